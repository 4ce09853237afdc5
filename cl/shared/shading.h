// Texture look-up, and models of reflection, for sixteen places at a time.
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

#ifdef ANISOTROPY

// How texture coordinates change from a sample to where the next one would be, to the right and
// down.
typedef struct {
    Lanes u_right, v_right, u_down, v_down;
} Footprint;

static inline float4 texel_in(TextureLevel level, float u, float v)
{
    float x = clamp(u * level.width - 0.5f, -1e6f, 1e6f);
    float y = clamp((1.0f - v) * level.height - 0.5f, -1e6f, 1e6f);
    float x0 = floor(x), y0 = floor(y);
    int16 columns = wrap_texels(x0 + LANE_INDEX, level.width, level.wrap);
    int16 rows = wrap_texels(y0 + LANE_INDEX, level.height, level.wrap);
    global const float4 *upper = level.texels + rows.s0 * level.width;
    global const float4 *lower = level.texels + rows.s1 * level.width;
    return mix(mix(upper[columns.s0], upper[columns.s1], x - x0),
               mix(lower[columns.s0], lower[columns.s1], x - x0), y - y0);
}

static float4 trilinear_texel(global const float4 *texels, Texture texture, float u, float v,
                              float level)
{
    level = clamp(level, 0.0f, texture.levels - 1.0f);
    uint below = min((uint)level, texture.levels - 1);
    float4 fine = texel_in(texture_level(texels, texture, below), u, v);
    if (level == below) return fine;
    return mix(fine, texel_in(texture_level(texels, texture, below + 1), u, v), level - below);
}

// Length of the footprint's shorter side in texels, at least one, and at least a part of the
// longer.
static inline float shorter_side(Texture texture, float2 right, float2 down)
{
    float2 size = (float2)(texture.width, texture.height), a = right * size, b = down * size;
    float longer = sqrt(fmax(dot(a, a), dot(b, b)));
    float shorter = longer > 0.0f ? fabs(a.x * b.y - a.y * b.x) / longer : 0.0f;
    return fmax(fmax(shorter, longer / ANISOTROPY), 1.0f);
}

// A texture's mean over the footprint of one sample: a row of look-ups along its longer side, at
// the mip level of its shorter side, or of a part of the longer one if that is larger (after
// McCormack et al. 1999, Feline). `least` is the lowest level.
static float4 texel_over(global const float4 *texels, Texture texture, float2 uv, float2 right,
                         float2 down, float least)
{
    float2 size = (float2)(texture.width, texture.height), a = right * size, b = down * size;
    bool wider = dot(a, a) >= dot(b, b);
    float longer = sqrt(wider ? dot(a, a) : dot(b, b));
    float shorter = shorter_side(texture, right, down);
    int looks = clamp((int)ceil(longer / shorter - 0.01f), 1, ANISOTROPY);
    float level = fmax(log2(shorter), least);
    float2 along = (wider ? right : down) / looks;
    float4 sum = 0.0f;
    for (int k = 0; k < looks; k++) {
        float2 at = uv + along * (k - 0.5f * (looks - 1));
        if (texture.wrap != WRAP_CLAMP) at -= 2.0f * floor(at / 2.0f);
        sum += trilinear_texel(texels, texture, at.x, at.y, level);
    }
    return sum / looks;
}

// Likewise of sixteen, the first `count` of which matter; others are zero.
static Colors texture_over(global const float4 *texels, Texture texture, Lanes u, Lanes v,
                           const Footprint *f, float least, int count)
{
    float us[LANES], vs[LANES], u_right[LANES], v_right[LANES], u_down[LANES], v_down[LANES];
    vstore16(u, 0, us), vstore16(v, 0, vs);
    vstore16(f->u_right, 0, u_right), vstore16(f->v_right, 0, v_right);
    vstore16(f->u_down, 0, u_down), vstore16(f->v_down, 0, v_down);
    float found[4][LANES];
    for (int i = 0; i < LANES; i++) {
        float4 texel = 0.0f;
        if (i < count)
            texel = texel_over(texels, texture, (float2)(us[i], vs[i]),
                               (float2)(u_right[i], v_right[i]), (float2)(u_down[i], v_down[i]),
                               least);
        found[0][i] = texel.x, found[1][i] = texel.y, found[2][i] = texel.z;
        found[3][i] = texel.w;
    }
    Colors c = {vload16(0, found[0]), vload16(0, found[1]), vload16(0, found[2])};
#ifdef ALPHA_VARIES
    c.alpha = vload16(0, found[3]);
#endif
    return c;
}

#endif

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

// Of a metallic-roughness material, at sixteen places.
typedef struct {
    Lanes metallic, roughness;
} Gloss;

#ifdef METALLIC

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
static inline Lanes ambient_of(Lanes diffuse, Lanes mirrored)
{
    return diffuse * (1.0f - mirrored) + mirrored;
}

// Part of Smith's masking: 1 / (cosine + sqrt(alpha^2 + (1 - alpha^2) cosine^2)).
static inline Lanes unmasked(Lanes cosine, Lanes alpha)
{
    Lanes square = alpha * alpha;
    return 1.0f / (cosine + sqrt(square + (1.0f - square) * cosine * cosine));
}

// pi times the metallic-roughness model of glTF 2.0, appendix B.3, times the cosine of the light:
// Lambert's, and GGX (Trowbridge & Reitz 1975, Walter et al. 2007) with Smith's masking, side by
// side, and Schlick's approximation of Fresnel between them.
static Lanes3 facets_reflect(const Facets *f, Lanes3 normal, Lanes3 view, Lanes3 towards,
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

// Light reflected to `view` (towards the eye) by points with unit normals: by Phong's model (1975),
// or by that of glTF where the surface has a gloss. Without a factor of pi: a white wall that faces
// a light of colour 1 has colour 1.
static Lanes3 reflected(const Material *material, const Gloss *gloss, Lanes3 color,
                        Lanes3 position, Lanes3 normal, Lanes3 view, global const Light *lights,
#ifdef SHADOWS
                        const Lanes *lit,
#endif
                        uint light_count)
{
#ifdef METALLIC
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
#ifdef METALLIC
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
#ifdef METALLIC
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
