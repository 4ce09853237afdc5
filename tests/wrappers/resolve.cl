// Stage "resolve" of one tile whose sums a test made.
#include "analytic/resolve.cl"

kernel void resolve_tile(Numbers numbers, int x, int y,
                         int x_low, int x_high, int y_low, int y_high,
                         global float4 *color, global float *depth, global uint *count,
                         global const int *film, global const float *background,
                         global float4 *rgba, global float *out_depth, global uint *met)
{
    Tile tile;
    tile.scene.numbers = numbers;
    tile.x = x, tile.y = y;
    tile.x_low = x_low, tile.x_high = x_high, tile.y_low = y_low, tile.y_high = y_high;
    tile.color = color, tile.depth = depth, tile.count = count;
    Frame frame = {film[0], film[1], film[2], film[3],
                   {background[0], background[1], background[2]}};
    Aovs aovs = {.size = 0};
    resolve(&tile, frame, background, rgba, out_depth, met, aovs);
}
