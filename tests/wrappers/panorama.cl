// Look-ups in a picture of all directions.
#include "shared/effects.h"
#include "shared/panorama.h"

#pragma OPENCL FP_CONTRACT OFF

// Of directions, three numbers each, and of the angle that a sample stands for.
kernel void look_up(global const Panorama *panorama, global const float *panorama_texels,
                    global const long *panorama_sums, global const float *given, uint count,
                    global float *colors)
{
    const Picture picture = {*panorama, panorama_texels, panorama_sums};
    for (uint i = 0; i < count; i++) {
        Lanes3 way = {given[4 * i], given[4 * i + 1], given[4 * i + 2]};
        Patches at = patches_of(panorama, way, (Lanes)(given[4 * i + 3]));
        Lanes3 found = picture_light(&picture, &at, 6);
        vstore3(LANE3(found, 5), i, colors);
    }
}

// Of sixteen patches at a time: how far each is from the next, and of the box around them the mean
// and how many patches it has room for.
kernel void stretches(global const Panorama *panorama, global const float *panorama_texels,
                      global const long *panorama_sums, global const float *given, uint count,
                      global float *apart, global float4 *around)
{
    const Picture picture = {*panorama, panorama_texels, panorama_sums};
    for (uint i = 0; i < count; i++) {
        global const float *g = given + 4 * LANES * i;
        Patches at = {lanes_load(g), lanes_load(g + LANES), lanes_load(g + 2 * LANES),
                      lanes_load(g + 3 * LANES)};
        lanes_store(patches_apart(panorama, &at), apart + LANES * i);
        float3 mean;
        float patches = box_around(&picture, &at, &mean);
        around[i] = (float4)(mean, patches);
    }
}
