// Stage "shade": the average colour of every visible span (Hong & Oh 2017, 3.2 and 4.4), summed
// into its pixel.
//
// Colour is averaged over places along the visible part, as many as quadrature.h says.
#include "shared/effects.h"
#include "analytic/line_window.h"
#if EXACT()
#include "analytic/varying_exact.h"
#else
#include "analytic/varying_surface.h"
#endif
#include "analytic/surface_color.h"
#if SHADOWS()
#include "analytic/shadow.h"
#endif
#if SKY()
#include "analytic/sky_over_time.h"
#endif

#if VARYING()
#include "analytic/quadrature.h"
#if STILL()
#include "analytic/still.h"
#endif

// Mip level of all places of the span: that at which their share of its longest extent is one texel
// (Hong & Oh 2017, 4.4). A test of alpha is made of the texture itself.
static float span_level(const Tile *tile, const Shaded *s, const Varying *v, Span span, int n)
{
#if TEXTURED() && !SHADING_ERROR()
    if (s->material.texture == NONE || (s->material.flags & MATERIAL_MASK)) return 0.0f;
    Texture texture = tile->scene.textures[s->material.texture];
    Lanes ends = LANE_INDEX < 1.0f ? (Lanes)(span.t0) : (Lanes)(span.t1);
    Attributes a = attributes_at(s, v, &ends);
    float2 extent = fabs((float2)(first_lane(steps_of_u(&a)), first_lane(steps_of_v(&a))))
                    * (float2)(texture.width, texture.height);
    return log2(fmax(fmax(extent.x, extent.y) / n, 1.0f));
#else
    return 0.0f;
#endif
}

#if ANISOTROPY()
// The footprint of all places of the span: that in its middle.
static void load_span_footprint(const Tile *tile, const Shaded *s, const Varying *v, Span span,
                                Attributes *a)
{
    float middle = 0.5f * (span.t0 + span.t1);
    Lanes middles = middle;
    Attributes there = attributes_at(s, v, &middles);
    float tau = (middle - s->path.open) / path_length(s->path);
    load_footprint(&tile->scene, s, tau, (Lanes)(s->place.x), (Lanes)(s->place.y), &there);
    a->footprint = there.footprint;
}
#endif

#if SHADING_ERROR()
// Size of the texels that are looked up, in those of the texture.
static inline float finest_texel(const Tile *tile, Texture texture, const Attributes *a)
{
#if ANISOTROPY()
    const Footprint *f = &a->footprint;
    return shorter_side(texture, (float2)(first_lane(f->u_right), first_lane(f->v_right)),
                        (float2)(first_lane(f->u_down), first_lane(f->v_down)),
                        tile->scene.numbers.anisotropy);
#else
    return 1.0f;
#endif
}

#if LIGHT_AROUND() && METALLIC()
// Whether the directions that are mirrored at times t are no further apart than texels of the cube
// map are.
static INLINED bool mirrors_closely(const Tile *tile, const Shaded *s, const Attributes *a, Lanes t)
{
    CubeMap map = tile->scene.maps[s->mesh.map];
    if (!(s->material.flags & MATERIAL_METALLIC) || map.levels == 0u) return true;
    float rough = s->material.gloss_texture == NONE ? s->material.roughness : 0.0f;
    uint level = min((uint)first_lane(level_of(&map, (Lanes)(rough * rough))), map.levels - 1u);
    Lanes3 view = lanes_unit(lanes_scaled(rays_at(s, t), -1.0f));
    Lanes3 way = mirrored_way(normals_seen(s, a, view), view);
    Lanes3 turn = {lanes_steps(way.x), lanes_steps(way.y), lanes_steps(way.z)};
    float texel = SPACING * 2.0f / map.size[level];
    return lanes_greatest_number(lanes_dot(turn, turn)) <= texel * texel;
}
#endif

// Whether the places, with these attributes, lie close enough together for the rule to be judged by
// its values: closer than texels are, and than highlights are wide. Where no more are to be had the
// level grows with the distance.
static INLINED bool close_enough(const Tile *tile, const Shaded *s, const Attributes *a, Lanes t,
                                 Instants places, float *level)
{
    bool close = true;
#if TEXTURED()
    const Material *m = &s->material;
    uint index = m->texture != NONE ? m->texture
                 : m->gloss_texture != NONE ? m->gloss_texture : m->emission_texture;
    if (index != NONE) {
        Texture texture = tile->scene.textures[index];
        Lanes across = fabs(steps_of_u(a)) * texture.width;
        Lanes down = fabs(steps_of_v(a)) * texture.height;
        float texels = lanes_greatest_number(lanes_max(across, down));
        close = texels <= SPACING * finest_texel(tile, texture, a);
        if (!can_refine(places) && !(s->material.flags & MATERIAL_MASK))
            *level = fmax(*level, log2(fmax(texels, 1.0f)));
    }
#endif
#if LIT()
    if (s->material.flags & MATERIAL_LIT) {
        Lanes3 n = lanes_unit(a->normal);
        Lanes3 turn = {lanes_steps(n.x), lanes_steps(n.y), lanes_steps(n.z)};
        close &= lanes_greatest_number(lanes_dot(turn, turn)) <= s->material.turn;
#if LIGHT_AROUND() && METALLIC()
        close &= mirrors_closely(tile, s, a, t);
#endif
    }
#endif
    return close;
}
#endif

