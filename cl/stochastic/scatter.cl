// Stage "scatter": where, when and through which point of the lens each sample of a group of slabs
// looks.
//
// Sobol points are stratified in time and on the lens jointly: these are the first three dimensions
// where there is a lens, time and place where there is none. Other patterns draw each effect's
// coordinates on their own.
#include "shared/effects.h"
#include "stochastic/tile_of_slabs.h"
#include "stochastic/scramble.h"
#include "shared/lens.h"
#include "shared/shutter.h"

#if LENS()
#define SHEAR_DIMENSION 3 // first of two of slices' points on the disc of glossy mirrors
#else
#define SHEAR_DIMENSION 1
#endif

// Points of sixteen pixels: place in the pixel, share of the light that has passed, places on the
// unit squares of the lens and of the disc of glossy mirrors.
typedef struct {
    Lanes x, y, t, u, v, a, b;
} Drawn;

// What is left of x, below three times n, modulo n.
static INLINED LaneUints within(LaneUints x, uint n)
{
    x -= x >= n ? (LaneUints)(n) : (LaneUints)(0u);
    return x - (x >= n ? (LaneUints)(n) : (LaneUints)(0u));
}

// x modulo n: a quotient that is at most two too small comes from the reciprocal.
static INLINED LaneUints modulo(LaneUints x, uint n)
{
    return within(x - n * mul_hi(x, (LaneUints)(~0u / n)), n);
}

// Random orders of 0 ... count - 1, one for each seed. Nothing is divided once this is known.
typedef struct {
    LaneUints seed, turn; // the seeds, and what is left of them modulo count
    uint count, mask;     // all bits that the numbers have
    uint wrap;            // what -2^32 is modulo count, from 1 on
} Orders;

static INLINED Orders orders_of(LaneUints seed, uint count)
{
    Orders orders = {.seed = seed, .turn = modulo(seed, count), .count = count};
    uint mask = count - 1u;
    mask |= mask >> 1, mask |= mask >> 2, mask |= mask >> 4, mask |= mask >> 8;
    orders.mask = mask;
    orders.wrap = count - (0u - count) % count;
    return orders;
}

// What the samples of a block's pixels are drawn with: seeds, one for each dimension, and what
// follows from their number.
typedef struct {
    LaneUints x, y, t, u, v, a, b;
    float over_samples;
#if PATTERN_JITTERED() || PATTERN_FIXED()
    Orders order_x;
#endif
#if PATTERN_JITTERED()
#if LENS()
    Orders order_u;
#endif
    float columns, over_columns, over_rows; // of the grid of cells
#endif
} Seeds;

static Seeds seeds_of(const Tile *tile, int block)
{
    const Numbers *n = &tile->scene.numbers;
    LaneUints pixel = pixel_seeds(tile, block);
    Seeds seeds = {mix_lanes(pixel + 1u), mix_lanes(pixel + 2u), mix_lanes(pixel + 3u),
                   mix_lanes(pixel + 4u), mix_lanes(pixel + 5u), mix_lanes(pixel + 6u),
                   mix_lanes(pixel + 7u), 1.0f / n->samples};
#if PATTERN_JITTERED() || PATTERN_FIXED()
    seeds.order_x = orders_of(seeds.x, n->samples);
#endif
#if PATTERN_JITTERED()
#if LENS()
    seeds.order_u = orders_of(seeds.u, n->samples);
#endif
    seeds.columns = (uint)n->columns, seeds.over_columns = 1.0f / (uint)n->columns;
    seeds.over_rows = 1.0f / (uint)(n->samples / n->columns);
#endif
    return seeds;
}

#if PATTERN_JITTERED() || PATTERN_FIXED()
// One of the orders of 0 ... mask that a seed stands for: the place of each x.
static INLINED LaneUints shuffled(LaneUints x, LaneUints seed, uint mask)
{
    x ^= seed, x *= 0xe170893du, x ^= seed >> 16, x ^= (x & mask) >> 4;
    x ^= seed >> 8, x *= 0x0929eb3fu, x ^= seed >> 23, x ^= (x & mask) >> 1;
    x *= 1u | seed >> 27, x *= 0x6935fa69u, x ^= (x & mask) >> 11;
    x *= 0x74dcb303u, x ^= (x & mask) >> 2, x *= 0x9e501cc3u, x ^= (x & mask) >> 2;
    x *= 0xc860a3dfu, x &= mask, x ^= x >> 5;
    return x;
}

