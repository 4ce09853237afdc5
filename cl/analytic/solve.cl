// Stage "solve": when each motion path covers each sample, solved exactly, into per-pixel linked lists.
//
// The samples that a path may cover are gathered eight at a time, whatever rows they lie in. Where
// the ends of an edge function have different signs it has exactly one root, which is the usual case
// and is solved in vectors, or none. All else (two roots in one edge, zeros at an end, paths that
// reach behind the eye) is solved sample by sample from the same coefficients.
//
// Paths come in order of least depth, so lists run from near to far.
#include "analytic/walk.h"
#include "analytic/edges.h"
#include "shared/bernstein.h"
#include "shared/wide.h"

// A path on the tile: its triangle, and the samples that wait to be solved.
typedef struct {
    MovingTriangle triangle;
    Path path;
    uint index;
    bool behind;          // reaches behind the eye
    bool single_sided;
    global const float *facing;
    int waiting;
    int samples[WIDE];
    float x[WIDE], y[WIDE];
} Solver;

static bool append_visit(Tile *tile, const Solver *s, int sample, double low, double high)
{
    Visit visit = {(float)(s->path.open + s->path.length * low),
                   (float)(s->path.open + s->path.length * high), s->index, -1};
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

// Solve one sample whatever its case.
static bool solve_any(Tile *tile, const Solver *s, int sample, double x, double y)
{
    Changes changes = {.count = 0};
    int positive = 0; // bit i: edge i is above zero; bit 3: the path's back faces the eye
    for (int i = 0; i < 3; i++) {
        double b[3], roots[2];
        bool negative;
        edge_function(&s->triangle, i, x, y, b);
        for (int along_x = 1; along_x >= 0 && b[0] == 0.0 && b[1] == 0.0 && b[2] == 0.0; along_x--)
            edge_derivative(&s->triangle, i, x, y, along_x, b);
        int count = bernstein_quadratic_roots(b[0], b[1], b[2], &negative, roots);
        for (int k = 0; k < count; k++) insert_change(&changes, roots[k], i);
        positive |= !negative << i;
    }
    for (int k = 1; k < 4 && s->facing[k] < 1.0f; k++) insert_change(&changes, s->facing[k], 3);
    positive |= (s->facing[0] < 0.0f) << 3;
    double low = 0.0;
    for (int k = 0; k <= changes.count; k++) {
        double high = k < changes.count ? changes.time[k] : 1.0;
        bool covered = positive == 0 || (positive == 15 && !s->single_sided);
        if (covered && low < high && !append_visit(tile, s, sample, low, high)) return false;
        if (k < changes.count) positive ^= 1 << changes.function[k];
        low = high;
    }
    return true;
}

// Times that the edges so far allow: [low, high) for the front, all below zero, and the back.
typedef struct {
    Wide front_low, front_high, back_low, back_high;
} Ranges;

// Cut the ranges by an edge function. Returns the lanes for which this can't be done: those with a
// zero at an end or with two roots.
static inline WideMask cut_ranges(Ranges *r, Wide b0, Wide b1, Wide b2)
{
    WideMask below = b0 < 0.0, changes = below ^ (b2 < 0.0);
    Wide sign = below ? (Wide)(-1.0) : (Wide)(1.0);
    Wide s0 = sign * b0, s1 = sign * b1, s2 = sign * b2;
    Wide discriminant = s1 * s1 - s0 * s2;
    Wide root = sqrt(changes ? discriminant : (Wide)(1.0));
    Wide before = s1 >= 0.0 ? s1 + root : s0, after = s1 >= 0.0 ? -s2 : root - s1;
    Wide time = changes ? before / (before + after) : (Wide)(1.0);
    r->front_low = wide_max(r->front_low, below ? (Wide)(0.0) : time);
    r->front_high = wide_min(r->front_high, below ? time : (Wide)(1.0));
    r->back_low = wide_max(r->back_low, below ? time : (Wide)(0.0));
    r->back_high = wide_min(r->back_high, below ? (Wide)(1.0) : time);
    WideMask two = ~changes & (s1 < 0.0) & (discriminant >= -1e-9 * (s1 * s1));
    return (b0 == 0.0) | (b2 == 0.0) | two;
}

// Solve the samples that wait. False when the pool is full.
static bool solve_waiting(Tile *tile, Solver *s)
{
    const MovingTriangle *m = &s->triangle;
    Wide x = convert_double8(vload8(0, s->x)), y = convert_double8(vload8(0, s->y));
    Wide px[6], py[6], b[3][3];
    for (int i = 0; i < 6; i++) {
        px[i] = fma(-x, (Wide)(m->w[i]), (Wide)(m->x[i]));
        py[i] = fma(-y, (Wide)(m->w[i]), (Wide)(m->y[i]));
    }
    WideMask front_lost = 0, back_lost = s->single_sided ? (WideMask)(-1) : (WideMask)(0);
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
    int waiting = s->waiting;
    s->waiting = 0;
    tile->tests += waiting;
    uint visits_before = tile->visit_count;
    if (all(front_lost & back_lost)) return true;
    Ranges ranges = {0.0, 1.0, 0.0, 1.0};
    WideMask hard = s->behind ? (WideMask)(-1) : (WideMask)(0);
    for (int i = 0; i < 3; i++) hard |= cut_ranges(&ranges, b[i][0], b[i][1], b[i][2]);
    hard &= ~(front_lost & back_lost);
    long is_hard[WIDE];
    double front_low[WIDE], front_high[WIDE], back_low[WIDE], back_high[WIDE];
    vstore8(hard, 0, is_hard);
    vstore8(ranges.front_low, 0, front_low), vstore8(ranges.front_high, 0, front_high);
    vstore8(ranges.back_low, 0, back_low), vstore8(ranges.back_high, 0, back_high);
    for (int i = 0; i < waiting; i++) {
        bool done = true;
        if (is_hard[i]) {
            done = solve_any(tile, s, s->samples[i], s->x[i], s->y[i]);
        } else {
            if (front_low[i] < front_high[i])
                done = append_visit(tile, s, s->samples[i], front_low[i], front_high[i]);
            if (done && !s->single_sided && back_low[i] < back_high[i])
                done = append_visit(tile, s, s->samples[i], back_low[i], back_high[i]);
        }
        if (!done) return false;
    }
    tile->hits += min((uint)waiting, tile->visit_count - visits_before);
    return true;
}

// Gather the samples of one row; solve whenever enough wait.
static bool gather_row(Tile *tile, Solver *s, int row, int first, int last, float near)
{
    float y = sample_y(tile, row);
    for (int column = first; column <= last; column++) {
        int sample = row * TILE + column;
#ifdef STATIC
        if (near > tile->static_depth[sample]) continue;
#endif
        s->samples[s->waiting] = sample;
        s->x[s->waiting] = sample_x(tile, row / TILE, column);
        s->y[s->waiting] = y;
        if (++s->waiting == WIDE && !solve_waiting(tile, s)) return false;
    }
    return true;
}

static bool solve_path(Tile *tile, Solver *s, global const Shape *shape)
{
    int first[LANES], last[LANES];
    for (int row = 0; row < ROWS; row += min(LANES, TILE)) {
        if (row + LANES <= tile->row_low || row >= tile->row_high) continue;
        if (!walk_rows(tile, shape, row, first, last)) continue;
        for (int i = 0; i < min(LANES, TILE - row % TILE); i++)
            if (first[i] <= last[i]
                && !gather_row(tile, s, row + i, first[i], last[i], shape->near))
                return false;
    }
    return s->waiting == 0 || solve_waiting(tile, s);
}

// Fill the piece's lists. False when the pool is full.
static bool solve(Tile *tile)
{
    tile->visit_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        tile->heads[i] = -1;
        tile->met[i] = 0u;
#ifdef STATIC
        tile->met[i] += tile->static_depth[i] < INFINITY;
#endif
    }
    Solver s;
    for (int i = 0; i < WIDE; i++) s.x[i] = s.y[i] = 0.0f;
    for (uint k = tile->static_count; k < tile->member_count; k++) {
        uint index = tile->members[k];
        global const Shape *shape = tile->scene.shapes + index;
        s.path = tile->scene.paths[index];
        s.index = index, s.waiting = 0;
        s.behind = shape->flags & SHAPE_BEHIND;
        s.facing = shape->facing;
        s.single_sided = false;
#ifdef SINGLE_SIDED
        uint material = tile->scene.meshes[s.path.mesh].material;
        s.single_sided = tile->scene.materials[material].flags & MATERIAL_SINGLE_SIDED;
#endif
        load_moving(tile->scene.vertices, s.path, shape->flags, &s.triangle);
        if (!solve_path(tile, &s, shape)) return false;
    }
    return true;
}
