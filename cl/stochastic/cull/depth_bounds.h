// Depths that a path may have for a stretch of its segment, and those that a tile has seen
// (Akenine-Moeller et al. 2007, 3.4). The paper's second bound, from the planes of the triangle at
// the start and the end, is left out: depth at a tile's corner is no blend of the two in between.
#ifndef MB_DEPTH_BOUNDS_H
#define MB_DEPTH_BOUNDS_H

#include "stochastic/test.h"

// Least depth that the path may have from time t0 to t1 of its segment, or less.
static float least_depth(const Moving *m, float t0, float t1)
{
    float low = INFINITY;
    for (int i = 0; i < 3; i++)
        low = fmin(low, m->w[i] + fmin(t0 * m->dw[i], t1 * m->dw[i]));
    return low <= 0.0f ? 0.0f : low * m->size * (1.0f - 1e-5f);
}

// Likewise the greatest, or more.
static float greatest_depth(const Moving *m, float t0, float t1)
{
    float high = 0.0f;
    for (int i = 0; i < 3; i++)
        high = fmax(high, m->w[i] + fmax(t0 * m->dw[i], t1 * m->dw[i]));
    return high * m->size * (1.0f + 1e-5f);
}

// The stretch of the path's segment that a slab's samples come from.
static float2 times_of_slab(const Tile *tile, const Moving *m, int slab)
{
    return (float2)(clamp((tile->t_low[slab] - m->open) * m->rate, 0.0f, 1.0f),
                    clamp((tile->t_high[slab] - m->open) * m->rate, 0.0f, 1.0f));
}

#endif
