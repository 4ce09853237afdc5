// Stage "occlude" on sorted intervals that a test made.
#include "analytic/occlude.cl"

#define ROWS (LAYERS * TILE)

kernel void occlude_tile(global Interval *sorted, global Run *runs, uint capacity,
                         global float *sorting, global Span *spans, global Run *span_runs,
                         global uint *result)
{
    Tile tile;
    tile.row_low = 0, tile.row_high = ROWS;
    tile.sorted = sorted, tile.runs = runs, tile.capacity = capacity;
    tile.sorting = sorting, tile.spans = spans, tile.span_runs = span_runs;
    result[0] = occlude(&tile);
    result[1] = tile.span_count;
}