// Colours at places along the span, with mip level `level`. False, and none, where that would not
// tell enough.
static bool colors_along(const Tile *tile, const Shaded *s, const Varying *v, Span span,
                         float level, Instants places, Colors *colors)
{
    Sight sight = {times_of(span, places), 1.0f, 0.0f, 0.0f}; // depth is for what lies near
    Attributes a = attributes_at(s, v, &sight.t);
#if ANISOTROPY()
    if (has_footprint(s)) load_span_footprint(tile, s, v, span, &a);
#endif
#if SHADING_ERROR()
    if (!close_enough(tile, s, &a, sight.t, places, &level) && can_refine(places)) return false;
#endif
#if LIT() && (POINT_LIGHTS() || LENS() || GLOSSY())
    sight.w = varying_depth(v, sight.t);
#endif
#if LIT() && LENS()
    // A point is seen through the middle of the lens where its circle of confusion is not.
    sight.w = lanes_min(lanes_max(sight.w, (Lanes)(1e-30f)), (Lanes)(1e30f));
    sight.across = -s->place.u * a.circle / sight.w, sight.down = -s->place.v * a.circle / sight.w;
#endif
#if LIT() && GLOSSY()
    undo_shear(s, &a, s->place.a, s->place.b, s->place.x, s->place.y, &sight);
#endif
#if SHADOWS()
    light_along(tile, s->window, span, places, a.lit);
#endif
    *colors = surface_color(tile, s, &a, level, places.count, &sight);
    return true;
}

static INLINED float4 weighted_sum(const Colors *colors, Lanes light)
{
    float4 sum = 0.0f;
    sum.x = lanes_sum(light * colors->x), sum.y = lanes_sum(light * colors->y);
    sum.z = lanes_sum(light * colors->z);
#if ALPHA_VARIES()
    sum.w = lanes_sum(light * colors->alpha);
#endif
    return sum;
}

// Average colour of the span.
static float3 varying_color(const Tile *tile, const Shaded *s, Span span)
{
    Varying v = prepare_varying(tile, s, span);
    Instants places = first_places(tile, span);
#if SHADOWS()
    if (s->path.step == 0 && s->mesh.map == 0u) places = (Instants){0, 1, 1}; // but for its light
#endif
    float level = span_level(tile, s, &v, span, places.n);
    float4 sum = 0.0f;
    float total = 0.0f;
    for (bool more = true; more;) {
        Colors here;
        if (!colors_along(tile, s, &v, span, level, places, &here)
            || !is_smooth(tile, &here, places)) {
            refine(&places);
            continue;
        }
        Lanes light = part_light(tile, s->window, span, places);
        sum += weighted_sum(&here, light), total += lanes_sum(light);
        more = next_places(&places);
    }
    return total > 0.0f ? sum.xyz / total : (float3)(0.0f);
}

#endif // VARYING

static float3 span_color(const Tile *tile, const Viewer *viewer, Span span)
{
    uint path = span_path(tile, span);
#if VARYING()
#if STILL()
    if (path < tile->scene.numbers.static_paths) return tile->still[viewer->sample].xyz;
#endif
    Shaded s = load_shaded(&tile->scene, path);
    if (varies_on_surface(&s)) {
        s.place = viewer->place, s.window = viewer->window;
        load_attributes(tile, &s);
        return varying_color(tile, &s, span);
    }
#endif
    return load3(tile->scene.paths[path].color);
}

#if STACKS()
#include "analytic/blend.h"
#endif

#define SPANS_AHEAD 4 // spans ahead of which their paths are asked for

static inline void fetch_path(const Tile *tile, uint path)
{
    fetch(tile->scene.paths + path);
#if EXACT()
    global const char *depth = (global const char *)(tile->depths + path);
    for (int i = 0; i < (int)sizeof(Depth); i += 64) fetch(depth + i);
#endif
}

