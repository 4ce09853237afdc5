// Texture look-up, and Phong's reflection model for sixteen places at a time.
#ifndef MB_SHADING_H
#define MB_SHADING_H

#include "shared/lanes.h"
#include "shared/records.h"

static inline float3 load3(global const float *p) { return (float3)(p[0], p[1], p[2]); }

// Sixteen colours, with alpha where it varies over a surface. Those of textures are premultiplied.
typedef struct {
    Lanes x, y, z;
#ifdef ALPHA_VARIES
    Lanes alpha;
#endif
} Colors;

// One level of a texture's mip chain.
typedef struct {
    global const float4 *texels;
    int width, height;
    uint wrap;
} TextureLevel;

static TextureLevel texture_level(global const float4 *texels, Texture texture, uint level)
{
    TextureLevel found = {texels + texture.texel, texture.width, texture.height, texture.wrap};
    for (uint i = 0; i < level; i++) {
        found.texels += found.width * found.height;
        found.width = max(found.width / 2, 1), found.height = max(found.height / 2, 1);
    }
    return found;
}

// Fold whole coordinates of texels, of less than 2^22, into [0, size).
static inline int16 wrap_texels(Lanes i, int size, uint wrap)
{
    if (wrap == WRAP_CLAMP)
        return convert_int16(lanes_min(lanes_max(i, 0.0f), (Lanes)(size - 1.0f)));
    float period = wrap == WRAP_MIRROR ? 2.0f * size : size;
    i -= period * floor((i + 0.5f) / period);
    return convert_int16(i < (float)size ? i : period - 1.0f - i);
}

// Bilinear look-ups at the first `count` places, others are zero; texel centres at one half, v
// points up.
static Colors bilinear(TextureLevel level, Lanes u, Lanes v, int count)
{
    Lanes x = u * (float)level.width - 0.5f, y = (1.0f - v) * (float)level.height - 0.5f;
    x = lanes_min(lanes_max(x, -1e6f), (Lanes)(1e6f)); // a whole number must hold them
    y = lanes_min(lanes_max(y, -1e6f), (Lanes)(1e6f));
    Lanes x0 = floor(x), y0 = floor(y);
    int left[LANES], right[LANES], top[LANES], bottom[LANES];
    vstore16(wrap_texels(x0, level.width, level.wrap), 0, left);
    vstore16(wrap_texels(x0 + 1.0f, level.width, level.wrap), 0, right);
    vstore16(wrap_texels(y0, level.height, level.wrap) * level.width, 0, top);
    vstore16(wrap_texels(y0 + 1.0f, level.height, level.wrap) * level.width, 0, bottom);
    float across[LANES], down[LANES], r[LANES], g[LANES], b[LANES];
#ifdef ALPHA_VARIES
    float alpha[LANES];
#endif
    vstore16(x - x0, 0, across), vstore16(y - y0, 0, down);
    for (int i = 0; i < LANES; i++) {
        float4 texel = 0.0f;
        if (i < count) {
            global const float4 *upper = level.texels + top[i], *lower = level.texels + bottom[i];
            texel = mix(mix(upper[left[i]], upper[right[i]], across[i]),
                        mix(lower[left[i]], lower[right[i]], across[i]), down[i]);
        }
        r[i] = texel.x, g[i] = texel.y, b[i] = texel.z;
#ifdef ALPHA_VARIES
        alpha[i] = texel.w;
#endif
    }
    Colors found = {vload16(0, r), vload16(0, g), vload16(0, b)};
#ifdef ALPHA_VARIES
    found.alpha = vload16(0, alpha);
#endif
    return found;
}

// Trilinear look-ups at mip level `level` and the first `count` places; others are zero.
static Colors texture_at(global const float4 *texels, Texture texture, Lanes u, Lanes v,
                         float level, int count)
{
    level = clamp(level, 0.0f, texture.levels - 1.0f);
    uint below = min((uint)level, texture.levels - 1), above = min(below + 1, texture.levels - 1);
    if (texture.wrap != WRAP_CLAMP)
        u -= floor(u / 2.0f) * 2.0f, v -= floor(v / 2.0f) * 2.0f;
    Colors fine = bilinear(texture_level(texels, texture, below), u, v, count);
    if (above == below || level == below) return fine;
    Colors coarse = bilinear(texture_level(texels, texture, above), u, v, count);
    Lanes part = level - below;
#ifdef ALPHA_VARIES
    fine.alpha = mix(fine.alpha, coarse.alpha, part);
#endif
    fine.x = mix(fine.x, coarse.x, part), fine.y = mix(fine.y, coarse.y, part);
    fine.z = mix(fine.z, coarse.z, part);
    return fine;
}

#ifdef ALPHA_VARIES
static inline Colors unpremultiplied(Colors c)
{
    Lanes over = c.alpha > 0.0f ? 1.0f / c.alpha : (Lanes)(0.0f);
    c.x *= over, c.y *= over, c.z *= over;
    return c;
}
#endif

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
                    Lanes3 view, global const Light *lights,
#ifdef SHADOWS
                    const Lanes *lit,
#endif
                    uint light_count)
{
    Lanes3 sum = {0.0f, 0.0f, 0.0f};
    const float *specular = material->specular;
    bool shiny = specular[0] != 0.0f || specular[1] != 0.0f || specular[2] != 0.0f;
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
        if (light.kind != LIGHT_DIRECTIONAL) {
            towards.x -= position.x, towards.y -= position.y, towards.z -= position.z;
            strength = 1.0f / lanes_max(lanes_dot(towards, towards), 1e-30f); // in it, too
            towards = lanes_scaled(towards, sqrt(strength));
        }
#endif
#ifdef SPOT_LIGHTS
        if (light.kind == LIGHT_SPOT) {
            Lanes3 axis = {light.axis[0], light.axis[1], light.axis[2]};
            Lanes cone = light.cone[0] * lanes_dot(axis, towards) + light.cone[1];
            cone = lanes_min(lanes_max(cone, (Lanes)(0.0f)), (Lanes)(1.0f));
            strength *= cone * cone;
        }
#endif
#ifdef SHADOWS
        if (light.shadow != NONE) strength *= lit[light.shadow];
#endif
        Lanes cosine = lanes_dot(normal, towards);
        cosine = cosine > 0.0f ? cosine : (Lanes)(0.0f);
        Lanes highlight = 0.0f;
        if (shiny) {
            Lanes reflected = 2.0f * cosine * lanes_dot(normal, view) - lanes_dot(towards, view);
            int16 shines = (reflected > 0.0f) & (cosine > 0.0f);
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
