// The samples of one tile, all of them in one group.
#include "stochastic/scatter.cl"

kernel void scatter_tile(global const Slot *slots, global const float *filter,
                         global const ShutterKey *shutter, uint seed, int x, int y,
                         float roll_start, float roll_step, float roll_length,
                         global float *xs, global float *ys, global float *ts,
                         global float *us, global float *vs, global float *zs,
                         global uint *owners)
{
    Tile tile;
    tile.scene.slots = slots, tile.scene.filter = filter, tile.scene.shutter = shutter;
    tile.scene.seed = seed, tile.scene.roll_start = roll_start, tile.scene.roll_step = roll_step;
    tile.scene.roll_length = roll_length;
    tile.x = x, tile.y = y, tile.group = 0, tile.slabs = SAMPLES;
    tile.xs = xs, tile.ys = ys, tile.ts = ts, tile.us = us, tile.vs = vs, tile.zs = zs;
    tile.owners = owners;
    scatter(&tile);
}
