// What a render finds besides its image: planes of 32-bit words, one for each channel, one after
// the other in the order of mbinterval/film/aovs.py. Each layer that is asked for is an effect;
// AOV_MESH is where both objects and materials come from.
#ifndef MB_AOV_H
#define MB_AOV_H

#include "shared/effects.h"

enum {
#if AOV_DEPTH()
    PLANE_DEPTH,
#endif
#if AOV_NORMAL()
    PLANE_NORMAL, PLANE_NORMAL_Y, PLANE_NORMAL_Z,
#endif
#if AOV_UV()
    PLANE_UV, PLANE_UV_V,
#endif
#if AOV_FORWARD()
    PLANE_FORWARD, PLANE_FORWARD_V,
#endif
#if AOV_BACKWARD()
    PLANE_BACKWARD, PLANE_BACKWARD_V,
#endif
#if AOV_MESH()
    PLANE_MESH,
#endif
#if AOV_OPERATIONS()
    PLANE_OPERATIONS,
#endif
    PLANES
};

// What goes with them; what is not asked for is not there.
typedef struct {
    size_t size;                   // words of a plane: pixels of the film
#if MOMENTARY() || AOV_OPERATIONS()
    global uint *planes;
#endif
#if AOV_SHARP()
    global float4 *sharp;          // the film at the moment
#endif
#if AOV_FORWARD()
    global const double *forward;  // where vertices are in the next frame, x w, y w and w
#endif
#if AOV_BACKWARD()
    global const double *backward; // in the one before
#endif
} Aovs;

#endif
