// Sixteen floats at a time. CPU devices run one work-item per thread and don't vectorize across
// work-items, so hot loops are written in vectors: over the columns or over the rows of a tile.
#ifndef MB_LANES_H
#define MB_LANES_H

#define LANES 16
typedef float16 Lanes;
typedef int16 LaneMask;

#define LANE_INDEX ((Lanes)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))

// max and min by comparison: half the cost of fmax and fmin, whose NaN rules nothing here needs.
static inline Lanes lanes_max(Lanes a, Lanes b) { return a > b ? a : b; }
static inline Lanes lanes_min(Lanes a, Lanes b) { return a < b ? a : b; }

// value - position * weight, rounded once, plus the same of the low parts.
static inline Lanes lanes_shift(float value, float value_low, Lanes position, float weight,
                                float weight_low)
{
    return fma(-position, (Lanes)(weight), (Lanes)(value))
           + fma(-position, (Lanes)(weight_low), (Lanes)(value_low));
}

#endif
