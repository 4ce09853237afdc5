// Rays through the scene at the times of point samples: what stands between them and a light.
//
// Paths are the leaves of a tree of boxes that hold them over the whole shutter. Sixteen rays go
// through it together, each at its own time, and meet triangles as they are then: no roots, no
// intervals. What is nearer to a ray's start than EQUAL_PLACE, of the distance to the origin, is
// not met, nor is the path that it starts on.
#ifndef MB_TRACE_H
#define MB_TRACE_H

#include "shared/effects.h"
#include "shared/attributes.h"
#include "shared/vectors.h"

#define EQUAL_PLACE 1e-12
#define LEAF_PATHS 4
#define TREE_DEPTH 32

typedef struct {
    global const Vertex *world;  // vertices in the world's directions, relative to the first eye
    global const Path *paths;
    global const TreeNode *nodes; // a binary tree: those below node i are 2 i and 2 i + 1
    global const uint *leaves;   // LEAF_PATHS paths, or NONE, of each of the lowest nodes
    uint leaf_nodes;             // how many there are; also the first one's place
    const Scene *scene;          // for alphas that vary; not of a shadow map
} Occluders;

VECTORS_OF(LaneDoubles, lane_doubles)

// From `from` along `way`: all of it, or, where that is the way to a light, up to its end.
typedef struct {
    LaneDoubles3 from, way;
    Lanes t;
    bool ends;
} Rays;

// A vertex at times tau of its motion segment.
static INLINED LaneDoubles3 world_at(const Occluders *o, uint vertex, uint step, LaneDoubles tau)
{
    Vertex a = o->world[vertex], b = o->world[vertex + step];
    LaneDoubles3 at = {a.x + tau * (b.x - a.x), a.y + tau * (b.y - a.y), a.w + tau * (b.w - a.w)};
    return at;
}

// Which rays meet the path, where along them, and where on it: the corners' shares times any
// number.
static INLINED LaneMask rays_meet(const Occluders *o, Path path, const Rays *r, LaneDoubles *place,
                                  LaneDoubles *shares)
{
    LaneDoubles tau = (to_lane_doubles(r->t) - path.open) / path_length(path);
    const uint corner[3] = {path.a, path.b, path.c};
    LaneDoubles3 p[3], u, v;
    for (int i = 0; i < 3; i++)
        p[i] = lane_doubles_plus(world_at(o, corner[i], path.step, tau), -1.0, r->from);
    u = lane_doubles_plus(p[1], -1.0, p[0]), v = lane_doubles_plus(p[2], -1.0, p[0]);
    LaneDoubles3 normal = lane_doubles_cross(u, v);
    LaneDoubles e0 = lane_doubles_dot(r->way, lane_doubles_cross(p[1], p[2]));
    LaneDoubles e1 = lane_doubles_dot(r->way, lane_doubles_cross(p[2], p[0]));
    LaneDoubles e2 = lane_doubles_dot(r->way, lane_doubles_cross(p[0], p[1]));
    shares[0] = e0, shares[1] = e1, shares[2] = e2;
    LaneDoubles facing = lane_doubles_dot(r->way, normal), height = lane_doubles_dot(p[0], normal);
    LaneDoubles least = EQUAL_PLACE * lane_doubles_size(normal)
                     * (lane_doubles_size(r->from) + lane_doubles_size(p[0]));
    *place = height / facing;
    LaneDoubleMask hit = ((e0 >= 0.0) & (e1 >= 0.0) & (e2 >= 0.0))
                 | ((e0 <= 0.0) & (e1 <= 0.0) & (e2 <= 0.0));
    hit &= (*place > 0.0) & (fabs(height) > least);
    if (r->ends) hit &= *place < 1.0;
    LaneMask there = (r->t >= path.open)
                     & ((r->t < path.close) | (LaneMask)(path.close >= 1.0f ? -1 : 0));
    return to_lane_ints(hit) & there;
}

// Rays in float32, for boxes that are a little larger than what they hold.
typedef struct {
    Lanes3 from, over; // start, one over the way
    Lanes t;
    float end;
} FloatRays;

static INLINED Lanes one_over(LaneDoubles way)
{
    Lanes w = to_lanes(way);
    return 1.0f / (fabs(w) > 1e-30f ? w : (Lanes)(1e-30f));
}

