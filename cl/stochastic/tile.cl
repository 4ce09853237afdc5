// The stochastic path, tile by tile. Each work-item takes tiles from a queue until it is empty and
// runs the stages on them in order: scatter, sample, shade for one group of slabs after the other,
// then resolve.
#include "shared/effects.h"
#include "stochastic/tile_of_slabs.h"
#include "stochastic/scatter.cl"
#include "stochastic/cull/cull.h"
#include "stochastic/shade.cl"
#if SKY()
#include "stochastic/sky_at_samples.h"
#endif
#include "stochastic/resolve.cl"
#include "shared/clock.h"
#include "shared/tile_grid.h"

// What a work-item counts: ticks of each stage, then its statistics.
enum { SCATTER, SAMPLE, SHADE, RESOLVE,
       BOUNDED, VISITED, STAGE1, TESTS, HITS, DEPTH_TESTS, TEXELS, TEXEL_LINES,
       COUNTERS };

static void render_tile(Tile *tile, global ulong *ticks)
{
    for (int i = 0; i < SLAB; i++) {
        tile->color[i] = 0.0f;
        tile->depth[i] = 0.0f;
        tile->count[i] = 0u;
#if WEIGHTED()
        tile->signed_color[i] = 0.0f;
        tile->signed_depth[i] = tile->sign_sum[i] = 0.0f;
#endif
    }
#if COUNT_TEXELS()
    for (int i = 0; i < CACHE_SETS; i++)
        for (int k = 0; k < CACHE_WAYS; k++) tile->texel_cache[i][k] = 0;
#endif
    ulong clock = TICKS();
    const int samples = tile->scene.numbers.samples, slabs = tile->scene.numbers.layers;
    for (tile->group = 0; tile->group < samples; tile->group += slabs) {
        tile->slabs = min(slabs, samples - tile->group);
        scatter(tile);
        clocked(true, SCATTER, ticks, &clock);
        sample(tile);
#if MIRRORS()
        tile->has_mirrors = find_mirrors(tile);
        if (tile->has_mirrors) {
            enter_mirrors(tile);
            sample(tile);
            leave_mirrors(tile);
        }
#endif
        clocked(true, SAMPLE, ticks, &clock);
        shade(tile);
#if SKY()
        add_sky(tile);
#endif
        clocked(true, SHADE, ticks, &clock);
    }
}

static void place_frame(Tile *tile)
{
    const Numbers *n = &tile->scene.numbers;
    float x = tile->x + HALF, y = tile->y + HALF;
    tile->middle_x = 0.5f * n->width - x, tile->middle_y = 0.5f * n->height - y;
    tile->clip_scale = 2.0f / n->height;
    tile->frame.left = n->reach_low - x, tile->frame.right = n->width - 1 + n->reach_high - x;
    tile->frame.top = n->reach_low - y, tile->frame.bottom = n->height - 1 + n->reach_high - y;
}

// Scratch of all work-items, one after the other: `sample_` is of each sample of a group, `pixel_`
// of each pixel.
kernel void tile(
    Numbers numbers, TileGrid grid, Frame frame,
    global const Vertex *vertices, global const Path *paths, global const Bounds *bounds,
    global const Mesh *meshes, global const Material *materials,
    global const float *vertex_colors, global const float *normals,
#if LARGE_UV()
    global const double *uvs,
#else
    global const float *uvs,
#endif
    global const Texture *textures, global const float4 *texels,
    global const Light *lights, global const Camera *cameras, global const Slot *slots,
    global const float *filter, global const ShutterKey *shutter, global const float *background,
    global const uint *starts, global const uint *members, global const uint *queue,
    global uint *next, global ulong *counters,
    global float *sample_x, global float *sample_y, global float *sample_t,
    global float *sample_u, global float *sample_v,
    global float *sample_depth, global uint *sample_owner,
    global float4 *pixel_color, global float *pixel_depth, global uint *pixel_seen,
#if GLOSSY()
    global float *sample_a, global float *sample_b,
#endif
#if MIRRORS()
    global float *sample_mirror_depth, global uint *sample_mirror_owner,
#endif
#if WEIGHTED()
    global float4 *pixel_signed_color, global float *pixel_signed_depth, global float *pixel_signs,
#endif
#if PATTERN_RGSS()
    global float4 *kept_color, global float *kept_depth,
#endif
#if SHADOWS()
    global const Vertex *world, global const ShadowLight *shadow_lights,
    global const TreeNode *tree, global const uint *leaves, global const LightView *light_views,
#if SHADOW_MAP()
    global const float *shadow_map,
#endif
#endif
#if CUBE_MAPS()
    global const CubeMap *maps, global const float4 *map_texels, global const Sky *sky,
    global const MirrorPlane *mirror_planes,
#endif
    global float4 *rgba, global float *depth, global uint *seen)
{
    const size_t worker = get_global_id(0), pixels = worker * SLAB;
    const size_t samples = numbers.layers * pixels;
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
        .bounds = bounds,
        .reach_low = numbers.reach_low, .reach_high = numbers.reach_high,
        .xs = sample_x + samples, .ys = sample_y + samples, .ts = sample_t + samples,
        .us = sample_u + samples, .vs = sample_v + samples,
        .zs = sample_depth + samples, .owners = sample_owner + samples,
        .color = pixel_color + pixels, .depth = pixel_depth + pixels, .count = pixel_seen + pixels,
#if GLOSSY()
        .as = sample_a + samples, .bs = sample_b + samples,
#endif
#if MIRRORS()
        .mirror_zs = sample_mirror_depth + samples,
        .mirror_owners = sample_mirror_owner + samples,
        .film = frame, .background = background,
#endif
#if WEIGHTED()
        .signed_color = pixel_signed_color + pixels, .signed_depth = pixel_signed_depth + pixels,
        .sign_sum = pixel_signs + pixels,
#endif
#if PATTERN_RGSS()
        .sample_colors = kept_color + numbers.samples * pixels,
        .sample_depths = kept_depth + numbers.samples * pixels,
#endif
#if SHADOWS()
        .occluders = {world, paths, tree, leaves, numbers.leaf_nodes},
        .shadow_lights = shadow_lights, .light_views = light_views,
#if SHADOW_MAP()
        .shadow_map = shadow_map,
#endif
#endif
    };
#if SHADOWS()
    tile.occluders.scene = &tile.scene;
#endif
    counters += worker * COUNTERS;

    for (uint k; (k = atomic_inc(next)) < grid.queued;) {
        uint index = queue[k];
        TilePlace at = tile_place(grid, index, frame, TILE);
        tile.x = at.x, tile.x_low = at.x_low, tile.x_high = at.x_high;
        tile.y = at.y, tile.y_low = at.y_low, tile.y_high = at.y_high;
        place_frame(&tile);
        tile.members = members + starts[index];
        tile.member_count = starts[index + 1] - starts[index];
        render_tile(&tile, counters);
        ulong clock = TICKS();
        resolve(&tile, frame, background, rgba, depth, seen);
        clocked(true, RESOLVE, counters, &clock);
    }
#if STATISTICS()
    const Statistics *s = &tile.statistics;
    counters[BOUNDED] += s->bounded, counters[VISITED] += s->visited;
    counters[STAGE1] += s->stage1, counters[TESTS] += s->tests;
    counters[HITS] += s->hits, counters[DEPTH_TESTS] += s->depth_tests;
    counters[TEXELS] += s->texels, counters[TEXEL_LINES] += s->texel_lines;
#endif
}
