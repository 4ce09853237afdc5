// Stage "solve": when each motion path covers each sample, solved exactly, into per-pixel linked
// lists.
//
// The samples that a path may cover are gathered eight at a time, whatever rows they lie in. Where
// the ends of an edge function have different signs it has exactly one root, which is the usual
// case and is solved in vectors, or none. All else (two roots in one edge, zeros at an end, paths
// that reach behind the eye) is solved sample by sample from the same coefficients.
//
// Paths come in order of least depth, so lists run from near to far.
#include "shared/effects.h"
#include "analytic/gather.h"
#include "analytic/line_window.h"
#include "shared/bernstein.h"

// The path as its visits name it.
static inline uint visited_path(const Gather *g)
{
#if STACKS()
    bool translucent = g->path.alpha < 1.0f;
#if MIRRORS()
    translucent |= g->mirrors || g->reflected;
#endif
    return g->index | (translucent ? TRANSLUCENT_BIT : 0u);
#else
    return g->index;
#endif
}

// Append what the path covers of the sample.
static inline bool append_visit(Tile *tile, int sample, Visit visit)
{
#if ROLLING()
    float2 window = window_of(tile, sample);
    visit.t0 = fmax(visit.t0, window.x), visit.t1 = fmin(visit.t1, window.y);
#endif
    if (!(visit.t0 < visit.t1)) return true;
    if (tile->visit_count == tile->capacity) return false;
    uint node = tile->visit_count++;
    tile->visits[node] = visit;
    if (tile->heads[sample] < 0) tile->heads[sample] = (int)node;
    else tile->visits[tile->tails[sample]].next = (int)node;
    tile->tails[sample] = (int)node;
    tile->met[sample]++;
    return true;
}

// Times at which a sign of one of four functions changes: the edges and the facing.
typedef struct {
    double time[9];
    int function[9];
    int count;
} Changes;

static void insert_change(Changes *c, double time, int function)
{
    int k = c->count++;
    for (; k > 0 && c->time[k - 1] > time; k--)
        c->time[k] = c->time[k - 1], c->function[k] = c->function[k - 1];
    c->time[k] = time, c->function[k] = function;
}

// Whether samples see the path's front at different times: through points of a lens, or in a glossy
// mirror.
static inline bool faces_by_sample(const Gather *g)
{
#if LENS()
    return true;
#elif GLOSSY()
    return g->shear.any;
#else
    return false;
#endif
}

// Add the times at which the path, as the sample sees it, begins or ceases to face the eye. Returns
// whether its back does so at first.
static bool insert_facing(const Gather *g, const MovingTriangle *m, Place place, Changes *changes)
{
    if (!faces_by_sample(g)) {
        global const float *facing = g->shape->facing_changes;
        for (int k = 1; k < 4 && facing[k] < 1.0f; k++) insert_change(changes, facing[k], 3);
        return facing[0] < 0.0f;
    }
    double d[4], e[3], roots[3];
    depth_of_edges(m, place, d, e);
    int count = bernstein_cubic_roots(d, roots);
    for (int k = 0; k < count; k++) insert_change(changes, roots[k], 3);
    return !(bernstein_cubic_start(d) < 0.0);
}

// A time of the path's motion segment in the shutter's [0, 1]. A segment ends at the bits at which
// the next one begins.
static inline float shutter_time(const Gather *g, double t)
{
    return (float)(g->open + t * g->length);
}

// Solve one sample whatever its case.
static bool solve_any(Tile *tile, const Gather *g, int sample, Place place)
{
    Changes changes = {.count = 0};
    MovingTriangle m = g->triangle;
#if GLOSSY()
    if (g->shear.any) shear_triangle(&g->shear, g->height, place, &m);
#endif
    bool behind = g->shape->flags & SHAPE_BEHIND;
    int positive = 0; // bit i: edge i is above zero; bit 3: the path's back faces the eye
    int back = behind ? 15 : 7; // before the eye the edges say which side faces it
    for (int i = 0; i < 3; i++) {
        double b[3], roots[2];
        bool negative;
        perturbed_edge_function(&m, i, place, b);
        if (b[0] == 0.0 && b[1] == 0.0 && b[2] == 0.0) return true; // two vertices are one
        int count = bernstein_quadratic_roots(b[0], b[1], b[2], &negative, roots);
        for (int k = 0; k < count; k++) insert_change(&changes, roots[k], i);
        positive |= !negative << i;
    }
    if (behind) positive |= insert_facing(g, &m, place, &changes) << 3;
    double low = 0.0;
    for (int k = 0; k <= changes.count; k++) {
        double high = k < changes.count ? changes.time[k] : 1.0;
        bool covered = positive == 0 || (positive == back && !g->single_sided);
        Visit visit = {shutter_time(g, low), shutter_time(g, high), g->shape->near,
                       g->shape->far, visited_path(g), -1};
        if (covered && !append_visit(tile, sample, visit)) return false;
        if (k < changes.count) positive ^= 1 << changes.function[k];
        low = high;
    }
    return true;
}

// Times that the edges so far allow: [low, high) for the front, all below zero, and the back.
typedef struct {
    Doubles front_low, front_high, back_low, back_high;
} Ranges;

