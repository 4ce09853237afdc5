// Culling method "interleave_uvt": a sample is tested when the box of the triangle at the sample's
// own time and point of the lens, snapped to tiles of 2 x 2 pixels, touches its tile (Fatahalian et
// al. 2009). With the pattern of the same name there are only four times as many such times and
// points as a pixel has samples; here the box is found for each sample anew, at the same counts.
//
// Operations: stratum 50 (59), tile 8, sample 0.
// As published: one stratum for each of the pattern's times and points of the lens.
#include "shared/effects.h"
#include "stochastic/cull/box.h"

typedef struct {
    Box box;
} Cull;

typedef struct {
    Lanes x, y; // middles of the tiles of 2 x 2 pixels
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
    float to_middle = 0.5f * (1.0f + tile->reach_low + tile->reach_high) - HALF;
    bounded->x = floor(block_x(block) * 0.5f) * 2.0f + to_middle;
    bounded->y = floor(block_y(block) * 0.5f) * 2.0f + to_middle;
    float size = 0.5f * (1.0f + tile->reach_high - tile->reach_low) * (1.0f + 1e-6f);
    LaneMask in = tiles_in_box(&cull->box, bounded->x, bounded->y, size);
    COUNT(tile, bounded, in);
    return in;
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *bounded, const SlabSamples *slab, LaneMask mask)
{
    Lanes left = INFINITY, right = -INFINITY, top = INFINITY, bottom = -INFINITY;
    LaneMask behind = 0;
    for (int i = 0; i < 3; i++) {
        Lanes w = m->w[i] + slab->tau * m->dw[i], over = 1.0f / w, slack = m->slack * over + 1e-3f;
        Lanes x = m->x[i] + slab->tau * m->dx[i], y = m->y[i] + slab->tau * m->dy[i];
#if LENS()
        Lanes circle = m->c[i] + slab->tau * m->dc[i];
        x += slab->at.u * circle, y += slab->at.v * circle;
#endif
        behind |= !(w > m->slack);
        left = lanes_min(left, x * over - slack), right = lanes_max(right, x * over + slack);
        top = lanes_min(top, y * over - slack), bottom = lanes_max(bottom, y * over + slack);
    }
    float size = 0.5f * (1.0f + tile->reach_high - tile->reach_low) * (1.0f + 1e-6f);
    return mask & (behind | ((bounded->x + size >= left) & (bounded->x - size <= right)
                             & (bounded->y + size >= top) & (bounded->y - size <= bottom)));
}

#include "stochastic/cull/scan_paths.h"
