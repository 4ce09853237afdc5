// Stage "occlude": what stays visible of each sample's sorted intervals (Hong & Oh 2017, 3.3, Fig. 7).
//
// Intervals come front to back; each sees what none before it has taken, of the bits of a mask or,
// without MASK_BITS, of the shutter itself. Every run that is left is a span.
#include "analytic/tile.h"

#ifdef MASK_BITS

#include "analytic/runs.h"

#define WORDS (MASK_BITS / 32)

// Bits [low, high) of a 32-bit word.
static inline uint bits_between(int low, int high)
{
    if (high <= 0 || low >= 32) return 0u;
    uint below_high = high >= 32 ? ~0u : (1u << high) - 1u;
    return low <= 0 ? below_high : below_high & ~((1u << low) - 1u);
}

// First bit from `bit` on whose value in `mask` is `value`, or MASK_BITS.
static int next_bit(const uint *mask, int bit, bool value)
{
    while (bit < MASK_BITS) {
        uint word = (value ? mask[bit / 32] : ~mask[bit / 32]) >> bit % 32;
        if (word != 0u) return bit + 31 - clz(word & -word);
        bit = (bit / 32 + 1) * 32;
    }
    return MASK_BITS;
}

// Take what is free of the interval's bits; `visible` gets them. Returns whether there are any.
static inline bool take_bits(uint *taken, Interval interval, uint *visible)
{
    int low = first_bit(interval.t0), high = first_bit(interval.t1);
    uint any_visible = 0u;
    for (int k = 0; k < WORDS; k++) {
        visible[k] = bits_between(low - 32 * k, high - 32 * k) & ~taken[k];
        taken[k] |= visible[k];
        any_visible |= visible[k];
    }
    return any_visible != 0u;
}

static inline bool all_taken(const uint *taken)
{
    uint all = ~0u;
    for (int k = 0; k < WORDS; k++) all &= taken[k];
    return all == ~0u;
}

#ifdef PARTIAL_BITS

// Spans of a sample whose every bit has an owner, an index into `sorted`, or is FREE.
static bool append_owned_runs(Tile *tile, const int *owner)
{
    int before = FREE;
    for (int bit = 0; bit < MASK_BITS;) {
        int own = owner[bit], end = bit + 1;
        while (end < MASK_BITS && owner[end] == own) end++;
        if (own != FREE) {
            Interval i = tile->sorted[own];
            int after = end < MASK_BITS ? owner[end] : FREE;
            float before_end = before == FREE ? 0.0f : tile->sorted[before].t1;
            float after_start = after == FREE ? 0.0f : tile->sorted[after].t0;
            float t0 = run_border(bit, before, before_end, own, i.t0);
            float t1 = run_border(end, own, i.t1, after, after_start);
            Span span = {t0, t1, t1 - t0, (uint)own};
            if (t0 < t1 && !append_span(tile, span)) return false;
        }
        before = own, bit = end;
    }
    return true;
}

static bool occlude_sample(Tile *tile, Run run)
{
    uint taken[WORDS] = {0u}, visible[WORDS];
    int owner[MASK_BITS];
    for (int bit = 0; bit < MASK_BITS; bit++) owner[bit] = FREE;
    for (uint i = 0; i < run.count && !all_taken(taken); i++) {
        if (!take_bits(taken, tile->sorted[run.start + i], visible)) continue;
        for (int bit = next_bit(visible, 0, true); bit < MASK_BITS;
             bit = next_bit(visible, bit + 1, true))
            owner[bit] = (int)(run.start + i);
    }
    return append_owned_runs(tile, owner);
}

#else

// Spans of the visible bits of one interval. False when the pool is full.
static bool append_visible_runs(Tile *tile, Interval interval, uint index, const uint *visible)
{
    int bit = next_bit(visible, 0, true);
    while (bit < MASK_BITS) {
        int end = next_bit(visible, bit, false);
        Span span = {fmax(interval.t0, bit * BIT), fmin(interval.t1, end * BIT), (end - bit) * BIT,
                     index};
        if (!append_span(tile, span)) return false;
        bit = next_bit(visible, end, true);
    }
    return true;
}

static bool occlude_sample(Tile *tile, Run run)
{
    uint taken[WORDS] = {0u}, visible[WORDS];
    for (uint i = 0; i < run.count && !all_taken(taken); i++) {
        Interval interval = tile->sorted[run.start + i];
        if (take_bits(taken, interval, visible)
            && !append_visible_runs(tile, interval, run.start + i, visible))
            return false;
    }
    return true;
}

#endif

#else // no mask: exactly

// Emit the parts of [t0, t1) that no stretch has taken, and take them. Stretches are disjoint, in
// order of time and don't touch; they lie in `begin` and `end`. False when the pool is full.
static bool take_stretch(Tile *tile, global float *begin, global float *end, int *count,
                         Interval interval, uint index)
{
    int first = 0, last; // stretches that the interval touches
    while (first < *count && end[first] < interval.t0) first++;
    float t = interval.t0;
    for (last = first; last < *count && begin[last] <= interval.t1; last++) {
        Span span = {t, begin[last], begin[last] - t, index};
        if (t < begin[last]) {
            if (tile->span_count == tile->capacity) return false;
            tile->spans[tile->span_count++] = span;
        }
        t = fmax(t, end[last]);
    }
    if (t < interval.t1) {
        Span span = {t, interval.t1, interval.t1 - t, index};
        if (tile->span_count == tile->capacity) return false;
        tile->spans[tile->span_count++] = span;
    }
    float joined_begin = first < last ? fmin(begin[first], interval.t0) : interval.t0;
    float joined_end = fmax(t, interval.t1);
    int gone = last - first - 1; // below zero: one more than before
    if (gone < 0) for (int i = *count; i > first; i--) begin[i] = begin[i - 1], end[i] = end[i - 1];
    if (gone > 0)
        for (int i = last; i < *count; i++) begin[i - gone] = begin[i], end[i - gone] = end[i];
    begin[first] = joined_begin, end[first] = joined_end;
    *count -= gone;
    return true;
}

static bool occlude_sample(Tile *tile, Run run)
{
    global float *begin = tile->sorting, *end = begin + tile->capacity + LANES;
    int count = 0;
    for (uint i = 0; i < run.count; i++) {
        if (count == 1 && begin[0] == 0.0f && end[0] == 1.0f) break;
        if (!take_stretch(tile, begin, end, &count, tile->sorted[run.start + i], run.start + i))
            return false;
    }
    return true;
}

#endif

// Spans of every sample of the piece. False when the pool is full.
static bool occlude(Tile *tile)
{
    tile->span_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        Run run = {tile->span_count, 0u};
        if (!occlude_sample(tile, tile->runs[i])) return false;
        run.count = tile->span_count - run.start;
        tile->span_runs[i] = run;
    }
    return true;
}
