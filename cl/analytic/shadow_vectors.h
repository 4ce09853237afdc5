// Vectors of casters, and such that are polynomials of time in Bernstein form.
#ifndef MB_SHADOW_VECTORS_H
#define MB_SHADOW_VECTORS_H

#include "shared/quintic.h"
#include "shared/vectors.h"

// One in each lane.
#define CASTERS DOUBLES

VECTORS_OF(Doubles, doubles)

static INLINED Doubles3 doubles_of(double3 v)
{
    Doubles3 all = {v.x, v.y, v.z};
    return all;
}

// Bernstein coefficients of vectors that are linear, quadratic or cubic in time.
typedef struct {
    Doubles3 c[2];
} Linear;

typedef struct {
    Doubles3 c[3];
} Quadratic;

typedef struct {
    Doubles3 c[4];
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
    Doubles3 early = doubles_cross(a.c[0], b.c[1]), late = doubles_cross(a.c[1], b.c[0]);
    product.c[0] = doubles_cross(a.c[0], b.c[0]), product.c[2] = doubles_cross(a.c[1], b.c[1]);
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

#endif
