// Stage "mask": what is seen of each sample's exact intervals at the centres of a mask's bits.
//
// Bit i belongs to the interval that is nearest at (i + 1/2) / MASK_BITS, by exact depth; of equal
// ones to the path that comes first. Every run of bits of one interval is a span.
#include "analytic/depth.h"
#include "analytic/runs.h"
#include "shared/wide.h"

// 1/w of the curve at eight times.
static inline Wide curve_nearness(const DepthCurve *c, Wide t)
{
    Wide tau = (t - (double)c->open) / (double)c->length, s = 1.0 - tau;
    Wide e = s * (s * c->e[0] + tau * c->e[1]) + tau * (s * c->e[1] + tau * c->e[2]);
    Wide d = s * (s * (s * c->d[0] + tau * (3.0 * c->d[1])) + tau * (tau * (3.0 * c->d[2])))
             + tau * (tau * (tau * c->d[3]));
    return e / d;
}

#define OWNED_BY_STATIC (-2)

// The interval of an owner: a node of the sample's list, or the static surface.
static inline Visit owned_visit(const Tile *tile, int sample, int owner)
{
#ifdef STATIC
    if (owner == OWNED_BY_STATIC) {
        Visit always = {0.0f, 1.0f, tile->static_part[sample] >> PART_BITS, -1};
        return always;
    }
#endif
    return tile->visits[owner];
}

// Give an owner the bits in which it is nearest so far.
static void take_nearest(const Tile *tile, int sample, Place place, int own, double *nearness,
                         int *owner)
{
    Visit visit = owned_visit(tile, sample, own);
    DepthCurve curve = depth_curve(tile, visit.path, place);
    int low = first_bit(visit.t0), high = first_bit(visit.t1);
    for (int bit = low / WIDE * WIDE; bit < high; bit += WIDE) {
        double here[WIDE];
        Wide centre = (convert_double8((int8)(0, 1, 2, 3, 4, 5, 6, 7)) + (bit + 0.5)) * BIT;
        vstore8(curve_nearness(&curve, centre), 0, here);
        for (int i = max(bit, low); i < min(bit + WIDE, high); i++) {
            double n = here[i - bit];
            bool nearer = owner[i] == FREE || n > nearness[i]
                          || (n == nearness[i]
                              && visit.path < owned_visit(tile, sample, owner[i]).path);
            if (nearer) nearness[i] = n, owner[i] = own;
        }
    }
}

// Spans of a sample whose every bit has an owner or is FREE. False when the pool is full.
static bool append_owned_runs(Tile *tile, int sample, const int *owner)
{
    int before = FREE;
    float before_end = 0.0f;
    for (int bit = 0; bit < MASK_BITS;) {
        int own = owner[bit], end = bit + 1;
        while (end < MASK_BITS && owner[end] == own) end++;
        if (own != FREE) {
            Visit visit = owned_visit(tile, sample, own);
            int after = end < MASK_BITS ? owner[end] : FREE;
            float after_start = after == FREE ? 0.0f : owned_visit(tile, sample, after).t0;
            float t0 = run_border(bit, before, before_end, own, visit.t0);
            float t1 = run_border(end, own, visit.t1, after, after_start);
            Span span = {t0, t1, t1 - t0, visit.path};
            if (t0 < t1 && !append_span(tile, span)) return false;
            before_end = visit.t1;
        }
        before = own, bit = end;
    }
    return true;
}

// Spans of every sample of the piece. False when the pool is full.
static bool mask(Tile *tile)
{
    double nearness[MASK_BITS];
    int owner[MASK_BITS];
    tile->span_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        Place place = place_of(tile, i);
        Run run = {tile->span_count, 0u};
        for (int bit = 0; bit < MASK_BITS; bit++) owner[bit] = FREE;
#ifdef STATIC
        if (tile->static_depth[i] < INFINITY)
            take_nearest(tile, i, place, OWNED_BY_STATIC, nearness, owner);
#endif
        for (int node = tile->heads[i]; node >= 0; node = tile->visits[node].next)
            take_nearest(tile, i, place, node, nearness, owner);
        if (!append_owned_runs(tile, i, owner)) return false;
        run.count = tile->span_count - run.start;
        tile->span_runs[i] = run;
    }
    return true;
}
