// The light that reaches point samples: by rays at each sample's own time, or by a shadow map with
// several times in each texel (Akenine-Moeller et al. 2007, 3.5).
#ifndef MB_LIGHTS_H
#define MB_LIGHTS_H

#include "shared/effects.h"
#include "stochastic/moving.h"
#include "stochastic/trace.h"
#include "shared/attributes.h"

#if GLOSSY()
// What samples' shear adds to (x, y, w) of a vertex that moves from a to b.
static INLINED LaneDoubles3 added_to(const Shear *shear, Vertex a, Vertex b, LaneDoubles tau,
                                 const Samples *s)
{
    double first = shear_height(shear, 0, a.x, a.y, a.w);
    double last = shear_height(shear, 1, b.x, b.y, b.w);
    LaneDoubles add[3];
    for (int k = 0; k < 3; k++) {
        LaneDoubles start = first * (to_lane_doubles(s->a) * shear->tilt[0][0][k]
                                  + to_lane_doubles(s->b) * shear->tilt[0][1][k]);
        LaneDoubles end = last * (to_lane_doubles(s->a) * shear->tilt[1][0][k]
                               + to_lane_doubles(s->b) * shear->tilt[1][1][k]);
        add[k] = start + tau * (end - start);
    }
    return (LaneDoubles3){add[0], add[1], add[2]};
}
#endif

// Where samples see the path, in the world from the first eye: the mean of its vertices by the
// samples' edge functions.
static LaneDoubles3 points_seen(const Tile *tile, Path path, const Samples *samples)
{
    LaneDoubles tau = (to_lane_doubles(samples->t) - path.open) / path_length(path);
    LaneDoubles x = to_lane_doubles(samples->x) + (tile->x + HALF);
    LaneDoubles y = to_lane_doubles(samples->y) + (tile->y + HALF);
    const uint corner[3] = {path.a, path.b, path.c};
    LaneDoubles px[3], py[3], e[3];
#if GLOSSY()
    Shear shear = load_shear(tile->scene.cameras, tile->scene.meshes + path.mesh, path);
#endif
    for (int i = 0; i < 3; i++) {
        Vertex a = tile->scene.vertices[corner[i]], b = tile->scene.vertices[corner[i] + path.step];
        LaneDoubles w = a.w + tau * (b.w - a.w);
        px[i] = a.x + tau * (b.x - a.x), py[i] = a.y + tau * (b.y - a.y);
#if LENS()
        LaneDoubles circle = a.circle + tau * (b.circle - a.circle);
        px[i] += to_lane_doubles(samples->u) * circle;
        py[i] += to_lane_doubles(samples->v) * circle;
#endif
#if GLOSSY()
        LaneDoubles3 more = added_to(&shear, a, b, tau, samples);
        px[i] += more.x, py[i] += more.y, w += more.z;
#endif
        px[i] -= x * w, py[i] -= y * w;
    }
    LaneDoubles sum = 0.0;
    for (int i = 0; i < 3; i++) {
        int p = (i + 1) % 3, q = (i + 2) % 3;
        e[i] = px[p] * py[q] - px[q] * py[p];
        sum += e[i];
    }
    LaneDoubles3 seen = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3; i++) {
        LaneDoubles share = sum != 0.0 ? e[i] / sum : (LaneDoubles)(1.0 / 3.0);
        seen = lane_doubles_plus(seen, share,
                             world_at(&tile->occluders, corner[i], path.step, tau));
    }
    return seen;
}

#if SHADOW_MAP()

// Whether the nearest surface of the map's texel, at a time of the sample's stratum, lies before
// the point by more than the bias: `shadow_bias` times a texel's size there.
static INLINED bool is_hidden(const Tile *tile, uint index, double3 p, float t)
{
    global const LightView *view = tile->light_views + index;
    global const double *m = view->matrix;
    double x = m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3];
    double y = m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7];
    double w = m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11];
    double depth = m[12] * p.x + m[13] * p.y + m[14] * p.z + m[15];
    const Numbers *n = &tile->scene.numbers;
    const int size = n->shadow_size;
    if (!(w > 0.0 && x >= 0.0 && y >= 0.0 && x < size * w && y < size * w)) return false;
    int column = min((int)(x / w), size - 1), row = min((int)(y / w), size - 1);
    int stratum = clamp((int)(t * n->shadow_strata), 0, n->shadow_strata - 1);
    size_t texel = ((size_t)index * n->shadow_strata + stratum) * size + row;
    float nearest = tile->shadow_map[texel * size + column];
    return nearest + n->shadow_bias * view->texel * w < depth;
}

static INLINED Lanes mapped_share(const Tile *tile, const ShadowLight *light,
                                  const LaneDoubles3 *points, Lanes t)
{
    float share[LANES];
    for (int i = 0; i < LANES; i++) {
        double3 p = (double3)(LANE(double, points->x, i), LANE(double, points->y, i),
                              LANE(double, points->z, i));
        bool hidden = false;
        for (uint k = 0; k < light->views && !hidden; k++)
            hidden = is_hidden(tile, light->view + k, p, LANE(float, t, i));
        share[i] = hidden ? 0.0f : 1.0f;
    }
    return lanes_load(share);
}

#endif

// Shares of the light, of all lights that cast shadows, that reach what samples see of a path.
static void light_at_samples(const Tile *tile, uint path, const Samples *samples, Lanes *lit)
{
    LaneDoubles3 points = points_seen(tile, tile->scene.paths[path], samples);
    for (int k = 0; k < SHADOW_LIGHTS; k++) {
        ShadowLight light = tile->shadow_lights[k];
#if SHADOW_MAP()
        lit[k] = mapped_share(tile, &light, &points, samples->t);
#else
        Rays rays = {.from = points, .t = samples->t, .ends = light.finite};
        LaneDoubles3 towards = {light.vector[0], light.vector[1], light.vector[2]};
        LaneDoubles3 place = {light.origin[0], light.origin[1], light.origin[2]};
        rays.way = light.finite ? lane_doubles_plus(place, -1.0, points) : towards;
        lit[k] = light_share(&tile->occluders, &rays, path);
#endif
    }
}

#endif
