// Stage "shade": the average colour of every visible span (Hong & Oh 2017, 3.2 and 4.4), summed
// into its pixel.
//
// Colour is averaged over TEXTURE_SAMPLES places along the visible part; the mip level comes from
// the longest extent of that part in texels, over the number of samples.
#include "analytic/shutter.h"
#ifdef EXACT
#include "analytic/varying_exact.h"
#else
#include "analytic/varying_surface.h"
#endif
#include "analytic/surface_color.h"
#ifdef SHADOWS
#include "analytic/shadow.h"
#endif

#if defined(PHONG) || defined(TEXTURED) || defined(VERTEX_COLOR)
#define VARYING
#endif

#if defined(STATIC) && !defined(SHADOWS)
#define STILL // what does not move has one colour whenever it is seen
#endif

#ifdef VARYING
#ifdef STILL
#include "analytic/still.h"
#endif

// The light that passes in each of the n equal parts of the span from `first` on; nothing beyond n.
static inline Lanes part_light(const Tile *tile, float2 window, Span span, int first, int n)
{
#ifdef SHUTTER_CURVE
    if (span.t0 == span.t1) return LANE_INDEX < 1.0f ? (Lanes)(1.0f) : (Lanes)(0.0f);
    float light[LANES], step = (span.t1 - span.t0) / n;
    float before = light_until(&tile->scene, window, span.t0 + step * first);
    for (int i = 0; i < LANES; i++) {
        float after = light_until(&tile->scene, window, span.t0 + step * min(first + i + 1, n));
        light[i] = after - before;
        before = after;
    }
    return vload16(0, light);
#else
    return first + LANE_INDEX < (float)n ? (Lanes)(1.0f) : (Lanes)(0.0f);
#endif
}

// Mip level at which a sample's share of the span's longest extent is one texel; a test of alpha
// is made of the texture itself.
static float span_level(const Tile *tile, const Shaded *s, const Varying *v, Span span, int n)
{
#ifdef TEXTURED
    if (s->material.texture == NONE || (s->material.flags & MATERIAL_MASK)) return 0.0f;
    Texture texture = tile->scene.textures[s->material.texture];
    Attributes a = attributes_at(s, v, LANE_INDEX < 1.0f ? (Lanes)(span.t0) : (Lanes)(span.t1));
    float2 extent = fabs((float2)(a.u.s1 - a.u.s0, a.v.s1 - a.v.s0))
                    * (float2)(texture.width, texture.height);
    return log2(fmax(fmax(extent.x, extent.y) / n, 1.0f));
#else
    return 0.0f;
#endif
}

// Number of places along a span at which its colour is found: one where it has no length.
static inline int places_along(Span span)
{
#ifdef AOV_SHARP
    if (span.t0 == span.t1) return 1;
#endif
    return TEXTURE_SAMPLES;
}

// Colours at sixteen of the n places along the span, from `first` on; the last one repeated beyond.
static Colors colors_along(const Tile *tile, const Shaded *s, const Varying *v, Span span,
                           float level, int first, int n)
{
    Lanes i = lanes_min(first + LANE_INDEX, (Lanes)(n - 1.0f));
    Lanes t = span.t0 + (span.t1 - span.t0) * ((i + 0.5f) / n);
    Attributes a = attributes_at(s, v, t);
    Lanes w = 1.0f, across = 0.0f, down = 0.0f; // depth is for what lies near
#if defined(PHONG) && (defined(POINT_LIGHTS) || defined(LENS))
    w = varying_depth(v, t);
#endif
#if defined(PHONG) && defined(LENS)
    // A point is seen through the middle of the lens where its circle of confusion is not.
    w = lanes_min(lanes_max(w, (Lanes)(1e-30f)), (Lanes)(1e30f));
    across = -s->place.u * a.circle / w, down = -s->place.v * a.circle / w;
#endif
#ifdef SHADOWS
    light_along(tile, s->window, span, first, n, a.lit);
#endif
    return surface_color(tile, s, &a, level, n - first, t, w, across, down);
}

// Average colour of the span, from so many places, sixteen at a time.
static float3 varying_color(const Tile *tile, const Shaded *s, Span span)
{
#ifdef SHADOWS
    const int n = s->path.step == 0 ? 1 : places_along(span); // only its light changes
#else
    const int n = places_along(span);
#endif
    Varying v = prepare_varying(tile, s, span);
    float level = span_level(tile, s, &v, span, n);
    float3 sum = 0.0f;
    float total = 0.0f;
    for (int first = 0; first < n; first += LANES) {
        Colors here = colors_along(tile, s, &v, span, level, first, n);
        Lanes light = part_light(tile, s->window, span, first, n);
        sum += (float3)(lanes_sum(light * here.x), lanes_sum(light * here.y),
                        lanes_sum(light * here.z));
        total += lanes_sum(light);
    }
    return total > 0.0f ? sum / total : (float3)(0.0f);
}

#endif // VARYING

