// Texture look-up for sixteen places at a time.
#ifndef MB_TEXTURES_H
#define MB_TEXTURES_H

#include "shared/effects.h"
#include "shared/colors.h"
#include "shared/records.h"

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
static INLINED LaneInts wrap_texels(Lanes i, int size, uint wrap)
{
    if (wrap == WRAP_CLAMP)
        return to_lane_ints(lanes_min(lanes_max(i, 0.0f), (Lanes)(size - 1.0f)));
    float period = wrap == WRAP_MIRROR ? 2.0f * size : size;
    i -= period * floor((i + 0.5f) / period);
    return to_lane_ints(i < (float)size ? i : period - 1.0f - i);
}

// Bilinear look-ups at the first `count` places, others are zero; texel centres at one half, v
// points up.
static Colors bilinear(TextureLevel level, const Lanes *u, const Lanes *v, int count)
{
    Lanes x = *u * (float)level.width - 0.5f, y = (1.0f - *v) * (float)level.height - 0.5f;
    x = lanes_min(lanes_max(x, -1e6f), (Lanes)(1e6f)); // a whole number must hold them
    y = lanes_min(lanes_max(y, -1e6f), (Lanes)(1e6f));
    Lanes x0 = floor(x), y0 = floor(y);
    int left[LANES], right[LANES], top[LANES], bottom[LANES];
    lanes_store(wrap_texels(x0, level.width, level.wrap), left);
    lanes_store(wrap_texels(x0 + 1.0f, level.width, level.wrap), right);
    lanes_store(wrap_texels(y0, level.height, level.wrap) * level.width, top);
    lanes_store(wrap_texels(y0 + 1.0f, level.height, level.wrap) * level.width, bottom);
    float across[LANES], down[LANES], r[LANES], g[LANES], b[LANES];
#if ALPHA_VARIES()
    float alpha[LANES];
#endif
    lanes_store(x - x0, across), lanes_store(y - y0, down);
    for (int i = 0; i < LANES; i++) {
        float4 texel = 0.0f;
        if (i < count) {
            global const float4 *upper = level.texels + top[i], *lower = level.texels + bottom[i];
            texel = mix(mix(upper[left[i]], upper[right[i]], across[i]),
                        mix(lower[left[i]], lower[right[i]], across[i]), down[i]);
        }
        r[i] = texel.x, g[i] = texel.y, b[i] = texel.z;
#if ALPHA_VARIES()
        alpha[i] = texel.w;
#endif
    }
    Colors found = {lanes_load(r), lanes_load(g), lanes_load(b)};
#if ALPHA_VARIES()
    found.alpha = lanes_load(alpha);
#endif
    return found;
}

// Trilinear look-ups at mip level `level` and the first `count` places; others are zero.
static Colors texture_at(global const float4 *texels, Texture texture, const Lanes *us,
                         const Lanes *vs, float level, int count)
{
    Lanes u = *us, v = *vs;
    level = clamp(level, 0.0f, texture.levels - 1.0f);
    uint below = min((uint)level, texture.levels - 1), above = min(below + 1, texture.levels - 1);
    if (texture.wrap != WRAP_CLAMP)
        u -= floor(u / 2.0f) * 2.0f, v -= floor(v / 2.0f) * 2.0f;
    Colors fine = bilinear(texture_level(texels, texture, below), &u, &v, count);
    if (above == below || level == below) return fine;
    Colors coarse = bilinear(texture_level(texels, texture, above), &u, &v, count);
    Lanes part = level - below;
#if ALPHA_VARIES()
    fine.alpha = mix(fine.alpha, coarse.alpha, part);
#endif
    fine.x = mix(fine.x, coarse.x, part), fine.y = mix(fine.y, coarse.y, part);
    fine.z = mix(fine.z, coarse.z, part);
    return fine;
}

#if ANISOTROPY()

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
    LaneInts columns = wrap_texels(x0 + LANE_INDEX, level.width, level.wrap);
    LaneInts rows = wrap_texels(y0 + LANE_INDEX, level.height, level.wrap);
    global const float4 *upper = level.texels + LANE(int, rows, 0) * level.width;
    global const float4 *lower = level.texels + LANE(int, rows, 1) * level.width;
    int left = LANE(int, columns, 0), right = LANE(int, columns, 1);
    return mix(mix(upper[left], upper[right], x - x0), mix(lower[left], lower[right], x - x0),
               y - y0);
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
// longer: `most` looks cover that.
static inline float shorter_side(Texture texture, float2 right, float2 down, int most)
{
    float2 size = (float2)(texture.width, texture.height), a = right * size, b = down * size;
    float longer = sqrt(fmax(dot(a, a), dot(b, b)));
    float shorter = longer > 0.0f ? fabs(a.x * b.y - a.y * b.x) / longer : 0.0f;
    return fmax(fmax(shorter, longer / most), 1.0f);
}

// A texture that is looked at up to `most` times for a sample, at mip level `least` or higher.
typedef struct {
    global const float4 *texels;
    Texture texture;
    float least;
    int most;
} Filtered;

// A texture's mean over the footprint of one sample: a row of look-ups along its longer side, at
// the mip level of its shorter side, or of a part of the longer one if that is larger (after
// McCormack et al. 1999, Feline).
static float4 texel_over(const Filtered *f, float2 uv, float2 right, float2 down)
{
    const Texture texture = f->texture;
    float2 size = (float2)(texture.width, texture.height), a = right * size, b = down * size;
    bool wider = dot(a, a) >= dot(b, b);
    float longer = sqrt(wider ? dot(a, a) : dot(b, b));
    float shorter = shorter_side(texture, right, down, f->most);
    int looks = clamp((int)ceil(longer / shorter - 0.01f), 1, f->most);
    float level = fmax(log2(shorter), f->least);
    float2 along = (wider ? right : down) / looks;
    float4 sum = 0.0f;
    for (int k = 0; k < looks; k++) {
        float2 at = uv + along * (k - 0.5f * (looks - 1));
        if (texture.wrap != WRAP_CLAMP) at -= 2.0f * floor(at / 2.0f);
        sum += trilinear_texel(f->texels, texture, at.x, at.y, level);
    }
    return sum / looks;
}

// Likewise of sixteen, the first `count` of which matter; others are zero.
static Colors texture_over(const Filtered *filtered, const Lanes *u, const Lanes *v,
                           const Footprint *f, int count)
{
    float us[LANES], vs[LANES], u_right[LANES], v_right[LANES], u_down[LANES], v_down[LANES];
    lanes_store(*u, us), lanes_store(*v, vs);
    lanes_store(f->u_right, u_right), lanes_store(f->v_right, v_right);
    lanes_store(f->u_down, u_down), lanes_store(f->v_down, v_down);
    float found[4][LANES];
    for (int i = 0; i < LANES; i++) {
        float4 texel = 0.0f;
        if (i < count)
            texel = texel_over(filtered, (float2)(us[i], vs[i]), (float2)(u_right[i], v_right[i]),
                               (float2)(u_down[i], v_down[i]));
        found[0][i] = texel.x, found[1][i] = texel.y, found[2][i] = texel.z;
        found[3][i] = texel.w;
    }
    Colors c = {lanes_load(found[0]), lanes_load(found[1]), lanes_load(found[2])};
#if ALPHA_VARIES()
    c.alpha = lanes_load(found[3]);
#endif
    return c;
}

#endif

#endif
