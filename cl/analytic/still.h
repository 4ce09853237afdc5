// Colours of what does not move, for sixteen samples at a time. A sample has one such colour, that
// of its nearest static surface, whenever it is seen.
#ifndef MB_STILL_H
#define MB_STILL_H

#include "shared/effects.h"
#include "analytic/edges.h"
#include "analytic/surface_color.h"

// Samples that see the same path.
typedef struct {
    uint path;
    int count;
    int samples[LANES];
    float x[LANES], y[LANES], w[LANES];
#define MEMBER(name) float name[LANES];
    LENS_COORDINATES(MEMBER)
#undef MEMBER
} Still;

static Attributes still_attributes(const Tile *tile, const Still *still, const Shaded *s)
{
    MovingTriangle m;
    load_moving(tile->scene.vertices, s->path, tile->shapes[still->path].flags, &m);
    LaneDoubles x[3], y[3], e[3], sum = 0.0;
    for (int i = 0; i < 3; i++) {
        x[i] = m.x[i], y[i] = m.y[i];
        x[i] = THROUGH_LENS(LaneDoubles, x[i], to_lane_doubles(lanes_load(still->u)), m, i);
        y[i] = THROUGH_LENS(LaneDoubles, y[i], to_lane_doubles(lanes_load(still->v)), m, i);
        x[i] = fma(-to_lane_doubles(lanes_load(still->x)), (LaneDoubles)(m.w[i]), x[i]);
        y[i] = fma(-to_lane_doubles(lanes_load(still->y)), (LaneDoubles)(m.w[i]), y[i]);
    }
    for (int i = 0; i < 3; i++) {
        int p = edge_first(&m, i), q = edge_second(&m, i);
        double sign = (m.reversed >> i & 1u) ? -1.0 : 1.0;
        e[i] = sign * fma(x[p], y[q], -(x[q] * y[p]));
        sum += e[i];
    }
    Weights weights[6];
    for (int i = 0; i < 3; i++) {
        weights[i] = to_weights(sum != 0.0 ? e[i] / sum : (LaneDoubles)(1.0 / 3.0));
        weights[i + 3] = 0.0f;
    }
    return blend_corners(s, weights);
}

// Find the colours of the samples at hand; the lanes beyond repeat the last one.
static void shade_still(Tile *tile, Still *still)
{
    if (still->count == 0) return;
    for (int i = still->count; i < LANES; i++) {
        still->x[i] = still->x[i - 1], still->y[i] = still->y[i - 1], still->w[i] = still->w[i - 1];
#define REPEAT(name) still->name[i] = still->name[i - 1];
        LENS_COORDINATES(REPEAT)
#undef REPEAT
    }
    Shaded s = load_shaded(&tile->scene, still->path);
    Colors color = {s.path.color[0], s.path.color[1], s.path.color[2]};
    if (varies_on_surface(&s)) {
        Place corner = {0.0f, 0.0f, 0.0f, 0.0f}; // whichever samples are shaded together
        s.place = corner;
        load_attributes(tile, &s);
        Attributes a = still_attributes(tile, still, &s);
        Sight sight = {s.path.open, lanes_load(still->w), lanes_load(still->x),
                     lanes_load(still->y)};
#if LENS()
        // A point is seen through the middle of the lens where its circle of confusion is not.
        sight.across -= lanes_load(still->u) * a.circle / sight.w;
        sight.down -= lanes_load(still->v) * a.circle / sight.w;
#endif
#if ANISOTROPY()
        if (has_footprint(&s))
            load_footprint(&tile->scene, &s, 0.0f, lanes_load(still->x), lanes_load(still->y), &a);
#endif
        color = surface_color(tile, &s, &a, 0.0f, still->count, &sight);
    }
    for (int i = 0; i < still->count; i++)
        tile->still[still->samples[i]] = (float4)(LANE3(color, i), 1.0f);
    still->count = 0;
}

// Whether the sample's static surface is ever seen.
static inline bool sees_still(const Tile *tile, int sample)
{
    bool seen = tile->static_depth[sample] < INFINITY;
#if MOVING()
    Run run = tile->span_runs[sample];
    bool found = false;
    for (uint i = 0; seen && !found && i < run.count; i++)
        found = span_path(tile, tile->spans[run.start + i]) < tile->scene.numbers.static_paths;
    seen &= found;
#endif
    return seen;
}

// Colours of all samples of the piece that see something static.
static void shade_all_still(Tile *tile)
{
    Still still = {.count = 0};
    for (int row = tile->row_low; row < tile->row_high; row++) {
        if (!row_is_rendered(tile, row)) continue;
        for (int column = tile->x_low; column < tile->x_high; column++) {
            int sample = row * TILE + column;
            if (!sees_still(tile, sample)) continue;
            uint path = tile->static_part[sample] >> PART_BITS;
            if (still.count == LANES || path != still.path) shade_still(tile, &still);
            Place place = place_of(tile, sample);
            int i = still.count++;
            still.path = path, still.samples[i] = sample;
            still.x[i] = place.x, still.y[i] = place.y;
            still.w[i] = (float)tile->static_depth[sample];
#define KEEP(name) still.name[i] = place.name;
            LENS_COORDINATES(KEEP)
#undef KEEP
        }
    }
    shade_still(tile, &still);
}

#endif
