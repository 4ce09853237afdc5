// Stage "envelope": what is seen of each sample's intervals, exactly: the front envelope in time and
// depth.
//
// An envelope is a list of fronts that follow each other in time. Two envelopes are merged in one
// walk through both; where both have a front, bounds of depth decide, or else the exact order, with
// a cut wherever it changes. Intervals come from near to far and enter a small envelope, equal sizes
// are merged as in a merge sort, so n intervals take O(n log n), and the walk ends when what is
// there closes the whole shutter in front of all that follow.
#include "analytic/depth.h"

#define BATCH 32
#define LEVELS 28

// Append a piece of a front, joined to the one before where it continues it.
static int append_front(global Front *out, int count, Front front, float t0, float t1)
{
    if (!(t0 < t1)) return count;
    if (count > 0 && out[count - 1].path == front.path && out[count - 1].t1 == t0) {
        out[count - 1].t1 = t1;
        return count;
    }
    front.t0 = t0, front.t1 = t1;
    out[count] = front;
    return count + 1;
}

// Append what is in front of two fronts in [t0, t1), where both are.
static int append_nearer(const Tile *tile, float2 place, global Front *out, int count, Front a,
                         Front b, float t0, float t1)
{
    if (a.far < b.near) return append_front(out, count, a, t0, t1);
    if (b.far < a.near) return append_front(out, count, b, t0, t1);
    double times[5];
    bool a_first;
    int changes = compare_depths(tile, a.path, b.path, place.x, place.y, t0, t1, times, &a_first);
    for (int i = 0; i <= changes; i++, a_first = !a_first) {
        float end = i < changes ? (float)times[i] : t1;
        count = append_front(out, count, a_first ? a : b, t0, end);
        t0 = end;
    }
    return count;
}

// Most fronts that merging can make: every two ends and every crossing begin one.
static inline int merged_bound(int a_count, int b_count) { return 7 * (a_count + b_count); }

// Merge two envelopes of the sample at `place`; returns the number of fronts.
static int merge_envelopes(const Tile *tile, float2 place, global const Front *a, int a_count,
                           global const Front *b, int b_count, global Front *out)
{
    int i = 0, k = 0, count = 0;
    float from = -1.0f; // what lies before has been dealt with
    while (i < a_count && k < b_count) {
        Front p = a[i], q = b[k];
        float p0 = fmax(p.t0, from), q0 = fmax(q.t0, from);
        float start = fmin(p0, q0), end;
        if (p0 < q0) {
            end = fmin(p.t1, q0);
            count = append_front(out, count, p, start, end);
        } else if (q0 < p0) {
            end = fmin(q.t1, p0);
            count = append_front(out, count, q, start, end);
        } else {
            end = fmin(p.t1, q.t1);
            count = append_nearer(tile, place, out, count, p, q, start, end);
        }
        from = end;
        i += p.t1 <= from, k += q.t1 <= from;
    }
    for (; i < a_count; i++) count = append_front(out, count, a[i], fmax(a[i].t0, from), a[i].t1);
    for (; k < b_count; k++) count = append_front(out, count, b[k], fmax(b[k].t0, from), b[k].t1);
    return count;
}

// Greatest depth of an envelope that closes the whole shutter, else infinity.
static float closing_depth(global const Front *fronts, int count)
{
    float t = 0.0f, far = 0.0f;
    for (int i = 0; i < count; i++) {
        if (fronts[i].t0 != t) return INFINITY;
        t = fronts[i].t1, far = fmax(far, fronts[i].far);
    }
    return t == 1.0f ? far : INFINITY;
}

// Whether the front lies behind the envelope wherever it is, by bounds of depth alone.
static bool is_hidden(global const Front *fronts, int count, Front front)
{
    float t = front.t0;
    for (int i = 0; i < count && t < front.t1; i++) {
        if (fronts[i].t1 <= t) continue;
        if (fronts[i].t0 > t || fronts[i].far >= front.near) return false;
        t = fronts[i].t1;
    }
    return t >= front.t1;
}

// The envelopes of a sample while it is built: runs of the pool `fronts`, the oldest first.
typedef struct {
    Run runs[LEVELS];
    uint entered[LEVELS]; // intervals in each
    int levels;
} Stack;

