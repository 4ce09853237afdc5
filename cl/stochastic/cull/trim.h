// Culling method "trim": the box, and no sample from a time at which the triangle is out of the
// frame or behind the eye (Laine et al. 2011, 3.2, their trimming of the time range alone).
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
    return mask & (tau >= cull->t_low) & (tau <= cull->t_high);
}

#include "stochastic/cull/scan.h"
