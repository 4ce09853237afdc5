// Culling method "hull": the samples of pixels in the convex hull, on screen, of the triangle's
// corners at both ends (McGuire et al. 2010). A way on screen is a straight line, so the hull holds
// the triangle at all times, as long as it stays before the eye; else the box serves. Under a lens
// each edge of the hull moves outwards by the greatest circle of confusion behind it.
//
// Operations: path 1716 (1818), tile 44, sample 0.
// Six edges are counted.
#include "shared/effects.h"
#include "stochastic/cull/box.h"

#define MAX_EDGES 15

typedef struct {
    Box box;
    int edges;
    float a[MAX_EDGES], b[MAX_EDGES], c[MAX_EDGES]; // inside a x + b y <= c
} Cull;

typedef struct {
    int unused;
} Bounded;

// The corners on screen, and how far they blur; false where one is behind the eye.
static bool hull_corners(const Moving *m, float2 *p, float *blur)
{
    for (int k = 0; k < 6; k++) {
        int i = k % 3;
        float t = k / 3, w = m->w[i] + t * m->dw[i];
        if (w <= m->slack) return false;
        p[k] = (float2)(m->x[i] + t * m->dx[i], m->y[i] + t * m->dy[i]) / w;
        blur[k] = m->slack / w + 1e-3f;
#if LENS()
        blur[k] += fabs(m->c[i] + t * m->dc[i]) / w;
#endif
    }
    return true;
}

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
    cull->edges = 0;
    float2 p[6];
    float blur[6];
    if (!hull_corners(m, p, blur)) return true;
    for (int i = 0; i < 6; i++) for (int j = i + 1; j < 6; j++) {
        float2 along = p[j] - p[i], normal = (float2)(along.y, -along.x);
        float size = sqrt(dot(normal, normal));
        if (!(size > 1e-6f)) continue;
        normal /= size;
        float low = INFINITY, high = -INFINITY, at = dot(normal, p[i]);
        float out_low = INFINITY, out_high = -INFINITY;
        for (int k = 0; k < 6; k++) {
            float side = dot(normal, p[k]), rounding = 1e-6f * (fabs(p[k].x) + fabs(p[k].y));
            low = fmin(low, side), high = fmax(high, side);
            out_low = fmin(out_low, side - blur[k] - rounding);
            out_high = fmax(out_high, side + blur[k] + rounding);
        }
        float sign = high - at <= 1e-4f ? 1.0f : at - low <= 1e-4f ? -1.0f : 0.0f;
        if (sign == 0.0f) continue; // no edge of the hull
        cull->a[cull->edges] = sign * normal.x, cull->b[cull->edges] = sign * normal.y;
        cull->c[cull->edges++] = sign > 0.0f ? out_high : -out_low;
    }
    return true;
}

static INLINED LaneMask bound_pixels(Tile *tile, const Moving *m, const Cull *cull, int block,
                                     Bounded *bounded)
{
    Lanes x = tile_middle(tile, block_x(block)), y = tile_middle(tile, block_y(block));
    float size = tile_half(tile);
    LaneMask in = tiles_in_path_box(tile, &cull->box, block);
    for (int k = 0; k < cull->edges; k++)
        in &= cull->a[k] * x + cull->b[k] * y
              <= cull->c[k] + size * (fabs(cull->a[k]) + fabs(cull->b[k]));
    bounded->unused = 0;
    return in;
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *bounded, const SlabSamples *slab, LaneMask mask)
{
    return mask;
}

#include "stochastic/cull/scan_paths.h"
