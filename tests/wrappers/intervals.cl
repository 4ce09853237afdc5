// Stage "intervals" on lists that a test made.
#include "analytic/intervals.cl"

#define ROWS (LAYERS * TILE)

kernel void intervals_tile(global const Path *paths, global const Shape *shapes,
                           global const Mesh *meshes, global const Material *materials,
                           global Fragment *fragments, global int *heads,
                           global double *static_depth, global uint *static_part, uint capacity,
                           global Interval *pool, global Run *runs, global uint *met,
                           global uint *result)
{
    Tile tile;
    tile.scene.paths = paths, tile.shapes = shapes;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.row_low = 0, tile.row_high = ROWS;
    tile.fragments = fragments, tile.heads = heads;
    tile.static_depth = static_depth, tile.static_part = static_part;
    tile.capacity = capacity, tile.intervals = pool, tile.runs = runs, tile.met = met;
    result[0] = intervals(&tile);
    result[1] = tile.interval_count;
}
