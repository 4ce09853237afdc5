// Stage "record" on spans that a test made.
#include "analytic/shade.cl"
#include "analytic/record.cl"

#define ROWS (LAYERS * TILE)

kernel void record_tile(Numbers numbers, Frame frame, global const Vertex *vertices,
                        global const Path *paths, global const Shape *shapes,
                        global const Depth *depths, global const Mesh *meshes,
                        global const Material *materials, global const float *vertex_colors,
                        global Place *places, global float *weights, global Span *spans,
                        global Run *span_runs, global float4 *added, uint event_capacity,
                        global Event *events, global uint *event_count, global uint *event_end,
                        global uint *full)
{
    Tile tile;
    tile.scene.numbers = numbers, tile.scene.vertices = vertices, tile.scene.paths = paths;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.scene.vertex_colors = vertex_colors;
    tile.shapes = shapes, tile.depths = depths, tile.places = places, tile.weights = weights;
    tile.x = frame.x - 1, tile.y = frame.y, tile.layer = 0;
    tile.row_low = 0, tile.row_high = ROWS;
    tile.x_low = 1, tile.x_high = TILE, tile.y_low = 0, tile.y_high = TILE - 2;
    tile.spans = spans, tile.span_runs = span_runs, tile.added = added;
    tile.events = events, tile.event_capacity = event_capacity;
    tile.event_count = event_count, tile.event_end = event_end, tile.events_full = false;
    record(&tile, frame);
    full[0] = tile.events_full;
}
