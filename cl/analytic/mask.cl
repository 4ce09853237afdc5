// Stage "mask": what is seen of each sample's exact intervals at the centres of a mask's bits.
//
// Bit i belongs to the interval that is nearest at (i + 1/2) / MASK_BITS, by exact depth; of equal
// ones to the path that comes first. Every run of bits of one interval is a span.
#include "shared/effects.h"
#include "analytic/depth_curve.h"
#include "analytic/runs.h"
#include "shared/lanes.h"

// 1/w of the curve at eight times.
static INLINED Doubles curve_nearness(const DepthCurve *c, Doubles t)
{
    Doubles tau = (t - (double)c->open) / (double)c->length, s = 1.0 - tau;
    Doubles e = s * (s * c->e[0] + tau * c->e[1]) + tau * (s * c->e[1] + tau * c->e[2]);
    Doubles d = s * (s * (s * c->d[0] + tau * (3.0 * c->d[1])) + tau * (tau * (3.0 * c->d[2])))
             + tau * (tau * (tau * c->d[3]));
    return e / d;
}

#define OWNED_BY_STATIC (-2)

// Owners are nodes of the sample's list, or the static surface.
static inline Owned owned_by(const Tile *tile, int sample, int owner)
{
#if STATIC()
    if (owner == OWNED_BY_STATIC) {
        float2 window = window_of(tile, sample);
        Owned always = {window.x, window.y, tile->static_part[sample] >> PART_BITS};
        return always;
    }
#endif
    Visit visit = tile->visits[owner];
    Owned owned = {visit.t0, visit.t1, visit.path};
    return owned;
}

#if PARTIAL_BITS()
static inline float2 touching(const Tile *tile, int sample, float t)
{
    float2 ends = t;
#if STATIC()
    if (tile->static_depth[sample] < INFINITY) ends = window_of(tile, sample);
#endif
    for (int node = tile->heads[sample]; node >= 0; node = tile->visits[node].next) {
        Visit visit = tile->visits[node];
        if (visit.t0 <= t && visit.t1 >= t)
            ends = (float2)(fmin(ends.x, visit.t0), fmax(ends.y, visit.t1));
    }
    return ends;
}
#endif

// Give an owner the bits in which it is nearest so far.
static void take_nearest(const Tile *tile, int sample, const float *centres, int own,
                         double *nearness, int *owner)
{
    Lit lit = lit_by(tile, sample, own);
    uint path = lit.interval.source;
    DepthCurve curve = depth_curve(tile, path, place_of(tile, sample));
    int low = first_bit(lit.start), high = first_bit(lit.end);
    for (int bit = low / DOUBLES * DOUBLES; bit < high; bit += DOUBLES) {
        double here[DOUBLES];
        doubles_store(curve_nearness(&curve, to_doubles(doubles_load(centres + bit))), here);
        for (int i = max(bit, low); i < min(bit + DOUBLES, high); i++) {
            double n = here[i - bit];
            bool nearer = owner[i] == FREE || n > nearness[i]
                          || (n == nearness[i]
                              && path < owned_by(tile, sample, owner[i]).source);
            if (nearer) nearness[i] = n, owner[i] = own;
        }
    }
}

// Spans of every sample of the piece. False when the pool is full.
static bool mask(Tile *tile)
{
    double nearness[MASK_BITS];
    float centres[MASK_BITS];
    int owner[MASK_BITS];
    tile->span_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        Run run = {tile->span_count, 0u};
        float2 window = window_of(tile, i);
        for (int bit = 0; bit < MASK_BITS; bit++) {
            owner[bit] = FREE;
            centres[bit] = time_of_light(&tile->scene, window, (bit + 0.5f) * BIT);
        }
#if STATIC()
        if (tile->static_depth[i] < INFINITY)
            take_nearest(tile, i, centres, OWNED_BY_STATIC, nearness, owner);
#endif
        for (int node = tile->heads[i]; node >= 0; node = tile->visits[node].next)
            take_nearest(tile, i, centres, node, nearness, owner);
        if (!append_owned_runs(tile, i, owner)) return false;
        run.count = tile->span_count - run.start;
        tile->span_runs[i] = run;
    }
    return true;
}
