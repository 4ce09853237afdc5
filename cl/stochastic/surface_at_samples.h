// What a path looks like at samples that it covers.
#ifndef MB_SURFACE_AT_SAMPLES_H
#define MB_SURFACE_AT_SAMPLES_H

#include "shared/effects.h"
#include "stochastic/moving.h"
#include "shared/attributes.h"
#if COUNT_TEXELS()
#include "stochastic/texels.h"
#endif
#if SHADOWS()
#include "stochastic/lights.h"
#endif

// Colour of a path where it does not vary, and alpha 1; nothing of NONE.
static inline float4 path_color(const Tile *tile, uint path)
{
    return path == NONE ? (float4)(0.0f) : (float4)(load3(tile->scene.paths[path].color), 1.0f);
}

#if VARYING()

// A path whose colour varies: ready to be asked for sixteen samples.
typedef struct {
    uint path;
    bool flat;
    Moving moving;
    Shaded shaded;
#if LARGE_UV()
    Vertex corner[6]; // x and y from the tile's middle
#endif
} Surface;

#if LARGE_UV()
typedef struct {
    LaneDoubles x, y, w;
} ExactVertex;

static void load_exact_corners(const Tile *tile, Surface *surface)
{
    for (int i = 0; i < 6; i++) {
        Vertex v = tile->scene.vertices[corner_vertex(surface->shaded.path, i)];
        v.x -= (tile->x + HALF) * v.w, v.y -= (tile->y + HALF) * v.w;
        surface->corner[i] = v;
    }
}

// Vertex i at times tau, relative to the samples.
static INLINED ExactVertex exact_vertex_at(const Surface *surface, int i, const Samples *samples,
                                           LaneDoubles tau)
{
    const Vertex q = surface->corner[i], r = surface->corner[i + 3];
    ExactVertex p = {q.x + tau * (r.x - q.x), q.y + tau * (r.y - q.y), q.w + tau * (r.w - q.w)};
#if GLOSSY()
    const Moving *m = &surface->moving;
    if (m->sheared) {
        Lanes near = to_lanes(tau);
        p.x += to_lane_doubles(sheared_by(m, 0, i, samples, near)) * m->size;
        p.y += to_lane_doubles(sheared_by(m, 1, i, samples, near)) * m->size;
        p.w += to_lane_doubles(sheared_by(m, 2, i, samples, near)) * m->size;
    }
#endif
#if LENS()
    LaneDoubles circle = q.circle + tau * (r.circle - q.circle);
    p.x += to_lane_doubles(samples->u) * circle, p.y += to_lane_doubles(samples->v) * circle;
#endif
    p.x -= to_lane_doubles(samples->x) * p.w, p.y -= to_lane_doubles(samples->y) * p.w;
    return p;
}

static INLINED LaneDoubles exact_edge_of(ExactVertex a, ExactVertex b)
{
    return a.x * b.y - b.x * a.y;
}
#endif

static void load_surface(const Tile *tile, uint path, Surface *surface)
{
    surface->path = path;
    Shaded *s = &surface->shaded;
    *s = load_shaded(&tile->scene, path);
    surface->flat = s->material.texture == NONE && !(s->material.flags & MATERIAL_LIT)
                    && s->mesh.color == NONE;
    if (surface->flat) return;
    s->place.x = tile->x + HALF, s->place.y = tile->y + HALF, s->place.u = s->place.v = 0.0f;
    surface->moving = load_moving(tile, path);
#if LARGE_UV()
    load_exact_corners(tile, surface);
#endif
    load_corners(&tile->scene, s);
#if LIT()
    load_view(&tile->scene, s);
#endif
}

