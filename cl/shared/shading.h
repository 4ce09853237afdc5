// Models of reflection for sixteen places at a time.
#ifndef MB_SHADING_H
#define MB_SHADING_H

#include "shared/effects.h"
#include "shared/vectors.h"
#include "shared/records.h"

// x^y for 0 < x <= 1 and y >= 0, to 1e-7 of the logarithm and 0 below 2^-40: by the series of
// artanh for log2 and of exp. Devices' own pow serves all arguments, at ten times the cost, and its
// tails are denormals, which cost a hundred cycles each.
static INLINED Lanes lanes_power(Lanes x, float y)
{
    LaneInts exponent = to_lane_ints(lanes_to_bits(x) >> 23) - 127;
    Lanes m = bits_to_lanes((lanes_to_bits(x) & 0x007fffffu) | 0x3f800000u); // [1, 2)
    LaneInts large = m > M_SQRT2_F;
    m = large ? 0.5f * m : m;
    exponent -= large; // true is -1
    Lanes s = (m - 1.0f) / (m + 1.0f), q = s * s;
    Lanes series = 1.0f + q * (1.0f / 3.0f + q * (0.2f + q * (1.0f / 7.0f + q * (1.0f / 9.0f))));
    Lanes z = y * (to_lanes(exponent) + 2.0f * M_LOG2E_F * s * series);
    LaneInts seen = z > -40.0f;
    z = seen ? z : (Lanes)(0.0f);
    LaneInts whole = to_lane_ints(z - 0.5f);
    Lanes f = (z - to_lanes(whole)) * M_LN2_F;
    Lanes e = 1.0f + f * (1.0f + f * (0.5f + f * (1.0f / 6.0f + f * (1.0f / 24.0f
              + f * (1.0f / 120.0f + f * (1.0f / 720.0f + f * (1.0f / 5040.0f)))))));
    return seen ? e * bits_to_lanes((whole + 127) << 23) : (Lanes)(0.0f);
}

// Of a metallic-roughness material, at sixteen places.
typedef struct {
    Lanes metallic, roughness;
} Gloss;

#if METALLIC()

#define LEAST_ROUGHNESS 0.03f // lights are points: below it a highlight would only be missed

// What a surface reflects where it faces the light, by Lambert and by the microfacets: colour that
// is scattered, that is mirrored head-on, and the distribution's alpha.
typedef struct {
    Lanes3 diffuse, mirrored;
    Lanes alpha;
} Facets;

static Facets facets_of(const Gloss *gloss, Lanes3 color)
{
    Lanes metal = lanes_min(lanes_max(gloss->metallic, (Lanes)(0.0f)), (Lanes)(1.0f));
    Lanes rough = lanes_min(lanes_max(gloss->roughness, LEAST_ROUGHNESS), (Lanes)(1.0f));
    Lanes dielectric = 0.04f * (1.0f - metal);
    Facets f;
    f.diffuse = lanes_scaled(color, 1.0f - metal);
    f.mirrored = lanes_scaled(color, metal);
    f.mirrored.x += dielectric, f.mirrored.y += dielectric, f.mirrored.z += dielectric;
    f.alpha = rough * rough;
    return f;
}

// One channel of what ambient light, the same from all sides, makes of the facets: as if it came
// head-on.
static INLINED Lanes ambient_of(Lanes diffuse, Lanes mirrored)
{
    return diffuse * (1.0f - mirrored) + mirrored;
}

// Part of Smith's masking: 1 / (cosine + sqrt(alpha^2 + (1 - alpha^2) cosine^2)).
static INLINED Lanes unmasked(Lanes cosine, Lanes alpha)
{
    Lanes square = alpha * alpha;
    return 1.0f / (cosine + sqrt(square + (1.0f - square) * cosine * cosine));
}

// pi times the metallic-roughness model of glTF 2.0, appendix B.3, times the cosine of the light:
// Lambert's, and GGX (Trowbridge & Reitz 1975, Walter et al. 2007) with Smith's masking, side by
// side, and Schlick's approximation of Fresnel between them.
static INLINED Lanes3 facets_reflect(const Facets *f, Lanes3 normal, Lanes3 view, Lanes3 towards,
                                     Lanes cosine)
{
    Lanes3 half_way = {towards.x + view.x, towards.y + view.y, towards.z + view.z};
    half_way = lanes_unit(half_way);
    Lanes3 c = {normal.y * half_way.z - normal.z * half_way.y,
                normal.z * half_way.x - normal.x * half_way.z,
                normal.x * half_way.y - normal.y * half_way.x};
    // cosine^2 (alpha^2 - 1) + 1, in the form that doesn't cancel near the highlight
    Lanes along = lanes_dot(normal, half_way), square = f->alpha * f->alpha;
    Lanes spread = lanes_dot(c, c) + square * along * along;
    Lanes facing = fabs(lanes_dot(normal, view));
    Lanes shine = square / (spread * spread) * unmasked(cosine, f->alpha)
                  * unmasked(facing, f->alpha);
    shine = along > 0.0f ? shine : (Lanes)(0.0f);
    Lanes grazing = 1.0f - lanes_min(fabs(lanes_dot(view, half_way)), (Lanes)(1.0f));
    Lanes fifth = grazing * grazing;
    fifth = fifth * fifth * grazing;
    Lanes3 sum;
#define CHANNEL(k) { \
        Lanes fresnel = f->mirrored.k + (1.0f - f->mirrored.k) * fifth; \
        sum.k = cosine * ((1.0f - fresnel) * f->diffuse.k + fresnel * shine); }
    CHANNEL(x) CHANNEL(y) CHANNEL(z)
