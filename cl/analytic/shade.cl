// Stage "shade": the average colour of every visible span (Hong & Oh 2017, 3.2 and 4.4), summed into
// its pixel.
//
// Attributes are found where the interval's two fragments lie on the path's surface, and run
// linearly in time between them, which is exact for a surface in translation. Colour is averaged
// over TEXTURE_SAMPLES places along the visible part; the mip level comes from the longest extent
// of that part in texels, over the number of samples.
#include "analytic/tile.h"
#include "analytic/surface.h"
#include "shared/shading.h"

#if defined(PHONG) || defined(TEXTURED) || defined(VERTEX_COLOR)
#define VARYING
#endif

#ifdef VARYING

// What is interpolated: attributes at one time of an interval.
typedef struct {
    float t;
    float2 uv;
    float3 normal, color;
} Attributes;

typedef struct {
    Path path;
    Mesh mesh;
    Material material;
    uint segment;
    float x, y; // sample
} Shaded;

static inline uint attribute_index(const Shaded *s, uint base, uint step, int corner)
{
    uint vertex = corner % 3 == 0 ? s->path.a : corner % 3 == 1 ? s->path.b : s->path.c;
    uint within = vertex - s->mesh.vertex - s->segment * s->mesh.count;
    return base + within + (step == 0 ? 0u : (s->segment + corner / 3) * s->mesh.count);
}

// Weights of the path's six corners where face `face` of its surface meets the sample; returns the
// fragment's time within the segment.
static float corner_weights(const Surface *surface, int face, float x, float y, float *weights)
{
    float xs[3], ys[3];
    for (int i = 0; i < 3; i++) {
        int c = FACE_CORNERS[face][i];
        xs[i] = fma(-x, surface->w[c], surface->x[c])
                + fma(-x, surface->w_low[c], surface->x_low[c]);
        ys[i] = fma(-y, surface->w[c], surface->y[c])
                + fma(-y, surface->w_low[c], surface->y_low[c]);
    }
    float e[3], sum = 0.0f, t = 0.0f;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        e[i] = xs[j] * ys[k] - xs[k] * ys[j];
        sum += e[i];
    }
    for (int i = 0; i < 6; i++) weights[i] = 0.0f;
    for (int i = 0; i < 3; i++) {
        int c = FACE_CORNERS[face][i], side = c - 6, r = (side + 1) % 3;
        float share = sum != 0.0f ? e[i] / sum : 1.0f / 3.0f;
        t += share * CORNER_TIME[c];
        if (c < 6) {
            weights[c] += share;
            continue;
        }
        float start = 0.5f, end = 0.5f;
        if (surface->crossed >> side & 1u) {
            start = surface->place[side][0], end = surface->place[side][1];
        }
        weights[side] += 0.5f * share * (1.0f - start), weights[r] += 0.5f * share * start;
        weights[side + 3] += 0.5f * share * (1.0f - end), weights[r + 3] += 0.5f * share * end;
    }
    return t;
}

// Normal of the flat triangle at the segment's start (corner 0) or end (corner 3), in the world.
static float3 face_normal(const Tile *tile, const Shaded *s, const Surface *surface, int corner)
{
    global const Camera *camera = tile->scene.cameras + s->mesh.camera
                                  + (s->path.step == 0 ? 0u : s->segment + corner / 3);
    double3 p[3];
    for (int i = 0; i < 3; i++) {
        double3 q = corner_position(surface, corner + i);
        global const double *m = camera->inverse;
        p[i] = (double3)(m[0] * q.x + m[1] * q.y + m[2] * q.z,
                         m[3] * q.x + m[4] * q.y + m[5] * q.z,
                         m[6] * q.x + m[7] * q.y + m[8] * q.z);
    }
    double3 n = cross(p[1] - p[0], p[2] - p[0]);
    double size = sqrt(dot(n, n));
    return convert_float3(size > 0.0 ? n / size : n);
}

static Attributes attributes_of_part(const Tile *tile, const Shaded *s, const Surface *surface,
                                     uint part)
{
    float weights[6];
    Attributes a = {0.0f, 0.0f, 0.0f, 0.0f};
    float tau = corner_weights(surface, part & ((1u << PART_BITS) - 1u), s->x, s->y, weights);
    a.t = s->path.open + s->path.length * tau;
    int corners = s->path.step == 0 ? 3 : 6;
    Mesh mesh = s->mesh;
    for (int i = 0; i < corners; i++) {
        if (mesh.uv != NONE)
            a.uv += weights[i] * vload2(attribute_index(s, mesh.uv, mesh.uv_step, i),
                                        tile->scene.uvs);
        if (mesh.color != NONE)
            a.color += weights[i] * vload3(attribute_index(s, mesh.color, mesh.color_step, i),
                                           tile->scene.vertex_colors);
        if (mesh.normal != NONE)
            a.normal += weights[i] * vload3(attribute_index(s, mesh.normal, mesh.normal_step, i),
                                            tile->scene.normals);
    }
#ifdef PHONG
    if (mesh.normal == NONE && (s->material.flags & MATERIAL_PHONG)) {
        float at_end = weights[3] + weights[4] + weights[5];
        float3 start = face_normal(tile, s, surface, 0);
        a.normal = s->path.step == 0 ? start
                                     : mix(start, face_normal(tile, s, surface, 3), at_end);
    }
#endif
    return a;
}

