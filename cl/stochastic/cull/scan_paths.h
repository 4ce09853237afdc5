// How the published methods go over a tile: path by path, and for each block of pixels slab by
// slab.
//
// A method's file defines what it knows of a path (Cull) and of the pixels of a block (Bounded);
// begin_path, whether a path is scanned at all; bound_pixels, which of a block's pixels it may
// touch; and keep_samples, which of their samples are tested. Samples at times of other motion
// segments never are.
#ifndef MB_SCAN_PATHS_H
#define MB_SCAN_PATHS_H

#include "shared/effects.h"
#include "stochastic/test.h"

// Whether the path is known to lie before all that the slab has seen.
static inline bool is_first(const Cull *cull, int slab)
{
#if ZMIN()
    return cull->first[slab];
#else
    return false;
#endif
}

static void scan_block(Tile *tile, const Moving *m, const Cull *cull, int block)
{
    Bounded bounded;
    LaneMask pixels = bound_pixels(tile, m, cull, block, &bounded);
    if (!any_lane(pixels)) return;
    for (int k = 0; k < tile->slabs; k++) {
        SlabSamples slab = {.index = k, .at = load_samples(tile, sample_index(k, block))};
        slab.tau = time_in_segment(m, slab.at.t);
        LaneMask mask = pixels & in_segment(m, slab.at.t);
        COUNT(tile, visited, mask);
        mask = keep_samples(tile, m, cull, &bounded, &slab, mask);
        if (any_lane(mask)) test_samples(tile, m, k, block, mask, is_first(cull, k));
    }
}

static void sample(Tile *tile)
{
    for (uint k = 0; k < tile->member_count; k++) {
        if (!is_sampled_now(tile, tile->members[k])) continue;
        Moving m = load_moving(tile, tile->members[k]);
#if GLOSSY()
        if (m.sheared) { // the published methods know of no shear
            for (int slab = 0; slab < tile->slabs; slab++)
                for (int block = 0; block < BLOCKS; block++)
                    test_samples(tile, &m, slab, block, (LaneMask)(-1), false);
            continue;
        }
#endif
        Cull cull;
        if (!begin_path(tile, &m, &cull)) continue;
        for (int block = 0; block < BLOCKS; block++) scan_block(tile, &m, &cull, block);
    }
}

#endif
