// Culling method "dual_space": bounds of (u, v) and of t for each pixel, or tile of `cull_tile`
// pixels along an edge (Laine et al. 2011, 3.1 and 3.2). Here lens coordinates lie in [-1, 1], view
// directions gamma are pixels, and the middle of the tile is gamma = 0.
//
// On the lens: the box of all corners seen from u = -1 and that from u = 1; the box at any u lies
// within their blend. In time: delta = x - gamma w is linear in gamma and in t, so that its least
// and greatest over the corners lie within lines through their values at both ends of the range of
// gamma, blended over t. A hit needs least <= 0 <= greatest, wherever the corners are, behind the
// eye too.
//
// Operations: path 806 (1680), tile 49 (95), sample 2 (6).
#include "shared/effects.h"
#include "stochastic/cull/time.h"

// What one axis knows of a path.
typedef struct {
    float low[2], high[2];     // box at lens coordinate -1 and 1
    float least[2], least_by[2]; // of delta, at t = 0 and 1: value at gamma = 0 and slope
    float most[2], most_by[2];
} Axis;

typedef struct {
    Box box;
    Axis x, y;
    float t_low, t_high;
} Cull;

typedef struct {
    Lanes t_low, t_high;
#if LENS()
    Lanes u_low, u_high, v_low, v_high;
#endif
} Bounded;

// Line through the values at both ends of the range of gamma.
static void line_between(float from, float at_from, float to, float at_to, float *value,
                         float *slope)
{
    *slope = (at_to - at_from) / (to - from);
    *value = at_from - *slope * from;
}

static void begin_axis(const Moving *m, const float *p, const float *dp, float from, float to,
                       float size, Axis *axis)
{
    float place[6], low[6], high[6], w[6];
    for (int k = 0; k < 6; k++) {
        int i = k % 3;
        float t = k / 3;
        place[k] = p[i] + t * dp[i], w[k] = m->w[i] + t * m->dw[i];
    }
#if LENS()
    for (int side = 0; side < 2; side++) {
        float all_low[6], all_high[6], every_low, every_high;
        axis->low[side] = INFINITY, axis->high[side] = -INFINITY;
        for (int k = 0; k < 6; k++) {
            float c = m->c[k % 3] + (k / 3) * m->dc[k % 3];
            low[k] = high[k] = place[k] + (side ? c : -c);
            all_low[k] = place[k] - fabs(c), all_high[k] = place[k] + fabs(c);
            if (w[k] <= 0.0f) continue;
            axis->low[side] = fmin(axis->low[side], (low[k] - m->slack) / w[k] - 1e-3f);
            axis->high[side] = fmax(axis->high[side], (high[k] + m->slack) / w[k] + 1e-3f);
        }
        project_extent(all_low, all_high, w, 6, m->slack, &every_low, &every_high);
        if (every_low == -INFINITY) axis->low[side] = -INFINITY;
        if (every_high == INFINITY) axis->high[side] = INFINITY;
    }
#endif
    for (int end = 0; end < 2; end++) {
        float least[2] = {INFINITY, INFINITY}, most[2] = {-INFINITY, -INFINITY};
        for (int k = 3 * end; k < 3 * end + 3; k++) {
            float more = size * fabs(w[k]) + 2.0f * m->slack;
            more = out_by_lens(more, m, k % 3, end, 1.0f);
            for (int side = 0; side < 2; side++) {
                float gamma = side ? to : from, delta = place[k] - gamma * w[k];
                more += 1e-6f * (fabs(place[k]) + fabs(gamma * w[k]));
                least[side] = fmin(least[side], delta - more);
                most[side] = fmax(most[side], delta + more);
            }
        }
        line_between(from, least[0], to, least[1], axis->least + end, axis->least_by + end);
        line_between(from, most[0], to, most[1], axis->most + end, axis->most_by + end);
    }
}

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
    if (!trim_to_frame(tile, m, &cull->t_low, &cull->t_high)) return false;
    // The range of gamma: where the box lies in the frame, and a pixel at least.
    const float room = cull_edge(tile) + 1.0f;
    float left = clamp(cull->box.left, tile->frame.left, tile->frame.right) - room;
    float right = clamp(cull->box.right, tile->frame.left, tile->frame.right) + room;
    float top = clamp(cull->box.top, tile->frame.top, tile->frame.bottom) - room;
    float bottom = clamp(cull->box.bottom, tile->frame.top, tile->frame.bottom) + room;
    float size = tile_half(tile);
    begin_axis(m, m->x, m->dx, left, right, size, &cull->x);
    begin_axis(m, m->y, m->dy, top, bottom, size, &cull->y);
    return true;
}

// Times at which the axis' range of delta holds 0.
static INLINED void bound_time(const Axis *axis, Lanes gamma, Lanes *low, Lanes *high)
{
    below_zero(axis->least[0] + axis->least_by[0] * gamma,
               axis->least[1] + axis->least_by[1] * gamma, low, high);
    below_zero(-(axis->most[0] + axis->most_by[0] * gamma),
               -(axis->most[1] + axis->most_by[1] * gamma), low,
               high);
}

#if LENS()
// Lens coordinates, in [-1, 1], at which the box of that axis reaches the tile at `place`.
static INLINED void bound_lens(const Axis *axis, Lanes place, float size, Lanes *low, Lanes *high)
{
    Lanes first = 0.0f, last = 1.0f;
    if (axis->low[0] > -INFINITY)
        below_zero(axis->low[0] - (place + size), axis->low[1] - (place + size), &first, &last);
    if (axis->high[0] < INFINITY)
        below_zero((place - size) - axis->high[0], (place - size) - axis->high[1], &first, &last);
    *low = 2.0f * first - 1.0f, *high = 2.0f * last - 1.0f;
}
#endif

static INLINED LaneMask bound_pixels(Tile *tile, const Moving *m, const Cull *cull, int block,
                                     Bounded *b)
{
    Lanes x = tile_middle(tile, block_x(block)), y = tile_middle(tile, block_y(block));
    float size = tile_half(tile);
    LaneMask in = tiles_in_path_box(tile, &cull->box, block);
    if (!any_lane(in)) return in;
    b->t_low = cull->t_low, b->t_high = cull->t_high;
    bound_time(&cull->x, x, &b->t_low, &b->t_high);
    bound_time(&cull->y, y, &b->t_low, &b->t_high);
    in &= b->t_low <= b->t_high;
#if LENS()
    bound_lens(&cull->x, x, size, &b->u_low, &b->u_high);
    bound_lens(&cull->y, y, size, &b->v_low, &b->v_high);
    in &= (b->u_low <= b->u_high) & (b->v_low <= b->v_high);
#endif
    return in;
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *b, const SlabSamples *slab, LaneMask mask)
{
#if LENS()
    const Lanes u = slab->at.u, v = slab->at.v;
    mask &= (u >= b->u_low) & (u <= b->u_high) & (v >= b->v_low) & (v <= b->v_high);
#endif
    COUNT(tile, stage1, mask);
    return mask & (slab->tau >= b->t_low) & (slab->tau <= b->t_high);
}

#include "stochastic/cull/scan_paths.h"
