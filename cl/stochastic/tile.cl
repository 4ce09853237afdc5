// The stochastic path, tile by tile. Each work-item takes tiles from a queue until it is empty and
// runs the stages on them in order: scatter, sample, shade for one group of slabs after the other,
// then resolve.
#include "stochastic/tile.h"
#include "stochastic/scatter.cl"
#include "stochastic/cull/cull.h"
#include "stochastic/shade.cl"
#ifdef SKY
#include "stochastic/sky.h"
#endif
#include "stochastic/resolve.cl"

// What a work-item counts: ticks of each stage, then its statistics.
enum { SCATTER, SAMPLE, SHADE, RESOLVE, STATISTICS_FIRST, COUNTERS = STATISTICS_FIRST + 8 };

#ifdef CLANG_BUILTINS
#define TICKS() __builtin_readcyclecounter()
#else
#define TICKS() 0ul
#endif

// Add the time since *clock to the stage's, and set the clock.
static inline void clocked(int stage, global ulong *ticks, ulong *clock)
{
    ulong now = TICKS();
    ticks[stage] += now - *clock;
    *clock = now;
}

static void render_tile(Tile *tile, global ulong *ticks)
{
    for (int i = 0; i < SLAB; i++) {
        tile->color[i] = 0.0f;
        tile->depth[i] = 0.0f;
        tile->count[i] = 0u;
#ifdef WEIGHTED
        tile->signed_color[i] = 0.0f;
        tile->signed_depth[i] = tile->sign_sum[i] = 0.0f;
#endif
    }
#ifdef COUNT_TEXELS
    for (int i = 0; i < CACHE_SETS; i++)
        for (int k = 0; k < CACHE_WAYS; k++) tile->texel_cache[i][k] = 0;
#endif
    ulong clock = TICKS();
    for (tile->group = 0; tile->group < SAMPLES; tile->group += SLABS) {
        tile->slabs = min(SLABS, SAMPLES - tile->group);
        scatter(tile);
        clocked(SCATTER, ticks, &clock);
        sample(tile);
#ifdef MIRRORS
        tile->has_mirrors = find_mirrors(tile);
        if (tile->has_mirrors) {
            enter_mirrors(tile);
            sample(tile);
            leave_mirrors(tile);
        }
#endif
        clocked(SAMPLE, ticks, &clock);
        shade(tile);
#ifdef SKY
        add_sky(tile);
#endif
        clocked(SHADE, ticks, &clock);
    }
}

typedef struct {
    int x, y;          // first pixel of the first tile
    int columns, rows; // tiles
    uint queued;       // tiles to render
    uint light_count, seed;
    float roll_start, roll_step, roll_length;
    float reach_low, reach_high;
    int width, height; // of the frame
} TileGrid;

static void place_frame(Tile *tile, TileGrid grid)
{
    float x = tile->x + HALF, y = tile->y + HALF;
    tile->middle_x = 0.5f * grid.width - x, tile->middle_y = 0.5f * grid.height - y;
    tile->clip_scale = 2.0f / grid.height;
    tile->frame.left = grid.reach_low - x, tile->frame.right = grid.width - 1 + grid.reach_high - x;
    tile->frame.top = grid.reach_low - y,
    tile->frame.bottom = grid.height - 1 + grid.reach_high - y;
}

#if defined(GLOSSY)
#define SCRATCH 11 // floats per sample
#elif defined(MIRRORS)
#define SCRATCH 9
#else
#define SCRATCH 7
#endif
#define PIXEL_VECTORS 8 // float4s per pixel

