// Test sixteen samples against a moving triangle, and keep what is nearest.
#ifndef MB_TEST_H
#define MB_TEST_H

#include "stochastic/moving.h"

// Of equal depths the path that comes first is seen, so that the order of paths plays no part. A
// path that is `first`, nearer than all that the slab has seen, needs no comparison.
static inline void test_samples(Tile *tile, const Moving *m, int slab, int block, LaneMask mask,
                                bool first)
{
    int index = sample_index(slab, block);
    Samples samples = load_samples(tile, index);
    Lanes depth;
    COUNT(tile, tests, mask);
    mask = covered(m, &samples, mask, &depth);
    COUNT(tile, hits, mask);
    if (!any_lane(mask)) return;
    Lanes before = load(tile->zs, index);
    uint16 owner = vload16(0, tile->owners + index);
    if (!first) {
        COUNT(tile, depth_tests, mask);
        mask &= (depth < before) | ((depth == before) & ((uint16)(m->path) < owner));
    }
    Lanes nearest = mask ? depth : before;
    vstore16(nearest, 0, tile->zs + index);
    vstore16(mask ? (uint16)(m->path) : owner, 0, tile->owners + index);
    tile->block_far[slab * BLOCKS + block] = greatest_lane(nearest);
#ifdef ZMIN
    tile->block_near[slab * BLOCKS + block] = least_lane(nearest);
#endif
}

#endif
