// Bits of whole numbers, mixed and reversed: of one number, or of sixteen side by side.
#ifndef MB_BITS_H
#define MB_BITS_H

#include "shared/inlining.h"

// `mix` is a good 32-bit integer mixer (lowbias32, Wellons 2018).
#define BITS_OF(type, mix, reverse) \
    static INLINED type mix(type x) \
    { \
        x ^= x >> 16; \
        x *= 0x7feb352du; \
        x ^= x >> 15; \
        x *= 0x846ca68bu; \
        return x ^ x >> 16; \
    } \
    static INLINED type reverse(type x) \
    { \
        x = x << 16 | x >> 16; \
        x = (x & 0x00ff00ffu) << 8 | (x >> 8 & 0x00ff00ffu); \
        x = (x & 0x0f0f0f0fu) << 4 | (x >> 4 & 0x0f0f0f0fu); \
        x = (x & 0x33333333u) << 2 | (x >> 2 & 0x33333333u); \
        return (x & 0x55555555u) << 1 | (x >> 1 & 0x55555555u); \
    }

BITS_OF(uint, mix_bits, reverse_bits)
BITS_OF(LaneUints, mix_lanes, reverse_lanes)

#endif
