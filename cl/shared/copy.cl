// What `mbinterval bench` measures the device's memory with: every work-item copies its share,
// counted in vectors of sixteen.
#include "shared/lanes.h"

kernel void copy(global const float *from, global float *to, ulong share)
{
    size_t start = get_global_id(0) * share;
    for (size_t i = start; i < start + share; i++)
        lanes_store(lanes_load(from + LANES * i), to + LANES * i);
}
