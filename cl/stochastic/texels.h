// What textures are asked for: texels of bilinear look-ups, and the lines of 4 x 4 texels, of 4
// bytes each, that a cache of 6 kB has to fetch for them (Akenine-Moeller et al. 2007, 4.4). The
// cache has 16 sets of 6 lines, the one used longest ago gives way, and it is empty where a tile
// begins, so that counts do not depend on who renders which tile.
#ifndef MB_TEXELS_H
#define MB_TEXELS_H

#include "stochastic/tile_of_slabs.h"
#include "shared/textures.h"

static void fetch_line(Tile *tile, uint line, int set)
{
    uint *lines = tile->texel_cache[set];
    int way = 0;
    while (way < CACHE_WAYS - 1 && lines[way] != line) way++;
    tile->statistics.texel_lines += lines[way] != line;
    for (; way > 0; way--) lines[way] = lines[way - 1];
    lines[0] = line;
}

// Count the look-ups at the first `count` places, which are those of texture_at at level 0.
static INLINED void count_texels(Tile *tile, Texture texture, Lanes u, Lanes v, int count)
{
    if (texture.wrap != WRAP_CLAMP)
        u -= floor(u / 2.0f) * 2.0f, v -= floor(v / 2.0f) * 2.0f;
    Lanes x = floor(u * (float)texture.width - 0.5f);
    Lanes y = floor((1.0f - v) * (float)texture.height - 0.5f);
    for (int corner = 0; corner < 4; corner++) {
        int column[LANES], row[LANES];
        lanes_store(wrap_texels(x + (float)(corner % 2), texture.width, texture.wrap), column);
        lanes_store(wrap_texels(y + (float)(corner / 2), texture.height, texture.wrap), row);
        for (int i = 0; i < count; i++) {
            uint line = texture.texel + (row[i] & ~3) * texture.width + (column[i] & ~3) + 1;
            fetch_line(tile, line, column[i] / 4 % 4 + row[i] / 4 % 4 * 4);
        }
    }
    tile->statistics.texels += 4 * count;
}

#endif
