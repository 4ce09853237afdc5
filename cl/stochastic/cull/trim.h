// Culling method "trim": the box, and no sample from a time at which the triangle is out of the
// frame or behind the eye (Laine et al. 2011, 3.2, their trimming of the time range alone).
//
// Operations: path 498 (666), tile 8, sample 2.
#include "stochastic/cull/time.h"

typedef struct {
    Box box;
    float t_low, t_high;
} Cull;

typedef struct {
    int unused;
} Bounded;

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
    return trim_to_frame(tile, m, &cull->t_low, &cull->t_high);
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
    return mask & (slab->tau >= cull->t_low) & (slab->tau <= cull->t_high);
}

#include "stochastic/cull/scan_paths.h"
