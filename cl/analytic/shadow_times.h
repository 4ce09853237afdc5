// When a caster stands in the light: the times at which the signs of its functions change.
#ifndef MB_SHADOW_TIMES_H
#define MB_SHADOW_TIMES_H

#include "analytic/shadow_functions.h"

// Functions of time whose signs say whether the triangle stands in the light: 0 1 2 of its edges,
// then the sides of its plane that the light and the point are on.
#define LIGHT_SIDE 3
#define POINT_SIDE 4
#define SHADOW_FUNCTIONS 5
#define MOST_SIGN_CHANGES 23

typedef struct {
    int sign[SHADOW_FUNCTIONS]; // at first: -1 or 1, or 0 where it is zero throughout
    int count;
    double time[MOST_SIGN_CHANGES]; // of changes, ascending, in the stretch's [0, 1]
    int function[MOST_SIGN_CHANGES];
} SignChanges;

static void insert_sign_change(SignChanges *s, double time, int function)
{
    int k = s->count++;
    for (; k > 0 && s->time[k - 1] > time; k--)
        s->time[k] = s->time[k - 1], s->function[k] = s->function[k - 1];
    s->time[k] = time, s->function[k] = function;
}

// Add a quintic's sign at first, and when it changes.
NOT_INLINED static void add_quintic(SignChanges *s, const double *b, int function)
{
    s->sign[function] = 0;
    for (int k = QUINTIC - 1; k >= 0; k--)
        if (b[k] != 0.0) s->sign[function] = b[k] < 0.0 ? -1 : 1;
    if (quintic_variations(b) == 0) return;
    double roots[5];
    int count = quintic_roots(b, roots);
    for (int k = 0; k < count; k++) insert_sign_change(s, roots[k], function);
}

NOT_INLINED static void add_cubic(SignChanges *s, const double *b, int function)
{
    double start = bernstein_cubic_start(b), roots[3];
    s->sign[function] = start < 0.0 ? -1 : start > 0.0;
    int count = bernstein_cubic_roots(b, roots);
    for (int k = 0; k < count; k++) insert_sign_change(s, roots[k], function);
}

// Whether the signs are those of a triangle between the light and the point.
static inline bool stands_between(const int *sign)
{
    int side = sign[LIGHT_SIDE];
    bool covered = true; // on an edge, too
    for (int i = 0; i < 3; i++) covered &= sign[i] != -side;
    return covered && side != 0 && sign[POINT_SIDE] == -side;
}

// Signs of the functions of one caster, and their changes.
static void caster_signs(const CasterFunctions *f, int lane, SignChanges *signs)
{
    double b[QUINTIC];
    signs->count = 0;
    for (int side = 0; side < 3; side++) {
        for (int k = 0; k < QUINTIC; k++) b[k] = LANE(double, f->edge[side][k], lane);
        add_quintic(signs, b, side);
    }
    for (int k = 0; k < 4; k++) b[k] = LANE(double, f->of_light[k], lane);
    add_cubic(signs, b, LIGHT_SIDE);
    for (int k = 0; k < QUINTIC; k++) b[k] = LANE(double, f->of_point[k], lane);
    add_quintic(signs, b, POINT_SIDE);
}

#endif
