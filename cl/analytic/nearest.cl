// Stage "nearest": what does not move needs no time. A z-buffer keeps, for each sample, the nearest
// static surface; it bounds the depth of everything that moves.
//
// The edge functions are those of a moving triangle, constant in time, and so is what they say of a
// sample that lies on one. Without a lens they are linear in the sample's place.
#include "shared/effects.h"
#include "analytic/edges.h"
#include "analytic/walk.h"
#include "shared/lanes.h"

// A triangle at rest, or as it is at one moment.
typedef struct {
    MovingTriangle triangle; // the same at both ends
    uint index;              // of its path
    bool single_sided;
    double x[3], y[3], at[3]; // edge i at the sample (X, Y) is x X + y Y + at; without a lens
} Resting;

// Where eight neighbours of a row lie.
typedef struct {
    Doubles x, y;
#define MEMBER(name) Doubles name;
    LENS_COORDINATES(MEMBER)
#undef MEMBER
} Places;

// Prepare the triangle; its vertices are there.
static void set_edges(Resting *r)
{
    const MovingTriangle *m = &r->triangle;
    for (int i = 0; i < 3; i++) {
        int p = edge_first(m, i), q = edge_second(m, i);
        double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
        r->x[i] = sign * cross2(m->y[p], m->w[p], m->y[q], m->w[q]);
        r->y[i] = sign * cross2(m->w[p], m->x[p], m->w[q], m->x[q]);
        r->at[i] = sign * cross2(m->x[p], m->y[p], m->x[q], m->y[q]);
    }
}

static void load_resting(const Tile *tile, uint path_index, Resting *r)
{
    Path path = tile->scene.paths[path_index];
    r->index = path_index;
    r->single_sided = is_single_sided(tile, path);
    load_moving(tile->scene.vertices, path, tile->shapes[path_index].flags, &r->triangle);
    set_edges(r);
}

static Places places_from(const Tile *tile, int sample)
{
    Places places;
#if PLACED()
    for (int i = 0; i < DOUBLES; i++) {
        Place place = tile->places[sample + i];
        LANE(double, places.x, i) = place.x, LANE(double, places.y, i) = place.y;
#define KEEP(name) LANE(double, places.name, i) = place.name;
        LENS_COORDINATES(KEEP)
#undef KEEP
    }
#else
    int row = sample / TILE; // what follows is place_of's sum
    Floats column = (float)(tile->x + sample % TILE) + DOUBLE_INDEX(Floats);
    places.x = to_doubles(column + tile->scene.slots[tile->layer + row / TILE].x_low);
    places.y = sample_y(tile, row);
#endif
    return places;
}

static inline Place place_of_lane(const Places *places, int i)
{
    Place place = {LANE(double, places->x, i), LANE(double, places->y, i), 0.0f, 0.0f};
#define TAKE(name) place.name = LANE(double, places->name, i);
    LENS_COORDINATES(TAKE)
#undef TAKE
    return place;
}

// Values of the three edge functions.
static inline void edges_at(const Resting *r, const Places *places, Doubles *e)
{
#if LENS()
    const MovingTriangle *m = &r->triangle;
    Doubles x[3], y[3]; // the same operations as shifted_x and shifted_y
    for (int i = 0; i < 3; i++) {
        x[i] = fma(places->u, (Doubles)(m->circle[i]), (Doubles)(m->x[i]));
        y[i] = fma(places->v, (Doubles)(m->circle[i]), (Doubles)(m->y[i]));
        x[i] = fma(-places->x, (Doubles)(m->w[i]), x[i]);
        y[i] = fma(-places->y, (Doubles)(m->w[i]), y[i]);
    }
    for (int i = 0; i < 3; i++) {
        int p = edge_first(m, i), q = edge_second(m, i);
        double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
        e[i] = sign * fma(x[p], y[q], -(x[q] * y[p]));
    }
#else
    for (int i = 0; i < 3; i++) {
        e[i] = fma((Doubles)(r->y[i]), places->y, (Doubles)(r->at[i]));
        e[i] = fma((Doubles)(r->x[i]), places->x, e[i]);
    }
#endif
}

// Depth at one sample, or infinity where the triangle does not cover it, whatever the case.
static double static_depth_at(const Resting *r, Place place)
{
    double e = 0.0, d = 0.0;
    int positive = 0;
    for (int i = 0; i < 3; i++) {
        double b[3], exact[3];
        perturbed_edge_function(&r->triangle, i, place, b);
        edge_function(&r->triangle, i, place, exact);
        positive |= (b[0] > 0.0) << i;
        e += exact[0], d += exact[0] * r->triangle.w[i];
    }
    bool covered = (positive == 7 && !r->single_sided) || positive == 0;
    double w = d / e;
    return covered && w > 0.0 && w < INFINITY ? w : INFINITY;
}

