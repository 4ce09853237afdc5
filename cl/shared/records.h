// Records shared with the host; mbinterval/device/records.py declares the same, and a test
// compiles a probe kernel that compares sizes and offsets.
#ifndef MB_RECORDS_H
#define MB_RECORDS_H

#include "shared/effects.h"
#include "shared/inlining.h"

// What the kernels are told in numbers: of the scene, and of the plan. Those of an effect that is
// not called for are 0.
typedef struct {
    uint light_count;
    uint static_paths;          // the first paths, opaque, which do not move
    uint path_count;            // all of them
    uint sky_count;
    uint leaf_nodes;            // of the tree of what casts shadows; also the first one's place
    float roll_start, roll_step, roll_length; // of a rolling shutter's lines, in the shutter's time
    uint shutter_keys;
    uint seed;
    int width, height;          // of the frame
    int samples;                // per pixel
    int layers;                 // samples per pixel that a tile works on at a time
    int filter_places;          // of the table of the filter's weight
    float filter_zero, filter_mass; // where it changes sign, and the mass of its absolute value
    float reach_low, reach_high; // where samples lie relative to their pixel, in x and in y
    int blades;
    float blade_rotation;       // radians
    float moment;               // of the sharp frame, in the shutter's time
    float shading_error;
    int shading_times;
    int anisotropy;
    float sample_spacing;       // edge of the square that a sample stands for, in pixels
    int most_intervals;         // of a sample
    int slices;                 // of accumulation
    int columns;                // of the grid that samples are jittered in
    int event_steps;            // parts of the shutter that have a colour of their own
    int shadow_size, shadow_strata; // texels along an edge of a shadow map, and times of it
    float shadow_bias;          // texels
    int cull_tile;              // pixels along an edge of the tiles that samples are culled in
    int frameless, frameless_step; // parts of the shutter that pixels see, and from row to row
    int strata_lens, strata_time; // parts of each axis of the lens, and of time, to cull by
} Numbers;

// The tiles that are rendered in one go.
typedef struct {
    int x, y;          // first pixel of the first tile
    int columns, rows; // tiles
    uint queued;       // tiles to render
    uint capacity;     // of each pool, per work-item
    uint event_capacity; // of the pool of events
} TileGrid;

// The tiles that paths are listed by.
typedef struct {
    int x, y;          // first pixel of the first tile
    int columns, rows; // tiles
    int size;          // pixels along a tile's edge
    uint paths;
    uint chunk;        // paths per work-item
    float x_low, x_high, y_low, y_high; // where samples lie, relative to their pixels
} ListGrid;

// The part of the frame that is rendered, and what lies behind everything.
typedef struct {
    int x, y;           // first pixel of the film in the frame
    int width, height;
    float background[3];
} Frame;

// A vertex in homogeneous pixel space, (X w, Y w, w). A point of the lens moves it by (u, v) times
// circle: its circle of confusion, times w.
typedef struct {
    double x, y, w, circle;
} Vertex;

// Vertices that are transformed alike: one mesh at one time of the shutter, or a part of it.
typedef struct {
    uint input;   // first position, in units of three doubles
    uint output;  // first vertex
    uint count;
    uint camera;  // index of the camera's pose
} VertexJob;

// A camera pose: pixel-homogeneous = matrix (world - eye); ray = inverse (X, Y, 1), in the world.
// One of what is seen in a glossy mirror has the mirror's shear too (shear.h).
typedef struct {
    double eye[3];
    double matrix[9];
    double inverse[9];
    double aperture;              // lens radius times focal length, in pixels times world units
    double focus;                 // distance in focus
    double sharp_near, sharp_far; // extended range in focus; both are `focus` without
    double foreground;            // greatest radius of blur before it, in pixels
    double plane[4];              // height over the mirror: the product with (x w, y w, w, 1)
    double tilt[6];               // what a, and then b, add to these for each unit of height
} Camera;

// Where a sample of every pixel may lie, relative to the pixel's upper left corner. With the same
// pattern in every pixel low and high are equal.
typedef struct {
    float x_low, x_high, y_low, y_high;
} Slot;

// A corner of the shutter's curve: time and open fraction, both in [0, 1], and the share of all
// light that has passed until then.
typedef struct {
    float t, open, passed, unused;
} ShutterKey;

// A motion path: one triangle over one motion segment. The end of vertex v is v + step.
typedef struct {
    uint a, b, c;
    uint step;    // vertices from the segment's start to its end; 0 where nothing moves
    uint face;    // face of the mesh
    uint mesh;
    float open, close; // times of the segment's ends, in the shutter's [0, 1]
    float color[3]; // of the face: what vertex colours, textures and light multiply
    float alpha;    // 1 is opaque, less translucent; below 0 it varies, and this is minus the
                    // factor that vertex colours and textures multiply
} Path;

static inline float path_length(Path path) { return path.close - path.open; }

