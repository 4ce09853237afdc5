// Attributes of a path's vertices, blended, and the light that a surface with them reflects.
#ifndef MB_ATTRIBUTES_H
#define MB_ATTRIBUTES_H

#include "shared/effects.h"
#include "shared/scene.h"
#include "shared/colors.h"
#include "shared/vectors.h"
#if LIT()
#include "shared/shading.h"
#endif
#if TEXTURED()
#include "shared/textures.h"
#endif
#if LIGHT_AROUND()
#include "shared/environment.h"
#include "shared/mirror_planes.h"
#endif
#include "shared/shear.h"

// Coordinates of textures, and weights of a path's corners: where one is millions of texels long its
// texels are lost to float32.
#if LARGE_UV()
typedef double2 Uv;
typedef double Weight;
typedef LaneDoubles Weights;
typedef Doubles HalfWeights;
#define to_weights(doubles) (doubles)
#define to_half_weights(doubles) (doubles)
#define lanes_to_weights to_lane_doubles
#else
typedef float2 Uv;
typedef float Weight;
typedef Lanes Weights;
typedef Floats HalfWeights;
#define to_weights to_lanes
#define to_half_weights to_floats
#define lanes_to_weights(lanes) (lanes)
#endif

// A path as one sample sees it. Corners 0 1 2 are its vertices at the segment's start, 3 4 5 at its
// end.
typedef struct {
    Path path;
    Mesh mesh;
    Material material;
    uint segment;
    Place place;
    float2 window; // when the sample is exposed
    Uv uv[6];
    float3 normal[6], color[6];
#if VERTEX_ALPHA()
    float alpha[6];
#endif
    float circle[6];
#if GLOSSY()
    Shear shear;
    float height[6];
#endif
    float3 ray[2], eye[2]; // at the segment's start and end: eye + w ray is seen at depth w, in the
                           // world's directions, relative to the first camera's eye
} Shaded;

// Attributes at sixteen times.
typedef struct {
    Lanes u, v;
#if LARGE_UV()
    Lanes u_within, v_within; // less whole repeats
    Lanes u_steps, v_steps;   // to the next lane
#endif
    Lanes3 normal, color;
    Lanes circle;
#if GLOSSY()
    Lanes height; // over the plane of the glossy mirror that it is seen in
#endif
#if VERTEX_ALPHA()
    Lanes alpha;
#endif
#if METALLIC()
    Gloss gloss;
#endif
#if ANISOTROPY()
    Footprint footprint;
#endif
#if SHADOWS()
    Lanes lit[SHADOW_LIGHTS]; // shares of the light of those that cast shadows
#endif
} Attributes;

// How they are seen: at times t of the shutter and depths w, (across, down) pixels from the place.
typedef struct {
    Lanes t, w, across, down;
} Sight;

static inline uint corner_vertex(Path path, int corner)
{
    uint vertex = corner % 3 == 0 ? path.a : corner % 3 == 1 ? path.b : path.c;
    return vertex + (corner < 3 ? 0u : path.step);
}

static inline uint attribute_index(const Shaded *s, uint base, uint step, int corner)
{
    uint within = corner_vertex(s->path, corner % 3) - s->mesh.vertex - s->segment * s->mesh.count;
    return base + within + (step == 0 ? 0u : (s->segment + corner / 3) * s->mesh.count);
}

#if LIT() || AOV_NORMAL()
static inline global const Camera *segment_camera(const Scene *scene, const Shaded *s, int end)
{
    return scene->cameras + s->mesh.camera
           + (s->path.step == 0 ? 0u : s->segment + (uint)end);
}

// Unit normal of the flat triangle at the segment's start (0) or end (1), in the world.
static float3 face_normal(const Scene *scene, const Shaded *s, int end)
{
    global const double *m = segment_camera(scene, s, end)->inverse;
    double3 p[3];
    for (int i = 0; i < 3; i++) {
        Vertex q = scene->vertices[corner_vertex(s->path, i + 3 * end)];
        p[i] = (double3)(m[0] * q.x + m[1] * q.y + m[2] * q.w, m[3] * q.x + m[4] * q.y + m[5] * q.w,
                         m[6] * q.x + m[7] * q.y + m[8] * q.w);
    }
    double3 n = cross(p[1] - p[0], p[2] - p[0]);
    double size = sqrt(dot(n, n));
    return convert_float3(size > 0.0 ? n / size : n);
}
#endif

