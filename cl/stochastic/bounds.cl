// Stage "bounds": what a path's vertices say about all samples.
#include "shared/effects.h"
#include "shared/scene.h"
#include "shared/shear.h"

#pragma OPENCL FP_CONTRACT OFF

// Power of two that brings everything in a frame of so many pixels near 1: float32 must hold
// products.
static float power_of_two_for(double most) { return (float)exp2(-floor(log2(fmax(most, 1e-37)))); }

static INLINED double determinant(double3 a, double3 b, double3 c)
{
    return a.x * (b.y * c.z - b.z * c.y) + a.y * (b.z * c.x - b.x * c.z)
           + a.z * (b.x * c.y - b.y * c.x);
}

// Least Bernstein coefficient over the motion of the determinant of the vertices, whose rows are q
// but for one column, 0 or 1, that is the circle of confusion where `column` says so.
static void determinants(const double3 *q, const double *circle, int column, double *d)
{
    double3 p[6];
    for (int i = 0; i < 6; i++) {
        p[i] = q[i];
        if (column == 0) p[i].x = circle[i];
        if (column == 1) p[i].y = circle[i];
    }
    for (int k = 0; k < 4; k++) d[k] = 0.0;
    for (int corners = 0; corners < 8; corners++) {
        int a = corners & 1, b = corners >> 1 & 1, c = corners >> 2;
        double part = a + b + c == 1 || a + b + c == 2 ? 1.0 / 3.0 : 1.0;
        d[a + b + c] += part * determinant(p[3 * a], p[1 + 3 * b], p[2 + 3 * c]);
    }
}

// Whether only the back is seen, from any point of the lens, by more than the sample test may
// round.
static bool faces_away(const double3 *q, const double *circle)
{
    double3 middle = 0.0;
    double w_low = q[0].z, w_high = q[0].z;
    for (int i = 0; i < 6; i++) {
        w_low = fmin(w_low, q[i].z), w_high = fmax(w_high, q[i].z);
        middle += q[i];
    }
    if (w_low <= 0.0) return false;
    double x = middle.x / middle.z, y = middle.y / middle.z, reach = 0.0, span = 0.0;
    double3 p[6];
    for (int i = 0; i < 6; i++) {
        p[i] = (double3)(q[i].x - x * q[i].z, q[i].y - y * q[i].z, q[i].z);
        reach = fmax(reach, fmax(fabs(p[i].x), fabs(p[i].y)) + fabs(circle[i]) + 32.0 * w_high);
    }
    for (int end = 0; end < 6; end += 3)
        for (int i = 0; i < 3; i++) {
            double3 side = p[end + (i + 1) % 3] - p[end + i];
            span = fmax(span, fabs(side.x) + fabs(side.y) + fabs(side.z) * reach / w_low
                              + fabs(circle[end + (i + 1) % 3] - circle[end + i]));
        }
    double d[4], du[4], dv[4];
    determinants(p, circle, -1, d);
    determinants(p, circle, 0, du);
    determinants(p, circle, 1, dv);
    double noise = 0x1p-19 * reach * span * w_high;
    bool away = true;
    for (int k = 0; k < 4; k++) away &= d[k] - fabs(du[k]) - fabs(dv[k]) > noise;
    return away;
}

#define PATHS_PER_ITEM 256

kernel void bounds(Numbers numbers, global const Vertex *vertices, global const Path *paths,
                   global const Mesh *meshes, global const Material *materials,
                   global const Camera *cameras, global Bounds *bounds)
{
    const uint start = get_global_id(0) * PATHS_PER_ITEM;
    const double edge = max(numbers.width, numbers.height);
    for (uint i = start; i < min(start + PATHS_PER_ITEM, numbers.path_count); i++) {
        Path path = paths[i];
        Mesh mesh = meshes[path.mesh];
        const uint corner[3] = {path.a, path.b, path.c};
        double3 q[6];
        double circle[6], low = INFINITY, high = -INFINITY, most = 0.0;
        for (int k = 0; k < 6; k++) {
            Vertex v = vertices[corner[k % 3] + (k < 3 ? 0u : path.step)];
            q[k] = (double3)(v.x, v.y, v.w);
            circle[k] = v.circle;
            low = fmin(low, v.w), high = fmax(high, v.w);
            most = fmax(most, fmax(fabs(v.x), fabs(v.y)) + edge * fabs(v.w));
            most = fmax(most, fabs(v.circle));
        }
        bool one_sided = materials[mesh.material].flags & MATERIAL_SINGLE_SIDED, turns = false;
#if GLOSSY()
        Shear shear = load_shear(cameras, meshes + path.mesh, path);
        double deep = 0.0;
        for (int k = 0; k < 6 && shear.any; k++)
            deep = fmax(deep, shear_reach(&shear, k / 3, q[k].x, q[k].y, q[k].z).x);
        low -= deep, high += deep, turns = shear.any;
#endif
        Bounds found = {.scale = power_of_two_for(most), .flags = 0u};
        found.near = (float)fmax(low, 0.0) * (1.0f - 1e-6f);
        found.far = low > 0.0 ? (float)high * (1.0f + 1e-6f) : INFINITY;
        bool away = one_sided && !turns && faces_away(q, circle);
        if (one_sided) found.flags |= BOUNDS_SINGLE_SIDED | (away ? BOUNDS_CULLED : 0u);
        if (high <= 0.0) found.flags |= BOUNDS_CULLED;
        bounds[i] = found;
    }
}