// What the mesh of a path says: where its attributes are (NONE where it has none), how many
// vertices lie between two times of an attribute (0 where it is constant). Of all meshes'
// vertices, each counted once, its own begin at `first`. What is seen in mirror k, counted from 1,
// is in world k, all else in world 0; a mirror has its own number, and the share of light that it
// mirrors.
typedef struct {
    uint vertex, count;
    uint uv, uv_step;
    uint normal, normal_step;
    uint color, color_step;
    uint material;
    uint camera;
    uint first;
    uint map;      // what it mirrors, among the cube maps
    uint world, mirror; // 0: what is no mirror
    float reflectivity;
    uint sheared;       // whether that mirror is glossy
} Mesh;

#define NONE 0xffffffffu

typedef struct {
    float specular[3], shininess;
    uint flags;    // MATERIAL_*
    uint texture;  // NONE or index
    float cutoff;  // alpha below which a MATERIAL_MASK is not there
    float turn;    // square of the chord that its normals may turn by between two places of a span
    float metallic, roughness;
    uint gloss_texture;    // of both: NONE or index
    uint emission_texture; // likewise
    float emission[3];
} Material;

#define MATERIAL_PHONG 1u
#define MATERIAL_SINGLE_SIDED 2u
#define MATERIAL_MASK 4u // alpha is tested, not blended
#define MATERIAL_METALLIC 8u
#define MATERIAL_LIT (MATERIAL_PHONG | MATERIAL_METALLIC)

// A texture's mip chain, level 0 first, each half the size of the one before, at least 1.
typedef struct {
    uint texel;   // first texel of level 0
    uint width, height;
    uint levels;
    uint wrap;    // WRAP_*
    uint unused[3];
} Texture;

#define WRAP_REPEAT 0u
#define WRAP_CLAMP 1u
#define WRAP_MIRROR 2u

typedef struct {
    float color[3];  // times intensity
    uint kind;       // LIGHT_*
    float vector[3]; // direction towards the light, normalized, or its position, relative to the
                     // eye at the shutter's opening
    uint shadow;     // its place among the lights that cast shadows, or NONE
    float axis[3];   // from what a spot light shines on back to it, normalized
    float cone[2];   // it fades with the square of cosine * cone[0] + cone[1], clamped to [0, 1]
    uint unused[3];
} Light;

#define LIGHT_AMBIENT 0u
#define LIGHT_DIRECTIONAL 1u
#define LIGHT_POINT 2u
#define LIGHT_SPOT 3u

// What a path's shape says about all samples. Computed by paths.cl once a frame.
// A sample (X, Y) can only be covered where a[i] X + b[i] Y + c[i] >= 0 for all i < planes.
#define MAX_PLANES 8
typedef struct {
    double c[MAX_PLANES];
    float a[MAX_PLANES];
    float b[MAX_PLANES];
    float y_min, y_max; // bounds on screen, infinite where the path reaches behind the eye
    float facing_changes[4]; // 1 (front) or -1 at the start, then the times at which that changes
    float crossing[6];  // for side i: place of the crossing on its start and on its end, counted
                        // from the end of the edge that comes first by position
    uint planes;
    uint flags;         // SHAPE_*
    float scale;        // power of two that brings w near 1
    float near, far;    // bounds of w wherever the path is hit
    uint unused;
} Shape;

#define SHAPE_CULLED 1u   // can't be seen at all
#define SHAPE_BEHIND 2u   // reaches behind the eye
#define SHAPE_CROSSED 4u  // bit of side 0; sides 1 and 2 follow
#define SHAPE_REVERSED 32u // likewise: the side's second corner comes first by position

// Depth of a path at any sample and time: w = d(tau) / (x(tau) X + y(tau) Y + w(tau)), Bernstein
// coefficients over the motion segment. d is the determinant of the three vertices, the rest the
// sum of the cross products of its edges.
typedef struct {
    double d[4];
    double x[3], y[3], w[3];
    float near, far;    // the shape's bounds
    float open, length; // the path's
    uint unused[2];     // to two cache lines
} Depth;

// What a path's vertices say about all samples, for point sampling.
typedef struct {
    float near, far; // bounds of w wherever the path is hit
    float scale;     // power of two that brings the vertices near 1
    uint flags;      // BOUNDS_*
} Bounds;

#define BOUNDS_CULLED 1u       // can't be seen at all
#define BOUNDS_SINGLE_SIDED 2u

// A time interval of an exact path: when it covers a sample, and bounds of its depth then.
typedef struct {
    float t0, t1, near, far;
    uint path; // with TRANSLUCENT_BIT where it is translucent
    int next;  // next interval of the sample, -1 at the end
} Visit;

#define TRANSLUCENT_BIT 0x80000000u

// A fragment: where one triangle of a path's surface is hit (Hong & Oh 2017, 4.3).
typedef struct {
    float t, w;
    uint part; // path << 4 | face of the path's surface
    int next;  // next fragment of the sample, -1 at the end
} Fragment;

#define PART_BITS 4
#define PART_EYE 15u // stands for the moment at which the path passes through the eye

