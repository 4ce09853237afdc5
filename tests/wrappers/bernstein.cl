// Roots, and signs just after 0, of many polynomials, one after the other.
#include "shared/bernstein.h"

#pragma OPENCL FP_CONTRACT OFF

kernel void quadratics(global const double *b, uint count, global double *roots, global int *counts,
                       global int *signs)
{
    for (uint i = 0; i < count; i++) {
        double found[2];
        bool negative;
        counts[i] = bernstein_quadratic_roots(b[3 * i], b[3 * i + 1], b[3 * i + 2], &negative,
                                              found);
        signs[i] = negative ? -1 : 1;
        for (int k = 0; k < counts[i]; k++) roots[2 * i + k] = found[k];
    }
}

kernel void cubics(global const double *b, uint count, global double *roots, global int *counts,
                   global int *signs)
{
    for (uint i = 0; i < count; i++) {
        double one[4], found[3];
        for (int k = 0; k < 4; k++) one[k] = b[4 * i + k];
        counts[i] = bernstein_cubic_roots(one, found);
        signs[i] = bernstein_cubic_start(one) < 0.0 ? -1 : 1;
        for (int k = 0; k < counts[i]; k++) roots[3 * i + k] = found[k];
    }
}
