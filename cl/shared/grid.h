// The tiles that paths are listed by.
#ifndef MB_GRID_H
#define MB_GRID_H

typedef struct {
    int x, y;          // first pixel of the first tile
    int columns, rows; // tiles
    int size;          // pixels along a tile's edge
    uint paths;
    uint chunk;        // paths per work-item
    float x_low, x_high, y_low, y_high; // where samples lie, relative to their pixels
} Grid;

#endif
