// Stage "solve" on pairs of a path and a sample that a test made: DOUBLES samples for each path.
#include "analytic/solve.cl"

static void give_places(Gather *g, global const float2 *places, int first)
{
    for (int i = 0; i < DOUBLES; i++) {
        g->samples[i] = first + i;
        g->x[i] = places[first + i].x, g->y[i] = places[first + i].y;
    }
}

static void begin_pairs(const Tile *tile, uint path, global const float2 *places, Gather *g)
{
    begin_gather(tile, path, g);
    clear_gather(g);
    g->waiting = DOUBLES;
    give_places(g, places, (int)(path * DOUBLES));
}

// `one_by_one` leaves the vectors out. Lists are by pair; result: done, number of visits.
kernel void solve_pairs(global const Vertex *vertices, global const Path *paths,
                        global const Shape *shapes, global const Mesh *meshes,
                        global const Material *materials, uint count,
                        global const float2 *places, uint one_by_one, uint capacity,
                        global Visit *visits, global int *heads, global int *tails,
                        global uint *met, global uint *result)
{
    Tile tile;
    tile.scene.vertices = vertices, tile.scene.paths = paths, tile.shapes = shapes;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.visits = visits, tile.visit_count = 0, tile.capacity = capacity;
    tile.heads = heads, tile.tails = tails, tile.met = met;
    tile.tests = tile.hits = 0;
    bool done = true;
    for (uint i = 0; i < count * DOUBLES; i++) heads[i] = -1, met[i] = 0u;
    for (uint path = 0; path < count && done; path++) {
        if (shapes[path].flags & SHAPE_CULLED) continue; // stage "bin" leaves it out
        Gather g;
        begin_pairs(&tile, path, places, &g);
        if (one_by_one)
            for (int i = 0; i < DOUBLES && done; i++)
                done = solve_any(&tile, &g, g.samples[i], gathered_place(&g, i));
        else
            done = solve_gathered(&tile, &g);
    }
    result[0] = done;
    result[1] = tile.visit_count;
}

// Every path on every sample; `count` is a multiple of DOUBLES. Lists are by sample.
kernel void solve_all(global const Vertex *vertices, global const Path *paths,
                      global const Shape *shapes, global const Mesh *meshes,
                      global const Material *materials, uint path_count,
                      global const float2 *places, uint count, uint one_by_one, uint capacity,
                      global Visit *visits, global int *heads, global int *tails, global uint *met,
                      global uint *result)
{
    Tile tile;
    tile.scene.vertices = vertices, tile.scene.paths = paths, tile.shapes = shapes;
    tile.scene.meshes = meshes, tile.scene.materials = materials;
    tile.visits = visits, tile.visit_count = 0, tile.capacity = capacity;
    tile.heads = heads, tile.tails = tails, tile.met = met;
    tile.tests = tile.hits = 0;
    bool done = true;
    for (uint i = 0; i < count; i++) heads[i] = -1, met[i] = 0u;
    for (uint path = 0; path < path_count && done; path++) {
        if (shapes[path].flags & SHAPE_CULLED) continue;
        Gather g;
        begin_gather(&tile, path, &g);
        clear_gather(&g);
        g.waiting = DOUBLES;
        for (uint first = 0; first < count && done; first += DOUBLES) {
            give_places(&g, places, (int)first);
            if (one_by_one)
                for (int i = 0; i < DOUBLES && done; i++)
                    done = solve_any(&tile, &g, g.samples[i], gathered_place(&g, i));
            else
                done = solve_gathered(&tile, &g);
        }
    }
    result[0] = done;
    result[1] = tile.visit_count;
}
