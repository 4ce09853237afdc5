// When a moving triangle stands between a light and a point of a moving surface: exactly in time.
//
// The point that a sample sees of a surface is rational in the time of a motion segment: the mean
// of the three vertices, each linear in time, by the sample's edge functions, which are quadratic.
// So it is a cubic over a quadratic. The triangle lies on the way to the light where three planes,
// each through the light and an edge, have the point on one side, where the triangle's own plane
// has the light and the point on different ones. As functions of time these are a quintic for each
// edge and for the point's side, and a cubic for the light's (the determinant of 3.1 in DESIGN.md,
// seen from the light). A light at a finite place is the origin; one at infinity a direction.
//
// There is no bias. A surface does not shade itself: its own path is left out, and two surfaces
// that are nearer than EQUAL_DEPTH, of the distance to the origin, do not shade each other.
// Faces at an edge find the same bits for it, and what is on an edge counts as covered, so that
// no light leaks through a closed surface.
#ifndef MB_SHADOW_FUNCTIONS_H
#define MB_SHADOW_FUNCTIONS_H

#include "analytic/depth_curve.h"
#include "analytic/shadow_vectors.h"

// What a sample sees of one path, from t0 to t1: the point n / e, relative to the first camera's
// eye.
typedef struct {
    double n[3][4]; // by coordinate
    double e[3];    // above zero where the path is hit
    double t0, t1;
} Receiver;

// What the sample sees of the path, over all of its motion segment.
static Receiver receiver_of(const Tile *tile, uint path_index, Place place)
{
    Path path = tile->scene.paths[path_index];
    MovingTriangle triangle;
    load_seen(tile, path_index, place, &triangle);
    const uint corner[3] = {path.a, path.b, path.c};
    Receiver r = {.e = {0.0, 0.0, 0.0}, .t0 = path.open, .t1 = path.close};
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 4; k++) r.n[c][k] = 0.0;
    for (int i = 0; i < 3; i++) {
        double b[3];
        edge_function(&triangle, i, place, b);
        Vertex u = tile->shadows.world[corner[i]], v = tile->shadows.world[corner[i] + path.step];
        const double start[3] = {u.x, u.y, u.w}, end[3] = {v.x, v.y, v.w};
        for (int c = 0; c < 3; c++) {
            r.n[c][0] += b[0] * start[c];
            r.n[c][1] += (b[0] * end[c] + 2.0 * b[1] * start[c]) / 3.0;
            r.n[c][2] += (2.0 * b[1] * end[c] + b[2] * start[c]) / 3.0;
            r.n[c][3] += b[2] * end[c];
        }
        for (int k = 0; k < 3; k++) r.e[k] += b[k];
    }
    if (r.e[0] + r.e[1] + r.e[2] < 0.0) {
        for (int k = 0; k < 3; k++) r.e[k] = -r.e[k];
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 4; k++) r.n[c][k] = -r.n[c][k];
    }
    return r;
}

// A receiver over a part of its time.
static Receiver restrict_receiver(const Receiver *r, double t0, double t1)
{
    if (t0 == r->t0 && t1 == r->t1) return *r;
    double low = (t0 - r->t0) / (r->t1 - r->t0), high = (t1 - r->t0) / (r->t1 - r->t0);
    Receiver part = {.t0 = t0, .t1 = t1};
    for (int c = 0; c < 3; c++) restrict_cubic(r->n[c], low, high, part.n[c]);
    restrict_quadratic(r->e, low, high, part.e);
    return part;
}

// Likewise in each lane, of a polynomial that all share.
static INLINED void restrict_cubics(const double *b, Doubles low, Doubles high, Doubles *out)
{
    Doubles l[3], h[3];
    for (int i = 0; i < 3; i++) {
        l[i] = b[i] + low * (b[i + 1] - b[i]);
        h[i] = b[i] + high * (b[i + 1] - b[i]);
    }
    Doubles ll0 = l[0] + low * (l[1] - l[0]), ll1 = l[1] + low * (l[2] - l[1]);
    Doubles lh0 = l[0] + high * (l[1] - l[0]), lh1 = l[1] + high * (l[2] - l[1]);
    Doubles hh0 = h[0] + high * (h[1] - h[0]), hh1 = h[1] + high * (h[2] - h[1]);
    out[0] = ll0 + low * (ll1 - ll0), out[1] = ll0 + high * (ll1 - ll0);
    out[2] = lh0 + high * (lh1 - lh0), out[3] = hh0 + high * (hh1 - hh0);
}

static INLINED void restrict_quadratics(const double *b, Doubles low, Doubles high, Doubles *out)
{
    Doubles l0 = b[0] + low * (b[1] - b[0]), l1 = b[1] + low * (b[2] - b[1]);
    Doubles h0 = b[0] + high * (b[1] - b[0]), h1 = b[1] + high * (b[2] - b[1]);
    out[0] = l0 + low * (l1 - l0), out[1] = l0 + high * (l1 - l0), out[2] = h0 + high * (h1 - h0);
}

