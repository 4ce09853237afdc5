// Spans from masks: runs of bits that belong to one interval.
//
// Bit i stands for [i / MASK_BITS, (i + 1) / MASK_BITS) of the shutter's light and belongs to an
// interval when its centre does. With PARTIAL_BITS a run begins and ends where its interval, or its
// neighbour's, does, if that lies within half a bit; neighbours share the place, so nothing counts
// twice. Intervals that follow each other without a gap are one stretch: what of it lies between a
// run and where nothing is seen is the run's, so that light does not depend on how motion is cut
// into segments, or a surface into triangles, that hold no centre.
#ifndef MB_RUNS_H
#define MB_RUNS_H

#include "shared/effects.h"
#include "analytic/line_window.h"

#define FREE (-1)
#define BIT (1.0f / MASK_BITS)

// First bit whose centre is not before the share `light`.
static inline int first_bit(float light)
{
    int bit = (int)ceil(light * MASK_BITS - 0.5f);
    return clamp(bit, 0, MASK_BITS);
}

static inline bool append_span(Tile *tile, Span span)
{
    if (tile->span_count == tile->capacity) return false;
    tile->spans[tile->span_count++] = span;
    return true;
}

// Append the part of the light from `low` to `high`, within [t0, t1]. False when the pool is full.
static bool append_light(Tile *tile, float2 window, float low, float high, float t0, float t1,
                         uint source)
{
    if (!(low < high)) return true;
    Span span = {clamp(time_of_light(&tile->scene, window, low), t0, t1),
                 clamp(time_of_light(&tile->scene, window, high), t0, t1), high - low, source};
    return append_span(tile, span);
}

#if EXACT() || PARTIAL_BITS()

// The interval that owns a bit: its times, and the source of its spans. Each stage that has a mask
// says what its owners stand for.
typedef struct {
    float t0, t1;
    uint source;
} Owned;

static inline Owned owned_by(const Tile *tile, int sample, int owner);

// An owner's light, from its start to its end; FREE has none.
typedef struct {
    float start, end;
    int owner;
    Owned interval;
} Lit;

static inline Lit lit_by(const Tile *tile, int sample, int owner)
{
    Lit lit = {0.0f, 0.0f, owner, {0.0f, 0.0f, NONE}};
    if (owner == FREE) return lit;
    float2 window = window_of(tile, sample);
    lit.interval = owned_by(tile, sample, owner);
    lit.start = light_until(&tile->scene, window, lit.interval.t0);
    lit.end = light_until(&tile->scene, window, lit.interval.t1);
    return lit;
}

// Shares of light at which the run before bit `bit` ends and the one after it begins.
typedef struct {
    float end, begin;
} Border;

#if PARTIAL_BITS()

// The least and the greatest end of all intervals of the sample that hold or touch t.
static inline float2 touching(const Tile *tile, int sample, float t);

// Where the stretch without a gap that ends, or goes on, at t begins and ends within the window.
static inline float covered_since(const Tile *tile, int sample, float2 window, float t)
{
    for (float next; t > window.x && (next = touching(tile, sample, t).x) < t;) t = next;
    return t;
}

static inline float covered_until(const Tile *tile, int sample, float2 window, float t)
{
    for (float next; t < window.y && (next = touching(tile, sample, t).y) > t;) t = next;
    return t;
}

// The border between runs with what may be a gap between them, or nothing on one side.
static inline Border border_at_gap(const Tile *tile, int sample, Lit left, Lit right)
{
    Border border = {left.end, left.end};
    float2 window = window_of(tile, sample);
    if (left.owner != FREE) {
        float until = covered_until(tile, sample, window, left.interval.t1);
        if (right.owner != FREE && until >= right.interval.t0) return border; // there is none
        border.end = light_until(&tile->scene, window, until);
    }
    if (right.owner != FREE) {
        float since = covered_since(tile, sample, window, right.interval.t0);
        border.begin = light_until(&tile->scene, window, since);
    }
    return border;
}

#endif

static inline Border run_border(const Tile *tile, int sample, int bit, Lit left, Lit right)
{
    Border border = {bit * BIT, bit * BIT};
#if PARTIAL_BITS()
    bool ends = left.owner != FREE && first_bit(left.end) == bit;
    bool begins = right.owner != FREE && first_bit(right.start) == bit;
    if ((ends || left.owner == FREE) && (begins || right.owner == FREE)
        && !(ends && begins && left.end >= right.start))
        return border_at_gap(tile, sample, left, right);
    if (ends) border.end = border.begin = left.end;
    else if (begins) border.end = border.begin = right.start;
#endif
    return border;
}

// Spans of a sample whose every bit has an owner or is FREE. False when the pool is full.
static bool append_owned_runs(Tile *tile, int sample, const int *owner)
{
    float2 window = window_of(tile, sample);
    Lit own = lit_by(tile, sample, owner[0]);
    Border before = run_border(tile, sample, 0, lit_by(tile, sample, FREE), own);
    for (int bit = 0, end; bit < MASK_BITS; bit = end) {
        for (end = bit + 1; end < MASK_BITS && owner[end] == own.owner;) end++;
        Lit next = lit_by(tile, sample, end < MASK_BITS ? owner[end] : FREE);
        Border after = run_border(tile, sample, end, own, next);
        Owned from = own.interval;
        if (own.owner != FREE
            && !append_light(tile, window, before.begin, after.end, from.t0, from.t1, from.source))
            return false;
        own = next, before = after;
    }
    return true;
}

#endif // bits with owners

#endif
