// Exact depth of motion paths at a sample: w(t) = d / e with d cubic and e quadratic in time, and the
// times at which two of them change order.
#ifndef MB_DEPTH_H
#define MB_DEPTH_H

#include "analytic/tile.h"
#include "shared/bernstein.h"
#include "shared/quintic.h"

// Depth of one path at one sample: w = d / e over the path's motion segment.
typedef struct {
    double d[4], e[3];
    float open, length;
} DepthCurve;

static DepthCurve depth_curve(const Tile *tile, uint path_index, float x, float y)
{
    global const Depth *depth = tile->scene.depths + path_index;
    DepthCurve curve;
    for (int i = 0; i < 4; i++) curve.d[i] = depth->d[i];
    for (int i = 0; i < 3; i++)
        curve.e[i] = fma((double)x, depth->x[i], fma((double)y, depth->y[i], depth->w[i]));
    curve.open = tile->scene.paths[path_index].open;
    curve.length = tile->scene.paths[path_index].length;
    return curve;
}

static double curve_depth(const DepthCurve *c, double t)
{
    double tau = (t - c->open) / c->length, s = 1.0 - tau;
    double e = s * (s * c->e[0] + tau * c->e[1]) + tau * (s * c->e[1] + tau * c->e[2]);
    return bernstein_cubic(c->d, tau) / e;
}

// Relative size below which two depths count as equal.
#define EQUAL_DEPTH 1e-12

// Compare two paths on [low, high): how often they change order, at which times, and whether a is in
// front at first. Equal depths throughout: the path with the lower index is in front.
static int compare_depths(const Tile *tile, uint a, uint b, float x, float y, double low,
                          double high, double *times, bool *a_first)
{
    DepthCurve ca = depth_curve(tile, a, x, y), cb = depth_curve(tile, b, x, y);
    double la = (low - ca.open) / ca.length, ha = (high - ca.open) / ca.length;
    double lb = (low - cb.open) / cb.length, hb = (high - cb.open) / cb.length;
    double ea[3], eb[3], da[4], db[4], fa[QUINTIC], fb[QUINTIC], g[QUINTIC];
    restrict_quadratic(ca.e, la, ha, ea), restrict_cubic(ca.d, la, ha, da);
    restrict_quadratic(cb.e, lb, hb, eb), restrict_cubic(cb.d, lb, hb, db);
    multiply_to_quintic(ea, db, fa), multiply_to_quintic(eb, da, fb);
    // Both d keep one sign where the paths are hit. 1/w is e/d.
    double sign = (da[0] + da[1] + da[2] + da[3] < 0.0) == (db[0] + db[1] + db[2] + db[3] < 0.0)
                      ? 1.0 : -1.0;
    bool equal = true;
    for (int i = 0; i < QUINTIC; i++) {
        g[i] = sign * (fa[i] - fb[i]);
        bool same = fabs(g[i]) <= EQUAL_DEPTH * (fabs(fa[i]) + fabs(fb[i]));
        g[i] = same ? 0.0 : g[i];
        equal &= same;
    }
    *a_first = a < b;
    if (equal) return 0;
    for (int i = QUINTIC - 1; i >= 0; i--)
        if (g[i] != 0.0) *a_first = g[i] > 0.0;
    if (quintic_variations(g) == 0) return 0;
    int count = quintic_roots(g, times);
    for (int i = 0; i < count; i++) times[i] = low + (high - low) * times[i];
    return count;
}

#endif
