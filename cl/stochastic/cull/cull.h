// The culling method that the plan chose: which samples of a tile each path is tested at.
//
// Each file states its operations as Laine et al. 2011, 4.1, count them, and with a lens in
// brackets: a multiply-add, and any other sum, product, quotient, comparison, least or greatest of
// two is one; choosing and moving are none. They are those of the code as it stands, with what it
// adds for rounding: of a path, or of each of its strata, of bounds for a tile of pixels, and of a
// sample that is compared with them. The sample test that all share has 25 (34).
#include "shared/effects.h"

#if CULL_BBOX()
#include "stochastic/cull/bbox.h"
#elif CULL_HULL()
#include "stochastic/cull/hull.h"
#elif CULL_OBB()
#include "stochastic/cull/obb.h"
#elif CULL_PIXAR()
#include "stochastic/cull/pixar.h"
#elif CULL_INTERLEAVE_UVT()
#include "stochastic/cull/interleave_uvt.h"
#elif CULL_DUAL_SPACE()
#include "stochastic/cull/dual_space.h"
#elif CULL_CLIP_SPACE()
#include "stochastic/cull/clip_space.h"
#elif CULL_CLIP_SPACE_PRINTED()
#include "stochastic/cull/clip_space_printed.h"
#elif CULL_TRIM()
#include "stochastic/cull/trim.h"
#elif CULL_ZMAX()
#include "stochastic/cull/zmax.h"
#elif CULL_ZMAX_STRATA()
#include "stochastic/cull/zmax.h"
#elif CULL_ZMIN() || CULL_ZMIN_STRATA()
#include "stochastic/cull/zmin.h"
#elif CULL_BEST()
#include "stochastic/cull/best.h"
#endif
