// Stage "resolve" of point sampling, of one tile whose sums a test made.
#include "stochastic/resolve.cl"

kernel void resolve_tile(Numbers numbers, Frame frame, int x, int y,
                         int x_low, int x_high, int y_low, int y_high,
                         global float4 *color, global float *depth, global uint *count,
                         global float4 *signed_color, global float *signed_depth,
                         global float *sign_sum, global const float *background,
                         global float4 *rgba, global float *out_depth, global uint *seen)
{
    Tile tile;
    tile.scene.numbers = numbers;
    tile.x = x, tile.y = y;
    tile.x_low = x_low, tile.x_high = x_high, tile.y_low = y_low, tile.y_high = y_high;
    tile.color = color, tile.depth = depth, tile.count = count;
#if WEIGHTED()
    tile.signed_color = signed_color, tile.signed_depth = signed_depth, tile.sign_sum = sign_sum;
#endif
    resolve(&tile, frame, background, rgba, out_depth, seen);
}
