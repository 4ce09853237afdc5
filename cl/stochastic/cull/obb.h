// Culling method "obb": the samples of pixels whose eye rays meet an oriented box around the moving
// triangle in homogeneous space (x, y, w) (Akenine-Moeller et al. 2007, 3.3.1). Its first axis
// joins the middles of the triangle's two positions, its second follows the longest edge across it;
// where there is none the box is aligned with the axes. Rays are tested against the box instead of
// rasterizing its backs, so nothing depends on what lies behind the eye. Under a lens the box holds
// all circles of confusion.
//
// Operations: path 417 (435), tile 64, sample 0.
#include "stochastic/cull/box.h"

typedef struct {
    float3 axis[3];
    float low[3], high[3];
} Cull;

typedef struct {
    int unused;
} Bounded;

// Like clip space: x and y in units of half the frame's height, so that axes are about as long.
static inline float3 clip_like(const Tile *tile, float x, float y, float w)
{
    return (float3)((x - tile->middle_x * w) * tile->clip_scale,
                    (y - tile->middle_y * w) * tile->clip_scale, w);
}

static bool box_axes(const float3 *p, float3 *axis)
{
    float3 along = ((p[3] + p[4]) + p[5]) - ((p[0] + p[1]) + p[2]);
    float size = sqrt(dot(along, along)), reach = 0.0f, longest = 0.0f;
    for (int k = 0; k < 6; k++) reach = fmax(reach, dot(p[k], p[k]));
    if (!(size > 1e-5f * sqrt(reach))) return false;
    axis[0] = along / size;
    for (int k = 0; k < 6; k++) {
        float3 edge = p[k / 3 * 3 + (k + 1) % 3] - p[k];
        edge -= dot(edge, axis[0]) * axis[0];
        float length = dot(edge, edge);
        if (length > longest) longest = length, axis[1] = edge;
    }
    if (!(longest > 1e-10f * reach)) return false;
    axis[1] /= sqrt(longest);
    axis[2] = cross(axis[0], axis[1]);
    return true;
}

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    float3 p[6];
    float around[6];
    for (int k = 0; k < 6; k++) {
        int i = k % 3;
        float t = k / 3;
        p[k] = clip_like(tile, m->x[i] + t * m->dx[i], m->y[i] + t * m->dy[i],
                         m->w[i] + t * m->dw[i]);
        around[k] = out_by_lens(m->slack, m, i, t, 1.0f) * tile->clip_scale;
    }
    if (!box_axes(p, cull->axis)) {
        cull->axis[0] = (float3)(1.0f, 0.0f, 0.0f), cull->axis[1] = (float3)(0.0f, 1.0f, 0.0f);
        cull->axis[2] = (float3)(0.0f, 0.0f, 1.0f);
    }
    for (int a = 0; a < 3; a++) {
        float3 n = cull->axis[a];
        cull->low[a] = INFINITY, cull->high[a] = -INFINITY;
        for (int k = 0; k < 6; k++) {
            float at = dot(n, p[k]);
            float more = around[k] * (fabs(n.x) + fabs(n.y))
                         + 4e-6f * (fabs(p[k].x) + fabs(p[k].y) + fabs(p[k].z));
            cull->low[a] = fmin(cull->low[a], at - more),
            cull->high[a] = fmax(cull->high[a], at + more);
        }
    }
    return true;
}

// A pixel's rays are s (x, y, 1), s > 0. Along each axis s times some value between g - h and g + h
// lies between low and high; the bounds of s that follow must leave something.
static INLINED LaneMask bound_pixels(Tile *tile, const Moving *m, const Cull *cull, int block,
                                     Bounded *bounded)
{
    Lanes x = (tile_middle(tile, block_x(block)) - tile->middle_x) * tile->clip_scale;
    Lanes y = (tile_middle(tile, block_y(block)) - tile->middle_y) * tile->clip_scale;
    float size = tile_half(tile) * tile->clip_scale + 2e-6f;
    Lanes nearest = 0.0f, farthest = INFINITY;
    LaneMask in = -1;
    COUNT(tile, bounded, in);
    for (int a = 0; a < 3; a++) {
        float3 n = cull->axis[a];
        Lanes g = n.x * x + n.y * y + n.z;
        float h = size * (fabs(n.x) + fabs(n.y)) + 2e-6f;
        for (int side = 0; side < 2; side++) {
            // s slope >= bound
            Lanes slope = side ? h - g : g + h;
            float bound = side ? -cull->high[a] : cull->low[a];
            Lanes s = bound / slope;
            if (bound > 0.0f) in &= slope > 0.0f;
            nearest = slope > 0.0f ? lanes_max(nearest, s * (bound > 0.0f ? 0.9999f : 1.0001f))
                : nearest;
            farthest = slope < 0.0f ? lanes_min(farthest, s * 1.0001f) : farthest;
        }
    }
    bounded->unused = 0;
    return in & (nearest <= farthest);
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *bounded, const SlabSamples *slab, LaneMask mask)
{
    return mask;
}

#include "stochastic/cull/scan_paths.h"
