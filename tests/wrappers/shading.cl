// Texture look-ups, reflected light and powers, one after the other.
#include "shared/shading.h"

#pragma OPENCL FP_CONTRACT OFF

kernel void lookups(global const float4 *texels, global const Texture *textures,
                    global const float *uvs, global const float *levels, uint count,
                    global float *colors)
{
    for (uint i = 0; i < count; i++)
        vstore3(texture_at(texels, textures[0], vload2(i, uvs), levels[i]), i, colors);
}

kernel void reflections(global const Material *materials, global const float *given, uint count,
                        global const Light *lights, uint light_count, global float *colors)
{
    for (uint i = 0; i < count; i++) {
        global const float *row = given + 12 * i;
        vstore3(phong(materials[0], vload3(0, row), vload3(1, row), vload3(2, row), vload3(3, row),
                      lights, light_count), i, colors);
    }
}

kernel void powers(global const float *x, global const float *y, uint count, global float *out)
{
    for (uint i = 0; i < count; i++) out[i] = power(x[i], y[i]);
}
