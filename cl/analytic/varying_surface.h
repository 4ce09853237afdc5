// How attributes and depth vary along an interval of a triangulated path: linearly in time between
// where its two fragments lie on the path's surface. For a surface in translation that is exact.
#ifndef MB_VARYING_SURFACE_H
#define MB_VARYING_SURFACE_H

#include "analytic/swept_surface.h"
#include "analytic/tile_of_rows.h"
#include "shared/attributes.h"

typedef struct {
    Interval interval;
    Weight start[6], end[6]; // of the corners at the fragments
    float t0, over;        // time of the first fragment, 1 / (time between them)
} Varying;

static inline uint span_path(const Tile *tile, Span span)
{
    return tile->sorted[span.source].first >> PART_BITS;
}

static inline float span_depth(const Tile *tile, Span span, Place place, float t)
{
    Interval i = tile->sorted[span.source];
    global const Shape *shape = tile->shapes + span_path(tile, span);
    float depth = i.w0 + (i.w1 - i.w0) * ((t - i.t0) / (i.t1 - i.t0));
    return fmin(fmax(depth, shape->near), shape->far); // huge needles have depths of infinity
}

// Weights of the path's six corners where face `face` of its surface meets the sample; returns the
// fragment's time within the segment.
static float fragment_weights(const Surface *surface, int face, Weight x, Weight y, Weight *weights)
{
    Weight xs[3], ys[3], e[3], sum = 0.0f, t = 0.0f;
    for (int i = 0; i < 3; i++) {
        int c = FACE_CORNERS[face][i];
        Weight w = surface->w[c], w_low = surface->w_low[c];
        xs[i] = fma(-x, w, (Weight)surface->x[c]) + fma(-x, w_low, (Weight)surface->x_low[c]);
        ys[i] = fma(-y, w, (Weight)surface->y[c]) + fma(-y, w_low, (Weight)surface->y_low[c]);
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        e[i] = xs[j] * ys[k] - xs[k] * ys[j];
        sum += e[i];
    }
    for (int i = 0; i < 6; i++) weights[i] = 0.0f;
    for (int i = 0; i < 3; i++) {
        int c = FACE_CORNERS[face][i], side = c - 6, r = (side + 1) % 3;
        Weight share = sum != 0.0f ? e[i] / sum : (Weight)1.0f / 3.0f;
        t += share * CORNER_TIME[c];
        if (c < 6) {
            weights[c] += share;
            continue;
        }
        bool crossed = surface->crossed >> side & 1u;
        float start = crossed ? surface->place[side][0] : 0.5f;
        float end = crossed ? surface->place[side][1] : 0.5f;
        weights[side] += 0.5f * share * (1.0f - start), weights[r] += 0.5f * share * start;
        weights[side + 3] += 0.5f * share * (1.0f - end), weights[r + 3] += 0.5f * share * end;
    }
    return t;
}

static Varying prepare_varying(const Tile *tile, const Shaded *s, Span span)
{
    Varying v;
    v.interval = tile->sorted[span.source];
    Surface surface;
    load_surface(tile->scene.vertices, s->path,
                 tile->shapes + (v.interval.first >> PART_BITS), &surface);
    uint face = (1u << PART_BITS) - 1u, first = v.interval.first, last = v.interval.last;
    if ((first & face) == PART_EYE) first = last;
    if ((last & face) == PART_EYE) last = first;
    v.t0 = fragment_weights(&surface, first & face, s->place.x, s->place.y, v.start);
    float t1 = fragment_weights(&surface, last & face, s->place.x, s->place.y, v.end);
    v.over = t1 != v.t0 ? 1.0f / (path_length(s->path) * (t1 - v.t0)) : 0.0f;
    v.t0 = s->path.open + path_length(s->path) * v.t0;
    return v;
}

static INLINED Lanes varying_depth(const Varying *v, Lanes t)
{
    Interval i = v->interval;
    return i.w0 + (i.w1 - i.w0) * ((t - i.t0) / (i.t1 - i.t0));
}

static Attributes attributes_at(const Shaded *s, const Varying *v, const Lanes *t)
{
    Weights part = lanes_to_weights(*t - v->t0) * v->over, weights[6];
    for (int i = 0; i < 6; i++) weights[i] = v->start[i] + part * (v->end[i] - v->start[i]);
    return blend_corners(s, weights);
}

#endif
