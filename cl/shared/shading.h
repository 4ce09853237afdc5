// Texture look-up, and Phong's reflection model for sixteen places at a time.
#ifndef MB_SHADING_H
#define MB_SHADING_H

#include "shared/lanes.h"
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
    x = clamp(x, -1e6f, 1e6f), y = clamp(y, -1e6f, 1e6f); // a whole number must hold them
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
    if (texture.wrap != WRAP_CLAMP) uv -= floor(uv / 2.0f) * 2.0f;
    float3 fine = texture_level(texels, texture, below, uv);
    if (above == below || level == below) return fine;
    return mix(fine, texture_level(texels, texture, above, uv), level - below);
}

// x^y for 0 < x <= 1 and y >= 0, to 1e-7 of the logarithm and 0 below 2^-40: by the series of
// artanh for log2 and of exp. Devices' own pow serves all arguments, at ten times the cost, and its
// tails are denormals, which cost a hundred cycles each.
static inline Lanes lanes_power(Lanes x, float y)
{
    int16 exponent = convert_int16(as_uint16(x) >> 23) - 127;
    Lanes m = as_float16((as_uint16(x) & 0x007fffffu) | 0x3f800000u); // [1, 2)
    int16 large = m > M_SQRT2_F;
    m = large ? 0.5f * m : m;
    exponent -= large; // true is -1
    Lanes s = (m - 1.0f) / (m + 1.0f), q = s * s;
    Lanes series = 1.0f + q * (1.0f / 3.0f + q * (0.2f + q * (1.0f / 7.0f + q * (1.0f / 9.0f))));
    Lanes z = y * (convert_float16(exponent) + 2.0f * M_LOG2E_F * s * series);
    int16 seen = z > -40.0f;
    z = seen ? z : (Lanes)(0.0f);
    int16 whole = convert_int16(z - 0.5f);
    Lanes f = (z - convert_float16(whole)) * M_LN2_F;
    Lanes e = 1.0f + f * (1.0f + f * (0.5f + f * (1.0f / 6.0f + f * (1.0f / 24.0f
              + f * (1.0f / 120.0f + f * (1.0f / 720.0f + f * (1.0f / 5040.0f)))))));
    return seen ? e * as_float16((whole + 127) << 23) : (Lanes)(0.0f);
}

// Phong (1975): colour seen from `view` (towards the eye) of points with unit normals.
static Lanes3 phong(const Material *material, Lanes3 color, Lanes3 position, Lanes3 normal,
                    Lanes3 view, global const Light *lights, uint light_count)
{
    Lanes3 sum = {0.0f, 0.0f, 0.0f};
    for (uint i = 0; i < light_count; i++) {
        Light light = lights[i];
        float3 arriving = (float3)(light.color[0], light.color[1], light.color[2]);
        if (light.kind == LIGHT_AMBIENT) {
            sum.x += color.x * arriving.x;
            sum.y += color.y * arriving.y;
            sum.z += color.z * arriving.z;
            continue;
        }
        Lanes3 towards = {light.vector[0], light.vector[1], light.vector[2]};
        Lanes strength = 1.0f;
#ifdef POINT_LIGHTS
        if (light.kind == LIGHT_POINT) {
            towards.x -= position.x, towards.y -= position.y, towards.z -= position.z;
            strength = 1.0f / lanes_max(lanes_dot(towards, towards), 1e-30f); // in it, too
            towards = lanes_scaled(towards, sqrt(strength));
        }
#endif
        Lanes cosine = lanes_dot(normal, towards);
        cosine = cosine > 0.0f ? cosine : (Lanes)(0.0f);
        Lanes reflected = 2.0f * cosine * lanes_dot(normal, view) - lanes_dot(towards, view);
        int16 shines = (reflected > 0.0f) & (cosine > 0.0f);
        Lanes highlight = lanes_power(shines ? lanes_min(reflected, (Lanes)(1.0f)) : (Lanes)(1.0f),
                                      material->shininess);
        highlight = shines ? highlight * strength : (Lanes)(0.0f);
        Lanes diffuse = cosine * strength;
        sum.x += arriving.x * (color.x * diffuse + material->specular[0] * highlight);
        sum.y += arriving.y * (color.y * diffuse + material->specular[1] * highlight);
        sum.z += arriving.z * (color.z * diffuse + material->specular[2] * highlight);
    }
    return sum;
}

#endif
