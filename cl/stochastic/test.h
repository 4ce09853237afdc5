// Test sixteen samples against a moving triangle, and keep what is nearest.
#ifndef MB_TEST_H
#define MB_TEST_H

#include "stochastic/moving.h"

// Of equal depths the path that comes first is seen, so that the order of paths plays no part.
static inline void test_samples(Tile *tile, const Moving *m, int slab, int block, LaneMask mask)
{
    int index = sample_index(slab, block);
    Samples samples = load_samples(tile, index);
    Lanes depth;
#ifdef STATISTICS
    tile->statistics.tests += count_lanes(mask);
#endif
    mask = covered(m, &samples, mask, &depth);
#ifdef STATISTICS
    tile->statistics.hits += count_lanes(mask);
#endif
    if (!any_lane(mask)) return;
    Lanes before = load(tile->zs, index);
    uint16 owner = vload16(0, tile->owners + index);
    mask &= (depth < before) | ((depth == before) & ((uint16)(m->path) < owner));
    Lanes nearest = mask ? depth : before;
    vstore16(nearest, 0, tile->zs + index);
    vstore16(mask ? (uint16)(m->path) : owner, 0, tile->owners + index);
    tile->block_far[slab * BLOCKS + block] = greatest_lane(nearest);
}

#endif
