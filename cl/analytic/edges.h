// Time-dependent edge functions of a moving triangle at a sample (Akenine-Moeller et al. 2007,
// 3.3.2).
//
// Edge i lies opposite vertex i. At the sample (X, Y) its function is the cross product of its two
// vertices shifted to the sample, (x - X w, y - Y w): a quadratic over the motion segment, in
// Bernstein form. Its vertices are taken in order of position (SHAPE_REVERSED), so that the faces
// on both sides of an edge find the same bits, and the sign is given back afterwards. The triangle
// covers the sample while all three are below zero (front) or above (back) and the sample's point
// lies before the eye. The sum of the three, 1/w apart from a factor, is linear in X and Y.
#ifndef MB_EDGES_H
#define MB_EDGES_H

#include "shared/effects.h"
#include "analytic/tile_of_rows.h"
#include "shared/coordinates.h"
#include "shared/shear.h"

typedef struct {
    double x[6], y[6], w[6]; // vertices 0 1 2 at the segment's start, 3 4 5 at its end
#if LENS()
    double circle[6];
#endif
    uint reversed;           // bit of edge i
} MovingTriangle;

// x of vertex i, which is `at`, seen through points u of the lens; or y through points v.
#if LENS()
#define THROUGH_LENS(type, at, points, triangle, i) fma(points, (type)((triangle).circle[i]), at)
#else
#define THROUGH_LENS(type, at, points, triangle, i) (at)
#endif

static void load_moving(global const Vertex *vertices, Path path, uint flags, MovingTriangle *m)
{
    uint corner[3] = {path.a, path.b, path.c};
    for (int i = 0; i < 6; i++) {
        Vertex v = vertices[corner[i % 3] + (i < 3 ? 0u : path.step)];
        m->x[i] = v.x, m->y[i] = v.y, m->w[i] = v.w;
#if LENS()
        m->circle[i] = v.circle;
#endif
    }
    // Side s of a path joins vertices s and s + 1: it is edge s + 2.
    uint sides = flags / SHAPE_REVERSED & 7u;
    m->reversed = (sides >> 1 & 1u) | (sides >> 2 & 1u) << 1 | (sides & 1u) << 2;
}

#if GLOSSY()

// Heights of the vertices over the plane that they are sheared along.
static void shear_heights(const Shear *shear, const MovingTriangle *m, double *height)
{
    for (int i = 0; i < 6; i++)
        height[i] = shear_height(shear, i / 3, m->x[i], m->y[i], m->w[i]);
}

// The triangle as the sample sees it in a glossy mirror.
static void shear_triangle(const Shear *shear, const double *height, Place p, MovingTriangle *m)
{
    for (int i = 0; i < 6; i++) {
        const double *a = shear->tilt[i / 3][0], *b = shear->tilt[i / 3][1];
        m->x[i] += height[i] * ((double)p.a * a[0] + (double)p.b * b[0]);
        m->y[i] += height[i] * ((double)p.a * a[1] + (double)p.b * b[1]);
        m->w[i] += height[i] * ((double)p.a * a[2] + (double)p.b * b[2]);
    }
}

#endif

// The path's triangle as the sample at `place` sees it.
static void load_seen(const Tile *tile, uint path_index, Place place, MovingTriangle *m)
{
    Path path = tile->scene.paths[path_index];
    load_moving(tile->scene.vertices, path, tile->shapes[path_index].flags, m);
#if GLOSSY()
    Shear shear = load_shear(tile->scene.cameras, tile->scene.meshes + path.mesh, path);
    if (!shear.any) return;
    double height[6];
    shear_heights(&shear, m, height);
    shear_triangle(&shear, height, place, m);
#endif
}

#define RECORDS_AHEAD 8  // paths ahead of which their records are asked for
#define VERTICES_AHEAD 4 // likewise their vertices, once the path is there

// Ask for what members after the k-th need: a tile's paths lie far apart in memory.
static inline void fetch_ahead(const Tile *tile, uint k)
{
    if (k + RECORDS_AHEAD < tile->member_count) {
        uint path = tile->members[k + RECORDS_AHEAD];
        global const char *shape = (global const char *)(tile->shapes + path);
        for (int i = 0; i < (int)sizeof(Shape); i += 64) fetch(shape + i);
        fetch(tile->scene.paths + path);
    }
    if (k + VERTICES_AHEAD < tile->member_count) {
        global const Path *path = tile->scene.paths + tile->members[k + VERTICES_AHEAD];
        const uint corner[3] = {path->a, path->b, path->c};
        for (int i = 0; i < 3; i++) {
            fetch(tile->scene.vertices + corner[i]);
            fetch(tile->scene.vertices + corner[i] + path->step);
        }
    }
}

