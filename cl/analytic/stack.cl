// Stage "stack", instead of "envelope" where something is translucent: what is seen at once, front
// to back, exactly in time.
//
// The front envelope of what is opaque ends every stack. It and what is translucent are swept
// together in order of time (Bentley & Ottmann 1979, for curves that may cross five times): a list
// of what is there, front to back, changes only where an interval begins or ends, and where two
// neighbours change order, at the exact times of depth_curve.h. From one change that can be seen to
// the next the list gives a stack: one span for each of its layers, all with the same times. It
// ends with what is opaque, or where so little light passes that nothing more can be seen. Each
// change takes time in proportion to what is there.
//
// Mirrors and what is seen in them are translucent here: mirror_walk.h says what of the list is
// seen.
#include "shared/effects.h"
#include "analytic/envelope.cl"
#include "analytic/mirror_walk.h"

// A sample's sweep: what is there now, and what of it is seen.
typedef struct {
    Place place;
    float2 window;
    global float *passed; // share of light that each front lets through, 1 where that varies
    global int *there;    // fronts that are there, front to back
    global float *until;  // when each of them may change order with the next
    int count;
    float now;
    float open;           // since when the stack is what it is
    int seen;             // how much of the list is the stack
    bool ended;           // by something opaque, or for want of light
} Sweep;

// Whether front i is before front k from now on; *until gets the time until which it stays so.
static bool is_before(const Tile *tile, const Sweep *s, int i, int k, float *until)
{
    Front a = tile->fronts[i], b = tile->fronts[k];
    *until = INFINITY;
    if (a.far < b.near || b.far < a.near) return a.far < b.near;
    double times[5];
    bool a_first;
    int changes = compare_depths(tile, a.path, b.path, s->place, s->now, fmin(a.t1, b.t1), times,
                                 &a_first);
    for (int n = 0; n < changes; n++, a_first = !a_first)
        if ((float)times[n] > s->now) { // others round to the past
            *until = (float)times[n];
            break;
        }
    return a_first;
}

// Append the stack, as it has been until now, to the spans. False when the pool is full.
static bool close_stack(Tile *tile, Sweep *s)
{
    if (s->open < s->now && s->seen > 0) {
        if ((uint)s->seen > tile->capacity - tile->span_count) return false;
        float weight = light_until(&tile->scene, s->window, s->now)
                       - light_until(&tile->scene, s->window, s->open);
        uint world = 0u;
        for (int k = 0; k < s->seen; k++) {
            uint path = tile->fronts[s->there[k]].path;
            if (!walk_sees(tile, path, &world)) continue;
            Span span = {s->open, s->now, weight, path};
            tile->spans[tile->span_count++] = span;
        }
    }
    s->open = s->now;
    return true;
}

static void open_stack(const Tile *tile, Sweep *s)
{
    float rest = 1.0f;
    uint world = 0u;
    s->seen = 0, s->ended = false;
    while (s->seen < s->count && !s->ended) {
        int front = s->there[s->seen++];
        if (!walk_sees(tile, tile->fronts[front].path, &world)) continue;
        rest *= s->passed[front];
        s->ended = rest < NO_LIGHT;
    }
}

// Take out what ends now. Neighbours that are new to each other get an order to be settled.
static bool remove_ended(Tile *tile, Sweep *s)
{
    int kept = 0;
    for (int k = 0; k < s->count; k++) {
        int front = s->there[k];
        if (tile->fronts[front].t1 <= s->now) {
            if (k < s->seen && !close_stack(tile, s)) return false;
            if (kept > 0) s->until[kept - 1] = s->now;
            continue;
        }
        s->there[kept] = front, s->until[kept++] = s->until[k];
    }
    s->count = kept;
    return true;
}

static bool insert(Tile *tile, Sweep *s, int front)
{
    int place = 0;
    float until;
    while (place < s->count && is_before(tile, s, s->there[place], front, &until)) place++;
    if ((place < s->seen || !s->ended) && !close_stack(tile, s)) return false;
    for (int k = s->count++; k > place; k--)
        s->there[k] = s->there[k - 1], s->until[k] = s->until[k - 1];
    s->there[place] = front, s->until[place] = s->now;
    if (place > 0) s->until[place - 1] = s->now;
    return true;
}

