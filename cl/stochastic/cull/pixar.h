// Culling method "pixar": both axes of the lens are cut into `strata_lens` parts and time into
// `strata_time`, in all STRATA parts; a sample is tested when the box of its part touches its pixel
// (Cook et al. 1990, without the pairing of strata: "modified Pixar" of Laine et al. 2011, 2).
//
// Operations: stratum 208 (286), tile 8, sample 12 (24).
#include "shared/effects.h"
#include "stochastic/cull/box.h"

typedef struct {
    Box box, boxes[STRATA];
} Cull;

typedef struct {
    Lanes x, y;
} Bounded;

static bool begin_path(const Tile *tile, const Moving *m, Cull *cull)
{
    Stratum everything = EVERYTHING;
    cull->box = screen_box(m, &everything);
    const int along = tile->scene.numbers.strata_lens, times = tile->scene.numbers.strata_time;
    for (int k = 0; k < STRATA; k++) {
        int u = k % along, v = k / along % along, t = k / (along * along);
        // Times of the shutter, in those of the segment.
        float from = ((float)t / times - m->open) * m->rate;
        float to = ((t + 1.0f) / times - m->open) * m->rate;
        Stratum s = {{clamp(from - 1e-6f * m->rate, 0.0f, 1.0f),
            clamp(to + 1e-6f * m->rate, 0.0f, 1.0f)},
                     {2.0f * u / along - 1.0f, 2.0f * (u + 1) / along - 1.0f},
                     {2.0f * v / along - 1.0f, 2.0f * (v + 1) / along - 1.0f}};
        cull->boxes[k] = screen_box(m, &s);
    }
    return true;
}

static INLINED LaneMask bound_pixels(Tile *tile, const Moving *m, const Cull *cull, int block,
                                     Bounded *bounded)
{
    bounded->x = tile_middle(tile, block_x(block)), bounded->y = tile_middle(tile, block_y(block));
    return tiles_in_path_box(tile, &cull->box, block);
}

static INLINED LaneInts stratum_along(Lanes place, int count)
{
    return to_lane_ints(lanes_min(lanes_max(place * (float)count, (Lanes)(0.0f)),
                                   (Lanes)(count - 1.0f)));
}

static INLINED LaneMask keep_samples(Tile *tile, const Moving *m, const Cull *cull,
                                     const Bounded *bounded, const SlabSamples *slab, LaneMask mask)
{
    const int along = tile->scene.numbers.strata_lens, times = tile->scene.numbers.strata_time;
    LaneInts stratum = stratum_along(slab->at.t, times) * (along * along);
#if LENS()
    stratum += stratum_along(0.5f * slab->at.u + 0.5f, along);
    stratum += stratum_along(0.5f * slab->at.v + 0.5f, along) * along;
#endif
    float left[LANES], right[LANES], top[LANES], bottom[LANES];
    for (int i = 0; i < LANES; i++) {
        const Box *box = cull->boxes + LANE(int, stratum, i);
        left[i] = box->left, right[i] = box->right, top[i] = box->top, bottom[i] = box->bottom;
    }
    float size = tile_half(tile);
    return mask & (bounded->x + size >= lanes_load(left)) & (bounded->x - size <= lanes_load(right))
           & (bounded->y + size >= lanes_load(top)) & (bounded->y - size <= lanes_load(bottom));
}

#include "stochastic/cull/scan_paths.h"
