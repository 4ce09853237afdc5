// What lies behind everything.
#ifndef MB_FILM_H
#define MB_FILM_H

#include "shared/effects.h"
#include "shared/records.h"

// Colour with coverage over the background of the film's pixel `place`, if the film has one; an
// environment is in the colour already.
static inline float4 over_background(float4 color, size_t place, Frame frame,
                                     global const float *background)
{
#if !TRANSPARENT() && !SKY()
#if BACKGROUND_IMAGE()
    float3 behind = vload3(place, background);
#else
    float3 behind = (float3)(frame.background[0], frame.background[1], frame.background[2]);
#endif
    color.xyz += (1.0f - color.w) * behind;
#endif
    return color;
}

#endif
