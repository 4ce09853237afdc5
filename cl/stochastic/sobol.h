// Point sets for one pixel, sixteen pixels at a time.
//
// Point l of N is (l + a random number) / N in its first dimension; the others are dimensions 1 to
// 4 of the Sobol sequence (directions of Joe & Kuo 2008), Owen-scrambled by hashing (Laine & Karras
// 2011; constants of Vegdahl 2021). With the first two of them the set is a (0, m, 3)-net for N =
// 2^m: of every elementary box of volume 1/N each holds one point.
#ifndef MB_SOBOL_H
#define MB_SOBOL_H

#include "shared/bits.h"
#include "shared/lanes.h"

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

// Point l in dimension 1 to 4, its bits in reverse order.
static uint sobol_reversed(uint l, int dimension)
{
    if (dimension == 1) return l;
    uint result = 0u;
    for (int i = 0; l >> i != 0u; i++)
        if (l >> i & 1u) result ^= (uint)SOBOL[dimension - 2][i] << 16;
    return reverse_bits(result);
}

static inline uint16 mix_lanes(uint16 x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ x >> 16;
}

static inline uint16 reverse_lanes(uint16 x)
{
    x = x << 16 | x >> 16;
    x = (x & 0x00ff00ffu) << 8 | (x >> 8 & 0x00ff00ffu);
    x = (x & 0x0f0f0f0fu) << 4 | (x >> 4 & 0x0f0f0f0fu);
    x = (x & 0x33333333u) << 2 | (x >> 2 & 0x33333333u);
    return (x & 0x55555555u) << 1 | (x >> 1 & 0x55555555u);
}

static inline Lanes unit_lanes(uint16 x) { return convert_float16(as_int16(x >> 8)) * 0x1p-24f; }

// Owen's nested scrambling of a number whose bits are in reverse order, one for each seed.
static inline Lanes scrambled(uint reversed, uint16 seed)
{
    uint16 x = reversed;
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= seed >> 16 | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return unit_lanes(reverse_lanes(x));
}

// A random number that belongs to l and the seed.
static inline Lanes hashed(uint l, uint16 seed)
{
    return unit_lanes(mix_lanes(seed ^ l * 0x9e3779b9u));
}

#endif
