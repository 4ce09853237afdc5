// Stage "shadow_map": the least depth that each light sees through every texel, at one jittered
// place and time for each stratum of the shutter (Akenine-Moeller et al. 2007, 3.5).
#include "stochastic/trace.h"
#include "shared/bits.h"

#pragma OPENCL FP_CONTRACT OFF

static inline float jitter(uint seed, uint what)
{
    return (mix_bits(seed ^ mix_bits(what + 0x9e3779b9u)) >> 8) * 0x1p-24f;
}

// The ray through x, y of a view.
static void aim(Rays *rays, int lane, global const ViewRays *view, double x, double y)
{
    double *from[3] = {&LANE(double, rays->from.x, 0), &LANE(double, rays->from.y, 0),
                       &LANE(double, rays->from.z, 0)};
    double *way[3] = {&LANE(double, rays->way.x, 0), &LANE(double, rays->way.y, 0),
                      &LANE(double, rays->way.z, 0)};
    for (int i = 0; i < 3; i++) {
        from[i][lane] = view->from[i] + x * view->from[3 + i] + y * view->from[6 + i];
        way[i][lane] = view->way[i] + x * view->way[3 + i] + y * view->way[6 + i];
    }
}

// One row of texels of one stratum of one view for each work-item.
kernel void shadow_map(Numbers numbers, global const Vertex *world, global const Path *paths,
                       global const TreeNode *tree, global const uint *leaves,
                       global const ViewRays *views, global float *shadow_map)
{
    const uint size = numbers.shadow_size, strata = numbers.shadow_strata;
    uint item = get_global_id(0), stratum = item / size % strata;
    global const ViewRays *view = views + item / size / strata;
    Occluders o = {world, paths, tree, leaves, numbers.leaf_nodes, 0};
    for (uint first = 0; first < size; first += LANES) {
        Rays rays = {.ends = false};
        float times[LANES];
        for (uint i = 0; i < LANES; i++) {
            uint x = min(first + i, size - 1u);
            uint own = mix_bits(numbers.seed ^ mix_bits(item * size + x));
            aim(&rays, (int)i, view, x + jitter(own, 0u), item % size + jitter(own, 1u));
            times[i] = (stratum + jitter(own, 2u)) * (1.0f / strata);
        }
        rays.t = lanes_load(times);
        Lanes depth = to_lanes(view->depth + first_place(&o, &rays));
        for (uint i = 0; i < min(LANES, (int)(size - first)); i++)
            shadow_map[(size_t)item * size + first + i] = LANE(float, depth, i);
    }
}
