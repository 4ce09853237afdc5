// The samples of one tile, all of them in one group.
#include "shared/effects.h"
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

#if PATTERN_JITTERED()
// Places of 0 ... count - 1 in the orders of sixteen seeds.
kernel void orders(global const uint *seeds, uint count, global uint *places)
{
    Orders orders = orders_of(lanes_load(seeds), count);
    for (uint l = 0; l < count; l++) lanes_store(permuted(l, &orders), places + LANES * l);
}
#endif
