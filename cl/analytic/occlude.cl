// Stage "occlude": what stays visible of each sample's intervals, by bit masks over the shutter
// (Hong & Oh 2017, 3.3, Fig. 7).
//
// Bit i stands for [i / MASK_BITS, (i + 1) / MASK_BITS) and belongs to an interval when its centre
// does. Intervals come front to back; each sees the bits that none before it has taken. Every run of
// such bits is a span.
#include "analytic/tile.h"

#define WORDS (MASK_BITS / 32)

// First bit whose centre is not before t.
static inline int first_bit(float t)
{
    int bit = (int)ceil(t * MASK_BITS - 0.5f);
    return clamp(bit, 0, MASK_BITS);
}

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

// Spans of the visible bits of one interval. False when the pool is full.
static bool append_spans(Tile *tile, Interval interval, uint index, const uint *visible)
{
    int bit = next_bit(visible, 0, true);
    while (bit < MASK_BITS) {
        int end = next_bit(visible, bit, false);
        if (tile->span_count == tile->capacity) return false;
        Span span = {fmax(interval.t0, bit * (1.0f / MASK_BITS)),
                     fmin(interval.t1, end * (1.0f / MASK_BITS)),
                     (end - bit) * (1.0f / MASK_BITS), index};
        tile->spans[tile->span_count++] = span;
        bit = next_bit(visible, end, true);
    }
    return true;
}

static bool occlude_sample(Tile *tile, Run run)
{
    uint taken[WORDS] = {0u};
    for (uint i = 0; i < run.count; i++) {
        Interval interval = tile->sorted[run.start + i];
        int low = first_bit(interval.t0), high = first_bit(interval.t1);
        uint visible[WORDS], any_visible = 0u, all_taken = ~0u;
        for (int k = 0; k < WORDS; k++) {
            visible[k] = bits_between(low - 32 * k, high - 32 * k) & ~taken[k];
            taken[k] |= visible[k];
            any_visible |= visible[k];
            all_taken &= taken[k];
        }
        if (any_visible != 0u && !append_spans(tile, interval, run.start + i, visible)) return false;
        if (all_taken == ~0u) break;
    }
    return true;
}

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
