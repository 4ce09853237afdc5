// What `mbinterval bench` measures the device's memory with: every work-item copies its share,
// counted in vectors of sixteen.
#include "shared/inlining.h"

kernel void copy(global const float *from, global float *to, ulong share)
{
    size_t start = get_global_id(0) * share;
    for (size_t i = start; i < start + share; i++) vstore16(vload16(i, from), i, to);
}
