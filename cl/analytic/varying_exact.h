// How attributes and depth vary along an interval of an exact path: by the sample's barycentric
// coordinates in the moving triangle, the edge functions over their sum.
#ifndef MB_VARYING_EXACT_H
#define MB_VARYING_EXACT_H

#include "analytic/tile_of_rows.h"
#include "shared/attributes.h"
#include "analytic/depth_curve.h"
#include "analytic/edges.h"

typedef struct {
    double edge[3][3];
    DepthCurve depth;
    float near, far; // bounds of the depth
} Varying;

static inline uint span_path(const Tile *tile, Span span) { return span.source; }

static inline float span_depth(const Tile *tile, Span span, Place place, float t)
{
    DepthCurve curve = depth_curve(tile, span.source, place);
    global const Depth *depth = tile->depths + span.source;
    // At the moment at which a triangle is seen edge-on any depth between its vertices' is right.
    return fmin(fmax((float)curve_depth(&curve, t), depth->near), depth->far);
}

static Varying prepare_varying(const Tile *tile, const Shaded *s, Span span)
{
    Varying v;
    MovingTriangle triangle;
    global const Shape *shape = tile->shapes + span.source;
    load_seen(tile, span.source, s->place, &triangle);
    for (int i = 0; i < 3; i++) edge_function(&triangle, i, s->place, v.edge[i]);
    v.depth = depth_curve(tile, span.source, s->place);
    v.near = shape->near, v.far = shape->far;
    return v;
}

static INLINED Lanes varying_depth(const Varying *v, Lanes t)
{
    LaneDoubles tau = (to_lane_doubles(t) - v->depth.open) / v->depth.length, s = 1.0 - tau;
    const double *d = v->depth.d, *e = v->depth.e;
    LaneDoubles over = s * (s * e[0] + tau * e[1]) + tau * (s * e[1] + tau * e[2]);
    LaneDoubles c0 = s * d[0] + tau * d[1], c1 = s * d[1] + tau * d[2], c2 = s * d[2] + tau * d[3];
    Lanes w = to_lanes((s * (s * c0 + tau * c1) + tau * (s * c1 + tau * c2)) / over);
    return lanes_min(lanes_max(w, v->near), v->far);
}

static Attributes attributes_at(const Shaded *s, const Varying *v, const Lanes *t)
{
    LaneDoubles tau = (to_lane_doubles(*t) - s->path.open) / path_length(s->path), rest = 1.0 - tau;
    LaneDoubles e[3], sum = 0.0;
    for (int i = 0; i < 3; i++) {
        const double *b = v->edge[i];
        e[i] = rest * (rest * b[0] + tau * b[1]) + tau * (rest * b[1] + tau * b[2]);
        sum += e[i];
    }
    Weights weights[6];
    for (int i = 0; i < 3; i++) {
        LaneDoubles share = sum != 0.0 ? e[i] / sum : (LaneDoubles)(1.0 / 3.0);
        weights[i] = to_weights(share * rest), weights[i + 3] = to_weights(share * tau);
    }
    return blend_corners(s, weights);
}

#endif
