// Stage "envelope" on lists of intervals that a test made.
#include "analytic/envelope.cl"

#define ROWS (LAYERS * TILE)

kernel void envelope_tile(global const Vertex *vertices, global const Path *paths,
                         global const Shape *shapes, global const Depth *depths,
                         global const Mesh *meshes, global const Material *materials,
                         global Place *places, global double *static_depth,
                         global uint *static_part, global Visit *visits, global int *heads,
                         uint capacity, global Front *fronts, global Front *merged,
                         global float *ordering, global Span *spans, global Run *span_runs,
                         global uint *result)
{
    Tile tile;
    tile.scene.vertices = vertices, tile.scene.paths = paths;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.shapes = shapes, tile.depths = depths, tile.places = places;
    tile.x = tile.y = tile.layer = 0, tile.row_low = 0, tile.row_high = ROWS;
    tile.static_depth = static_depth, tile.static_part = static_part;
    tile.visits = visits, tile.heads = heads, tile.capacity = capacity;
    tile.fronts = fronts, tile.merged = merged, tile.ordering = ordering;
    tile.spans = spans, tile.span_runs = span_runs;
    result[0] = envelope(&tile);
}