// Attributes of the surface at samples.
static Attributes surface_attributes(const Surface *surface, const Samples *samples)
{
    const Shaded *s = &surface->shaded;
#if LARGE_UV()
    Weights tau = (to_lane_doubles(samples->t) - s->path.open) / path_length(s->path);
    ExactVertex p[3];
    for (int i = 0; i < 3; i++) p[i] = exact_vertex_at(surface, i, samples, tau);
#define EDGE exact_edge_of
#else
    const Moving *m = &surface->moving;
    Weights tau = time_in_segment(m, samples->t);
    Lanes3 p[3];
    for (int i = 0; i < 3; i++) p[i] = vertex_at(m, i, samples, tau);
#define EDGE edge_of
#endif
    Weights e[3] = {EDGE(p[1], p[2]), EDGE(p[2], p[0]), EDGE(p[0], p[1])};
#undef EDGE
    Weights sum = (e[0] + e[1]) + e[2], weights[6];
    for (int i = 0; i < 3; i++) {
        Weights share = sum != 0.0f ? e[i] / sum : (Weights)((Weight)1.0f / 3.0f);
        // A mean place may lie outside of the triangle.
        share = share > 0.0f ? share : (Weights)(0.0f);
        share = share < 1.0f ? share : (Weights)(1.0f);
        weights[i] = share * (1.0f - tau), weights[i + 3] = share * tau;
    }
    return blend_corners(s, weights);
}

// Colours of the surface at samples with these depths, `count` of which matter.
static Colors surface_colors(Tile *tile, const Surface *surface, const Samples *samples,
                             const Lanes *depth, int count)
{
    const Shaded *s = &surface->shaded;
    Attributes a = surface_attributes(surface, samples);
    float4 base = path_color(tile, surface->path);
    Lanes3 color = {base.x * a.color.x, base.y * a.color.y, base.z * a.color.z};
#if TEXTURED()
    if (s->material.texture != NONE) {
        Texture texture = tile->scene.textures[s->material.texture];
#if COUNT_TEXELS()
        count_texels(tile, texture, *u_in(texture, &a), *v_in(texture, &a), count);
#endif
        Colors texel = texture_at(tile->scene.texels, texture, u_in(texture, &a),
                                  v_in(texture, &a), 0.0f, count);
#if ALPHA_VARIES()
        texel = unpremultiplied(texel);
#endif
        color.x *= texel.x, color.y *= texel.y, color.z *= texel.z;
    }
#endif
#if LIT()
    if (s->material.flags & MATERIAL_LIT) {
        Lanes w = lanes_min(lanes_max(*depth, (Lanes)(1e-30f)), (Lanes)(1e30f));
        Sight sight = {samples->t, w, samples->x, samples->y};
#if SHADOWS()
        light_at_samples(tile, surface->path, samples, a.lit);
#endif
#if LENS()
        sight.across -= samples->u * a.circle / w, sight.down -= samples->v * a.circle / w;
#endif
#if GLOSSY()
        const float middle_x = tile->x + HALF, middle_y = tile->y + HALF;
        undo_shear(s, &a, samples->a, samples->b, samples->x + middle_x, samples->y + middle_y,
                   &sight);
#endif
#if METALLIC()
        load_gloss(&tile->scene, s, &a, 0.0f, count);
#endif
        color = reflect_light(&tile->scene, s, &a, color, &sight, count);
#if EMISSION()
        color = with_emission(&tile->scene, s, &a, color, 0.0f, count);
#endif
    }
#endif
    Colors colors = {color.x, color.y, color.z};
    return colors;
}

#if ALPHA_VARIES()
// Alpha of the surface at samples that it covers.
static INLINED Lanes alpha_at_samples(Tile *tile, const Surface *surface, const Samples *samples)
{
    const Shaded *s = &surface->shaded;
    Attributes a = surface_attributes(surface, samples);
#if COUNT_TEXELS()
    if (s->material.texture != NONE) {
        Texture texture = tile->scene.textures[s->material.texture];
        count_texels(tile, texture, *u_in(texture, &a), *v_in(texture, &a), LANES);
    }
#endif
    return counted_alpha(s, given_alpha(&tile->scene, s, &a, LANES));
}
#endif

#endif // VARYING

#endif
