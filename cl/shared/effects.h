// The effects that a render may call for: each is a macro, 1 where it does and 0 where it does not,
// as in `#if LENS()`. Any other name does not compile, as a misspelt effect would not.
//
// The host gives the option -DMB_LENS for LENS, and so on (KERNEL_EFFECTS in Python is this list).
// What is not called for leaves no code. Options with numbers are sizes: TILE, MASK_BITS,
// SHADOW_LIGHTS, STRATA, PLANES (of layers) and the first of each layer's, such as PLANE_DEPTH.
#ifndef MB_EFFECTS_H
#define MB_EFFECTS_H

// 1 of a macro that is defined as 1, 0 of one that is not defined.
#define GIVEN(option) GIVEN_AS(option)
#define GIVEN_AS(value) GIVEN_##value
#define GIVEN_1 1

// Motion, and how it is followed.
#define MOVING() GIVEN(MB_MOVING) // something moves in the exposure, or is seen through at rest
#define EXACT() GIVEN(MB_EXACT) // depth and attributes are exact functions of time
#define STATIC() GIVEN(MB_STATIC) // something does not move
#define PAIR_BY_DEPTH() GIVEN(MB_PAIR_BY_DEPTH) // fragments are paired in this order
#define BIT_MASK() GIVEN(MB_BIT_MASK) // visibility in MASK_BITS parts of the shutter
#define PARTIAL_BITS() GIVEN(MB_PARTIAL_BITS) // with the coverage of each of them
#define MAX_INTERVALS() GIVEN(MB_MAX_INTERVALS) // no more than `most_intervals` of a sample count

// Samples.
#define PLACED() GIVEN(MB_PLACED) // they lie differently in every pixel
#define SCATTERED() GIVEN(MB_SCATTERED) // and anywhere in it
#define FIVE_POINT() GIVEN(MB_FIVE_POINT) // pixels share them
#define WEIGHTED() GIVEN(MB_WEIGHTED) // the filter has negative lobes
#define FILTER_TABLE() GIVEN(MB_FILTER_TABLE) // places are warped to a filter
#define LENS() GIVEN(MB_LENS) // samples look through points of a lens
#define BLADES() GIVEN(MB_BLADES) // that is a polygon
#define SHUTTER_CURVE() GIVEN(MB_SHUTTER_CURVE) // the shutter opens and closes as a curve says
#define ROLLING() GIVEN(MB_ROLLING) // the shutter opens line by line
#define ROLLING_COLUMNS() GIVEN(MB_ROLLING_COLUMNS) // which are columns

// Surfaces.
#define SINGLE_SIDED() GIVEN(MB_SINGLE_SIDED) // some are seen from one side only
#define TRANSLUCENT() GIVEN(MB_TRANSLUCENT) // some are seen through
#define ALPHA_VARIES() GIVEN(MB_ALPHA_VARIES) // alpha varies over a surface
#define VERTEX_ALPHA() GIVEN(MB_VERTEX_ALPHA) // of vertices
#define MIRRORS() GIVEN(MB_MIRRORS) // some reflect what is there
#define GLOSSY() GIVEN(MB_GLOSSY) // and blur it: samples draw points of a disc
#define TEXTURED() GIVEN(MB_TEXTURED)
#define LARGE_UV() GIVEN(MB_LARGE_UV) // so many texels away that float32 is too coarse
#define VERTEX_COLOR() GIVEN(MB_VERTEX_COLOR)
#define PHONG() GIVEN(MB_PHONG)
#define METALLIC() GIVEN(MB_METALLIC)
#define EMISSION() GIVEN(MB_EMISSION)
#define SHADING_ERROR() GIVEN(MB_SHADING_ERROR) // colours are evaluated as often as this needs
#define ANISOTROPY() GIVEN(MB_ANISOTROPY) // textures are read over a sample's footprint

// Light.
#define POINT_LIGHTS() GIVEN(MB_POINT_LIGHTS) // spot lights among them
#define SPOT_LIGHTS() GIVEN(MB_SPOT_LIGHTS)
#define SHADOWS() GIVEN(MB_SHADOWS) // of SHADOW_LIGHTS lights
#define SHADOW_MAP() GIVEN(MB_SHADOW_MAP) // that are looked up in a map
#define ENVIRONMENT() GIVEN(MB_ENVIRONMENT) // light from all sides
#define SKY() GIVEN(MB_SKY) // that is seen
#define REFLECTIONS() GIVEN(MB_REFLECTIONS) // objects have cube maps of their own
#define BACKGROUND_IMAGE() GIVEN(MB_BACKGROUND_IMAGE)
#define TRANSPARENT() GIVEN(MB_TRANSPARENT) // the film has no background

