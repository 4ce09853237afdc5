// Lists of fragments of one tile, made from all paths.
#include "analytic/rasterize.cl"

#define ROWS (LAYERS * TILE)

kernel void rasterize_tile(global const Vertex *vertices, global const Path *paths,
                           global const Shape *shapes, global const Slot *slots,
                           global const uint *members, uint member_count, int x, int y,
                           uint capacity, global Fragment *fragments, global int *heads,
                           global uint *result)
{
    Tile tile;
    tile.scene.vertices = vertices, tile.scene.paths = paths, tile.shapes = shapes;
    tile.scene.slots = slots;
    tile.x = x, tile.y = y, tile.layer = 0;
    tile.x_low = tile.y_low = 0, tile.x_high = tile.y_high = TILE;
    tile.row_low = 0, tile.row_high = tile.rows = ROWS;
    tile.members = members, tile.member_count = member_count, tile.static_count = 0;
    tile.capacity = capacity, tile.fragments = fragments, tile.heads = heads;
    result[0] = rasterize(&tile);
    result[1] = tile.fragment_count;
}
