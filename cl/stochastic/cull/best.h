// Culling method "best": what is fastest on a CPU. In each slab the samples come from a short
// stretch of time and a part of the lens: the box of the vertices' ways in it, found for sixteen
// slabs at once, says which blocks of 4 x 4 pixels to test. Paths come from near to far, and what
// lies behind all that a tile, a slab or a block has seen so far is left out (Akenine-Moeller et
// al. 2007, 3.4).
//
// Operations: slab 158 (218), block 1.
#include "shared/effects.h"
#include "stochastic/test.h"

// For sixteen slabs: blocks that the triangle may touch, and the least depth that it may have.
typedef struct {
    int left[LANES], right[LANES], top[LANES], bottom[LANES], touched[LANES];
    float near[LANES];
} Touched;

// Least and greatest place on screen of a vertex at one time and anywhere on a part of the lens.
static INLINED void widen(Lanes place, Lanes blur_low, Lanes blur_high, Lanes slack, Lanes *low,
                          Lanes *high)
{
    *low = lanes_min(*low, place + blur_low - slack);
    *high = lanes_max(*high, place + blur_high + slack);
}

static void touched_by(const Tile *tile, const Moving *m, int first, Touched *out)
{
    Lanes t_low = lanes_load(tile->t_low + first), t_high = lanes_load(tile->t_high + first);
    LaneMask seen = (t_high >= m->open) & (t_low <= m->close) & (t_low <= t_high);
    Lanes left = INFINITY, right = -INFINITY, top = INFINITY, bottom = -INFINITY, near = INFINITY;
    for (int end = 0; end < 2; end++) {
        Lanes tau = time_in_segment(m, end ? t_high : t_low);
        tau = lanes_min(lanes_max(tau, (Lanes)(0.0f)), (Lanes)(1.0f));
        for (int i = 0; i < 3; i++) {
            Lanes w = m->w[i] + tau * m->dw[i], over = 1.0f / w, slack = m->slack * over + 1e-3f;
            Lanes x = (m->x[i] + tau * m->dx[i]) * over, y = (m->y[i] + tau * m->dy[i]) * over;
            Lanes slack_y = slack;
#if GLOSSY()
            if (m->sheared) {
                Spread spread = spread_over_time(m->first + i, m->last + i, tau, x, y, w);
                slack = m->slack / spread.least + 1e-3f;
#if LENS()
                slack += fabs(m->c[i] + tau * m->dc[i]) / spread.least;
#endif
                slack_y = slack + spread.down, slack += spread.across, w = spread.least;
            }
#endif
            near = lanes_min(near, w);
#if LENS()
            Lanes circle = (m->c[i] + tau * m->dc[i]) * over;
            Lanes a = circle * lanes_load(tile->u_low + first);
            Lanes b = circle * lanes_load(tile->u_high + first);
            widen(x, lanes_min(a, b), lanes_max(a, b), slack, &left, &right);
            a = circle * lanes_load(tile->v_low + first),
            b = circle * lanes_load(tile->v_high + first);
            widen(y, lanes_min(a, b), lanes_max(a, b), slack_y, &top, &bottom);
#else
            widen(x, (Lanes)(0.0f), (Lanes)(0.0f), slack, &left, &right);
            widen(y, (Lanes)(0.0f), (Lanes)(0.0f), slack_y, &top, &bottom);
#endif
        }
    }
    // Behind the eye the way of a vertex is not between its ends: then it may be anywhere.
    LaneMask ahead = near > 4.0f * m->slack / (2.0f * HALF);
    near = ahead ? near * (m->size * (1.0f - 1e-5f)) : (Lanes)(0.0f);
    seen &= near <= lanes_load(tile->far + first);
    // Block b holds samples from 4 b - HALF + reach_low to 4 b + 3 - HALF + reach_high.
    const Lanes below = -1.0f, above = (float)(TILE / BLOCK);
    float low = HALF - tile->reach_low, high = HALF - (BLOCK - 1) - tile->reach_high;
    left = ahead ? ceil((left + high) * (1.0f / BLOCK)) : (Lanes)(0.0f);
    top = ahead ? ceil((top + high) * (1.0f / BLOCK)) : (Lanes)(0.0f);
    right = ahead ? floor((right + low) * (1.0f / BLOCK)) : above;
    bottom = ahead ? floor((bottom + low) * (1.0f / BLOCK)) : above;
    seen &= (left < above) & (top < above) & (right > below) & (bottom > below);
    const Lanes zero = 0.0f, three = (float)(TILE / BLOCK - 1);
    lanes_store(to_lane_ints(lanes_max(left, zero)), out->left);
    lanes_store(to_lane_ints(lanes_max(top, zero)), out->top);
    lanes_store(to_lane_ints(lanes_min(right, three)), out->right);
    lanes_store(to_lane_ints(lanes_min(bottom, three)), out->bottom);
    lanes_store(seen, out->touched);
    lanes_store(near, out->near);
}

// Test the blocks of one slab that the triangle may touch, but those of which all is nearer.
static void test_slab(Tile *tile, const Moving *m, int slab, const Touched *touched, int lane)
{
    for (int row = touched->top[lane]; row <= touched->bottom[lane]; row++)
        for (int column = touched->left[lane]; column <= touched->right[lane]; column++) {
            int block = row * (TILE / BLOCK) + column;
            if (touched->near[lane] > tile->block_far[slab * BLOCKS + block]) continue;
            test_samples(tile, m, slab, block, (LaneMask)(-1), false);
        }
}

#define PATHS_BETWEEN_UPDATES 8

// Bring the slabs' greatest depths up to date; returns the tile's.
static float update_far(Tile *tile)
{
    float far = 0.0f;
    for (int slab = 0; slab < tile->slabs; slab++) {
        tile->far[slab] = lanes_greatest(lanes_load(tile->block_far + slab * BLOCKS));
        far = fmax(far, tile->far[slab]);
    }
    return far;
}

static void sample(Tile *tile)
{
    float far = INFINITY;
    Touched touched;
    for (uint k = 0; k < tile->member_count; k++) {
        if (k % PATHS_BETWEEN_UPDATES == 0) far = update_far(tile);
        if (tile->bounds[tile->members[k]].near > far) return; // the rest is farther
        if (!is_sampled_now(tile, tile->members[k])) continue;
        Moving m = load_moving(tile, tile->members[k]);
        for (int first = 0; first < tile->slabs; first += LANES) {
            touched_by(tile, &m, first, &touched);
            for (int lane = 0; lane < LANES; lane++)
                if (touched.touched[lane]) test_slab(tile, &m, first + lane, &touched, lane);
        }
    }
}
