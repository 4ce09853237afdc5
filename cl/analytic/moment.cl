// Stage "moment": what the centre of each pixel sees at one moment of the shutter, through the
// middle of the lens: depth, normal, texture coordinates, where it goes, and which mesh it is.
//
// Most patterns have no sample at the centre, and a sample more would be solved over the whole
// shutter for one moment of it. So the triangles of all motion paths are frozen at the moment, and
// the z-buffer of what does not move ("nearest") takes them too. It comes last: that is free then.
#include "shared/effects.h"
#include "shared/film.h"
#include "analytic/line_window.h"
#include "analytic/surface_color.h"

#if STACKS()
#define ALPHA_THERE 0.5f // from which on a translucent surface is what is seen
#endif

// Rows and columns of a tile, low <= x < high.
typedef struct {
    int x_low, x_high, y_low, y_high;
} Box;

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

// First of the pixels from `low` to `high` whose centre is at `place` or beyond, `origin` being
// where pixel 0 begins.
static inline int pixel_from(double place, int origin, int low, int high)
{
    return (int)clamp(ceil(place - 0.5 - origin), (double)low, (double)high);
}

// The part of the box whose pixels' centres the triangle may cover.
static Box box_of(const Tile *tile, const MovingTriangle *m, Box box)
{
    const double slack = 1e-6; // pixels; more than rounding
    double3 low = INFINITY, high = -INFINITY;
    for (int i = 0; i < 3; i++) {
        if (!(m->w[i] > 0.0)) return box;
        double3 at = (double3)(m->x[i] / m->w[i], m->y[i] / m->w[i], 0.0);
        low = fmin(low, at), high = fmax(high, at);
    }
    box.x_low = pixel_from(low.x - slack, tile->x, box.x_low, box.x_high);
    box.x_high = pixel_from(high.x + slack, tile->x, box.x_low, box.x_high);
    box.y_low = pixel_from(low.y - slack, tile->y, box.y_low, box.y_high);
    box.y_high = pixel_from(high.y + slack, tile->y, box.y_low, box.y_high);
    return box;
}

static Places centres_from(const Tile *tile, int pixel)
{
    Places places = {.y = tile->y + pixel / TILE + 0.5f};
    Floats column = (float)(tile->x + pixel % TILE) + DOUBLE_INDEX(Floats);
    places.x = to_doubles(column + 0.5f);
#define CLEAR(name) places.name = 0.0;
    LENS_COORDINATES(CLEAR)
#undef CLEAR
    return places;
}

#if ALPHA_VARIES()
// Eight pixels at whose centres enough of the path, frozen at `tau`, is there.
static INLINED DoubleMask there_enough(const Tile *tile, Path path, const Resting *r, double tau,
                                     Places places)
{
    if (!(path.alpha < 0.0f)) return (DoubleMask)(-1);
    Doubles e[3];
    edges_at(r, &places, e);
    Doubles sum = (e[0] + e[1]) + e[2];
    Weights weights[6];
    for (int i = 0; i < 3; i++) {
        HalfWeights begin = to_half_weights(e[i] / sum * (1.0 - tau));
        HalfWeights end = to_half_weights(e[i] / sum * tau);
        weights[i] = weights[i + 3] = 0.0f;
        FIRST_HALF(weights[i]) = begin, FIRST_HALF(weights[i + 3]) = end;
    }
    Lanes alpha = alpha_at_weights(&tile->scene, r->index, weights, DOUBLES);
    return to_double_mask(FIRST_HALF(alpha) >= ALPHA_THERE); // nor where it is seen edge-on
}
#endif

// The path as it is at `t` into the z-buffer of the box.
static void see_frozen(Tile *tile, Path path, const MovingTriangle *moving, Resting *r, float t,
                       Box box)
{
    bool there = path.step == 0 || (path.open <= t && t < path.close);
    if (!there) return;
    double tau = local_moment(path, t);
    freeze_triangle(moving, tau, &r->triangle);
    set_edges(r);
    box = box_of(tile, &r->triangle, box);
    for (int y = box.y_low; y < box.y_high; y++)
        for (int x = box.x_low / DOUBLES * DOUBLES; x < box.x_high; x += DOUBLES) {
            int pixel = y * TILE + x;
            Places places = centres_from(tile, pixel);
            DoubleMask mask = columns_between(x, box.x_low, box.x_high - 1);
#if ALPHA_VARIES()
            mask &= there_enough(tile, path, r, tau, places);
#endif
            nearest_of_lanes(tile, r, pixel, &places, &mask);
        }
}

