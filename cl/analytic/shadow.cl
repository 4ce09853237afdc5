// Stage "shadow": when each visible span is lit, by each light that casts shadows, exactly in time.
//
// A light is a camera: stages "paths" and "bin" have listed the paths that may lie in each tile of
// its view, from near to far. What a span's point passes of these tiles has all paths that can
// shade it, and each is solved for when it does (shadow_times.h) and dims the light by its alpha
// (shadow_steps.h). Nothing is tested where no light is reflected: unlit materials, and flat faces
// that turn their other side to the light.
#include "shared/effects.h"
#include "analytic/shadow.h"
#include "analytic/shadow_steps.h"
#include "analytic/shadow_times.h"

// A receiver under one light, and the list of its steps.
typedef struct {
    Receiver receiver;
    uint path;
    ShadowLight light;
    float end;         // of the list
    Steps list;
    Casters casters;   // that wait to be solved
} Shading;

// Leave out the times of [low, high) before it is lit at first and after it is lit at last. False
// if it is dark throughout.
static bool trim_to_lit(const Steps *list, double *low, double *high)
{
    double first = INFINITY, last = -INFINITY;
    for (uint k = 0; k < list->count; k++) {
        if (list->steps[k].passed == 0.0f) continue;
        double t0 = fmax(*low, (double)list->steps[k].t);
        double t1 = k + 1 < list->count ? fmin(*high, (double)list->steps[k + 1].t) : *high;
        if (t0 < t1) first = fmin(first, t0), last = t1;
    }
    *low = first, *high = last;
    return first < last;
}

// Dim the list where the caster stands in the light. False when the pool is full.
static bool dim_by_caster(const Tile *tile, Shading *s, const Caster *c, SignChanges *signs)
{
    float since = (float)c->low;
    for (int k = 0; k <= signs->count; k++) {
        float until = k < signs->count ? (float)(c->low + (c->high - c->low) * signs->time[k])
                                       : (float)c->high;
        if (stands_between(signs->sign)
            && !dim_by_stretch(tile, &s->list, c, since, until, s->end))
            return false;
        if (k < signs->count) signs->sign[signs->function[k]] *= -1;
        since = until;
    }
    return true;
}

// Solve for the casters that wait. False when the pool is full.
NOT_INLINED static bool cast_shadows(const Tile *tile, Shading *s)
{
    Casters *waiting = &s->casters;
    if (waiting->count == 0) return true;
    CasterFunctions functions;
    caster_functions(tile, &s->receiver, &s->light, waiting, &functions);
    for (int lane = 0; lane < waiting->count && !is_dark(&s->list); lane++) {
        if (LANE(long, functions.between, lane) == 0) continue;
        SignChanges signs;
        caster_signs(&functions, lane, &signs);
        Caster caster = {waiting->path[lane], waiting->t0[lane], waiting->t1[lane], &functions,
                         lane};
        if (!dim_by_caster(tile, s, &caster, &signs)) return false;
    }
    waiting->count = 0;
    return true;
}

// Let a path wait to be solved. False when the pool is full.
static bool add_caster(const Tile *tile, Shading *s, uint caster)
{
    global const Path *path = tile->scene.paths + caster;
    double low = fmax(s->receiver.t0, (double)path->open);
    double high = fmin(s->receiver.t1, (double)path->close);
    if (!(low < high) || path->alpha == 0.0f || !trim_to_lit(&s->list, &low, &high)) return true;
    int k = s->casters.count++;
    s->casters.path[k] = caster, s->casters.t0[k] = low, s->casters.t1[k] = high;
    return k + 1 < CASTERS || cast_shadows(tile, s);
}

// Where a view may see the receiver: a box, the tiles that it lies in, and the greatest depth.
typedef struct {
    float left, right, top, bottom;
    int x_low, x_high, y_low, y_high;
    float far;
} Reach;

#define REACH_SLACK 1e-3 // of a tile, more than the rounding

