// Cube maps from pictures: level 0 of an environment, and the levels that rough surfaces mirror.
// Each work-item makes one row of texels of one face.
#include "shared/cube_map.h"
#include "shared/panorama.h"

#pragma OPENCL FP_CONTRACT OFF

static inline CubePlace place_in_row(uint row, uint column, uint size, float across, float down)
{
    uint wide = size + 1u;
    CubePlace p = {row / wide, (column + across) * (2.0f / size) - 1.0f,
                   (row % wide + down) * (2.0f / size) - 1.0f};
    return p;
}

// Level 0: the mean of four look-ups around each texel, of four texels at a time.
kernel void project(global const Panorama *panorama, global const float *panorama_texels,
                    uint size, global float4 *texels)
{
    const Picture picture = {*panorama, panorama_texels};
    uint row = get_global_id(0);
    for (uint column = 0; column <= size; column += 4u) {
        float way[3][LANES];
        for (int k = 0; k < LANES; k++) {
            CubePlace p = place_in_row(row, column + k / 4, size, k & 1 ? 0.25f : -0.25f,
                                       k & 2 ? 0.25f : -0.25f);
            float3 d = cube_direction(p);
            way[0][k] = d.x, way[1][k] = d.y, way[2][k] = d.z;
        }
        Lanes3 ways = {lanes_load(way[0]), lanes_load(way[1]), lanes_load(way[2])};
        Patches at = patches_of(panorama, ways, (Lanes)(0.0f));
        Lanes3 light = picture_points(&picture, &at, LANES);
        for (uint i = 0; i < 4u && column + i <= size; i++) {
            float3 sum = 0.0f;
            for (int k = 0; k < 4; k++) sum += LANE3(light, 4 * i + k);
            texels[(size_t)row * (size + 1u) + column + i] = (float4)(0.25f * sum, 1.0f);
        }
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