// What is found besides the image.
#define MOMENTARY() GIVEN(MB_MOMENTARY) // layers at one moment
#define AOV_SHARP() GIVEN(MB_AOV_SHARP)
#define AOV_DEPTH() GIVEN(MB_AOV_DEPTH)
#define AOV_NORMAL() GIVEN(MB_AOV_NORMAL)
#define AOV_UV() GIVEN(MB_AOV_UV)
#define AOV_FORWARD() GIVEN(MB_AOV_FORWARD)
#define AOV_BACKWARD() GIVEN(MB_AOV_BACKWARD)
#define AOV_MESH() GIVEN(MB_AOV_MESH)
#define AOV_OPERATIONS() GIVEN(MB_AOV_OPERATIONS)
#define RECORDED() GIVEN(MB_RECORDED) // spans are kept for the host
#define RECORDED_COLOR() GIVEN(MB_RECORDED_COLOR) // with colour and depth
#define EVENT_STEPS() GIVEN(MB_EVENT_STEPS) // parts of the shutter have a colour of their own

// Point samples.
#define STOCHASTIC() GIVEN(MB_STOCHASTIC) // all is found by them
#define PATTERN_SOBOL() GIVEN(MB_PATTERN_SOBOL)
#define PATTERN_RANDOM() GIVEN(MB_PATTERN_RANDOM)
#define PATTERN_JITTERED() GIVEN(MB_PATTERN_JITTERED)
#define PATTERN_FIXED() GIVEN(MB_PATTERN_FIXED)
#define PATTERN_RGSS() GIVEN(MB_PATTERN_RGSS)
#define PATTERN_INTERLEAVE_UVT() GIVEN(MB_PATTERN_INTERLEAVE_UVT)
#define PATTERN_SLICES() GIVEN(MB_PATTERN_SLICES)
#define SLICES_JITTERED() GIVEN(MB_SLICES_JITTERED) // slices are at random times
#define SLICE_LINES() GIVEN(MB_SLICE_LINES) // slices look through lines across the lens
#define REORDERED() GIVEN(MB_REORDERED) // samples of a slab are alike
#define FRAMELESS() GIVEN(MB_FRAMELESS) // pixels see one of several parts of the shutter
#define TEST_EDGES() GIVEN(MB_TEST_EDGES) // by edge functions over time
#define SHADE_PIXEL() GIVEN(MB_SHADE_PIXEL) // a colour for each pixel and path
#define SHADE_HYBRID() GIVEN(MB_SHADE_HYBRID) // of what does not move
#define STATISTICS() GIVEN(MB_STATISTICS)
#define CULL_BBOX() GIVEN(MB_CULL_BBOX)
#define CULL_HULL() GIVEN(MB_CULL_HULL)
#define CULL_OBB() GIVEN(MB_CULL_OBB)
#define CULL_PIXAR() GIVEN(MB_CULL_PIXAR)
#define CULL_INTERLEAVE_UVT() GIVEN(MB_CULL_INTERLEAVE_UVT)
#define CULL_DUAL_SPACE() GIVEN(MB_CULL_DUAL_SPACE)
#define CULL_CLIP_SPACE() GIVEN(MB_CULL_CLIP_SPACE)
#define CULL_CLIP_SPACE_PRINTED() GIVEN(MB_CULL_CLIP_SPACE_PRINTED)
#define CULL_TRIM() GIVEN(MB_CULL_TRIM)
#define CULL_ZMAX() GIVEN(MB_CULL_ZMAX)
#define CULL_ZMAX_STRATA() GIVEN(MB_CULL_ZMAX_STRATA)
#define CULL_ZMIN() GIVEN(MB_CULL_ZMIN)
#define CULL_ZMIN_STRATA() GIVEN(MB_CULL_ZMIN_STRATA)
#define CULL_BEST() GIVEN(MB_CULL_BEST)
#define CULL_TILES() GIVEN(MB_CULL_TILES) // in tiles of more than a pixel

// The device's compiler.
#define CLANG_BUILTINS() GIVEN(MB_CLANG_BUILTINS) // knows clang's built-in functions

// What follows from them.
#define LIT() (PHONG() || METALLIC()) // surfaces reflect light
#define VARYING() (LIT() || TEXTURED() || VERTEX_COLOR()) // colour varies over a surface
#define LIGHT_AROUND() (ENVIRONMENT() || REFLECTIONS()) // surfaces reflect what cube maps hold
#define CUBE_MAPS() (LIGHT_AROUND() || SKY())
#define STACKS() (TRANSLUCENT() || MIRRORS()) // a mirror and what is seen in it are a stack
#define STILL() (STATIC() && !SHADOWS() && !REFLECTIONS()) // what does not move has one colour
#define VIEW_VARIES() (LENS() || STOCHASTIC() || STATIC() || GLOSSY()) // over a surface
#define ZMIN() (CULL_ZMIN() || CULL_ZMIN_STRATA())
#define COUNT_TEXELS() (STATISTICS() && TEXTURED())

#endif