// Place of l in each of the orders (Kensler 2013).
static INLINED LaneUints permuted(uint l, const Orders *orders)
{
    const LaneUints seed = orders->seed;
    const uint mask = orders->mask, n = orders->count;
    LaneUints i = shuffled((LaneUints)(l), seed, mask);
    if (mask + 1u == n) return i + seed & mask;
    LaneInts again = i >= (LaneUints)(n);
    while (any_lane(again)) {
        i = again ? shuffled(i, seed, mask) : i;
        again = i >= (LaneUints)(n);
    }
    // i + seed modulo n, where the sum may be 2^32 too small.
    LaneUints lost = i + seed < seed ? (LaneUints)(orders->wrap) : (LaneUints)(0u);
    return within(i + orders->turn + lost, n);
}
#endif

#if PATTERN_JITTERED()
// A random point in sample l's cell of a grid over the unit square.
static INLINED void jitter_in_cell(const Seeds *seeds, uint l, const Orders *orders,
                                   LaneUints seed_y, Lanes *x, Lanes *y)
{
    LaneUints cell = permuted(l, orders);
    Lanes row = floor((to_lanes(cell) + 0.5f) * seeds->over_columns);
    *x = (to_lanes(cell) - row * seeds->columns + hashed(l, orders->seed)) * seeds->over_columns;
    *y = (row + hashed(l, seed_y)) * seeds->over_rows;
}
#endif

// Sample l of every pixel of a block.
static Drawn draw(const Tile *tile, uint l, const Seeds *seeds)
{
    Drawn d;
    d.u = d.v = d.a = d.b = 0.0f;
#if GLOSSY()
    d.a = hashed(l, seeds->a), d.b = hashed(l, seeds->b);
#endif
    d.t = ((float)l + hashed(l, seeds->t)) * seeds->over_samples;
    d.x = d.y = 0.0f;
#if PATTERN_SOBOL()
#if LENS()
    d.u = scrambled(sobol(l, 1), seeds->u);
    d.v = scrambled(sobol(l, 2), seeds->v);
    d.x = scrambled(sobol(l, 3), seeds->x);
    d.y = scrambled(sobol(l, 4), seeds->y);
#else
    d.x = scrambled(sobol(l, 1), seeds->x);
    d.y = scrambled(sobol(l, 2), seeds->y);
#if GLOSSY() // with a lens it is drawn at random
    d.a = scrambled(sobol(l, 3), seeds->a), d.b = scrambled(sobol(l, 4), seeds->b);
#endif
#endif
#elif PATTERN_RANDOM()
    d.t = hashed(l, seeds->t);
    d.x = hashed(l, seeds->x), d.y = hashed(l, seeds->y);
    d.u = hashed(l, seeds->u), d.v = hashed(l, seeds->v);
#elif PATTERN_JITTERED()
    jitter_in_cell(seeds, l, &seeds->order_x, seeds->y, &d.x, &d.y);
#if LENS() // unused loops are not left out by compilers
    jitter_in_cell(seeds, l, &seeds->order_u, seeds->v, &d.u, &d.v);
#endif
#elif PATTERN_FIXED()
    uint slot[LANES];
    float x[LANES], y[LANES];
    lanes_store(permuted(l, &seeds->order_x), slot);
    for (int i = 0; i < LANES; i++)
        x[i] = tile->scene.slots[slot[i]].x_low, y[i] = tile->scene.slots[slot[i]].y_low;
    d.x = lanes_load(x), d.y = lanes_load(y);
    d.u = scrambled(sobol(l, 1), seeds->u);
    d.v = scrambled(sobol(l, 2), seeds->v);
#elif PATTERN_INTERLEAVE_UVT()
    d.x = scrambled(sobol(l, 3), seeds->x);
    d.y = scrambled(sobol(l, 4), seeds->y);
#elif PATTERN_SLICES()
    // All pixels alike: sample l belongs to one of the slices' times and points of the lens.
    const uint slices = tile->scene.numbers.slices, each = tile->scene.numbers.samples / slices;
    const uint slice = l / each;
    LaneUints frame = (LaneUints)(mix_bits(tile->scene.numbers.seed + 13u));
    Slot slot = tile->scene.slots[l % each];
    d.x = slot.x_low, d.y = slot.y_low;
    d.t = (float)slice;
#if SLICES_JITTERED()
    d.t += hashed(slice, frame);
#else
    d.t += 0.5f;
#endif
    d.t *= 1.0f / slices;
    d.u = scrambled(sobol(slice, 1), frame + 1u);
    d.v = scrambled(sobol(slice, 2), frame * 5u);
#if GLOSSY()
    d.a = scrambled(sobol(slice, SHEAR_DIMENSION), frame * 7u);
    d.b = scrambled(sobol(slice, SHEAR_DIMENSION + 1), frame * 9u);
#endif
#endif
    return d;
}

