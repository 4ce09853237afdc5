// The coordinates of samples: x and y on the film; u and v on the lens, where there is one; a and b
// on the disc that glossy mirrors blur over. Records have members of these names for those that
// there are, and each list here repeats DO(name) for its own.
#ifndef MB_COORDINATES_H
#define MB_COORDINATES_H

#include "shared/effects.h"

#if LENS()
#define LENS_COORDINATES(DO) DO(u) DO(v)
#else
#define LENS_COORDINATES(DO)
#endif

#if GLOSSY()
#define DISC_COORDINATES(DO) DO(a) DO(b)
#else
#define DISC_COORDINATES(DO)
#endif

#define MORE_COORDINATES(DO) LENS_COORDINATES(DO) DISC_COORDINATES(DO)
#define COORDINATES(DO) DO(x) DO(y) MORE_COORDINATES(DO)

#endif
