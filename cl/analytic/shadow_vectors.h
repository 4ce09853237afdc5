// Eight vectors at a time, and such that are polynomials of time in Bernstein form.
#ifndef MB_SHADOW_VECTORS_H
#define MB_SHADOW_VECTORS_H

#include "shared/inlining.h"
#include "shared/quintic.h"

// Casters are worked on eight at a time, one in each lane.
#define CASTERS 8
typedef double8 Doubles;
typedef long8 DoubleMask;

// Eight vectors.
typedef struct {
    Doubles x, y, z;
} Vectors;

static inline Vectors vectors_minus(Vectors a, Vectors b)
{
    Vectors difference = {a.x - b.x, a.y - b.y, a.z - b.z};
    return difference;
}

// a + by * b
static INLINED Vectors vectors_added(Vectors a, Doubles by, Vectors b)
{
    Vectors sum = {a.x + by * b.x, a.y + by * b.y, a.z + by * b.z};
    return sum;
}

static inline Vectors vectors_cross(Vectors a, Vectors b)
{
    Vectors product = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return product;
}

static INLINED Doubles vectors_dot(Vectors a, Vectors b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static INLINED Vectors vectors_of(double3 v)
{
    Vectors all = {v.x, v.y, v.z};
    return all;
}

static INLINED Doubles magnitudes(Doubles a) { return a < 0.0 ? -a : a; }

// The sum of the magnitudes of the coordinates.
static INLINED Doubles vectors_size(Vectors a)
{
    return magnitudes(a.x) + magnitudes(a.y) + magnitudes(a.z);
}

// Bernstein coefficients of vectors that are linear, quadratic or cubic in time.
typedef struct {
    Vectors c[2];
} Linear;

typedef struct {
    Vectors c[3];
} Quadratic;

typedef struct {
    Vectors c[4];
} Cubic;

// Coefficients of a quadratic as those of a cubic.
static void quadratic_as_cubic(const double *e, double *out)
{
    out[0] = e[0], out[1] = (e[0] + 2.0 * e[1]) / 3.0, out[2] = (2.0 * e[1] + e[2]) / 3.0;
    out[3] = e[2];
}

static void quadratics_as_cubics(const Doubles *e, Doubles *out)
{
    out[0] = e[0], out[1] = (e[0] + 2.0 * e[1]) / 3.0, out[2] = (2.0 * e[1] + e[2]) / 3.0;
    out[3] = e[2];
}

// The cross product over time.
static Quadratic cross_over_time(Linear a, Linear b)
{
    Quadratic product;
    Vectors early = vectors_cross(a.c[0], b.c[1]), late = vectors_cross(a.c[1], b.c[0]);
    product.c[0] = vectors_cross(a.c[0], b.c[0]), product.c[2] = vectors_cross(a.c[1], b.c[1]);
    product.c[1].x = 0.5 * (early.x + late.x), product.c[1].y = 0.5 * (early.y + late.y);
    product.c[1].z = 0.5 * (early.z + late.z);
    return product;
}

// Add the product of quadratics and cubics.
static inline void add_product(const Doubles *q, const Doubles *c, Doubles *sum)
{
    sum[0] += q[0] * c[0];
    sum[1] += 0.4 * (q[1] * c[0]) + 0.6 * (q[0] * c[1]);
    sum[2] += 0.1 * (q[2] * c[0]) + 0.6 * (q[1] * c[1]) + 0.3 * (q[0] * c[2]);
    sum[3] += 0.3 * (q[2] * c[1]) + 0.6 * (q[1] * c[2]) + 0.1 * (q[0] * c[3]);
    sum[4] += 0.6 * (q[2] * c[2]) + 0.4 * (q[1] * c[3]);
    sum[5] += q[2] * c[3];
}

// The dot product over time.
NOT_INLINED static void dot_over_time(const Quadratic *a, const Cubic *b, Doubles *out)
{
    Doubles q[3], c[4];
    for (int k = 0; k < QUINTIC; k++) out[k] = 0.0;
    for (int k = 0; k < 3; k++) q[k] = a->c[k].x;
    for (int k = 0; k < 4; k++) c[k] = b->c[k].x;
    add_product(q, c, out);
    for (int k = 0; k < 3; k++) q[k] = a->c[k].y;
    for (int k = 0; k < 4; k++) c[k] = b->c[k].y;
    add_product(q, c, out);
    for (int k = 0; k < 3; k++) q[k] = a->c[k].z;
    for (int k = 0; k < 4; k++) c[k] = b->c[k].z;
    add_product(q, c, out);
}

// Lanes in which any coefficient is above zero.
static INLINED DoubleMask any_above(const Doubles *b, int count)
{
    DoubleMask found = b[0] > 0.0;
    for (int k = 1; k < count; k++) found |= b[k] > 0.0;
    return found;
}

static INLINED DoubleMask any_below(const Doubles *b, int count)
{
    DoubleMask found = b[0] < 0.0;
    for (int k = 1; k < count; k++) found |= b[k] < 0.0;
    return found;
}

static INLINED bool none_of(DoubleMask mask)
{
    const long4 *part = (const long4 *)&mask;
    long4 any = part[0] | part[1];
    return (any.x | any.y | any.z | any.w) == 0;
}

#endif
