// Stage "resolve": sums over a pixel's samples become the film's colour, alpha, depth and count.
#include "analytic/film.h"
#include "analytic/tile.h"

static void resolve(const Tile *tile, Frame frame, global const float *background,
                    global float4 *rgba, global float *depth, global uint *met)
{
    for (int y = tile->y_low; y < tile->y_high; y++)
        for (int x = tile->x_low; x < tile->x_high; x++) {
            int pixel = y * TILE + x;
            size_t out = (size_t)(tile->y + y - frame.y) * frame.width + (tile->x + x - frame.x);
            float4 sum = tile->color[pixel];
            depth[out] = sum.w > 0.0f ? tile->depth[pixel] / sum.w : INFINITY;
            sum *= 1.0f / SAMPLES;
#ifndef WEIGHTED
            sum.w = fmin(sum.w, 1.0f); // thousands of spans add up to 1, but for rounding
#endif
#ifdef FIVE_POINT // the background comes last
            rgba[out] = sum;
#else
            rgba[out] = over_background(sum, out, frame, background);
#endif
            met[out] = tile->count[pixel];
        }
}