// The depth of the triangle, where `allowed`, into the z-buffer of eight samples from `sample` on;
// ties go to the path that comes first.
static void nearest_of_lanes(Tile *tile, const Resting *r, int sample, const Places *places,
                             const DoubleMask *allowed)
{
    DoubleMask mask = *allowed;
    Doubles e[3];
    edges_at(r, places, e);
    DoubleMask covered = (e[0] < 0.0) & (e[1] < 0.0) & (e[2] < 0.0);
    if (!r->single_sided) covered |= (e[0] > 0.0) & (e[1] > 0.0) & (e[2] > 0.0);
    DoubleMask zero = mask & ((e[0] == 0.0) | (e[1] == 0.0) | (e[2] == 0.0));
    covered &= mask;
    if (!any_double(covered | zero)) return;
    const double *depth = r->triangle.w;
    Doubles w = (e[0] * depth[0] + e[1] * depth[1] + e[2] * depth[2]) / (e[0] + e[1] + e[2]);
    w = (covered & (w > 0.0)) ? w : (Doubles)(INFINITY);
    if (any_double(zero))
        for (int i = 0; i < DOUBLES; i++)
            if (LANE(long, zero, i))
                LANE(double, w, i) = static_depth_at(r, place_of_lane(places, i));
    Doubles before = doubles_load(tile->static_depth + sample);
    Uints part = doubles_load(tile->static_part + sample);
    DoubleMask first = to_double_mask((Uints)(r->index) < part >> PART_BITS);
    DoubleMask nearer = (w < before) | ((w == before) & (w < INFINITY) & first);
    if (!any_double(nearer)) return;
    doubles_store(nearer ? w : before, tile->static_depth + sample);
    part = to_ints(nearer) ? (Uints)(r->index << PART_BITS) : part;
    doubles_store(part, tile->static_part + sample);
}

// Columns of a row that lie from `first` to `last`.
static INLINED DoubleMask columns_between(int column, int first, int last)
{
    DoubleMask lanes = (long)column + DOUBLE_INDEX(DoubleMask);
    return (lanes >= (long)first) & (lanes <= (long)last);
}

// The samples of a row from column `first` to `last`, but for those that something at hand lies
// before.
static void nearest_in_row(Tile *tile, const Resting *r, int row, int first, int last)
{
    double near = tile->shapes[r->index].near;
    for (int column = first / DOUBLES * DOUBLES; column <= last; column += DOUBLES) {
        int sample = row * TILE + column;
        Doubles before = doubles_load(tile->static_depth + sample);
        DoubleMask mask = columns_between(column, first, last) & (before >= near);
        if (!any_double(mask)) continue;
#if AOV_OPERATIONS()
        for (int i = 0; i < DOUBLES; i++) tile->tested[sample + i] -= LANE(long, mask, i);
#endif
        Places places = places_from(tile, sample);
        nearest_of_lanes(tile, r, sample, &places, &mask);
    }
}

static void clear_nearest(Tile *tile)
{
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) {
        tile->static_depth[i] = INFINITY;
        tile->static_part[i] = 0u;
    }
}

// Depth that no surface of the piece lies behind.
static double farthest_surface(const Tile *tile)
{
    Doubles far = 0.0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i += DOUBLES)
        far = doubles_max(far, doubles_load(tile->static_depth + i));
    double depth[DOUBLES], most = 0.0;
    doubles_store(far, depth);
    for (int i = 0; i < DOUBLES; i++) most = fmax(most, depth[i]);
    return most;
}

#define PATHS_BETWEEN 8 // paths after which the farthest surface is looked for again

// Nearest static surface of every sample of the piece: paths come from near to far, and end where
// all that follow lie behind. Always true: a z-buffer cannot run full.
static bool nearest(Tile *tile)
{
    clear_nearest(tile);
    const int block_rows = min(LANES, TILE);
    double far = INFINITY;
    for (uint k = 0; k < tile->static_count; k++) {
        if (k % PATHS_BETWEEN == 0) far = farthest_surface(tile);
        uint path = tile->members[k];
        if (tile->shapes[path].near > far) break;
        fetch_ahead(tile, k);
        Resting r;
        load_resting(tile, path, &r);
        for (int block = 0; block < tile->row_high; block += block_rows) {
            int first[LANES], last[LANES];
            if (block + block_rows <= tile->row_low
                || !walk_rows(tile, tile->shapes + path, block, first, last))
                continue;
            for (int i = 0; i < block_rows; i++)
                nearest_in_row(tile, &r, block + i, first[i], last[i]);
        }
    }
    return true;
}
