// Stage "rasterize": the triangles of every motion path's surface into per-pixel linked lists
// (Hong & Oh 2017, 4.3).
//
// A row of samples cuts a triangle in two of its edges. Where an edge meets the row, relative to
// the sample, is the edge function of its two corners; a sample is inside where the two edges lie
// on different sides of it. An edge is evaluated once for the two faces that share it, so a closed
// surface gives every sample an even number of fragments, whatever is rounded. Corners are shifted
// to the sample before anything is multiplied; nothing is divided by w and nothing clipped.
#include "analytic/walk.h"
#include "analytic/swept_surface.h"

// Where an edge meets the row: x relative to the samples, and the sums of the weights that its
// corners have there, of their times and of their w.
typedef struct {
    Lanes x;
    float weight, time, w;
} EdgePoint;

static EdgePoint meet_edge(const Surface *surface, int edge, const Lanes *x, const float *y)
{
    int i = EDGE_CORNERS[edge][0], j = EDGE_CORNERS[edge][1];
    float yi = fabs(y[i]), yj = fabs(y[j]);
    EdgePoint point;
    point.x = x[i] * yj + x[j] * yi;
    point.weight = yi + yj;
    point.time = CORNER_TIME[i] * yj + CORNER_TIME[j] * yi;
    point.w = surface->w[i] * yj + surface->w[j] * yi;
    int side = (edge - 9) / 4;
    if (edge >= 9 && (surface->crossed >> side & 1u)) {
        // A part of an edge of a cap: the same function as that edge's, to the bit.
        int part = (edge - 9) % 4, whole = part < 2 ? side : side + 3;
        int p = EDGE_CORNERS[whole][0], q = EDGE_CORNERS[whole][1];
        int low = y[p] < 0.0f ? p : q, high = low == p ? q : p;
        point.x = x[low] * y[high] - x[high] * y[low];
        point.x *= surface->along[side][part];
    }
    return point;
}

// value - position * weight, rounded once, plus the same of the low parts.
static INLINED Lanes lanes_shift(float value, float value_low, Lanes position, float weight,
                                 float weight_low)
{
    return fma(-position, (Lanes)(weight), (Lanes)(value))
           + fma(-position, (Lanes)(weight_low), (Lanes)(value_low));
}

// Up to 16 samples of one row, the first of them at `column`.
typedef struct {
    int row, column, count;
} Strip;

static INLINED bool append_fragments(Tile *tile, Strip strip, uint part, LaneMask inside, Lanes t,
                                     Lanes w)
{
    float times[LANES], ws[LANES];
    int hit[LANES];
    lanes_store(t, times);
    lanes_store(w, ws);
    lanes_store(inside, hit);
    for (int i = 0; i < strip.count; i++) {
        if (!hit[i]) continue;
        if (tile->fragment_count == tile->capacity) return false;
        uint node = tile->fragment_count++;
        int sample = strip.row * TILE + strip.column + i;
        Fragment fragment = {times[i], ws[i], part, tile->heads[sample]};
        tile->fragments[node] = fragment;
        tile->heads[sample] = (int)node;
    }
    return true;
}

// What fragments of a path are made with.
typedef struct {
    const Surface *surface;
    uint path;
    float open, length; // of its motion segment, in the shutter
    float w_scale;      // to undo the surface's scale
} Source;

// All faces of a path's surface on samples, relative to which the corners' y are given.
static bool rasterize_samples(Tile *tile, const Source *source, const float *y, Strip strip)
{
    const Surface *surface = source->surface;
    Lanes x[CORNERS];
    Lanes sample = to_lanes((int)(tile->x + strip.column) + to_lane_ints(LANE_INDEX))
                   + tile->scene.slots[tile->layer + strip.row / TILE].x_low;
    int below = 0;
    for (int i = 0; i < CORNERS; i++) {
        x[i] = lanes_shift(surface->x[i], surface->x_low[i], sample, surface->w[i],
                           surface->w_low[i]);
        below |= (y[i] < 0.0f) << i;
    }
    int crossing = crossing_edges(below);
    EdgePoint points[EDGES];
    for (int rest = crossing; rest != 0; rest &= rest - 1) {
        int edge = 31 - clz(rest & -rest);
        points[edge] = meet_edge(surface, edge, x, y);
    }
    for (int face = 0; face < FACES; face++) {
        int edges = crossing & FACE_EDGES[face];
        if (edges == 0) continue;
        int side = (face - 2) / 4;
        if (face >= 2 && face % 2 == 0 && (surface->crossed >> side & 1u)) continue;
        EdgePoint a = points[31 - clz(edges & -edges)], b = points[31 - clz(edges)];
        LaneMask inside = (a.x > 0.0f) ^ (b.x > 0.0f);
        Lanes to_a = fabs(b.x), to_b = fabs(a.x);
        Lanes over = 1.0f / (a.weight * to_a + b.weight * to_b);
        Lanes w = (a.w * to_a + b.w * to_b) * over;
        Lanes t = (a.time * to_a + b.time * to_b) * over;
        inside &= w > 0.0f;
        if (!any_lane(inside)) continue;
        if (!append_fragments(tile, strip, source->path << PART_BITS | face, inside,
                              source->open + source->length * t, w * source->w_scale))
            return false;
    }
    return true;
}

// One path on the rows first_row ... first_row + 15. False when the pool is full.
static bool rasterize_rows(Tile *tile, const Surface *surface, uint path_index, int first_row)
{
    int first[LANES], last[LANES];
    global const Shape *shape = tile->shapes + path_index;
    if (!walk_rows(tile, shape, first_row, first, last)) return true;
    Path path = tile->scene.paths[path_index];
    const Source source = {surface, path_index, path.open, path_length(path), 1.0f / shape->scale};
    for (int i = 0; i < min(LANES, TILE - first_row % TILE); i++) {
        if (first[i] > last[i]) continue;
        int row = first_row + i;
        float y[CORNERS], sample = sample_y(tile, row);
        for (int k = 0; k < CORNERS; k++)
            y[k] = fma(-sample, surface->w[k], surface->y[k])
                   + fma(-sample, surface->w_low[k], surface->y_low[k]);
        for (int column = first[i]; column <= last[i]; column += LANES) {
            Strip strip = {row, column, min(LANES, last[i] + 1 - column)};
            if (!rasterize_samples(tile, &source, y, strip)) return false;
        }
    }
    return true;
}

// Fill the piece's lists. False when the pool is full.
static bool rasterize(Tile *tile)
{
    tile->fragment_count = 0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++) tile->heads[i] = -1;
    for (uint k = tile->static_count; k < tile->member_count; k++) {
        uint path_index = tile->members[k];
        Surface surface;
        load_surface(tile->scene.vertices, tile->scene.paths[path_index],
                     tile->shapes + path_index, &surface);
        for (int row = 0; row < tile->rows; row += min(LANES, TILE))
            if (row + LANES > tile->row_low && row < tile->row_high
                && !rasterize_rows(tile, &surface, path_index, row))
                return false;
    }
    return true;
}
