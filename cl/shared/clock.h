// The time that stages take: ticks of the core's clock, 0 where the compiler knows of none.
#ifndef MB_CLOCK_H
#define MB_CLOCK_H

#include "shared/effects.h"

#if CLANG_BUILTINS()
#define TICKS() __builtin_readcyclecounter()
#else
#define TICKS() 0ul
#endif

// Add the time since *clock to the stage's, and set the clock. Passes its argument on.
static inline bool clocked(bool done, int stage, global ulong *ticks, ulong *clock)
{
    ulong now = TICKS();
    ticks[stage] += now - *clock;
    *clock = now;
    return done;
}

#endif