static void see_path(Tile *tile, uint index)
{
    Path path = tile->scene.paths[index];
#if MIRRORS()
    if (tile->scene.meshes[path.mesh].world != 0u) return; // the mirror is what is seen
#endif
#if STACKS()
    if (path.alpha >= 0.0f && path.alpha < ALPHA_THERE) return;
#endif
    Resting r;
    load_resting(tile, index, &r);
    MovingTriangle moving = r.triangle;
    Box box = {tile->x_low, tile->x_high, tile->y_low, tile->y_high};
#if ROLLING_COLUMNS()
    for (int x = tile->x_low; x < tile->x_high; x++) {
        box.x_low = x, box.x_high = x + 1;
        see_frozen(tile, path, &moving, &r, moment_at(tile, x, 0), box);
    }
#elif ROLLING()
    for (int y = tile->y_low; y < tile->y_high; y++) {
        box.y_low = y, box.y_high = y + 1;
        see_frozen(tile, path, &moving, &r, moment_at(tile, 0, y), box);
    }
#else
    see_frozen(tile, path, &moving, &r, moment_at(tile, 0, 0), box);
#endif
}

// What a pixel's centre sees: a path at a time within its motion segment, and the shares of its
// three vertices, which are those in the world.
typedef struct {
    Shaded shaded;
    double tau, depth;
    double share[3];
    bool from_behind;
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
    // The front is where vertices are seen counter-clockwise; edge-on counts as the front.
    seen.from_behind = sum > 0.0;
    return seen;
}

// Vertex i's attribute, at both ends of the segment, as it counts at the moment.
static inline double2 corner_weights(const Seen *seen, int i)
{
    return seen->share[i] * (double2)(1.0 - seen->tau, seen->tau);
}

#if AOV_NORMAL()
// Unit normal in the world, on the side of a two-sided surface that is seen.
static INLINED double3 normal_of(const Tile *tile, const Seen *seen)
{
    const Scene *scene = &tile->scene;
    const Shaded *s = &seen->shaded;
    double3 normal = 0.0;
    if (s->mesh.normal == NONE)
        normal = (1.0 - seen->tau) * convert_double3(face_normal(scene, s, 0))
                 + seen->tau * convert_double3(face_normal(scene, s, 1));
    else
        for (int i = 0; i < 6; i++) {
            uint at = attribute_index(s, s->mesh.normal, s->mesh.normal_step, i);
            double2 weights = corner_weights(seen, i % 3);
            normal += (i < 3 ? weights.x : weights.y)
                      * convert_double3(vload3(at, scene->normals));
        }
    double size = sqrt(normal.x * normal.x + normal.y * normal.y + normal.z * normal.z);
    bool turned = seen->from_behind && !(s->material.flags & MATERIAL_SINGLE_SIDED);
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

static inline void store_float(Aovs aovs, int plane, size_t pixel, double value)
{
    aovs.planes[plane * aovs.size + pixel] = as_uint((float)value);
}

static inline void store_pair(Aovs aovs, int plane, size_t pixel, double2 value)
{
    store_float(aovs, plane, pixel, value.x);
    store_float(aovs, plane + 1, pixel, value.y);
}

static void store_seen(const Tile *tile, int x, int y, size_t out, Aovs aovs)
{
    Seen seen = see_again(tile, x, y);
#if AOV_DEPTH()
    store_float(aovs, PLANE_DEPTH, out, seen.depth);
#endif
#if AOV_NORMAL()
    double3 normal = normal_of(tile, &seen);
    store_pair(aovs, PLANE_NORMAL, out, normal.xy);
    store_float(aovs, PLANE_NORMAL + 2, out, normal.z);
#endif
#if AOV_UV()
    store_pair(aovs, PLANE_UV, out, uv_of(tile, &seen));
#endif
#if AOV_FORWARD()
    store_pair(aovs, PLANE_FORWARD, out, flow_of(&seen, centre_of(tile, x, y), aovs.forward));
#endif
#if AOV_BACKWARD()
    store_pair(aovs, PLANE_BACKWARD, out, flow_of(&seen, centre_of(tile, x, y), aovs.backward));
#endif
#if AOV_MESH()
    aovs.planes[PLANE_MESH * aovs.size + out] = seen.shaded.path.mesh + 1u;
#endif
}

// Where nothing is seen.
static void store_nothing(size_t out, Aovs aovs)
{
    for (int plane = 0; plane < PLANES; plane++) aovs.planes[plane * aovs.size + out] = 0u;
#if AOV_DEPTH()
    store_float(aovs, PLANE_DEPTH, out, INFINITY);
#endif
}

// The layers of the tile's pixels; "operations" among the planes is not of this stage.
static void moment(Tile *tile, Frame frame, Aovs aovs)
{
    tile->row_low = 0, tile->row_high = TILE;
    clear_nearest(tile);
    double far = INFINITY;
    for (uint k = 0; k < tile->member_count; k++) {
        if (k % PATHS_BETWEEN == 0) far = farthest_surface(tile);
        if (tile->shapes[tile->members[k]].near <= far) see_path(tile, tile->members[k]);
    }
    for (int y = tile->y_low; y < tile->y_high; y++)
        for (int x = tile->x_low; x < tile->x_high; x++) {
            size_t out = (size_t)(tile->y + y - frame.y) * frame.width + (tile->x + x - frame.x);
            if (tile->static_depth[y * TILE + x] < INFINITY) store_seen(tile, x, y, out, aovs);
            else store_nothing(out, aovs);
        }
}
