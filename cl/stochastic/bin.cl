// Stage "bin": which paths may touch which tile. A path's motion is cut into sixteen parts in time,
// and in each the box of its vertices' ways bounds it on screen.
//
// Paths are counted, then filed, in chunks; a tile's paths come chunk by chunk and so in the order
// given, in any run and on any number of threads.
#include "shared/effects.h"
#include "shared/lanes.h"
#include "shared/records.h"
#include "shared/shear.h"

#pragma OPENCL FP_CONTRACT OFF

// Bounds on screen in each part, in pixels from the first of the grid; everywhere where they reach
// behind the eye.
typedef struct {
    Lanes left, right, top, bottom;
} Boxes;

// What is filed.
typedef struct {
    global const Vertex *vertices;
    global const Path *paths;
    global const Bounds *bounds; // of the paths
    global const Mesh *meshes;
    global const Camera *cameras;
    global const uint *order;    // the paths', from near to far
} Filed;

static Boxes boxes_of(const Filed *filed, Path path, ListGrid grid)
{
    const uint corner[3] = {path.a, path.b, path.c};
#if GLOSSY()
    Shear shear = load_shear(filed->cameras, filed->meshes + path.mesh, path);
#endif
    Boxes boxes = {INFINITY, -INFINITY, INFINITY, -INFINITY};
    LaneMask behind = 0;
    for (int i = 0; i < 3; i++) {
        Vertex q = filed->vertices[corner[i]], r = filed->vertices[corner[i] + path.step];
        double size = exp2(-floor(log2(fmax(fmax(fabs(q.w), fabs(r.w)), 1e-37))));
        float x = (float)(size * (q.x - grid.x * q.w)), y = (float)(size * (q.y - grid.y * q.w));
        float dx = (float)(size * (r.x - grid.x * r.w)) - x;
        float dy = (float)(size * (r.y - grid.y * r.w)) - y;
        float w = (float)(size * q.w), dw = (float)(size * r.w) - w;
        float slack = 0x1p-18f * (fabs(x) + fabs(dx) + fabs(y) + fabs(dy));
        float circle = 0.0f;
#if LENS()
        circle = (float)(size * fmax(fabs(q.circle), fabs(r.circle))) * (1.0f + 1e-6f);
#endif
#if GLOSSY()
        Added first = added_by_shear(&shear, 0, q, size, grid.x, grid.y);
        Added last = added_by_shear(&shear, 1, r, size, grid.x, grid.y);
#endif
        for (int end = 0; end < 2; end++) {
            Lanes t = (LANE_INDEX + (float)end) * (1.0f / LANES);
            Lanes now = w + t * dw, over = 1.0f / now, blur = (circle + slack) * over + 1e-3f;
            Lanes px = (x + t * dx) * over, py = (y + t * dy) * over, blur_y = blur;
            behind |= !(now > 1e-6f);
#if GLOSSY()
            if (shear.any) {
                Spread spread = spread_over_time(&first, &last, t, px, py, now);
                behind |= !(spread.least > 1e-6f);
                blur = (circle + slack) / spread.least + 1e-3f;
                blur_y = blur + spread.down, blur += spread.across;
            }
#endif
            boxes.left = lanes_min(boxes.left, px - blur),
            boxes.right = lanes_max(boxes.right, px + blur);
            boxes.top = lanes_min(boxes.top, py - blur_y),
            boxes.bottom = lanes_max(boxes.bottom, py + blur_y);
        }
    }
    boxes.left = behind ? (Lanes)(-INFINITY) : boxes.left;
    boxes.right = behind ? (Lanes)(INFINITY) : boxes.right;
    boxes.top = behind ? (Lanes)(-INFINITY) : boxes.top;
    boxes.bottom = behind ? (Lanes)(INFINITY) : boxes.bottom;
    return boxes;
}

// Count (entries == 0) or file one chunk. `place` has one number per tile for this chunk.
static void bin_chunk(const Filed *filed, ListGrid grid, uint chunk, global uint *place,
                      global uint *entries)
{
    uint begin = chunk * grid.chunk, end = min(begin + grid.chunk, grid.paths);
    // A pixel's samples lie from x_low to x_high of it: a tile's to size - 1 + x_high.
    float size = grid.size, right_of = size - 1 + grid.x_high, below = size - 1 + grid.y_high;
    for (uint i = begin; i < end; i++) {
        uint path = filed->order[i];
        if (filed->bounds[path].flags & BOUNDS_CULLED) continue;
        Boxes boxes = boxes_of(filed, filed->paths[path], grid);
        float top = ceil((lanes_least(boxes.top) - below) / size);
        float bottom = floor((-lanes_least(-boxes.bottom) - grid.y_low) / size);
        int first = (int)fmin(fmax(top, 0.0f), (float)grid.rows);
        int last = (int)fmax(fmin(bottom, grid.rows - 1.0f), -1.0f);
        for (int row = first; row <= last; row++) {
            LaneMask in = (boxes.top <= row * size + below)
                & (boxes.bottom >= row * size + grid.y_low);
            float left = ceil((lanes_least(in ? boxes.left : (Lanes)(INFINITY)) - right_of) / size);
            float right = -lanes_least(in ? -boxes.right : (Lanes)(INFINITY));
            right = floor((right - grid.x_low) / size);
            int from = (int)fmin(fmax(left, 0.0f), (float)grid.columns);
            int to = (int)fmax(fmin(right, grid.columns - 1.0f), -1.0f);
            for (int column = from; column <= to; column++) {
                uint at = place[row * grid.columns + column]++;
                if (entries != 0) entries[at] = path;
            }
        }
    }
}

kernel void bin_count(global const Vertex *vertices, global const Path *paths,
                      global const Bounds *bounds, global const Mesh *meshes,
                      global const Camera *cameras, global const uint *order, ListGrid grid,
                      global uint *counts)
{
    uint tiles = grid.columns * grid.rows;
    global uint *place = counts + (size_t)get_global_id(0) * tiles;
    for (uint i = 0; i < tiles; i++) place[i] = 0;
    Filed filed = {vertices, paths, bounds, meshes, cameras, order};
    bin_chunk(&filed, grid, get_global_id(0), place, 0);
}

kernel void bin_file(global const Vertex *vertices, global const Path *paths,
                     global const Bounds *bounds, global const Mesh *meshes,
                     global const Camera *cameras, global const uint *order, ListGrid grid,
                     global uint *counts, global uint *members)
{
    uint tiles = grid.columns * grid.rows;
    Filed filed = {vertices, paths, bounds, meshes, cameras, order};
    bin_chunk(&filed, grid, get_global_id(0), counts + (size_t)get_global_id(0) * tiles, members);
}
