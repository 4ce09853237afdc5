// Stacks of spans, blended front to back: each layer adds its colour times its alpha times what the
// layers before it let through.
//
// Where alpha is constant over every layer of a stack that is exact, whatever its colours do. Where
// it varies, all layers are evaluated at the same times, since what one lets through depends on
// when.
#ifndef MB_BLEND_H
#define MB_BLEND_H

#include "shared/effects.h"
#include "analytic/mirror_walk.h"
#include "analytic/line_window.h"

// Spans of the same times, front to back, and the time of them that is asked for.
typedef struct {
    global const Span *spans;
    uint count;
    float2 times;
} Stack;

// Average over a stack's time: colour premultiplied with alpha, and depth times alpha.
typedef struct {
    float4 color;
    float depth;
} Blended;

// Number of spans of the first stack among `count` of a sample.
static inline uint stack_size(global const Span *spans, uint count)
{
    uint size = 1;
    while (size < count && spans[size].t0 == spans[0].t0) size++;
    return size;
}

// What each layer of a stack adds, for stage "record".
static inline void clear_added(const Tile *tile, uint count)
{
#if RECORDED()
    for (uint k = 0; k < count; k++) tile->added[k] = (float4)(0.0f);
#endif
}

static inline void keep_added(const Tile *tile, uint layer, float4 color)
{
#if RECORDED()
    tile->added[layer] += color;
#endif
}

static inline void scale_added(const Tile *tile, uint count, float by)
{
#if RECORDED()
    for (uint k = 0; k < count; k++) tile->added[k] = by * tile->added[k];
#endif
}

static inline float alpha_of(const Tile *tile, Span span)
{
    return alpha_of_path(tile, span.source);
}

static inline float middle_depth(const Tile *tile, Span span, Place place)
{
    return span_depth(tile, span, place, 0.5f * (span.t0 + span.t1));
}

#if MIRRORS()

// What the mirror shows where nothing else is, from times.x to times.y: the environment, or the
// background of the sample's pixel.
static float4 mirrored_behind(const Tile *tile, const Viewer *viewer, Span mirror, float2 times)
{
#if SKY()
    Gaze gaze = gaze_at(viewer->place, mesh_of(&tile->scene, mirror.source)->mirror);
    const Opening opening = {viewer->window, times, 0, 0u};
    return (float4)(sky_between(tile, &gaze, &opening), 1.0f);
#else
    const Frame *frame = &tile->frame;
#if BACKGROUND_IMAGE()
    int x = tile->x + viewer->sample % TILE - frame->x;
    int y = tile->y + viewer->sample / TILE % TILE - frame->y;
    return (float4)(vload3((size_t)y * frame->width + x, tile->background), 1.0f);
#else
    return (float4)(frame->background[0], frame->background[1], frame->background[2], 1.0f);
#endif
#endif
}

#if ALPHA_VARIES()
// Likewise at places of a stack's time.
static Colors mirrored_along(const Tile *tile, const Viewer *viewer, Span mirror, Span stretch,
                             Instants places)
{
#if SKY()
    Gaze gaze = gaze_at(viewer->place, mesh_of(&tile->scene, mirror.source)->mirror);
    Patches at = sky_patches(&tile->scene, &gaze, times_of(stretch, places));
    Lanes3 light = sky_light(&tile->scene, &at, places.count);
    Colors behind = {light.x, light.y, light.z};
#else
    float4 same = mirrored_behind(tile, viewer, mirror, (float2)(stretch.t0, stretch.t1));
    Colors behind = {same.x, same.y, same.z};
#endif
    return behind;
}
#endif

#endif

#if ALPHA_VARIES()

static bool alpha_varies(const Tile *tile, global const Span *spans, uint count)
{
    bool found = false;
    for (uint i = 0; i < count && !found; i++) found = alpha_of(tile, spans[i]) < 0.0f;
    return found;
}

// Colours of a layer at places of a stack's time. False, and none, where that would not tell
// enough.
static bool layer_colors(const Tile *tile, const Viewer *viewer, Span span, Instants places,
                         Colors *colors)
{
    Shaded s = load_shaded(&tile->scene, span.source);
    const float *base = s.path.color;
    float4 flat = (float4)(base[0], base[1], base[2], s.path.alpha);
#if STILL()
    if (span.source < tile->scene.numbers.static_paths) flat = tile->still[viewer->sample];
    else
#endif
    if (varies_on_surface(&s)) {
        s.place = viewer->place, s.window = viewer->window;
        load_attributes(tile, &s);
        Varying v = prepare_varying(tile, &s, span);
        float level = span_level(tile, &s, &v, span, places.n);
        return colors_along(tile, &s, &v, span, level, places, colors);
    }
    Colors same = {flat.x, flat.y, flat.z, flat.w};
    *colors = same;
    return true;
}

