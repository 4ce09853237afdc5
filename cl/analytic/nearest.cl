// Stage "nearest": what does not move needs no time. A z-buffer keeps, for each sample, the nearest
// static surface; it bounds the depth of everything that moves.
//
// The edge functions are those of a moving triangle, constant in time, and so is what they say of a
// sample that lies on one.
#include "analytic/gather.h"

// Depth at one sample, or infinity where the triangle does not cover it, whatever the case.
static double static_depth_at(const Gather *g, Place place)
{
    double e = 0.0, d = 0.0;
    int positive = 0;
    for (int i = 0; i < 3; i++) {
        double b[3], exact[3];
        perturbed_edge_function(&g->triangle, i, place, b);
        edge_function(&g->triangle, i, place, exact);
        positive |= (b[0] > 0.0) << i;
        e += exact[0], d += exact[0] * g->triangle.w[i];
    }
    bool covered = (positive == 7 && !g->single_sided) || positive == 0;
    double w = d / e;
    return covered && w > 0.0 && w < INFINITY ? w : INFINITY;
}

// Depth at the samples at hand, into the z-buffer; ties go to the path that comes first.
static void nearest_of_gathered(Tile *tile, const Gather *g)
{
    const MovingTriangle *m = &g->triangle;
    Wide px[3], py[3], e[3];
    for (int i = 0; i < 3; i++) px[i] = gathered_x(g, i), py[i] = gathered_y(g, i);
    for (int i = 0; i < 3; i++) {
        int p = edge_first(m, i), q = edge_second(m, i);
        double sign = (m->reversed >> i & 1u) ? -1.0 : 1.0;
        e[i] = sign * fma(px[p], py[q], -(px[q] * py[p]));
    }
    WideMask front = (e[0] < 0.0) & (e[1] < 0.0) & (e[2] < 0.0);
    WideMask back = (e[0] > 0.0) & (e[1] > 0.0) & (e[2] > 0.0);
    WideMask zero = (e[0] == 0.0) | (e[1] == 0.0) | (e[2] == 0.0);
    if (!g->single_sided) front |= back;
    Wide w = (e[0] * m->w[0] + e[1] * m->w[1] + e[2] * m->w[2]) / (e[0] + e[1] + e[2]);
    w = (front & (w > 0.0)) ? w : (Wide)(INFINITY);
    double depth[WIDE];
    long is_zero[WIDE];
    vstore8(w, 0, depth);
    vstore8(zero, 0, is_zero);
    for (int i = 0; i < g->waiting; i++) {
        int sample = g->samples[i];
        double here = is_zero[i] ? static_depth_at(g, gathered_place(g, i)) : depth[i];
        bool first = here < INFINITY && here == tile->static_depth[sample]
                     && g->index < tile->static_part[sample] >> PART_BITS;
        if (!(here < tile->static_depth[sample]) && !first) continue;
        tile->static_depth[sample] = here;
        tile->static_part[sample] = g->index << PART_BITS;
    }
}

// Depth that no surface of the piece lies behind.
static double farthest_surface(const Tile *tile)
{
    Wide far = 0.0;
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i += WIDE)
        far = wide_max(far, vload8(0, tile->static_depth + i));
    double depth[WIDE], most = 0.0;
    vstore8(far, 0, depth);
    for (int i = 0; i < WIDE; i++) most = fmax(most, depth[i]);
    return most;
}

#define PATHS_BETWEEN 8 // paths after which the farthest surface is looked for again

// Nearest static surface of every sample of the piece: paths come from near to far, and end where
// all that follow lie behind. Always true: a z-buffer cannot run full.
static bool nearest(Tile *tile)
{
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++)
        tile->static_depth[i] = INFINITY;
    Gather g;
    clear_gather(&g);
    double far = INFINITY;
    for (uint k = 0; k < tile->static_count; k++) {
        if (k % PATHS_BETWEEN == 0) far = farthest_surface(tile);
        if (tile->shapes[tile->members[k]].near > far) break;
        fetch_ahead(tile, k);
        begin_gather(tile, tile->members[k], &g);
        while (gather_samples(tile, &g)) {
            count_tested(tile, &g);
            nearest_of_gathered(tile, &g);
        }
    }
    return true;
}
