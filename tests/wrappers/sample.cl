// Stage "sample" of point sampling on paths and samples that a test made.
#include "stochastic/tile_of_slabs.h"
#include "stochastic/cull/cull.h"

kernel void sample_tile(Numbers numbers, global const Vertex *vertices, global const Path *paths,
                        global const Bounds *bounds, global const Mesh *meshes,
                        global const Material *materials, global const uint *members,
                        uint member_count, int x, int y, global float *bound, global float *xs,
                        global float *ys, global float *ts, global float *us, global float *vs,
                        global float *zs, global uint *owners)
{
    Tile tile;
    tile.scene.numbers = numbers, tile.scene.vertices = vertices, tile.scene.paths = paths;
    tile.scene.meshes = meshes, tile.scene.materials = materials, tile.bounds = bounds;
    tile.x = x, tile.y = y, tile.group = 0, tile.slabs = numbers.samples;
    tile.x_low = tile.y_low = 0, tile.x_high = tile.y_high = TILE;
    tile.middle_x = 0.5f * numbers.width - (x + HALF);
    tile.middle_y = 0.5f * numbers.height - (y + HALF);
    tile.clip_scale = 2.0f / numbers.height;
    tile.frame.left = -(x + HALF), tile.frame.right = tile.frame.left + numbers.width;
    tile.frame.top = -(y + HALF), tile.frame.bottom = tile.frame.top + numbers.height;
    tile.reach_low = 0.0f, tile.reach_high = 1.0f;
    tile.members = members, tile.member_count = member_count;
    tile.xs = xs, tile.ys = ys, tile.ts = ts, tile.us = us, tile.vs = vs;
    tile.zs = zs, tile.owners = owners;
    for (int k = 0; k < MOST_SLABS; k++) {
        global const float *b = bound + 6 * min(k, tile.slabs - 1);
        bool used = k < tile.slabs;
        tile.t_low[k] = used ? b[0] : 2.0f, tile.t_high[k] = used ? b[1] : -1.0f;
        tile.u_low[k] = b[2], tile.u_high[k] = b[3], tile.v_low[k] = b[4], tile.v_high[k] = b[5];
        tile.far[k] = used ? INFINITY : 0.0f;
        for (int i = 0; i < BLOCKS; i++) {
            tile.block_far[k * BLOCKS + i] = INFINITY;
#if ZMIN()
            tile.block_near[k * BLOCKS + i] = INFINITY;
#endif
        }
    }
    sample(&tile);
}
