// Bounds on screen of a moving triangle for a stretch of time and a part of the lens.
#ifndef MB_BOX_H
#define MB_BOX_H

#include "shared/effects.h"
#include "stochastic/test.h"

// Pixels from the middle of the tile.
typedef struct {
    float left, right, top, bottom;
} Box;

// When, and where on the lens.
typedef struct {
    float t[2], u[2], v[2]; // from, to; t over the motion segment
} Stratum;

constant Stratum EVERYTHING = {{0.0f, 1.0f}, {-1.0f, 1.0f}, {-1.0f, 1.0f}};

// Bounds along one axis of points (p, w), which may be as far as `p_low` and `p_high`. Where some
// lie behind the eye the bound is infinite on each side on which the hull of all meets the eye's
// plane: that is where a line between one before it and one behind it does (what Laine et al. 2011,
// 3.1, find by a separating line).
static void project_extent(const float *p_low, const float *p_high, const float *w, int count,
                           float slack, float *low, float *high)
{
    *low = INFINITY, *high = -INFINITY;
    for (int i = 0; i < count; i++) {
        if (w[i] <= 0.0f) continue;
        // Behind the eye or so near to it that rounding decides: the loop below sees to it.
        *low = fmin(*low, (p_low[i] - slack) / w[i] - 1e-3f);
        *high = fmax(*high, (p_high[i] + slack) / w[i] + 1e-3f);
        for (int k = 0; k < count; k++) {
            if (w[k] > slack) continue;
            if ((p_high[i] + slack) * (slack - w[k]) + (p_high[k] + slack) * w[i] >= 0.0f)
                *high = INFINITY;
            if ((p_low[i] - slack) * (slack - w[k]) + (p_low[k] - slack) * w[i] <= 0.0f)
                *low = -INFINITY;
        }
    }
}

static Box screen_box(const Moving *m, const Stratum *s)
{
    float x_low[6], x_high[6], y_low[6], y_high[6], w[6];
    for (int k = 0; k < 6; k++) {
        int i = k % 3;
        float t = s->t[k / 3];
        float x = m->x[i] + t * m->dx[i], y = m->y[i] + t * m->dy[i];
        w[k] = m->w[i] + t * m->dw[i];
        x_low[k] = x_high[k] = x, y_low[k] = y_high[k] = y;
#if LENS()
        float c = m->c[i] + t * m->dc[i];
        x_low[k] += fmin(c * s->u[0], c * s->u[1]), x_high[k] += fmax(c * s->u[0], c * s->u[1]);
        y_low[k] += fmin(c * s->v[0], c * s->v[1]), y_high[k] += fmax(c * s->v[0], c * s->v[1]);
#endif
    }
    Box box;
    project_extent(x_low, x_high, w, 6, m->slack, &box.left, &box.right);
    project_extent(y_low, y_high, w, 6, m->slack, &box.top, &box.bottom);
    return box;
}

// Pixels along an edge of the tiles that samples are culled in.
static INLINED int cull_edge(const Tile *tile)
{
#if CULL_TILES()
    return tile->scene.numbers.cull_tile;
#else
    return 1;
#endif
}

// Of these tiles, the middle of each lane's, and half of what its samples span.
static INLINED Lanes tile_middle(const Tile *tile, Lanes pixel)
{
    int edge = cull_edge(tile);
    Lanes first = floor(pixel * (1.0f / edge)) * edge;
    return first + (0.5f * (edge - 1 + tile->reach_low + tile->reach_high) - HALF);
}

static inline float tile_half(const Tile *tile)
{
    return 0.5f * (cull_edge(tile) - 1 + tile->reach_high - tile->reach_low) * (1.0f + 1e-6f);
}

static INLINED LaneMask tiles_in_box(const Box *box, Lanes x, Lanes y, float half_size)
{
    return (x + half_size >= box->left) & (x - half_size <= box->right)
           & (y + half_size >= box->top) & (y - half_size <= box->bottom);
}

// Which pixels of a block lie in tiles that touch the box of a path.
static INLINED LaneMask tiles_in_path_box(Tile *tile, const Box *box, int block)
{
    Lanes x = tile_middle(tile, block_x(block)), y = tile_middle(tile, block_y(block));
    LaneMask in = tiles_in_box(box, x, y, tile_half(tile));
    COUNT(tile, bounded, in);
    return in;
}

// Least and greatest t in [0, 1] at which a + (b - a) t <= 0, given slack for rounding; low > high
// where there is none.
static INLINED void below_zero(Lanes a, Lanes b, Lanes *low, Lanes *high)
{
    Lanes cross = a / (a - b);
    LaneMask starts = a <= 0.0f, ends = b <= 0.0f;
    *low = lanes_max(*low, starts ? (Lanes)(0.0f) : ends ? cross - 1e-5f : (Lanes)(2.0f));
    *high = lanes_min(*high, ends ? (Lanes)(1.0f) : starts ? cross + 1e-5f : (Lanes)(-1.0f));
}

#endif
