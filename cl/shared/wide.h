// Eight doubles at a time, for what must be exact.
#ifndef MB_WIDE_H
#define MB_WIDE_H

#define WIDE 8
typedef double8 Wide;
typedef long8 WideMask;

static inline Wide wide_max(Wide a, Wide b) { return a > b ? a : b; }
static inline Wide wide_min(Wide a, Wide b) { return a < b ? a : b; }

#endif
