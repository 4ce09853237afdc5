// What a render finds besides its image: planes of 32-bit words, one for each channel. Each layer
// that is asked for is an effect, AOV_NORMAL for one, and its first plane a size, PLANE_NORMAL, as
// mbinterval/film/aovs.py orders them. AOV_MESH is where both objects and materials come from.
#ifndef MB_AOV_H
#define MB_AOV_H

#include "shared/effects.h"

// What goes with them; what is not asked for is not there.
typedef struct {
    size_t size;                   // words of a plane: pixels of the film
#if MOMENTARY() || AOV_OPERATIONS()
    global uint *planes;
#endif
#if AOV_SHARP()
    global float4 *sharp;          // the film at the moment
#endif
#if AOV_FORWARD()
    global const double *forward;  // where vertices are in the next frame, x w, y w and w
#endif
#if AOV_BACKWARD()
    global const double *backward; // in the one before
#endif
} Aovs;

#endif
