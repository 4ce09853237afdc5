// Vectors: all that kernels know of their width and of how they are laid out.
//
// CPU devices run one work-item per thread and don't vectorize across work-items, so hot loops are
// written in vectors: over the columns or over the rows of a tile. `Lanes` are LANES floats, and
// what goes with them has as many lanes; `Doubles` are DOUBLES doubles, half as many, for what must
// be exact. Masks are -1 in lanes that hold and 0 in others.
#ifndef MB_LANES_H
#define MB_LANES_H

#include "shared/inlining.h"

#define LANES 16
typedef float16 Lanes;
typedef int16 LaneInts;
typedef uint16 LaneUints;
typedef int16 LaneMask;
typedef double16 LaneDoubles;
typedef long16 LaneDoubleMask;

#define DOUBLES 8
typedef double8 Doubles;
typedef long8 DoubleMask;
typedef float8 Floats;
typedef int8 Ints;
typedef uint8 Uints;

#define to_lanes convert_float16
#define to_lane_ints convert_int16
#define to_lane_uints convert_uint16
#define to_lane_doubles convert_double16
#define to_lane_double_mask convert_long16
#define bits_to_lanes as_float16
#define lanes_to_bits as_uint16
#define as_lane_ints as_int16

#define to_doubles convert_double8
#define to_double_mask convert_long8
#define to_floats convert_float8
#define to_ints convert_int8

// From and to arrays of the lanes' type.
#define lanes_load(from) vload16(0, from)
#define lanes_store(lanes, to) vstore16(lanes, 0, to)
#define doubles_load(from) vload8(0, from)
#define doubles_store(doubles, to) vstore8(doubles, 0, to)

// Lane i of a vector of this type, to read or to write.
#define LANE(type, vector, i) (((type *)&(vector))[i])

// Likewise of a record of lanes x, y and z.
#define LANE3(vectors, i) \
    ((float3)(LANE(float, (vectors).x, i), LANE(float, (vectors).y, i), \
              LANE(float, (vectors).z, i)))

// The first half of lanes, which goes with Doubles.
#define FIRST_HALF(lanes) ((lanes).lo)

#define LANE_INDEX ((Lanes)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#define DOUBLE_INDEX(type) ((type)(0, 1, 2, 3, 4, 5, 6, 7))

// Lanes as a square: the column and the row of each.
#define SQUARE_COLUMN ((Lanes)(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3))
#define SQUARE_ROW ((Lanes)(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3))

// max and min by comparison: half the cost of fmax and fmin, whose NaN rules nothing here needs.
static INLINED Lanes lanes_max(Lanes a, Lanes b) { return a > b ? a : b; }
static INLINED Lanes lanes_min(Lanes a, Lanes b) { return a < b ? a : b; }
static INLINED Doubles doubles_max(Doubles a, Doubles b) { return a > b ? a : b; }
static INLINED Doubles doubles_min(Doubles a, Doubles b) { return a < b ? a : b; }

static INLINED float lanes_sum(Lanes a)
{
    const float4 *part = (const float4 *)&a;
    float4 sum = (part[0] + part[2]) + (part[1] + part[3]);
    return (sum.x + sum.z) + (sum.y + sum.w);
}

static INLINED float lanes_greatest(Lanes a)
{
    const float4 *part = (const float4 *)&a;
    float4 b = part[0] > part[1] ? part[0] : part[1], c = part[2] > part[3] ? part[2] : part[3];
    b = b > c ? b : c;
    return fmax(fmax(b.x, b.y), fmax(b.z, b.w));
}

// Likewise where some may be NaN, which do not count.
static INLINED float lanes_greatest_number(Lanes a)
{
    const float4 *part = (const float4 *)&a;
    float4 most = fmax(fmax(part[0], part[2]), fmax(part[1], part[3]));
    return fmax(fmax(most.x, most.z), fmax(most.y, most.w));
}

static INLINED float lanes_least(Lanes a) { return -lanes_greatest(-a); }

static INLINED float first_lane(Lanes a) { return a.s0; }

// The next lane's value less each lane's; 0 in the last.
static INLINED Lanes lanes_steps(Lanes a) { return a.s123456789abcdeff - a; }
static INLINED LaneDoubles lane_doubles_steps(LaneDoubles a) { return a.s123456789abcdeff - a; }

// By parts of four: Oclgrind takes halves of halves for unwritten.
static INLINED bool any_lane(LaneMask mask)
{
    const int4 *part = (const int4 *)&mask;
    int4 any = (part[0] | part[1]) | (part[2] | part[3]);
    return (any.x | any.y | any.z | any.w) != 0;
}

// Whether any lane is below zero. By OpenCL's function: of lanes that were never written, and are
// masked since, Oclgrind takes the result of any_lane for unwritten too.
static INLINED bool any_below_zero(LaneInts a) { return any(a); }

static INLINED uint count_lanes(LaneMask mask)
{
    const int4 *part = (const int4 *)&mask;
    int4 sum = (part[0] + part[1]) + (part[2] + part[3]); // true is -1
    return (uint)-(sum.x + sum.y + sum.z + sum.w);
}

static INLINED bool any_double(DoubleMask mask)
{
    const long4 *part = (const long4 *)&mask;
    long4 any = part[0] | part[1];
    return (any.x | any.y | any.z | any.w) != 0;
}

static INLINED bool any_int(Ints mask)
{
    const int4 *part = (const int4 *)&mask;
    int4 any = part[0] | part[1];
    return (any.x | any.y | any.z | any.w) != 0;
}

#endif
