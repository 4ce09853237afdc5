// Culling method "clip_space_printed": the two stages as Wu et al. 2015 (3.2, 3.3) print them, kept
// to show what they lose; clip_space has the corrected bounds.
//
// Stage I keeps u between the least and the greatest of the six corners' u = (X w - x) / c. Stage
// II keeps t between two lines: through the greatest of the three corners' times at u = -1 and at u
// = 1, and likewise of the least of tangents at u = 0. The pixel's extent is not in the paper: here
// each corner's bounds are those at both sides of the pixel.
//
// Operations: path 198 (276), tile 284 (368), sample 16 (20).
#include "shared/effects.h"
#include "stochastic/cull/box.h"

typedef struct {
    Box box;
    bool moves; // else there are no times to bound
} Cull;

typedef struct {
#if LENS()
    Lanes lens_low[2], lens_high[2];
#endif
    Lanes t_low[2][2], t_high[2][2]; // [axis][u = -1, 1]
} Bounded;

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
    cull->moves = false;
    for (int i = 0; i < 3; i++)
        cull->moves |= m->dx[i] != 0.0f || m->dy[i] != 0.0f || m->dw[i] != 0.0f;
    return true;
}

// Widen the bounds of one axis by corner i as seen from one side of the pixels.
static INLINED void add_corner(const Moving *m, int i, const float *p, const float *dp, Lanes place,
                               int axis, Bounded *b)
{
    Lanes a0 = p[i] - place * m->w[i], a1 = p[i] + dp[i] - place * (m->w[i] + m->dw[i]);
    float c0 = 0.0f, c1 = 0.0f;
#if LENS()
    c0 = m->c[i], c1 = m->c[i] + m->dc[i];
    Lanes u0 = -a0 / c0, u1 = -a1 / c1;
    b->lens_low[axis] = lanes_min(b->lens_low[axis], lanes_min(u0, u1));
    b->lens_high[axis] = lanes_max(b->lens_high[axis], lanes_max(u0, u1));
#endif
    // t(u) = -(a0 + u c0) / ((a1 - a0) + u (c1 - c0))
    Lanes d0 = a1 - a0, d1 = c1 - c0;
    Lanes at_low = -(a0 - c0) / (d0 - d1), at_high = -(a0 + c0) / (d0 + d1);
    Lanes at_zero = -a0 / d0, slope = (a0 * d1 - c0 * d0) / (d0 * d0);
    b->t_high[axis][0] = lanes_max(b->t_high[axis][0], at_low);
    b->t_high[axis][1] = lanes_max(b->t_high[axis][1], at_high);
    b->t_low[axis][0] = lanes_min(b->t_low[axis][0], at_zero - slope);
    b->t_low[axis][1] = lanes_min(b->t_low[axis][1], at_zero + slope);
}

static INLINED LaneMask bound_pixels(Tile *tile, const Moving *m, const Cull *cull, int block,
                                     Bounded *b)
{
    Lanes x = tile_middle(tile, block_x(block)), y = tile_middle(tile, block_y(block));
    float size = tile_half(tile);
    LaneMask in = tiles_in_path_box(tile, &cull->box, block);
    if (!any_lane(in)) return in;
    for (int axis = 0; axis < 2; axis++) {
#if LENS()
        b->lens_low[axis] = INFINITY, b->lens_high[axis] = -INFINITY;
#endif
        for (int k = 0; k < 2; k++) b->t_low[axis][k] = INFINITY, b->t_high[axis][k] = -INFINITY;
        for (int i = 0; i < 6; i++) {
            float side = i < 3 ? -size : size;
            if (axis == 0) add_corner(m, i % 3, m->x, m->dx, x + side, axis, b);
            else add_corner(m, i % 3, m->y, m->dy, y + side, axis, b);
        }
    }
    return in;
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *b, const SlabSamples *slab, LaneMask mask)
{
    Lanes lens[2] = {0.0f, 0.0f};
#if LENS()
    lens[0] = slab->at.u, lens[1] = slab->at.v;
    for (int axis = 0; axis < 2; axis++)
        mask &= (lens[axis] >= b->lens_low[axis]) & (lens[axis] <= b->lens_high[axis]);
#endif
    COUNT(tile, stage1, mask);
    if (!cull->moves) return mask;
    for (int axis = 0; axis < 2; axis++) {
        Lanes part = 0.5f * (lens[axis] + 1.0f);
        Lanes low = b->t_low[axis][0] + part * (b->t_low[axis][1] - b->t_low[axis][0]);
        Lanes high = b->t_high[axis][0] + part * (b->t_high[axis][1] - b->t_high[axis][0]);
        mask &= (slab->tau >= low) & (slab->tau <= high);
    }
    return mask;
}

#include "stochastic/cull/scan_paths.h"
