// Vectors of three coordinates, as many at a time as there are lanes.
//
// Functions round as the pragma FP_CONTRACT says where they are made.
#ifndef MB_VECTORS_H
#define MB_VECTORS_H

#include "shared/lanes.h"

// Three coordinates of this type, and functions whose names begin with `name`: the dot product, the
// vector times a number, the sum of a and `by` times b, the difference, the cross product, and the
// sum of the magnitudes of the coordinates.
#define VECTORS_OF(type, name) \
    typedef struct { \
        type x, y, z; \
    } type##3; \
    static INLINED type name##_dot(type##3 a, type##3 b) \
    { \
        return a.x * b.x + a.y * b.y + a.z * b.z; \
    } \
    static INLINED type##3 name##_scaled(type##3 a, type by) \
    { \
        return (type##3){a.x * by, a.y * by, a.z * by}; \
    } \
    static INLINED type##3 name##_plus(type##3 a, type by, type##3 b) \
    { \
        return (type##3){a.x + by * b.x, a.y + by * b.y, a.z + by * b.z}; \
    } \
    static INLINED type##3 name##_minus(type##3 a, type##3 b) \
    { \
        return (type##3){a.x - b.x, a.y - b.y, a.z - b.z}; \
    } \
    static INLINED type##3 name##_cross(type##3 a, type##3 b) \
    { \
        return (type##3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; \
    } \
    static INLINED type name##_size(type##3 a) { return fabs(a.x) + fabs(a.y) + fabs(a.z); }

VECTORS_OF(Lanes, lanes)

// Of length 1; zero stays zero.
static INLINED Lanes3 lanes_unit(Lanes3 a)
{
    return lanes_scaled(a, 1.0f / sqrt(lanes_max(lanes_dot(a, a), FLT_MIN)));
}

// a + by * b, of a vector that all lanes share.
static INLINED Lanes3 lanes_added(Lanes3 a, Lanes by, float3 b)
{
    return lanes_plus(a, by, (Lanes3){b.x, b.y, b.z});
}

#endif
