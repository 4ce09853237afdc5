// Culling method "clip_space": two stages per pixel (Wu et al. 2015; Wu 2013), corrected.
//
// p_k(t, u) = x_k(t) + u c_k(t) - X w_k(t) is corner k relative to the pixel: bilinear. A sample
// can be hit only where p is not above zero for all three corners, nor below. Stage I leaves out
// the u at which all six corners, of both ends, lie on one side. Stage II bounds p from below and
// above by the bilinear blend of its least and greatest over the corners at t = 0, 1 and u = -1, 1;
// that bound's zero, t(u), is a rational function, which a line bounds: the chord where it bends
// away from what is kept, else the tangent at u = 0. The other axis has v.
//
// As printed, stage II has the chord for a greatest and the tangent for a least time, of the
// corners' own times, whatever way they bend; a triangle that grows about a pixel has corners'
// times outside of [0, 1] and covers it all the same; and there are poles: see clip_space_printed.
//
// Operations: path 198 (276), tile 412 (602), sample 20 (24).
#include "shared/effects.h"
#include "stochastic/cull/box.h"

typedef struct {
    Box box;
} Cull;

// Bounds t <= or >= from + by u: `side` is 1, -1, or 0 for none.
typedef struct {
    Lanes from, by, side;
} Line;

typedef struct {
#if LENS()
    Lanes low[2], high[2]; // of u and v
#endif
    Line lines[4];
} Bounded;

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
    return true;
}

// Values of all corners relative to the pixels along one axis, pushed apart by what the pixel
// spans: at both ends (k < 3, k >= 3), the least and the greatest.
typedef struct {
    Lanes least[6], most[6];
    float circle[6];
} Relative;

static INLINED void relative_to(const Moving *m, const float *p, const float *dp, Lanes place,
                                float size, Relative *r)
{
    for (int k = 0; k < 6; k++) {
        int i = k % 3;
        float t = k / 3, x = p[i] + t * dp[i], w = m->w[i] + t * m->dw[i];
        float more = size * fabs(w) + 2.0f * m->slack;
        Lanes middle = x - place * w;
        r->least[k] = middle - more, r->most[k] = middle + more;
        r->circle[k] = 0.0f;
#if LENS()
        r->circle[k] = m->c[i] + t * m->dc[i];
#endif
    }
}

#if LENS()
// Stage I: leave out the ends of [-1, 1] at which all of a[k] + u c[k] are above zero.
static void leave_out_above(const Lanes *a, const float *c, float sign, Lanes *low, Lanes *high)
{
    Lanes from = -2.0f, to = 2.0f; // where all are above zero
    for (int k = 0; k < 6; k++) {
        Lanes value = sign * a[k];
        float slope = sign * c[k];
        if (slope == 0.0f) from = value > 0.0f ? from : (Lanes)(3.0f);
        else if (slope > 0.0f) from = lanes_max(from, -value / slope);
        else to = lanes_min(to, -value / slope);
    }
    // An end of the lens lies in there when all are above zero: then what is kept begins at the
    // other.
    LaneMask first = (from < -1.0f) & (from < to), last = (to > 1.0f) & (from < to);
    *low = first ? lanes_max(*low, to - 1e-5f) : *low;
    *high = last ? lanes_min(*high, from + 1e-5f) : *high;
}
#endif

// Stage II: the line that bounds t where value[t][u], all corners' least, is not above zero. `sign`
// turns the greatest into that.
static Line line_of(const Lanes *a, const float *c, float sign)
{
    Lanes value[2][2];
    for (int end = 0; end < 2; end++)
        for (int side = 0; side < 2; side++) {
            Lanes least = INFINITY;
            for (int k = 3 * end; k < 3 * end + 3; k++)
                least = lanes_min(least, sign * (a[k] + (side ? c[k] : -c[k])));
            value[end][side] = least;
        }
    // value = alpha + beta t; alpha and beta are linear in u.
    Lanes alpha0 = 0.5f * (value[0][0] + value[0][1]), alpha1 = 0.5f * (value[0][1] - value[0][0]);
    Lanes end0 = 0.5f * (value[1][0] + value[1][1]), end1 = 0.5f * (value[1][1] - value[1][0]);
    Lanes beta0 = end0 - alpha0, beta1 = end1 - alpha1;
    Lanes beta_low = value[1][0] - value[0][0], beta_high = value[1][1] - value[0][1];
    LaneMask until = (beta_low > 0.0f) & (beta_high > 0.0f);
    LaneMask since = (beta_low < 0.0f) & (beta_high < 0.0f);
    Lanes side = until ? (Lanes)(1.0f) : since ? (Lanes)(-1.0f) : (Lanes)(0.0f);
    Lanes at_low = -value[0][0] / beta_low, at_high = -value[0][1] / beta_high;
    Lanes middle = -alpha0 / beta0;
    Lanes slope = (alpha0 * beta1 - alpha1 * beta0) / (beta0 * beta0);
    // A Moebius function bends one way between poles: compare the chord's middle.
    LaneMask convex = 0.5f * (at_low + at_high) >= middle;
    LaneMask chord = until ? convex : ~convex;
    Line line;
    line.from = chord ? 0.5f * (at_low + at_high) : middle;
    line.by = chord ? 0.5f * (at_high - at_low) : slope;
    Lanes rounding = 1e-5f * (1.0f + fabs(at_low) + fabs(at_high) + fabs(middle) + fabs(slope));
    line.from += side * rounding;
    line.side = rounding < 1e3f ? side : (Lanes)(0.0f); // next to a pole; NaN too
    return line;
}

static INLINED LaneMask bound_pixels(Tile *tile, const Moving *m, const Cull *cull, int block,
                                     Bounded *b)
{
    Lanes x = tile_middle(tile, block_x(block)), y = tile_middle(tile, block_y(block));
    float size = tile_half(tile);
    LaneMask in = tiles_in_path_box(tile, &cull->box, block);
    if (!any_lane(in)) return in;
    for (int axis = 0; axis < 2; axis++) {
        Relative r;
        if (axis == 0) relative_to(m, m->x, m->dx, x, size, &r);
        else relative_to(m, m->y, m->dy, y, size, &r);
#if LENS()
        b->low[axis] = -1.0f, b->high[axis] = 1.0f;
        leave_out_above(r.least, r.circle, 1.0f, b->low + axis, b->high + axis);
        leave_out_above(r.most, r.circle, -1.0f, b->low + axis, b->high + axis);
        in &= b->low[axis] <= b->high[axis];
#endif
        b->lines[2 * axis] = line_of(r.least, r.circle, 1.0f);
        b->lines[2 * axis + 1] = line_of(r.most, r.circle, -1.0f);
    }
    return in;
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *b, const SlabSamples *slab, LaneMask mask)
{
#if LENS()
    Lanes lens[2] = {slab->at.u, slab->at.v};
    for (int axis = 0; axis < 2; axis++)
        mask &= (lens[axis] >= b->low[axis]) & (lens[axis] <= b->high[axis]);
#else
    Lanes lens[2] = {0.0f, 0.0f};
#endif
    COUNT(tile, stage1, mask);
    for (int k = 0; k < 4; k++) {
        const Line *line = b->lines + k;
        mask &= (line->side == 0.0f)
                | (line->side * (slab->tau - (line->from + line->by * lens[k / 2])) <= 0.0f);
    }
    return mask;
}

#include "stochastic/cull/scan_paths.h"
