// Stage "envelope": what is seen of each sample's intervals, exactly: the front envelope in time
// and depth.
//
// Intervals come from near to far; those that lie behind what covers their time are left out, and
// all that follow once the whole shutter is covered. The rest are sorted by time and dealt into
// chains, whose members follow each other without overlap; most often a chain is one surface that
// passes, triangle after triangle. A chain is an envelope already. Chains are then merged in pairs,
// as in a merge sort, each time in one walk through both: where both have something to show, bounds
// of depth decide, or else the exact order, with a cut wherever it changes. That takes O(n log n)
// for n intervals.
#include "shared/effects.h"
#include "analytic/depth_curve.h"
#include "analytic/line_window.h"

#define OPEN_CHAINS 16 // chains that may still grow; older ones are complete
#define RANKED 256     // above this, intervals are sorted by merging
#define COVERS 8       // covered stretches of the shutter that are kept in mind

// A growing envelope.
typedef struct {
    global Front *out;
    int count, room;
    bool full;
} Writer;

// Append [t0, t1) of a front, joined to the one before where it continues it.
static void append_front(Writer *w, Front front, float t0, float t1)
{
    if (!(t0 < t1)) return;
    global Front *before = w->out + w->count - 1;
    if (w->count > 0 && before->path == front.path && before->t1 == t0) {
        before->t1 = t1;
        return;
    }
    w->full |= w->count == w->room;
    if (w->full) return;
    front.t0 = t0, front.t1 = t1;
    w->out[w->count++] = front;
}

// Append the nearer of two fronts in [t0, t1), where both are.
static void append_nearer(const Tile *tile, Place place, Writer *w, Front a, Front b, float t0,
                          float t1)
{
    if (a.far < b.near || b.far < a.near) {
        append_front(w, a.far < b.near ? a : b, t0, t1);
        return;
    }
    double times[5];
    bool a_first;
    int changes = compare_depths(tile, a.path, b.path, place, t0, t1, times, &a_first);
    for (int i = 0; i <= changes; i++, a_first = !a_first) {
        float end = i < changes ? (float)times[i] : t1;
        append_front(w, a_first ? a : b, t0, end);
        t0 = end;
    }
}

// Merge two envelopes of the sample at `place`.
static void merge_envelopes(const Tile *tile, Place place, global const Front *a, int a_count,
                            global const Front *b, int b_count, Writer *w)
{
    int i = 0, k = 0;
    float from = -1.0f; // what lies before has been dealt with
    while (i < a_count && k < b_count) {
        Front p = a[i], q = b[k];
        float p0 = fmax(p.t0, from), q0 = fmax(q.t0, from);
        if (p0 < q0) {
            from = fmin(p.t1, q0);
            append_front(w, p, p0, from);
        } else if (q0 < p0) {
            from = fmin(q.t1, p0);
            append_front(w, q, q0, from);
        } else {
            from = fmin(p.t1, q.t1);
            append_nearer(tile, place, w, p, q, p0, from);
        }
        i += p.t1 <= from, k += q.t1 <= from;
    }
    for (; i < a_count; i++) append_front(w, a[i], fmax(a[i].t0, from), a[i].t1);
    for (; k < b_count; k++) append_front(w, b[k], fmax(b[k].t0, from), b[k].t1);
}

// Rank of each key among `count`, ties by place, counted for 16 at a time: the last ones are filled
// up.
static void rank_keys(global float *keys, int count, global int *ranks)
{
    for (int k = count; k % LANES != 0; k++) keys[k] = INFINITY;
    for (int first = 0; first < count; first += LANES) {
        Lanes key = lanes_load(keys + first);
        LaneMask place = to_lane_ints(LANE_INDEX), rank = 0;
        int last = min(first + LANES, count);
        for (int k = 0; k < first; k++) rank -= keys[k] <= key;
        for (int k = first; k < last; k++)
            rank -= (keys[k] < key) | ((keys[k] == key) & (k - first < place));
        for (int k = last; k < count; k++) rank -= keys[k] < key;
        lanes_store(rank, ranks + first);
    }
}

