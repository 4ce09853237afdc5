// A picture of all directions by longitude and latitude, which an environment is: its middle is -z,
// what is to the right of it +x, its upper edge +y.
//
// What is looked up is the mean over a box, of what a sample stands for but of one texel at least,
// across and down. Over one texel that is what bilinear interpolation between the centres of texels
// finds. Where texels are narrower than what a sample stands for, as they are next to the poles
// whatever their number, it comes from a table of the sums of all texels above and to the left
// (Crow 1984, "Summed-area tables for texture mapping"). Sums are whole numbers of a `unit` of
// light, so that they are exact: what is dark does not lose its digits beside what is bright.
#ifndef MB_PANORAMA_H
#define MB_PANORAMA_H

#include "shared/effects.h"
#include "shared/vectors.h"
#include "shared/records.h"

typedef struct {
    Panorama about;
    global const float *texels; // three each
#if SKY()
    global const long *sums; // likewise, of texels above and to the left of each corner
#endif
} Picture;

// Where sixteen directions are in a picture, and the boxes around them, in texels.
typedef struct {
    Lanes x, y, wide, high;
} Patches;

// Angles from -pi to pi; 0 where both are 0. After Moshier's atanf (Cephes), which is off by two
// units in the last place at most.
static INLINED Lanes lanes_atan2(Lanes y, Lanes x)
{
    Lanes across = fabs(x), up = fabs(y);
    Lanes most = lanes_max(across, up), a = lanes_min(across, up) / lanes_max(most, FLT_MIN);
    LaneMask far = a > 0.41421356f; // the tangent of an eighth of pi
    a = far ? (a - 1.0f) / (a + 1.0f) : a;
    Lanes z = a * a;
    Lanes angle = ((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z;
    angle = (angle - 3.33329491539e-1f) * z * a + a;
    angle += far ? (Lanes)(M_PI_4_F) : (Lanes)(0.0f);
    angle = up > across ? M_PI_2_F - angle : angle;
    angle = x < 0.0f ? M_PI_F - angle : angle;
    return y < 0.0f ? -angle : angle;
}

// Size of the box that is averaged where a sample stands for `texels` of them: one texel where that
// is less, and where it is far more as wide as has the variance of the mean of what is interpolated
// between texels, which itself is spread by one.
static INLINED Lanes box_size(Lanes texels, float most)
{
    texels = lanes_min(texels, (Lanes)(most)); // whose square is a number
    Lanes square = lanes_max(texels * texels, (Lanes)(1.0f));
    return lanes_min(sqrt(square + 1.0f - 1.0f / square), (Lanes)(most));
}

// Patches of directions of any length, of samples that stand for `spread` radians.
static INLINED Patches patches_of(global const Panorama *about, Lanes3 way, Lanes spread)
{
    const float width = about->width, height = about->height;
    Lanes level = sqrt(way.x * way.x + way.z * way.z);
    Lanes turned = (lanes_atan2(way.x, -way.z) + about->turn) * (0.5f * M_1_PI_F) + 0.5f;
    Lanes x = (turned - floor(turned)) * width;
    Lanes y = (0.5f - lanes_atan2(way.y, level) * M_1_PI_F) * height;
    // Parallels are shorter by the cosine of the latitude.
    Lanes cosine = level / lanes_max(sqrt(lanes_dot(way, way)), FLT_MIN);
    Lanes wide = spread * (0.5f * M_1_PI_F * width) / lanes_max(cosine, (Lanes)(1e-9f));
    Lanes high = spread * (M_1_PI_F * height);
    return (Patches){x, y, box_size(wide, width), box_size(high, height)};
}

// How far each patch is from the next, in sizes of the greater of the two, across or down.
static INLINED Lanes patches_apart(global const Panorama *about, const Patches *p)
{
    const float width = about->width;
    Lanes across = fabs(lanes_steps(p->x)), down = fabs(lanes_steps(p->y));
    across = lanes_min(across, width - across); // around the other way
    Lanes next_wide = p->wide + lanes_steps(p->wide), next_high = p->high + lanes_steps(p->high);
    return lanes_max(across / lanes_max(p->wide, next_wide), down / lanes_max(p->high, next_high));
}

// Interpolated between the centres of texels.
static float3 texels_around(const Picture *p, float x, float y)
{
    const int width = p->about.width, height = p->about.height;
    x -= 0.5f, y = clamp(y - 0.5f, 0.0f, height - 1.0f);
    int left = (int)floor(x), top = min((int)y, max(height - 2, 0));
    int right = left + 1 < width ? left + 1 : 0, bottom = min(top + 1, height - 1);
    float across = x - left, down = y - top;
    left = left < 0 ? width - 1 : left;
    float3 upper = mix(vload3((size_t)top * width + left, p->texels),
                       vload3((size_t)top * width + right, p->texels), across);
    float3 lower = mix(vload3((size_t)bottom * width + left, p->texels),
                       vload3((size_t)bottom * width + right, p->texels), across);
    return p->about.intensity * mix(upper, lower, down);
}

// Light from the middles of patches; `count` of them matter.
static Lanes3 picture_points(const Picture *p, const Patches *at, int count)
{
    float x[LANES], y[LANES], found[3][LANES];
    lanes_store(at->x, x), lanes_store(at->y, y);
    for (int i = 0; i < LANES; i++) {
        float3 light = 0.0f;
        if (i < count) light = texels_around(p, x[i], y[i]);
        found[0][i] = light.x, found[1][i] = light.y, found[2][i] = light.z;
    }
    return (Lanes3){lanes_load(found[0]), lanes_load(found[1]), lanes_load(found[2])};
}

#if SKY()

// Sum of the texels above a row and to the left of a column, which may lie in the next turn.
static inline long3 sum_until(const Picture *p, int row, int column)
{
    const int width = p->about.width;
    const size_t start = (size_t)row * (width + 1);
    long3 before = 0;
    if (column < 0) before = -vload3(start + width, p->sums), column += width;
    if (column > width) before = vload3(start + width, p->sums), column -= width;
    return before + vload3(start + column, p->sums);
}

// Texels from one edge to another: those in between, and shares of the first and the last.
typedef struct {
    int ends[4];
    float share[3];
} Extent;

static inline Extent extent_of(float from, float to)
{
    int first = (int)floor(from), last = max((int)floor(to), first + 1);
    return (Extent){{first, first + 1, last, last + 1},
                    {first + 1 - from, 1.0f, fmax(to - last, 0.0f)}};
}

// Mean over the box around a place: of nine parts, whose texels have a share each. Nothing is
// beyond the poles.
static float3 texels_in_box(const Picture *p, float x, float y, float wide, float high)
{
    const int height = p->about.height;
    Extent across = extent_of(x - 0.5f * wide, x + 0.5f * wide);
    Extent down = extent_of(fmax(y - 0.5f * high, 0.0f), fmin(y + 0.5f * high, height));
    float3 sum = 0.0f;
    float count = 0.0f;
    long3 above[3];
    for (int row = 0; row < 4; row++) {
        int end = min(down.ends[row], height);
        long3 left = sum_until(p, end, across.ends[0]);
        for (int column = 0; column < 3; column++) {
            long3 right = sum_until(p, end, across.ends[column + 1]), here = right - left;
            if (row > 0) {
                float share = down.share[row - 1] * across.share[column];
                int texels = (end - min(down.ends[row - 1], height))
                             * (across.ends[column + 1] - across.ends[column]);
                sum += share * convert_float3(here - above[column]);
                count += share * texels;
            }
            above[column] = here, left = right;
        }
    }
    return convert_float3(convert_double3(sum / count) * p->about.unit);
}

// Mean over the box around sixteen patches and as much again on all sides, in `mean`; returns how
// many of the last patch's size have room in it.
static float box_around(const Picture *p, const Patches *at, float3 *mean)
{
    const float width = p->about.width;
    Lanes x = at->x - first_lane(at->x);
    x -= width * rint(x / width); // the shorter way around
    Lanes y = at->y;
    float left = lanes_least(x - at->wide), right = lanes_greatest(x + at->wide);
    float top = lanes_least(y - at->high), bottom = lanes_greatest(y + at->high);
    float wide = fmin(right - left, width), high = bottom - top;
    float middle = first_lane(at->x) + 0.5f * (left + right);
    middle -= width * floor(middle / width);
    *mean = texels_in_box(p, middle, 0.5f * (top + bottom), wide, high);
    return wide * high / (LANE(float, at->wide, LANES - 1) * LANE(float, at->high, LANES - 1));
}

// Light from patches; `count` of them matter.
static Lanes3 picture_light(const Picture *p, const Patches *at, int count)
{
    float x[LANES], y[LANES], wide[LANES], high[LANES], found[3][LANES];
    lanes_store(at->x, x), lanes_store(at->y, y);
    lanes_store(at->wide, wide), lanes_store(at->high, high);
    for (int i = 0; i < LANES; i++) {
        float3 light = 0.0f;
        if (i < count && wide[i] == 1.0f && high[i] == 1.0f) light = texels_around(p, x[i], y[i]);
        else if (i < count) light = texels_in_box(p, x[i], y[i], wide[i], high[i]);
        found[0][i] = light.x, found[1][i] = light.y, found[2][i] = light.z;
    }
    return (Lanes3){lanes_load(found[0]), lanes_load(found[1]), lanes_load(found[2])};
}

#endif // SKY

#endif
