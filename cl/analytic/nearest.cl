// Stage "nearest": what does not move needs no time. A plain z-buffer keeps, for each sample, the
// nearest static surface; it bounds the depth of everything that moves.
#include "analytic/walk.h"

// Corners of a static triangle as float pairs.
typedef struct {
    float x[3], y[3], w[3], x_low[3], y_low[3], w_low[3];
} Triangle;

static void load_triangle(global const Vertex *vertices, Path path, float scale, Triangle *triangle)
{
    uint corner[3] = {path.a, path.b, path.c};
    for (int i = 0; i < 3; i++) {
        Vertex v = vertices[corner[i]];
        double x = scale * v.x, y = scale * v.y, w = scale * v.w;
        triangle->x[i] = (float)x, triangle->x_low[i] = (float)(x - triangle->x[i]);
        triangle->y[i] = (float)y, triangle->y_low[i] = (float)(y - triangle->y[i]);
        triangle->w[i] = (float)w, triangle->w_low[i] = (float)(w - triangle->w[i]);
    }
}

static void nearest_in_samples(Tile *tile, const Triangle *triangle, uint path_index, float w_scale,
                               const float *y, int row, int column, int count)
{
    // The corner alone on its side of the row, and the two edges from it, which meet the row.
    bool below0 = y[0] < 0.0f, below1 = y[1] < 0.0f, below2 = y[2] < 0.0f;
    int i = below0 == below1 ? 2 : below0 == below2 ? 1 : 0, j = (i + 1) % 3, k = (i + 2) % 3;
    Lanes sample = convert_float16((int)(tile->x + column) + convert_int16(LANE_INDEX))
                   + tile->scene.offsets[tile->layer + row / TILE].x;
    Lanes x[3];
    for (int c = 0; c < 3; c++)
        x[c] = lanes_shift(triangle->x[c], triangle->x_low[c], sample, triangle->w[c],
                           triangle->w_low[c]);
    float yi = fabs(y[i]), yj = fabs(y[j]), yk = fabs(y[k]);
    Lanes a = x[i] * yj + x[j] * yi, b = x[i] * yk + x[k] * yi;
    LaneMask inside = (a > 0.0f) ^ (b > 0.0f);
    Lanes to_a = fabs(b), to_b = fabs(a);
    Lanes w = ((triangle->w[i] * yj + triangle->w[j] * yi) * to_a
               + (triangle->w[i] * yk + triangle->w[k] * yi) * to_b)
              / ((yi + yj) * to_a + (yi + yk) * to_b);
    inside &= w > 0.0f;
    if (!any(inside)) return;
    float ws[LANES];
    int hit[LANES];
    vstore16(w * w_scale, 0, ws);
    vstore16(inside, 0, hit);
    int first = row * TILE + column;
    for (int c = 0; c < count; c++)
        if (hit[c] && ws[c] < tile->static_depth[first + c]) {
            tile->static_depth[first + c] = ws[c];
            tile->static_part[first + c] = path_index << PART_BITS;
        }
}

static void nearest_in_rows(Tile *tile, const Triangle *triangle, uint path_index, int first_row)
{
    int first[LANES], last[LANES];
    global const Shape *shape = tile->scene.shapes + path_index;
    if (!walk_rows(tile, shape, first_row, first, last)) return;
    for (int i = 0; i < min(LANES, TILE - first_row % TILE); i++) {
        if (first[i] > last[i]) continue;
        int row = first_row + i;
        float y[3], sample = sample_y(tile, row);
        for (int c = 0; c < 3; c++)
            y[c] = fma(-sample, triangle->w[c], triangle->y[c])
                   + fma(-sample, triangle->w_low[c], triangle->y_low[c]);
        if ((y[0] < 0.0f) == (y[1] < 0.0f) && (y[1] < 0.0f) == (y[2] < 0.0f)) continue;
        for (int column = first[i]; column <= last[i]; column += LANES)
            nearest_in_samples(tile, triangle, path_index, 1.0f / shape->scale, y, row, column,
                               min(LANES, last[i] + 1 - column));
    }
}

// Nearest static surface of every sample of the piece; ties go to the path that comes first.
// Always true: a z-buffer cannot run full.
static bool nearest(Tile *tile)
{
    for (int i = tile->row_low * TILE; i < tile->row_high * TILE; i++)
        tile->static_depth[i] = INFINITY;
    for (uint k = 0; k < tile->static_count; k++) {
        uint path_index = tile->members[k];
        Triangle triangle;
        load_triangle(tile->scene.vertices, tile->scene.paths[path_index],
                      tile->scene.shapes[path_index].scale, &triangle);
        for (int row = 0; row < ROWS; row += min(LANES, TILE))
            if (row + LANES > tile->row_low && row < tile->row_high)
                nearest_in_rows(tile, &triangle, path_index, row);
    }
    return true;
}