// Order of the keys by merging runs of growing length; `order` and `scratch` hold places.
static global int *merge_sort_keys(global const float *keys, int count, global int *order,
                                   global int *scratch)
{
    for (int i = 0; i < count; i++) order[i] = i;
    for (int size = 1; size < count; size *= 2) {
        for (int start = 0; start < count; start += 2 * size) {
            int i = start, middle = min(start + size, count), k = middle;
            int end = min(start + 2 * size, count);
            for (int n = start; n < end; n++)
                scratch[n] = k >= end || (i < middle && keys[order[i]] <= keys[order[k]])
                                 ? order[i++] : order[k++];
        }
        global int *swapped = order;
        order = scratch, scratch = swapped;
    }
    return order;
}

// Places of the sample's intervals in order of their start. The list's nodes are in `nodes`.
static global int *order_by_start(Tile *tile, int count)
{
    size_t size = tile->capacity + LANES;
    global float *keys = tile->ordering;
    global int *order = (global int *)(keys + size), *scratch = order + size;
    if (count > RANKED) return merge_sort_keys(keys, count, order, scratch);
    rank_keys(keys, count, scratch);
    for (int i = 0; i < count; i++) order[scratch[i]] = i;
    return order;
}

// Stretches of the shutter that are covered, and how deep at most: intervals behind them are
// hidden.
typedef struct {
    float t0[COVERS], t1[COVERS], far[COVERS];
    int count;
} Cover;

static inline bool is_covered(const Cover *c, Front front)
{
    bool covered = false;
    for (int i = 0; i < c->count; i++)
        covered |= c->t0[i] <= front.t0 && front.t1 <= c->t1[i] && c->far[i] < front.near;
    return covered;
}

// Whether all that follows a path in a list, whose interval is covered, is covered too.
static inline bool ends_list(const Tile *tile, const Cover *c, uint path, float2 window)
{
    bool closed = c->t0[0] <= window.x && c->t1[0] >= window.y;
    return closed && c->far[0] < tile->shapes[path].near;
}

// Add an interval: stretches that it touches become one with it.
static void add_cover(Cover *c, Front front)
{
    int kept = 0;
    for (int i = 0; i < c->count; i++) {
        bool apart = c->t1[i] < front.t0 || front.t1 < c->t0[i];
        c->t0[kept] = c->t0[i], c->t1[kept] = c->t1[i], c->far[kept] = c->far[i];
        kept += apart;
        if (apart) continue;
        front.t0 = fmin(front.t0, c->t0[i]), front.t1 = fmax(front.t1, c->t1[i]);
        front.far = fmax(front.far, c->far[i]);
    }
    // Where there is no room the interval is left out, which only hides less.
    if (kept < COVERS) c->t0[kept] = front.t0, c->t1[kept] = front.t1, c->far[kept++] = front.far;
    c->count = kept;
}

// Copy what of the sample's list may be seen into the pool `fronts`, and its starts where they are
// sorted; `cover` gets what that covers. The list runs from near to far: it ends where the whole
// shutter is covered.
static int gather_fronts(Tile *tile, int sample, float2 window, Cover *cover)
{
    int count = 0;
    cover->count = 0;
#if STATIC()
    if (tile->static_depth[sample] < INFINITY) {
        float depth = (float)tile->static_depth[sample];
        Front always = {window.x, window.y, depth * (1.0f - 1e-6f), depth * (1.0f + 1e-6f),
                        tile->static_part[sample] >> PART_BITS};
        tile->fronts[0] = always;
        tile->ordering[count++] = window.x;
        add_cover(cover, tile->fronts[0]);
    }
#endif
    for (int node = tile->heads[sample]; node >= 0; node = tile->visits[node].next) {
        Visit visit = tile->visits[node];
#if STACKS()
        if (visit.path & TRANSLUCENT_BIT) continue;
#endif
        Front front = {visit.t0, visit.t1, visit.near, visit.far, visit.path};
        if (is_covered(cover, front)) {
            if (ends_list(tile, cover, visit.path, window)) break;
            continue;
        }
        if (count == (int)tile->capacity) return -1;
        tile->fronts[count] = front;
        tile->ordering[count++] = visit.t0;
        add_cover(cover, front);
    }
    return count;
}

