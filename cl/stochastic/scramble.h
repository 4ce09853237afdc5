// Point sets for one pixel, sixteen pixels at a time.
//
// Point l of N is (l + a random number) / N in its first dimension; the others are dimensions 1 to
// 4 of the Sobol sequence, Owen-scrambled by hashing (Laine & Karras 2011; constants of Vegdahl
// 2021). With the first two of them the set is a (0, m, 3)-net for N = 2^m: of every elementary box
// of volume 1/N each holds one point.
#ifndef MB_SCRAMBLE_H
#define MB_SCRAMBLE_H

#include "shared/lanes.h"
#include "shared/sobol.h"

static INLINED Lanes unit_lanes(LaneUints x) { return to_lanes(as_lane_ints(x >> 8)) * 0x1p-24f; }

// Owen's nested scrambling of a binary fraction, one for each seed.
static INLINED Lanes scrambled(uint bits, LaneUints seed)
{
    LaneUints x = reverse_bits(bits);
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= seed >> 16 | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return unit_lanes(reverse_lanes(x));
}

// A random number that belongs to l and the seed.
static INLINED Lanes hashed(uint l, LaneUints seed)
{
    return unit_lanes(mix_lanes(seed ^ l * 0x9e3779b9u));
}

#endif