// Places of a stretch of time, and the light that passes at each.
typedef struct {
    Span stretch;
    Instants places;
    Lanes light;
} Moments;

// What the layers add at these moments of a stack's time: sums over them, of each layer for stage
// "record" if they are to be kept. False where that would not be exact enough.
static bool blend_places(const Tile *tile, const Viewer *viewer, const Stack *stack,
                         const Moments *moments, bool keep, Blended *sum)
{
    global const Span *spans = stack->spans;
    const uint count = stack->count;
    const Span stretch = moments->stretch;
    const Instants places = moments->places;
    const Lanes light = moments->light;
    Lanes rest = 1.0f;
    const float given = lanes_sum(light);
    float left = given;
    uint mirror = mirror_among(tile, spans, count);
    Colors all = {0.0f, 0.0f, 0.0f, 0.0f};
    sum->depth = 0.0f;
    for (uint i = 0; i < count && left > NO_LIGHT * given; i++) {
        Span span = spans[i];
        span.t0 = stretch.t0, span.t1 = stretch.t1;
        Colors here;
        if (!layer_colors(tile, viewer, span, places, &here)) return false;
        if (i == mirror) here.alpha = alpha_of(tile, span);
        Lanes part = rest * here.alpha;
        Colors added = {part * here.x, part * here.y, part * here.z, part};
        all.x += added.x, all.y += added.y, all.z += added.z, all.alpha += part;
        if (keep) keep_added(tile, i, weighted_sum(&added, light));
        span.source = spans[min(i, mirror)].source;
        sum->depth += lanes_sum(light * part) * middle_depth(tile, span, viewer->place);
        rest -= part;
        left = lanes_sum(light * rest);
    }
#if MIRRORS()
    if (mirror < count) {
        Colors behind = mirrored_along(tile, viewer, spans[mirror], stretch, places);
        Colors added = {rest * behind.x, rest * behind.y, rest * behind.z, rest};
        all.x += added.x, all.y += added.y, all.z += added.z, all.alpha += rest;
        if (keep) keep_added(tile, mirror, weighted_sum(&added, light));
        Span shown = stretch;
        shown.source = spans[mirror].source;
        sum->depth += left * middle_depth(tile, shown, viewer->place);
    }
#endif
    sum->color = weighted_sum(&all, light);
    return is_smooth(tile, &all, places);
}

// Blend all layers at the same times.
static Blended blend_over_time(const Tile *tile, const Viewer *viewer, const Stack *stack)
{
    Moments at = {.stretch = {stack->times.x, stack->times.y, 0.0f, 0u}};
    at.places = first_places(tile, at.stretch);
    Blended sum = {0.0f, 0.0f};
    float total = 0.0f;
    for (bool more = true; more;) {
        Blended part;
        at.light = part_light(tile, viewer->window, at.stretch, at.places);
        if (!blend_places(tile, viewer, stack, &at, false, &part)) {
            refine(&at.places);
            continue;
        }
#if RECORDED()
        blend_places(tile, viewer, stack, &at, true, &part);
#endif
        sum.color += part.color, sum.depth += part.depth, total += lanes_sum(at.light);
        more = next_places(&at.places);
    }
    if (total > 0.0f) sum.color /= total, sum.depth /= total;
    if (total > 0.0f) scale_added(tile, stack->count, 1.0f / total);
    return sum;
}

#endif // ALPHA_VARIES

// Blend a stack over the time that is asked for.
static Blended blend_stack(const Tile *tile, const Viewer *viewer, const Stack *stack)
{
    global const Span *spans = stack->spans;
    const uint count = stack->count;
    const float2 times = stack->times;
    clear_added(tile, count);
#if ALPHA_VARIES()
    if (alpha_varies(tile, spans, count)) return blend_over_time(tile, viewer, stack);
#endif
    Blended sum = {0.0f, 0.0f};
    float rest = 1.0f, depth = 0.0f;
    uint mirror = mirror_among(tile, spans, count);
    for (uint i = 0; i < count; i++) {
        Span span = spans[i];
        span.t0 = times.x, span.t1 = times.y;
        float alpha = alpha_of(tile, span);
        float3 color = span_color(tile, viewer, span);
        if (i <= mirror) // of what it shows a mirror's own
            depth = middle_depth(tile, span, viewer->place);
        sum.color += rest * alpha * (float4)(color, 1.0f);
        keep_added(tile, i, rest * alpha * (float4)(color, 1.0f));
        sum.depth += rest * alpha * depth;
        rest *= 1.0f - alpha;
    }
#if MIRRORS()
    if (mirror < count) {
        float4 behind = mirrored_behind(tile, viewer, spans[mirror], times);
        sum.color += rest * behind, sum.depth += rest * depth;
        keep_added(tile, mirror, rest * behind);
    }
#endif
    return sum;
}

#endif
