// Stage "nearest" on paths that a test made.
#include "analytic/nearest.cl"

#define ROWS (LAYERS * TILE)

kernel void nearest_tile(global const Vertex *vertices, global const Path *paths,
                         global const Shape *shapes, global const Mesh *meshes,
                         global const Material *materials, global const Slot *slots,
                         global const uint *members, uint member_count, int x, int y,
                         global double *static_depth, global uint *static_part)
{
    Tile tile;
    tile.scene.vertices = vertices, tile.scene.paths = paths, tile.shapes = shapes;
    tile.scene.meshes = meshes, tile.scene.materials = materials, tile.scene.slots = slots;
    tile.x = x, tile.y = y, tile.layer = 0;
    tile.x_low = tile.y_low = 0, tile.x_high = tile.y_high = TILE;
    tile.row_low = 0, tile.row_high = tile.rows = ROWS;
    tile.members = members, tile.member_count = tile.static_count = member_count;
    tile.static_depth = static_depth, tile.static_part = static_part;
    nearest(&tile);
}
