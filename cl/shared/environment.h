// Light from all around on surfaces: what they scatter of it, and what they mirror.
//
// Mirrored light is a product of two (Karis 2013, "Real Shading in Unreal Engine 4"): the mean of
// what lies around the mirrored direction, from a level of a cube map, and what the microfacets
// reflect of light that is the same from everywhere, from a table.
#ifndef MB_ENVIRONMENT_H
#define MB_ENVIRONMENT_H

#include "shared/effects.h"
#include "shared/cube_map.h"
#if METALLIC()
#include "shared/panorama.h"
#endif
#include "shared/scene.h"
#include "shared/shading.h"

#define IRRADIANCE_SIZE 16u // of the cube for Lambert's surfaces

#if METALLIC()

#define SHARE_COLUMNS 64 // of the table, from a cosine to the view of 0 to one of 1
#define SHARE_ROWS 32    // from a roughness of 0 to one of 1

// What facets reflect of light that is the same from everywhere: of white ones and in addition to
// their own colour; and what Fresnel's term takes from the light that is scattered.
typedef struct {
    Lanes factor, added, lost;
} Shares;

static INLINED Shares shares_at(global const float4 *table, Lanes cosine, Lanes roughness,
                                int count)
{
    float x[LANES], y[LANES], found[3][LANES];
    lanes_store(cosine * (SHARE_COLUMNS - 1.0f), x);
    lanes_store(roughness * (SHARE_ROWS - 1.0f), y);
    for (int i = 0; i < LANES; i++) {
        int from = min(i, count - 1);
        int column = min((int)x[from], SHARE_COLUMNS - 2), row = min((int)y[from], SHARE_ROWS - 2);
        global const float4 *corner = table + row * SHARE_COLUMNS + column;
        float4 share = mix(mix(corner[0], corner[1], x[from] - column),
                           mix(corner[SHARE_COLUMNS], corner[SHARE_COLUMNS + 1], x[from] - column),
                           y[from] - row);
        found[0][i] = share.x, found[1][i] = share.y, found[2][i] = share.z;
    }
    return (Shares){lanes_load(found[0]), lanes_load(found[1]), lanes_load(found[2])};
}

// Level of a map at which light is spread as by facets of that alpha: from 1 on alpha doubles from
// level to level, to 1 at the last; level 0 is a mirror.
static INLINED Lanes level_of(const CubeMap *map, Lanes alpha)
{
    Lanes x = alpha * (float)(1u << (max(map->levels, 2u) - 2u));
    LaneInts exponent = to_lane_ints(lanes_to_bits(x) >> 23) - 127;
    Lanes part = bits_to_lanes((lanes_to_bits(x) & 0x007fffffu) | 0x3f800000u); // [1, 2)
    return x < 1.0f ? x : to_lanes(exponent) + part;
}

#endif

// The direction that points with these normals mirror to `view`.
static inline Lanes3 mirrored_way(Lanes3 normal, Lanes3 view)
{
    Lanes twice = 2.0f * lanes_dot(normal, view);
    return (Lanes3){twice * normal.x - view.x, twice * normal.y - view.y,
                    twice * normal.z - view.z};
}

#if METALLIC()

// Light that facets of `alpha` mirror, around these directions at times t. A clear mirror shows the
// picture of the environment itself, which the first level is of.
static Lanes3 mirrored_light(const Scene *scene, uint map, const Lanes3 *way, const Lanes *alpha,
                             const Lanes *t, int count)
{
    CubeMap seen = scene->maps[map];
    Lanes level = level_of(&seen, *alpha);
#if ENVIRONMENT()
    Lanes clear = lanes_max(1.0f - level, (Lanes)(0.0f));
    if (map == 0u) level = lanes_max(level, (Lanes)(1.0f));
#endif
    Lanes3 light = cube_light(&seen, scene->map_texels, *way, &level, t, count);
#if ENVIRONMENT()
    if (map == 0u && lanes_greatest(clear) > 0.0f) {
        const Picture picture = {*scene->panorama, scene->panorama_texels};
        Patches at = patches_of(scene->panorama, *way, (Lanes)(0.0f));
        Lanes3 sharp = picture_points(&picture, &at, count);
        light = lanes_plus(light, clear, lanes_minus(sharp, light));
    }
#endif
    return light;
}

#endif

// What surfaces reflect to `view` of the light around them at times t: they scatter that of the
// environment, and mirror that of the cube map `map`. `count` of them matter.
static INLINED Lanes3 light_around(const Scene *scene, uint map, const LitPoints *points, Lanes t,
                                   int count)
{
    Lanes3 color = points->color;
    const Lanes3 normal = points->normal, view = points->view;
    Lanes3 sum = {0.0f, 0.0f, 0.0f};
#if METALLIC()
    const Gloss *gloss = points->gloss;
    Facets facets;
    Shares shares;
    if (gloss) {
        facets = facets_of(gloss, color);
        Lanes cosine = lanes_min(lanes_max(lanes_dot(normal, view), (Lanes)(0.0f)), (Lanes)(1.0f));
        shares = shares_at(scene->map_texels, cosine, sqrt(facets.alpha), count);
        color.x = facets.diffuse.x * (1.0f - facets.mirrored.x) * (1.0f - shares.lost);
        color.y = facets.diffuse.y * (1.0f - facets.mirrored.y) * (1.0f - shares.lost);
        color.z = facets.diffuse.z * (1.0f - facets.mirrored.z) * (1.0f - shares.lost);
    }
#endif
#if ENVIRONMENT()
    CubeMap around = scene->maps[0];
    around.levels = 1u, around.size[0] = IRRADIANCE_SIZE, around.first[0] = around.irradiance;
    Lanes finest = 0.0f;
    Lanes3 scattered = cube_light(&around, scene->map_texels, normal, &finest, &t, count);
    sum.x = color.x * scattered.x, sum.y = color.y * scattered.y, sum.z = color.z * scattered.z;
#endif
#if METALLIC()
    if (gloss) {
        Lanes3 way = mirrored_way(normal, view);
        Lanes3 mirrored = mirrored_light(scene, map, &way, &facets.alpha, &t, count);
        sum.x += mirrored.x * (facets.mirrored.x * shares.factor + shares.added);
        sum.y += mirrored.y * (facets.mirrored.y * shares.factor + shares.added);
        sum.z += mirrored.z * (facets.mirrored.z * shares.factor + shares.added);
    }
#endif
    return sum;
}

#endif
