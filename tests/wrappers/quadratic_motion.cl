// A prototype for tests/reports/quadratic_motion.py alone: stage "solve" for vertices that move
// along parabolas, so that edge functions have degree four, beside the same for chords.
//
// Both solve eight samples in vectors, where each edge has one root or none, and all else one by
// one. Gathering, bounds of depth, and zeros throughout, which are alike in both, are left out.
#include "analytic/solve.cl"
#include "shared/quintic.h"

#pragma OPENCL FP_CONTRACT OFF

#define MOST_TURNS 15
#define SMALL 1e-6 // a step of Newton's: the next one would be about as small as its square
#define LEFT_OUT 0 // in `met`, above the number of intervals: the signs of coefficients decided
#define IN_VECTORS 16
#define ONE_BY_ONE 32

// What is known of a pair of a path and a sample.
typedef struct {
    global const float4 *seen; // x, y, and the times at which its line opens and closes
    global int *met;
    global float *covered;
    float4 path;               // opens, closes, is single-sided
    uint skip;                 // what would be solved one by one, to see what that takes
} Pairs;

static void list_interval(const Pairs *p, uint pair, float low, float high)
{
    float length = p->path.y - p->path.x;
    float t0 = fmax(p->path.x + low * length, p->seen[pair].z);
    float t1 = fmin(p->path.x + high * length, p->seen[pair].w);
    if (t0 < t1) p->met[pair]++, p->covered[pair] += t1 - t0;
}

static INLINED Doubles cross_lanes(Doubles px, Doubles py, Doubles qx, Doubles qy)
{
    return fma(px, qy, -(qx * py));
}

#define CROSS(i, k) cross_lanes(x[3 * (i) + p], y[3 * (i) + p], x[3 * (k) + q], y[3 * (k) + q])

// Coefficients of an edge function; vertex v has its control point k at 3 k + v.
static INLINED void edge_lanes(const Doubles *x, const Doubles *y, int p, int q, int degree,
                               Doubles *b)
{
    if (degree == 2) {
        b[0] = CROSS(0, 0), b[1] = 0.5 * (CROSS(0, 1) + CROSS(1, 0)), b[2] = CROSS(1, 1);
        return;
    }
    b[0] = CROSS(0, 0), b[1] = 0.5 * (CROSS(0, 1) + CROSS(1, 0));
    b[2] = (CROSS(0, 2) + 4.0 * CROSS(1, 1) + CROSS(2, 0)) * (1.0 / 6.0);
    b[3] = 0.5 * (CROSS(1, 2) + CROSS(2, 1)), b[4] = CROSS(2, 2);
}

// Roots of quartics that are above zero at 0 and, in the lanes wanted, have one: Newton's method,
// bracketed.
static INLINED Doubles quartic_only_roots(const Doubles *s, DoubleMask wanted)
{
    Doubles low = 0.0, high = 1.0, t = wanted ? s[0] / (s[0] - s[4]) : (Doubles)(0.5);
    for (int step = 0; step < 60 && any_double(wanted); step++) {
        Doubles c[5] = {s[0], s[1], s[2], s[3], s[4]};
        for (int k = 4; k > 1; k--)
            for (int i = 0; i < k; i++) c[i] = fma(t, c[i + 1] - c[i], c[i]);
        Doubles slope = c[1] - c[0], value = fma(t, slope, c[0]);
        low = value > 0.0 ? t : low, high = value > 0.0 ? high : t;
        Doubles next = t - value / (4.0 * slope);
        DoubleMask inside = (next >= low - SMALL) & (next <= high + SMALL);
        next = inside ? next : 0.5 * (low + high);
        wanted &= fabs(next - t) > SMALL;
        t = next;
    }
    return t;
}

// Lanes in which both halves of a quartic have coefficients above zero alone.
static INLINED DoubleMask quartic_stays(const Doubles *s)
{
    Doubles c[5] = {s[0], s[1], s[2], s[3], s[4]};
    DoubleMask stays = -1;
    for (int k = 4; k > 0; k--) {
        for (int i = 0; i < k; i++) c[i] = 0.5 * (c[i] + c[i + 1]);
        stays &= (c[0] > 0.0) & (c[k - 1] > 0.0);
    }
    return stays;
}

// As cut_ranges, for degree four.
static INLINED DoubleMask cut_by_quartic(Ranges *r, const Doubles *b, DoubleMask alive)
{
    DoubleMask below = b[0] < 0.0, changes = below ^ (b[4] < 0.0);
    Doubles sign = below ? (Doubles)(-1.0) : (Doubles)(1.0), s[5];
    for (int i = 0; i < 5; i++) s[i] = sign * b[i];
    DoubleMask n1 = s[1] < 0.0, n2 = s[2] < 0.0, n3 = s[3] < 0.0;
    DoubleMask three = changes & ((n1 & ~n2) | (n2 & ~n3)), two = ~changes & (n1 | n2 | n3);
    if (any_double(two & alive)) two &= ~quartic_stays(s);
    Doubles root = quartic_only_roots(s, changes & ~three & alive);
    Doubles time = changes ? root : (Doubles)(1.0);
    r->front_low = doubles_max(r->front_low, below ? (Doubles)(0.0) : time);
    r->front_high = doubles_min(r->front_high, below ? time : (Doubles)(1.0));
    r->back_low = doubles_max(r->back_low, below ? time : (Doubles)(0.0));
    r->back_high = doubles_min(r->back_high, below ? (Doubles)(1.0) : time);
    return (b[0] == 0.0) | (b[4] == 0.0) | three | two;
}

