// The closed surface that a moving triangle sweeps, triangulated (Hong & Oh 2017, 4.2, Fig. 9).
//
// Corners 0 1 2 are the triangle at the segment's start, 3 4 5 at its end, 6 7 8 one point for each
// side: the mean of the side's four corners at t = 0.5, or, where the moving edge's two positions
// cross on screen, the crossing (halfway between the two edges in depth). Faces 0 and 1 are the
// caps; side s has faces 2 + 4 s ...: towards its start edge, its q edge, its end edge, its p edge.
// A crossed side has only the second and the fourth. Edges 0-2 bound the first cap, 3-5 the last,
// 6-8 join the corners in time, 9 + 4 s ... join p0, q0, q1, p1 of side s to its point.
#ifndef MB_SWEPT_SURFACE_H
#define MB_SWEPT_SURFACE_H

#include "shared/records.h"

#define CORNERS 9
#define EDGES 21
#define FACES 14

constant uchar EDGE_CORNERS[EDGES][2] = {
    {0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5},
    {0, 6}, {1, 6}, {4, 6}, {3, 6}, {1, 7}, {2, 7}, {5, 7}, {4, 7}, {2, 8}, {0, 8}, {3, 8}, {5, 8}
};

#define EDGE_BITS(a, b, c) (1 << (a) | 1 << (b) | 1 << (c))

constant int FACE_EDGES[FACES] = {
    EDGE_BITS(0, 1, 2), EDGE_BITS(3, 4, 5),
    EDGE_BITS(0, 9, 10), EDGE_BITS(7, 10, 11), EDGE_BITS(3, 11, 12), EDGE_BITS(6, 12, 9),
    EDGE_BITS(1, 13, 14), EDGE_BITS(8, 14, 15), EDGE_BITS(4, 15, 16), EDGE_BITS(7, 16, 13),
    EDGE_BITS(2, 17, 18), EDGE_BITS(6, 18, 19), EDGE_BITS(5, 19, 20), EDGE_BITS(8, 20, 17)
};

constant uchar FACE_CORNERS[FACES][3] = {
    {0, 1, 2}, {3, 4, 5}, {0, 1, 6}, {1, 4, 6}, {4, 3, 6}, {3, 0, 6},
    {1, 2, 7}, {2, 5, 7}, {5, 4, 7}, {4, 1, 7}, {2, 0, 8}, {0, 3, 8}, {3, 5, 8}, {5, 2, 8}
};

constant float CORNER_TIME[CORNERS] = {0.0f, 0.0f, 0.0f, 1.0f, 1.0f, 1.0f, 0.5f, 0.5f, 0.5f};

// Coordinates are float pairs: value = high + low.
typedef struct {
    float x[CORNERS], y[CORNERS], w[CORNERS];
    float x_low[CORNERS], y_low[CORNERS], w_low[CORNERS];
    uint crossed;         // bit per side
    float place[3][2];    // crossed sides: where the start edge and the end edge cross
    float along[3][4];    // crossed sides: length of edges 9 + 4 s ... over that of the edge that
                          // they are a part of
} Surface;

static INLINED double3 corner_position(const Surface *s, int i)
{
    return (double3)((double)s->x[i] + s->x_low[i], (double)s->y[i] + s->y_low[i],
                     (double)s->w[i] + s->w_low[i]);
}

static INLINED void set_corner(Surface *s, int i, double3 p)
{
    s->x[i] = (float)p.x, s->y[i] = (float)p.y, s->w[i] = (float)p.z;
    s->x_low[i] = (float)(p.x - s->x[i]), s->y_low[i] = (float)(p.y - s->y[i]);
    s->w_low[i] = (float)(p.z - s->w[i]);
}

// The point of side s, and for a crossed side what part of each edge leads to it. The edge's two
// corners are taken in order of position, so that both faces at an edge find the same bits.
static void set_side_point(Surface *surface, global const Shape *shape, int s)
{
    bool reversed = shape->flags / SHAPE_REVERSED >> s & 1u;
    int p = reversed ? (s + 1) % 3 : s, q = reversed ? s : (s + 1) % 3;
    double3 p0 = corner_position(surface, p), q0 = corner_position(surface, q);
    double3 p1 = corner_position(surface, p + 3), q1 = corner_position(surface, q + 3);
    if (!(surface->crossed >> s & 1u)) {
        set_corner(surface, 6 + s, 0.25 * ((p0 + q0) + (p1 + q1)));
        return;
    }
    double on_start = shape->crossing[2 * s], on_end = shape->crossing[2 * s + 1];
    double3 start = p0 + on_start * (q0 - p0), end = p1 + on_end * (q1 - p1);
    set_corner(surface, 6 + s, 0.5 * (start + end));
    double up = 0.5 * (1.0 + end.z / start.z), down = 0.5 * (1.0 + start.z / end.z);
    float at_p0 = (float)(up * on_start), at_q0 = (float)(up * (1.0 - on_start));
    float at_p1 = (float)(down * on_end), at_q1 = (float)(down * (1.0 - on_end));
    surface->along[s][0] = reversed ? at_q0 : at_p0;
    surface->along[s][1] = reversed ? at_p0 : at_q0;
    surface->along[s][2] = reversed ? at_p1 : at_q1;
    surface->along[s][3] = reversed ? at_q1 : at_p1;
    surface->place[s][0] = (float)(reversed ? 1.0 - on_start : on_start);
    surface->place[s][1] = (float)(reversed ? 1.0 - on_end : on_end);
}

static void load_surface(global const Vertex *vertices, Path path, global const Shape *shape,
                         Surface *surface)
{
    uint corner[3] = {path.a, path.b, path.c};
    for (int i = 0; i < 6; i++) {
        Vertex v = vertices[corner[i % 3] + (i < 3 ? 0u : path.step)];
        set_corner(surface, i, shape->scale * (double3)(v.x, v.y, v.w));
    }
    surface->crossed = shape->flags / SHAPE_CROSSED & 7u;
    for (int s = 0; s < 3; s++) set_side_point(surface, shape, s);
}

// Edges at each corner.
constant int CORNER_EDGES[CORNERS] = {
    1 << 0 | 1 << 2 | 1 << 6 | 1 << 9 | 1 << 18, 1 << 0 | 1 << 1 | 1 << 7 | 1 << 10 | 1 << 13,
    1 << 1 | 1 << 2 | 1 << 8 | 1 << 14 | 1 << 17, 1 << 3 | 1 << 5 | 1 << 6 | 1 << 12 | 1 << 19,
    1 << 3 | 1 << 4 | 1 << 7 | 1 << 11 | 1 << 16, 1 << 4 | 1 << 5 | 1 << 8 | 1 << 15 | 1 << 20,
    15 << 9, 15 << 13, 15 << 17
};

// Edges with one corner below a row and one not, from the bits of the corners below it.
static int crossing_edges(int below)
{
    int edges = 0;
    for (int i = 0; i < CORNERS; i++) edges ^= -(below >> i & 1) & CORNER_EDGES[i];
    return edges;
}

#endif
