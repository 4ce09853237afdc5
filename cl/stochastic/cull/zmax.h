// Culling methods "zmax" and "zmax_strata": the box, and no path in a tile all of whose samples
// have seen something nearer than any of its corners; with ZMAX_STRATA one greatest depth for each
// slab of time (Akenine-Moeller et al. 2007, 3.4). The paper's second bound, from the planes of the
// triangle at the start and the end, is left out: depth at a tile's corner is no blend of the two
// in between.
#include "stochastic/cull/box.h"

typedef struct {
    Box box;
} Cull;

typedef struct {
    int unused;
} Bounded;

// Least depth that the path may have from time t0 to t1 of its segment, or less.
static float least_depth(const Moving *m, float t0, float t1)
{
    float low = INFINITY;
    for (int i = 0; i < 3; i++)
        low = fmin(low, m->w[i] + fmin(t0 * m->dw[i], t1 * m->dw[i]));
    return low <= 0.0f ? 0.0f : low * m->size * (1.0f - 1e-5f);
}

static float far_of_slab(const Tile *tile, int slab)
{
    return greatest_lane(vload16(0, tile->block_far + slab * BLOCKS));
}

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
#ifndef ZMAX_STRATA
    float far = 0.0f;
    for (int slab = 0; slab < tile->slabs; slab++) far = fmax(far, far_of_slab(tile, slab));
    if (least_depth(m, 0.0f, 1.0f) > far) return false;
#endif
    return true;
}

static LaneMask bound_pixels(const Tile *tile, const Moving *m, const Cull *cull, int block,
                             Bounded *bounded)
{
    Lanes x = tile_middle(tile, block_x(block)), y = tile_middle(tile, block_y(block));
    bounded->unused = 0;
    return tiles_in_box(&cull->box, x, y, tile_half(tile));
}

static inline LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                    const Bounded *bounded, const Samples *s, Lanes tau, int slab,
                                    LaneMask mask)
{
#ifdef ZMAX_STRATA
    float from = clamp((tile->t_low[slab] - m->open) * m->rate, 0.0f, 1.0f);
    float to = clamp((tile->t_high[slab] - m->open) * m->rate, 0.0f, 1.0f);
    if (least_depth(m, from, to) > far_of_slab(tile, slab)) mask = 0;
#endif
    return mask;
}

#include "stochastic/cull/scan.h"
