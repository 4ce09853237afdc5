// Spans from masks: runs of bits that belong to one interval.
//
// Bit i stands for [i / MASK_BITS, (i + 1) / MASK_BITS) of the shutter's light and belongs to an interval
// when its centre does. With PARTIAL_BITS a run begins and ends where its interval, or its
// neighbour's, does, if that lies within half a bit; neighbours share the place, so nothing counts
// twice.
#ifndef MB_RUNS_H
#define MB_RUNS_H

#include "analytic/shutter.h"

#define FREE (-1)
#define BIT (1.0f / MASK_BITS)

// First bit whose centre is not before the share `light`.
static inline int first_bit(float light)
{
    int bit = (int)ceil(light * MASK_BITS - 0.5f);
    return clamp(bit, 0, MASK_BITS);
}

// The light of an interval, from its start to its end, and who it is; FREE for none.
typedef struct {
    float start, end;
    int owner;
} Lit;

// Share of light at which run `left` ends and run `right` begins, before bit `bit`.
static inline float run_border(int bit, Lit left, Lit right)
{
#ifdef PARTIAL_BITS
    if (left.owner != FREE && first_bit(left.end) == bit) return left.end;
    if (right.owner != FREE && first_bit(right.start) == bit) return right.start;
#endif
    return bit * BIT;
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

#endif
