// The analytic path, tile by tile. Each work-item takes tiles from a queue until it is empty and
// runs the stages on them in order; its scratch memory stays in cache and is bounded.
//
//     triangulated: place -> nearest -> rasterize -> intervals -> sort -> occlude
//                   -> shade -> record -> moment -> resolve
//     exact:        place -> nearest -> solve -> envelope -> shade -> record -> moment -> resolve,
//                   with mask or stack for envelope, and shadow before shade
//
// Stages between nearest and shade exist only where something moves, place only where samples lie
// differently in every pixel, record and moment only where what they find is asked for. Nothing is
// lost when a pool is full: the piece of the tile at hand is done again in halves. Only when a
// single row of samples does not fit is the tile given back to the host, which has larger pools, or
// when there is no room for its events, which the host has emptied the pool for next time.
#include "shared/effects.h"
#include "analytic/tile_of_rows.h"
#if PLACED()
#include "analytic/place.cl"
#endif
#if STATIC() || MOMENTARY()
#include "analytic/nearest.cl"
#endif
#if MOVING() && EXACT()
#include "analytic/solve.cl"
#if BIT_MASK()
#include "analytic/mask.cl"
#elif STACKS()
#include "analytic/stack.cl"
#else
#include "analytic/envelope.cl"
#endif
#elif MOVING()
#include "analytic/rasterize.cl"
#include "analytic/intervals.cl"
#include "analytic/sort.cl"
#include "analytic/occlude.cl"
#endif
#if SHADOWS()
#include "analytic/shadow.cl"
#endif
#include "analytic/shade.cl"
#if RECORDED()
#include "analytic/record.cl"
#endif
#if MOMENTARY()
#include "analytic/moment.cl"
#endif
#include "analytic/resolve.cl"
#include "shared/clock.h"
#include "shared/tile_grid.h"

// What became of a tile.
enum { DONE, POOLS_FULL, EVENTS_FULL };

// What a work-item counts: ticks of each stage, and pairs that were tested and hit.
enum { PLACE, NEAREST, RASTERIZE, INTERVALS, SORT, OCCLUDE, SOLVE, ENVELOPE, MASK, STACK, SHADOW,
       SHADE, RECORD, MOMENT, RESOLVE, TESTS, HITS,
       COUNTERS };

// The stages up to shading on one piece. False, and nothing added to pixels, when a pool is full.
static bool render_piece(Tile *tile, Frame frame, global ulong *ticks)
{
    ulong clock = TICKS();
#if AOV_OPERATIONS()
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) tile->tested[i] = 0u;
#endif
#if STATIC()
    clocked(nearest(tile), NEAREST, ticks, &clock);
#endif
#if MOVING() && EXACT()
    if (!clocked(solve(tile), SOLVE, ticks, &clock)) return false;
#if BIT_MASK()
    if (!clocked(mask(tile), MASK, ticks, &clock)) return false;
#elif STACKS()
    if (!clocked(stack(tile), STACK, ticks, &clock)) return false;
#else
    if (!clocked(envelope(tile), ENVELOPE, ticks, &clock)) return false;
#endif
#elif MOVING()
    if (!clocked(rasterize(tile), RASTERIZE, ticks, &clock)) return false;
    if (!clocked(intervals(tile), INTERVALS, ticks, &clock)) return false;
    if (!clocked(sort(tile), SORT, ticks, &clock)) return false;
    if (!clocked(occlude(tile), OCCLUDE, ticks, &clock)) return false;
#endif
#if SHADOWS()
    if (!clocked(shadow(tile), SHADOW, ticks, &clock)) return false;
#endif
    clocked(shade(tile), SHADE, ticks, &clock);
#if RECORDED()
    clocked(record(tile, frame), RECORD, ticks, &clock);
#endif
    return true;
}

// Records of the fullest of the pools that grow with a piece.
static inline uint fullest_pool(const Tile *tile)
{
#if SHADOWS()
    uint most = max(tile->span_count, tile->shadows.step_count);
#if MOVING()
    most = max(most, tile->visit_count);
#endif
    return most;
#elif !MOVING()
    return 0u;
#elif EXACT()
    return max(tile->visit_count, tile->span_count);
#else
    return max(max(tile->fragment_count, tile->interval_count),
               max(tile->sorted_count, tile->span_count));
#endif
}

