// The samples that a path may cover, eight at a time, whatever rows they lie in.
#ifndef MB_GATHER_H
#define MB_GATHER_H

#include "shared/effects.h"
#include "analytic/edges.h"
#include "analytic/walk.h"
#include "shared/lanes.h"

// A path on a piece of a tile, how far the walk has come, and the samples at hand.
typedef struct {
    MovingTriangle triangle;
    Path path;
    uint index;
    global const Shape *shape;
    bool single_sided;
#if MIRRORS()
    bool mirrors, reflected;        // it is a mirror, or seen in one
#endif
#if GLOSSY()
    Shear shear;
    double height[6];               // of the vertices over the plane that they are sheared along
#endif
    double open, length;            // of its motion segment, in the shutter
    double slack;                   // of times that are rounded to float32, in the segment's
    double w[3], speed[3];          // depth of each vertex at the start, and how it changes
    int block, row, column;         // first row of 16, row within them, next column
    int first[LANES], last[LANES];  // columns of each row
    int waiting;
    int samples[DOUBLES];
#define MEMBER(name) float name[DOUBLES];
    COORDINATES(MEMBER)
#undef MEMBER
} Gather;

// Give the lanes that no sample fills something to compute with.
static void clear_gather(Gather *g)
{
#define CLEAR(name) \
    for (int i = 0; i < DOUBLES; i++) g->name[i] = 0.0f;
    COORDINATES(CLEAR)
#undef CLEAR
}

static void begin_gather(const Tile *tile, uint path_index, Gather *g)
{
    g->index = path_index;
    g->path = tile->scene.paths[path_index];
    g->shape = tile->shapes + path_index;
    g->open = g->path.open, g->length = (double)g->path.close - g->path.open;
    g->single_sided = is_single_sided(tile, g->path);
#if MIRRORS()
    Mesh mesh = tile->scene.meshes[g->path.mesh];
    g->mirrors = mesh.mirror != 0u, g->reflected = mesh.world != 0u;
#endif
    load_moving(tile->scene.vertices, g->path, g->shape->flags, &g->triangle);
#if GLOSSY()
    g->shear = load_shear(tile->scene.cameras, tile->scene.meshes + g->path.mesh, g->path);
    if (g->shear.any) shear_heights(&g->shear, &g->triangle, g->height);
#endif
    g->slack = 1e-7 / g->length;
    for (int i = 0; i < 3; i++) {
        g->w[i] = g->triangle.w[i];
        g->speed[i] = g->triangle.w[i + 3] - g->w[i];
    }
    g->block = -min(LANES, TILE), g->row = LANES, g->column = 0;
}

// Go to the next row that the path may touch. False when there is none.
static bool next_row(const Tile *tile, Gather *g)
{
    const int block_rows = min(LANES, TILE);
    for (;;) {
        while (++g->row < block_rows)
            if (g->first[g->row] <= g->last[g->row]) {
                g->column = g->first[g->row];
                return true;
            }
        do {
            g->block += block_rows;
            if (g->block >= tile->row_high) return false;
        } while (g->block + block_rows <= tile->row_low
                 || !walk_rows(tile, g->shape, g->block, g->first, g->last));
        g->row = -1;
    }
}

#if STATIC()
// Whether something static lies before all of the path; nothing does before what a mirror shows.
static inline bool is_behind_static(const Tile *tile, const Gather *g, int sample)
{
#if MIRRORS()
    if (g->reflected) return false;
#endif
    return g->shape->near > tile->static_depth[sample];
}
#endif

// Gather the next samples, but for those that something static lies before. False when there are
// none left.
static bool gather_samples(const Tile *tile, Gather *g)
{
    g->waiting = 0;
    for (;;) {
        bool in_row = g->row >= 0 && g->row < min(LANES, TILE) && g->column <= g->last[g->row];
        if (!in_row && !next_row(tile, g)) return g->waiting > 0;
        int start = (g->block + g->row) * TILE;
        for (; g->column <= g->last[g->row]; g->column++) {
            int sample = start + g->column;
#if STATIC()
            if (is_behind_static(tile, g, sample)) continue;
#endif
            Place place = place_of(tile, sample);
            g->samples[g->waiting] = sample;
#define KEEP(name) g->name[g->waiting] = place.name;
            COORDINATES(KEEP)
#undef KEEP
            if (++g->waiting == DOUBLES) {
                g->column++;
                return true;
            }
        }
    }
}

// Count the tests of the samples at hand.
static inline void count_tested(Tile *tile, const Gather *g)
{
#if AOV_OPERATIONS()
    for (int i = 0; i < g->waiting; i++) tile->tested[g->samples[i]]++;
#endif
}

static inline Place gathered_place(const Gather *g, int i)
{
    Place place = {g->x[i], g->y[i], 0.0f, 0.0f};
#define TAKE(name) place.name = g->name[i];
    MORE_COORDINATES(TAKE)
#undef TAKE
    return place;
}

// x, y or w (0, 1, 2) of vertex i, which is `value`, as each sample at hand sees it in a glossy
// mirror: the same operations as shear_triangle.
static INLINED Doubles gathered_seen(const Gather *g, double value, int i, int which)
{
#if GLOSSY()
    const double *a = g->shear.tilt[i / 3][0], *b = g->shear.tilt[i / 3][1];
    if (g->shear.any)
        return value
               + g->height[i] * (to_doubles(doubles_load(g->a)) * a[which]
                                 + to_doubles(doubles_load(g->b)) * b[which]);
#endif
    return value;
}

static INLINED Doubles gathered_w(const Gather *g, int i)
{
    return gathered_seen(g, g->triangle.w[i], i, 2);
}

// Vertex i relative to each sample at hand: the same operations as shifted_x and shifted_y.
static INLINED Doubles gathered_x(const Gather *g, int i)
{
    Doubles x = gathered_seen(g, g->triangle.x[i], i, 0);
    x = THROUGH_LENS(Doubles, x, to_doubles(doubles_load(g->u)), g->triangle, i);
    return fma(-to_doubles(doubles_load(g->x)), gathered_w(g, i), x);
}

static INLINED Doubles gathered_y(const Gather *g, int i)
{
    Doubles y = gathered_seen(g, g->triangle.y[i], i, 1);
    y = THROUGH_LENS(Doubles, y, to_doubles(doubles_load(g->v)), g->triangle, i);
    return fma(-to_doubles(doubles_load(g->y)), gathered_w(g, i), y);
}

#endif
