// Colours of sixteen places at a time.
#ifndef MB_COLORS_H
#define MB_COLORS_H

#include "shared/effects.h"
#include "shared/lanes.h"

static inline float3 load3(global const float *p) { return (float3)(p[0], p[1], p[2]); }

// Sixteen colours, with alpha where it varies over a surface. Those of textures are premultiplied.
typedef struct {
    Lanes x, y, z;
#if ALPHA_VARIES()
    Lanes alpha;
#endif
} Colors;

#if ALPHA_VARIES()
static inline Colors unpremultiplied(Colors c)
{
    Lanes over = c.alpha > 0.0f ? 1.0f / c.alpha : (Lanes)(0.0f);
    c.x *= over, c.y *= over, c.z *= over;
    return c;
}
#endif

#endif