// Deal the sorted intervals into chains; returns how many. `chain` gets each one's chain.
static int deal_into_chains(const Tile *tile, global const int *order, int count, global int *chain)
{
    float ends[OPEN_CHAINS];
    int chains = 0;
    for (int i = 0; i < count; i++) {
        Front front = tile->fronts[order[i]];
        int oldest = max(chains - OPEN_CHAINS, 0), chosen = -1;
        for (int k = oldest; k < chains; k++) {
            float end = ends[k % OPEN_CHAINS];
            if (end == front.t0) {
                chosen = k;
                break;
            }
            if (end < front.t0 && chosen < 0) chosen = k;
        }
        if (chosen < 0) chosen = chains++;
        ends[chosen % OPEN_CHAINS] = front.t1;
        chain[i] = chosen;
    }
    return chains;
}

// Chains laid one after the other in the pool `merged`; starts[chains] is their end.
static void lay_chains(Tile *tile, global const int *order, int count, global const int *chain,
                       int chains, global int *starts)
{
    for (int k = 0; k <= chains; k++) starts[k] = 0;
    for (int i = 0; i < count; i++) starts[chain[i] + 1]++;
    for (int k = 0; k < chains; k++) starts[k + 1] += starts[k];
    // Filling moves each start to the next one's place; going back undoes it.
    for (int i = 0; i < count; i++) tile->merged[starts[chain[i]]++] = tile->fronts[order[i]];
    for (int k = chains; k > 0; k--) starts[k] = starts[k - 1];
    starts[0] = 0;
}

// Merge neighbouring envelopes of the pool `merged` until one is left, in passes from one pool to
// the other and back. Returns its length, or -1 when a pool is full.
static int merge_chains(Tile *tile, Place place, int chains, global int *starts)
{
    while (chains > 1) {
        Writer w = {tile->fronts, 0, 0, false};
        for (int k = 0; k < chains; k += 2) {
            int a = starts[k], b = starts[k + 1], end = starts[min(k + 2, chains)];
            int begin = (int)(w.out - tile->fronts) + w.count;
            w.out = tile->fronts + begin, w.count = 0, w.room = (int)tile->capacity - begin;
            merge_envelopes(tile, place, tile->merged + a, b - a, tile->merged + b, end - b, &w);
            if (w.full) return -1;
            starts[k / 2] = begin;
        }
        chains = (chains + 1) / 2;
        starts[chains] = (int)(w.out - tile->fronts) + w.count;
        global Front *swapped = tile->fronts;
        tile->fronts = tile->merged, tile->merged = swapped;
    }
    return starts[chains];
}

// The sample's envelope, in the pool `merged`; returns its length, or -1 when a pool is full.
static int envelope_sample(Tile *tile, int sample, Place place, float2 window, Cover *cover)
{
    int count = gather_fronts(tile, sample, window, cover);
    if (count < 2) {
        if (count == 1) tile->merged[0] = tile->fronts[0];
        return count;
    }
    size_t size = tile->capacity + LANES;
    global int *chain = (global int *)tile->ordering + 3 * size, *starts = chain + size;
    global int *order = order_by_start(tile, count);
    int chains = deal_into_chains(tile, order, count, chain);
    lay_chains(tile, order, count, chain, chains, starts);
    return merge_chains(tile, place, chains, starts);
}

// Append the sample's envelope as spans. False when the pool is full.
static bool append_envelope(Tile *tile, int count, float2 window)
{
    if ((uint)count > tile->capacity - tile->span_count) return false;
    for (int k = 0; k < count; k++) {
        Front front = tile->merged[k];
        float before = light_until(&tile->scene, window, front.t0);
        float weight = light_until(&tile->scene, window, front.t1) - before;
        Span span = {front.t0, front.t1, weight, front.path};
        tile->spans[tile->span_count++] = span;
    }
    return true;
}

// Spans of every sample of the piece. False when a pool is full.
static bool envelope(Tile *tile)
{
    tile->span_count = 0;
    Cover cover;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        Place place = place_of(tile, i);
        float2 window = window_of(tile, i);
        int count = envelope_sample(tile, i, place, window, &cover);
        Run run = {tile->span_count, (uint)count};
        if (count < 0 || !append_envelope(tile, count, window)) return false;
        tile->span_runs[i] = run;
    }
    return true;
}