#undef CHANNEL
    return sum;
}

#endif

// Points of a surface: colours, places, unit normals and the way to the eye.
typedef struct {
    Lanes3 color, position, normal, view;
    const Gloss *gloss; // of a surface that has one, else 0
#if SHADOWS()
    const Lanes *lit;   // shares of the light of those that cast shadows
#endif
} LitPoints;

// Light reflected to `view` (towards the eye) by points with unit normals: by Phong's model (1975),
// or by that of glTF where the surface has a gloss. Without a factor of pi: a white wall that faces
// a light of colour 1 has colour 1.
static Lanes3 reflected(const Material *material, const LitPoints *points,
                        global const Light *lights, uint light_count)
{
    const Lanes3 color = points->color, position = points->position;
    const Lanes3 normal = points->normal, view = points->view;
#if METALLIC()
    const Gloss *gloss = points->gloss;
    Facets facets;
    if (gloss) facets = facets_of(gloss, color);
#endif
    Lanes3 sum = {0.0f, 0.0f, 0.0f};
    const float *specular = material->specular;
    bool shiny = specular[0] != 0.0f || specular[1] != 0.0f || specular[2] != 0.0f;
    for (uint i = 0; i < light_count; i++) {
        Light light = lights[i];
        float3 arriving = (float3)(light.color[0], light.color[1], light.color[2]);
        if (light.kind == LIGHT_AMBIENT) {
#if METALLIC()
            if (gloss) {
                sum.x += arriving.x * ambient_of(facets.diffuse.x, facets.mirrored.x);
                sum.y += arriving.y * ambient_of(facets.diffuse.y, facets.mirrored.y);
                sum.z += arriving.z * ambient_of(facets.diffuse.z, facets.mirrored.z);
                continue;
            }
#endif
            sum.x += color.x * arriving.x;
            sum.y += color.y * arriving.y;
            sum.z += color.z * arriving.z;
            continue;
        }
        Lanes3 towards = {light.vector[0], light.vector[1], light.vector[2]};
        Lanes strength = 1.0f;
#if POINT_LIGHTS()
        if (light.kind != LIGHT_DIRECTIONAL) {
            towards.x -= position.x, towards.y -= position.y, towards.z -= position.z;
            strength = 1.0f / lanes_max(lanes_dot(towards, towards), 1e-30f); // in it, too
            towards = lanes_scaled(towards, sqrt(strength));
        }
#endif
#if SPOT_LIGHTS()
        if (light.kind == LIGHT_SPOT) {
            Lanes3 axis = {light.axis[0], light.axis[1], light.axis[2]};
            Lanes cone = light.cone[0] * lanes_dot(axis, towards) + light.cone[1];
            cone = lanes_min(lanes_max(cone, (Lanes)(0.0f)), (Lanes)(1.0f));
            strength *= cone * cone;
        }
#endif
#if SHADOWS()
        if (light.shadow != NONE) strength *= points->lit[light.shadow];
#endif
        Lanes cosine = lanes_dot(normal, towards);
        cosine = cosine > 0.0f ? cosine : (Lanes)(0.0f);
#if METALLIC()
        if (gloss) {
            Lanes3 seen = facets_reflect(&facets, normal, view, towards, cosine);
            sum.x += arriving.x * strength * seen.x;
            sum.y += arriving.y * strength * seen.y;
            sum.z += arriving.z * strength * seen.z;
            continue;
        }
#endif
        Lanes highlight = 0.0f;
        if (shiny) {
            Lanes reflected = 2.0f * cosine * lanes_dot(normal, view) - lanes_dot(towards, view);
            LaneInts shines = (reflected > 0.0f) & (cosine > 0.0f);
            reflected = shines ? lanes_min(reflected, (Lanes)(1.0f)) : (Lanes)(1.0f);
            highlight = lanes_power(reflected, material->shininess);
            highlight = shines ? highlight * strength : (Lanes)(0.0f);
        }
        Lanes diffuse = cosine * strength;
        sum.x += arriving.x * (color.x * diffuse + specular[0] * highlight);
        sum.y += arriving.y * (color.y * diffuse + specular[1] * highlight);
        sum.z += arriving.z * (color.z * diffuse + specular[2] * highlight);
    }
    return sum;
}

#endif
