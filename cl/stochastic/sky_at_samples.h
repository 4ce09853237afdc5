// What samples see that see no surface: the environment, without alpha.
#ifndef MB_SKY_AT_SAMPLES_H
#define MB_SKY_AT_SAMPLES_H

#include "shared/effects.h"
#include "shared/gaze.h"
#include "stochastic/tile_of_slabs.h"

// Add the light that a sample without a surface sees; stage "shade" counted the sample.
static inline void add_light(Tile *tile, int index, float4 light)
{
    int pixel = index % SLAB;
    tile->color[pixel] += light;
#if WEIGHTED()
    tile->signed_color[pixel] += sign_of_sample(tile, index, pixel) * light;
#endif
#if PATTERN_RGSS()
    tile->sample_colors[index] = light;
#endif
}

static void add_sky(Tile *tile)
{
    for (int index = 0; index < tile->slabs * SLAB; index += LANES) {
        bool any = false;
        for (int i = 0; i < LANES; i++) any |= tile->owners[index + i] == NONE;
        if (!any) continue;
        Gaze gaze = {load(tile->xs, index) + (float)(tile->x + HALF),
                     load(tile->ys, index) + (float)(tile->y + HALF)};
#define LOAD(name) gaze.name = load(tile->name##s, index);
        LENS_COORDINATES(LOAD)
#undef LOAD
        Patches at = sky_patches(&tile->scene, &gaze, load(tile->ts, index));
        Lanes3 light = sky_light(&tile->scene, &at, LANES);
        for (int i = 0; i < LANES; i++)
            if (tile->owners[index + i] == NONE)
                add_light(tile, index + i,
                          (float4)(LANE3(light, i), 0.0f));
    }
}

#endif
