// Stage "occlude": what stays visible of each sample's sorted intervals (Hong & Oh 2017, 3.3,
// Figure 7).
//
// Intervals come front to back; each sees what none before it has taken, of the bits of a mask or,
// without MASK_BITS, of the shutter itself. Every run that is left is a span.
#include "shared/effects.h"
#include "analytic/line_window.h"

#if BIT_MASK()

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
static inline bool take_bits(const Tile *tile, float2 window, uint *taken, Interval interval,
                             uint *visible)
{
    int low = first_bit(light_until(&tile->scene, window, interval.t0));
    int high = first_bit(light_until(&tile->scene, window, interval.t1));
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

#if PARTIAL_BITS()

// Owners are indices into `sorted`.
static inline Owned owned_by(const Tile *tile, int sample, int owner)
{
    Interval interval = tile->sorted[owner];
    Owned owned = {interval.t0, interval.t1, (uint)owner};
    return owned;
}

// Rounding parts times of fragments that are the same, as where motion segments follow each other.
#define ROUNDED 0x1p-22f

static inline float2 touching(const Tile *tile, int sample, float t)
{
    Run run = tile->runs[sample];
    float2 ends = t;
    for (uint i = run.start; i < run.start + run.count; i++) {
        Interval interval = tile->sorted[i];
        if (interval.t0 <= t + ROUNDED && interval.t1 >= t - ROUNDED)
            ends = (float2)(fmin(ends.x, interval.t0), fmax(ends.y, interval.t1));
    }
    return ends;
}

static bool occlude_sample(Tile *tile, int sample)
{
    Run run = tile->runs[sample];
    float2 window = window_of(tile, sample);
    uint taken[WORDS] = {0u}, visible[WORDS];
    int owner[MASK_BITS];
    for (int bit = 0; bit < MASK_BITS; bit++) owner[bit] = FREE;
    for (uint i = 0; i < run.count && !all_taken(taken); i++) {
        if (!take_bits(tile, window, taken, tile->sorted[run.start + i], visible)) continue;
        for (int bit = next_bit(visible, 0, true); bit < MASK_BITS;
             bit = next_bit(visible, bit + 1, true))
            owner[bit] = (int)(run.start + i);
    }
    return append_owned_runs(tile, sample, owner);
}

#else

// Spans of the visible bits of one interval. False when the pool is full.
static bool append_visible_runs(Tile *tile, float2 window, Interval interval, uint index,
                                const uint *visible)
{
    int bit = next_bit(visible, 0, true);
    while (bit < MASK_BITS) {
        int end = next_bit(visible, bit, false);
        if (!append_light(tile, window, bit * BIT, end * BIT, interval.t0, interval.t1, index))
            return false;
        bit = next_bit(visible, end, true);
    }
    return true;
}

static bool occlude_sample(Tile *tile, int sample)
{
    Run run = tile->runs[sample];
    float2 window = window_of(tile, sample);
    uint taken[WORDS] = {0u}, visible[WORDS];
    for (uint i = 0; i < run.count && !all_taken(taken); i++) {
        Interval interval = tile->sorted[run.start + i];
        if (take_bits(tile, window, taken, interval, visible)
            && !append_visible_runs(tile, window, interval, run.start + i, visible))
            return false;
    }
    return true;
}

#endif

#else // no mask: exactly

static bool append_stretch(Tile *tile, float2 window, float t0, float t1, uint index)
{
    if (!(t0 < t1)) return true;
    if (tile->span_count == tile->capacity) return false;
    float weight = light_until(&tile->scene, window, t1) - light_until(&tile->scene, window, t0);
    Span span = {t0, t1, weight, index};
    tile->spans[tile->span_count++] = span;
    return true;
}

// Emit the parts of the interval that no stretch has taken, and take them. Stretches are disjoint,
// in order of time and don't touch; they lie in `begin` and `end`. False when the pool is full.
static bool take_stretch(Tile *tile, float2 window, global float *begin, global float *end,
                         int *count, Interval interval, uint index)
{
    int first = 0, last; // stretches that the interval touches
    while (first < *count && end[first] < interval.t0) first++;
    float t = interval.t0;
    for (last = first; last < *count && begin[last] <= interval.t1; last++) {
        if (!append_stretch(tile, window, t, begin[last], index)) return false;
        t = fmax(t, end[last]);
    }
    if (!append_stretch(tile, window, t, interval.t1, index)) return false;
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

static bool occlude_sample(Tile *tile, int sample)
{
    Run run = tile->runs[sample];
    float2 window = window_of(tile, sample);
    global float *begin = tile->sorting, *end = begin + tile->capacity + LANES;
    int count = 0;
    for (uint i = 0; i < run.count; i++) {
        if (count == 1 && begin[0] <= window.x && end[0] >= window.y) break;
        if (!take_stretch(tile, window, begin, end, &count, tile->sorted[run.start + i],
                          run.start + i))
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
        if (!occlude_sample(tile, i)) return false;
        run.count = tile->span_count - run.start;
        tile->span_runs[i] = run;
    }
    return true;
}
