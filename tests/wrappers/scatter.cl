// The samples of one tile, all of them in one group.
#include "stochastic/scatter.cl"

kernel void scatter_tile(global const Slot *slots, global const float *filter,
                         global const ShutterKey *shutter, Numbers numbers, int x, int y,
                         global float *xs, global float *ys, global float *ts,
                         global float *us, global float *vs, global float *zs,
                         global uint *owners)
{
    Tile tile;
    tile.scene.slots = slots, tile.scene.filter = filter, tile.scene.shutter = shutter;
    tile.scene.numbers = numbers;
    tile.x = x, tile.y = y, tile.group = 0, tile.slabs = numbers.samples;
    tile.xs = xs, tile.ys = ys, tile.ts = ts, tile.us = us, tile.vs = vs, tile.zs = zs;
    tile.owners = owners;
    scatter(&tile);
}
