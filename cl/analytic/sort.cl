// Stage "sort": each sample's intervals in front-to-back order in depth and time
// (Hong & Oh 2017, 3.3).
//
// An interval is a line segment in (time, depth). Segments that cross are split where they cross;
// after that "in front of" has no cycles. Segments are ranked by least depth first, so that the
// search for something in front of one ends at the first that begins behind it (the paper's first
// test); mostly that order is final. Where it is not, segments are taken out one by one, each time
// one that nothing left is in front of.
//
// The paper's third and fourth tests compare one segment's ends with the other's line. For segments
// that do not cross they say which is in front in the middle of their common time, and that is
// what is compared: it holds where two pieces meet and rounding upsets the tests.
#include "shared/effects.h"
#include "analytic/tile_of_rows.h"

// The arrays of one sample: Tile.sorting, where its segments are ranked.
typedef struct {
    global float *near, *far, *t0, *t1, *w0, *slope;
    global int *source, *taken;
} Ranked;

static Ranked ranked_arrays(const Tile *tile)
{
    size_t size = tile->capacity + LANES;
    global float *base = tile->sorting;
    Ranked r = {base, base + size, base + 2 * size, base + 3 * size, base + 4 * size,
                base + 5 * size, (global int *)(base + 6 * size), (global int *)(base + 7 * size)};
    return r;
}

static inline float least_depth(Interval i) { return i.w0 < i.w1 ? i.w0 : i.w1; }

static inline float depth_at(Interval i, float t)
{
    return i.w0 + (i.w1 - i.w0) * ((t - i.t0) / (i.t1 - i.t0));
}

// Rank by least depth, ties by path: later in the list, which paths entered at its head. Counts for
// 16 at a time how many come before each.
static void rank_segments(Ranked r, global const Interval *list, int count)
{
    for (int i = 0; i < count; i++) r.w0[i] = least_depth(list[i]);
    for (int i = count; i % LANES != 0; i++) r.w0[i] = INFINITY; // fill up the last sixteen
    for (int first = 0; first < count; first += LANES) {
        Lanes key = lanes_load(r.w0 + first);
        LaneMask place = first + to_lane_ints(LANE_INDEX), rank = 0;
        for (int k = 0; k < count; k++) {
            Lanes other = r.w0[k];
            rank -= (other < key) | ((other == key) & (k > place));
        }
        lanes_store(rank, r.taken + first);
    }
    for (int i = 0; i < count; i++) {
        Interval interval = list[i];
        int k = r.taken[i];
        r.near[k] = least_depth(interval);
        r.far[k] = interval.w0 < interval.w1 ? interval.w1 : interval.w0;
        r.t0[k] = interval.t0, r.t1[k] = interval.t1;
        r.source[k] = i;
    }
    for (int k = 0; k < count; k++) {
        Interval interval = list[r.source[k]];
        r.w0[k] = interval.w0;
        r.slope[k] = (interval.w1 - interval.w0) / (interval.t1 - interval.t0);
        r.taken[k] = 0;
    }
    for (int k = count; k < count + LANES; k++) r.near[k] = INFINITY, r.t1[k] = -1.0f;
}

// Compare segment i with the 16 from `first` on, in their common time: the first's depth less the
// others' at its start and at its end, and whether there is any.
static INLINED LaneMask compare_segments(Ranked r, int i, int first, Lanes *at_low, Lanes *at_high)
{
    Lanes t0 = lanes_load(r.t0 + first), t1 = lanes_load(r.t1 + first);
    Lanes w0 = lanes_load(r.w0 + first), slope = lanes_load(r.slope + first);
    Lanes low = lanes_max(t0, (Lanes)(r.t0[i])), high = lanes_min(t1, (Lanes)(r.t1[i]));
    *at_low = (r.w0[i] + r.slope[i] * (low - r.t0[i])) - (w0 + slope * (low - t0));
    *at_high = (r.w0[i] + r.slope[i] * (high - r.t0[i])) - (w0 + slope * (high - t0));
    return low < high;
}

// What is wrong with the order by least depth: 1 where a later segment is in front, 2 where two
// cross, by more than rounding at a common end.
static int check_order(Ranked r, int count)
{
    LaneMask wrong = 0;
    for (int i = 0; i + 1 < count; i++)
        for (int k = i + 1; k < count && r.near[k] < r.far[i]; k += LANES) {
            Lanes at_low, at_high;
            LaneMask common = compare_segments(r, i, k, &at_low, &at_high);
            wrong |= common & (at_low + at_high > 0.0f) & 1;
            wrong |= common & (at_low * at_high < 0.0f) & 2;
        }
    return (any_below_zero(wrong << 31) ? 1 : 0) | (any_below_zero(wrong << 30) ? 2 : 0);
}

// Time at which two segments that cross do so; at the ends of their common time where rounding
// puts it there.
static float crossing_time(Interval a, Interval b)
{
    float low = fmax(a.t0, b.t0), high = fmin(a.t1, b.t1);
    float at_low = depth_at(a, low) - depth_at(b, low);
    float at_high = depth_at(a, high) - depth_at(b, high);
    return low + (high - low) * (at_low / (at_low - at_high));
}