// False if the view never sees it.
static bool reach_of(const LightView *view, const Receiver *r, Reach *reach)
{
    const double *m = view->matrix;
    double e[4], x[4], y[4], w[4], far = -INFINITY;
    quadratic_as_cubic(r->e, e);
    bool left = true, right = true, above = true, below = true, behind = true, before = true;
    for (int k = 0; k < 4; k++) {
        double3 p = (double3)(r->n[0][k], r->n[1][k], r->n[2][k]);
        x[k] = m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3] * e[k];
        y[k] = m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7] * e[k];
        w[k] = m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11] * e[k];
        double depth = m[12] * p.x + m[13] * p.y + m[14] * p.z + m[15] * e[k];
        left &= x[k] < -REACH_SLACK * w[k], right &= x[k] > (view->size + REACH_SLACK) * w[k];
        above &= y[k] < -REACH_SLACK * w[k], below &= y[k] > (view->size + REACH_SLACK) * w[k];
        behind &= w[k] <= 0.0, before &= w[k] > 0.0;
        far = e[k] > 0.0 ? fmax(far, depth / e[k]) : INFINITY;
    }
    if (left || right || above || below || behind) return false;
    double x_low = INFINITY, x_high = -INFINITY, y_low = INFINITY, y_high = -INFINITY;
    for (int k = 0; k < 4; k++) {
        double px = before ? x[k] / w[k] : k * (double)view->size;
        double py = before ? y[k] / w[k] : k * (double)view->size;
        x_low = fmin(x_low, px), x_high = fmax(x_high, px);
        y_low = fmin(y_low, py), y_high = fmax(y_high, py);
    }
    double last = view->size - 1.0;
    reach->left = (float)(x_low - REACH_SLACK), reach->right = (float)(x_high + REACH_SLACK);
    reach->top = (float)(y_low - REACH_SLACK), reach->bottom = (float)(y_high + REACH_SLACK);
    reach->x_low = (int)clamp(floor(x_low - REACH_SLACK), 0.0, last);
    reach->x_high = (int)clamp(floor(x_high + REACH_SLACK), 0.0, last);
    reach->y_low = (int)clamp(floor(y_low - REACH_SLACK), 0.0, last);
    reach->y_high = (int)clamp(floor(y_high + REACH_SLACK), 0.0, last);
    reach->far = (float)far;
    return true;
}

// Whether the box lies outside of the outline.
static inline bool misses(global const Outline *outline, const Reach *reach)
{
    Floats a = doubles_load(outline->a), b = doubles_load(outline->b), c = doubles_load(outline->c);
    Floats side = c + a * (a > 0.0f ? (Floats)(reach->right) : (Floats)(reach->left))
                  + b * (b > 0.0f ? (Floats)(reach->bottom) : (Floats)(reach->top));
    return any_int(side < 0.0f);
}

// Dim the list by the paths of one tile of a view, from near to far. Paths that have been dealt
// with for this list bear its stamp. False when the pool is full.
static bool shade_from_tile(Tile *tile, Shading *s, const LightView *view, uint index,
                            const Reach *reach)
{
    uint begin = tile->shadows.starts[view->starts + index];
    uint end = tile->shadows.starts[view->starts + index + 1];
    for (uint k = begin; k < end && !is_dark(&s->list); k++) {
        uint caster = tile->shadows.members[k];
        global const Outline *outline = tile->shadows.outlines + view->paths + caster;
        if (outline->near > reach->far) break;
        if (tile->shadows.stamps[caster] == tile->shadows.stamp || misses(outline, reach)) continue;
        tile->shadows.stamps[caster] = tile->shadows.stamp;
        if (caster != s->path && !add_caster(tile, s, caster)) return false;
    }
    return true;
}

// Dim the list by all that stands between the light and the receiver.
static bool shade_from_views(Tile *tile, Shading *s)
{
    tile->shadows.stamp++;
    for (uint i = 0; i < s->light.views; i++) {
        LightView view = tile->shadows.views[s->light.view + i];
        Reach reach;
        if (!reach_of(&view, &s->receiver, &reach)) continue;
        for (int y = reach.y_low; y <= reach.y_high; y++)
            for (int x = reach.x_low; x <= reach.x_high && !is_dark(&s->list); x++)
                if (!shade_from_tile(tile, s, &view, (uint)y * view.size + x, &reach))
                    return false;
    }
    return cast_shadows(tile, s);
}

