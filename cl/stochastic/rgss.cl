// Stage "rgss": a pixel's four samples and the nearest one of each of its four neighbours, weighed
// 5/32 and 3/32 (Akenine-Moeller et al. 2007, 3.2, Equation 1).
#include "stochastic/resolve.cl"

// Sample of the pixel at (x, y) that lies nearest to its neighbour at (x + dx, y + dy): the one in
// the column or row next to it. scatter.cl puts sample l of that pixel at place l ^ (x & 1 | (y &
// 1) << 1) of the rotated grid, whose places have the columns 1, 3, 0, 2 and the rows 0, 1, 2, 3.
static int nearest_sample(int x, int y, int dx, int dy)
{
    int place = dx < 0 ? 2 : dx > 0 ? 1 : dy < 0 ? 0 : 3;
    return place ^ (x & 1 | (y & 1) << 1);
}

// `kept` is one pixel wider on each side than the film.
kernel void rgss(global const float4 *colors, global const float *depths,
                 global const uint *kept_seen,
                 global const float *background, global float4 *rgba, global float *depth,
                 global uint *seen, Frame frame)
{
    const int steps[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
    int y = get_global_id(0), wide = frame.width + 2;
    for (int x = 0; x < frame.width; x++) {
        size_t kept = (size_t)(y + 1) * wide + (x + 1), out = (size_t)y * frame.width + x;
        float4 own = 0.0f, others = 0.0f;
        float own_depth = 0.0f, other_depth = 0.0f;
        for (int l = 0; l < 4; l++) own += colors[4 * kept + l], own_depth += depths[4 * kept + l];
        for (int k = 0; k < 4; k++) {
            int dx = steps[k][0], dy = steps[k][1];
            size_t next = kept + dy * wide + dx;
            int l = nearest_sample(frame.x + x + dx, frame.y + y + dy, -dx, -dy);
            others += colors[4 * next + l], other_depth += depths[4 * next + l];
        }
        float4 color = (5.0f / 32.0f) * own + (3.0f / 32.0f) * others;
        float far = (5.0f / 32.0f) * own_depth + (3.0f / 32.0f) * other_depth;
        depth[out] = color.w > 0.0f ? far / color.w : INFINITY;
        rgba[out] = over_background(color, kept, frame, background);
        seen[out] = kept_seen[kept];
    }
}
