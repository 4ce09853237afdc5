// Cube maps from pictures: level 0 of an environment, and the levels that rough surfaces mirror.
// Each work-item makes one row of texels of one face.
#include "shared/cube_map.h"

#pragma OPENCL FP_CONTRACT OFF

static inline CubePlace place_in_row(uint row, uint column, uint size, float across, float down)
{
    uint wide = size + 1u;
    CubePlace p = {row / wide, (column + across) * (2.0f / size) - 1.0f,
                   (row % wide + down) * (2.0f / size) - 1.0f};
    return p;
}

// A picture by longitude and latitude, looked up bilinearly; its middle is -z, its right half +x.
static float3 by_longitude(global const float *image, int width, int height, float turn, float3 d)
{
    float u = (atan2(d.x, -d.z) + turn) / (2.0f * M_PI_F) + 0.5f;
    float x = (u - floor(u)) * width - 0.5f;
    float y = (0.5f - atan2(d.y, sqrt(d.x * d.x + d.z * d.z)) / M_PI_F) * height - 0.5f;
    y = clamp(y, 0.0f, height - 1.0f);
    int left = (int)floor(x), top = min((int)y, max(height - 2, 0));
    int right = left + 1 == width ? 0 : left + 1, bottom = min(top + 1, height - 1);
    float across = x - left, down = y - top;
    left = left < 0 ? width - 1 : left;
    float3 upper = mix(vload3((size_t)top * width + left, image),
                       vload3((size_t)top * width + right, image), across);
    float3 lower = mix(vload3((size_t)bottom * width + left, image),
                       vload3((size_t)bottom * width + right, image), across);
    return mix(upper, lower, down);
}

// Level 0: the mean of four look-ups around each texel.
kernel void project(global const float *image, int width, int height, float turn, float intensity,
                    uint size, global float4 *texels)
{
    uint row = get_global_id(0);
    for (uint column = 0; column <= size; column++) {
        float3 sum = 0.0f;
        for (int k = 0; k < 4; k++) {
            CubePlace p = place_in_row(row, column, size, k & 1 ? 0.25f : -0.25f,
                                       k & 2 ? 0.25f : -0.25f);
            sum += by_longitude(image, width, height, turn, cube_direction(p));
        }
        texels[(size_t)row * (size + 1u) + column] = (float4)(0.25f * intensity * sum, 1.0f);
    }
}

// A level of half the size: each texel the mean of the ones around it in `given`, weighed 1 2 1
// along both edges, over edges of the cube as well.
kernel void halve(global const float4 *given, uint given_size, uint size, global float4 *texels)
{
    uint row = get_global_id(0);
    float apart = 0.5f * size / given_size; // half a step of the given level
    for (uint column = 0; column <= size; column++) {
        float4 sum = 0.0f;
        for (int k = 0; k < 4; k++) {
            CubePlace p = place_in_row(row, column, size, k & 1 ? apart : -apart,
                                       k & 2 ? apart : -apart);
            sum += cube_bilinear(given, given_size, cube_place(cube_direction(p)));
        }
        texels[(size_t)row * (size + 1u) + column] = 0.25f * sum;
    }
}

// A level as a rough surface mirrors it that is seen head-on: the mean over `lobe`, directions
// about +z that weigh their cosine, each looked up where a texel of `given` is as wide as it
// stands for.
kernel void prefilter(global const CubeMap *given, global const float4 *given_texels,
                      global const float4 *lobe, uint directions, uint size,
                      global float4 *texels)
{
    uint row = get_global_id(0);
    CubeMap map = given[0];
    for (uint column = 0; column <= size; column++) {
        float3 axis = normalize(cube_direction(place_in_row(row, column, size, 0.0f, 0.0f)));
        float3 aside = fabs(axis.y) < 0.9f ? (float3)(0, 1, 0) : (float3)(1, 0, 0);
        float3 across = normalize(cross(aside, axis)), down = cross(axis, across);
        float4 sum = 0.0f;
        float weight = 0.0f;
        for (uint k = 0; k < directions; k++) {
            float4 way = lobe[k];
            CubePlace p = cube_place(way.x * across + way.y * down + way.z * axis);
            sum += way.z * cube_trilinear(&map, given_texels, p, way.w);
            weight += way.z;
        }
        texels[(size_t)row * (size + 1u) + column] = sum / weight;
    }
}
