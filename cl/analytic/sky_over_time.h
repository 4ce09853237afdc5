// The environment where a sample's spans leave it open: its mean over that time, as the camera
// moves.
//
// It is looked up in the middles of equal parts of the time, sixteen of them at first, each weighed
// with the light that no span takes from it. Where patches that are looked up lie further apart than
// they are wide the time is halved, and each half treated alike. The error is 1/24 of the mean
// second difference where light changes smoothly, and no more than 1/8 of its size where it has a
// corner, as quadrature.h has it; where the latter is above `shading_error`, or light that lies next
// to the patches may have been missed, the time is halved as well, down to a share of a patch.
#ifndef MB_SKY_OVER_TIME_H
#define MB_SKY_OVER_TIME_H

#include "shared/effects.h"
#include "analytic/line_window.h"
#include "shared/gaze.h"

#define MOST_SKY_PARTS (LANES << 11)
#define LEAST_SKY_PART (1.0f / 256) // patches
#define NO_SKY 1e-6f // openness below which it is rounding

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

// Sixteen of `count` equal parts of an opening's time, from `first` on.
typedef struct {
    int first, count;
} SkyParts;

static inline float part_edge(const Opening *o, SkyParts p, int i)
{
    return o->times.x + (o->times.y - o->times.x) * ((float)(p.first + i) / p.count);
}

static INLINED Lanes part_middles(const Opening *o, SkyParts p)
{
    return o->times.x + (o->times.y - o->times.x) * ((p.first + 0.5f + LANE_INDEX) / p.count);
}

// Light of the window that passes in each part and that none of the spans takes.
static INLINED Lanes light_left(const Scene *scene, const Opening *o, SkyParts p)
{
    float left[LANES], passed = light_until(scene, o->window, part_edge(o, p, 0));
    for (int i = 0; i < LANES; i++) {
        float until = light_until(scene, o->window, part_edge(o, p, i + 1));
        left[i] = until - passed, passed = until;
    }
    for (uint k = 0; k < o->count; k++) {
        global const Span *span = o->spans + k;
        if (!leads(o->spans, k)) continue;
        for (int i = 0; i < LANES; i++) {
            float from = fmax(part_edge(o, p, i), span->t0);
            float to = fmin(part_edge(o, p, i + 1), span->t1);
            if (from < to)
                left[i] -= light_until(scene, o->window, to) - light_until(scene, o->window, from);
        }
    }
    return lanes_max(lanes_load(left), (Lanes)(0.0f));
}

// Go on after the parts at hand; false at the end of the time.
static inline bool next_parts(SkyParts *p)
{
    p->first += LANES;
    while (p->count > LANES && p->first % (2 * LANES) == 0) p->first /= 2, p->count /= 2;
    return p->first < p->count;
}

static inline void halve_parts(SkyParts *p) { p->first *= 2, p->count *= 2; }

// Whether sixteen parts tell their mean well enough.
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

// Whether parts that are `apart` patches from each other tell of light that is next to their middles
// and not there: of what the box around them has more of than they see. All of it may be one texel.
// Where its light begins within the last half part the mean lacks up to 1/128 of it times that
// distance, and where they pass a corner of it between two middles 1/96 times the square.
static inline bool sky_is_seen(const Tile *tile, const Patches *at, Lanes3 light, float apart)
{
#if SHADING_ERROR()
    const Picture picture = sky_picture(&tile->scene);
    float3 mean, seen = (float3)(lanes_sum(light.x), lanes_sum(light.y), lanes_sum(light.z));
    float patches = box_around(&picture, at, &mean);
    float3 missed = fabs(mean - seen * (1.0f / LANES)) * patches;
    float most = fmax(missed.x, fmax(missed.y, missed.z));
    return most * apart <= 16.0f * LANES * tile->scene.numbers.shading_error;
#else
    return true;
#endif
}

// What the environment is in the parts at hand. False, and none, where these are too long for that:
// they are halved then.
static bool sky_in_parts(const Tile *tile, const Gaze *gaze, const Opening *o, SkyParts *p,
                         Lanes3 *light)
{
    const Scene *scene = &tile->scene;
    Patches at = sky_patches(scene, gaze, part_middles(o, *p));
    float apart = lanes_greatest(patches_apart(scene->panorama, &at));
    if (apart > 1.0f && p->count < MOST_SKY_PARTS) {
        for (; apart > 1.0f && p->count < MOST_SKY_PARTS; apart *= 0.5f) halve_parts(p);
        return false;
    }
    *light = sky_light(scene, &at, LANES);
    bool enough = apart <= LEAST_SKY_PART || p->count >= MOST_SKY_PARTS;
    if (enough || (sky_is_smooth(tile, *light) && sky_is_seen(tile, &at, *light, apart)))
        return true;
    halve_parts(p);
    return false;
}

// Mean of the environment over the opening: of one look-up where the camera does not turn.
static float3 sky_between(const Tile *tile, const Gaze *gaze, const Opening *opening)
{
    const Scene *scene = &tile->scene;
    SkyParts parts = {0, LANES};
    Patches at = sky_patches(scene, gaze, part_middles(opening, parts));
    if (!(lanes_greatest(patches_apart(scene->panorama, &at)) > 0.0f)) {
        Lanes3 light = sky_light(scene, &at, 1);
        return LANE3(light, 0);
    }
    float3 sum = 0.0f;
    float total = 0.0f;
    for (bool more = true; more; more = next_parts(&parts)) {
        Lanes weight = light_left(scene, opening, parts);
        Lanes3 light;
        while (lanes_sum(weight) > 0.0f && !sky_in_parts(tile, gaze, opening, &parts, &light))
            weight = light_left(scene, opening, parts);
        if (!(lanes_sum(weight) > 0.0f)) continue;
        sum += (float3)(lanes_sum(weight * light.x), lanes_sum(weight * light.y),
                        lanes_sum(weight * light.z));
        total += lanes_sum(weight);
    }
    return total > 0.0f ? sum / total : sum;
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
