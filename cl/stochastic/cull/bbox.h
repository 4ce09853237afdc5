// Culling method "bbox": every sample of the pixels that the path's box on screen touches is
// tested.
//
// Operations: path 198 (276), tile 8, sample 0.
#include "stochastic/cull/box.h"

typedef struct {
    Box box;
} Cull;

typedef struct {
    int unused;
} Bounded;

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
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
