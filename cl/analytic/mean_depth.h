// The mean depth of a span over its time, weighted as the shutter is.
//
// Depth is d / e, a cubic over a quadratic in time: as smooth as the roots of e, at which the
// triangle is seen edge-on, are far away. On a stretch around whose middle no root lies within R
// half lengths, Gauss's rule with n points takes the mean of 1 / (R - x) for it with an error of pi
// (R + sqrt(R^2 - 1))^-(2 n + 1), more or less: 1e-8 for n = 8 and R = 7/4. So a span is cut where
// the shutter's curve has a corner, and then into halves of halves that are so, down to 2^-24 of
// its length, what float32 tells apart.
//
// Triangulated paths have depths that are linear along an interval: the mean is that at the mean
// time.
#ifndef MB_MEAN_DEPTH_H
#define MB_MEAN_DEPTH_H

#include "shared/effects.h"
#include "analytic/line_window.h"
#if EXACT()
#include "analytic/varying_exact.h"
#else
#include "analytic/varying_surface.h"
#endif

#if SHUTTER_CURVE()

// A span in the time of its line's exposure, [0, 1]: its middle and half its length, and the first
// and last of the stretches between keys of the shutter's curve that it lies in.
typedef struct {
    float middle, extent;
    uint first, last;
} Exposed;

static inline Exposed exposed_in(const Scene *scene, float2 window, Span span)
{
    float t0 = span.t0, t1 = span.t1;
#if ROLLING()
    const float length = window.y - window.x;
    t0 = (t0 - window.x) / length, t1 = (t1 - window.x) / length;
#endif
    const uint most = scene->numbers.shutter_keys - 2u;
    Exposed found = {0.5f * (t0 + t1), 0.5f * (t1 - t0), 0u, 0u};
    while (found.first < most && scene->shutter[found.first + 1u].t <= t0) found.first++;
    found.last = found.first;
    while (found.last < most && scene->shutter[found.last + 1u].t < t1) found.last++;
    return found;
}

// The stretch after key k in x, which goes from -1 to 1 over the span, and how far the shutter is
// open in it: line.x + line.y x.
typedef struct {
    double2 interval, line;
} Stretch;

static inline Stretch stretch_of(const Scene *scene, const Exposed *e, uint k)
{
    const ShutterKey a = scene->shutter[k], b = scene->shutter[k + 1u];
    const float over = 1.0f / (b.t - a.t);
    Stretch s = {(double2)(-1.0, 1.0)};
    if (k > e->first) s.interval.x = ((double)a.t - e->middle) / e->extent;
    if (k < e->last) s.interval.y = ((double)b.t - e->middle) / e->extent;
    s.line.x = (a.open * (b.t - e->middle) + b.open * (e->middle - a.t)) * over;
    s.line.y = (b.open - a.open) * (e->extent * over);
    return s;
}

#endif

#if EXACT()

#define FAR_ROOT 1.75
#define SHORTEST_PART 0x1p-24

// Of the nodes x and -x of Gauss's rule with eight points on [-1, 1]: x^2, and the weight of both,
// by half.
#define GAUSS_SQUARES ((double4)(0.92215660849205860, 0.63467747623463673, 0.27618431387246446, \
    0.033648268067506840))
#define GAUSS_WEIGHTS ((double4)(0.10122853629037626, 0.22238103445337448, 0.31370664587788727, \
    0.36268378337836199))

// Depth over a part of a span: d / e, both polynomials in x, which goes from -1 to 1 over it.
typedef struct {
    double d[4], e[3];
} Ratio;

// The ratio from m - size to m + size of x.
static inline Ratio ratio_within(const Ratio *r, double m, double size)
{
    const double *d = r->d, *e = r->e, square = size * size, d3 = 3.0 * d[3];
    return (Ratio){
        {((d[3] * m + d[2]) * m + d[1]) * m + d[0], ((d3 * m + 2.0 * d[2]) * m + d[1]) * size,
         (d3 * m + d[2]) * square, d[3] * (size * square)},
        {(e[2] * m + e[1]) * m + e[0], (2.0 * e[2] * m + e[1]) * size, e[2] * square},
    };
}

// The ratio over times t0 to t1 of the shutter.
static inline Ratio ratio_over(const DepthCurve *c, float t0, float t1)
{
    const double *d = c->d, *e = c->e, over = 0.5 / c->length;
    const double middle = ((double)t0 + t1 - 2.0 * c->open) * over;
    const Ratio segment = {
        {d[0], 3.0 * (d[1] - d[0]), 3.0 * ((d[0] + d[2]) - 2.0 * d[1]),
         (d[3] - d[0]) + 3.0 * (d[1] - d[2])},
        {e[0], 2.0 * (e[1] - e[0]), (e[0] + e[2]) - 2.0 * e[1]},
    };
    return ratio_within(&segment, middle, ((double)t1 - t0) * over);
}

// Whether no root of e is near.
static inline bool roots_are_far(const Ratio *r)
{
    return FAR_ROOT * fabs(r->e[1]) + FAR_ROOT * FAR_ROOT * fabs(r->e[2]) <= fabs(r->e[0]);
}

