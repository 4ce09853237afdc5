// Stage "shadow" on spans and casters that a test made.
#include "analytic/shadow.cl"

#define ROWS (LAYERS * TILE)

kernel void shadow_tile(global const Vertex *vertices, global const Path *paths,
                        global const Shape *shapes, global const Depth *depths,
                        global const Mesh *meshes, global const Material *materials,
                        global Place *places, global const ShadowLight *lights,
                        global const LightView *views, global const uint *starts,
                        global const uint *members, global const Outline *outlines,
                        global uint *stamps, uint capacity, global Step *steps,
                        global float *spans, global Run *span_runs, global uint *result)
{
    Tile tile;
    tile.scene.vertices = vertices, tile.scene.paths = paths;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.shapes = shapes, tile.depths = depths, tile.places = places;
    Shadows shadows = {vertices, lights, views, starts, members, outlines, stamps, 0u, steps, 0u};
    tile.shadows = shadows; // homogeneous pixel space is the world
    tile.x = tile.y = tile.layer = 0, tile.row_low = 0, tile.row_high = ROWS;
    tile.x_low = tile.y_low = 0, tile.x_high = tile.y_high = TILE;
    tile.capacity = capacity, tile.spans = (global Span *)spans, tile.span_runs = span_runs;
    result[0] = shadow(&tile);
    result[1] = tile.shadows.step_count;
}
