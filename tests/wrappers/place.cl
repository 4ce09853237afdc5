// Places and weights of all samples of a tile.
#include "shared/effects.h"
#include "analytic/place.cl"

kernel void place_tile(global const Slot *slots, global const float *filter, Numbers numbers,
                       int x, int y, global Place *places, global float *weights)
{
    Tile tile;
    tile.scene.slots = slots, tile.scene.filter = filter, tile.scene.numbers = numbers;
    tile.x = x, tile.y = y, tile.layer = 0, tile.places = places;
#if WEIGHTED()
    tile.weights = weights;
#endif
    place(&tile, numbers.samples * TILE);
}