#if VERTEX_COLOR()
static inline void load_color(const Scene *scene, Shaded *s, uint index, int corner)
{
#if VERTEX_ALPHA()
    float4 color = vload4(index, scene->vertex_colors);
    s->color[corner] = color.xyz, s->alpha[corner] = color.w;
#else
    s->color[corner] = vload3(index, scene->vertex_colors);
#endif
}
#endif

static Shaded load_shaded(const Scene *scene, uint path)
{
    Shaded s;
    s.path = scene->paths[path], s.mesh = scene->meshes[s.path.mesh];
    s.material = scene->materials[s.mesh.material];
    s.segment = (s.path.a - s.mesh.vertex) / s.mesh.count;
    return s;
}

#if GLOSSY()
static void load_heights(const Scene *scene, Shaded *s)
{
    s->shear = load_shear(scene->cameras, scene->meshes + s->path.mesh, s->path);
    for (int i = 0; i < 6; i++) {
        Vertex v = scene->vertices[corner_vertex(s->path, i)];
        s->height[i] = s->shear.any ? (float)shear_height(&s->shear, i / 3, v.x, v.y, v.w) : 0.0f;
    }
}
#endif

static void load_corners(const Scene *scene, Shaded *s)
{
    Mesh mesh = s->mesh;
#if GLOSSY()
    load_heights(scene, s);
#endif
    for (int i = 0; i < 6; i++) {
        s->uv[i] = 0.0f, s->normal[i] = 0.0f, s->color[i] = 1.0f;
#if VERTEX_ALPHA()
        s->alpha[i] = 1.0f;
#endif
#if LENS()
        s->circle[i] = (float)scene->vertices[corner_vertex(s->path, i)].circle;
#endif
#if TEXTURED()
        if (mesh.uv != NONE)
            s->uv[i] = vload2(attribute_index(s, mesh.uv, mesh.uv_step, i), scene->uvs);
#endif
#if VERTEX_COLOR()
        if (mesh.color != NONE)
            load_color(scene, s, attribute_index(s, mesh.color, mesh.color_step, i), i);
#endif
#if LIT()
        if (mesh.normal != NONE)
            s->normal[i] = vload3(attribute_index(s, mesh.normal, mesh.normal_step, i),
                                  scene->normals);
#endif
    }
#if LIT()
    if (mesh.normal == NONE && (s->material.flags & MATERIAL_LIT))
        for (int end = 0; end < 2; end++)
            s->normal[3 * end] = s->normal[3 * end + 1] = s->normal[3 * end + 2]
                = face_normal(scene, s, end);
#endif
}

#if TEXTURED()
static INLINED void blend_uv(const Shaded *s, const Weights *weights, Attributes *a)
{
#if LARGE_UV()
    LaneDoubles u = 0.0, v = 0.0;
    for (int i = 0; i < 6; i++) u += weights[i] * s->uv[i].x, v += weights[i] * s->uv[i].y;
    a->u = to_lanes(u), a->v = to_lanes(v);
    a->u_within = to_lanes(u - 2.0 * floor(0.5 * u)); // two of what is mirrored are one
    a->v_within = to_lanes(v - 2.0 * floor(0.5 * v));
    a->u_steps = to_lanes(lane_doubles_steps(u)), a->v_steps = to_lanes(lane_doubles_steps(v));
#else
    for (int i = 0; i < 6; i++) a->u += weights[i] * s->uv[i].x, a->v += weights[i] * s->uv[i].y;
#endif
}

// From each lane's texture coordinates to the next one's; 0 in the last.
static INLINED Lanes steps_of_u(const Attributes *a)
{
#if LARGE_UV()
    return a->u_steps;
#else
    return lanes_steps(a->u);
#endif
}

static INLINED Lanes steps_of_v(const Attributes *a)
{
#if LARGE_UV()
    return a->v_steps;
#else
    return lanes_steps(a->v);
#endif
}

// Where a texture is looked up.
static INLINED const Lanes *u_in(Texture texture, const Attributes *a)
{
#if LARGE_UV()
    if (texture.wrap != WRAP_CLAMP) return &a->u_within;
#endif
    return &a->u;
}