static float3 span_color(const Tile *tile, int sample, Span span, Place place, float2 window)
{
    uint path = span_path(tile, span);
#ifdef VARYING
#ifdef STILL
    if (path < tile->static_paths) return tile->still[sample].xyz;
#endif
    Shaded s = load_shaded(tile, path);
    if (varies_on_surface(&s)) {
        s.place = place, s.window = window;
        load_attributes(tile, &s);
        return varying_color(tile, &s, span);
    }
#endif
    return load3(tile->scene.paths[path].color);
}

#ifdef TRANSLUCENT
#include "analytic/blend.h"
#endif

#define SPANS_AHEAD 4 // spans ahead of which their paths are asked for

static inline void fetch_path(const Tile *tile, uint path)
{
    fetch(tile->scene.paths + path);
#ifdef EXACT
    global const char *depth = (global const char *)(tile->depths + path);
    for (int i = 0; i < (int)sizeof(Depth); i += 64) fetch(depth + i);
#endif
}

// Add the spans of a sample to its pixel: colour with coverage, and depth.
static void add_spans(Tile *tile, int sample, int pixel, global const Span *spans, uint count)
{
    Place place = place_of(tile, sample);
    float2 window = window_of(tile, sample);
    float4 color = 0.0f;
    float depth = 0.0f;
#ifdef TRANSLUCENT
    for (uint i = 0, size; i < count; i += size) {
        size = stack_size(spans + i, count - i);
        for (uint k = i + size; k < min(i + 2 * size, count); k++)
            fetch_path(tile, span_path(tile, spans[k]));
        Blended stack = blend_stack(tile, sample, spans + i, size,
                                    (float2)(spans[i].t0, spans[i].t1), place, window);
        color += spans[i].weight * stack.color, depth += spans[i].weight * stack.depth;
    }
#else
    for (uint i = 0; i < count; i++) {
        if (i + SPANS_AHEAD < count) fetch_path(tile, span_path(tile, spans[i + SPANS_AHEAD]));
        Span span = spans[i];
        color += span.weight * (float4)(span_color(tile, sample, span, place, window), 1.0f);
        depth += span.weight * span_depth(tile, span, place, 0.5f * (span.t0 + span.t1));
    }
#endif
    tile->color[pixel] += weight_of(tile, sample) * color;
    tile->depth[pixel] += weight_of(tile, sample) * depth;
}

#ifdef AOV_SHARP
// Add what of the spans is seen at the moment: a span without length.
static void add_moment(Tile *tile, int sample, int pixel, global const Span *spans, uint count)
{
    Place place = place_of(tile, sample);
    float2 window = window_of(tile, sample);
    float t = moment_in(window);
    for (uint i = 0; i < count; i++) {
        Span span = spans[i];
        if (!(span.t0 <= t && t < span.t1)) continue;
#ifdef TRANSLUCENT
        Blended stack = blend_stack(tile, sample, spans + i, stack_size(spans + i, count - i),
                                    (float2)(t), place, window);
        tile->sharp[pixel] += weight_of(tile, sample) * stack.color;
        return;
#endif
        span.t0 = span.t1 = t;
        float3 color = span_color(tile, sample, span, place, window);
        tile->sharp[pixel] += weight_of(tile, sample) * (float4)(color, 1.0f);
        return;
    }
}
#endif

// Add what a sample of the piece sees to its pixel.
static void shade_sample(Tile *tile, int row, int column)
{
    int sample = row * TILE + column, pixel = row % TILE * TILE + column;
#ifdef AOV_OPERATIONS
    tile->operations[pixel] += tile->tested[sample];
#endif
#if defined(MOVING) || defined(SHADOWS)
    Run run = tile->span_runs[sample];
    add_spans(tile, sample, pixel, tile->spans + run.start, run.count);
#ifdef AOV_SHARP
    add_moment(tile, sample, pixel, tile->spans + run.start, run.count);
#endif
    tile->count[pixel] += tile->met[sample];
#elif defined(STATIC) // an empty scene has neither
    if (!(tile->static_depth[sample] < INFINITY)) return;
    Span always = {0.0f, 1.0f, 1.0f, tile->static_part[sample] >> PART_BITS};
    Place place = place_of(tile, sample);
    float3 color = span_color(tile, sample, always, place, window_of(tile, sample));
    tile->color[pixel] += weight_of(tile, sample) * (float4)(color, 1.0f);
    tile->depth[pixel] += weight_of(tile, sample) * (float)tile->static_depth[sample];
#ifdef AOV_SHARP
    tile->sharp[pixel] += weight_of(tile, sample) * (float4)(color, 1.0f);
#endif
    tile->count[pixel]++;
#endif
}

// Add every span of the piece to its pixel, sample by sample. Always true.
static bool shade(Tile *tile)
{
#if defined(VARYING) && defined(STILL)
    shade_all_still(tile);
#endif
    for (int row = tile->row_low; row < tile->row_high; row++) {
        if (!row_is_rendered(tile, row)) continue;
        for (int column = tile->x_low; column < tile->x_high; column++)
            shade_sample(tile, row, column);
    }
    return true;
}