// Add the spans of a sample to its pixel: colour with coverage, and depth.
static void add_spans(Tile *tile, int sample, int pixel, global const Span *spans, uint count)
{
    const Viewer viewer = viewer_of(tile, sample);
    float4 color = 0.0f;
    float depth = 0.0f;
#if STACKS()
    for (uint i = 0, size; i < count; i += size) {
        size = stack_size(spans + i, count - i);
        for (uint k = i + size; k < min(i + 2 * size, count); k++)
            fetch_path(tile, span_path(tile, spans[k]));
        const Stack stack = {spans + i, size, (float2)(spans[i].t0, spans[i].t1)};
        Blended seen = blend_stack(tile, &viewer, &stack);
#if SKY()
        seen.color += sky_through(tile, &viewer, stack.times, 1.0f - seen.color.w);
#endif
        color += spans[i].weight * seen.color, depth += spans[i].weight * seen.depth;
    }
#else
    for (uint i = 0; i < count; i++) {
        if (i + SPANS_AHEAD < count) fetch_path(tile, span_path(tile, spans[i + SPANS_AHEAD]));
        Span span = spans[i];
        color += span.weight * (float4)(span_color(tile, &viewer, span), 1.0f);
        depth += span.weight * span_depth(tile, span, viewer.place, 0.5f * (span.t0 + span.t1));
    }
#endif
#if SKY()
    color += sky_behind(tile, &viewer, spans, count);
#endif
    tile->color[pixel] += weight_of(tile, sample) * color;
    tile->depth[pixel] += weight_of(tile, sample) * depth;
}

#if AOV_SHARP()
// Add what of the spans is seen at the moment: a span without length.
static void add_moment(Tile *tile, int sample, int pixel, global const Span *spans, uint count)
{
    const Viewer viewer = viewer_of(tile, sample);
    float t = moment_in(tile, viewer.window);
    for (uint i = 0; i < count; i++) {
        Span span = spans[i];
        if (!(span.t0 <= t && t < span.t1)) continue;
#if STACKS()
        const Stack stack = {spans + i, stack_size(spans + i, count - i), (float2)(t)};
        Blended seen = blend_stack(tile, &viewer, &stack);
#if SKY()
        seen.color += sky_through(tile, &viewer, stack.times, 1.0f - seen.color.w);
#endif
        tile->sharp[pixel] += weight_of(tile, sample) * seen.color;
        return;
#endif
        span.t0 = span.t1 = t;
        float3 color = span_color(tile, &viewer, span);
        tile->sharp[pixel] += weight_of(tile, sample) * (float4)(color, 1.0f);
        return;
    }
#if SKY()
    tile->sharp[pixel] += weight_of(tile, sample) * sky_through(tile, &viewer, (float2)(t), 1.0f);
#endif
}
#endif

#if !MOVING() && !SHADOWS()
// Add what a sample sees that sees no surface.
static void add_open(Tile *tile, int sample, int pixel)
{
#if SKY()
    const Viewer viewer = viewer_of(tile, sample);
    float4 light = sky_behind(tile, &viewer, 0, 0u);
    tile->color[pixel] += weight_of(tile, sample) * light;
#if AOV_SHARP()
    light = sky_through(tile, &viewer, (float2)(moment_in(tile, viewer.window)), 1.0f);
    tile->sharp[pixel] += weight_of(tile, sample) * light;
#endif
#endif
}
#endif

// Add what a sample of the piece sees to its pixel.
static void shade_sample(Tile *tile, int row, int column)
{
    int sample = row * TILE + column, pixel = row % TILE * TILE + column;
#if AOV_OPERATIONS()
    tile->operations[pixel] += tile->tested[sample];
#endif
#if MOVING() || SHADOWS()
    Run run = tile->span_runs[sample];
    add_spans(tile, sample, pixel, tile->spans + run.start, run.count);
#if AOV_SHARP()
    add_moment(tile, sample, pixel, tile->spans + run.start, run.count);
#endif
    tile->count[pixel] += tile->met[sample];
#elif STATIC() // an empty scene has neither
    if (!(tile->static_depth[sample] < INFINITY)) {
        add_open(tile, sample, pixel);
        return;
    }
    Span always = {0.0f, 1.0f, 1.0f, tile->static_part[sample] >> PART_BITS};
    const Viewer viewer = viewer_of(tile, sample);
    float3 color = span_color(tile, &viewer, always);
    tile->color[pixel] += weight_of(tile, sample) * (float4)(color, 1.0f);
    tile->depth[pixel] += weight_of(tile, sample) * (float)tile->static_depth[sample];
#if AOV_SHARP()
    tile->sharp[pixel] += weight_of(tile, sample) * (float4)(color, 1.0f);
#endif
    tile->count[pixel]++;
#else
    add_open(tile, sample, pixel);
#endif
}

// Add every span of the piece to its pixel, sample by sample. Always true.
static bool shade(Tile *tile)
{
#if VARYING() && STILL()
    shade_all_still(tile);
#endif
    for (int row = tile->row_low; row < tile->row_high; row++) {
        if (!row_is_rendered(tile, row)) continue;
        for (int column = tile->x_low; column < tile->x_high; column++)
            shade_sample(tile, row, column);
    }
    return true;
}