static INLINED const Lanes *v_in(Texture texture, const Attributes *a)
{
#if LARGE_UV()
    if (texture.wrap != WRAP_CLAMP) return &a->v_within;
#endif
    return &a->v;
}
#endif

// Attributes at weights of the six corners; those that no effect asks for stay out.
static inline Attributes blend_corners(const Shaded *s, const Weights *given)
{
    Attributes a = {.u = 0.0f, .v = 0.0f, .color = {1.0f, 1.0f, 1.0f}};
#if LARGE_UV()
    Lanes weights[6];
    for (int i = 0; i < 6; i++) weights[i] = to_lanes(given[i]);
#else
    const Lanes *weights = given;
#endif
#if ANISOTROPY()
    Footprint point = {0.0f, 0.0f, 0.0f, 0.0f};
    a.footprint = point;
#endif
#if TEXTURED()
    blend_uv(s, given, &a);
#endif
#if LIT()
    for (int i = 0; i < 6; i++) a.normal = lanes_added(a.normal, weights[i], s->normal[i]);
#endif
#if VERTEX_COLOR()
    a.color.x = a.color.y = a.color.z = 0.0f;
    for (int i = 0; i < 6; i++) a.color = lanes_added(a.color, weights[i], s->color[i]);
#endif
#if VERTEX_ALPHA()
    a.alpha = 0.0f;
    for (int i = 0; i < 6; i++) a.alpha += weights[i] * s->alpha[i];
#endif
#if LENS()
    for (int i = 0; i < 6; i++) a.circle += weights[i] * s->circle[i];
#endif
#if GLOSSY()
    a.height = 0.0f;
    for (int i = 0; i < 6; i++) a.height += weights[i] * s->height[i];
#endif
    return a;
}

#if ALPHA_VARIES()
static INLINED Lanes vertex_alpha(const Attributes *a)
{
#if VERTEX_ALPHA()
    return a->alpha;
#else
    return 1.0f;
#endif
}

// Alpha from 0 to 1, of what vertices and texture say.
static INLINED Lanes untested_alpha(const Shaded *s, Lanes alpha)
{
    if (!(s->path.alpha < 0.0f)) return s->path.alpha;
    return lanes_min(lanes_max(-s->path.alpha * alpha, (Lanes)(0.0f)), (Lanes)(1.0f));
}

// Alpha that counts: 0 or 1 if it is tested.
static INLINED Lanes counted_alpha(const Shaded *s, Lanes alpha)
{
    alpha = untested_alpha(s, alpha);
    if (!(s->path.alpha < 0.0f) || !(s->material.flags & MATERIAL_MASK)) return alpha;
    return alpha >= s->material.cutoff ? (Lanes)(1.0f) : (Lanes)(0.0f);
}
#endif

#if TEXTURED()
// The texture's colours, at mip level `level`; `count` of them matter.
static inline Colors texel_colors(const Scene *scene, uint texture, const Attributes *a,
                                  float level, int count)
{
    const Texture known = scene->textures[texture];
    const Lanes *u = u_in(known, a), *v = v_in(known, a);
#if ANISOTROPY()
    const Filtered filtered = {scene->texels, known, level, scene->numbers.anisotropy};
    return texture_over(&filtered, u, v, &a->footprint, count);
#else
    return texture_at(scene->texels, known, u, v, level, count);
#endif
}
#endif

#if ALPHA_VARIES()
// What vertices and the texture, at its finest level, say of alpha; `count` of them matter.
static INLINED Lanes given_alpha(const Scene *scene, const Shaded *s, const Attributes *a,
                                 int count)
{
    Lanes alpha = vertex_alpha(a);
#if TEXTURED()
    if (s->material.texture != NONE) {
        Texture texture = scene->textures[s->material.texture];
        const Lanes *u = u_in(texture, a), *v = v_in(texture, a);
        alpha *= texture_at(scene->texels, texture, u, v, 0.0f, count).alpha;
    }
#endif
    return alpha;
}

// Alphas that count at weights of a path's corners at its segment's start and end.
static INLINED Lanes alpha_at_weights(const Scene *scene, uint path, const Weights *weights,
                                      int count)
{
    Shaded s = load_shaded(scene, path);
    load_corners(scene, &s);
    Attributes a = blend_corners(&s, weights);
    return counted_alpha(&s, given_alpha(scene, &s, &a, count));
}
#endif