// Put neighbours in order whose order may change now: each swap undoes one pair's wrong order and
// unsettles the pairs on both sides.
static bool settle(Tile *tile, Sweep *s)
{
    for (int k = 0; k + 1 < s->count;) {
        if (s->until[k] > s->now) {
            k++;
            continue;
        }
        int front = s->there[k], next = s->there[k + 1];
        float until;
        bool in_order = is_before(tile, s, front, next, &until);
        s->until[k] = until;
        if (in_order) continue;
        if (k < s->seen && !close_stack(tile, s)) return false;
        s->there[k] = next, s->there[k + 1] = front;
        s->until[k + 1] = s->now;
        if (k > 0) s->until[--k] = s->now;
    }
    if (s->count > 0) s->until[s->count - 1] = INFINITY;
    return true;
}

// When the list changes next.
static float next_change(const Tile *tile, const Sweep *s, float begin)
{
    for (int k = 0; k < s->count; k++)
        begin = fmin(begin, fmin(tile->fronts[s->there[k]].t1, s->until[k]));
    return begin;
}

// Sweep through `count` fronts of the pool, whose order by their start is given.
static bool sweep(Tile *tile, Sweep *s, global const int *order, int count)
{
    for (int next = 0; next < count || s->count > 0;) {
        s->now = next_change(tile, s, next < count ? tile->fronts[order[next]].t0 : INFINITY);
        if (!remove_ended(tile, s)) return false;
        for (; next < count && tile->fronts[order[next]].t0 <= s->now; next++)
            if (!insert(tile, s, order[next])) return false;
        if (!settle(tile, s)) return false;
        if (s->open == s->now) open_stack(tile, s);
    }
    return true;
}

// Whether `cover` hides something: it does not hide what is seen in a mirror.
static inline bool may_be_covered(const Tile *tile, uint path)
{
#if MIRRORS()
    return mesh_of(&tile->scene, path)->world == 0u;
#else
    return true;
#endif
}

// Copy what is translucent of the sample's list, and not behind `cover`, into the pool `fronts`.
// Returns how many, or -1 when the pool is full.
static int gather_translucent(Tile *tile, int sample, float2 window, const Cover *cover)
{
    int count = 0;
    for (int node = tile->heads[sample]; node >= 0; node = tile->visits[node].next) {
        Visit visit = tile->visits[node];
        if (!(visit.path & TRANSLUCENT_BIT)) continue;
        uint path = visit.path & ~TRANSLUCENT_BIT;
        Front front = {visit.t0, visit.t1, visit.near, visit.far, path};
        if (may_be_covered(tile, path) && is_covered(cover, front)) {
#if !MIRRORS()
            if (ends_list(tile, cover, path, window)) break;
#endif
            continue;
        }
        if (tile->scene.paths[path].alpha == 0.0f) continue;
        if (count == (int)tile->capacity) return -1;
        tile->fronts[count++] = front;
    }
    return count;
}

// What a front of the path lets through; all of it where that varies.
static inline float passed_by(const Tile *tile, uint path)
{
    float alpha = alpha_of_path(tile, path);
    return alpha < 0.0f ? 1.0f : 1.0f - alpha;
}

static bool stack_sample(Tile *tile, int sample)
{
    Sweep s = {.place = place_of(tile, sample), .window = window_of(tile, sample)};
    Cover cover;
    int opaque = envelope_sample(tile, sample, s.place, s.window, &cover);
    if (opaque < 0) return false;
    int translucent = gather_translucent(tile, sample, s.window, &cover);
    if (translucent == 0) return append_envelope(tile, opaque, s.window);
    int count = translucent + opaque;
    if (translucent < 0 || count > (int)tile->capacity) return false;
    for (int k = 0; k < opaque; k++) tile->fronts[translucent + k] = tile->merged[k];
    for (int k = 0; k < count; k++) tile->ordering[k] = tile->fronts[k].t0;
    global int *order = order_by_start(tile, count);
    size_t size = tile->capacity + LANES;
    s.passed = tile->ordering; // the starts have served
    s.there = (global int *)tile->ordering + 3 * size, s.until = tile->ordering + 4 * size;
    for (int k = 0; k < count; k++) s.passed[k] = passed_by(tile, tile->fronts[k].path);
    return sweep(tile, &s, order, count);
}

// Spans of every sample of the piece. False when a pool is full.
static bool stack(Tile *tile)
{
    tile->span_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        Run run = {tile->span_count, 0u};
        if (!stack_sample(tile, i)) return false;
        run.count = tile->span_count - run.start;
        tile->span_runs[i] = run;
    }
    return true;
}