// The receiver in each lane's own part of time, relative to an origin.
typedef struct {
    Cubic n;
    Doubles e[3], cubic_e[4];
} Receivers;

static INLINED Receivers spread_receiver(const Receiver *r, Doubles t0, Doubles t1, double3 origin)
{
    Doubles over = 1.0 / (r->t1 - r->t0), low = (t0 - r->t0) * over, high = (t1 - r->t0) * over;
    Doubles x[4], y[4], z[4];
    Receivers all;
    restrict_cubics(r->n[0], low, high, x);
    restrict_cubics(r->n[1], low, high, y);
    restrict_cubics(r->n[2], low, high, z);
    restrict_quadratics(r->e, low, high, all.e);
    quadratics_as_cubics(all.e, all.cubic_e);
    for (int k = 0; k < 4; k++) {
        all.n.c[k].x = x[k] - all.cubic_e[k] * origin.x;
        all.n.c[k].y = y[k] - all.cubic_e[k] * origin.y;
        all.n.c[k].z = z[k] - all.cubic_e[k] * origin.z;
    }
    return all;
}

// Paths that may stand in the light, each over a part [t0, t1) of its motion segment.
typedef struct {
    uint path[CASTERS];
    double t0[CASTERS], t1[CASTERS];
    int count;
} Casters;

// Corners of the casters at the ends of their parts, relative to `origin`; lanes beyond the last
// have the last one's. Bit i of `reversed`: the side of corners i and i + 1 has the second first.
static INLINED void load_casters(const Tile *tile, const Casters *casters, double3 origin,
                                 Linear *corners, DoubleMask *reversed)
{
    double at[3][2][3][CASTERS]; // corner, end, coordinate
    long flags[3][CASTERS];
    for (int lane = 0; lane < CASTERS; lane++) {
        int k = min(lane, casters->count - 1);
        Path path = tile->scene.paths[casters->path[k]];
        // In double, as the receiver's: by a rounded length what is seen in a mirror would leave
        // the plane that it is mirrored from.
        double over = 1.0 / ((double)path.close - path.open);
        double low = (casters->t0[k] - path.open) * over;
        double high = (casters->t1[k] - path.open) * over;
        const uint corner[3] = {path.a, path.b, path.c};
        uint sides = tile->shapes[casters->path[k]].flags / SHAPE_REVERSED;
        for (int i = 0; i < 3; i++) {
            Vertex u = tile->shadows.world[corner[i]];
            Vertex v = tile->shadows.world[corner[i] + path.step];
            double start[3] = {u.x - origin.x, u.y - origin.y, u.w - origin.z};
            double end[3] = {v.x - origin.x, v.y - origin.y, v.w - origin.z};
            for (int c = 0; c < 3; c++) {
                at[i][0][c][lane] = start[c] + low * (end[c] - start[c]);
                at[i][1][c][lane] = start[c] + high * (end[c] - start[c]);
            }
            flags[i][lane] = -(long)(sides >> i & 1u);
        }
    }
    for (int i = 0; i < 3; i++) {
        for (int end = 0; end < 2; end++) {
            corners[i].c[end].x = doubles_load(at[i][end][0]);
            corners[i].c[end].y = doubles_load(at[i][end][1]);
            corners[i].c[end].z = doubles_load(at[i][end][2]);
        }
        reversed[i] = doubles_load(flags[i]);
    }
}

// Normals of the moving triangles' planes.
static Quadratic plane_normals(const Linear *corners)
{
    Linear u, v;
    for (int k = 0; k < 2; k++) {
        u.c[k] = doubles_minus(corners[1].c[k], corners[0].c[k]);
        v.c[k] = doubles_minus(corners[2].c[k], corners[0].c[k]);
    }
    return cross_over_time(u, v);
}

static INLINED double3 towards_light(const ShadowLight *light)
{
    return (double3)(light->vector[0], light->vector[1], light->vector[2]);
}

// On which side of the triangles' planes the light is, cubics in time: above zero behind the front.
static void side_of_light(const ShadowLight *light, const Linear *corners, const Quadratic *n,
                          Doubles *d)
{
    if (light->finite) {
        Doubles3 a = corners[0].c[0], b = corners[0].c[1];
        d[0] = doubles_dot(a, n->c[0]), d[3] = doubles_dot(b, n->c[2]);
        d[1] = (doubles_dot(b, n->c[0]) + 2.0 * doubles_dot(a, n->c[1])) / 3.0;
        d[2] = (2.0 * doubles_dot(b, n->c[1]) + doubles_dot(a, n->c[2])) / 3.0;
    } else {
        Doubles quadratic[3];
        Doubles3 towards = doubles_of(towards_light(light));
        for (int k = 0; k < 3; k++) quadratic[k] = -doubles_dot(towards, n->c[k]);
        quadratics_as_cubics(quadratic, d);
    }
}

