// A moving triangle in the coordinates of a tile, and whether it covers a sample: the one test that
// all culling methods share, so that they give the same bits.
//
// At a sample (x, y, t, u, v) the vertices are those of time t, seen from the point (u, v) of the
// lens and shifted to the sample: p = (X w - x w, Y w - y w), from which the edge functions are
// three cross products (after Laine & Karras 2011: about 25 multiply-adds; the report was not at
// hand). Where all are of one sign the sample lies in the triangle or in its mirror image behind
// the eye; the depth, sum of e_i w_i over sum of e_i, tells which by its sign.
//
// TEST_EDGES has time-dependent edge functions instead (Akenine-Moeller et al. 2007, 3.3.2), a t^2
// + b t + c for each coefficient, of vertices in order of position; they know no lens.
//
// Faces at a shared edge find the same vertices, in one tile, bit by bit. The sign of a difference
// of two rounded products is never wrong, but may be lost; then it is decided in double precision,
// where a product of two floats is exact. An edge that runs through the sample is decided as if the
// sample lay at (x + eps, y + eps^2). So a closed sheet covers each sample once, by exact rules for
// the rounded vertices.
#ifndef MB_MOVING_H
#define MB_MOVING_H

#include "shared/effects.h"
#include "stochastic/tile_of_slabs.h"
#include "shared/coordinates.h"
#include "shared/shear.h"

typedef struct {
    float x[3], y[3], w[3];    // at the start of the segment, scaled
    float dx[3], dy[3], dw[3]; // from there to its end
#if LENS()
    float c[3], dc[3];         // circle of confusion
#endif
#if GLOSSY()
    bool sheared;
    Added first[3], last[3];   // what a and b of a sample add to the vertices at both ends
#endif
#if TEST_EDGES()
    // of edge i, factor of x, y and 1, the coefficients of 1, tau and tau^2
    float edge[3][3][3];
#endif
    float open, close, rate;   // of its motion segment, in the shutter; one over its length
    float size;                // to undo the scale
    float slack;               // more than the rounding of x and y
    float near;
    uint path;
    bool single_sided;
#if TRANSLUCENT()
    float alpha;               // the path's
#endif
} Moving;

// Sixteen samples.
typedef struct {
#define MEMBER(name) Lanes name;
    COORDINATES(MEMBER)
#undef MEMBER
    Lanes t;
} Samples;

// Those of a slab in one block, and their times in a path's segment.
typedef struct {
    int index;
    Samples at;
    Lanes tau;
} SlabSamples;

static inline Samples load_samples(const Tile *tile, int index)
{
    Samples s;
#define LOAD(name) s.name = load(tile->name##s, index);
    COORDINATES(LOAD)
#undef LOAD
    s.t = load(tile->ts, index);
    return s;
}

#if GLOSSY()
// Load how a path is sheared, with the scale and the origin of its vertices. Returns the most that
// is added to them.
static float load_added(const Tile *tile, Path path, double scale, double x, double y, Moving *m)
{
    Shear shear = load_shear(tile->scene.cameras, tile->scene.meshes + path.mesh, path);
    const uint corner[3] = {path.a, path.b, path.c};
    float most = 0.0f;
    m->sheared = shear.any;
    for (int i = 0; i < 3 && shear.any; i++) {
        global const Vertex *v = tile->scene.vertices + corner[i];
        m->first[i] = added_by_shear(&shear, 0, v[0], scale, x, y);
        m->last[i] = added_by_shear(&shear, 1, v[path.step], scale, x, y);
        for (int k = 0; k < 6; k++) {
            float from = m->first[i].by[k / 3][k % 3], to = m->last[i].by[k / 3][k % 3];
            most = fmax(most, (k % 3 == 2 ? 2.0f * HALF : 1.0f) * fmax(fabs(from), fabs(to)));
        }
    }
    return most;
}

// What the samples' shear adds to x, y or w (0, 1, 2) of vertex i at time tau.
static INLINED Lanes sheared_by(const Moving *m, int which, int i, const Samples *s, Lanes tau)
{
    float a = m->first[i].by[0][which], b = m->first[i].by[1][which];
    float da = m->last[i].by[0][which] - a, db = m->last[i].by[1][which] - b;
    return s->a * (a + tau * da) + s->b * (b + tau * db);
}
#endif

#if TEST_EDGES()
static INLINED bool comes_before(double3 p0, double3 p1, double3 q0, double3 q1)
{
    if (p0.x != q0.x) return p0.x < q0.x;
    if (p0.y != q0.y) return p0.y < q0.y;
    if (p0.z != q0.z) return p0.z < q0.z;
    if (p1.x != q1.x) return p1.x < q1.x;
    if (p1.y != q1.y) return p1.y < q1.y;
    return p1.z < q1.z;
}

