// Walking what a path sweeps on screen, row by row: the columns of each row whose samples lie
// inside all of the path's bounding planes (DESIGN.md 3.2).
#ifndef MB_WALK_H
#define MB_WALK_H

#include "analytic/tile_of_rows.h"

// First and last column of the rows first_row ... first_row + 15 (of one layer) that the path may
// cover, last < first where there is none. Returns whether there is any.
static bool walk_rows(const Tile *tile, global const Shape *shape, int first_row, int *first,
                      int *last)
{
    int layer = first_row / TILE, y = first_row % TILE;
    Slot slot = tile->scene.slots[tile->layer + layer];
    float top = (float)(tile->y + y);
    // Far from the corner of a large frame float32 is wrong by that much about planes and samples.
    float slack = 4e-7f * (tile->x + tile->y + 2 * TILE);
    if (shape->y_max + slack < top + slot.y_low
        || shape->y_min - slack > top + slot.y_high + (LANES - 1))
        return false;
    // Of where the samples of a pixel may lie, the corner that a plane favours counts.
    double left_x = tile->x + slot.x_low, right_x = tile->x + slot.x_high;
    double upper_y = top + slot.y_low, lower_y = top + slot.y_high;
    Lanes left = -1.0f, right = (float)TILE;
    for (uint i = 0; i < shape->planes; i++) {
        float a = shape->a[i], b = shape->b[i];
        double x = a > 0.0f ? right_x : left_x, y_at = b > 0.0f ? lower_y : upper_y;
        Lanes side = (float)(shape->c[i] + slack + a * x + b * y_at) + b * LANE_INDEX;
        if (a > 1e-5f) left = lanes_max(left, side * (-1.0f / a));
        else if (a < -1e-5f) right = lanes_min(right, side * (-1.0f / a));
        else right = side < -1e-2f ? (Lanes)(-1.0f) : right;
    }
    // Both lie in [-1, TILE] where the row is not empty; a column is inside if left <= x <= right.
    LaneInts low = to_lane_ints(ceil(lanes_min(left, (Lanes)(2.0f * TILE))));
    LaneInts high = to_lane_ints(floor(lanes_max(right, (Lanes)(-2.0f))));
    low = max(low, (LaneInts)(tile->x_low)); // Oclgrind knows no mixed forms
    high = min(high, (LaneInts)(tile->x_high - 1));
    lanes_store(low, first);
    lanes_store(high, last);
    bool any_row = false;
    for (int i = 0; i < LANES && y + i < TILE; i++) {
        int row = first_row + i;
        bool inside = row >= tile->row_low && row < tile->row_high && row_is_rendered(tile, row);
        if (!inside) last[i] = -1, first[i] = 0;
        any_row |= first[i] <= last[i];
    }
    return any_row;
}

#endif
