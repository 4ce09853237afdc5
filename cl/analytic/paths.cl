// Stage "paths": the shape of every motion path: planes that bound it on screen, when it faces the
// viewer, and which of its moving edges cross on screen (Hong & Oh 2017, 4.2).
#include "shared/effects.h"
#include "shared/records.h"
#include "shared/bernstein.h"
#include "shared/shear.h"

#pragma OPENCL FP_CONTRACT OFF

static INLINED double3 cross_product(double3 a, double3 b)
{
    return (double3)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static INLINED double dot_product(double3 a, double3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// Planes through the eye and two of the six corners that have all on one side: what the path
// covers lies inside all of them, in front of the eye or behind it (DESIGN.md 3.2). Each is pushed
// outwards by MARGIN pixels, more than its rounding. Of two corners that are the same but for
// rounding, as where a vertex turns in its place, the plane may be anywhere, and is left out.
#define MARGIN 1e-3

static uint bounding_planes(const double3 *q, int corners, double blur, Shape *shape)
{
    uint count = 0;
    for (int i = 0; i < corners; i++) for (int j = i + 1; j < corners; j++) {
        double3 n = cross_product(q[i], q[j]);
        double size = sqrt(dot_product(n, n)), slope = sqrt(n.x * n.x + n.y * n.y);
        double low = 0.0, high = 0.0;
        bool through = true; // both corners
        for (int k = 0; k < corners; k++) {
            double side = dot_product(n, q[k]);
            double noise = 1e-13 * size * sqrt(dot_product(q[k], q[k]));
            if (k == i || k == j) through &= fabs(side) <= 0.25 * MARGIN * slope * fabs(q[k].z);
            else low = fmin(low, side + noise), high = fmax(high, side - noise);
        }
        if (!through || !(slope > 1e-13 * size) || size == 0.0) continue;
        for (int sign = -1; sign <= 1; sign += 2) {
            if (sign > 0 ? low < 0.0 : high > 0.0) continue;
            double scale = sign / slope;
            float a = (float)(n.x * scale), b = (float)(n.y * scale);
            double c = n.z * scale + MARGIN + blur;
            bool known = false;
            for (uint k = 0; k < count; k++)
                known |= fabs(shape->a[k] - a) < 1e-7f && fabs(shape->b[k] - b) < 1e-7f
                         && fabs(shape->c[k] - c) < 0.1 * MARGIN;
            if (known || count == MAX_PLANES) continue;
            shape->a[count] = a, shape->b[count] = b, shape->c[count] = c;
            count++;
        }
    }
    return count;
}

// Whether the moving edge's positions p0 q0 and p1 q1 cross on screen, and where on each.
static INLINED bool edge_crosses(double3 p0, double3 q0, double3 p1, double3 q1, float *place)
{
    double3 line0 = cross_product(p0, q0), line1 = cross_product(p1, q1);
    double a = dot_product(p0, line1), b = dot_product(q0, line1);
    double c = dot_product(p1, line0), d = dot_product(q1, line0);
    if (!(a * b < 0.0 && c * d < 0.0)) return false;
    double s = a / (a - b), u = c / (c - d);
    if (p0.z + s * (q0.z - p0.z) <= 0.0 || p1.z + u * (q1.z - p1.z) <= 0.0) return false;
    place[0] = (float)s, place[1] = (float)u;
    return true;
}

// Depth over time. The cross products of the edges add up to one of differences, (b - a) x (c - a),
// which is small where the triangle is.
static Depth depth_over_time(const double3 *q)
{
    double3 u0 = q[1] - q[0], v0 = q[2] - q[0], u1 = q[4] - q[3], v1 = q[5] - q[3];
    double3 n0 = cross_product(u0, v0), n2 = cross_product(u1, v1);
    double3 n1 = 0.5 * (cross_product(u0, v1) + cross_product(u1, v0));
    Depth depth = {
        .d = {dot_product(q[0], n0), (dot_product(q[3], n0) + 2.0 * dot_product(q[0], n1)) / 3.0,
              (2.0 * dot_product(q[3], n1) + dot_product(q[0], n2)) / 3.0,
              dot_product(q[3], n2)},
        .x = {n0.x, n1.x, n2.x}, .y = {n0.y, n1.y, n2.y}, .w = {n0.z, n1.z, n2.z}
    };
    return depth;
}

// Sum of a b and c d in twice the precision: (rounded, rest).
static double2 exact_products(double a, double b, double c, double d)
{
    double p = a * b, q = c * d, sum = p + q, added = sum - p;
    double lost = (p - (sum - added)) + (q - added);
    return (double2)(sum, lost + (fma(a, b, -p) + fma(c, d, -q)));
}

// Determinant to the last bit or nearly so, whatever cancels.
static INLINED double exact_determinant(double3 a, double3 b, double3 c)
{
    const double left[3] = {a.x, a.y, a.z};
    const double2 minors[3] = {exact_products(b.y, c.z, -b.z, c.y),
                               exact_products(b.z, c.x, -b.x, c.z),
                               exact_products(b.x, c.y, -b.y, c.x)};
    double sum = 0.0, rest = 0.0;
    for (int i = 0; i < 3; i++) {
        double term = left[i] * minors[i].x, next = sum + term, added = next - sum;
        rest += (sum - (next - added)) + (term - added);
        rest += fma(left[i], minors[i].x, -term) + left[i] * minors[i].y;
        sum = next;
    }
    return sum + rest;
}

// The determinant over time of a path that reaches behind the eye: its zeros end intervals.
static void exact_facing(const double3 *q, double *d)
{
    for (int k = 0; k < 4; k++) d[k] = 0.0;
    for (int corners = 0; corners < 8; corners++) { // bit i: vertex i at the segment's end
        int a = corners & 1, b = corners >> 1 & 1, c = corners >> 2;
        d[a + b + c] += exact_determinant(q[3 * a], q[1 + 3 * b], q[2 + 3 * c]);
    }
    d[1] /= 3.0, d[2] /= 3.0;
}

// When the path's front faces the viewer: while the determinant d of its vertices is below zero. At
// its zeros the triangle's plane passes through the eye. The sample plays no part.
static void facing_over_time(const double *d, Shape *shape)
{
    double roots[3];
    int count = bernstein_cubic_roots(d, roots);
    shape->facing_changes[0] = bernstein_cubic_start(d) < 0.0 ? 1.0f : -1.0f;
    for (int i = 0; i < 3; i++)
        shape->facing_changes[i + 1] = i < count ? (float)roots[i] : INFINITY;
}

// Order of moving vertices by position, at the start and then at the end (Akenine-Möller et al.
// 2007, 3.3.2): the same for every face at an edge, whatever the order of its vertices.
static INLINED bool comes_before(double3 p0, double3 p1, double3 q0, double3 q1)
{
    if (p0.x != q0.x) return p0.x < q0.x;
    if (p0.y != q0.y) return p0.y < q0.y;
    if (p0.z != q0.z) return p0.z < q0.z;
    if (p1.x != q1.x) return p1.x < q1.x;
    if (p1.y != q1.y) return p1.y < q1.y;
    return p1.z < q1.z;
}

// Whether the path is smaller than 1e-11 of its place at all times, a hundred-millionth of a pixel:
// its edge functions would be little but rounding, which might agree.
static bool is_nothing(const double3 *q, const Depth *depth)
{
    double3 most = 0.0;
    for (int i = 0; i < 6; i++) most = fmax(most, fabs(q[i]));
    double3 least = 1e-22 * (double3)(most.y * most.z, most.x * most.z, most.x * most.y);
    bool nothing = true;
    for (int k = 0; k < 3; k++)
        nothing &= fabs(depth->x[k]) <= least.x && fabs(depth->y[k]) <= least.y
                   && fabs(depth->w[k]) <= least.z;
    return nothing;
}

// How far lens and glossy mirrors spread a path at most: on screen in pixels, and in depth.
typedef struct {
    double blur, deep;
} Reach;

// Vertex i of the path: three at the start, three at the end.
static inline Vertex vertex_of(global const Vertex *vertices, Path path, int i)
{
    uint corner[3] = {path.a, path.b, path.c};
    return vertices[corner[i % 3] + (i < 3 ? 0u : path.step)];
}

static Reach reach_of_lens(global const Vertex *vertices, Path path)
{
    Reach reach = {0.0, 0.0};
#if LENS()
    bool blurred = false;
    for (int i = 0; i < 6; i++) {
        Vertex v = vertex_of(vertices, path, i);
        // Next to the eye's plane any circle between the vertices' is as great as you like.
        blurred |= v.circle != 0.0;
        reach.blur = fmax(reach.blur, v.w > 0.0 ? fabs(v.circle) / v.w : INFINITY);
    }
    if (!blurred) reach.blur = 0.0;
#endif
    return reach;
}

#if GLOSSY()
static Reach reach_in_mirror(global const Vertex *vertices, Path path, const Shear *shear)
{
    Reach reach = {0.0, 0.0};
    for (int i = 0; i < 6; i++) {
        Vertex v = vertex_of(vertices, path, i);
        double2 spread = shear_reach(shear, i / 3, v.x, v.y, v.w);
#if LENS()
        spread.y += fabs(v.circle) / fmax(v.w - spread.x, 1e-300);
#endif
        reach.deep = fmax(reach.deep, spread.x), reach.blur = fmax(reach.blur, spread.y);
    }
    return reach;
}
#endif

static void shape_of_path(global const Vertex *vertices, Path path, bool single_sided, Reach reach,
                          Shape *shape, Depth *depth)
{
    double3 q[6];
    for (int i = 0; i < 6; i++) {
        Vertex v = vertex_of(vertices, path, i);
        q[i] = (double3)(v.x, v.y, v.w);
    }
    const double blur = reach.blur, deep = reach.deep;
    double w_low = q[0].z, w_high = q[0].z;
    float y_min = INFINITY, y_max = -INFINITY;
    for (int i = 0; i < 6; i++) {
        w_low = fmin(w_low, q[i].z), w_high = fmax(w_high, q[i].z);
        float y = (float)(q[i].y / q[i].z);
        y_min = fmin(y_min, y), y_max = fmax(y_max, y);
    }
    w_low -= deep, w_high += deep;
    shape->flags = w_high <= 0.0 ? SHAPE_CULLED : w_low <= 0.0 ? SHAPE_BEHIND : 0u;
    shape->y_min = w_low > 0.0 ? y_min - (float)(MARGIN + blur) : -INFINITY;
    shape->y_max = w_low > 0.0 ? y_max + (float)(MARGIN + blur) : INFINITY;
    shape->near = (float)fmax(w_low, 0.0) * (1.0f - 1e-6f);
    shape->far = (float)w_high * (1.0f + 1e-6f);
    shape->scale = (float)exp2(-floor(log2(fmax(w_high, -w_low))));
    int corners = path.step == 0 ? 3 : 6; // what does not move ends where it starts
    shape->planes = blur < INFINITY ? bounding_planes(q, corners, blur, shape) : 0u;
    *depth = depth_over_time(q);
    if (is_nothing(q, depth)) shape->flags |= SHAPE_CULLED;
    if (shape->flags & SHAPE_BEHIND) exact_facing(q, depth->d);
    facing_over_time(depth->d, shape);
#if !LENS() // through the points of a lens a path faces the eye at other times
    single_sided &= deep == 0.0; // and so does what is sheared
    if (single_sided && shape->facing_changes[0] < 0.0f && shape->facing_changes[1] > 1.0f)
        shape->flags |= SHAPE_CULLED;
#endif
    for (int side = 0; side < 3; side++) {
        int p = side, r = (side + 1) % 3;
        if (comes_before(q[r], q[r + 3], q[p], q[p + 3])) {
            shape->flags |= SHAPE_REVERSED << side;
            p = r, r = side;
        }
        if (path.step != 0
            && edge_crosses(q[p], q[r], q[p + 3], q[r + 3], shape->crossing + 2 * side))
            shape->flags |= SHAPE_CROSSED << side;
    }
}

#define PATHS_PER_ITEM 256

kernel void paths(global const Vertex *vertices, global const Path *paths, uint count,
                  global const Mesh *meshes, global const Material *materials,
#if GLOSSY()
                  global const Camera *cameras,
#endif
                  global Shape *shapes, global Depth *depths)
{
    uint first = get_global_id(0) * PATHS_PER_ITEM;
    for (uint i = first; i < min(first + PATHS_PER_ITEM, count); i++) {
        Path path = paths[i];
        uint flags = materials[meshes[path.mesh].material].flags;
        Shape shape = {.flags = 0u};
        Depth depth;
        Reach reach = reach_of_lens(vertices, path);
#if GLOSSY()
        Shear shear = load_shear(cameras, meshes + path.mesh, path);
        if (shear.any) reach = reach_in_mirror(vertices, path, &shear);
#endif
        shape_of_path(vertices, path, flags & MATERIAL_SINGLE_SIDED, reach, &shape, &depth);
        shapes[i] = shape;
#if EXACT()
        depth.near = shape.near, depth.far = shape.far;
        depth.open = path.open, depth.length = path_length(path);
        depths[i] = depth;
#endif
    }
}
