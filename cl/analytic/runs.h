// Spans from masks: runs of bits that belong to one interval.
//
// Bit i stands for [i / MASK_BITS, (i + 1) / MASK_BITS) of the shutter's light and belongs to an
// interval when its centre does. With PARTIAL_BITS a run begins and ends where its interval, or its
// neighbour's, does, if that lies within half a bit; neighbours share the place, so nothing counts
// twice.
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

// Share of light at which run `left` ends and run `right` begins, before bit `bit`.
static inline float run_border(int bit, Lit left, Lit right)
{
#if PARTIAL_BITS()
    if (left.owner != FREE && first_bit(left.end) == bit) return left.end;
    if (right.owner != FREE && first_bit(right.start) == bit) return right.start;
#endif
    return bit * BIT;
}

// Spans of a sample whose every bit has an owner or is FREE. False when the pool is full.
static bool append_owned_runs(Tile *tile, int sample, const int *owner)
{
    float2 window = window_of(tile, sample);
    Lit before = lit_by(tile, sample, FREE);
    for (int bit = 0, end; bit < MASK_BITS; bit = end) {
        Lit own = lit_by(tile, sample, owner[bit]);
        for (end = bit + 1; end < MASK_BITS && owner[end] == own.owner;) end++;
        Lit after = lit_by(tile, sample, end < MASK_BITS ? owner[end] : FREE);
        float low = run_border(bit, before, own), high = run_border(end, own, after);
        Owned from = own.interval;
        if (own.owner != FREE
            && !append_light(tile, window, low, high, from.t0, from.t1, from.source))
            return false;
        before = own;
    }
    return true;
}

#endif // bits with owners

#endif