// When a path covers a sample: [t0, t1), depth linear from w0 to w1.
typedef struct {
    float t0, t1, w0, w1;
    uint first, last; // parts of the fragments that it was made from
} Interval;

// A part of a front envelope: a path in [t0, t1), and bounds of its depth.
typedef struct {
    float t0, t1, near, far;
    uint path;
} Front;

// A visible piece of an interval. Spans of the same times are a stack, front to back: all but the
// last are translucent.
typedef struct {
    float t0, t1;
    float weight; // of the shutter
    uint source;  // exact paths: the path; triangulated ones: index into the pool `sorted`
#if SHADOWS()
    uint steps;   // first of its steps in their pool
#endif
} Span;

// A visible span as the host gets it, with what it adds to its pixel.
typedef struct {
    uint pixel;     // of the region, row by row
    uint sample;    // of the pixel, with EVENT_*
    uint path;
    float t0, t1;   // in the exposure of the pixel's line
    float weight;   // share of the pixel's light, by filter and shutter
    float share;    // of the sample in its pixel
    float z0, z1;   // depth at t0 and at t1
    float color[4]; // average of what it adds: premultiplied with alpha, which is last
} Event;

#define EVENT_WHOLE 0x80000000u // events of its parts follow
#define EVENT_PART 0x40000000u
// From `t` on the share `passed` of a light reaches a span, up to the next step.
typedef struct {
    float t, passed;
} Step;

// A light that casts shadows. Places are relative to the eye at the shutter's opening.
typedef struct {
    double vector[3]; // direction towards it, normalized; nothing where it is at a finite place
    double origin[3]; // its place, or any place where it is infinitely far
    uint finite;
    uint view, views; // first of its views, and how many
    uint unused;
} ShadowLight;

// How a light sees the scene: a face of a point light's cube, a spot light's cone, all that a
// directional light shines on. Its size x size tiles cover x, y in [0, size]; (x w, y w, w) and the
// depth of a point are matrix (point - eye, 1), row by row.
typedef struct {
    double matrix[16];
    uint size;
    uint starts; // place of its first tile in the list of where tiles' paths start
    uint paths;  // place of its first path in the list of outlines
    float texel; // width of a tile at depth 1, or, in parallel, at any depth
} LightView;

// What a view sees of a path: its least depth, and planes; it lies where, for all i,
// a[i] x + b[i] y + c[i] >= 0, x and y in tiles.
typedef struct {
    float a[MAX_PLANES], b[MAX_PLANES], c[MAX_PLANES];
    float near, unused[7]; // to two cache lines
} Outline;

// Rays of a view: the one through x, y starts at from[0..2] + x from[3..5] + y from[6..8], goes
// along what `way` says likewise, and is at depth `depth` + s after s times that.
typedef struct {
    double from[9], way[9];
    double depth;
} ViewRays;

// A box in which paths are from `open` to `close` of the shutter.
typedef struct {
    float low[3], high[3];
    float open, close;
} TreeNode;

#define MAP_LEVELS 12

// Light from all directions: cube maps, level 0 sharp and the others as rougher and rougher
// surfaces mirror it, for each of `times` equal parts of the shutter (cl/shared/cube_map.h).
// Nothing is in one without levels.
typedef struct {
    uint levels, times;
    uint stride;            // texels from one part of the shutter to the next
    uint irradiance;        // first texel of the cube for Lambert's surfaces
    uint first[MAP_LEVELS]; // texel of each level
    uint size[MAP_LEVELS];  // steps along the edge of a face: one texel less than it has
} CubeMap;

// The camera over a part of the shutter, for what is infinitely far: a pixel (X, Y) sees it in the
// direction start (X, Y, 1), row by row, at its beginning, `end` likewise, and linearly between. A
// point of the lens moves it by (u, v) times `blur` pixels.
typedef struct {
    float open, close;
    float start[9], end[9];
    float blur_start, blur_end;
    float angle_start, angle_end; // that a pixel stands for in the middle of the frame
} Sky;

// A picture of all directions (cl/shared/panorama.h): columns and rows of texels, by how far it is
// turned to the left, in radians, and what its texels and a unit of their sums are of light.
typedef struct {
    int width, height;
    float turn, intensity;
    double unit;
} Panorama;

// A mirror's plane: its unit normal, and two orthogonal directions within it, each as long as the
// radius of the disc over which it spreads what is at distance 1.
typedef struct {
    float normal[3];
    float tangents[6];
} MirrorPlane;

// A sample: its place in the frame, in pixels, the point of the lens that it looks through, and
// that of the disc over which glossy mirrors spread what they show.
typedef struct {
    float x, y, u, v;
#if GLOSSY()
    float a, b;
#endif
} Place;

// Scratch of the envelope for one interval: a word in each of five arrays.
typedef struct {
    float words[5];
} Ordering;

// Scratch of the sort for one interval: a word in each of nine arrays.
typedef struct {
    float words[9];
} Sorting;

// A run of records that belongs to one sample.
typedef struct {
    uint start, count;
} Run;

#endif
