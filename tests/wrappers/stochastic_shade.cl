// Stage "shade" of point sampling, of samples of which a test says what they see.
#include "stochastic/shade.cl"

kernel void shade_tile(Numbers numbers, global const Vertex *vertices, global const Path *paths,
                       global const Bounds *bounds, global const Mesh *meshes,
                       global const Material *materials, global const float *vertex_colors,
                       int x, int y, global float *xs, global float *ys, global float *ts,
                       global float *zs, global uint *owners, global float4 *color,
                       global float *depth, global uint *count)
{
    Tile tile;
    tile.scene.numbers = numbers;
    tile.scene.vertices = vertices, tile.scene.paths = paths, tile.bounds = bounds;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.scene.vertex_colors = vertex_colors;
    tile.x = x, tile.y = y, tile.group = 0, tile.slabs = numbers.samples;
    tile.xs = xs, tile.ys = ys, tile.ts = ts, tile.zs = zs, tile.owners = owners;
    tile.color = color, tile.depth = depth, tile.count = count;
    shade(&tile);
}
