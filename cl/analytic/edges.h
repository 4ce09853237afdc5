// Time-dependent edge functions of a moving triangle at a sample (Akenine-Moeller et al. 2007, 3.3.2).
//
// Edge i lies opposite vertex i. At the sample (X, Y) its function is the cross product of its two
// vertices shifted to the sample, (x - X w, y - Y w): a quadratic over the motion segment, in
// Bernstein form. Its vertices are taken in order of position (SHAPE_REVERSED), so that the faces on
// both sides of an edge find the same bits, and the sign is given back afterwards. The triangle
// covers the sample while all three are below zero (front) or above (back) and the sample's point
// lies before the eye. The sum of the three, 1/w apart from a factor, is linear in X and Y.
#ifndef MB_EDGES_H
#define MB_EDGES_H

#include "shared/records.h"

typedef struct {
    double x[6], y[6], w[6]; // vertices 0 1 2 at the segment's start, 3 4 5 at its end
    uint reversed;           // bit of edge i
} MovingTriangle;

static void load_moving(global const Vertex *vertices, Path path, uint flags, MovingTriangle *m)
{
    uint corner[3] = {path.a, path.b, path.c};
    for (int i = 0; i < 6; i++) {
        Vertex v = vertices[corner[i % 3] + (i < 3 ? 0u : path.step)];
        m->x[i] = v.x, m->y[i] = v.y, m->w[i] = v.w;
    }
    // Side s of a path joins vertices s and s + 1: it is edge s + 2.
    uint sides = flags / SHAPE_REVERSED & 7u;
    m->reversed = (sides >> 1 & 1u) | (sides >> 2 & 1u) << 1 | (sides & 1u) << 2;
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

// Bernstein coefficients of edge i's function at the sample (x, y).
static void edge_function(const MovingTriangle *m, int i, double x, double y, double *b)
{
    int p = edge_first(m, i), q = edge_second(m, i);
    double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
    double px = fma(-x, m->w[p], m->x[p]), py = fma(-y, m->w[p], m->y[p]);
    double qx = fma(-x, m->w[q], m->x[q]), qy = fma(-y, m->w[q], m->y[q]);
    double rx = fma(-x, m->w[p + 3], m->x[p + 3]), ry = fma(-y, m->w[p + 3], m->y[p + 3]);
    double sx = fma(-x, m->w[q + 3], m->x[q + 3]), sy = fma(-y, m->w[q + 3], m->y[q + 3]);
    b[0] = sign * cross2(px, py, qx, qy);
    b[1] = sign * (0.5 * (cross2(px, py, sx, sy) + cross2(rx, ry, qx, qy)));
    b[2] = sign * cross2(rx, ry, sx, sy);
}

// What an edge function that is zero throughout becomes when the sample moves by (eps, eps^2): its
// derivative along x, or, where that is zero throughout too, along y.
static void edge_derivative(const MovingTriangle *m, int i, double x, double y, bool along_x,
                            double *b)
{
    int p = edge_first(m, i), q = edge_second(m, i);
    double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
    double wp[2] = {m->w[p], m->w[p + 3]}, wq[2] = {m->w[q], m->w[q + 3]}, vp[2], vq[2];
    for (int k = 0; k < 2; k++) {
        int u = p + 3 * k, v = q + 3 * k;
        vp[k] = along_x ? fma(-y, m->w[u], m->y[u]) : -fma(-x, m->w[u], m->x[u]);
        vq[k] = along_x ? fma(-y, m->w[v], m->y[v]) : -fma(-x, m->w[v], m->x[v]);
    }
    b[0] = sign * cross2(vp[0], wp[0], vq[0], wq[0]);
    b[1] = sign * (0.5 * (cross2(vp[0], wp[0], vq[1], wq[1]) + cross2(vp[1], wp[1], vq[0], wq[0])));
    b[2] = sign * cross2(vp[1], wp[1], vq[1], wq[1]);
}

#endif