// Merge the two newest envelopes. False when the pool is full.
static bool merge_newest(Tile *tile, float2 place, Stack *stack)
{
    Run a = stack->runs[stack->levels - 2], b = stack->runs[stack->levels - 1];
    if ((uint)merged_bound(a.count, b.count) > tile->capacity - a.start) return false;
    int count = merge_envelopes(tile, place, tile->fronts + a.start, a.count,
                                tile->fronts + b.start, b.count, tile->merged);
    for (int i = 0; i < count; i++) tile->fronts[a.start + i] = tile->merged[i];
    stack->levels--;
    stack->runs[stack->levels - 1].count = count;
    stack->entered[stack->levels - 1] += stack->entered[stack->levels];
    return true;
}

// Put one interval into the newest envelope, and merge equals. False when the pool is full.
static bool enter_front(Tile *tile, float2 place, Stack *stack, Front front)
{
    int top = stack->levels - 1;
    if (top < 0 || stack->entered[top] >= BATCH) {
        uint start = top < 0 ? 0u : stack->runs[top].start + stack->runs[top].count;
        if (start == tile->capacity) return false;
        tile->fronts[start] = front;
        stack->runs[++top].start = start;
        stack->runs[top].count = 1, stack->entered[top] = 1;
        stack->levels = top + 1;
        return true;
    }
    Run run = stack->runs[top];
    uint end = run.start + run.count;
    if (end == tile->capacity) return false;
    tile->fronts[end] = front;
    stack->runs[top + 1].start = end, stack->runs[top + 1].count = 1, stack->entered[top + 1] = 1;
    stack->levels++;
    if (!merge_newest(tile, place, stack)) return false;
    while (stack->levels > 1 && stack->entered[stack->levels - 1] >= BATCH
           && stack->entered[stack->levels - 1] >= stack->entered[stack->levels - 2])
        if (!merge_newest(tile, place, stack)) return false;
    return true;
}

static inline Front front_of(const Tile *tile, uint path, float t0, float t1)
{
    global const Shape *shape = tile->scene.shapes + path;
    Front front = {t0, t1, shape->near, shape->far, path};
    return front;
}

static bool envelope_sample(Tile *tile, int sample, float2 place, Stack *stack)
{
    stack->levels = 0;
    float closed = INFINITY;
#ifdef STATIC
    if (tile->static_depth[sample] < INFINITY) {
        Front front = front_of(tile, tile->static_part[sample] >> PART_BITS, 0.0f, 1.0f);
        if (!enter_front(tile, place, stack, front)) return false;
        closed = front.far;
    }
#endif
    for (int node = tile->heads[sample]; node >= 0; node = tile->visits[node].next) {
        Visit visit = tile->visits[node];
        Front front = front_of(tile, visit.path, visit.t0, visit.t1);
        if (front.near > closed) break;
        if (stack->levels > 0
            && is_hidden(tile->fronts, (int)stack->runs[0].count, front))
            continue;
        if (!enter_front(tile, place, stack, front)) return false;
        if (stack->levels == 1)
            closed = fmin(closed, closing_depth(tile->fronts, (int)stack->runs[0].count));
    }
    while (stack->levels > 1)
        if (!merge_newest(tile, place, stack)) return false;
    return true;
}

// Spans of every sample of the piece. False when a pool is full.
static bool envelope(Tile *tile)
{
    Stack stack;
    tile->span_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        Run run = {tile->span_count, 0u};
        int row = i / TILE;
        float2 place = (float2)(sample_x(tile, row / TILE, i % TILE), sample_y(tile, row));
        if (!envelope_sample(tile, i, place, &stack)) return false;
        run.count = stack.levels > 0 ? stack.runs[0].count : 0u;
        if (run.count > tile->capacity - run.start) return false;
        for (uint k = 0; k < run.count; k++) {
            Front front = tile->fronts[k];
            Span span = {front.t0, front.t1, front.t1 - front.t0, front.path};
            tile->spans[run.start + k] = span;
        }
        tile->span_count += run.count;
        tile->span_runs[i] = run;
    }
    return true;
}