// On which side of them the point is, quintics: above zero behind the front. Zero is within
// EQUAL_DEPTH of the plane.
static void side_of_point(const Linear *corners, const Quadratic *normals, const Receivers *r,
                          Doubles *out)
{
    Doubles3 a = corners[0].c[0], b = corners[0].c[1];
    const Doubles *e = r->e;
    Cubic away; // a e - n
    Doubles size = 0.0, reach = 0.0;
    for (int k = 0; k < 4; k++) {
        Doubles of_a = k == 0 ? e[0] : k == 1 ? 2.0 / 3.0 * e[1] : k == 2 ? e[2] / 3.0 : 0.0;
        Doubles of_b = k == 0 ? 0.0 : k == 1 ? e[0] / 3.0 : k == 2 ? 2.0 / 3.0 * e[1] : e[2];
        Doubles3 none = {0.0, 0.0, 0.0};
        Doubles3 moved = doubles_plus(doubles_plus(none, of_a, a), of_b, b);
        Doubles here = doubles_size(moved) + doubles_size(r->n.c[k]);
        reach = here > reach ? here : reach;
        away.c[k] = doubles_minus(moved, r->n.c[k]);
    }
    for (int k = 0; k < 3; k++) {
        Doubles here = doubles_size(normals->c[k]);
        size = here > size ? here : size;
    }
    dot_over_time(normals, &away, out);
    Doubles least = EQUAL_DEPTH * size * reach;
    for (int k = 0; k < QUINTIC; k++) out[k] = fabs(out[k]) <= least ? 0.0 : out[k];
}

// Functions of the edges from p to q: on which side of the plane through one and the light the
// point n / e is, quintics in time.
NOT_INLINED static void light_edge(const ShadowLight *light, Linear p, Linear q, const Receivers *r,
                       Doubles *out)
{
    Quadratic across = cross_over_time(p, q);
    if (light->finite) {
        dot_over_time(&across, &r->n, out);
        return;
    }
    Doubles3 towards = doubles_of(towards_light(light));
    Doubles3 start = doubles_cross(doubles_minus(p.c[0], q.c[0]), towards);
    Doubles3 end = doubles_cross(doubles_minus(p.c[1], q.c[1]), towards);
    Quadratic slope = {{start, start, end}};
    slope.c[1].x = 0.5 * (start.x + end.x), slope.c[1].y = 0.5 * (start.y + end.y);
    slope.c[1].z = 0.5 * (start.z + end.z);
    dot_over_time(&slope, &r->n, out);
    Doubles level[3];
    for (int k = 0; k < 3; k++) level[k] = doubles_dot(towards, across.c[k]);
    add_product(level, r->cubic_e, out);
    for (int k = 0; k < QUINTIC; k++) out[k] = -out[k];
}

// The functions of eight casters.
typedef struct {
    Doubles edge[3][QUINTIC], of_point[QUINTIC], of_light[4];
    DoubleMask between; // those that may stand between the light and the receiver
} CasterFunctions;

NOT_INLINED static void caster_functions(const Tile *tile, const Receiver *receiver,
                                         const ShadowLight *light, const Casters *casters,
                                         CasterFunctions *f)
{
    double3 origin = (double3)(light->origin[0], light->origin[1], light->origin[2]);
    double t0[CASTERS], t1[CASTERS];
    for (int lane = 0; lane < CASTERS; lane++) {
        int k = min(lane, casters->count - 1);
        t0[lane] = casters->t0[k], t1[lane] = casters->t1[k];
    }
    Receivers r = spread_receiver(receiver, doubles_load(t0), doubles_load(t1), origin);
    Linear corners[3];
    DoubleMask reversed[3];
    load_casters(tile, casters, origin, corners, reversed);
    Quadratic normals = plane_normals(corners);
    side_of_light(light, corners, &normals, f->of_light);
    side_of_point(corners, &normals, &r, f->of_point);
    DoubleMask front = any_below(f->of_light, 4) & any_above(f->of_point, QUINTIC);
    DoubleMask back = any_above(f->of_light, 4) & any_below(f->of_point, QUINTIC);
    for (int side = 0; side < 3 && any_double(front | back); side++) {
        Linear p = corners[side], q = corners[(side + 1) % 3], first, second;
        for (int k = 0; k < 2; k++) {
            first.c[k].x = reversed[side] ? q.c[k].x : p.c[k].x;
            first.c[k].y = reversed[side] ? q.c[k].y : p.c[k].y;
            first.c[k].z = reversed[side] ? q.c[k].z : p.c[k].z;
            second.c[k].x = reversed[side] ? p.c[k].x : q.c[k].x;
            second.c[k].y = reversed[side] ? p.c[k].y : q.c[k].y;
            second.c[k].z = reversed[side] ? p.c[k].z : q.c[k].z;
        }
        Doubles *edge = f->edge[side];
        light_edge(light, first, second, &r, edge);
        for (int k = 0; k < QUINTIC; k++) edge[k] = reversed[side] ? -edge[k] : edge[k];
        DoubleMask above = any_above(edge, QUINTIC), below = any_below(edge, QUINTIC);
        front &= below | ~above, back &= above | ~below;
    }
    f->between = front | back;
}

#endif
