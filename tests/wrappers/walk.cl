// Columns that walk_rows gives for every row of every tile, for every path.
#include "analytic/walk.h"

#define ROWS (LAYERS * TILE)

kernel void walk(global const Shape *shapes, uint count, global const Slot *slots, int columns,
                 int rows, int width, int height, global int *first, global int *last)
{
    Tile tile;
    tile.scene.slots = slots;
    tile.layer = 0, tile.row_low = 0, tile.row_high = ROWS;
    for (int index = 0; index < columns * rows; index++) {
        tile.x = index % columns * TILE, tile.y = index / columns * TILE;
        tile.x_low = 0, tile.x_high = min(width - tile.x, TILE);
        tile.y_low = 0, tile.y_high = min(height - tile.y, TILE);
        for (uint path = 0; path < count; path++)
            for (int row = 0; row < ROWS; row += min(LANES, TILE)) {
                int from[LANES], to[LANES];
                if (!walk_rows(&tile, shapes + path, row, from, to)) continue;
                size_t at = ((size_t)index * count + path) * ROWS + row;
                for (int i = 0; i < min(LANES, TILE - row % TILE); i++)
                    first[at + i] = from[i], last[at + i] = to[i];
            }
    }
}
