// Running sums of counts of paths by tile and chunk.
#include "shared/records.h"

// Turn counts into places to write to: tile by tile, within a tile chunk by chunk. starts[tile] is
// the first entry of a tile; starts[tiles] is the number of all entries, NONE where 32 bits don't
// hold it.
kernel void bin_scan(uint tiles, uint chunks, global uint *counts, global uint *starts)
{
    ulong total = 0;
    for (uint tile = 0; tile < tiles; tile++) {
        starts[tile] = (uint)total;
        for (uint chunk = 0; chunk < chunks; chunk++) {
            size_t place = (size_t)chunk * tiles + tile;
            uint count = counts[place];
            counts[place] = (uint)total;
            total += count;
        }
    }
    starts[tiles] = total < NONE ? (uint)total : NONE;
}
