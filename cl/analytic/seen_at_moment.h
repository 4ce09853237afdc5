// What the centre of a pixel sees at the moment of the layers: the triangle as it is then, and its
// normal, texture coordinates and optical flow there.
#ifndef MB_SEEN_AT_MOMENT_H
#define MB_SEEN_AT_MOMENT_H

#include "shared/effects.h"
#include "analytic/line_window.h"
#include "analytic/edges.h"
#include "shared/attributes.h"

static inline Place centre_of(const Tile *tile, int x, int y)
{
    Place place = {tile->x + x + 0.5f, tile->y + y + 0.5f, 0.0f, 0.0f};
    return place;
}

static inline float moment_at(const Tile *tile, int x, int y)
{
    return moment_in(tile, line_window(&tile->scene, tile->x + x, tile->y + y));
}

// Time within the path's motion segment; 0 where nothing moves.
static inline double local_moment(Path path, float t)
{
    return path.step == 0 ? 0.0 : ((double)t - path.open) / path_length(path);
}

// The triangle as it is at `tau`, at both ends. The same bits for each vertex of neighbours.
static void freeze_triangle(const MovingTriangle *m, double tau, MovingTriangle *frozen)
{
    frozen->reversed = m->reversed;
    for (int i = 0; i < 3; i++) {
        frozen->x[i] = frozen->x[i + 3] = m->x[i] + tau * (m->x[i + 3] - m->x[i]);
        frozen->y[i] = frozen->y[i + 3] = m->y[i] + tau * (m->y[i + 3] - m->y[i]);
        frozen->w[i] = frozen->w[i + 3] = m->w[i] + tau * (m->w[i + 3] - m->w[i]);
#if LENS()
        frozen->circle[i] = frozen->circle[i + 3] = 0.0;
#endif
    }
}

// What a pixel's centre sees: a path at a time within its motion segment, and the shares of its
// three vertices, which are those in the world.
typedef struct {
    Shaded shaded;
    double tau, depth;
    double share[3];
} Seen;

static Seen see_again(const Tile *tile, int x, int y)
{
    int pixel = y * TILE + x;
    uint index = tile->static_part[pixel] >> PART_BITS;
    Place place = centre_of(tile, x, y);
    Seen seen = {.shaded = load_shaded(&tile->scene, index), .depth = tile->static_depth[pixel]};
    Shaded *s = &seen.shaded;
    seen.tau = local_moment(s->path, moment_at(tile, x, y));
    MovingTriangle moving, frozen;
    load_moving(tile->scene.vertices, s->path, tile->shapes[index].flags, &moving);
    freeze_triangle(&moving, seen.tau, &frozen);
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        double b[3];
        edge_function(&frozen, i, place, b);
        seen.share[i] = b[0], sum += b[0];
    }
    for (int i = 0; i < 3; i++) seen.share[i] = sum != 0.0 ? seen.share[i] / sum : 1.0 / 3.0;
    return seen;
}

// Vertex i's attribute, at both ends of the segment, as it counts at the moment.
static inline double2 corner_weights(const Seen *seen, int i)
{
    return seen->share[i] * (double2)(1.0 - seen->tau, seen->tau);
}

#if AOV_NORMAL()
// Normal of a mesh that has none.
static INLINED double3 flat_normal_of(const Scene *scene, const Seen *seen)
{
    const Shaded *s = &seen->shaded;
    const FaceEnd start = face_end(scene, s, 0), end = face_end(scene, s, 1);
    const double tau = seen->tau, rest = 1.0 - tau;
#if FACES_TURN()
    double3 n[3];
    flat_normals(start, end, n);
    return rest * (rest * n[0] + tau * n[1]) + tau * (rest * n[1] + tau * n[2]);
#else
    return rest * convert_double3(flat_normal(start)) + tau * convert_double3(flat_normal(end));
#endif
}

// Whether the ray of a pixel's centre runs along the normal rather than against it.
static INLINED bool points_away(const Tile *tile, const Seen *seen, double3 normal, Place place)
{
    global const double *m = segment_camera(&tile->scene, &seen->shaded, 0)->inverse;
    global const double *n = segment_camera(&tile->scene, &seen->shaded, 1)->inverse;
    double ray[3];
    for (int i = 0; i < 3; i++) {
        double first = m[3 * i] * place.x + m[3 * i + 1] * place.y + m[3 * i + 2];
        double last = n[3 * i] * place.x + n[3 * i + 1] * place.y + n[3 * i + 2];
        ray[i] = first + seen->tau * (last - first);
    }
    return normal.x * ray[0] + normal.y * ray[1] + normal.z * ray[2] > 0.0;
}

// Unit normal in the world, turned to the viewer where both sides are seen, as it is for shading.
static INLINED double3 normal_of(const Tile *tile, const Seen *seen, Place place)
{
    const Scene *scene = &tile->scene;
    const Shaded *s = &seen->shaded;
    double3 normal = 0.0;
    if (s->mesh.normal == NONE)
        normal = flat_normal_of(scene, seen);
    else
        for (int i = 0; i < 6; i++) {
            uint at = attribute_index(s, s->mesh.normal, s->mesh.normal_step, i);
            double2 weights = corner_weights(seen, i % 3);
            normal += (i < 3 ? weights.x : weights.y)
                      * convert_double3(vload3(at, scene->normals));
        }
    double size = sqrt(normal.x * normal.x + normal.y * normal.y + normal.z * normal.z);
    bool turned = !(s->material.flags & MATERIAL_SINGLE_SIDED)
                  && points_away(tile, seen, normal, place);
    return size > 0.0 ? normal * ((turned ? -1.0 : 1.0) / size) : normal;
}
#endif

#if AOV_UV()
static double2 uv_of(const Tile *tile, const Seen *seen)
{
    const Shaded *s = &seen->shaded;
    double2 uv = 0.0;
    if (s->mesh.uv == NONE) return uv;
    for (int i = 0; i < 6; i++) {
        uint at = attribute_index(s, s->mesh.uv, s->mesh.uv_step, i);
        double2 weights = corner_weights(seen, i % 3);
        uv += (i < 3 ? weights.x : weights.y) * convert_double2(vload2(at, tile->scene.uvs));
    }
    return uv;
}
#endif

#if AOV_FORWARD() || AOV_BACKWARD()
// From the pixel's centre to where `places`, of the vertices in another frame, take the point.
static double2 flow_of(const Seen *seen, Place from, global const double *places)
{
    const Shaded *s = &seen->shaded;
    double3 point = 0.0;
    for (int i = 0; i < 3; i++)
        point += seen->share[i] * vload3(attribute_index(s, s->mesh.first, 0u, i), places);
    if (!(point.z > 0.0)) return (double2)(NAN);
    return (double2)(point.x / point.z - from.x, point.y / point.z - from.y);
}
#endif

#endif