#if ANISOTROPY()
// Nothing where it is not finite, since the triangle is seen edge-on.
static INLINED Lanes footprint_side(LaneDoubles side)
{
    Lanes near = to_lanes(side);
    return fabs(near) < 1e6f ? near : (Lanes)(0.0f);
}

// Find the footprint of samples at (x, y) whose uv are given, of the triangle as it is at tau.
// Share i of a point is e_i over the sum of all e, and e_i is linear on screen: the cross product
// of the two other vertices times (x, y, 1). Through the middle of the lens.
static INLINED void load_footprint(const Scene *scene, const Shaded *s, float tau, Lanes x, Lanes y,
                                   Attributes *a)
{
    double3 vertex[3], all = 0.0, u = 0.0, v = 0.0;
    for (int i = 0; i < 3; i++) {
        Vertex p = scene->vertices[corner_vertex(s->path, i)];
        Vertex q = scene->vertices[corner_vertex(s->path, i + 3)];
        vertex[i] = (double3)(p.x + tau * (q.x - p.x), p.y + tau * (q.y - p.y),
                              p.w + tau * (q.w - p.w));
    }
    for (int i = 0; i < 3; i++) {
        double3 edge = cross(vertex[(i + 1) % 3], vertex[(i + 2) % 3]);
        Uv uv = s->uv[i] + tau * (s->uv[i + 3] - s->uv[i]);
        all += edge, u += (double)uv.x * edge, v += (double)uv.y * edge;
    }
    LaneDoubles at = all.x * to_lane_doubles(x) + all.y * to_lane_doubles(y) + all.z;
    LaneDoubles over = (double)scene->numbers.sample_spacing / at;
#if LARGE_UV()
    LaneDoubles us = (u.x * to_lane_doubles(x) + u.y * to_lane_doubles(y) + u.z) / at;
    LaneDoubles vs = (v.x * to_lane_doubles(x) + v.y * to_lane_doubles(y) + v.z) / at;
#else
    LaneDoubles us = to_lane_doubles(a->u), vs = to_lane_doubles(a->v);
#endif
    a->footprint.u_right = footprint_side((u.x - us * all.x) * over);
    a->footprint.v_right = footprint_side((v.x - vs * all.x) * over);
    a->footprint.u_down = footprint_side((u.y - us * all.y) * over);
    a->footprint.v_down = footprint_side((v.y - vs * all.y) * over);
}
#endif

#if METALLIC()
// Metallic and roughness, with their texture's blue and green (glTF 2.0, 3.9.2).
static void load_gloss(const Scene *scene, const Shaded *s, Attributes *a, float level, int count)
{
    a->gloss.metallic = s->material.metallic, a->gloss.roughness = s->material.roughness;
#if TEXTURED()
    if (s->material.gloss_texture != NONE) {
        Colors texel = texel_colors(scene, s->material.gloss_texture, a, level, count);
        a->gloss.metallic *= texel.z, a->gloss.roughness *= texel.y;
    }
#endif
}
#endif

#if EMISSION()
static Lanes3 with_emission(const Scene *scene, const Shaded *s, const Attributes *a, Lanes3 color,
                            float level, int count)
{
    const float *given = s->material.emission;
    Lanes3 emission = {given[0], given[1], given[2]};
#if TEXTURED()
    if (s->material.emission_texture != NONE) {
        Colors texel = texel_colors(scene, s->material.emission_texture, a, level, count);
        emission.x *= texel.x, emission.y *= texel.y, emission.z *= texel.z;
    }
#endif
    return (Lanes3){color.x + emission.x, color.y + emission.y, color.z + emission.z};
}
#endif

#if LIT()
// The view through the sample's point of the film at the segment's start and end.
static void load_view(const Scene *scene, Shaded *s)
{
    for (int end = 0; end < 2; end++) {
        global const Camera *camera = segment_camera(scene, s, end);
        float ray[3], eye[3];
        for (int i = 0; i < 3; i++) {
            global const double *m = camera->inverse + 3 * i;
            ray[i] = (float)(m[0] * s->place.x + m[1] * s->place.y + m[2]);
            eye[i] = (float)(camera->eye[i] - scene->cameras[0].eye[i]);
        }
        s->ray[end] = (float3)(ray[0], ray[1], ray[2]);
        s->eye[end] = (float3)(eye[0], eye[1], eye[2]);
    }
}

