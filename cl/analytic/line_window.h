// Samples as they look at the scene, and the windows of their lines, where the shutter rolls.
#ifndef MB_LINE_WINDOW_H
#define MB_LINE_WINDOW_H

#include "shared/effects.h"
#include "analytic/tile_of_rows.h"
#include "shared/shutter.h"

// Times at which the sample's line begins and ceases to be exposed.
static inline float2 window_of(const Tile *tile, int sample)
{
    return line_window(&tile->scene, tile->x + sample % TILE, tile->y + sample / TILE % TILE);
}

// A sample, the place that it looks from, and when its line is exposed.
typedef struct {
    int sample;
    Place place;
    float2 window;
} Viewer;

static inline Viewer viewer_of(const Tile *tile, int sample)
{
    return (Viewer){sample, place_of(tile, sample), window_of(tile, sample)};
}

#if MOMENTARY() || AOV_SHARP()
// The moment of the sharp frame, for a line that is exposed in `window`; never its very end, at
// which nothing is seen any more.
static inline float moment_in(const Tile *tile, float2 window)
{
    float t = window.x + tile->scene.numbers.moment * (window.y - window.x);
    return fmin(t, window.y * (1.0f - FLT_EPSILON / 2));
}
#endif

#endif
