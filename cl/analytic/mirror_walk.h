// Mirrors: what stands behind a mirror in the list of a sample, front to back, is what it shows.
//
// What is seen in mirror k lies in world k, all else in world 0. A walk from the eye begins in
// world 0, passes over what lies in other worlds, and goes on in world k where it comes to mirror
// k. So what is reflected shows only where the mirror is, behind it and not behind what hides it,
// and is cut off at the mirror's plane; what stands behind the mirror in world 0 hides nothing of
// it.
#ifndef MB_MIRROR_WALK_H
#define MB_MIRROR_WALK_H

#include "shared/effects.h"
#include "analytic/tile_of_rows.h"

// Whether a walk from the eye that comes to this path in `world` sees it; where it is a mirror the
// world changes.
static inline bool walk_sees(const Tile *tile, uint path, uint *world)
{
#if MIRRORS()
    global const Mesh *mesh = mesh_of(&tile->scene, path);
    if (mesh->world != *world) return false;
    if (mesh->mirror) *world = mesh->mirror;
#endif
    return true;
}

// Alpha of a path, or what of its own colour a mirror shows; below 0 where it varies.
static inline float alpha_of_path(const Tile *tile, uint path)
{
#if MIRRORS()
    global const Mesh *mesh = mesh_of(&tile->scene, path);
    if (mesh->mirror) return 1.0f - mesh->reflectivity;
#endif
    return tile->scene.paths[path].alpha;
}

// The layer of a stack that is a mirror, in which all that follow are seen; `count` if there is
// none.
static inline uint mirror_among(const Tile *tile, global const Span *spans, uint count)
{
#if MIRRORS()
    for (uint i = 0; i < count; i++)
        if (mesh_of(&tile->scene, spans[i].source)->mirror) return i;
#endif
    return count;
}

#endif
