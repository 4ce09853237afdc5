// Stage "shade": the colours of a group's samples, summed into their pixels in order of their
// slabs.
//
// Where colour varies over a surface it is found for each sample, or once for all samples of a
// pixel that see the same triangle, at their mean place and time, as multisampling does
// (SHADE_PIXEL; with SHADE_HYBRID only what does not move, Akenine-Moeller et al. 2007, 5). Samples
// are points, which is why textures are read at their finest level.
#include "shared/effects.h"
#include "stochastic/surface_at_samples.h"

// Sign of the filter's weight at a sample: only one with negative lobes has two.
static inline float sign_of_sample(const Tile *tile, int index, int pixel)
{
#if WEIGHTED()
    int at = pixel_of(pixel / LANES, pixel % LANES);
    float x = fabs(tile->xs[index] + HALF - at % TILE - 0.5f);
    float y = fabs(tile->ys[index] + HALF - at / TILE - 0.5f);
    const float zero = tile->scene.numbers.filter_zero;
    return (x > zero) == (y > zero) ? 1.0f : -1.0f;
#else
    return 1.0f;
#endif
}

static inline void add_sample(Tile *tile, int index, float4 color)
{
    int pixel = index % SLAB;
    float depth = color.w > 0.0f ? tile->zs[index] : 0.0f;
    tile->color[pixel] += color;
    tile->depth[pixel] += depth;
    tile->count[pixel] += color.w > 0.0f;
#if WEIGHTED()
    float sign = sign_of_sample(tile, index, pixel);
    tile->signed_color[pixel] += sign * color;
    tile->signed_depth[pixel] += sign * depth;
    tile->sign_sum[pixel] += sign;
#endif
#if PATTERN_RGSS()
    tile->sample_colors[index] = color;
    tile->sample_depths[index] = depth;
#endif
}

#if VARYING()

static INLINED Lanes listed_values(global const float *values, const int *list, int count)
{
    float value[LANES];
    for (int i = 0; i < LANES; i++) value[i] = values[list[min(i, count - 1)]];
    return lanes_load(value);
}

static inline float mean_of_values(global const float *values, const int *list, int count)
{
    float sum = 0.0f;
    for (int i = 0; i < count; i++) sum += values[list[i]];
    return sum * (1.0f / count);
}

// The samples of `list`, the last one repeated where there are fewer than sixteen; w is their
// depth.
static Samples gather_listed(const Tile *tile, const int *list, int count, Lanes *w)
{
    Samples s;
#define GATHER(name) s.name = listed_values(tile->name##s, list, count);
    COORDINATES(GATHER)
    GATHER(t)
#undef GATHER
    *w = listed_values(tile->zs, list, count);
    return s;
}

// Whether the samples of a pixel that see the path share one colour.
static inline bool shaded_once(const Shaded *s)
{
#if SHADE_PIXEL()
    return true;
#elif SHADE_HYBRID()
    return s->path.step == 0u;
#else
    return false;
#endif
}

// The mean of listed samples in all lanes.
static Samples mean_of_listed(const Tile *tile, const int *list, int count, Lanes *w)
{
    Samples mean;
#define MEAN(name) mean.name = mean_of_values(tile->name##s, list, count);
    COORDINATES(MEAN)
    MEAN(t)
#undef MEAN
    *w = mean_of_values(tile->zs, list, count);
    return mean;
}

static inline float4 color_of_lane(const Colors *color, int i)
{
    return (float4)(LANE3(*color, i), 1.0f);
}

// Colour of each listed sample of one pixel, all of the same path.
static void color_samples(Tile *tile, const Surface *surface, const int *list, int count,
                          float4 *colors)
{
    Lanes w;
    if (surface->flat) {
        for (int i = 0; i < count; i++) colors[i] = path_color(tile, surface->path);
    } else if (shaded_once(&surface->shaded)) {
        Samples mean = mean_of_listed(tile, list, count, &w);
        Colors color = surface_colors(tile, surface, &mean, &w, 1);
        for (int i = 0; i < count; i++) colors[i] = color_of_lane(&color, 0);
    } else {
        for (int from = 0; from < count; from += LANES) {
            int here = min(count - from, LANES);
            Samples samples = gather_listed(tile, list + from, here, &w);
            Colors color = surface_colors(tile, surface, &samples, &w, here);
            for (int i = 0; i < here; i++) colors[from + i] = color_of_lane(&color, i);
        }
    }
}

// Colours of all samples of a pixel, path by path, into `colors` by slab.
static void color_pixel(Tile *tile, int pixel, Surface *surface, float4 *colors)
{
    bool done[MOST_SLABS];
    for (int slab = 0; slab < tile->slabs; slab++) {
        done[slab] = tile->owners[slab * SLAB + pixel] == NONE;
        colors[slab] = (float4)(0.0f);
    }
    for (int slab = 0; slab < tile->slabs; slab++) {
        if (done[slab]) continue;
        uint owner = tile->owners[slab * SLAB + pixel];
        int list[MOST_SLABS], count = 0;
        float4 found[MOST_SLABS];
        for (int k = slab; k < tile->slabs; k++)
            if (tile->owners[k * SLAB + pixel] == owner)
                list[count++] = k * SLAB + pixel, done[k] = true;
        if (surface->path != owner) load_surface(tile, owner, surface);
        color_samples(tile, surface, list, count, found);
        for (int i = 0; i < count; i++) colors[list[i] / SLAB] = found[i];
    }
}

#if MIRRORS()
// Add what is seen in mirrors to the colours of a pixel's samples.
static void color_mirrored(Tile *tile, int pixel, Surface *surface, float4 *colors)
{
    float4 mirrored[MOST_SLABS];
    swap_mirrored(tile);
    color_pixel(tile, pixel, surface, mirrored);
    swap_mirrored(tile);
    for (int slab = 0; slab < tile->slabs; slab++)
        colors[slab] = with_mirrored(tile, slab * SLAB + pixel, colors[slab], mirrored[slab]);
}
#endif

static void shade(Tile *tile)
{
    Surface surface;
    surface.path = NONE;
    float4 colors[MOST_SLABS];
    for (int pixel = 0; pixel < SLAB; pixel++) {
        color_pixel(tile, pixel, &surface, colors);
#if MIRRORS()
        if (tile->has_mirrors) color_mirrored(tile, pixel, &surface, colors);
#endif
        for (int slab = 0; slab < tile->slabs; slab++)
            add_sample(tile, slab * SLAB + pixel, colors[slab]);
    }
}

#else

static void shade(Tile *tile)
{
    for (int index = 0; index < tile->slabs * SLAB; index++) {
        float4 color = path_color(tile, tile->owners[index]);
#if MIRRORS()
        if (tile->has_mirrors)
            color = with_mirrored(tile, index, color, path_color(tile, tile->mirror_owners[index]));
#endif
        add_sample(tile, index, color);
    }
}

#endif