#if PATTERN_RGSS()
// Akenine-Moeller et al. 2007, 3.2: four samples on a rotated grid, sample l at a time in [l, l +
// 1) / 4. Quads of 2 x 2 pixels share that time, which lies in the first half of its quarter or in
// the second, as on a chess board; for l = 1, 2, 3 quads begin one pixel to the right, below, and
// both. Where a sample lies in its pixel repeats every 2 x 2 pixels, so that with the four nearest
// samples of neighbours (rgss.cl) a pixel has eight times, and no two samples of one quarter share
// a row or a column. (This arrangement is one of the four that exist.)
static INLINED void draw_rotated_grid(const Tile *tile, uint l, Lanes pixel_x, Lanes pixel_y,
                                      Drawn *d)
{
    LaneInts x = to_lane_ints(pixel_x) + tile->x, y = to_lane_ints(pixel_y) + tile->y;
    LaneInts place = (int)l ^ (x & 1 | (y & 1) << 1);
    const int columns = 1 | 3 << 2 | 0 << 4 | 2 << 6;
    d->x = 0.125f + 0.25f * to_lanes((LaneInts)(columns) >> 2 * place & 3);
    d->y = 0.125f + 0.25f * to_lanes(place);
    LaneInts quad_x = (x - (int)(l & 1u)) >> 1, quad_y = (y - (int)(l >> 1)) >> 1;
    const uint frame = mix_bits(tile->scene.numbers.seed + 7u);
    LaneUints seed = mix_lanes(to_lane_uints(quad_x) ^ mix_lanes(to_lane_uints(quad_y) ^ frame));
    Lanes second = to_lanes(quad_x + quad_y & 1);
    d->t = 0.25f * ((float)l + 0.5f * (second + hashed(l, seed)));
}
#endif

#if PATTERN_INTERLEAVE_UVT()
// Fatahalian et al. 2009: four times as many pairs of a time and a lens point as a pixel has
// samples, the same in every tile of 2 x 2 pixels; which of the tile's pixels has which pair is
// drawn anew for each tile, within each four that follow one another in time.
static INLINED void draw_interleaved(const Tile *tile, uint l, Lanes pixel_x, Lanes pixel_y,
                                     Drawn *d)
{
    LaneInts x = to_lane_ints(pixel_x) + tile->x, y = to_lane_ints(pixel_y) + tile->y;
    const uint mixed_seed = mix_bits(tile->scene.numbers.seed + 9u);
    LaneUints quad = mix_lanes(to_lane_uints(x >> 1)
                            ^ mix_lanes(to_lane_uints(y >> 1) ^ mixed_seed));
    LaneUints mixed = mix_lanes(quad ^ l * 0x9e3779b9u);
    // One of the 24 orders of four: a turn, then one that keeps the first in place.
    LaneUints k = to_lane_uints(x & 1 | (y & 1) << 1);
    LaneUints swap = (mixed >> 8) % 6u, turned = k;
    LaneInts mirrored = (k != 0u) & (swap >= 3u);
    turned = mirrored ? 4u - k : k;
    turned = k != 0u ? (turned - 1u + swap) % 3u + 1u : k;
    LaneUints pair = l * 4u + (turned + (mixed & 3u)) % 4u;
    uint frame = mix_bits(tile->scene.numbers.seed + 11u);
    float t[LANES], u[LANES], v[LANES];
    uint index[LANES];
    lanes_store(pair, index);
    const float quarter = 0.25f / tile->scene.numbers.samples;
    for (int i = 0; i < LANES; i++) {
        t[i] = (index[i] + (mix_bits(frame ^ index[i] * 0x9e3779b9u) >> 8) * 0x1p-24f) * quarter;
        u[i] = first_lane(scrambled(sobol(index[i], 1), (LaneUints)(frame + 1u)));
        v[i] = first_lane(scrambled(sobol(index[i], 2), (LaneUints)(mix_bits(frame + 2u))));
    }
    d->t = lanes_load(t), d->u = lanes_load(u), d->v = lanes_load(v);
}
#endif

