// Stage "resolve": sums over a pixel's samples become the film's colour, alpha, depth and counts.
#include "shared/effects.h"
#include "shared/film.h"
#include "analytic/tile_of_rows.h"

// Mean colour and alpha over the background of the film's pixel `place`.
static inline float4 resolved(const Tile *tile, float4 sum, size_t place, Frame frame,
                              global const float *background)
{
    sum *= 1.0f / tile->scene.numbers.samples;
#if !WEIGHTED()
    sum.w = fmin(sum.w, 1.0f); // thousands of spans add up to 1, but for rounding
#endif
#if FIVE_POINT() // the background comes last
    return sum;
#else
    return over_background(sum, place, frame, background);
#endif
}

static void resolve(const Tile *tile, Frame frame, global const float *background,
                    global float4 *rgba, global float *depth, global uint *met, Aovs aovs)
{
    for (int y = tile->y_low; y < tile->y_high; y++)
        for (int x = tile->x_low; x < tile->x_high; x++) {
            int pixel = y * TILE + x;
            size_t out = (size_t)(tile->y + y - frame.y) * frame.width + (tile->x + x - frame.x);
            float4 sum = tile->color[pixel];
            depth[out] = sum.w > 0.0f ? tile->depth[pixel] / sum.w : INFINITY;
            rgba[out] = resolved(tile, sum, out, frame, background);
            met[out] = tile->count[pixel];
#if AOV_SHARP()
            aovs.sharp[out] = resolved(tile, tile->sharp[pixel], out, frame, background);
#endif
#if AOV_OPERATIONS()
            aovs.planes[PLANE_OPERATIONS * aovs.size + out] = tile->operations[pixel];
#endif
        }
}