// First time after `after` at which segment i crosses another one, or its end.
static float next_crossing(Ranked r, global const Interval *list, int i, int count, float after)
{
    Interval whole = list[r.source[i]];
    float next = whole.t1;
    for (int k = 0; k < count && r.near[k] < r.far[i]; k += LANES) {
        Lanes at_low, at_high;
        LaneMask crosses = compare_segments(r, i, k, &at_low, &at_high);
        crosses &= at_low * at_high < 0.0f;
        if (!any_below_zero(crosses)) continue;
        int lanes[LANES];
        lanes_store(crosses, lanes);
        for (int lane = 0; lane < min(LANES, count - k); lane++) {
            if (!lanes[lane] || k + lane == i) continue;
            // In one order of arguments, so that both segments are cut at the same time.
            Interval a = list[r.source[min(i, k + lane)]], b = list[r.source[max(i, k + lane)]];
            float t = crossing_time(a, b);
            if (t > after && t < next && t > fmax(a.t0, b.t0) && t < fmin(a.t1, b.t1)) next = t;
        }
    }
    return next;
}

// Cut the sample's segments where they cross into pieces, in the pool `sorted` for now.
static bool split_crossings(Tile *tile, Ranked r, global const Interval *list, int count)
{
    for (int i = 0; i < count; i++) {
        Interval whole = list[r.source[i]];
        float from = whole.t0, w_from = whole.w0;
        while (from < whole.t1) {
            float to = next_crossing(r, list, i, count, from);
            float w_to = to == whole.t1 ? whole.w1 : depth_at(whole, to);
            Interval piece = {from, to, w_from, w_to, whole.first, whole.last};
            if (tile->sorted_count == tile->capacity) return false;
            tile->sorted[tile->sorted_count++] = piece;
            from = to, w_from = w_to;
        }
    }
    return true;
}

// The first segment from `start` on, of those not taken, that is in front of segment i, or i.
static int find_in_front(Ranked r, int i, int start, int count)
{
    for (int k = start; k < count && r.near[k] < r.far[i]; k += LANES) {
        Lanes at_low, at_high;
        LaneMask in_front = compare_segments(r, i, k, &at_low, &at_high);
        in_front &= (at_low + at_high > 0.0f) & (lanes_load(r.taken + k) == 0);
        if (!any_below_zero(in_front)) continue;
        int lanes[LANES];
        lanes_store(in_front, lanes);
        for (int lane = 0; lane < min(LANES, count - k); lane++)
            if (lanes[lane] && k + lane != i) return k + lane;
    }
    return i;
}

// Take out, again and again, a segment that no other is in front of. `order` gets their ranks.
static void order_front_to_back(Ranked r, int count, global int *order)
{
    int first = 0;
    for (int done = 0; done < count; done++) {
        while (r.taken[first]) first++;
        int chosen = first;
        // Rounding can make a cycle of pieces that all but touch; then the search ends here.
        for (int tries = done; tries < count; tries++) {
            int in_front = find_in_front(r, chosen, first, count);
            if (in_front == chosen) break;
            chosen = in_front;
        }
        r.taken[chosen] = 1;
        order[done] = chosen;
    }
}

// Sort one sample into the pool `sorted`. False when that is full.
static bool sort_sample(Tile *tile, Run *run)
{
    Ranked r = ranked_arrays(tile);
    global Interval *list = tile->intervals + run->start;
    uint start = tile->sorted_count;
    int count = (int)run->count;
    rank_segments(r, list, count);
#if MAX_INTERVALS()
    if (count > tile->scene.numbers.most_intervals) {
        count = tile->scene.numbers.most_intervals;
        for (int k = count; k < count + LANES; k++) r.near[k] = INFINITY, r.t1[k] = -1.0f;
    }
#endif
    int wrong = check_order(r, count);
    global Interval *from = list;
    if (wrong & 2) {
        if (!split_crossings(tile, r, list, count)) return false;
        count = (int)(tile->sorted_count - start);
        if (2u * count > tile->capacity - start) return false;
        // The pieces move behind the place of their sorted order, last first, as paths are listed.
        from = tile->sorted + start + count;
        for (int i = 0; i < count; i++) from[i] = tile->sorted[start + count - 1 - i];
        rank_segments(r, from, count);
        wrong = check_order(r, count);
    }
    if (tile->capacity - start < (uint)count) return false;
    global int *order = r.taken + tile->capacity + LANES;
    if (wrong & 1) order_front_to_back(r, count, order);
    for (int i = 0; i < count; i++)
        tile->sorted[start + i] = from[r.source[wrong & 1 ? order[i] : i]];
    tile->sorted_count = start + count;
    run->start = start, run->count = count;
    return true;
}

// Sort every sample of the piece from pool `intervals` to pool `sorted`. False when that is full.
static bool sort(Tile *tile)
{
    tile->sorted_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        Run run = tile->runs[i];
        if (!sort_sample(tile, &run)) return false;
        tile->runs[i] = run;
    }
    return true;
}
