// Texture look-ups, reflected light and powers, one after the other.
#include "shared/effects.h"
#include "shared/textures.h"
#include "shared/shading.h"

#pragma OPENCL FP_CONTRACT OFF

#if ALPHA_VARIES()
kernel void lookups(global const float4 *texels, global const Texture *textures,
                    global const float *uvs, global const float *levels, uint count,
                    global float *colors)
{
    for (uint i = 0; i < count; i++) {
        Lanes u = uvs[2 * i], v = uvs[2 * i + 1];
        Colors found = texture_at(texels, textures[0], &u, &v, levels[i], 6);
        vstore4((float4)(LANE3(found, 5), LANE(float, found.alpha, 5)), i, colors);
    }
}
#endif

#if ANISOTROPY()
kernel void footprints(global const float4 *texels, global const Texture *textures,
                       global const float *given, uint count, int most, global float *colors)
{
    for (uint i = 0; i < count; i++) {
        global const float *g = given + 7 * i;
        Footprint f = {g[2], g[3], g[4], g[5]};
        Lanes u = g[0], v = g[1];
        Filtered filtered = {texels, textures[0], g[6], most};
        Colors found = texture_over(&filtered, &u, &v, &f, 6);
        vstore3(LANE3(found, 5), i, colors);
    }
}
#endif

kernel void reflections(global const Material *materials, global const float *given, uint count,
                        global const Light *lights, uint light_count, global float *colors)
{
    for (uint i = 0; i < count; i++) {
        global const float *row = given + 12 * i;
        Lanes3 v[4];
        for (int k = 0; k < 4; k++)
            v[k].x = row[3 * k], v[k].y = row[3 * k + 1], v[k].z = row[3 * k + 2];
        Material material = materials[0];
        Gloss gloss = {material.metallic, material.roughness};
        LitPoints points = {v[0], v[1], v[2], v[3],
                            material.flags & MATERIAL_METALLIC ? &gloss : 0};
        Lanes3 seen = reflected(&material, &points, lights, light_count);
        vstore3(LANE3(seen, 3), i, colors);
    }
}

kernel void powers(global const float *x, global const float *y, uint count, global float *out)
{
    for (uint i = 0; i < count; i++) out[i] = first_lane(lanes_power((Lanes)(x[i]), y[i]));
}
