// What one work-item knows while it renders a tile: the scene, the tile's place, and scratch memory
// that belongs to the work-item and is used again for the next tile.
//
// A tile's samples form rows: row r = layer * TILE + y, where a layer holds one spatial sample of
// every pixel. The samples of a row lie in one stripe of the pixels' height, or on a line. A piece
// is a run of rows whose lists fit into the pools.
//
// TILE is a tile's edge in pixels.
#ifndef MB_TILE_OF_ROWS_H
#define MB_TILE_OF_ROWS_H

#include "shared/effects.h"
#include "shared/scene.h"
#include "shared/vectors.h"
#include "analytic/aov.h"
#include "shared/film.h"

#pragma OPENCL FP_CONTRACT OFF

#define NO_LIGHT 1e-6f // transmittance below which what lies behind is not seen

#if SHADOWS()
// What the lights see, and the light that reaches spans.
typedef struct {
    global const Vertex *world; // vertices in the world's directions, relative to the first eye
    global const ShadowLight *lights;
    global const LightView *views;
    global const uint *starts;  // first of the members of each tile of each view
    global const uint *members; // paths that may lie in a tile, from near to far
    global const Outline *outlines; // of each path in each view
    global uint *stamps;        // of each path: for which list it was dealt with last
    uint stamp;
    global Step *steps;         // pool
    uint step_count;
} Shadows;
#endif

typedef struct {
    Scene scene;
#if SHADOWS()
    Shadows shadows;
#endif
    global const Shape *shapes;  // of the paths
    global const Depth *depths;  // likewise; exact paths only
#if MIRRORS()
    Frame frame;
    global const float *background; // an image, if there is one
#endif
    int x, y;                    // first pixel of the tile in the frame
    int x_low, x_high;           // columns of the tile that are rendered, low <= x < high
    int y_low, y_high;           // rows likewise
    int layer;                   // sample of the first layer
    int rows;                    // of all layers that are worked on at a time
    int row_low, row_high;       // rows of the piece
    int piece_rows;              // how many to try
    global const uint *members;  // paths that may touch the tile, ascending
    uint member_count, static_count;
#if PLACED()
    global Place *places;        // of the samples of the current layers
#endif
#if WEIGHTED()
    global float *weights;       // of the samples of the current layers
#endif
    uint capacity;               // records that each pool holds
    global int *heads;           // first fragment or visit of each sample
#if EXACT()
    global Visit *visits;        // pool
    uint visit_count;
    global int *tails;           // last visit of each sample
    global Front *fronts;        // pool: intervals or envelopes of the sample at hand
    global Front *merged;        // pool: likewise; the two take turns
    global float *ordering;      // scratch: arrays of capacity + LANES
    ulong tests, hits;           // (path, sample) pairs that were solved, and that gave an interval
#else
    global Fragment *fragments;  // pool
    uint fragment_count;
    float2 window;               // when the sample at hand is exposed
    global Interval *intervals;  // pool
    uint interval_count;
    global Run *runs;            // intervals of each sample
    global float *sorting;       // scratch of the sort: arrays of capacity + LANES
    global Interval *sorted;     // pool: intervals in depth order, split where they cross
    uint sorted_count;
#endif
    global Span *spans;          // pool
    uint span_count;
    global Run *span_runs;       // spans of each sample
    global double *static_depth; // of the nearest static surface
    global uint *static_part;
    global float4 *still;        // its colour
    global uint *met;            // intervals met by each sample
    global float4 *color;        // per pixel: sums over samples, alpha last
    global float *depth;
    global uint *count;          // intervals met
#if AOV_SHARP()
    global float4 *sharp;        // per pixel: sums over samples at the moment, alpha last
#endif
#if AOV_OPERATIONS()
    global uint *tested;         // paths that each sample was tested against
    global uint *operations;     // per pixel
#endif
#if RECORDED()
    global float4 *added;        // pool: what each layer of the stack at hand adds
    global Event *events;        // pool of all work-items
    global uint *event_count;    // that room was asked for so far
    global uint *event_end;      // of those that found room
    uint event_capacity;
    bool events_full;            // some of the tile's found no room
#endif
} Tile;

// Ask for a cache line ahead of its use.
static inline void fetch(global const void *line)
{
#if CLANG_BUILTINS()
    __builtin_prefetch((const void *)(size_t)line, 0, 3);
#else
    prefetch((global const char *)line, 64);
#endif
}

static inline float sample_y(const Tile *tile, int row)
{
    return (float)(tile->y + row % TILE) + tile->scene.slots[tile->layer + row / TILE].y_low;
}

static inline Place place_of(const Tile *tile, int sample)
{
#if PLACED()
    return tile->places[sample];
#else
    // Whole columns and rows plus an offset: the same bits in any tile.
    int row = sample / TILE, column = sample % TILE;
    float x = (float)(tile->x + column) + tile->scene.slots[tile->layer + row / TILE].x_low;
    Place place = {x, sample_y(tile, row), 0.0f, 0.0f};
    return place;
#endif
}

static inline float weight_of(const Tile *tile, int sample)
{
#if WEIGHTED()
    return tile->weights[sample];
#else
    return 1.0f;
#endif
}

static inline bool row_is_rendered(const Tile *tile, int row)
{
    int y = row % TILE;
    return y >= tile->y_low && y < tile->y_high;
}

#endif
