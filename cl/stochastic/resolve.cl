// Stage "resolve": sums over a pixel's samples become the film's colour, alpha, depth and count.
#include "shared/effects.h"
#include "stochastic/tile_of_slabs.h"
#include "shared/film.h" // after the pragma that forbids to contract

#if WEIGHTED()
// A filter with negative lobes: samples weigh its mass times their sign, and what a pixel's
// samples lack of their number together is spread evenly.
static void weigh(const Tile *tile, int pixel)
{
    const float mass = tile->scene.numbers.filter_mass;
    float lacking = 1.0f - mass * tile->sign_sum[pixel] * (1.0f / tile->scene.numbers.samples);
    tile->color[pixel] = mass * tile->signed_color[pixel] + lacking * tile->color[pixel];
    tile->depth[pixel] = mass * tile->signed_depth[pixel] + lacking * tile->depth[pixel];
}
#endif

#if PATTERN_RGSS()

// Keep all samples of the tile's pixels for the filter, which reaches into neighbours: colour, and
// depth.
static void resolve(const Tile *tile, Frame frame, global const float *background,
                    global float4 *rgba, global float *depth, global uint *seen)
{
    const int samples = tile->scene.numbers.samples;
    for (int y = tile->y_low; y < tile->y_high; y++)
        for (int x = tile->x_low; x < tile->x_high; x++) {
            size_t out = (size_t)(tile->y + y - frame.y) * frame.width + (tile->x + x - frame.x);
            for (int l = 0; l < samples; l++) {
                int sample = l * SLAB + place_of_pixel(x, y);
                rgba[out * samples + l] = tile->sample_colors[sample];
                depth[out * samples + l] = tile->sample_depths[sample];
            }
            seen[out] = tile->count[place_of_pixel(x, y)];
        }
}

#else

static void resolve(const Tile *tile, Frame frame, global const float *background,
                    global float4 *rgba, global float *depth, global uint *seen)
{
    const int samples = tile->scene.numbers.samples;
    for (int y = tile->y_low; y < tile->y_high; y++)
        for (int x = tile->x_low; x < tile->x_high; x++) {
            int pixel = place_of_pixel(x, y);
            size_t out = (size_t)(tile->y + y - frame.y) * frame.width + (tile->x + x - frame.x);
#if WEIGHTED()
            weigh(tile, pixel);
#endif
            float4 sum = tile->color[pixel];
            depth[out] = sum.w > 0.0f ? tile->depth[pixel] / sum.w : INFINITY;
            rgba[out] = over_background(sum * (1.0f / samples), out, frame, background);
            seen[out] = tile->count[pixel];
        }
}

#endif
