// The first four dimensions of the Sobol sequence (directions of Joe & Kuo 2008).
#ifndef MB_SOBOL_H
#define MB_SOBOL_H

#include "shared/bits.h"

#define SOBOL_BITS 16

// Columns of the generator matrices of dimensions 2, 3 and 4, the first bit highest.
constant ushort SOBOL[3][SOBOL_BITS] = {
    {0x8000, 0xc000, 0xa000, 0xf000, 0x8800, 0xcc00, 0xaa00, 0xff00, 0x8080, 0xc0c0, 0xa0a0, 0xf0f0,
     0x8888, 0xcccc, 0xaaaa, 0xffff},
    {0x8000, 0xc000, 0x6000, 0x9000, 0xe800, 0x5c00, 0x8e00, 0xc500, 0x6880, 0x9cc0, 0xee60, 0x5590,
     0x8068, 0xc09c, 0x60ee, 0x9055},
    {0x8000, 0xc000, 0x2000, 0x5000, 0xf800, 0x7400, 0xa200, 0x9300, 0xd880, 0x2540, 0x59e0, 0xe6d0,
     0x7808, 0xb40c, 0x8202, 0xc305}
};

// Point `index`, below 2^SOBOL_BITS, in dimension 1 to 4: a binary fraction, the first bit highest.
static uint sobol(uint index, int dimension)
{
    if (dimension == 1) return reverse_bits(index);
    uint result = 0u;
    for (int i = 0; index >> i != 0u; i++)
        if (index >> i & 1u) result ^= (uint)SOBOL[dimension - 2][i] << 16;
    return result;
}

#endif
