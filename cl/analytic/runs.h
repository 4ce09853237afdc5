// Spans from masks: runs of bits that belong to one interval.
//
// Bit i stands for [i / MASK_BITS, (i + 1) / MASK_BITS) of the shutter and belongs to an interval when
// its centre does. With PARTIAL_BITS a run begins and ends where its interval, or its neighbour's,
// does, if that lies within half a bit; neighbours share the place, so nothing counts twice.
#ifndef MB_RUNS_H
#define MB_RUNS_H

#include "analytic/tile.h"

#define FREE (-1)
#define BIT (1.0f / MASK_BITS)

// First bit whose centre is not before t.
static inline int first_bit(float t)
{
    int bit = (int)ceil(t * MASK_BITS - 0.5f);
    return clamp(bit, 0, MASK_BITS);
}

// Time at which run `left` (an interval or FREE) ends and run `right` begins, before bit `bit`.
static inline float run_border(int bit, int left, float left_end, int right, float right_start)
{
    float border = bit * BIT;
#ifdef PARTIAL_BITS
    if (left != FREE && first_bit(left_end) == bit) return left_end;
    if (right != FREE && first_bit(right_start) == bit) return right_start;
#endif
    return border;
}

static inline bool append_span(Tile *tile, Span span)
{
    if (tile->span_count == tile->capacity) return false;
    tile->spans[tile->span_count++] = span;
    return true;
}

#endif
