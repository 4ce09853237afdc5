// Stage "record": the piece's visible spans for the host, each with its times and what it adds to
// its pixel.
//
// All work-items share one pool. A sample's events lie together in it, in order of time and, of the
// layers of a stack, front to back; where in the pool depends on how the work went, and only the
// host's sorting makes it the same each time. Where colour changes along a span, and it passes from
// one of the `event_steps` parts of its line's exposure to the next, an event for each part of it,
// with an average of its own, follows that of the whole.
#include "shared/effects.h"
#include "shared/film.h"
#include "analytic/line_window.h"

// Time `t` of the shutter in the exposure of a line that is open in `window`.
static inline float line_time(float2 window, float t)
{
#if ROLLING()
    return clamp((t - window.x) / (window.y - window.x), 0.0f, 1.0f);
#else
    return t;
#endif
}

// Whether the colour of what a stack of `size` spans adds may change in its time.
static bool changes_in_time(const Tile *tile, global const Span *spans, uint size)
{
    bool found = false;
#if VARYING()
    for (uint i = 0; i < size && !found; i++) {
        uint path = span_path(tile, spans[i]);
#if STILL()
        if (path < tile->scene.numbers.static_paths) continue;
#endif
        Shaded s = load_shaded(&tile->scene, path);
        found = varies_on_surface(&s);
    }
#endif
    return found;
}

// End of the part of a stack that begins at t.
static float part_end(const Tile *tile, float2 window, bool changes, float t, float end)
{
#if EVENT_STEPS() && VARYING()
    if (!changes) return end;
    const int steps = tile->scene.numbers.event_steps;
    float length = window.y - window.x;
    int step = (int)((t - window.x) / length * steps);
    float next = t;
    while (next <= t) next = window.x + length * ((float)++step / steps);
    return fmin(next, end);
#else
    return end;
#endif
}

// Spans of the first stack among `count`.
static inline uint layers_at_once(global const Span *spans, uint count)
{
#if STACKS()
    return stack_size(spans, count);
#else
    return 1u;
#endif
}

// Parts of a stack.
static uint count_parts(const Tile *tile, float2 window, bool changes, float t, float end)
{
    uint parts = 0;
    do {
        t = part_end(tile, window, changes, t, end);
        parts++;
    } while (t < end); // a mask's spans may have no length
    return parts;
}

// Events that the spans of a sample make.
static uint count_events(const Tile *tile, float2 window, global const Span *spans, uint count)
{
    uint events = 0;
    for (uint i = 0, size; i < count; i += size) {
        size = layers_at_once(spans + i, count - i);
        bool changes = changes_in_time(tile, spans + i, size);
        uint parts = count_parts(tile, window, changes, spans[i].t0, spans[i].t1);
        events += parts > 1 ? size * (parts + 1) : size;
    }
    return events;
}

// Room for so many events, or 0 where there is none; the tile is then to be done again.
static global Event *reserve_events(Tile *tile, uint count)
{
    if (tile->events_full || count == 0) return 0;
    uint first = atomic_add(tile->event_count, count);
    if (first <= tile->event_capacity && count <= tile->event_capacity - first)
        return tile->events + first;
    atomic_min(tile->event_end, first);
    tile->events_full = true;
    return 0;
}

// What a stack adds from times.x to times.y; of its layer k it is then `added_by(tile, k)`.
static float4 add_stack(const Tile *tile, const Viewer *viewer, global const Span *spans, uint size,
                        float2 times)
{
#if STACKS()
    const Stack stack = {spans, size, times};
    return blend_stack(tile, viewer, &stack).color;
#elif RECORDED_COLOR()
    Span span = spans[0];
    span.t0 = times.x, span.t1 = times.y;
    return (float4)(span_color(tile, viewer, span), 1.0f);
#else
    return (float4)(0.0f, 0.0f, 0.0f, 1.0f);
#endif
}

static inline float4 added_by(const Tile *tile, uint layer, float4 whole)
{
#if STACKS()
    return tile->added[layer];
#else
    return whole;
#endif
}

