// Stage "shade": the average colour of every visible span (Hong & Oh 2017, 3.2 and 4.4), summed into
// its pixel.
//
// Colour is averaged over TEXTURE_SAMPLES places along the visible part; the mip level comes from the
// longest extent of that part in texels, over the number of samples.
#include "analytic/shutter.h"
#ifdef EXACT
#include "analytic/varying_exact.h"
#else
#include "analytic/varying_surface.h"
#endif

#if defined(PHONG) || defined(TEXTURED) || defined(VERTEX_COLOR)
#define VARYING
#endif

// Colour that is the same everywhere on the face.
static inline float3 flat_color(const Tile *tile, Path path, Mesh mesh)
{
    float3 color = load3(tile->scene.materials[mesh.material].base);
#ifdef FACE_COLOR
    if (mesh.face_color != NONE)
        color *= vload3(mesh.face_color + path.face, tile->scene.face_colors);
#endif
    return color;
}

#ifdef VARYING

// Number of places along a span at which its colour is found: one if nothing can vary.
static inline int evaluations(const Shaded *s)
{
    bool varies = s->path.step != 0
                  && (s->material.texture != NONE || (s->material.flags & MATERIAL_PHONG)
                      || s->mesh.color != NONE);
    return varies ? TEXTURE_SAMPLES : 1;
}

// Weight of the i-th of n equal parts of the span: the light that passes in it.
static inline float part_light(const Tile *tile, const Shaded *s, Span span, int i, int n)
{
#ifdef SHUTTER_CURVE
    float step = (span.t1 - span.t0) / n;
    return light_until(tile, s->window, span.t0 + step * (i + 1))
           - light_until(tile, s->window, span.t0 + step * i);
#else
    return 1.0f;
#endif
}

static float3 varying_color(const Tile *tile, const Shaded *s, Span span, float3 base)
{
    Varying v = prepare_varying(tile, s, span);
    int n = evaluations(s);
#ifdef TEXTURED
    Texture texture = tile->scene.textures[s->material.texture == NONE ? 0u : s->material.texture];
    float2 extent = fabs(attributes_at(s, &v, span.t1).uv - attributes_at(s, &v, span.t0).uv)
                    * (float2)(texture.width, texture.height);
    float level = log2(fmax(fmax(extent.x, extent.y) / n, 1.0f));
#endif
    float3 sum = 0.0f;
    float total = 0.0f;
    for (int i = 0; i < n; i++) {
        float t = span.t0 + (span.t1 - span.t0) * ((i + 0.5f) / n);
        Attributes a = attributes_at(s, &v, t);
        float3 here = base * a.color;
#ifdef TEXTURED
        if (s->material.texture != NONE)
            here *= texture_at(tile->scene.texels, texture, a.uv, level);
#endif
#ifdef PHONG
        if (s->material.flags & MATERIAL_PHONG) {
            float w = 1.0f; // depth is for what lies near
#if defined(POINT_LIGHTS) || defined(LENS)
            w = varying_depth(&v, t);
#endif
            here = reflect_light(tile, s, a, here, t, w);
        }
#endif
        float light = part_light(tile, s, span, i, n);
        sum += light * here, total += light;
    }
    return total > 0.0f ? sum / total : (float3)(0.0f);
}

#endif // VARYING

static float3 span_color(const Tile *tile, Span span, Place place, float2 window)
{
    Path path = tile->scene.paths[span_path(tile, span)];
    Mesh mesh = tile->scene.meshes[path.mesh];
    float3 color = flat_color(tile, path, mesh);
#ifdef VARYING
    Shaded s;
    s.path = path, s.mesh = mesh, s.material = tile->scene.materials[mesh.material];
    if (s.material.texture == NONE && !(s.material.flags & MATERIAL_PHONG) && mesh.color == NONE)
        return color;
    s.segment = (uint)(path.open / path.length + 0.5f);
    s.place = place, s.window = window;
    load_corners(tile, &s);
#ifdef PHONG
    load_view(tile, &s);
#endif
    color = varying_color(tile, &s, span, color);
#endif
    return color;
}

// Add one span of a sample to its pixel.
static void add_span(Tile *tile, int sample, int pixel, Span span)
{
    Place place = place_of(tile, sample);
    float weight = span.weight * weight_of(tile, sample);
    float3 color = span_color(tile, span, place, window_of(tile, sample));
    tile->color[pixel] += weight * (float4)(color, 1.0f);
    tile->depth[pixel] += weight * span_depth(tile, span, place, 0.5f * (span.t0 + span.t1));
}

static void shade_sample(Tile *tile, int row, int column)
{
    int sample = row * TILE + column, pixel = row % TILE * TILE + column;
#ifdef MOVING
    Run run = tile->span_runs[sample];
    for (uint i = run.start; i < run.start + run.count; i++)
        add_span(tile, sample, pixel, tile->spans[i]);
    tile->count[pixel] += tile->met[sample];
#elif defined(STATIC) // an empty scene has neither
    if (!(tile->static_depth[sample] < INFINITY)) return;
    Span always = {0.0f, 1.0f, 1.0f, tile->static_part[sample] >> PART_BITS};
    add_span(tile, sample, pixel, always);
    tile->count[pixel]++;
#endif
}

// Add every span of the piece to its pixel, sample by sample. Always true.
static bool shade(Tile *tile)
{
    for (int row = tile->row_low; row < tile->row_high; row++)
        for (int column = tile->x_low; row_is_rendered(tile, row) && column < tile->x_high; column++)
            shade_sample(tile, row, column);
    return true;
}
