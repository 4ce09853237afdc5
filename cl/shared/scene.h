// A scene as the kernels see it, and the samples that look at it.
#ifndef MB_SCENE_H
#define MB_SCENE_H

#include "shared/effects.h"
#include "shared/records.h"

typedef struct {
    Numbers numbers;
    global const Vertex *vertices;
    global const Path *paths;
    global const Mesh *meshes;
    global const Material *materials;
    global const float *vertex_colors; // three per vertex and time
#if LARGE_UV()
    global const double *uvs;          // two
#else
    global const float *uvs;
#endif
    global const float *normals;       // three
    global const Texture *textures;
    global const float4 *texels;
    global const Light *lights;
    global const Camera *cameras;
    global const Slot *slots;      // of the samples of a pixel
    global const float *filter;    // inverse of the filter's cumulative weight
    global const ShutterKey *shutter;
#if CUBE_MAPS()
    global const CubeMap *maps;       // the environment, then those of objects
    global const float4 *map_texels;  // what facets reflect (environment.h), and those of maps
    global const Sky *sky;            // the camera, for what lies behind all
    global const MirrorPlane *mirror_planes; // of the worlds that are seen in mirrors, from 1 on
#endif
} Scene;

static inline global const Mesh *mesh_of(const Scene *scene, uint path)
{
    return scene->meshes + scene->paths[path].mesh;
}

#endif