// Whether a flat receiver has the light behind the side that is seen, throughout.
static bool turns_away(const Tile *tile, const Shading *s, bool seen_from_front)
{
    Casters own = {.path = {s->path}, .t0 = {s->receiver.t0}, .t1 = {s->receiver.t1}, .count = 1};
    double3 origin = (double3)(s->light.origin[0], s->light.origin[1], s->light.origin[2]);
    Linear corners[3];
    DoubleMask reversed[3];
    load_casters(tile, &own, origin, corners, reversed);
    Quadratic normals = plane_normals(corners);
    Doubles d[4];
    side_of_light(&s->light, corners, &normals, d);
    return !any_double(seen_from_front ? any_below(d, 4) : any_above(d, 4));
}

// Whether the path's front is what the sample sees from t0 to t1.
static bool front_is_seen(const Tile *tile, uint path, Place place, float t0, float t1)
{
    DepthCurve curve = depth_curve(tile, path, place);
    double tau = (0.5 * ((double)t0 + t1) - curve.open) / curve.length;
    return bernstein_cubic(curve.d, tau) < 0.0;
}

// Make the lists of steps of a span. False when the pool is full.
NOT_INLINED static bool shadow_span(Tile *tile, Place place, global Span *span)
{
    Shading s = {.path = span->source, .end = span->t1};
    Mesh mesh = tile->scene.meshes[tile->scene.paths[s.path].mesh];
    bool lit = tile->scene.materials[mesh.material].flags & MATERIAL_LIT;
    bool solved = lit && span->t0 < span->t1, flat = mesh.normal == NONE, front = false;
    Receiver whole;
    if (solved) {
        whole = receiver_of(tile, s.path, place);
        whole = restrict_receiver(&whole, span->t0, span->t1);
        if (flat) front = front_is_seen(tile, s.path, place, span->t0, span->t1);
#if MIRRORS()
        front ^= mesh.world != 0u; // its vertices run the other way where it is mirrored from
#endif
    }
    span->steps = tile->shadows.step_count;
    for (int k = 0; k < SHADOW_LIGHTS; k++) {
        if (tile->shadows.step_count + 2 > tile->capacity) return false;
        s.list.steps = tile->shadows.steps + tile->shadows.step_count, s.list.count = 1;
        s.list.room = tile->capacity - tile->shadows.step_count - 1;
        s.list.steps[0].t = span->t0, s.list.steps[0].passed = 1.0f;
        s.light = tile->shadows.lights[k], s.receiver = whole, s.casters.count = 0;
        if (solved && !(flat && turns_away(tile, &s, front)) && !shade_from_views(tile, &s))
            return false;
        s.list.steps[s.list.count].t = INFINITY, s.list.steps[s.list.count].passed = 0.0f;
        tile->shadows.step_count += s.list.count + 1;
    }
    return true;
}

#if !MOVING()
// Spans of what does not move: where there is nothing else no stage before this one makes them.
static bool still_span(Tile *tile, int sample)
{
    Run run = {tile->span_count, tile->static_depth[sample] < INFINITY};
    tile->span_runs[sample] = run, tile->met[sample] = run.count;
    if (run.count == 0) return true;
    if (tile->span_count == tile->capacity) return false;
    Span span = {.t0 = 0.0f, .t1 = 1.0f, .weight = 1.0f,
                 .source = tile->static_part[sample] >> PART_BITS};
    tile->spans[tile->span_count++] = span;
    return true;
}
#endif

// Lists of steps of all spans of the piece. False when a pool is full.
static bool shadow(Tile *tile)
{
    tile->shadows.step_count = 0;
#if !MOVING()
    tile->span_count = 0;
#endif
    for (int row = tile->row_low; row < tile->row_high; row++) {
        if (!row_is_rendered(tile, row)) continue;
        for (int column = tile->x_low; column < tile->x_high; column++) {
            int sample = row * TILE + column;
#if !MOVING()
            if (!still_span(tile, sample)) return false;
#endif
            Run run = tile->span_runs[sample];
            Place place = place_of(tile, sample);
            for (uint i = 0; i < run.count; i++)
                if (!shadow_span(tile, place, tile->spans + run.start + i)) return false;
        }
    }
    return true;
}
