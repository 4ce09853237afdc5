// The light that reaches a span from each light that casts shadows: a list of steps over its time.
//
// A step says from when on which share of the light passes; the last is followed by one at
// infinity. Lists of the lights follow each other.
#ifndef MB_SHADOW_H
#define MB_SHADOW_H

#include "analytic/quadrature.h"

// Average share of the light that passes from t0 to t1, weighted as the shutter is.
static float share_between(const Tile *tile, global const Step *steps, float2 window, float t0,
                           float t1)
{
    while (steps[1].t <= t0) steps++;
    if (steps[1].t >= t1 || !(t0 < t1)) return steps[0].passed;
    float before = light_until(&tile->scene, window, t0), sum = 0.0f, total = 0.0f;
    for (; steps[0].t < t1; steps++) {
        float until = light_until(&tile->scene, window, fmin(steps[1].t, t1));
        sum += (until - before) * steps[0].passed;
        total += until - before;
        before = until;
    }
    return total > 0.0f ? sum / total : 0.0f;
}

// Shares that reach the part of a span around each place, from each light.
static void light_along(const Tile *tile, float2 window, Span span, Instants places, Lanes *lit)
{
    global const Step *steps = tile->shadows.steps + span.steps;
    float size = (span.t1 - span.t0) / places.n;
    for (int light = 0; light < SHADOW_LIGHTS; light++) {
        float share[LANES];
        bool steady = steps[1].t == INFINITY;
        for (int i = 0; i < LANES; i++) {
            int part = places.first + min(i, places.count - 1);
            share[i] = steady ? steps[0].passed
                              : share_between(tile, steps, window, span.t0 + size * part,
                                              span.t0 + size * (part + 1));
        }
        lit[light] = lanes_load(share);
        while (steps->t < INFINITY) steps++;
        steps++;
    }
}

#endif
