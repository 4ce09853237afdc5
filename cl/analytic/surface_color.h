// The colour of a path at sixteen points, from its attributes there.
#ifndef MB_SURFACE_COLOR_H
#define MB_SURFACE_COLOR_H

#include "shared/effects.h"
#include "analytic/tile_of_rows.h"
#include "shared/attributes.h"

// Whether the colour is not the same all over the path.
static inline bool varies_on_surface(const Shaded *s)
{
    return s->material.texture != NONE || (s->material.flags & MATERIAL_LIT)
           || s->mesh.color != NONE;
}

#if ANISOTROPY()
// Whether its textures are averaged over footprints; a test of alpha is made of the texture itself.
static inline bool has_footprint(const Shaded *s)
{
    const Material *m = &s->material;
    return (m->texture != NONE || m->gloss_texture != NONE || m->emission_texture != NONE)
           && !(m->flags & MATERIAL_MASK);
}
#endif

// What the corners have, and the view through the place.
static void load_attributes(const Tile *tile, Shaded *s)
{
    load_corners(&tile->scene, s);
#if LIT()
    load_view(&tile->scene, s);
#endif
}

// Colours with these attributes, which get their gloss, of what is seen, `count` of which matter;
// textures at mip level `level`.
static Colors surface_color(const Tile *tile, const Shaded *s, Attributes *a, float level,
                            int count, Sight *sight)
{
    const float *base = s->path.color;
    Lanes3 color = {base[0] * a->color.x, base[1] * a->color.y, base[2] * a->color.z};
#if ALPHA_VARIES()
    Lanes alpha = vertex_alpha(a);
#endif
#if TEXTURED()
    if (s->material.texture != NONE) {
        Colors texel = texel_colors(&tile->scene, s->material.texture, a, level, count);
#if ALPHA_VARIES()
        alpha *= texel.alpha;
        texel = unpremultiplied(texel);
#endif
        color.x *= texel.x, color.y *= texel.y, color.z *= texel.z;
    }
#endif
#if LIT()
    if (s->material.flags & MATERIAL_LIT) {
        // Not in the eye.
        sight->w = lanes_min(lanes_max(sight->w, (Lanes)(1e-30f)), (Lanes)(1e30f));
#if METALLIC()
        load_gloss(&tile->scene, s, a, level, count);
#endif
        color = reflect_light(&tile->scene, s, a, color, sight, count);
#if EMISSION()
        color = with_emission(&tile->scene, s, a, color, level, count);
#endif
    }
#endif
    Colors colors = {color.x, color.y, color.z};
#if ALPHA_VARIES()
    colors.alpha = counted_alpha(s, alpha);
#endif
    return colors;
}

#endif
