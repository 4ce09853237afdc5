// Cube maps: light by direction.
//
// Face 2 a is around the positive axis a = x, y, z, face 2 a + 1 around the negative one. On it u
// and v are the two other coordinates, in the order x y z x, over the distance along the axis: from
// -1 to 1. The outermost texels have their centres on the edges, so that faces that meet share them
// and a bilinear look-up knows no seam: `size` steps along an edge lie between size + 1 texels.
#ifndef MB_CUBE_MAP_H
#define MB_CUBE_MAP_H

#include "shared/vectors.h"
#include "shared/records.h"

// A place on the cube.
typedef struct {
    uint face;
    float u, v;
} CubePlace;

static inline CubePlace cube_place(float3 d)
{
    float3 size = fabs(d);
    CubePlace p;
    float depth;
    if (size.x >= size.y && size.x >= size.z)
        p.face = d.x < 0.0f ? 1u : 0u, depth = size.x, p.u = d.y, p.v = d.z;
    else if (size.y >= size.z)
        p.face = d.y < 0.0f ? 3u : 2u, depth = size.y, p.u = d.z, p.v = d.x;
    else
        p.face = d.z < 0.0f ? 5u : 4u, depth = size.z, p.u = d.x, p.v = d.y;
    depth = 1.0f / fmax(depth, FLT_MIN);
    p.u *= depth, p.v *= depth;
    return p;
}

// The direction of a place; u and v may lie beyond the face.
static inline float3 cube_direction(CubePlace p)
{
    float along = p.face & 1u ? -1.0f : 1.0f;
    return p.face < 2u ? (float3)(along, p.u, p.v)
           : p.face < 4u ? (float3)(p.v, along, p.u) : (float3)(p.u, p.v, along);
}

// Look-up on one level, whose texels are given.
static inline float4 cube_bilinear(global const float4 *texels, uint size, CubePlace p)
{
    float x = clamp(0.5f * (p.u + 1.0f), 0.0f, 1.0f) * size;
    float y = clamp(0.5f * (p.v + 1.0f), 0.0f, 1.0f) * size;
    uint column = min((uint)x, size - 1u), row = min((uint)y, size - 1u), wide = size + 1u;
    global const float4 *corner = texels + ((size_t)p.face * wide + row) * wide + column;
    return mix(mix(corner[0], corner[1], x - column),
               mix(corner[wide], corner[wide + 1u], x - column), y - row);
}

// Look-up between levels; `texels` are those of a part of the shutter.
static float4 cube_trilinear(const CubeMap *map, global const float4 *texels, CubePlace p,
                             float level)
{
    level = clamp(level, 0.0f, map->levels - 1.0f);
    uint below = min((uint)level, map->levels - 1u);
    float4 found = cube_bilinear(texels + map->first[below], map->size[below], p);
    if (level == below) return found;
    return mix(found, cube_bilinear(texels + map->first[below + 1u], map->size[below + 1u], p),
               level - below);
}

// Light from directions d, of any length, at times t of the shutter; `count` of them matter.
static Lanes3 cube_light(const CubeMap *map, global const float4 *texels, Lanes3 d,
                         const Lanes *level, const Lanes *t, int count)
{
    float x[LANES], y[LANES], z[LANES], levels[LANES], times[LANES];
    lanes_store(d.x, x), lanes_store(d.y, y), lanes_store(d.z, z);
    lanes_store(*level, levels), lanes_store(*t, times);
    float found[3][LANES];
    for (int i = 0; i < LANES; i++) {
        float4 light = 0.0f;
        if (i < count && map->levels > 0u) {
            float part = clamp(times[i], 0.0f, 1.0f) * map->times;
            size_t start = (size_t)min((uint)part, map->times - 1u) * map->stride;
            CubePlace place = cube_place((float3)(x[i], y[i], z[i]));
            light = cube_trilinear(map, texels + start, place, levels[i]);
        }
        found[0][i] = light.x, found[1][i] = light.y, found[2][i] = light.z;
    }
    return (Lanes3){lanes_load(found[0]), lanes_load(found[1]), lanes_load(found[2])};
}

#endif