// All rows of the tile's current layers, in pieces that fit. What fitted last is tried first, more
// where there was room. False when a single row does not fit.
static bool render_layers(Tile *tile, int rows, Frame frame, global ulong *ticks)
{
    for (tile->row_low = 0; tile->row_low < rows; tile->row_low = tile->row_high) {
        tile->row_high = min(tile->row_low + tile->piece_rows, rows);
        while (!render_piece(tile, frame, ticks)) {
            tile->piece_rows = (tile->row_high - tile->row_low) / 2;
            if (tile->piece_rows == 0) {
                tile->piece_rows = 1;
                return false;
            }
            tile->row_high = tile->row_low + tile->piece_rows;
        }
        if (fullest_pool(tile) < tile->capacity / 3u)
            tile->piece_rows = min(2 * tile->piece_rows, tile->rows);
    }
    return true;
}

static bool render_tile(Tile *tile, Frame frame, global ulong *ticks)
{
    for (int i = 0; i < TILE * TILE; i++) {
        tile->color[i] = 0.0f;
        tile->depth[i] = 0.0f;
        tile->count[i] = 0u;
#if AOV_SHARP()
        tile->sharp[i] = 0.0f;
#endif
#if AOV_OPERATIONS()
        tile->operations[i] = 0u;
#endif
    }
    const int samples = tile->scene.numbers.samples, layers = tile->scene.numbers.layers;
    for (tile->layer = 0; tile->layer < samples; tile->layer += layers) {
        int rows = min(layers, samples - tile->layer) * TILE;
#if PLACED()
        ulong clock = TICKS();
        place(tile, rows);
        clocked(true, PLACE, ticks, &clock);
#endif
        if (!render_layers(tile, rows, frame, ticks)) return false;
    }
    return true;
}

// Number of the tile's members that do not move; they come first.
static uint count_static(const Tile *tile)
{
    uint low = 0, high = tile->member_count;
    while (low < high) {
        uint middle = (low + high) / 2;
        if (tile->members[middle] < tile->scene.numbers.static_paths) low = middle + 1;
        else high = middle;
    }
    return low;
}

