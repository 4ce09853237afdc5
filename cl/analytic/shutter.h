// The window of a sample's line, where the shutter rolls.
#ifndef MB_TILE_SHUTTER_H
#define MB_TILE_SHUTTER_H

#include "analytic/tile.h"
#include "shared/shutter.h"

// Times at which the sample's line begins and ceases to be exposed.
static inline float2 window_of(const Tile *tile, int sample)
{
    return line_window(&tile->scene, tile->x + sample % TILE, tile->y + sample / TILE % TILE);
}

#endif
