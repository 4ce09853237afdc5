// Roots of many quintics, one after the other.
#include "shared/quintic.h"

#pragma OPENCL FP_CONTRACT OFF

kernel void quintics(global const double *b, uint count, global double *roots, global int *counts)
{
    for (uint i = 0; i < count; i++) {
        double one[QUINTIC], found[5];
        for (int k = 0; k < QUINTIC; k++) one[k] = b[QUINTIC * i + k];
        counts[i] = quintic_roots(one, found);
        for (int k = 0; k < counts[i]; k++) roots[5 * i + k] = found[k];
    }
}
