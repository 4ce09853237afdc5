// Averages over a span of time: at how many places it is evaluated, and where.
//
// With `shading_times` at the middles of so many equal parts (Hong & Oh 2017, 3.2), sixteen at a
// time. Else at as many as it takes: at the middles of fifteen parts first. The error of that
// rule is 1/24 of the mean second difference of the colours there where they are smooth in time,
// and no more than 1/8 of its size where they have a corner. Where the latter is above
// `shading_error` the stretch is halved, and each half treated alike, up to 960 parts in all. So
// colour is off by no more than `shading_error` times what the span weighs, as far as a rule can
// tell that sees points only; shade.cl says of textures and highlights when the points are too
// far apart to tell.
#ifndef MB_QUADRATURE_H
#define MB_QUADRATURE_H

#include "shared/effects.h"
#include "analytic/line_window.h"
#include "shared/lanes.h"
#include "shared/colors.h"

// Places of a span in time: the middles of n equal parts, `count` of them at hand, from `first` on.
typedef struct {
    int first, count, n;
} Instants;

#if SHADING_ERROR()
#define PLACES 15
#define MOST_PLACES (PLACES << 6)
#define SPACING 1.0f // texels between places that a rule is judged by
#endif

// The first places of a span: one where it has no length.
static inline Instants first_places(const Tile *tile, Span span)
{
#if AOV_SHARP()
    if (span.t0 == span.t1) return (Instants){0, 1, 1};
#endif
#if SHADING_ERROR()
    return (Instants){0, PLACES, PLACES};
#else
    int times = tile->scene.numbers.shading_times;
    return (Instants){0, min(LANES, times), times};
#endif
}

// Times of the places; the last one repeated beyond.
static INLINED Lanes times_of(Span span, Instants p)
{
    Lanes i = p.first + lanes_min(LANE_INDEX, (Lanes)(p.count - 1.0f));
    return span.t0 + (span.t1 - span.t0) * ((i + 0.5f) / p.n);
}

// Go on after the places at hand. False at the end of the span.
static inline bool next_places(Instants *p)
{
    p->first += p->count;
#if SHADING_ERROR()
    while (p->n > PLACES && p->first % (2 * PLACES) == 0) p->first /= 2, p->n /= 2;
#else
    p->count = min(LANES, p->n - p->first);
#endif
    return p->first < p->n;
}

// The light that passes in the part around each place; nothing beyond them. Without a curve it is
// the part's length, of a span of length 1.
static INLINED Lanes part_light(const Tile *tile, float2 window, Span span, Instants p)
{
#if SHUTTER_CURVE()
    if (span.t0 == span.t1) return LANE_INDEX < 1.0f ? (Lanes)(1.0f) : (Lanes)(0.0f);
    float light[LANES], step = (span.t1 - span.t0) / p.n;
    float before = light_until(&tile->scene, window, span.t0 + step * p.first);
    for (int i = 0; i < LANES; i++) {
        float after = light_until(&tile->scene, window,
                                  span.t0 + step * (p.first + min(i + 1, p.count)));
        light[i] = after - before;
        before = after;
    }
    return lanes_load(light);
#else
    return LANE_INDEX < (float)p.count ? (Lanes)(1.0f / p.n) : (Lanes)(0.0f);
#endif
}

#if SHADING_ERROR()

static inline bool can_refine(Instants p) { return p.n > 1 && p.n < MOST_PLACES; }

// Take twice as many places in the first half of the stretch.
static inline void refine(Instants *p) { p->first *= 2, p->n *= 2; }

static INLINED Lanes bends(Lanes a) { return fabs(lanes_steps(lanes_steps(a))); }

// Whether colours at the places tell their mean well enough.
static inline bool is_smooth(const Tile *tile, const Colors *c, Instants p)
{
    if (!can_refine(p)) return true;
    Lanes most = lanes_max(lanes_max(bends(c->x), bends(c->y)), bends(c->z));
#if ALPHA_VARIES()
    most = lanes_max(most, bends(c->alpha));
#endif
    most = LANE_INDEX < PLACES - 2.0f ? most : (Lanes)(0.0f);
    return lanes_sum(most) <= 8.0f * tile->scene.numbers.shading_error * (PLACES - 2.0f);
}

#else

static inline void refine(Instants *p) {}
static inline bool is_smooth(const Tile *tile, const Colors *c, Instants p) { return true; }

#endif

#endif
