// The environment where a sample's spans leave it open: its mean over that time, as the camera
// moves.
//
// It is looked up in the middles of equal parts of the time, at first no further apart than texels
// are, each weighed with the light that no span takes from it. The error is 1/24 of the mean
// second difference where light changes smoothly, and no more than 1/8 of its size where it has a
// corner, as quadrature.h has it; where the latter is above `shading_error` there are twice as many
// parts, up to eight per texel.
#ifndef MB_SKY_OVER_TIME_H
#define MB_SKY_OVER_TIME_H

#include "shared/effects.h"
#include "analytic/line_window.h"
#include "shared/gaze.h"

#define MOST_SKY_PARTS 4096
#define NO_SKY 1e-6f // openness below which it is rounding

static INLINED Lanes3 ways_of(const Tile *tile, const Gaze *gaze, Lanes t)
{
    return lanes_unit(sky_ways(&tile->scene, gaze, t));
}

static INLINED Lanes sky_times(float t0, float t1, int first, int parts)
{
    return t0 + (t1 - t0) * ((first + 0.5f + LANE_INDEX) / parts);
}

// At least as many parts of the time as texels pass, in sixteens, or one where the camera does not
// turn.
static int sky_parts(const Tile *tile, const Gaze *gaze, float t0, float t1)
{
    Lanes3 way = ways_of(tile, gaze, sky_times(t0, t1, 0, LANES));
    const float *x = &LANE(float, way.x, 0), *y = &LANE(float, way.y, 0);
    const float *z = &LANE(float, way.z, 0);
    float turn = 0.0f; // of all but the first and the last half of a sixteenth
    for (int i = 1; i < LANES; i++)
        turn += length((float3)(x[i] - x[i - 1], y[i] - y[i - 1], z[i] - z[i - 1]));
    if (!(turn > 0.0f)) return 1;
    float texels = 0.5f * turn * (LANES / (LANES - 1.0f)) * tile->scene.maps[0].size[0];
    return LANES * min((int)ceil(texels / LANES), MOST_SKY_PARTS / LANES);
}

// Whether a span is the first of its stack: the others take the same light.
static inline bool leads(global const Span *spans, uint i)
{
#if STACKS()
    return i == 0u || spans[i].t0 != spans[i - 1u].t0;
#else
    return true;
#endif
}

// A time of a line's window, and the spans that stand before the environment.
typedef struct {
    float2 window, times;
    global const Span *spans;
    uint count;
} Opening;

// Light of the window that passes from t0 to t1 and that none of the spans takes.
static float light_left(const Tile *tile, const Opening *o, float t0, float t1)
{
    const Scene *scene = &tile->scene;
    float left = light_until(scene, o->window, t1) - light_until(scene, o->window, t0);
    for (uint i = 0; i < o->count; i++) {
        float from = fmax(t0, o->spans[i].t0), to = fmin(t1, o->spans[i].t1);
        if (leads(o->spans, i) && from < to)
            left -= light_until(scene, o->window, to) - light_until(scene, o->window, from);
    }
    return fmax(left, 0.0f);
}

// Whether sixteen places tell their mean well enough.
static inline bool sky_is_smooth(const Tile *tile, Lanes3 light)
{
#if SHADING_ERROR()
    Lanes most = fabs(lanes_steps(lanes_steps(light.x)));
    most = lanes_max(most, fabs(lanes_steps(lanes_steps(light.y))));
    most = lanes_max(most, fabs(lanes_steps(lanes_steps(light.z))));
    most = LANE_INDEX < LANES - 2.0f ? most : (Lanes)(0.0f);
    return lanes_sum(most) <= 8.0f * tile->scene.numbers.shading_error * (LANES - 2.0f);
#else
    return true;
#endif
}

// Mean of the environment in that many parts of the time without the spans. False, and none, where
// they are too few, unless they must do.
static bool mean_sky(const Tile *tile, const Gaze *gaze, const Opening *opening, int parts,
                     bool must, float3 *mean)
{
    const float2 times = opening->times;
    float3 sum = 0.0f;
    float total = 0.0f, step = (times.y - times.x) / parts;
    for (int first = 0; first < parts; first += LANES) {
        float weight[LANES] = {1.0f};
        for (int i = 0; parts > 1 && i < LANES; i++)
            weight[i] = light_left(tile, opening, times.x + step * (first + i),
                                   times.x + step * (first + i + 1));
        Lanes part = lanes_load(weight);
        if (!(lanes_sum(part) > 0.0f)) continue;
        Lanes3 way = ways_of(tile, gaze, sky_times(times.x, times.y, first, parts));
        Lanes3 light = sky_light(&tile->scene, way, min(LANES, parts));
        if (!must && !sky_is_smooth(tile, light)) return false;
        sum += (float3)(lanes_sum(part * light.x), lanes_sum(part * light.y),
                        lanes_sum(part * light.z));
        total += lanes_sum(part);
    }
    *mean = total > 0.0f ? sum / total : sum;
    return true;
}

static float3 sky_between(const Tile *tile, const Gaze *gaze, const Opening *opening)
{
    float3 mean;
    int parts = sky_parts(tile, gaze, opening->times.x, opening->times.y);
    int most = min(8 * parts, MOST_SKY_PARTS);
    bool alone = parts == 1;
    while (!mean_sky(tile, gaze, opening, parts, alone || parts >= most, &mean)) parts *= 2;
    return mean;
}

// What the environment adds to a sample that its spans leave open: times the openness.
static float4 sky_behind(const Tile *tile, const Viewer *viewer, global const Span *spans,
                         uint count)
{
    float open = 1.0f;
    for (uint i = 0; i < count; i++)
        if (leads(spans, i)) open -= spans[i].weight;
    if (!(open > NO_SKY)) return (float4)(0.0f);
    Gaze gaze = gaze_at(viewer->place, 0u);
    const Opening opening = {viewer->window, viewer->window, spans, count};
    float3 light = sky_between(tile, &gaze, &opening);
    return (float4)(open * light, 0.0f);
}

// Likewise through what lets `open` through between two times, which may be one.
static float4 sky_through(const Tile *tile, const Viewer *viewer, float2 times, float open)
{
    if (!(open > NO_SKY)) return (float4)(0.0f);
    Gaze gaze = gaze_at(viewer->place, 0u);
    const Opening opening = {viewer->window, times, 0, 0u};
    float3 light = sky_between(tile, &gaze, &opening);
    return (float4)(open * light, 0.0f);
}

#endif
