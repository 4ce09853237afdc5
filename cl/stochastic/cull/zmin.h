// Culling methods "zmin" and "zmin_strata": the box, and no comparison of depths for a path all of
// whose corners are nearer than everything that a tile has seen: what it covers it hides. With
// ZMIN_STRATA one least depth for each slab of time (Akenine-Moeller et al. 2007, 3.4).
//
// Operations: path 222 (300), tile 8, sample 0.
// With ZMIN_STRATA also 22 for each slab.
#include "shared/effects.h"
#include "stochastic/cull/box.h"
#include "stochastic/cull/depth_bounds.h"

typedef struct {
    Box box;
    bool first[MOST_SLABS]; // before all that the slab has seen
} Cull;

typedef struct {
    int unused;
} Bounded;

static float near_of_slab(const Tile *tile, int slab)
{
    return lanes_least(lanes_load(tile->block_near + slab * BLOCKS));
}

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
    float near = INFINITY, greatest = greatest_depth(m, 0.0f, 1.0f);
    for (int slab = 0; slab < tile->slabs; slab++) near = fmin(near, near_of_slab(tile, slab));
    for (int slab = 0; slab < tile->slabs; slab++) {
#if CULL_ZMIN_STRATA()
        float2 t = times_of_slab(tile, m, slab);
        greatest = greatest_depth(m, t.x, t.y), near = near_of_slab(tile, slab);
#endif
        cull->first[slab] = greatest < near;
    }
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
    return mask;
}

#include "stochastic/cull/scan_paths.h"