// Rays through the place at times t of the shutter.
static INLINED Lanes3 rays_at(const Shaded *s, Lanes t)
{
    Lanes3 ray = {s->ray[0].x, s->ray[0].y, s->ray[0].z};
    return lanes_added(ray, (t - s->path.open) * (1.0f / path_length(s->path)),
                       s->ray[1] - s->ray[0]);
}

// Unit normals, turned to the viewer where both sides are seen.
static inline Lanes3 normals_seen(const Shaded *s, const Attributes *a, Lanes3 view)
{
    Lanes3 normal = lanes_unit(a->normal);
    if (s->material.flags & MATERIAL_SINGLE_SIDED) return normal;
    return lanes_scaled(normal, lanes_dot(normal, view) < 0.0f ? (Lanes)(-1.0f) : (Lanes)(1.0f));
}
#if GLOSSY()
// From the sheared point, (x, y) on screen, that samples see, to the one that is lit.
static INLINED void undo_shear(const Shaded *s, const Attributes *attributes, Lanes a, Lanes b,
                               Lanes x, Lanes y, Sight *sight)
{
    if (!s->shear.any) return;
    Lanes tau = (sight->t - s->path.open) * (1.0f / path_length(s->path)), moved[3];
    for (int k = 0; k < 3; k++) {
        float a0 = (float)s->shear.tilt[0][0][k], a1 = (float)s->shear.tilt[1][0][k];
        float b0 = (float)s->shear.tilt[0][1][k], b1 = (float)s->shear.tilt[1][1][k];
        moved[k] = attributes->height
                   * (a * (a0 + tau * (a1 - a0)) + b * (b0 + tau * (b1 - b0)));
    }
    Lanes before = lanes_max(sight->w - moved[2], (Lanes)(1e-30f));
    sight->across += (x * moved[2] - moved[0]) / before;
    sight->down += (y * moved[2] - moved[1]) / before;
    sight->w = before;
}
#endif

// Reflected light of what is seen; `count` of them matter.
static Lanes3 reflect_light(const Scene *scene, const Shaded *s, const Attributes *a,
                            Lanes3 color, const Sight *sight, int count)
{
    Lanes t = sight->t, across = sight->across, down = sight->down;
    Lanes tau = (t - s->path.open) * (1.0f / path_length(s->path));
    Lanes3 ray = rays_at(s, t);
    Lanes3 position = {s->eye[0].x, s->eye[0].y, s->eye[0].z};
    position = lanes_added(position, tau, s->eye[1] - s->eye[0]);
#if VIEW_VARIES()
    global const double *m = segment_camera(scene, s, 0)->inverse;
    global const double *n = segment_camera(scene, s, 1)->inverse;
    ray = lanes_added(ray, across, (float3)(m[0], m[3], m[6]));
    ray = lanes_added(ray, down, (float3)(m[1], m[4], m[7]));
    ray = lanes_added(ray, tau * across, (float3)(n[0] - m[0], n[3] - m[3], n[6] - m[6]));
    ray = lanes_added(ray, tau * down, (float3)(n[1] - m[1], n[4] - m[4], n[7] - m[7]));
#endif
    position.x += sight->w * ray.x, position.y += sight->w * ray.y;
    position.z += sight->w * ray.z;
    Lanes3 view = lanes_unit(lanes_scaled(ray, -1.0f));
    LitPoints points = {color, position, normals_seen(s, a, view), view, 0};
#if METALLIC()
    if (s->material.flags & MATERIAL_METALLIC) points.gloss = &a->gloss;
#endif
#if SHADOWS()
    points.lit = a->lit;
#endif
    global const Light *lights = scene->lights;
#if MIRRORS()
    lights += s->mesh.world * scene->numbers.light_count; // those of each world in turn
#endif
    Lanes3 sum = reflected(&s->material, &points, lights, scene->numbers.light_count);
#if LIGHT_AROUND()
#if MIRRORS()
    points.normal = unmirrored(scene, s->mesh.world, points.normal);
    points.view = unmirrored(scene, s->mesh.world, points.view);
#endif
    Lanes3 around = light_around(scene, s->mesh.map, &points, t, count);
    sum.x += around.x, sum.y += around.y, sum.z += around.z;
#endif
    return sum;
}
#endif

#endif
