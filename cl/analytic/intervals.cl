// Stage "intervals": the fragments of each path on each sample, paired into time intervals (Hong &
// Oh 2017, 3.3).
//
// Fragments are paired in order of time; the paper pairs them in order of depth, which
// PAIR_BY_DEPTH keeps. An odd number means that the path swept over the eye: the fragment that is
// missing lies at w = 0, at the time when the triangle's plane passes through the eye. It is put in
// before pairing; where there is no such time, rounding made the number odd, and the fragment
// nearest to the eye is left out.
#include "shared/effects.h"
#include "analytic/line_window.h"

#define MAX_FRAGMENTS 16

// The part of the interval in [low, high), its depth interpolated.
static Interval clip_interval(Interval whole, float low, float high)
{
    Interval part = whole;
    float slope = (whole.w1 - whole.w0) / (whole.t1 - whole.t0);
    if (low > whole.t0) part.t0 = low, part.w0 = whole.w0 + slope * (low - whole.t0);
    if (high < whole.t1) part.t1 = high, part.w1 = whole.w0 + slope * (high - whole.t0);
    return part;
}

static bool append_interval(Tile *tile, Interval interval)
{
#if ROLLING()
    interval = clip_interval(interval, tile->window.x, tile->window.y);
#endif
    if (!(interval.t1 > interval.t0)) return true;
    if (tile->interval_count == tile->capacity) return false;
    tile->intervals[tile->interval_count++] = interval;
    return true;
}

// Append what of the interval can be seen: of a single-sided path, the times when it faces us.
static bool append_facing(Tile *tile, Interval interval, uint path_index)
{
#if SINGLE_SIDED()
    Path path = tile->scene.paths[path_index];
    uint material = tile->scene.meshes[path.mesh].material;
    if (tile->scene.materials[material].flags & MATERIAL_SINGLE_SIDED) {
        global const float *facing = tile->shapes[path_index].facing_changes;
        bool front = facing[0] > 0.0f;
        float low = path.open;
        for (int i = 1; i <= 4; i++, front = !front) {
            float turn = i < 4 ? facing[i] : INFINITY;
            float high = turn < 1.0f ? path.open + path_length(path) * turn : path.close;
            if (front && low < interval.t1 && high > interval.t0
                && !append_interval(tile, clip_interval(interval, low, high)))
                return false;
            if (!(turn < 1.0f)) break;
            low = high;
        }
        return true;
    }
#endif
    return append_interval(tile, interval);
}

// Sort by time, or by depth; ties by the other and by part, so that the order is unique.
static void order_fragments(Fragment *list, int count, bool by_depth)
{
    for (int i = 1; i < count; i++) {
        Fragment f = list[i];
        int k = i;
        for (; k > 0; k--) {
            Fragment g = list[k - 1];
            float df = by_depth ? f.w : f.t, dg = by_depth ? g.w : g.t;
            if (!(df < dg || (df == dg && f.part < g.part))) break;
            list[k] = g;
        }
        list[k] = f;
    }
}

// Make the number of fragments even; they are in order of time.
static int complete_fragments(Tile *tile, Fragment *list, int count, uint path_index)
{
    global const float *facing = tile->shapes[path_index].facing_changes;
    Path path = tile->scene.paths[path_index];
    int nearest_fragment = 0;
    float best = INFINITY, eye = 0.0f;
    for (int i = 1; i < 4 && facing[i] < 1.0f; i++)
        for (int k = 0; k < count; k++) {
            float t = path.open + path_length(path) * facing[i];
            if (fabs(list[k].t - t) < best)
                best = fabs(list[k].t - t), eye = t, nearest_fragment = k;
        }
    if (best < INFINITY && count < MAX_FRAGMENTS) {
        Fragment f = {eye, 0.0f, path_index << PART_BITS | PART_EYE, -1};
        list[count] = f;
        order_fragments(list, count + 1, false);
        return count + 1;
    }
    for (int k = 1; k < count; k++)
        if (list[k].w < list[nearest_fragment].w) nearest_fragment = k;
    for (int k = nearest_fragment; k + 1 < count; k++) list[k] = list[k + 1];
    return count - 1;
}

static bool pair_fragments(Tile *tile, Fragment *list, int count, uint path_index)
{
    order_fragments(list, count, false);
    if (count & 1) count = complete_fragments(tile, list, count, path_index);
#if PAIR_BY_DEPTH()
    order_fragments(list, count, true);
#endif
    for (int i = 0; i < count; i += 2) {
        Fragment a = list[i], b = list[i + 1];
        if (b.t < a.t) a = list[i + 1], b = list[i];
        Interval interval = {a.t, b.t, a.w, b.w, a.part, b.part};
        if (!append_facing(tile, interval, path_index)) return false;
    }
    return true;
}

// Intervals of one sample. A path's fragments follow each other in the list, since paths are
// rasterized one after the other.
static bool sample_intervals(Tile *tile, int sample)
{
    Fragment list[MAX_FRAGMENTS];
    for (int node = tile->heads[sample]; node >= 0;) {
        uint path_index = tile->fragments[node].part >> PART_BITS;
        int count = 0;
        for (; node >= 0 && tile->fragments[node].part >> PART_BITS == path_index;
             node = tile->fragments[node].next)
            if (count < MAX_FRAGMENTS) list[count++] = tile->fragments[node];
        if (!pair_fragments(tile, list, count, path_index)) return false;
    }
#if STATIC()
    if (tile->static_depth[sample] < INFINITY) {
        float w = (float)tile->static_depth[sample];
        uint part = tile->static_part[sample];
        Interval interval = {tile->window.x, tile->window.y, w, w, part, part};
        return append_interval(tile, interval);
    }
#endif
    return true;
}

// Intervals of every sample of the piece. False when the pool is full.
static bool intervals(Tile *tile)
{
    tile->interval_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        uint start = tile->interval_count;
        tile->window = window_of(tile, i);
        if (!sample_intervals(tile, i)) return false;
        Run run = {start, tile->interval_count - start};
        tile->runs[i] = run;
        tile->met[i] = run.count;
    }
    return true;
}
