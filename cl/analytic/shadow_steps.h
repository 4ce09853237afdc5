// The share of a light that passes, step by step, and how what stands in it dims it.
//
// What is translucent lets the share 1 - alpha pass. Where alpha varies it is looked up at times
// along the way, four for each texel of its texture, and is linear between them.
#ifndef MB_SHADOW_STEPS_H
#define MB_SHADOW_STEPS_H

#include "shared/effects.h"
#include "analytic/shadow_functions.h"
#include "analytic/surface_color.h"

// The list of steps at hand, at the end of the pool.
typedef struct {
    global Step *steps;
    uint count, room;
} Steps;

// Index of the step that begins at t, made if there is none; the list has room.
static uint step_at(Steps *list, float t)
{
    uint k = list->count;
    while (list->steps[k - 1].t > t) k--;
    if (list->steps[k - 1].t == t) return k - 1;
    for (uint i = list->count++; i > k; i--) list->steps[i] = list->steps[i - 1];
    list->steps[k].t = t, list->steps[k].passed = list->steps[k - 1].passed;
    return k;
}

// Let the share `passed` of the light pass from t0 to t1. False when the pool is full.
static bool dim(Steps *list, float t0, float t1, float end, float passed)
{
    if (!(t0 < t1)) return true;
    if (list->count + 2 > list->room) return false;
    uint first = step_at(list, t0), last = t1 < end ? step_at(list, t1) : list->count;
    for (uint k = first; k < last; k++) list->steps[k].passed *= passed;
    uint kept = 1;
    for (uint k = 1; k < list->count; k++)
        if (list->steps[k].passed != list->steps[kept - 1].passed)
            list->steps[kept++] = list->steps[k];
    list->count = kept;
    return true;
}

static inline bool is_dark(const Steps *list)
{
    return list->count == 1 && list->steps[0].passed == 0.0f;
}

// A caster that waits, and its functions: those of one lane.
typedef struct {
    uint path;
    double low, high; // times between which the functions are given
    const CasterFunctions *functions;
    int lane;
} Caster;

#if ALPHA_VARIES()

#define MOST_PARTS 128 // of one stretch of time

// A stretch of time in n equal parts.
typedef struct {
    float since, until;
    int n;
} Parts;

static inline float part_start(Parts p, int part)
{
    return part < p.n ? p.since + (p.until - p.since) * part / p.n : p.until;
}

// Weights of a caster's corners where the light passes it when sixteen parts begin, from `first`
// on: by the functions of the edges across from them.
static void caster_weights(const Caster *c, Path path, Parts parts, int first, Weights *weights)
{
    for (int lane = 0; lane < LANES; lane++) {
        double t = part_start(parts, first + lane), e[3], sum = 0.0;
        double along = clamp((t - c->low) / (c->high - c->low), 0.0, 1.0);
        Weight tau = (Weight)((t - path.open) / path_length(path));
        for (int i = 0; i < 3; i++) {
            double b[QUINTIC];
            for (int k = 0; k < QUINTIC; k++)
                b[k] = LANE(double, c->functions->edge[(i + 1) % 3][k], c->lane);
            e[i] = quintic_at(b, along), sum += e[i];
        }
        for (int i = 0; i < 3; i++) {
            Weight share = sum != 0.0 ? (Weight)(e[i] / sum) : (Weight)1.0f / 3.0f;
            LANE(Weight, weights[i], lane) = share * (1.0f - tau);
            LANE(Weight, weights[i + 3], lane) = share * tau;
        }
    }
}

// In how many parts a stretch is looked at: four for each texel that the light passes through.
static int count_parts_of_light(const Tile *tile, const Shaded *s, const Weights *weights)
{
    float texels = 4.0f; // of colours that are linear
#if TEXTURED()
    if (s->material.texture != NONE) {
        Texture texture = tile->scene.textures[s->material.texture];
        Attributes a = blend_corners(s, weights);
        Lanes across = fabs(steps_of_u(&a)) * texture.width;
        Lanes down = fabs(steps_of_v(&a)) * texture.height;
        texels = LANES * lanes_greatest_number(lanes_max(across, down));
    }
#endif
    return (int)clamp(ceil(4.0f * texels), 16.0f, (float)MOST_PARTS);
}

// Dim the list for one part, in which the caster's alpha goes from a to b. Where it is tested it
// passes the cutoff as a line does. False when the pool is full.
static bool dim_part(Steps *list, const Material *m, float since, float until, float a, float b,
                     float end)
{
    if (!(m->flags & MATERIAL_MASK)) return dim(list, since, until, end, 1.0f - 0.5f * (a + b));
    bool before = a >= m->cutoff, after = b >= m->cutoff;
    float change = before == after ? until
                                   : clamp(mix(since, until, (m->cutoff - a) / (b - a)), since,
                                           until);
    return (!before || dim(list, since, change, end, 0.0f))
           && (!after || dim(list, before == after ? until : change, until, end, 0.0f));
}

// Dim the list by a caster whose alpha varies. False when the pool is full.
static bool dim_by_alphas(const Tile *tile, Steps *list, const Caster *c, float since, float until,
                          float end)
{
    Shaded s = load_shaded(&tile->scene, c->path);
    load_corners(&tile->scene, &s);
    Parts parts = {since, until, LANES - 1};
    Weights weights[6];
    caster_weights(c, s.path, parts, 0, weights);
    parts.n = count_parts_of_light(tile, &s, weights);
    for (int first = 0; first < parts.n; first += LANES - 1) {
        caster_weights(c, s.path, parts, first, weights);
        Attributes a = blend_corners(&s, weights);
        Lanes given = untested_alpha(&s, given_alpha(&tile->scene, &s, &a, LANES));
        const float *alpha = &LANE(float, given, 0);
        for (int i = 0; i < min(LANES - 1, parts.n - first); i++)
            if (!dim_part(list, &s.material, part_start(parts, first + i),
                          part_start(parts, first + i + 1), alpha[i], alpha[i + 1], end))
                return false;
    }
    return true;
}

#endif

// Dim the list where the caster stands in the light from `since` to `until`. False when the pool is
// full.
static bool dim_by_stretch(const Tile *tile, Steps *list, const Caster *c, float since, float until,
                           float end)
{
#if STACKS()
    float alpha = tile->scene.paths[c->path].alpha;
#else
    float alpha = 1.0f;
#endif
#if ALPHA_VARIES()
    if (alpha < 0.0f)
        return !(since < until) || dim_by_alphas(tile, list, c, since, until, end);
#endif
    return dim(list, since, until, end, 1.0f - alpha);
}

#endif
