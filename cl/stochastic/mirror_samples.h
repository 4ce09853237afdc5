// Mirrors: what samples see of the world is found first, then, of those that see a mirror, what
// they see in it, by the same culling and tests, behind the mirror at the sample's own place and
// time.
#ifndef MB_MIRROR_SAMPLES_H
#define MB_MIRROR_SAMPLES_H

#include "shared/effects.h"
#include "stochastic/tile_of_slabs.h"
#if SKY()
#include "shared/gaze.h"
#endif

// Whether a path is sampled now: in mirrors what is reflected, before that all else.
static inline bool is_sampled_now(const Tile *tile, uint path)
{
#if MIRRORS()
    return (mesh_of(&tile->scene, path)->world != 0u) == tile->in_mirrors;
#else
    return true;
#endif
}

#if MIRRORS()

// The mirror that a sample sees, or 0.
static inline uint mirror_seen(const Tile *tile, uint owner)
{
    return owner == NONE ? 0u : mesh_of(&tile->scene, owner)->mirror;
}

// Those of the samples that see the mirror of this world before `depth`.
static INLINED LaneMask seen_in_mirror(const Tile *tile, uint path, int index, LaneMask mask,
                                       Lanes depth)
{
    if (!tile->in_mirrors || !any_lane(mask)) return mask;
    uint world = mesh_of(&tile->scene, path)->world;
    int shows[LANES];
    for (int i = 0; i < LANES; i++)
        shows[i] = mirror_seen(tile, tile->mirror_owners[index + i]) == world ? -1 : 0;
    return mask & lanes_load(shows) & (depth > load(tile->mirror_zs, index));
}

static void swap_mirrored(Tile *tile)
{
    global float *zs = tile->zs;
    global uint *owners = tile->owners;
    tile->zs = tile->mirror_zs, tile->owners = tile->mirror_owners;
    tile->mirror_zs = zs, tile->mirror_owners = owners;
}

// Begin to sample what is seen in mirrors. What sees none has everything hidden: its depth is 0.
static void enter_mirrors(Tile *tile)
{
    tile->in_mirrors = true;
    swap_mirrored(tile);
    for (int i = 0; i < tile->slabs * SLAB; i++) {
        tile->zs[i] = mirror_seen(tile, tile->mirror_owners[i]) ? INFINITY : 0.0f;
        tile->owners[i] = NONE;
    }
    for (int k = 0; k < tile->slabs * BLOCKS; k++) {
        Lanes zs = load(tile->zs, k * LANES);
        tile->block_far[k] = lanes_greatest(zs);
#if ZMIN()
        tile->block_near[k] = lanes_least(zs);
#endif
    }
    for (int k = 0; k < tile->slabs; k++) tile->far[k] = INFINITY;
}

static void leave_mirrors(Tile *tile)
{
    swap_mirrored(tile);
    tile->in_mirrors = false;
}

static bool find_mirrors(const Tile *tile)
{
    bool found = false;
    for (int i = 0; i < tile->slabs * SLAB && !found; i++)
        found = mirror_seen(tile, tile->owners[i]) != 0u;
    return found;
}

// What the mirror that a sample sees shows where nothing else is: the environment, or the
// background of the sample's pixel.
static float4 mirrored_behind(const Tile *tile, int index)
{
#if SKY()
    Gaze gaze = {tile->xs[index] + (tile->x + HALF), tile->ys[index] + (tile->y + HALF)};
#define TAKE(name) gaze.name = tile->name##s[index];
    MORE_COORDINATES(TAKE)
#undef TAKE
    gaze.world = mirror_seen(tile, tile->owners[index]);
    Patches at = sky_patches(&tile->scene, &gaze, (Lanes)(tile->ts[index]));
    Lanes3 light = sky_light(&tile->scene, &at, 1);
    return (float4)(LANE3(light, 0), 1.0f);
#else
    const Frame *film = &tile->film;
#if BACKGROUND_IMAGE()
    int pixel = index % SLAB, at = pixel_of(pixel / LANES, pixel % LANES);
    int x = tile->x + at % TILE - film->x, y = tile->y + at / TILE - film->y;
    if (x < 0 || y < 0 || x >= film->width || y >= film->height) return (float4)(1.0f);
    return (float4)(vload3((size_t)y * film->width + x, tile->background), 1.0f);
#else
    return (float4)(film->background[0], film->background[1], film->background[2], 1.0f);
#endif
#endif
}

// A sample's colour with what it sees in a mirror, if it sees one; nothing there has alpha 0.
static float4 with_mirrored(const Tile *tile, int index, float4 color, float4 mirrored)
{
    uint owner = tile->owners[index];
    if (!mirror_seen(tile, owner)) return color;
    if (mirrored.w == 0.0f) mirrored = mirrored_behind(tile, index);
    return mix(color, mirrored, mesh_of(&tile->scene, owner)->reflectivity);
}

#endif

#endif