kernel void tile(
    global const Vertex *vertices, global const Path *paths, global const Bounds *bounds,
    global const Mesh *meshes, global const Material *materials,
    global const float *vertex_colors, global const float *uvs, global const float *normals,
    global const Texture *textures, global const float4 *texels,
    global const Light *lights, global const Camera *cameras, global const Slot *slots,
    global const float *filter, global const ShutterKey *shutter, global const float *background,
    global const uint *starts, global const uint *members, global const uint *queue,
    global uint *next, global float *samples, global float4 *pixels, global ulong *counters,
    global float4 *rgba, global float *depth, global uint *seen,
#ifdef SHADOWS
    global const Vertex *world, global const ShadowLight *shadow_lights,
    global const TreeNode *tree, global const uint *leaves, uint leaf_nodes,
    global const LightView *light_views, global const float *shadow_map,
#endif
#ifdef CUBE_MAPS
    global const CubeMap *maps, global const float4 *map_texels, global const Sky *sky,
    uint sky_count, global const MirrorPlane *mirror_planes,
#endif
    TileGrid grid, Frame frame)
{
    uint worker = get_global_id(0);
    global float *scratch = samples + (size_t)worker * SCRATCH * SLABS * SLAB;
    global float *part[SCRATCH];
    for (int i = 0; i < SCRATCH; i++) part[i] = scratch + i * SLABS * SLAB;
    Tile tile = {
        .scene = {
            .vertices = vertices, .paths = paths, .meshes = meshes, .materials = materials,
            .vertex_colors = vertex_colors, .uvs = uvs,
            .normals = normals, .textures = textures, .texels = texels, .lights = lights,
            .light_count = grid.light_count, .cameras = cameras, .slots = slots,
            .filter = filter, .shutter = shutter, .seed = grid.seed,
            .roll_start = grid.roll_start, .roll_step = grid.roll_step,
            .roll_length = grid.roll_length
        },
#ifdef SHADOWS
        .occluders = {world, paths, tree, leaves, leaf_nodes},
        .shadow_lights = shadow_lights, .light_views = light_views, .shadow_map = shadow_map,
#endif
        .bounds = bounds,
        .reach_low = grid.reach_low, .reach_high = grid.reach_high,
        .xs = part[0], .ys = part[1], .ts = part[2], .zs = part[3],
        .owners = (global uint *)part[4], .us = part[5], .vs = part[6],
#ifdef MIRRORS
        .mirror_zs = part[7], .mirror_owners = (global uint *)part[8],
        .film = frame, .background = background,
#endif
#ifdef GLOSSY
        .as = part[9], .bs = part[10],
#endif
        .color = pixels + (size_t)worker * PIXEL_VECTORS * SLAB
    };
#ifdef SHADOWS
    tile.occluders.scene = &tile.scene;
#endif
#ifdef CUBE_MAPS
    tile.scene.maps = maps, tile.scene.map_texels = map_texels;
    tile.scene.sky = sky, tile.scene.sky_count = sky_count;
    tile.scene.mirror_planes = mirror_planes;
#endif
    tile.depth = (global float *)(tile.color + SLAB);
    tile.count = (global uint *)(tile.depth + SLAB);
#ifdef WEIGHTED
    tile.signed_color = tile.color + 2 * SLAB;
    tile.signed_depth = (global float *)(tile.color + 3 * SLAB);
    tile.sign_sum = tile.signed_depth + SLAB;
#endif
#ifdef PATTERN_RGSS
    tile.sample_colors = tile.color + 2 * SLAB;
    tile.sample_depths = (global float *)(tile.color + 6 * SLAB);
#endif
    counters += worker * COUNTERS;

    for (uint k; (k = atomic_inc(next)) < grid.queued;) {
        uint index = queue[k];
        tile.x = grid.x + (int)(index % grid.columns) * TILE;
        tile.y = grid.y + (int)(index / grid.columns) * TILE;
        tile.x_low = max(frame.x - tile.x, 0),
        tile.x_high = min(frame.x + frame.width - tile.x, TILE);
        tile.y_low = max(frame.y - tile.y, 0),
        tile.y_high = min(frame.y + frame.height - tile.y, TILE);
        place_frame(&tile, grid);
        tile.members = members + starts[index];
        tile.member_count = starts[index + 1] - starts[index];
        render_tile(&tile, counters);
        ulong clock = TICKS();
        resolve(&tile, frame, background, rgba, depth, seen);
        clocked(RESOLVE, counters, &clock);
    }
    const ulong *counted = (const ulong *)&tile.statistics;
    for (int i = STATISTICS_FIRST; i < COUNTERS; i++) counters[i] += counted[i - STATISTICS_FIRST];
}