// Cut the ranges by an edge function. Returns the lanes for which this can't be done: those with a
// zero at an end or with two roots.
static INLINED DoubleMask cut_ranges(Ranges *r, Doubles b0, Doubles b1, Doubles b2)
{
    DoubleMask below = b0 < 0.0, changes = below ^ (b2 < 0.0);
    Doubles sign = below ? (Doubles)(-1.0) : (Doubles)(1.0);
    Doubles s0 = sign * b0, s1 = sign * b1, s2 = sign * b2;
    Doubles discriminant = s1 * s1 - s0 * s2;
    Doubles root = sqrt(changes ? discriminant : (Doubles)(1.0));
    Doubles before = s1 >= 0.0 ? s1 + root : s0, after = s1 >= 0.0 ? -s2 : root - s1;
    Doubles time = changes ? before / (before + after) : (Doubles)(1.0);
    r->front_low = doubles_max(r->front_low, below ? (Doubles)(0.0) : time);
    r->front_high = doubles_min(r->front_high, below ? time : (Doubles)(1.0));
    r->back_low = doubles_max(r->back_low, below ? time : (Doubles)(0.0));
    r->back_high = doubles_min(r->back_high, below ? (Doubles)(1.0) : time);
    DoubleMask two = ~changes & (s1 < 0.0) & (discriminant >= -1e-9 * (s1 * s1));
    return (b0 == 0.0) | (b2 == 0.0) | two;
}

// When the path covers each of the samples at hand: t0 < t1 where it does.
typedef struct {
    float t0[DOUBLES], t1[DOUBLES], near[DOUBLES], far[DOUBLES];
} Covered;

// What is covered in [low, high) of the motion segment, with the depths of the vertices then: what
// lies between them is no nearer and no farther. Slack, for times are rounded to float32.
static INLINED void store_covered(const Gather *g, Doubles low, Doubles high, Covered *covered)
{
    Doubles near = INFINITY, far = 0.0, before = low - g->slack, after = high + g->slack;
    for (int i = 0; i < 3; i++) {
#if GLOSSY()
        Doubles w = gathered_w(g, i), speed = gathered_w(g, i + 3) - w;
#else
        double w = g->w[i], speed = g->speed[i];
#endif
        Doubles start = w + before * speed, end = w + after * speed;
        near = doubles_min(near, doubles_min(start, end));
        far = doubles_max(far, doubles_max(start, end));
    }
    doubles_store(to_floats(g->open + low * g->length), covered->t0);
    doubles_store(to_floats(g->open + high * g->length), covered->t1);
    doubles_store(to_floats(doubles_max(near, 0.0)) * (1.0f - 1e-6f), covered->near);
    doubles_store(to_floats(far) * (1.0f + 1e-6f), covered->far);
}

static inline bool append_covered(Tile *tile, const Gather *g, const Covered *c, int i)
{
    Visit visit = {c->t0[i], c->t1[i], c->near[i], c->far[i], visited_path(g), -1};
    return append_visit(tile, g->samples[i], visit);
}

// Solve the samples at hand. False when the pool is full.
static bool solve_gathered(Tile *tile, const Gather *g)
{
    const MovingTriangle *m = &g->triangle;
    Doubles px[6], py[6], b[3][3];
    for (int i = 0; i < 6; i++) px[i] = gathered_x(g, i), py[i] = gathered_y(g, i);
    DoubleMask front_lost = 0, back_lost = g->single_sided ? (DoubleMask)(-1) : (DoubleMask)(0);
    for (int i = 0; i < 3; i++) {
        int p = edge_first(m, i), q = edge_second(m, i), r = p + 3, t = q + 3;
        double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
        b[i][0] = sign * fma(px[p], py[q], -(px[q] * py[p]));
        b[i][1] = sign * (0.5 * (fma(px[p], py[t], -(px[t] * py[p]))
                                 + fma(px[r], py[q], -(px[q] * py[r]))));
        b[i][2] = sign * fma(px[r], py[t], -(px[t] * py[r]));
        front_lost |= (b[i][0] > 0.0) & (b[i][1] > 0.0) & (b[i][2] > 0.0);
        back_lost |= (b[i][0] < 0.0) & (b[i][1] < 0.0) & (b[i][2] < 0.0);
    }
    tile->tests += g->waiting;
    count_tested(tile, g);
    if (!any_double(~(front_lost & back_lost))) return true;
    uint visits_before = tile->visit_count;
    Ranges ranges = {0.0, 1.0, 0.0, 1.0};
    DoubleMask hard = g->shape->flags & SHAPE_BEHIND ? (DoubleMask)(-1) : (DoubleMask)(0);
    for (int i = 0; i < 3; i++) hard |= cut_ranges(&ranges, b[i][0], b[i][1], b[i][2]);
    hard &= ~(front_lost & back_lost);
    long is_hard[DOUBLES];
    doubles_store(hard, is_hard);
    Covered front, back;
    store_covered(g, ranges.front_low, ranges.front_high, &front);
    if (!g->single_sided) store_covered(g, ranges.back_low, ranges.back_high, &back);
    for (int i = 0; i < g->waiting; i++) {
        bool done = is_hard[i] ? solve_any(tile, g, g->samples[i], gathered_place(g, i))
                               : append_covered(tile, g, &front, i)
                                     && (g->single_sided || append_covered(tile, g, &back, i));
        if (!done) return false;
    }
    tile->hits += min((uint)g->waiting, tile->visit_count - visits_before);
    return true;
}

// Fill the piece's lists. False when the pool is full.
static bool solve(Tile *tile)
{
    tile->visit_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        tile->heads[i] = -1;
        tile->met[i] = 0u;
#if STATIC()
        tile->met[i] += tile->static_depth[i] < INFINITY;
#endif
    }
    Gather g;
    clear_gather(&g);
    for (uint k = tile->static_count; k < tile->member_count; k++) {
        fetch_ahead(tile, k);
        begin_gather(tile, tile->members[k], &g);
        while (gather_samples(tile, &g))
            if (!solve_gathered(tile, &g)) return false;
    }
    return true;
}
