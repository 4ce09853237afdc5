// Stage "place": where the samples of a tile lie, and the point of the lens that each looks
// through, different in every pixel.
//
// The samples of a pixel are Hammersley's points under Owen's nested scrambling (Owen 1995), in
// four dimensions: y, x, and the two of the lens. Sample l of N lies in row l, so the samples of a
// layer have nearly the same height in every pixel and rows can be walked; the other three are the
// Sobol sequence at the row's index. Of N = 2^k samples each row and each column of an N x N grid
// holds one, and other pairs of dimensions are nearly as well spread. The fixed pattern takes its
// lens from the same sequence, in Morton's order of its samples (Ahmed & Wonka 2020). The square of
// the lens is mapped to a disc (Shirley & Chiu 1997) or to a polygon of blades. The disc of glossy
// mirrors is drawn as the lens is; where there are both, in an order of its own.
#include "shared/effects.h"
#include "analytic/tile_of_rows.h"
#include "shared/lens.h"
#include "shared/sobol.h"

// Owen's scrambling of the `count` highest bits: each bit is flipped by a random number that
// depends on the bits above it. Lower bits become random. `back` undoes it.
static uint scramble_bits(uint x, int count, uint seed, bool back)
{
    uint result = 0u;
    for (int i = 31; i > 31 - count; i--) {
        uint above = (back ? result : x) >> i >> 1; // the original's bits above this one
        uint flip = mix_bits(above ^ mix_bits(seed + (uint)i)) & 1u;
        result |= (x >> i & 1u ^ flip) << i;
    }
    uint low = count == 0 ? ~0u : (1u << (32 - count)) - 1u;
    return result | (mix_bits(seed ^ mix_bits(x >> (32 - max(count, 1)))) & low);
}

// Bits of the largest index of a sample.
static inline int index_bits(const Tile *tile)
{
    return 32 - (int)clz((uint)tile->scene.numbers.samples - 1u);
}

// A number in [0, 1) of the sequence whose points have these bits, scrambled.
static inline float scrambled(const Tile *tile, uint bits, uint seed)
{
    return (scramble_bits(bits, index_bits(tile), seed, false) >> 8) * 0x1p-24f;
}

// Index in the sequence of the sample in row l; of 2^k rows the order is scrambled too.
static uint index_of_row(const Tile *tile, uint l, uint seed)
{
    const uint samples = tile->scene.numbers.samples;
    if (samples == 1u || (samples & (samples - 1u)) != 0u) return l;
    const int bits = index_bits(tile);
    return scramble_bits(l << (32 - bits), bits, seed, true) >> (32 - bits);
}

// Place of sample l in the unit square of a pixel with this seed.
static float2 net_point(const Tile *tile, uint l, uint seed)
{
    float across = scrambled(tile, sobol(index_of_row(tile, l, seed), 1), seed + 0x9e3779b9u);
    float within = (mix_bits(seed ^ mix_bits(l + 0x85ebca6bu)) >> 8) * 0x1p-24f;
    return (float2)(across, (l + within) * (1.0f / tile->scene.numbers.samples));
}

#if LENS() || GLOSSY()
// Point `index` of the sequence in the unit square of the two dimensions after those of the pixel.
static float2 square_point(const Tile *tile, uint index, uint seed)
{
    return (float2)(scrambled(tile, sobol(index, 2), seed ^ 0x02e5be93u),
        scrambled(tile, sobol(index, 3), seed ^ 0x68bc21ebu));
}
#endif

#if GLOSSY()
static float2 shear_point(const Tile *tile, uint l, uint seed)
{
#if LENS()
    seed = mix_bits(seed + 0x7f4a7c15u);
#endif
    return square_to_disc(square_point(tile, index_of_row(tile, l, seed), seed));
}
#endif

#if LENS()

static float2 lens_point(const Tile *tile, uint l, uint seed)
{
    float2 square = square_point(tile, index_of_row(tile, l, seed), seed);
#if BLADES()
    return square_to_polygon(square, &tile->scene.numbers);
#else
    return square_to_disc(square);
#endif
}

#endif

// Where in the filter's reach the fraction `u` of its weight lies to the left: a table of the
// inverse of its cumulative weight. The box filter needs none.
static inline float warp_to_filter(const Tile *tile, float u)
{
#if FILTER_TABLE()
    const int places = tile->scene.numbers.filter_places;
    float scaled = u * places;
    int i = min((int)scaled, places - 1);
    return mix(tile->scene.filter[i], tile->scene.filter[i + 1], scaled - i);
#else
    return u;
#endif
}

// Where sample l of the pixel lies, relative to the pixel's corner.
static inline float2 place_in_pixel(const Tile *tile, uint l, uint seed)
{
#if SCATTERED()
    float2 at = net_point(tile, l, seed);
    return (float2)(warp_to_filter(tile, at.x), warp_to_filter(tile, at.y));
#else
    Slot slot = tile->scene.slots[l];
    return (float2)(slot.x_low, slot.y_low);
#endif
}

#if WEIGHTED()
// A filter with negative lobes is sampled by its absolute value; where it is negative samples weigh
// less than nothing.
static inline float filter_sign(const Tile *tile, float2 at)
{
    float x = fabs(at.x - 0.5f), y = fabs(at.y - 0.5f), zero = tile->scene.numbers.filter_zero;
    return tile->scene.numbers.filter_mass * ((x > zero) == (y > zero) ? 1.0f : -1.0f);
}
#endif

// Places, and weights that add up to their number in every pixel, of all samples of the current
// layers.
static void place(Tile *tile, int rows)
{
    for (int pixel = 0; pixel < TILE * TILE; pixel++) {
        int x = tile->x + pixel % TILE, y = tile->y + pixel / TILE;
        uint seed = mix_bits((uint)x ^ mix_bits((uint)y ^ mix_bits(tile->scene.numbers.seed)));
#if WEIGHTED()
        const uint samples = tile->scene.numbers.samples;
        float lacking = 1.0f;
        for (uint l = 0; l < samples; l++)
            lacking -= filter_sign(tile, place_in_pixel(tile, l, seed)) * (1.0f / samples);
#endif
        for (int sample = pixel; sample < rows * TILE; sample += TILE * TILE) {
            uint l = (uint)(tile->layer + sample / (TILE * TILE));
            float2 at = place_in_pixel(tile, l, seed);
            Place p = {(float)x + at.x, (float)y + at.y, 0.0f, 0.0f};
#if LENS()
            float2 lens = lens_point(tile, l, seed);
            p.u = lens.x, p.v = lens.y;
#endif
#if GLOSSY()
            float2 shear = shear_point(tile, l, seed);
            p.a = shear.x, p.b = shear.y;
#endif
#if WEIGHTED()
            tile->weights[sample] = filter_sign(tile, at) + lacking;
#endif
            tile->places[sample] = p;
        }
    }
}
