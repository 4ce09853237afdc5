// Texture look-up and Phong's reflection model.
#ifndef MB_SHADING_H
#define MB_SHADING_H

#include "shared/records.h"

static inline float3 load3(global const float *p) { return (float3)(p[0], p[1], p[2]); }

// Fold a texel's coordinate into [0, size).
static inline int wrap_texel(int i, int size, uint wrap)
{
    if (wrap == WRAP_CLAMP) return clamp(i, 0, size - 1);
    int period = wrap == WRAP_MIRROR ? 2 * size : size;
    i %= period;
    if (i < 0) i += period;
    return i < size ? i : 2 * size - 1 - i;
}

// Bilinear look-up in one level; texel centres at one half, v points up.
static float3 texture_level(global const float4 *texels, Texture texture, uint level, float2 uv)
{
    int width = texture.width, height = texture.height;
    for (uint i = 0; i < level; i++) {
        texels += width * height;
        width = max(width / 2, 1), height = max(height / 2, 1);
    }
    float x = uv.x * width - 0.5f, y = (1.0f - uv.y) * height - 0.5f;
    float x0 = floor(x), y0 = floor(y);
    int left = wrap_texel((int)x0, width, texture.wrap);
    int right = wrap_texel((int)x0 + 1, width, texture.wrap);
    int top = wrap_texel((int)y0, height, texture.wrap) * width;
    int bottom = wrap_texel((int)y0 + 1, height, texture.wrap) * width;
    float4 upper = mix(texels[top + left], texels[top + right], x - x0);
    float4 lower = mix(texels[bottom + left], texels[bottom + right], x - x0);
    return mix(upper, lower, y - y0).xyz;
}

// Trilinear look-up at mip level `level`.
static float3 texture_at(global const float4 *texels, Texture texture, float2 uv, float level)
{
    level = clamp(level, 0.0f, texture.levels - 1.0f);
    uint below = min((uint)level, texture.levels - 1), above = min(below + 1, texture.levels - 1);
    texels += texture.texel;
    uv -= floor(uv / 2.0f) * 2.0f * (texture.wrap == WRAP_CLAMP ? 0.0f : 1.0f);
    float3 fine = texture_level(texels, texture, below, uv);
    if (above == below || level == below) return fine;
    return mix(fine, texture_level(texels, texture, above, uv), level - below);
}

// Phong (1975): colour seen from `view` (towards the eye) of a point with unit `normal`.
static float3 phong(Material material, float3 color, float3 position, float3 normal, float3 view,
                    global const Light *lights, uint light_count)
{
    float3 specular_color = (float3)(material.specular[0], material.specular[1],
                                     material.specular[2]);
    float3 sum = 0.0f;
    for (uint i = 0; i < light_count; i++) {
        Light light = lights[i];
        float3 arriving = (float3)(light.color[0], light.color[1], light.color[2]);
        if (light.kind == LIGHT_AMBIENT) {
            sum += color * arriving;
            continue;
        }
        float3 towards = (float3)(light.vector[0], light.vector[1], light.vector[2]);
        if (light.kind == LIGHT_POINT) {
            towards -= position;
            float squared = dot(towards, towards);
            arriving /= squared;
            towards /= sqrt(squared);
        }
        float cosine = dot(normal, towards);
        if (!(cosine > 0.0f)) continue;
        float reflected = dot(2.0f * cosine * normal - towards, view);
        float highlight = reflected > 0.0f ? pow(reflected, material.shininess) : 0.0f;
        sum += arriving * (color * cosine + specular_color * highlight);
    }
    return sum;
}

#endif
