// Culling methods "zmax" and "zmax_strata": the box, and no path in a tile all of whose samples
// have seen something nearer than any of its corners; with ZMAX_STRATA one greatest depth for each
// slab of time (Akenine-Moeller et al. 2007, 3.4).
//
// Operations: path 216 (294), tile 8, sample 0.
// With ZMAX_STRATA also 22 for each slab.
#include "shared/effects.h"
#include "stochastic/cull/box.h"
#include "stochastic/cull/depth_bounds.h"

typedef struct {
    Box box;
} Cull;

typedef struct {
    int unused;
} Bounded;

static float far_of_slab(const Tile *tile, int slab)
{
    return lanes_greatest(lanes_load(tile->block_far + slab * BLOCKS));
}

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
#if !CULL_ZMAX_STRATA()
    float far = 0.0f;
    for (int slab = 0; slab < tile->slabs; slab++) far = fmax(far, far_of_slab(tile, slab));
    if (least_depth(m, 0.0f, 1.0f) > far) return false;
#endif
    return true;
}

static INLINED LaneMask bound_pixels(Tile *tile, const Moving *m, const Cull *cull, int block,
                                     Bounded *bounded)
{
    bounded->unused = 0;
    return tiles_in_path_box(tile, &cull->box, block);
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *bounded, const SlabSamples *slab, LaneMask mask)
{
#if CULL_ZMAX_STRATA()
    float2 t = times_of_slab(tile, m, slab->index);
    if (least_depth(m, t.x, t.y) > far_of_slab(tile, slab->index)) mask = 0;
#endif
    return mask;
}

#include "stochastic/cull/scan_paths.h"
