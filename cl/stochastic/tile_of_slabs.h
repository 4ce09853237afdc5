// What one work-item knows while it renders a tile by point samples: the scene, the tile's place,
// and scratch memory that is used again for the next tile.
//
// A tile is 16 blocks of 4 x 4 pixels, the lanes of a vector. Its samples lie slab by slab: a slab
// holds one sample of every pixel, all from a short stretch of time and, with a lens, a small part
// of it. Slabs are worked on some at a time, so that they stay in cache. Coordinates are relative
// to the middle of the tile, so that float32 is exact where it matters.
#ifndef MB_TILE_OF_SLABS_H
#define MB_TILE_OF_SLABS_H

#include "shared/effects.h"
#include "shared/scene.h"
#include "shared/vectors.h"
#include "stochastic/scramble.h"
#if SHADOWS()
#include "stochastic/trace.h"
#endif

#pragma OPENCL FP_CONTRACT OFF

#define TILE 16
#define BLOCK 4
#define BLOCKS 16
#define HALF (TILE / 2)
#define SLAB (BLOCKS * LANES) // samples of a slab
#ifndef MOST_SLABS
#define MOST_SLABS 64 // that are worked on at a time, SLABS of the plan
#endif

// Pixels whose tiles were bounded; samples that were looked at, passed each stage of culling, were
// tested, were hit, and were compared in depth; texels that were asked for, and lines of them that
// a small cache had to fetch.
typedef struct {
    ulong bounded, visited, stage1, tests, hits, depth_tests, texels, texel_lines;
} Statistics;

#if COUNT_TEXELS()
#define CACHE_SETS 16
#define CACHE_WAYS 6
#endif

#if STATISTICS()
#define COUNT(tile, what, mask) (tile)->statistics.what += count_lanes(mask)
#else
#define COUNT(tile, what, mask)
#endif

typedef struct {
    Scene scene;
#if SHADOWS()
    Occluders occluders;
    global const ShadowLight *shadow_lights;
    global const LightView *light_views;
    global const float *shadow_map; // texels, row by row, of each stratum of time of each view
#endif
    global const Bounds *bounds; // of the paths
    int x, y;                    // first pixel of the tile in the frame
    int x_low, x_high;           // columns of the tile that are rendered, low <= x < high
    int y_low, y_high;           // rows likewise
    float middle_x, middle_y, clip_scale; // the frame's middle from the tile's, 2 / its height
    struct {
        float left, right, top, bottom;
    } frame;                     // where samples of the frame may lie, from the tile's middle
    float reach_low, reach_high; // where samples lie relative to their pixel, in x and in y
    int group;                   // sample of the first slab
    int slabs;                   // slabs in use
    global const uint *members;  // paths that may touch the tile, from near to far
    uint member_count;
    // Of each sample of the group:
    global float *xs, *ys, *ts;
    global float *us, *vs;       // on the lens
#if GLOSSY()
    global float *as, *bs;       // on the disc of glossy mirrors
#endif
    global float *zs;            // depth of the nearest surface so far
    global uint *owners;         // its path, or NONE
#if MIRRORS()
    global float *mirror_zs;     // likewise of what is seen in mirrors; while that is sampled, the
    global uint *mirror_owners;  // two have changed places
    bool in_mirrors;             // that is sampled
    bool has_mirrors;            // some sample of the group sees one
    Frame film;
    global const float *background; // an image, if there is one
#endif
    // Of each slab of the group:
    float t_low[MOST_SLABS], t_high[MOST_SLABS];
#if LENS()
    float u_low[MOST_SLABS], u_high[MOST_SLABS], v_low[MOST_SLABS], v_high[MOST_SLABS];
#endif
    float far[MOST_SLABS];            // greatest depth of any of its samples, or more
    float block_far[MOST_SLABS * BLOCKS];  // likewise of each of its blocks
#if ZMIN()
    float block_near[MOST_SLABS * BLOCKS]; // least depth of any of its samples
#endif
    Statistics statistics;
#if COUNT_TEXELS()
    uint texel_cache[CACHE_SETS][CACHE_WAYS];
#endif
    global float4 *color;        // per pixel: sums over samples, alpha last
    global float *depth;
    global uint *count;          // samples that see something
#if WEIGHTED()
    global float4 *signed_color; // likewise, each sample with the filter's sign
    global float *signed_depth;
    global float *sign_sum;
#endif
#if PATTERN_RGSS()
    global float4 *sample_colors; // of the tile's samples, slab by slab
    global float *sample_depths;  // times alpha
#endif
} Tile;

// The first of sixteen samples.
static inline int sample_index(int slab, int block) { return (slab * BLOCKS + block) * LANES; }

// Pixel of the tile in each lane of a block.
static INLINED Lanes block_x(int block)
{
    const Lanes x = SQUARE_COLUMN;
    return x + (float)(block % (TILE / BLOCK) * BLOCK);
}

static INLINED Lanes block_y(int block)
{
    const Lanes y = SQUARE_ROW;
    return y + (float)(block / (TILE / BLOCK) * BLOCK);
}

// A random number for each pixel of a block.
static INLINED LaneUints pixel_seeds(const Tile *tile, int block)
{
    LaneUints x = to_lane_uints(to_lane_ints(block_x(block)) + tile->x);
    LaneUints y = to_lane_uints(to_lane_ints(block_y(block)) + tile->y);
    return mix_lanes(x ^ mix_lanes(y ^ mix_bits(tile->scene.numbers.seed)));
}

// Place of a pixel of the tile among the samples of a slab.
static inline int place_of_pixel(int x, int y)
{
    int block = y / BLOCK * (TILE / BLOCK) + x / BLOCK;
    return block * LANES + y % BLOCK * BLOCK + x % BLOCK;
}

// Likewise back: y * TILE + x of a lane of a block.
static inline int pixel_of(int block, int lane)
{
    int x = block % (TILE / BLOCK) * BLOCK + lane % BLOCK;
    return (block / (TILE / BLOCK) * BLOCK + lane / BLOCK) * TILE + x;
}

static INLINED Lanes load(global const float *values, int index)
{
    return lanes_load(values + index);
}

#endif
