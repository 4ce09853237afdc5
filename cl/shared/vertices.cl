// Vertices in homogeneous pixel space at the ends of every motion segment.
#include "shared/effects.h"
#include "shared/records.h"

#pragma OPENCL FP_CONTRACT OFF

#if LENS()
// Circle of confusion at depth w, in pixels, times w: affine in w for a thin lens. In the extended
// range in focus it is zero, and beyond continuous; before the focus it is limited (Wu et al. 2015,
// 3.4; Munkberg et al. 2012). Behind the eye it goes on as next to it, so that an edge through the
// eye's plane has before it what its points have. Meshes are cut where this bends
// (mbinterval/exposure/limits.py has it too).
static double lens_circle(const Camera *camera, double w)
{
    double scale = camera->aperture;
    double circle = scale * (w / camera->focus - 1.0);
    double near = scale * (camera->sharp_near / camera->focus - 1.0);
    double far = scale * (camera->sharp_far / camera->focus - 1.0);
    circle -= clamp(circle, near, far);
    return isinf(camera->foreground) ? circle : fmax(circle, -camera->foreground * w);
}
#endif

// World positions to homogeneous pixel space, relative to the eye before anything is rounded.
kernel void vertices(global const VertexJob *jobs, global const double *positions,
                     global const Camera *cameras, global Vertex *vertices)
{
    VertexJob job = jobs[get_global_id(0)];
    Camera camera = cameras[job.camera];
    const double *m = camera.matrix;
    for (uint i = 0; i < job.count; i++) {
        global const double *p = positions + 3 * ((size_t)job.input + i);
        double x = p[0] - camera.eye[0], y = p[1] - camera.eye[1], z = p[2] - camera.eye[2];
        Vertex v = {m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z,
                    m[6] * x + m[7] * y + m[8] * z, 0.0};
#if LENS()
        v.circle = lens_circle(&camera, v.w);
#endif
        vertices[job.output + i] = v;
    }
}