// The layer that an event of layer k names: of what is seen in a mirror that is the mirror.
static inline uint shown_layer(const Tile *tile, global const Span *spans, uint k)
{
#if MIRRORS()
    return mirror_among(tile, spans, k);
#else
    return k;
#endif
}

// One event for each layer of a stack, from times.x to times.y.
static void write_stack(const Tile *tile, const Viewer *viewer, Event event,
                        global const Span *spans, uint size, float2 times, global Event *out)
{
    const float2 window = viewer->window;
    float4 whole = add_stack(tile, viewer, spans, size, times);
    event.t0 = line_time(window, times.x), event.t1 = line_time(window, times.y);
    event.weight = spans[0].weight;
    if (times.x > spans[0].t0 || times.y < spans[0].t1)
        event.weight = light_until(&tile->scene, window, times.y)
                       - light_until(&tile->scene, window, times.x);
    event.weight *= event.share;
    for (uint k = 0; k < size; k++) {
        Span shown = spans[shown_layer(tile, spans, k)];
        event.path = span_path(tile, shown);
#if RECORDED_COLOR()
        event.z0 = span_depth(tile, shown, viewer->place, times.x);
        event.z1 = span_depth(tile, shown, viewer->place, times.y);
#endif
        vstore4(added_by(tile, k, whole), 0, event.color);
        out[k] = event;
    }
}

#if MOVING() || SHADOWS()

static void record_spans(Tile *tile, int sample, Event event)
{
    Run run = tile->span_runs[sample];
    global const Span *spans = tile->spans + run.start;
    const Viewer viewer = viewer_of(tile, sample);
    const float2 window = viewer.window;
    global Event *out = reserve_events(tile, count_events(tile, window, spans, run.count));
    if (!out) return;
    for (uint i = 0, size; i < run.count; i += size) {
        size = layers_at_once(spans + i, run.count - i);
        bool changes = changes_in_time(tile, spans + i, size);
        Event part = event, whole = event;
        float t = spans[i].t0, end = spans[i].t1;
        bool cut = count_parts(tile, window, changes, t, end) > 1;
        whole.sample |= cut ? EVENT_WHOLE : 0u, part.sample |= EVENT_PART;
        write_stack(tile, &viewer, whole, spans + i, size, (float2)(t, end), out);
        for (out += size; cut && t < end; out += size) {
            float next = part_end(tile, window, changes, t, end);
            write_stack(tile, &viewer, part, spans + i, size, (float2)(t, next), out);
            t = next;
        }
    }
}

#elif STATIC()

static void record_spans(Tile *tile, int sample, Event event)
{
    if (!(tile->static_depth[sample] < INFINITY)) return;
    global Event *out = reserve_events(tile, 1u);
    if (!out) return;
    Span always = {0.0f, 1.0f, 1.0f, tile->static_part[sample] >> PART_BITS};
    const Viewer viewer = viewer_of(tile, sample);
    float3 color = span_color(tile, &viewer, always);
    event.path = always.source;
    event.t0 = 0.0f, event.t1 = 1.0f, event.weight = event.share;
    event.z0 = event.z1 = (float)tile->static_depth[sample];
    vstore4((float4)(color, 1.0f), 0, event.color);
    *out = event;
}

#else

static void record_spans(Tile *tile, int sample, Event event) {}

#endif

// Record every span of the piece. Always true: where there is no room the tile says so.
static bool record(Tile *tile, Frame frame)
{
    for (int row = tile->row_low; row < tile->row_high; row++) {
        if (!row_is_rendered(tile, row)) continue;
        int y = tile->y + row % TILE - frame.y;
        for (int column = tile->x_low; column < tile->x_high; column++) {
            int sample = row * TILE + column;
            Event event = {.pixel = (uint)y * (uint)frame.width + (tile->x + column - frame.x),
                           .sample = (uint)(tile->layer + row / TILE),
                           .share = weight_of(tile, sample) * (1.0f / tile->scene.numbers.samples)};
            record_spans(tile, sample, event);
        }
    }
    return true;
}
