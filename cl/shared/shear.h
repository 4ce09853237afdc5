// Glossy mirrors: what is seen in one is sheared along its plane, a vertex at height h over the
// plane by h (a T + b B), where T and B lie in the plane and (a, b) is a point of the unit disc
// that each sample draws (Akenine-Moeller et al. 2007, 4.3, after Diefenbach & Badler 1997).
//
// In homogeneous pixels the height is affine in (x, y, w), so that a sheared vertex is linear in
// (a, b) and, between the ends of a motion segment, in time: as through a point of a lens, but that
// its depth is moved too.
#ifndef MB_SHEAR_H
#define MB_SHEAR_H

#include "shared/effects.h"

#if GLOSSY()

#include "shared/lanes.h"
#include "shared/records.h"

// A path's shear at both ends of its motion segment.
typedef struct {
    bool any;
    double plane[2][4];   // height of a vertex: the product with (x, y, w, 1)
    double tilt[2][2][3]; // what a and b add to (x, y, w) for each unit of height
} Shear;

static Shear load_shear(global const Camera *cameras, global const Mesh *mesh, Path path)
{
    Shear s = {.any = mesh->sheared != 0u};
    if (!s.any) return s;
    uint segment = path.step == 0u ? 0u : (path.a - mesh->vertex) / mesh->count;
    for (int end = 0; end < 2; end++) {
        global const Camera *camera
            = cameras + mesh->camera + segment + (path.step == 0u ? 0 : end);
        for (int k = 0; k < 4; k++) s.plane[end][k] = camera->plane[k];
        for (int k = 0; k < 6; k++) s.tilt[end][k / 3][k % 3] = camera->tilt[k];
    }
    return s;
}

static inline double shear_height(const Shear *s, int end, double x, double y, double w)
{
    const double *plane = s->plane[end];
    return plane[0] * x + plane[1] * y + plane[2] * w + plane[3];
}

// The farthest that a vertex is moved: in depth, and on screen in pixels, which is infinite where
// it may come to the eye's plane or behind it.
static double2 shear_reach(const Shear *s, int end, double x, double y, double w)
{
    double height = fabs(shear_height(s, end, x, y, w));
    const double *a = s->tilt[end][0], *b = s->tilt[end][1];
    double deep = height * sqrt(a[2] * a[2] + b[2] * b[2]), least = w - deep;
    if (!(least > 0.0)) return (double2)(deep, INFINITY);
    double px = x / w, py = y / w;
    double ax = a[0] - px * a[2], bx = b[0] - px * b[2];
    double ay = a[1] - py * a[2], by = b[1] - py * b[2];
    return (double2)(deep, height * sqrt(ax * ax + bx * bx + ay * ay + by * by) / least);
}

// What a and b add to (x, y, w) of a vertex, scaled, and with (x, y) on screen as its origin.
typedef struct {
    float by[2][3];
} Added;

static Added added_by_shear(const Shear *s, int end, Vertex v, double scale, double x, double y)
{
    double height = scale * shear_height(s, end, v.x, v.y, v.w);
    Added added;
    for (int i = 0; i < 2; i++) {
        const double *tilt = s->tilt[end][i];
        added.by[i][0] = (float)(height * (tilt[0] - x * tilt[2]));
        added.by[i][1] = (float)(height * (tilt[1] - y * tilt[2]));
        added.by[i][2] = (float)(height * tilt[2]);
    }
    return added;
}

// How far a vertex is spread on screen at most, across and down, at sixteen times, and its least
// depth. It is at (x, y) and depth w, and what is added to it changes from `first` to `last`.
typedef struct {
    Lanes across, down, least;
} Spread;

static INLINED Spread spread_over_time(const Added *first, const Added *last, Lanes tau, Lanes x,
                                       Lanes y, Lanes w)
{
    Lanes add[2][3];
    for (int i = 0; i < 6; i++) {
        float from = first->by[i / 3][i % 3], to = last->by[i / 3][i % 3];
        add[i / 3][i % 3] = from + tau * (to - from);
    }
    const float more = 1.0f + 1e-5f; // than rounding
    Lanes ax = add[0][0] - x * add[0][2], bx = add[1][0] - x * add[1][2];
    Lanes ay = add[0][1] - y * add[0][2], by = add[1][1] - y * add[1][2];
    Lanes deep = sqrt(add[0][2] * add[0][2] + add[1][2] * add[1][2]);
    Spread s = {.least = w - more * deep};
    s.across = more * sqrt(ax * ax + bx * bx) / s.least;
    s.down = more * sqrt(ay * ay + by * by) / s.least;
    return s;
}

#endif

#endif