// Means of depth, and of depth times x: half of the sum, and of the difference, at x and -x.
static inline double2 gauss_means(const Ratio *r)
{
    const double4 x2 = GAUSS_SQUARES;
    double4 d_even = r->d[0] + r->d[2] * x2, d_odd = r->d[1] + r->d[3] * x2;
    double4 e_even = r->e[0] + r->e[2] * x2;
    double4 part = GAUSS_WEIGHTS / (e_even * e_even - x2 * (r->e[1] * r->e[1]));
    double4 sum = part * (d_even * e_even - x2 * d_odd * r->e[1]);
#if SHUTTER_CURVE()
    double4 difference = x2 * part * (d_odd * e_even - d_even * r->e[1]);
#else
    double4 difference = 0.0;
#endif
    return (double2)((sum.x + sum.y) + (sum.z + sum.w),
                     (difference.x + difference.y) + (difference.z + difference.w));
}

// A span's depth, and bounds of it.
typedef struct {
    Ratio ratio;
    float near, far;
} SpanDepth;

static inline double within_bounds(const SpanDepth *s, double w)
{
    w = w > s->near ? w : s->near; // what is not a number is near
    return w < s->far ? w : s->far;
}

// Integrals of depth times how far the shutter is open, and of the latter alone, over x from
// interval.x to interval.y in the span, where it is open by line.x + line.y x.
NOT_INLINED static double2 depth_integral(const SpanDepth *s, double2 interval, double2 line)
{
    double2 sum = 0.0;
    for (double begin = interval.x, end; begin < interval.y; begin = end) {
        Ratio part;
        double size;
        bool far;
        for (end = interval.y;; end = 0.5 * (begin + end)) {
            size = 0.5 * (end - begin);
            part = ratio_within(&s->ratio, 0.5 * (begin + end), size);
            far = roots_are_far(&part);
            if (far || size <= SHORTEST_PART) break;
        }
        double2 means = gauss_means(&part);
        double light = 2.0 * size * (line.x + line.y * (0.5 * (begin + end)));
        sum += (double2)(light * within_bounds(s, means.x), light);
        if (far) sum.x += 2.0 * size * size * line.y * means.y;
    }
    return sum;
}

#if SHUTTER_CURVE()

// The mean over all stretches of the curve; anything there is if it is zero in them.
static inline double mean_by_curve(const Scene *scene, const SpanDepth *s, const Exposed *exposed)
{
    if (exposed->first == exposed->last && roots_are_far(&s->ratio)) {
        double2 means = gauss_means(&s->ratio);
        double2 line = stretch_of(scene, exposed, exposed->first).line;
        float slope = (float)line.y / (float)line.x;
        return line.x > 0.0 ? means.x + slope * means.y : means.x;
    }
    double2 sum = 0.0;
    for (uint k = exposed->first; k <= exposed->last; k++) {
        const Stretch stretch = stretch_of(scene, exposed, k);
        sum += depth_integral(s, stretch.interval, stretch.line);
    }
    return sum.y > 0.0 ? sum.x / sum.y : s->ratio.d[0] / s->ratio.e[0];
}

#endif

// Mean depth of what a sample sees in a span.
static float mean_depth(const Tile *tile, float2 window, Span span, Place place)
{
    bool rests = tile->scene.paths[span.source].step == 0u;
    if (rests || !(span.t0 < span.t1))
        return span_depth(tile, span, place, 0.5f * (span.t0 + span.t1));
    const DepthCurve curve = depth_curve(tile, span.source, place);
    const SpanDepth s = {ratio_over(&curve, span.t0, span.t1), tile->depths[span.source].near,
                         tile->depths[span.source].far};
#if SHUTTER_CURVE()
    const Exposed exposed = exposed_in(&tile->scene, window, span);
    return (float)within_bounds(&s, mean_by_curve(&tile->scene, &s, &exposed));
#else
    if (roots_are_far(&s.ratio)) return (float)within_bounds(&s, gauss_means(&s.ratio).x);
    double2 sum = depth_integral(&s, (double2)(-1.0, 1.0), (double2)(1.0, 0.0));
    return (float)within_bounds(&s, sum.x / sum.y);
#endif
}

#else

static float mean_depth(const Tile *tile, float2 window, Span span, Place place)
{
    float mean = 0.5f * (span.t0 + span.t1);
#if SHUTTER_CURVE()
    const Exposed exposed = exposed_in(&tile->scene, window, span);
    double light = 0.0, moment = 0.0; // integrals of the openness, and of it times x
    for (uint k = exposed.first; k <= exposed.last; k++) {
        const Stretch s = stretch_of(&tile->scene, &exposed, k);
        const double x0 = s.interval.x, x1 = s.interval.y;
        light += (x1 - x0) * (s.line.x + s.line.y * (0.5 * (x0 + x1)));
        moment += (x1 * x1 - x0 * x0) * (0.5 * s.line.x);
        moment += (x1 * x1 * x1 - x0 * x0 * x0) * (s.line.y / 3.0);
    }
    if (light > 0.0) mean += (float)(moment / light) * (0.5f * (span.t1 - span.t0));
#endif
    return span_depth(tile, span, place, mean);
}

#endif

#endif
