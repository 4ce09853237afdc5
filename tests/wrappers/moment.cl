// Stage "moment" of one tile, on paths that a test made.
#include "analytic/nearest.cl"
#include "analytic/moment.cl"

kernel void moment_tile(Numbers numbers, Frame frame, global const Vertex *vertices,
                        global const Path *paths, global const Shape *shapes,
                        global const Mesh *meshes, global const Material *materials,
                        global const float *uvs, global const float *normals,
                        global const Camera *cameras, global const uint *members,
                        uint member_count, int x, int y, global const double *forward,
                        global const double *backward, global double *static_depth,
                        global uint *static_part, global uint *planes)
{
    Tile tile;
    tile.scene.numbers = numbers, tile.scene.vertices = vertices, tile.scene.paths = paths;
    tile.scene.meshes = meshes, tile.scene.materials = materials, tile.scene.uvs = uvs;
    tile.scene.normals = normals, tile.scene.cameras = cameras, tile.shapes = shapes;
    tile.x = x, tile.y = y;
    tile.x_low = max(frame.x - x, 0), tile.x_high = min(frame.x + frame.width - x, TILE);
    tile.y_low = max(frame.y - y, 0), tile.y_high = min(frame.y + frame.height - y, TILE);
    tile.members = members, tile.member_count = member_count;
    tile.static_depth = static_depth, tile.static_part = static_part;
    Aovs aovs = {.size = (size_t)frame.width * frame.height};
    aovs.planes = planes, aovs.forward = forward, aovs.backward = backward;
    moment(&tile, frame, aovs);
}
