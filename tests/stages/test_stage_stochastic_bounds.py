"""Stage "bounds" of point sampling: what is known of each path, against points on its triangle."""

from __future__ import annotations

import numpy as np
import pytest
from reference.rays import at_time, is_front
from support.stage_triangles import bounds_of, draw, points_on

COUNT = 1024
CORNER = (2000, 1072)


@pytest.mark.parametrize("seed", range(2))
def test_what_is_seen_of_a_path_lies_within_its_bounds(seed):
    of = draw(seed, COUNT, CORNER, segments=True)
    found = bounds_of(of)
    path, tau, share = points_on(of, seed)
    now = at_time(of.points[path], tau)
    w = (share * now[..., 2]).sum(axis=1)
    seen = w > 0
    assert np.all(found["near"][path][seen] <= w[seen])
    assert np.all(w[seen] <= found["far"][path][seen])
    culled = (found["flags"] & 1).astype(bool)
    single = (found["flags"] & 2).astype(bool)
    assert np.array_equal(single, of.single_sided)
    visible = seen & (is_front(now) | ~single[path])
    shown = np.bincount(path[visible], minlength=COUNT)
    assert np.all(shown[culled] == 0)
    # What never turns its front is left out, but for those of which rounding might say otherwise.
    assert np.mean(culled[(shown == 0) & single]) > 0.6
    assert np.count_nonzero(culled) > 50
    ahead = (of.points[..., 2] > 0).all(axis=(1, 2))
    least, most = of.points[..., 2].min(axis=(1, 2)), of.points[..., 2].max(axis=(1, 2))
    assert found["near"][ahead] == pytest.approx(least[ahead], rel=2e-6)
    assert found["far"][ahead] == pytest.approx(most[ahead], rel=2e-6)
    assert np.all(np.isinf(found["far"][~ahead & ~culled]))


def test_scales_are_powers_of_two_that_bring_vertices_near_one():
    of = draw(5, COUNT, CORNER)
    circle = np.random.default_rng(5).choice([0.0, 1.0, 1e6], of.points.shape[:3])
    circle[:, 1] = circle[:, 0]  # as it is for what rests
    found = bounds_of(of, circle)
    assert np.all(np.frexp(found["scale"])[0] == 0.5)
    size = np.abs(of.points[..., :2]).max(axis=3) + 4096.0 * np.abs(of.points[..., 2])
    size = np.maximum(size, np.abs(circle)).max(axis=(1, 2)) * found["scale"]
    assert np.all((size >= 1.0) & (size < 2.0))