static inline bool is_single_sided(const Tile *tile, Path path)
{
#if SINGLE_SIDED()
    uint material = tile->scene.meshes[path.mesh].material;
    return tile->scene.materials[material].flags & MATERIAL_SINGLE_SIDED;
#else
    return false;
#endif
}

// First and second vertex of edge i in order of position.
static inline int edge_first(const MovingTriangle *m, int i)
{
    return (m->reversed >> i & 1u) ? (i + 2) % 3 : (i + 1) % 3;
}

static inline int edge_second(const MovingTriangle *m, int i)
{
    return (m->reversed >> i & 1u) ? (i + 1) % 3 : (i + 2) % 3;
}

static inline double cross2(double px, double py, double qx, double qy)
{
    return fma(px, qy, -(qx * py));
}

// Vertex i relative to the sample, as seen through its point of the lens.
static inline double shifted_x(const MovingTriangle *m, int i, Place p)
{
    double x = THROUGH_LENS(double, m->x[i], (double)p.u, *m, i);
    return fma(-(double)p.x, m->w[i], x);
}

static inline double shifted_y(const MovingTriangle *m, int i, Place p)
{
    double y = THROUGH_LENS(double, m->y[i], (double)p.v, *m, i);
    return fma(-(double)p.y, m->w[i], y);
}

// Bernstein coefficients of edge i's function at the sample.
static void edge_function(const MovingTriangle *m, int i, Place place, double *b)
{
    int p = edge_first(m, i), q = edge_second(m, i);
    double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
    double px = shifted_x(m, p, place), py = shifted_y(m, p, place);
    double qx = shifted_x(m, q, place), qy = shifted_y(m, q, place);
    double rx = shifted_x(m, p + 3, place), ry = shifted_y(m, p + 3, place);
    double sx = shifted_x(m, q + 3, place), sy = shifted_y(m, q + 3, place);
    b[0] = sign * cross2(px, py, qx, qy);
    b[1] = sign * (0.5 * (cross2(px, py, sx, sy) + cross2(rx, ry, qx, qy)));
    b[2] = sign * cross2(rx, ry, sx, sy);
}

// What an edge function that is zero throughout becomes when the sample moves by (eps, eps^2): its
// derivative along x, or, where that is zero throughout too, along y.
static void edge_derivative(const MovingTriangle *m, int i, Place place, bool along_x, double *b)
{
    int p = edge_first(m, i), q = edge_second(m, i);
    double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
    double wp[2] = {m->w[p], m->w[p + 3]}, wq[2] = {m->w[q], m->w[q + 3]}, vp[2], vq[2];
    for (int k = 0; k < 2; k++) {
        int u = p + 3 * k, v = q + 3 * k;
        vp[k] = along_x ? shifted_y(m, u, place) : -shifted_x(m, u, place);
        vq[k] = along_x ? shifted_y(m, v, place) : -shifted_x(m, v, place);
    }
    b[0] = sign * cross2(vp[0], wp[0], vq[0], wq[0]);
    b[1] = sign * (0.5 * (cross2(vp[0], wp[0], vq[1], wq[1]) + cross2(vp[1], wp[1], vq[0], wq[0])));
    b[2] = sign * cross2(vp[1], wp[1], vq[1], wq[1]);
}

// An edge function that is nowhere zero throughout, if the triangle is not degenerate.
static void perturbed_edge_function(const MovingTriangle *m, int i, Place place, double *b)
{
    edge_function(m, i, place, b);
    for (int along_x = 1; along_x >= 0 && b[0] == 0.0 && b[1] == 0.0 && b[2] == 0.0; along_x--)
        edge_derivative(m, i, place, along_x, b);
}

// Determinant of the three vertices over time, as seen through the sample's point of the lens: the
// sum of the edge functions times w; and the sum of the edge functions.
static void depth_of_edges(const MovingTriangle *m, Place place, double *d, double *e)
{
    for (int k = 0; k < 4; k++) d[k] = 0.0;
    for (int k = 0; k < 3; k++) e[k] = 0.0;
    for (int i = 0; i < 3; i++) {
        double b[3], w0 = m->w[i], w1 = m->w[i + 3];
        edge_function(m, i, place, b);
        for (int k = 0; k < 3; k++) e[k] += b[k];
        d[0] += b[0] * w0;
        d[1] += (2.0 * (b[1] * w0) + b[0] * w1) / 3.0;
        d[2] += (b[2] * w0 + 2.0 * (b[1] * w1)) / 3.0;
        d[3] += b[2] * w1;
    }
}

#endif