// Coefficients of the edge from vertex i + 1 to vertex i + 2; q and r are the vertices' two ends.
static void edge_over_time(const double3 *q, const double3 *r, int i, float coefficient[3][3])
{
    int a = (i + 1) % 3, b = (i + 2) % 3;
    bool reversed = comes_before(q[b], r[b], q[a], r[a]);
    if (reversed) a = b, b = (i + 1) % 3;
    double3 h = cross(q[a], q[b]), end = cross(r[a], r[b]);
    double3 m = cross(q[a], r[b]) + cross(r[a], q[b]);
    double3 g = m - 2.0 * h, f = h - m + end;
    double sign = reversed ? -1.0 : 1.0;
    const double3 terms[3] = {sign * h, sign * g, sign * f};
    for (int k = 0; k < 3; k++) {
        coefficient[0][k] = (float)terms[k].x, coefficient[1][k] = (float)terms[k].y;
        coefficient[2][k] = (float)terms[k].z;
    }
}

// Edge function i at the samples.
static INLINED Lanes edge_at(const Moving *m, int i, const Samples *s, Lanes tau)
{
    Lanes factor[3];
    for (int k = 0; k < 3; k++) {
        const float *c = m->edge[i][k];
        factor[k] = fma(fma(tau, (Lanes)(c[2]), (Lanes)(c[1])), tau, (Lanes)(c[0]));
    }
    return fma(s->x, factor[0], fma(s->y, factor[1], factor[2]));
}
#endif

static Moving load_moving(const Tile *tile, uint index)
{
    Moving m;
    Path path = tile->scene.paths[index];
    Bounds bounds = tile->bounds[index];
    const uint corner[3] = {path.a, path.b, path.c};
    const double scale = bounds.scale, x = tile->x + HALF, y = tile->y + HALF;
    float most = 0.0f;
#if TEST_EDGES()
    double3 start[3], end[3];
#endif
    for (int i = 0; i < 3; i++) {
        Vertex q = tile->scene.vertices[corner[i]], r = tile->scene.vertices[corner[i] + path.step];
        float x1 = (float)(scale * (r.x - x * r.w)), y1 = (float)(scale * (r.y - y * r.w));
        float w1 = (float)(scale * r.w);
        m.x[i] = (float)(scale * (q.x - x * q.w)), m.y[i] = (float)(scale * (q.y - y * q.w));
        m.w[i] = (float)(scale * q.w);
        m.dx[i] = x1 - m.x[i], m.dy[i] = y1 - m.y[i], m.dw[i] = w1 - m.w[i];
        most = fmax(most, fmax(fmax(fabs(m.x[i]), fabs(x1)), fmax(fabs(m.y[i]), fabs(y1))));
        most = fmax(most, 2.0f * HALF * fmax(fabs(m.w[i]), fabs(w1)));
#if TEST_EDGES()
        start[i] = scale * (double3)(q.x - x * q.w, q.y - y * q.w, q.w);
        end[i] = scale * (double3)(r.x - x * r.w, r.y - y * r.w, r.w);
#endif
#if LENS()
        float c1 = (float)(scale * r.circle);
        m.c[i] = (float)(scale * q.circle);
        m.dc[i] = c1 - m.c[i];
        most = fmax(most, fmax(fabs(m.c[i]), fabs(c1)));
#endif
    }
#if TEST_EDGES()
    for (int i = 0; i < 3; i++) edge_over_time(start, end, i, m.edge[i]);
#endif
#if GLOSSY()
    most += 2.0f * load_added(tile, path, scale, x, y, &m);
#endif
    m.open = path.open, m.close = path.close, m.rate = 1.0f / path_length(path);
    m.size = 1.0f / bounds.scale;
    m.slack = 0x1p-19f * most;
    m.near = bounds.near;
    m.path = index;
    m.single_sided = bounds.flags & BOUNDS_SINGLE_SIDED;
#if TRANSLUCENT()
    m.alpha = path.alpha;
#endif
    return m;
}

// A bound, further out by `by` times vertex i's circle of confusion at time t of the segment.
static inline float out_by_lens(float bound, const Moving *m, int i, float t, float by)
{
#if LENS()
    bound += fabs(m->c[i] + t * m->dc[i]) * by;
#endif
    return bound;
}

// Place of a time of the shutter in the segment.
static INLINED Lanes time_in_segment(const Moving *m, Lanes t) { return (t - m->open) * m->rate; }

// Segments are half-open, but the shutter's last moment belongs to its last one.
static INLINED LaneMask in_segment(const Moving *m, Lanes t)
{
    return (t >= m->open) & ((t < m->close) | (LaneMask)(m->close >= 1.0f ? -1 : 0));
}

