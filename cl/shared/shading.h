// Texture look-up and Phong's reflection model.
#ifndef MB_SHADING_H
#define MB_SHADING_H

#include "shared/records.h"

// Written out: devices' own versions guard against overflow, at several times the cost.
static inline float dot3(float3 a, float3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline float3 unit(float3 v) { return v * (1.0f / sqrt(dot3(v, v))); }

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

// x^y for 0 < x <= 1 and y >= 0, to 1e-7 of the logarithm, 0 below 2^-40: by the series of artanh for log2 and of exp. The
// devices' own pow serves all arguments and costs ten times as much.
static inline float power(float x, float y)
{
    int exponent = (int)(as_uint(x) >> 23) - 127;
    float m = as_float((as_uint(x) & 0x007fffffu) | 0x3f800000u); // [1, 2)
    if (m > M_SQRT2_F) m *= 0.5f, exponent++;
    float s = (m - 1.0f) / (m + 1.0f), q = s * s;
    float series = 1.0f + q * (1.0f / 3.0f + q * (0.2f + q * (1.0f / 7.0f + q * (1.0f / 9.0f))));
    float log2_x = exponent + 2.0f * M_LOG2E_F * s * series;
    float z = y * log2_x;
    if (!(z > -40.0f)) return 0.0f; // and no denormals, which cost a hundred cycles each
    int whole = (int)(z - 0.5f);
    float f = (z - whole) * M_LN2_F;
    float e = 1.0f + f * (1.0f + f * (0.5f + f * (1.0f / 6.0f + f * (1.0f / 24.0f
              + f * (1.0f / 120.0f + f * (1.0f / 720.0f + f * (1.0f / 5040.0f)))))));
    return e * as_float((uint)(whole + 127) << 23);
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
#ifdef POINT_LIGHTS
        if (light.kind == LIGHT_POINT) {
            towards -= position;
            float squared = dot3(towards, towards);
            arriving /= squared;
            towards /= sqrt(squared);
        }
#endif
        float cosine = dot3(normal, towards);
        if (!(cosine > 0.0f)) continue;
        float reflected = dot3(2.0f * cosine * normal - towards, view);
        float highlight = reflected > 0.0f ? power(fmin(reflected, 1.0f), material.shininess) : 0.0f;
        sum += arriving * (color * cosine + specular_color * highlight);
    }
    return sum;
}

#endif
