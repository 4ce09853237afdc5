// Exact depth of motion paths at a sample: w(t) = d / e with d cubic and e quadratic in time, and
// the times at which two of them change order.
#ifndef MB_DEPTH_CURVE_H
#define MB_DEPTH_CURVE_H

#include "shared/effects.h"
#include "analytic/edges.h"
#include "shared/bernstein.h"
#include "shared/quintic.h"

// Depth of one path at one sample: w = d / e over the path's motion segment.
typedef struct {
    double d[4], e[3];
    float open, length;
} DepthCurve;

static void depth_from_edges(const Tile *tile, uint path_index, Place place, DepthCurve *curve)
{
    MovingTriangle triangle;
    load_seen(tile, path_index, place, &triangle);
    depth_of_edges(&triangle, place, curve->d, curve->e);
}

// Part of its terms below which a sum has lost too many digits: a needle, or seen edge-on.
#define CANCELLED 1e-6

static DepthCurve depth_curve(const Tile *tile, uint path_index, Place place)
{
    DepthCurve curve;
    global const Depth *depth = tile->depths + path_index;
    curve.open = depth->open, curve.length = depth->length;
#if LENS()
    depth_from_edges(tile, path_index, place, &curve);
#else
#if GLOSSY()
    if (tile->scene.meshes[tile->scene.paths[path_index].mesh].sheared) {
        depth_from_edges(tile, path_index, place, &curve);
        return curve;
    }
#endif
    double x = place.x, y = place.y, most = 0.0, terms = 0.0;
    for (int i = 0; i < 4; i++) curve.d[i] = depth->d[i];
    for (int i = 0; i < 3; i++) {
        double along_x = x * depth->x[i], along_y = y * depth->y[i];
        curve.e[i] = along_x + along_y + depth->w[i];
        most += fabs(curve.e[i]), terms += fabs(along_x) + fabs(along_y) + fabs(depth->w[i]);
    }
    if (most < CANCELLED * terms) depth_from_edges(tile, path_index, place, &curve);
#endif
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

// A curve on [low, high) of the shutter, its signs such that d and e are positive where it is hit.
static DepthCurve restrict_curve(const DepthCurve *c, double low, double high)
{
    DepthCurve r;
    double l = (low - c->open) / c->length, h = (high - c->open) / c->length;
    restrict_cubic(c->d, l, h, r.d);
    restrict_quadratic(c->e, l, h, r.e);
    double sign = r.d[0] + r.d[1] + r.d[2] + r.d[3] < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 4; i++) r.d[i] *= sign;
    for (int i = 0; i < 3; i++) r.e[i] *= sign;
    return r;
}

// Whether a is in front of b throughout, by bounds of d and e.
static bool surely_before(const DepthCurve *a, const DepthCurve *b)
{
    double a_far = fmax(fmax(a->d[0], a->d[1]), fmax(a->d[2], a->d[3]));
    double b_near = fmin(fmin(b->d[0], b->d[1]), fmin(b->d[2], b->d[3]));
    double a_e = fmin(fmin(a->e[0], a->e[1]), a->e[2]), b_e = fmax(fmax(b->e[0], b->e[1]), b->e[2]);
    return b_near > 0.0 && a_e > 0.0 && a_far * b_e < b_near * a_e * (1.0 - EQUAL_DEPTH);
}

// Compare two paths on [low, high): how often they change order, at which times, and whether a is
// in front at first. Equal depths throughout: the path with the lower index is in front.
static int compare_depths(const Tile *tile, uint a, uint b, Place place, double low, double high,
                          double *times, bool *a_first)
{
    DepthCurve ca = depth_curve(tile, a, place), cb = depth_curve(tile, b, place);
    ca = restrict_curve(&ca, low, high), cb = restrict_curve(&cb, low, high);
    *a_first = surely_before(&ca, &cb);
    if (*a_first || surely_before(&cb, &ca)) return 0;
    // 1/w is e/d: a is in front while e_a d_b - e_b d_a is above zero.
    double fa[QUINTIC], fb[QUINTIC], g[QUINTIC];
    multiply_to_quintic(ca.e, cb.d, fa), multiply_to_quintic(cb.e, ca.d, fb);
    bool equal = true;
    for (int i = 0; i < QUINTIC; i++) {
        g[i] = fa[i] - fb[i];
        if (fabs(g[i]) <= EQUAL_DEPTH * (fabs(fa[i]) + fabs(fb[i]))) g[i] = 0.0;
        equal &= g[i] == 0.0;
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
