// From the unit square to the lens: a disc, or a polygon of blades.
#ifndef MB_LENS_H
#define MB_LENS_H

#include "shared/effects.h"
#include "shared/records.h"

// Area-preserving map of the unit square to the unit disc.
static float2 square_to_disc(float2 square)
{
    float x = 2.0f * square.x - 1.0f, y = 2.0f * square.y - 1.0f;
    if (x == 0.0f && y == 0.0f) return (float2)(0.0f);
    bool wide = fabs(x) > fabs(y);
    float radius = wide ? x : y;
    float angle = wide ? M_PI_4_F * (y / x) : M_PI_2_F - M_PI_4_F * (x / y);
    return radius * (float2)(cos(angle), sin(angle));
}

#if BLADES()
// Likewise to the regular polygon of the blades within the unit disc.
static float2 square_to_polygon(float2 square, const Numbers *numbers)
{
    float scaled = square.x * numbers->blades, blade = floor(scaled), along = scaled - blade;
    float step = 2.0f * M_PI_F / numbers->blades, a = blade * step + numbers->blade_rotation;
    float out = sqrt(square.y);
    float2 p = (float2)(cos(a), sin(a)), q = (float2)(cos(a + step), sin(a + step));
    return out * mix(p, q, along);
}
#endif

#if SLICE_LINES()
// Likewise along lines that go from rim to rim through the middle: x says which line, y where on
// it.
// Areas are kept, so that places crowd towards the rim as all lines together do in the middle.
static float2 square_to_disc_lines(float2 square)
{
    float along = 2.0f * square.y - 1.0f, turn = 0.5f * square.x + (along < 0.0f ? 0.5f : 0.0f);
    float angle = 2.0f * M_PI_F * turn;
    return sqrt(fabs(along)) * (float2)(cos(angle), sin(angle));
}

#if BLADES()
// Of a polygon. (A line's halves begin half the rim apart, which with an odd number of blades bends
// it a little.)
static float2 square_to_polygon_lines(float2 square, const Numbers *numbers)
{
    float along = 2.0f * square.y - 1.0f, turn = 0.5f * square.x + (along < 0.0f ? 0.5f : 0.0f);
    return square_to_polygon((float2)(turn, fabs(along)), numbers);
}
#endif
#endif

#endif
