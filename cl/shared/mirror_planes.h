// Directions in the worlds that are seen in mirrors, and in the real one that they are images of.
#ifndef MB_MIRROR_PLANES_H
#define MB_MIRROR_PLANES_H

#include "shared/effects.h"
#include "shared/vectors.h"
#include "shared/scene.h"

// Directions in the world of a mirror as they are in the real one.
static inline Lanes3 unmirrored(const Scene *scene, uint world, Lanes3 ways)
{
#if MIRRORS()
    if (world == 0u) return ways;
    float3 normal = vload3(0, scene->mirror_planes[world - 1u].normal);
    Lanes3 n = {normal.x, normal.y, normal.z};
    return lanes_added(ways, -2.0f * lanes_dot(ways, n), normal);
#else
    return ways;
#endif
}

// What is infinitely far is seen in these directions through the points (a, b) of a glossy mirror's
// disc: those in which it lies.
static INLINED Lanes3 unsheared(const Scene *scene, uint world, Lanes3 ways, Lanes a, Lanes b)
{
#if GLOSSY()
    if (world == 0u) return ways;
    global const MirrorPlane *plane = scene->mirror_planes + (world - 1u);
    float3 normal = vload3(0, plane->normal);
    Lanes height = lanes_dot(ways, (Lanes3){normal.x, normal.y, normal.z});
    ways = lanes_added(ways, -height * a, vload3(0, plane->tangents));
    ways = lanes_added(ways, -height * b, vload3(1, plane->tangents));
#endif
    return ways;
}

#endif