// Roots of a quartic, raised to the degree that quintic.h has.
static int quartic_roots(const double *b, bool *negative, double *roots)
{
    double raised[QUINTIC], start = 0.0;
    for (int i = 4; i >= 0; i--) start = b[i] != 0.0 ? b[i] : start;
    *negative = start < 0.0;
    raised[0] = b[0], raised[5] = b[4];
    for (int i = 1; i < 5; i++) raised[i] = 0.2 * (i * b[i - 1] + (5 - i) * b[i]);
    return quintic_roots(raised, roots);
}

static void solve_one(const Pairs *p, uint pair, const Doubles b[3][5], int lane, int degree)
{
    double time[MOST_TURNS + 1], roots[5], low = 0.0;
    int edge[MOST_TURNS], turns = 0, positive = 0;
    for (int i = 0; i < 3; i++) {
        double one[5];
        bool negative;
        for (int k = 0; k <= degree; k++) one[k] = LANE(const double, b[i][k], lane);
        int count = degree == 2
                        ? bernstein_quadratic_roots(one[0], one[1], one[2], &negative, roots)
                        : quartic_roots(one, &negative, roots);
        positive |= !negative << i;
        for (int n = 0; n < count; n++) {
            int k = turns++;
            for (; k > 0 && time[k - 1] > roots[n]; k--)
                time[k] = time[k - 1], edge[k] = edge[k - 1];
            time[k] = roots[n], edge[k] = i;
        }
    }
    time[turns] = 1.0;
    for (int k = 0; k <= turns; low = time[k++]) {
        if (positive == 0 || (positive == 7 && p->path.z == 0.0f))
            list_interval(p, pair, (float)low, (float)time[k]);
        if (k < turns) positive ^= 1 << edge[k];
    }
}

static void list_ranges(const Pairs *p, uint pair, int count, const Ranges *r,
                        const DoubleMask *alive, const DoubleMask *hard, const Doubles b[3][5],
                        int degree)
{
    for (int i = 0; i < count; i++) {
        bool lives = LANE(const long, *alive, i), alone = lives && LANE(const long, *hard, i);
        p->met[pair + i] = alone ? ONE_BY_ONE : lives ? IN_VECTORS : LEFT_OUT;
        p->covered[pair + i] = 0.0f;
        if (alone && !p->skip) solve_one(p, pair + i, b, i, degree);
        if (!lives || alone) continue;
        list_interval(p, pair + i, (float)LANE(const double, r->front_low, i),
                      (float)LANE(const double, r->front_high, i));
        if (p->path.z == 0.0f)
            list_interval(p, pair + i, (float)LANE(const double, r->back_low, i),
                          (float)LANE(const double, r->back_high, i));
    }
}

// `count` pairs from `pair` on, at most DOUBLES, of a path with control points (x, y, w).
static INLINED void solve_lanes(const Pairs *p, uint pair, int count, global const double *points,
                                int degree)
{
    Doubles x[9], y[9], b[3][5], at_x = 0.0, at_y = 0.0;
    for (int i = 0; i < count; i++) {
        LANE(double, at_x, i) = p->seen[pair + i].x;
        LANE(double, at_y, i) = p->seen[pair + i].y;
    }
    for (int i = 0; i < 3 * (degree / 2 + 1); i++) {
        x[i] = fma(-at_x, points[3 * i + 2], points[3 * i]);
        y[i] = fma(-at_y, points[3 * i + 2], points[3 * i + 1]);
    }
    DoubleMask front_lost = 0, back_lost = p->path.z != 0.0f ? (DoubleMask)(-1) : (DoubleMask)(0);
    for (int i = 0; i < 3; i++) {
        edge_lanes(x, y, (i + 1) % 3, (i + 2) % 3, degree, b[i]);
        DoubleMask above = -1, below = -1;
        for (int k = 0; k <= degree; k++) above &= b[i][k] > 0.0, below &= b[i][k] < 0.0;
        front_lost |= above, back_lost |= below;
    }
    DoubleMask alive = ~(front_lost & back_lost) & (DOUBLE_INDEX(DoubleMask) < count), hard = 0;
    Ranges ranges = {0.0, 1.0, 0.0, 1.0};
    if (any_double(alive))
        for (int i = 0; i < 3; i++)
            hard |= degree == 2 ? cut_ranges(&ranges, b[i][0], b[i][1], b[i][2])
                                : cut_by_quartic(&ranges, b[i], alive);
    list_ranges(p, pair, count, &ranges, &alive, &hard, b, degree);
}

// Runs are (path, first pair, number of pairs): one path on the samples of one tile.
#define SOLVE_RUNS(name, degree) \
    kernel void name(global const double *points, global const float4 *paths, \
                     global const uint4 *runs, uint count, global const float4 *seen, \
                     uint skip, global int *met, global float *covered) \
    { \
        for (uint i = 0; i < count; i++) { \
            uint4 run = runs[i]; \
            Pairs p = {seen, met, covered, paths[run.x], skip}; \
            global const double *own = points + run.x * (9u * (degree / 2 + 1)); \
            for (uint k = 0; k < run.z; k += DOUBLES) \
                solve_lanes(&p, run.y + k, (int)min(run.z - k, (uint)DOUBLES), own, degree); \
        } \
    }

SOLVE_RUNS(solve_degree_2, 2)
SOLVE_RUNS(solve_degree_4, 4)
