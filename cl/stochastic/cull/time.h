// The time that a moving triangle spends in the frame, even partially (Laine et al. 2011, 3.2):
// within the sides of the frame and before the eye.
#ifndef MB_CULL_TIME_H
#define MB_CULL_TIME_H

#include "stochastic/cull/box.h"

// Narrow [low, high] to the time in which any corner may lie inside of the plane a x + b y + c w >=
// 0: the greatest value of any corner lies under the line between those at the ends.
static void trim_by_plane(const Moving *m, float a, float b, float c, float *low, float *high)
{
    float most[2] = {-INFINITY, -INFINITY};
    for (int k = 0; k < 6; k++) {
        int i = k % 3;
        float t = k / 3, x = m->x[i] + t * m->dx[i], y = m->y[i] + t * m->dy[i];
        float w = m->w[i] + t * m->dw[i], side = a * x + b * y + c * w;
        side += 2.0f * m->slack + 1e-6f * fabs(c * w);
        most[k / 3] = fmax(most[k / 3], out_by_lens(side, m, i, t, fabs(a) + fabs(b)));
    }
    if (most[0] < 0.0f && most[1] < 0.0f) *high = -1.0f;
    float cross = most[0] / (most[0] - most[1]);
    if (most[0] < 0.0f) *low = fmax(*low, cross - 1e-5f);
    if (most[1] < 0.0f) *high = fmin(*high, cross + 1e-5f);
}

static bool trim_to_frame(const Tile *tile, const Moving *m, float *low, float *high)
{
    *low = 0.0f, *high = 1.0f;
    trim_by_plane(m, 1.0f, 0.0f, -tile->frame.left, low, high);
    trim_by_plane(m, -1.0f, 0.0f, tile->frame.right, low, high);
    trim_by_plane(m, 0.0f, 1.0f, -tile->frame.top, low, high);
    trim_by_plane(m, 0.0f, -1.0f, tile->frame.bottom, low, high);
    trim_by_plane(m, 0.0f, 0.0f, 1.0f, low, high);
    return *low <= *high;
}

#endif