#if SLICE_LINES()
// Akenine-Moeller et al. 2007, 4.2 and 4.3: all samples of a slice look through one line across the
// lens, and one across the disc of glossy mirrors, each at a place of its own, drawn in each pixel.
static void draw_line(const Tile *tile, uint l, const Seeds *seeds, Drawn *d)
{
    const uint slice = l / (tile->scene.numbers.samples / tile->scene.numbers.slices);
    LaneUints frame = (LaneUints)(mix_bits(tile->scene.numbers.seed + 13u));
#if LENS()
    d->u = scrambled(sobol(slice, 1), frame + 1u);
    d->v = scrambled(sobol(l, 2), seeds->v);
#endif
#if GLOSSY()
    d->a = scrambled(sobol(slice, SHEAR_DIMENSION), frame * 7u);
    d->b = scrambled(sobol(l, SHEAR_DIMENSION + 1), seeds->b);
#endif
}
#endif

#if FILTER_TABLE()
// Where in the filter's reach the fraction `share` of its weight lies to the left.
static INLINED Lanes warped_to_filter(const Tile *tile, Lanes share)
{
    const int places = tile->scene.numbers.filter_places;
    float out[LANES];
    lanes_store(share * (float)places, out);
    for (int i = 0; i < LANES; i++) {
        int k = min((int)out[i], places - 1);
        out[i] = mix(tile->scene.filter[k], tile->scene.filter[k + 1], out[i] - k);
    }
    return lanes_load(out);
}
#endif

// From shares of the light that has passed to times of the shutter.
static INLINED Lanes times_of_light(const Tile *tile, int block, Lanes passed)
{
#if SHUTTER_CURVE() || ROLLING()
    float t[LANES];
    lanes_store(passed, t);
    for (int i = 0; i < LANES; i++) {
        int pixel = pixel_of(block, i);
        float2 window = line_window(&tile->scene, tile->x + pixel % TILE, tile->y + pixel / TILE);
        t[i] = time_of_light(&tile->scene, window, t[i]);
    }
    return lanes_load(t);
#else
    return passed;
#endif
}

#if LENS()
static inline float2 lens_point(const Tile *tile, float u, float v)
{
#if SLICE_LINES() && BLADES()
    return square_to_polygon_lines((float2)(u, v), &tile->scene.numbers);
#elif SLICE_LINES()
    return square_to_disc_lines((float2)(u, v));
#elif BLADES()
    return square_to_polygon((float2)(u, v), &tile->scene.numbers);
#else
    return square_to_disc((float2)(u, v));
#endif
}
#endif

// Sample l of every pixel of a block, before the filter and the shutter.
static Drawn draw_sample(const Tile *tile, int block, uint l, const Seeds *seeds)
{
    Drawn d = draw(tile, l, seeds);
#if PATTERN_RGSS()
    draw_rotated_grid(tile, l, block_x(block), block_y(block), &d);
#endif
#if PATTERN_INTERLEAVE_UVT()
    draw_interleaved(tile, l, block_x(block), block_y(block), &d);
#endif
#if SLICE_LINES()
    draw_line(tile, l, seeds, &d);
#endif
#if FRAMELESS()
    // Every so many pixels see their own part of the shutter only.
    int parts = tile->scene.numbers.frameless, step = tile->scene.numbers.frameless_step;
    LaneInts x = to_lane_ints(block_x(block)) + tile->x, y = to_lane_ints(block_y(block)) + tile->y;
    LaneInts phase = (x + step * y) % parts;
    phase = phase < 0 ? phase + parts : phase;
    d.t = (to_lanes(phase) + d.t) * (1.0f / parts);
#endif
    return d;
}

#if REORDERED()
// What samples of a pixel are ordered by, so that those of a slab are alike: time; the lens, along
// a Z-shaped curve of its cells; or both.
static INLINED LaneUints order_key(const Numbers *n, Lanes t, Lanes u, Lanes v)
{
#if LENS()
    LaneUints a = to_lane_uints(u * 16.0f), b = to_lane_uints(v * 16.0f), key = 0u;
    const int groups = (n->samples + n->layers - 1) / n->layers;
    LaneUints c = to_lane_uints(clamp(t, 0.0f, 0.9999f) * (16.0f * groups)) & 15u;
    for (int bit = 3; bit >= 0; bit--) {
#if MOVING()
        key = key << 1 | (c >> bit & 1u);
#endif
        key = key << 1 | (a >> bit & 1u);
        key = key << 1 | (b >> bit & 1u);
    }
    return key;
#else
    return to_lane_uints(t * 0x1p24f);
#endif
}

