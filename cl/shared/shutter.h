// The light that passes the shutter: its curve over time, and the window of a rolling shutter's
// line.
#ifndef MB_SHUTTER_H
#define MB_SHUTTER_H

#include "shared/effects.h"
#include "shared/scene.h"

// Times at which the line of the pixel in column x and row y begins and ceases to be exposed.
static inline float2 line_window(const Scene *scene, int x, int y)
{
#if ROLLING()
#if ROLLING_COLUMNS()
    int line = x;
#else
    int line = y;
#endif
    float open = scene->numbers.roll_start + scene->numbers.roll_step * line;
    return (float2)(open, open + scene->numbers.roll_length);
#else
    return (float2)(0.0f, 1.0f);
#endif
}

#if SHUTTER_CURVE()

// Share of the light that has passed by `t`, in the line's own time, [0, 1]. The curve is linear
// between keys, so the light in between is a trapezoid.
static float passed_through_curve(global const ShutterKey *keys, uint count, float t)
{
    uint k = 1;
    while (k < count - 1u && keys[k].t <= t) k++;
    ShutterKey a = keys[k - 1], b = keys[k];
    float part = (t - a.t) / (b.t - a.t), open = a.open + 0.5f * part * (b.open - a.open);
    float whole = 0.5f * (a.open + b.open);
    return whole > 0.0f ? a.passed + (b.passed - a.passed) * (part * open / whole) : a.passed;
}

// The time by which the share `passed` of the light has passed.
static float time_through_curve(global const ShutterKey *keys, uint count, float passed)
{
    uint k = 1;
    while (k < count - 1u && keys[k].passed <= passed) k++;
    ShutterKey a = keys[k - 1], b = keys[k];
    float share = (passed - a.passed) / (b.passed - a.passed); // of the trapezoid's area
    float c = share * 0.5f * (a.open + b.open), slope = b.open - a.open;
    // slope / 2 part^2 + a.open part = c, in the form that doesn't cancel
    float part = 2.0f * c / (a.open + sqrt(fmax(a.open * a.open + 2.0f * slope * c, 0.0f)));
    return a.t + (b.t - a.t) * clamp(part, 0.0f, 1.0f);
}

#endif

// Share of the light of a line, open in `window`, that has passed by t.
static inline float light_until(const Scene *scene, float2 window, float t)
{
#if ROLLING()
    t = clamp((t - window.x) / (window.y - window.x), 0.0f, 1.0f);
#endif
#if SHUTTER_CURVE()
    t = passed_through_curve(scene->shutter, scene->numbers.shutter_keys, t);
#endif
    return t;
}

// The time by which that share has passed.
static inline float time_of_light(const Scene *scene, float2 window, float passed)
{
#if SHUTTER_CURVE()
    passed = time_through_curve(scene->shutter, scene->numbers.shutter_keys, passed);
#endif
#if ROLLING()
    passed = window.x + (window.y - window.x) * passed;
#endif
    return passed;
}

#endif