#ifdef PHONG
// Reflected light at time t, when the surface is seen at depth w.
static float3 reflect_light(const Tile *tile, const Shaded *s, float3 normal, float3 color, float t,
                            float w)
{
    float tau = s->path.step == 0 ? 0.0f : (t - s->path.open) / s->path.length;
    global const Camera *c0 = tile->scene.cameras + s->mesh.camera
                              + (s->path.step == 0 ? 0u : s->segment);
    global const Camera *c1 = s->path.step == 0 ? c0 : c0 + 1;
    float3 ray, eye;
    float r[3], p[3];
    for (int i = 0; i < 3; i++) {
        double start = c0->inverse[3 * i] * s->x + c0->inverse[3 * i + 1] * s->y
                       + c0->inverse[3 * i + 2];
        double end = c1->inverse[3 * i] * s->x + c1->inverse[3 * i + 1] * s->y
                     + c1->inverse[3 * i + 2];
        r[i] = (float)(start + (end - start) * tau);
        p[i] = (float)(c0->eye[i] + (c1->eye[i] - c0->eye[i]) * tau);
    }
    ray = (float3)(r[0], r[1], r[2]), eye = (float3)(p[0], p[1], p[2]);
    float3 view = -normalize(ray);
    normal = normalize(normal);
    if (!(s->material.flags & MATERIAL_SINGLE_SIDED) && dot(normal, view) < 0.0f) normal = -normal;
    return phong(s->material, color, eye + w * ray, normal, view, tile->scene.lights,
                 tile->scene.light_count);
}
#endif

#endif // VARYING

static inline float interval_depth(Interval i, float t)
{
    return i.w0 + (i.w1 - i.w0) * ((t - i.t0) / (i.t1 - i.t0));
}

// Colour that is the same everywhere on the face.
static inline float3 flat_color(const Tile *tile, Path path, Mesh mesh)
{
    float3 color = load3(tile->scene.materials[mesh.material].base);
#ifdef FACE_COLOR
    if (mesh.face_color != NONE) color *= vload3(path.face, tile->scene.face_colors);
#endif
    return color;
}

static float3 span_color(const Tile *tile, Interval interval, Span span, int row, int column)
{
    Path path = tile->scene.paths[interval.first >> PART_BITS];
    Mesh mesh = tile->scene.meshes[path.mesh];
    float3 color = flat_color(tile, path, mesh);
#ifdef VARYING
    Shaded s;
    s.path = path, s.mesh = mesh, s.material = tile->scene.materials[mesh.material];
    if (s.material.texture == NONE && !(s.material.flags & MATERIAL_PHONG) && mesh.color == NONE)
        return color;
    s.segment = (uint)(path.open / path.length + 0.5f);
    s.x = sample_x(tile, row / TILE, column), s.y = sample_y(tile, row);
    Surface surface;
    load_surface(tile->scene.vertices, path, tile->scene.shapes + (interval.first >> PART_BITS),
                 &surface);
    uint first = interval.first, last = interval.last;
    if ((first & PART_EYE) == PART_EYE) first = last;
    if ((last & PART_EYE) == PART_EYE) last = first;
    Attributes a = attributes_of_part(tile, &s, &surface, first);
    Attributes b = first == last ? a : attributes_of_part(tile, &s, &surface, last);
    float over = b.t != a.t ? 1.0f / (b.t - a.t) : 0.0f;
    int n = first == last ? 1 : TEXTURE_SAMPLES;
#ifdef TEXTURED
    float level = 0.0f;
    Texture texture = tile->scene.textures[s.material.texture == NONE ? 0u : s.material.texture];
    float2 extent = fabs(b.uv - a.uv) * (float2)(texture.width, texture.height)
                    * fabs((span.t1 - span.t0) * over);
    level = log2(fmax(fmax(extent.x, extent.y) / n, 1.0f));
#endif
    float3 sum = 0.0f;
    for (int i = 0; i < n; i++) {
        float t = span.t0 + (span.t1 - span.t0) * ((i + 0.5f) / n), part = (t - a.t) * over;
        float3 here = color;
        if (mesh.color != NONE) here *= mix(a.color, b.color, part);
#ifdef TEXTURED
        if (s.material.texture != NONE)
            here *= texture_at(tile->scene.texels, texture, mix(a.uv, b.uv, part), level);
#endif
#ifdef PHONG
        if (s.material.flags & MATERIAL_PHONG)
            here = reflect_light(tile, &s, mix(a.normal, b.normal, part), here, t,
                                 interval_depth(interval, t));
#endif
        sum += here;
    }
    color = sum / n;
#endif
    return color;
}

// What one span adds to its pixel.
static void add_span(Tile *tile, int row, int column, Interval interval, Span span)
{
    int pixel = row % TILE * TILE + column;
    tile->color[pixel] += span.weight
                          * (float4)(span_color(tile, interval, span, row, column), 1.0f);
    tile->depth[pixel] += span.weight * interval_depth(interval, 0.5f * (span.t0 + span.t1));
}

static void shade_sample(Tile *tile, int row, int column)
{
    int sample = row * TILE + column;
#ifdef MOVING
    Run run = tile->span_runs[sample];
    for (uint i = run.start; i < run.start + run.count; i++) {
        Span span = tile->spans[i];
        add_span(tile, row, column, tile->sorted[span.interval], span);
    }
    tile->count[row % TILE * TILE + column] += tile->met[sample];
#else
    float w = tile->static_depth[sample];
    if (!(w < INFINITY)) return;
    Interval always = {0.0f, 1.0f, w, w, tile->static_part[sample], tile->static_part[sample]};
    Span span = {0.0f, 1.0f, 1.0f, 0u};
    add_span(tile, row, column, always, span);
    tile->count[row % TILE * TILE + column]++;
#endif
}

// Add every span of the piece to its pixel, sample by sample and front to back. Always true.
static bool shade(Tile *tile)
{
    for (int row = tile->row_low; row < tile->row_high; row++)
        for (int column = tile->x_low; row_is_rendered(tile, row) && column < tile->x_high; column++)
            shade_sample(tile, row, column);
    return true;
}