// Vertex i of the triangle at time tau, relative to the samples.
static INLINED Lanes3 vertex_at(const Moving *m, int i, const Samples *s, Lanes tau)
{
    Lanes3 p;
    p.z = fma(tau, (Lanes)(m->dw[i]), (Lanes)(m->w[i]));
    p.x = fma(tau, (Lanes)(m->dx[i]), (Lanes)(m->x[i]));
    p.y = fma(tau, (Lanes)(m->dy[i]), (Lanes)(m->y[i]));
#if GLOSSY()
    if (m->sheared) {
        p.x += sheared_by(m, 0, i, s, tau), p.y += sheared_by(m, 1, i, s, tau);
        p.z += sheared_by(m, 2, i, s, tau);
    }
#endif
#if LENS()
    Lanes circle = fma(tau, (Lanes)(m->dc[i]), (Lanes)(m->c[i]));
    p.x = fma(s->u, circle, p.x);
    p.y = fma(s->v, circle, p.y);
#endif
    p.x = fma(-s->x, p.z, p.x);
    p.y = fma(-s->y, p.z, p.y);
    return p;
}

static INLINED Lanes edge_of(Lanes3 a, Lanes3 b) { return a.x * b.y - b.x * a.y; }

// Sign, or 0 for a degenerate edge, of an edge function that float32 has as zero.
static INLINED int exact_sign(double3 a, double3 b)
{
    double p = a.x * b.y, q = b.x * a.y;
    if (p == q) p = b.z * a.y, q = a.z * b.y; // along x
    if (p == q) p = b.x * a.z, q = a.x * b.z; // along y
    return (p > q) - (p < q);
}

// Those of the lanes in which one edge function is zero that are hits nevertheless.
static INLINED LaneMask exact_hits(LaneMask unsure, const Lanes3 *p, bool single_sided)
{
    float v[9][LANES];
    int mask[LANES];
    for (int i = 0; i < 3; i++)
        lanes_store(p[i].x, v[3 * i]), lanes_store(p[i].y, v[3 * i + 1]),
        lanes_store(p[i].z, v[3 * i + 2]);
    lanes_store(unsure, mask);
    for (int k = 0; k < LANES; k++) {
        if (!mask[k]) continue;
        double3 q[3];
        for (int i = 0; i < 3; i++) q[i] = (double3)(v[3 * i][k], v[3 * i + 1][k], v[3 * i + 2][k]);
        int a = exact_sign(q[1], q[2]), b = exact_sign(q[2], q[0]), c = exact_sign(q[0], q[1]);
        mask[k] = a == b && b == c && (single_sided ? a < 0 : a != 0) ? -1 : 0;
    }
    return lanes_load(mask);
}

// Which of the samples in `mask` the triangle covers, and its depth there.
static INLINED LaneMask covered(const Moving *m, const Samples *s, LaneMask mask, Lanes *depth)
{
    Lanes tau = time_in_segment(m, s->t);
    Lanes3 p[3];
    for (int i = 0; i < 3; i++) p[i] = vertex_at(m, i, s, tau);
#if TEST_EDGES()
    Lanes e0 = edge_at(m, 0, s, tau), e1 = edge_at(m, 1, s, tau), e2 = edge_at(m, 2, s, tau);
#else
    Lanes e0 = edge_of(p[1], p[2]), e1 = edge_of(p[2], p[0]), e2 = edge_of(p[0], p[1]);
#endif
    Lanes least = lanes_min(lanes_min(e0, e1), e2), most = lanes_max(lanes_max(e0, e1), e2);
#if SINGLE_SIDED()
    mask &= m->single_sided ? most <= 0.0f : (least >= 0.0f) | (most <= 0.0f);
#else
    mask &= (least >= 0.0f) | (most <= 0.0f);
#endif
    mask &= in_segment(m, s->t);
    if (!any_lane(mask)) return mask;
    LaneMask unsure = mask & ((least == 0.0f) | (most == 0.0f));
    if (any_lane(unsure)) mask = (mask & ~unsure) | exact_hits(unsure, p, m->single_sided);
    Lanes w = (e0 * p[0].z + e1 * p[1].z + e2 * p[2].z) / ((e0 + e1) + e2);
    Lanes low = lanes_min(lanes_min(p[0].z, p[1].z), p[2].z);
    Lanes high = lanes_max(lanes_max(p[0].z, p[1].z), p[2].z);
    mask &= w > 0.0f; // not 0 by 0 either
    *depth = lanes_min(lanes_max(w, low), high) * m->size;
    return mask;
}

#endif
