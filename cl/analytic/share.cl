// Stage "share": averages over pixels by the five-point rule, from the values at their centres.
//
// By Taylor's theorem a pixel's average is its centre's value and 1/24 of the Laplacian there, but
// for fourth derivatives; the discrete Laplacian lets each sample count in four more pixels.
#include "shared/film.h"

kernel void share(global const float4 *centres, Frame given, Frame film,
                  global const float *background, global float4 *shared)
{
    int y = (int)get_global_id(0), row = film.y + y - given.y;
    global const float4 *here = centres + (size_t)row * given.width;
    global const float4 *above = row > 0 ? here - given.width : here;
    global const float4 *below = row < given.height - 1 ? here + given.width : here;
    for (int x = 0; x < film.width; x++) {
        int column = film.x + x - given.x;
        float4 centre = here[column];
        float4 beside = here[max(column - 1, 0)] + here[min(column + 1, given.width - 1)];
        float4 around = (above[column] + below[column]) + beside;
        float4 average = centre + (around - 4.0f * centre) * (1.0f / 24.0f);
        size_t from = (size_t)row * given.width + column, to = (size_t)y * film.width + x;
        shared[to] = over_background(average, from, film, background);
    }
}
