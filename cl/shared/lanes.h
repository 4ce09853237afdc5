// Sixteen floats at a time. CPU devices run one work-item per thread and don't vectorize across
// work-items, so hot loops are written in vectors: over the columns or over the rows of a tile.
#ifndef MB_LANES_H
#define MB_LANES_H

#include "shared/inlining.h"

#define LANES 16
typedef float16 Lanes;
typedef int16 LaneMask;

#define LANE_INDEX ((Lanes)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))

// max and min by comparison: half the cost of fmax and fmin, whose NaN rules nothing here needs.
static INLINED Lanes lanes_max(Lanes a, Lanes b) { return a > b ? a : b; }
static INLINED Lanes lanes_min(Lanes a, Lanes b) { return a < b ? a : b; }

static INLINED float lanes_sum(Lanes a)
{
    const float4 *part = (const float4 *)&a;
    float4 sum = (part[0] + part[2]) + (part[1] + part[3]);
    return (sum.x + sum.z) + (sum.y + sum.w);
}

static INLINED float lanes_greatest(Lanes a)
{
    const float4 *part = (const float4 *)&a;
    float4 most = fmax(fmax(part[0], part[2]), fmax(part[1], part[3]));
    return fmax(fmax(most.x, most.z), fmax(most.y, most.w));
}

// The next lane's value less each lane's; 0 in the last.
static INLINED Lanes lanes_steps(Lanes a) { return a.s123456789abcdeff - a; }

// Sixteen vectors.
typedef struct {
    Lanes x, y, z;
} Lanes3;

static INLINED Lanes lanes_dot(Lanes3 a, Lanes3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static INLINED Lanes3 lanes_scaled(Lanes3 a, Lanes by)
{
    Lanes3 scaled = {a.x * by, a.y * by, a.z * by};
    return scaled;
}

// Of length 1; zero stays zero.
static inline Lanes3 lanes_unit(Lanes3 a)
{
    return lanes_scaled(a, 1.0f / sqrt(lanes_max(lanes_dot(a, a), FLT_MIN)));
}

// a + by * b, of a vector that all lanes share
static INLINED Lanes3 lanes_added(Lanes3 a, Lanes by, float3 b)
{
    Lanes3 sum = {a.x + by * b.x, a.y + by * b.y, a.z + by * b.z};
    return sum;
}

// value - position * weight, rounded once, plus the same of the low parts.
static INLINED Lanes lanes_shift(float value, float value_low, Lanes position, float weight,
                                 float weight_low)
{
    return fma(-position, (Lanes)(weight), (Lanes)(value))
           + fma(-position, (Lanes)(weight_low), (Lanes)(value_low));
}

#endif