// Slab of each of the group's samples of one block: its place in the order of the keys.
static void rank_samples(const LaneUints *keys, int slabs, LaneInts *ranks)
{
    for (int i = 0; i < slabs; i++) {
        LaneInts rank = 0;
        for (int k = 0; k < i; k++) rank -= (keys[k] <= keys[i]); // true is -1
        for (int k = i + 1; k < slabs; k++) rank -= (keys[k] < keys[i]);
        ranks[i] = rank;
    }
}
#endif

#if GLOSSY()
// The point of lane i on the disc of glossy mirrors.
static inline void store_shear(const Tile *tile, int index, const Drawn *d, int i)
{
    float2 square = (float2)(LANE(float, d->a, i), LANE(float, d->b, i));
#if SLICE_LINES()
    float2 point = square_to_disc_lines(square);
#else
    float2 point = square_to_disc(square);
#endif
    tile->as[index] = point.x, tile->bs[index] = point.y;
}
#endif

static void scatter_block(const Tile *tile, int block)
{
    Seeds seeds = seeds_of(tile, block);
    Lanes left = block_x(block) - (float)HALF, top = block_y(block) - (float)HALF;
#if REORDERED()
    LaneUints keys[MOST_SLABS];
    LaneInts ranks[MOST_SLABS];
    for (int k = 0; k < tile->slabs; k++) {
        Drawn d = draw_sample(tile, block, tile->group + k, &seeds);
        keys[k] = order_key(&tile->scene.numbers, d.t, d.u, d.v);
    }
    rank_samples(keys, tile->slabs, ranks);
#endif
    for (int k = 0; k < tile->slabs; k++) {
        Drawn d = draw_sample(tile, block, tile->group + k, &seeds);
#if FILTER_TABLE()
        d.x = warped_to_filter(tile, d.x), d.y = warped_to_filter(tile, d.y);
#endif
        d.x += left, d.y += top;
        d.t = times_of_light(tile, block, d.t);
        int index = sample_index(k, block);
#if REORDERED()
        for (int i = 0; i < LANES; i++) {
            int to = sample_index(LANE(int, ranks[k], i), block) + i;
            tile->xs[to] = LANE(float, d.x, i), tile->ys[to] = LANE(float, d.y, i);
            tile->ts[to] = LANE(float, d.t, i);
#if LENS()
            float2 point = lens_point(tile, LANE(float, d.u, i), LANE(float, d.v, i));
            tile->us[to] = point.x, tile->vs[to] = point.y;
#endif
#if GLOSSY()
            store_shear(tile, to, &d, i);
#endif
        }
#else
        lanes_store(d.x, tile->xs + index);
        lanes_store(d.y, tile->ys + index);
        lanes_store(d.t, tile->ts + index);
#if GLOSSY()
        for (int i = 0; i < LANES; i++) store_shear(tile, index + i, &d, i);
#endif
#endif
    }
}

static void bound_values(global const float *values, int slab, float *low, float *high)
{
    Lanes least = INFINITY, most = -INFINITY;
    for (int block = 0; block < BLOCKS; block++) {
        Lanes here = load(values, sample_index(slab, block));
        least = lanes_min(least, here), most = lanes_max(most, here);
    }
    *low = lanes_least(least), *high = lanes_greatest(most);
}

// Draw the samples of the group that begins with sample tile->group, and clear what they see.
static void scatter(Tile *tile)
{
    for (int block = 0; block < BLOCKS; block++) scatter_block(tile, block);
    for (int k = 0; k < (tile->slabs + LANES - 1) / LANES * LANES; k++) {
        bool used = k < tile->slabs;
        tile->t_low[k] = 2.0f, tile->t_high[k] = -1.0f;
        if (used) bound_values(tile->ts, k, tile->t_low + k, tile->t_high + k);
#if LENS()
        tile->u_low[k] = tile->v_low[k] = tile->u_high[k] = tile->v_high[k] = 0.0f;
        if (used) bound_values(tile->us, k, tile->u_low + k, tile->u_high + k);
        if (used) bound_values(tile->vs, k, tile->v_low + k, tile->v_high + k);
#endif
        tile->far[k] = used ? INFINITY : 0.0f;
    }
    for (int k = 0; k < tile->slabs; k++)
        lanes_store((Lanes)(INFINITY), tile->block_far + k * BLOCKS);
#if ZMIN()
    for (int k = 0; k < tile->slabs; k++)
        lanes_store((Lanes)(INFINITY), tile->block_near + k * BLOCKS);
#endif
    for (int i = 0; i < tile->slabs * SLAB; i += LANES) {
        lanes_store((Lanes)(INFINITY), tile->zs + i);
        lanes_store((LaneUints)(NONE), tile->owners + i);
    }
}
