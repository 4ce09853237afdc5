// Stage "bin": which paths may touch which tile, without clipping (DESIGN.md 3.2).
//
// Paths are counted, then filed, in chunks; a tile's paths come chunk by chunk and so in the order
// given, in any run and on any number of threads.
#include "shared/records.h"

#pragma OPENCL FP_CONTRACT OFF

// Pixels by which float32 may be wrong about a place at (x, y): of planes, bounds and samples.
static inline float rounding_at(float x, float y) { return 4e-7f * (x + y); }

// Columns of tiles in one row of tiles that the shape may touch.
static int2 touched_columns(global const Shape *shape, ListGrid grid, int row)
{
    double top = grid.y + row * grid.size + grid.y_low;
    double bottom = grid.y + (row + 1) * grid.size - 1 + grid.y_high;
    double left = grid.x + grid.x_low;
    double right = grid.x + grid.columns * grid.size - 1 + grid.x_high;
    double slack = rounding_at((float)right, (float)bottom);
    for (uint i = 0; i < shape->planes; i++) {
        double a = shape->a[i], b = shape->b[i];
        double side = shape->c[i] + slack + (b > 0.0 ? b * bottom : b * top);
        if (a > 1e-5) left = fmax(left, -side / a);
        else if (a < -1e-5) right = fmin(right, -side / a);
        else if (side + fabs(a) * 1e5 < 0.0) return (int2)(0, -1);
    }
    if (left > right) return (int2)(0, -1);
    // A sample at X belongs to a pixel from X - x_high to X - x_low.
    int first = (int)ceil((left - grid.x_high - grid.x - grid.size + 1) / grid.size);
    int last = (int)floor((right - grid.x_low - grid.x) / grid.size);
    return (int2)(max(first, 0), min(last, grid.columns - 1));
}

// Count (entries == 0) or file one chunk. `place` has one number per tile for this chunk.
static void bin_chunk(global const Shape *shapes, global const uint *order, ListGrid grid,
                      uint chunk, global uint *place, global uint *entries)
{
    uint begin = chunk * grid.chunk, end = min(begin + grid.chunk, grid.paths);
    for (uint i = begin; i < end; i++) {
        global const Shape *shape = shapes + order[i];
        if (shape->flags & SHAPE_CULLED) continue;
        float slack = rounding_at(0.0f, (float)(grid.y + grid.rows * grid.size));
        float low = ceil((shape->y_min - slack - grid.y_high - grid.y - grid.size + 1) / grid.size);
        float high = floor((shape->y_max + slack - grid.y_low - grid.y) / grid.size);
        // Bounds may be infinite: no integer before they are in range.
        int first_row = (int)fmin(fmax(low, 0.0f), (float)grid.rows);
        int last_row = (int)fmax(fmin(high, grid.rows - 1.0f), -1.0f);
        for (int row = first_row; row <= last_row; row++) {
            int2 touched = touched_columns(shape, grid, row);
            for (int column = touched.x; column <= touched.y; column++) {
                uint at = place[row * grid.columns + column]++;
                if (entries != 0) entries[at] = order[i];
            }
        }
    }
}

kernel void bin_count(global const Shape *shapes, global const uint *order, ListGrid grid,
                      global uint *counts)
{
    uint tiles = grid.columns * grid.rows;
    global uint *place = counts + (size_t)get_global_id(0) * tiles;
    for (uint i = 0; i < tiles; i++) place[i] = 0;
    bin_chunk(shapes, order, grid, get_global_id(0), place, 0);
}

kernel void bin_file(global const Shape *shapes, global const uint *order, ListGrid grid,
                     global uint *counts, global uint *members)
{
    uint tiles = grid.columns * grid.rows;
    global uint *place = counts + (size_t)get_global_id(0) * tiles;
    bin_chunk(shapes, order, grid, get_global_id(0), place, members);
}
