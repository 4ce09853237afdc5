// The culling method that the plan chose: which samples of a tile each path is tested at.
#if defined(CULL_BBOX)
#include "stochastic/cull/bbox.h"
#elif defined(CULL_HULL)
#include "stochastic/cull/hull.h"
#elif defined(CULL_OBB)
#include "stochastic/cull/obb.h"
#elif defined(CULL_PIXAR)
#include "stochastic/cull/pixar.h"
#elif defined(CULL_INTERLEAVE_UVT)
#include "stochastic/cull/interleave_uvt.h"
#elif defined(CULL_DUAL_SPACE)
#include "stochastic/cull/dual_space.h"
#elif defined(CULL_CLIP_SPACE)
#include "stochastic/cull/clip_space.h"
#elif defined(CULL_CLIP_SPACE_PRINTED)
#include "stochastic/cull/clip_space_printed.h"
#elif defined(CULL_TRIM)
#include "stochastic/cull/trim.h"
#elif defined(CULL_ZMAX)
#include "stochastic/cull/zmax.h"
#elif defined(CULL_ZMAX_STRATA)
#define ZMAX_STRATA
#include "stochastic/cull/zmax.h"
#else
#include "stochastic/cull/best.h"
#endif
