// Stage "sort" on intervals that a test made.
#include "analytic/sort.cl"

#define ROWS (LAYERS * TILE)

kernel void sort_tile(global Interval *intervals, global Run *runs, uint capacity, int most,
                      global float *sorting, global Interval *sorted, global uint *result)
{
    Tile tile;
    tile.scene.numbers.most_intervals = most;
    tile.row_low = 0, tile.row_high = ROWS;
    tile.intervals = intervals, tile.runs = runs, tile.capacity = capacity;
    tile.sorting = sorting, tile.sorted = sorted;
    result[0] = sort(&tile);
    result[1] = tile.sorted_count;
}
