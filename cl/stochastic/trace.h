// Rays through the scene at the times of point samples: what stands between them and a light.
//
// Paths are the leaves of a tree of boxes that hold them over the whole shutter. Sixteen rays go
// through it together, each at its own time, and meet triangles as they are then: no roots, no
// intervals. What is nearer to a ray's start than EQUAL_PLACE, of the distance to the origin, is
// not met, nor is the path that it starts on.
#ifndef MB_TRACE_H
#define MB_TRACE_H

#include "shared/attributes.h"
#include "shared/lanes.h"

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

typedef struct {
    double16 x, y, z;
} Doubles3;

// From `from` along `way`: all of it, or, where that is the way to a light, up to its end.
typedef struct {
    Doubles3 from, way;
    Lanes t;
    bool ends;
} Rays;

static INLINED Doubles3 doubles_added(Doubles3 a, double16 by, Doubles3 b)
{
    Doubles3 sum = {a.x + by * b.x, a.y + by * b.y, a.z + by * b.z};
    return sum;
}

static inline Doubles3 doubles_cross(Doubles3 a, Doubles3 b)
{
    Doubles3 product = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return product;
}

static INLINED double16 doubles_dot(Doubles3 a, Doubles3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static INLINED double16 doubles_size(Doubles3 a) { return fabs(a.x) + fabs(a.y) + fabs(a.z); }

// A vertex at times tau of its motion segment.
static INLINED Doubles3 world_at(const Occluders *o, uint vertex, uint step, double16 tau)
{
    Vertex a = o->world[vertex], b = o->world[vertex + step];
    Doubles3 at = {a.x + tau * (b.x - a.x), a.y + tau * (b.y - a.y), a.w + tau * (b.w - a.w)};
    return at;
}

// Which rays meet the path, where along them, and where on it: the corners' shares times any
// number.
static INLINED LaneMask rays_meet(const Occluders *o, Path path, const Rays *r, double16 *place,
                                  double16 *shares)
{
    double16 tau = (convert_double16(r->t) - path.open) / path_length(path);
    const uint corner[3] = {path.a, path.b, path.c};
    Doubles3 p[3], u, v;
    for (int i = 0; i < 3; i++)
        p[i] = doubles_added(world_at(o, corner[i], path.step, tau), -1.0, r->from);
    u = doubles_added(p[1], -1.0, p[0]), v = doubles_added(p[2], -1.0, p[0]);
    Doubles3 normal = doubles_cross(u, v);
    double16 e0 = doubles_dot(r->way, doubles_cross(p[1], p[2]));
    double16 e1 = doubles_dot(r->way, doubles_cross(p[2], p[0]));
    double16 e2 = doubles_dot(r->way, doubles_cross(p[0], p[1]));
    shares[0] = e0, shares[1] = e1, shares[2] = e2;
    double16 facing = doubles_dot(r->way, normal), height = doubles_dot(p[0], normal);
    double16 least = EQUAL_PLACE * doubles_size(normal)
                     * (doubles_size(r->from) + doubles_size(p[0]));
    *place = height / facing;
    long16 hit = ((e0 >= 0.0) & (e1 >= 0.0) & (e2 >= 0.0))
                 | ((e0 <= 0.0) & (e1 <= 0.0) & (e2 <= 0.0));
    hit &= (*place > 0.0) & (fabs(height) > least);
    if (r->ends) hit &= *place < 1.0;
    LaneMask there = (r->t >= path.open)
                     & ((r->t < path.close) | (LaneMask)(path.close >= 1.0f ? -1 : 0));
    return convert_int16(hit) & there;
}

// Rays in float32, for boxes that are a little larger than what they hold.
typedef struct {
    Lanes3 from, over; // start, one over the way
    Lanes t;
    float end;
} FloatRays;

static INLINED Lanes one_over(double16 way)
{
    Lanes w = convert_float16(way);
    return 1.0f / (fabs(w) > 1e-30f ? w : (Lanes)(1e-30f));
}

static FloatRays float_rays(const Rays *r)
{
    FloatRays f;
    f.from.x = convert_float16(r->from.x), f.from.y = convert_float16(r->from.y);
    f.from.z = convert_float16(r->from.z);
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

static INLINED bool some_lane(LaneMask mask)
{
    const int4 *part = (const int4 *)&mask;
    int4 any = (part[0] | part[1]) | (part[2] | part[3]);
    return (any.x | any.y | any.z | any.w) != 0;
}

// Share of the light that the path lets through where the rays meet it: 1 - alpha.
static INLINED Lanes passed_share(const Occluders *o, uint index, const Rays *r,
                                  const double16 *shares)
{
    Path path = o->paths[index];
#ifdef ALPHA_VARIES
    if (path.alpha < 0.0f) {
        double16 sum = (shares[0] + shares[1]) + shares[2];
        Lanes tau = (r->t - path.open) / path_length(path), weights[6];
        for (int i = 0; i < 3; i++) {
            Lanes share = convert_float16(sum != 0.0 ? shares[i] / sum : (double16)(1.0 / 3.0));
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
        if (!some_lane(enter)) continue;
        if (node < o->leaf_nodes) {
            stack[top++] = 2u * node, stack[top++] = 2u * node + 1u;
            continue;
        }
        for (int k = 0; k < LEAF_PATHS; k++) {
            uint index = o->leaves[(node - o->leaf_nodes) * LEAF_PATHS + k];
            if (index == NONE || index == own) continue;
            double16 place, shares[3];
            LaneMask hit = enter & rays_meet(o, o->paths[index], rays, &place, shares);
            if (!some_lane(hit)) continue;
            Lanes passed = passed_share(o, index, rays, shares);
            share = hit ? share * passed : share;
        }
    }
    return share;
}

// Where along each ray it meets the first path that is not wholly transparent.
static INLINED double16 first_place(const Occluders *o, const Rays *rays)
{
    FloatRays f = float_rays(rays);
    double16 nearest = INFINITY;
    uint stack[TREE_DEPTH];
    int top = 0;
    stack[top++] = 1u;
    while (top > 0) {
        uint node = stack[--top];
        LaneMask enter = rays_enter(o->nodes + node, &f);
        if (!some_lane(enter)) continue;
        if (node < o->leaf_nodes) {
            stack[top++] = 2u * node, stack[top++] = 2u * node + 1u;
            continue;
        }
        for (int k = 0; k < LEAF_PATHS; k++) {
            uint index = o->leaves[(node - o->leaf_nodes) * LEAF_PATHS + k];
            if (index == NONE || o->paths[index].alpha == 0.0f) continue;
            double16 place, shares[3];
            LaneMask hit = enter & rays_meet(o, o->paths[index], rays, &place, shares);
            nearest = (convert_long16(hit) & (place < nearest)) ? place : nearest;
        }
    }
    return nearest;
}

#endif