// Scratch of all work-items, one after the other: `sample_` is of each sample of the layers at
// hand, `pixel_` of each pixel, and the rest are pools.
kernel void tile(
    Numbers numbers, TileGrid grid, Frame frame,
    global const Vertex *vertices, global const Path *paths, global const Shape *shapes,
    global const Mesh *meshes, global const Material *materials,
    global const float *vertex_colors, global const float *normals,
#if LARGE_UV()
    global const double *uvs,
#else
    global const float *uvs,
#endif
    global const Texture *textures, global const float4 *texels, global const Light *lights,
    global const Camera *cameras, global const Slot *slots,
    global const float *filter, global const ShutterKey *shutter, global const float *background,
    global const uint *starts, global const uint *members, global const uint *queue,
    global uint *next, global uint *failed, global ulong *counters,
    global double *sample_static_depth, global uint *sample_static_part, global int *sample_heads,
    global uint *sample_met, global Run *sample_spans, global float4 *sample_still,
    global float4 *pixel_color, global float *pixel_depth, global uint *pixel_met,
    global Span *spans,
#if PLACED()
    global Place *sample_places,
#endif
#if WEIGHTED()
    global float *sample_weights,
#endif
#if AOV_SHARP()
    global float4 *pixel_sharp, global float4 *sharp,
#endif
#if AOV_OPERATIONS()
    global uint *sample_tested, global uint *pixel_operations,
#endif
#if MOMENTARY() || AOV_OPERATIONS()
    global uint *planes,
#endif
#if AOV_FORWARD()
    global const double *forward,
#endif
#if AOV_BACKWARD()
    global const double *backward,
#endif
#if EXACT()
    global int *sample_tails, global const Depth *depths,
    global Visit *visits, global Front *fronts, global Front *merged, global Ordering *ordering,
#else
    global Run *sample_intervals,
    global Fragment *fragments, global Interval *intervals, global Sorting *sorting,
    global Interval *sorted,
#endif
#if SHADOWS()
    global const Vertex *world, global const ShadowLight *shadow_lights,
    global const LightView *light_views, global const uint *light_starts,
    global const uint *light_members, global const Outline *outlines, global uint *path_stamps,
    global Step *steps,
#endif
#if CUBE_MAPS()
    global const CubeMap *maps, global const float4 *map_texels, global const Sky *sky,
    global const MirrorPlane *mirror_planes,
#endif
#if RECORDED()
    global float4 *added,
    global Event *events, global uint *event_count, global uint *event_end,
#endif
    global float4 *rgba, global float *depth, global uint *met)
{
    const size_t worker = get_global_id(0), pool = worker * grid.capacity;
    const size_t samples = worker * numbers.layers * TILE * TILE, pixels = worker * TILE * TILE;
    Tile tile = {
        .scene = {
            .numbers = numbers,
            .vertices = vertices, .paths = paths, .meshes = meshes, .materials = materials,
            .vertex_colors = vertex_colors, .uvs = uvs, .normals = normals,
            .textures = textures, .texels = texels, .lights = lights, .cameras = cameras,
            .slots = slots, .filter = filter, .shutter = shutter,
#if CUBE_MAPS()
            .maps = maps, .map_texels = map_texels, .sky = sky, .mirror_planes = mirror_planes,
#endif
        },
        .shapes = shapes,
        .rows = numbers.layers * TILE,
        .piece_rows = numbers.layers * TILE,
        .capacity = grid.capacity,
        .static_depth = sample_static_depth + samples,
        .static_part = sample_static_part + samples,
        .heads = sample_heads + samples,
        .met = sample_met + samples,
        .span_runs = sample_spans + samples,
        .still = sample_still + samples,
        .color = pixel_color + pixels, .depth = pixel_depth + pixels, .count = pixel_met + pixels,
        .spans = spans + pool,
#if PLACED()
        .places = sample_places + samples,
#endif
#if WEIGHTED()
        .weights = sample_weights + samples,
#endif
#if AOV_SHARP()
        .sharp = pixel_sharp + pixels,
#endif
#if AOV_OPERATIONS()
        .tested = sample_tested + samples, .operations = pixel_operations + pixels,
#endif
#if EXACT()
        .tails = sample_tails + samples, .depths = depths,
        .visits = visits + pool, .fronts = fronts + pool, .merged = merged + pool,
        .ordering = (global float *)(ordering + worker * (grid.capacity + LANES)),
#else
        .runs = sample_intervals + samples,
        .fragments = fragments + pool, .intervals = intervals + pool, .sorted = sorted + pool,
        .sorting = (global float *)(sorting + worker * (grid.capacity + LANES)),
#endif
#if SHADOWS()
        .shadows = {world, shadow_lights, light_views, light_starts, light_members, outlines,
                    path_stamps + worker * numbers.path_count, 0u, steps + pool, 0u},
#endif
#if MIRRORS()
        .frame = frame, .background = background,
#endif
#if RECORDED()
        .added = added + pool,
        .events = events, .event_capacity = grid.event_capacity,
        .event_count = event_count, .event_end = event_end,
#endif
    };
    Aovs aovs = {
        .size = (size_t)frame.width * frame.height,
#if MOMENTARY() || AOV_OPERATIONS()
        .planes = planes,
#endif
#if AOV_SHARP()
        .sharp = sharp,
#endif
#if AOV_FORWARD()
        .forward = forward,
#endif
#if AOV_BACKWARD()
        .backward = backward,
#endif
    };
    counters += worker * COUNTERS;

    for (uint k; (k = atomic_inc(next)) < grid.queued;) {
        uint index = queue[k];
        TilePlace at = tile_place(grid, index, frame, TILE);
        tile.x = at.x, tile.x_low = at.x_low, tile.x_high = at.x_high;
        tile.y = at.y, tile.y_low = at.y_low, tile.y_high = at.y_high;
        tile.members = members + starts[index];
        tile.member_count = starts[index + 1] - starts[index];
        tile.static_count = count_static(&tile);
#if RECORDED()
        tile.events_full = false;
#endif
        bool done = render_tile(&tile, frame, counters);
        failed[index] = done ? DONE : POOLS_FULL;
#if RECORDED()
        if (done && tile.events_full) failed[index] = EVENTS_FULL, done = false;
#endif
        if (!done) continue;
        ulong clock = TICKS();
#if MOMENTARY()
        moment(&tile, frame, aovs);
        clocked(true, MOMENT, counters, &clock);
#endif
        resolve(&tile, frame, background, rgba, depth, met, aovs);
        clocked(true, RESOLVE, counters, &clock);
    }
#if EXACT()
    counters[TESTS] += tile.tests, counters[HITS] += tile.hits;
#endif
}
