// Normals of flat triangles: those of meshes that have none at their vertices.
//
// Vertices move linearly in the world from one end of a motion segment to the other, so with edges
// u and v the normal is their cross product at the moment: a quadratic in time, whose Bernstein
// coefficients are u0 x v0, (u0 x v1 + u1 x v0) / 2 and u1 x v1. FACES_TURN says that some face
// does more than shift; else the unit normals at both ends are equal, and blended.
#ifndef MB_FLAT_NORMALS_H
#define MB_FLAT_NORMALS_H

#include "shared/effects.h"
#include "shared/records.h"

// A triangle's vertices, and the camera's pose, at one end of a motion segment.
typedef struct {
    global const Vertex *corner[3];
    global const Camera *camera;
} FaceEnd;

// Two edges in the world, and their cross product.
typedef struct {
    double3 u, v, normal;
} FaceEdges;

static FaceEdges face_edges(FaceEnd end)
{
    global const double *m = end.camera->inverse;
    double3 p[3];
    for (int i = 0; i < 3; i++) {
        Vertex q = *end.corner[i];
        p[i] = (double3)(m[0] * q.x + m[1] * q.y + m[2] * q.w, m[3] * q.x + m[4] * q.y + m[5] * q.w,
                         m[6] * q.x + m[7] * q.y + m[8] * q.w);
    }
    FaceEdges edges = {p[1] - p[0], p[2] - p[0]};
    edges.normal = cross(edges.u, edges.v);
    return edges;
}

#if FACES_TURN()

// Bernstein coefficients of the normal over the segment; the longest of them has length 1.
static void flat_normals(FaceEnd start, FaceEnd end, double3 *n)
{
    FaceEdges first = face_edges(start), last = face_edges(end);
    n[0] = first.normal, n[2] = last.normal;
    n[1] = 0.5 * (cross(first.u, last.v) + cross(last.u, first.v));
    double size = sqrt(fmax(fmax(dot(n[0], n[0]), dot(n[1], n[1])), dot(n[2], n[2])));
    for (int k = 0; k < 3 && size > 0.0; k++) n[k] /= size;
}

#endif

// Unit normal at one end.
static float3 flat_normal(FaceEnd end)
{
    double3 n = face_edges(end).normal;
    double size = sqrt(dot(n, n));
    return convert_float3(size > 0.0 ? n / size : n);
}

#endif
