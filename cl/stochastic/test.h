// Test sixteen samples against a moving triangle, and keep what is nearest.
#ifndef MB_TEST_H
#define MB_TEST_H

#include "shared/effects.h"
#include "stochastic/moving.h"
#include "stochastic/mirror_samples.h"
#if TRANSLUCENT()
#include "stochastic/surface_at_samples.h"

// Samples at which what is translucent is there: each surface with its alpha's probability, drawn
// for it and the sample alone (Enderton et al. 2010, 3). Nothing needs an order then, and the mean
// is that of all layers blended.
static INLINED LaneMask there_by_chance(Tile *tile, const Moving *m, const Samples *samples,
                                        int slab, int block, LaneMask mask)
{
    if (!(m->alpha < 1.0f)) return mask;
    Lanes alpha = m->alpha;
#if ALPHA_VARIES()
    if (m->alpha < 0.0f && any_lane(mask)) {
        Surface surface;
        load_surface(tile, m->path, &surface);
        alpha = alpha_at_samples(tile, &surface, samples);
    }
#endif
    LaneUints seed = mix_lanes(pixel_seeds(tile, block) ^ mix_bits(m->path + 1u));
    return mask & (hashed((uint)(tile->group + slab), seed) < alpha);
}
#endif

// Of equal depths the path that comes first is seen, so that the order of paths plays no part. A
// path that is `first`, nearer than all that the slab has seen, needs no comparison.
static INLINED void test_samples(Tile *tile, const Moving *m, int slab, int block, LaneMask mask,
                                 bool first)
{
    int index = sample_index(slab, block);
    Samples samples = load_samples(tile, index);
    Lanes depth;
    COUNT(tile, tests, mask);
    mask = covered(m, &samples, mask, &depth);
#if MIRRORS()
    mask = seen_in_mirror(tile, m->path, index, mask, depth);
#endif
#if TRANSLUCENT()
    mask = there_by_chance(tile, m, &samples, slab, block, mask);
#endif
    COUNT(tile, hits, mask);
    if (!any_lane(mask)) return;
    Lanes before = load(tile->zs, index);
    LaneUints owner = lanes_load(tile->owners + index);
    if (!first) {
        COUNT(tile, depth_tests, mask);
        mask &= (depth < before) | ((depth == before) & ((LaneUints)(m->path) < owner));
    }
    Lanes nearest = mask ? depth : before;
    lanes_store(nearest, tile->zs + index);
    lanes_store(mask ? (LaneUints)(m->path) : owner, tile->owners + index);
    tile->block_far[slab * BLOCKS + block] = lanes_greatest(nearest);
#if ZMIN()
    tile->block_near[slab * BLOCKS + block] = lanes_least(nearest);
#endif
}

#endif