static FloatRays float_rays(const Rays *r)
{
    FloatRays f;
    f.from.x = to_lanes(r->from.x), f.from.y = to_lanes(r->from.y);
    f.from.z = to_lanes(r->from.z);
    f.over.x = one_over(r->way.x), f.over.y = one_over(r->way.y), f.over.z = one_over(r->way.z);
    f.t = r->t, f.end = r->ends ? 1.0f + 1e-5f : INFINITY;
    return f;
}

static INLINED LaneMask rays_enter(global const TreeNode *node, const FloatRays *r)
{
    Lanes x0 = (node->low[0] - r->from.x) * r->over.x, x1 = (node->high[0] - r->from.x) * r->over.x;
    Lanes y0 = (node->low[1] - r->from.y) * r->over.y, y1 = (node->high[1] - r->from.y) * r->over.y;
    Lanes z0 = (node->low[2] - r->from.z) * r->over.z, z1 = (node->high[2] - r->from.z) * r->over.z;
    Lanes enter = lanes_max(lanes_max(lanes_min(x0, x1), lanes_min(y0, y1)), lanes_min(z0, z1));
    Lanes leave = lanes_min(lanes_min(lanes_max(x0, x1), lanes_max(y0, y1)), lanes_max(z0, z1));
    Lanes slack = 1e-5f * fabs(leave);
    return (enter <= leave + slack) & (leave + slack >= 0.0f) & (enter <= r->end)
           & (r->t >= node->open) & (r->t <= node->close);
}

// Share of the light that the path lets through where the rays meet it: 1 - alpha.
static INLINED Lanes passed_share(const Occluders *o, uint index, const Rays *r,
                                  const LaneDoubles *shares)
{
    Path path = o->paths[index];
#if ALPHA_VARIES()
    if (path.alpha < 0.0f) {
        LaneDoubles sum = (shares[0] + shares[1]) + shares[2];
        Weights tau = (lanes_to_weights(r->t) - path.open) / path_length(path), weights[6];
        for (int i = 0; i < 3; i++) {
            Weights share = to_weights(sum != 0.0 ? shares[i] / sum : (LaneDoubles)(1.0 / 3.0));
            weights[i] = share * (1.0f - tau), weights[i + 3] = share * tau;
        }
        return 1.0f - alpha_at_weights(o->scene, index, weights, LANES);
    }
#endif
    return (Lanes)(1.0f - path.alpha);
}

// Share of light that passes along each ray, which starts on the path `own`.
static INLINED Lanes light_share(const Occluders *o, const Rays *rays, uint own)
{
    FloatRays f = float_rays(rays);
    Lanes share = 1.0f;
    uint stack[TREE_DEPTH];
    int top = 0;
    stack[top++] = 1u;
    while (top > 0) {
        uint node = stack[--top];
        LaneMask enter = rays_enter(o->nodes + node, &f) & (share > 0.0f);
        if (!any_lane(enter)) continue;
        if (node < o->leaf_nodes) {
            stack[top++] = 2u * node, stack[top++] = 2u * node + 1u;
            continue;
        }
        for (int k = 0; k < LEAF_PATHS; k++) {
            uint index = o->leaves[(node - o->leaf_nodes) * LEAF_PATHS + k];
            if (index == NONE || index == own) continue;
            LaneDoubles place, shares[3];
            LaneMask hit = enter & rays_meet(o, o->paths[index], rays, &place, shares);
            if (!any_lane(hit)) continue;
            Lanes passed = passed_share(o, index, rays, shares);
            share = hit ? share * passed : share;
        }
    }
    return share;
}

// Where along each ray it meets the first path that is not wholly transparent.
static INLINED LaneDoubles first_place(const Occluders *o, const Rays *rays)
{
    FloatRays f = float_rays(rays);
    LaneDoubles nearest = INFINITY;
    uint stack[TREE_DEPTH];
    int top = 0;
    stack[top++] = 1u;
    while (top > 0) {
        uint node = stack[--top];
        LaneMask enter = rays_enter(o->nodes + node, &f);
        if (!any_lane(enter)) continue;
        if (node < o->leaf_nodes) {
            stack[top++] = 2u * node, stack[top++] = 2u * node + 1u;
            continue;
        }
        for (int k = 0; k < LEAF_PATHS; k++) {
            uint index = o->leaves[(node - o->leaf_nodes) * LEAF_PATHS + k];
            if (index == NONE || o->paths[index].alpha == 0.0f) continue;
            LaneDoubles place, shares[3];
            LaneMask hit = enter & rays_meet(o, o->paths[index], rays, &place, shares);
            nearest = (to_lane_double_mask(hit) & (place < nearest)) ? place : nearest;
        }
    }
    return nearest;
}

#endif
