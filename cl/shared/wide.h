// Eight doubles at a time, for what must be exact.
#ifndef MB_WIDE_H
#define MB_WIDE_H

#include "shared/inlining.h"

#define WIDE 8
typedef double8 Wide;
typedef long8 WideMask;

static INLINED Wide wide_max(Wide a, Wide b) { return a > b ? a : b; }
static INLINED Wide wide_min(Wide a, Wide b) { return a < b ? a : b; }

#endif
