// Tiles of a grid, and what of each lies in the frame.
#ifndef MB_TILE_GRID_H
#define MB_TILE_GRID_H

#include "shared/records.h"

// A tile's first pixel in the frame, and its columns and rows that are rendered, low <= x < high.
typedef struct {
    int x, y, x_low, x_high, y_low, y_high;
} TilePlace;

// Place of tile `index`, row by row, whose edge is `size` pixels.
static TilePlace tile_place(TileGrid grid, uint index, Frame frame, int size)
{
    TilePlace p;
    p.x = grid.x + (int)(index % grid.columns) * size;
    p.y = grid.y + (int)(index / grid.columns) * size;
    p.x_low = max(frame.x - p.x, 0), p.x_high = min(frame.x + frame.width - p.x, size);
    p.y_low = max(frame.y - p.y, 0), p.y_high = min(frame.y + frame.height - p.y, size);
    return p;
}

#endif
