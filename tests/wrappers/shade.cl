// Stage "shade" on spans that a test made.
#include "analytic/shade.cl"

#define ROWS (LAYERS * TILE)

kernel void shade_tile(Numbers numbers, global const Vertex *vertices, global const Path *paths,
                       global const Shape *shapes, global const Depth *depths,
                       global const Mesh *meshes, global const Material *materials,
                       global const float *vertex_colors, global Place *places,
                       global float *weights, global Span *spans, global Run *span_runs,
                       global uint *met, global float4 *color,
                       global float *depth, global uint *count)
{
    Tile tile;
    tile.scene.numbers = numbers, tile.scene.vertices = vertices, tile.scene.paths = paths;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.scene.vertex_colors = vertex_colors;
    tile.shapes = shapes, tile.depths = depths, tile.places = places, tile.weights = weights;
    tile.x = tile.y = tile.layer = 0, tile.row_low = 0, tile.row_high = ROWS;
    tile.x_low = 1, tile.x_high = TILE, tile.y_low = 0, tile.y_high = TILE - 2;
    tile.spans = spans, tile.span_runs = span_runs, tile.met = met;
    tile.color = color, tile.depth = depth, tile.count = count;
    shade(&tile);
}
