// The environment behind everything, as samples see it at times of the shutter.
#ifndef MB_GAZE_H
#define MB_GAZE_H

#include "shared/effects.h"
#include "shared/coordinates.h"
#include "shared/mirror_planes.h"
#include "shared/panorama.h"

// Where samples look at the environment: places on the film, of the lens, and of the disc of a
// glossy mirror, and the world that they see last.
typedef struct {
    Lanes x, y, u, v, a, b;
    uint world;
} Gaze;

static inline Gaze gaze_at(Place place, uint world)
{
    Gaze g = {place.x, place.y, place.u, place.v, 0.0f, 0.0f, world};
#define TAKE(name) g.name = place.name;
    DISC_COORDINATES(TAKE)
#undef TAKE
    return g;
}

// What samples see of the environment at times t: places in its picture, and what is around them
// as far as a sample stands for.
static INLINED Patches sky_patches(const Scene *scene, const Gaze *gaze, Lanes t)
{
    float times[LANES], way[3][LANES], px[LANES], py[LANES], angle[LANES];
    lanes_store(t, times), lanes_store(gaze->x, px), lanes_store(gaze->y, py);
#if LENS()
    float pu[LANES], pv[LANES];
    lanes_store(gaze->u, pu), lanes_store(gaze->v, pv);
#endif
    uint k = 0;
    for (int i = 0; i < LANES; i++) {
        while (k > 0u && scene->sky[k].open > times[i]) k--;
        while (k + 1u < scene->numbers.sky_count && scene->sky[k].close <= times[i]) k++;
        global const Sky *sky = scene->sky + k;
        float part = clamp((times[i] - sky->open) / (sky->close - sky->open), 0.0f, 1.0f);
#if LENS()
        float blur = mix(sky->blur_start, sky->blur_end, part);
        px[i] -= blur * pu[i], py[i] -= blur * pv[i];
#endif
        for (int row = 0; row < 3; row++) {
            global const float *a = sky->start + 3 * row, *b = sky->end + 3 * row;
            float start = a[0] * px[i] + a[1] * py[i] + a[2];
            way[row][i] = mix(start, b[0] * px[i] + b[1] * py[i] + b[2], part);
        }
        angle[i] = mix(sky->angle_start, sky->angle_end, part);
    }
    Lanes3 ways = {lanes_load(way[0]), lanes_load(way[1]), lanes_load(way[2])};
    // Off the middle a pixel's solid angle is less by the cube of the cosine, which is 1 / length.
    Lanes length = sqrt(lanes_dot(ways, ways));
    Lanes spread = lanes_load(angle) * scene->numbers.sample_spacing / (length * sqrt(length));
    ways = unsheared(scene, gaze->world, ways, gaze->a, gaze->b);
    return patches_of(scene->panorama, unmirrored(scene, gaze->world, ways), spread);
}

static inline Picture sky_picture(const Scene *scene)
{
    return (Picture){*scene->panorama, scene->panorama_texels, scene->panorama_sums};
}

// Light from patches of the environment; `count` of them matter.
static Lanes3 sky_light(const Scene *scene, const Patches *at, int count)
{
    const Picture picture = sky_picture(scene);
    return picture_light(&picture, at, count);
}

#endif
