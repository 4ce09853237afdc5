"""Deep images: what samples in depth say in closed form, and that "over" gives back the film."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from support.closed_forms import UNIT_CAMERA, overlap, rectangle, slab, slab_times, world
from support.oclgrind_scenes import seen_through
from support.panes import pane

import mbinterval as mb
from mbinterval.device import records
from mbinterval.errors import OutputError, UsageError
from mbinterval.film.deep import Slices
from mbinterval.scene.model import Mesh, Scene

SIZE = (32, 16)
X = np.arange(32) + 0.5


def film(*meshes: Mesh, background=(0.2, 0.1, 0.4), **settings: object) -> mb.Film:
    of = Scene(meshes=meshes, camera=UNIT_CAMERA, background=background)
    chosen = mb.Settings(aovs="deep", **({"samples": 1} | settings))
    return mb.render(of, width=32, height=16, settings=chosen)


def samples_of(deep: mb.DeepImage, y: int, x: int) -> np.ndarray:
    """``(n, 6)``: Z, ZBack, R, G, B, A of a pixel."""
    ends = np.append(0, np.cumsum(deep.counts.ravel(), dtype=np.int64))
    place = y * deep.counts.shape[1] + x
    part = np.s_[ends[place] : ends[place + 1]]
    return np.column_stack([deep.z[part], deep.z_back[part], deep.rgba[part]])


def over(image: np.ndarray, background) -> np.ndarray:
    rgb = image[..., :3] + (1 - image[..., 3:]) * np.asarray(background)
    return np.concatenate([rgb, image[..., 3:]], axis=2)


def test_shares_of_time_become_alphas_of_what_is_left_open():
    near = slab(rectangle(4.25, 9.25, -50, 50), (12, 0), 2.0, SIZE, (0.9, 0.2, 0.1))
    far = slab(rectangle(-3.5, 30.0, -50, 50), (-20, 0), 4.0, SIZE, (0.1, 0.3, 0.8))
    deep = film(near, far).deep
    front, back = slab_times(X, 4.25, 9.25, 12), slab_times(X, -3.5, 30.0, -20)
    c1 = front[1] - front[0]
    c2 = back[1] - back[0] - overlap(front, back)
    both = (c1 > 1e-3) & (c2 > 1e-3) & (c1 < 0.999)
    assert both.sum() > 8
    for x in np.flatnonzero(both):
        found = samples_of(deep, 7, x)
        a2 = c2[x] / (1 - c1[x])  # not c2: that is what the near one leaves open
        want = [
            [2.0, 2.0, 0.9 * c1[x], 0.2 * c1[x], 0.1 * c1[x], c1[x]],
            [4.0, 4.0, 0.1 * a2, 0.3 * a2, 0.8 * a2, a2],
        ]
        assert found == pytest.approx(np.array(want), abs=3e-6)
        with pytest.raises(AssertionError):
            assert found[1, 5] == pytest.approx(c2[x], abs=3e-6)


def test_what_changes_its_depth_lies_in_the_slices_that_it_passes():
    """A wall that comes from depth 4 to 2, evenly: what is nearer than z has (4 - z) / 2 less."""
    ends = [world(rectangle(-90, 120, -90, 110), w, SIZE) for w in (4.0, 2.0)]
    wall = Mesh(np.stack(ends), [[0, 1, 2], [0, 2, 3]], shading="unlit", motion_segments=1)
    tolerance = 0.05
    deep = film(wall, deep_tolerance=tolerance).deep
    found = samples_of(deep, 8, 16)
    z, back, alpha = found[:, 0], found[:, 1], found[:, 5]
    assert len(z) == pytest.approx(np.log(2) / np.log1p(tolerance), abs=2)
    assert (back <= z * (1 + tolerance) * (1 + 1e-6)).all()
    assert z[1:] == pytest.approx(back[:-1])
    assert (z[0], back[-1]) == (pytest.approx(2.0), pytest.approx(4.0))
    left = np.cumprod(1 - alpha)
    assert 1 - left == pytest.approx((back - 2.0) / 2.0, abs=1e-5)
    assert film(wall, deep_tolerance=1.0).deep.counts.max() <= 2


@pytest.mark.parametrize("tolerance", [0.001, 0.01, 0.5])
def test_samples_are_in_order_apart_and_give_back_the_film(tolerance):
    background = (0.7, 0.2, 0.4)
    found = film(*seen_through(), background=background, deep_tolerance=tolerance)
    deep = found.deep
    assert np.abs(over(deep.flatten(), background) - found.rgba).max() < 2e-6
    first = np.cumsum(deep.counts.ravel(), dtype=np.int64) - deep.counts.ravel()
    inside = np.ones(len(deep.z), bool)
    inside[first[deep.counts.ravel() > 0]] = False
    assert (deep.z_back >= deep.z).all()
    assert (deep.z[1:] >= deep.z_back[:-1])[inside[1:]].all()
    assert (deep.rgba[:, 3] <= 1).all()
    assert (deep.rgba[:, 3] > 0).all()
    spread = deep.z_back / deep.z
    assert np.quantile(spread, 0.99) <= (1 + tolerance) * (1 + 1e-5)


def test_coverage_that_adds_up_to_one_a_little_late_or_early_stays_within_a_millionth():
    rng = np.random.default_rng(5)
    count, size = 400, 40
    events = np.zeros(count * size, records.EVENT)
    events["pixel"] = np.repeat(np.arange(count), size)
    weight = rng.dirichlet(np.full(size, 0.05), count)  # some are far below what is told apart
    events["weight"] = (weight * rng.uniform(0.999999, 1.000001, (count, 1))).ravel()
    events["color"][:, 3] = 1.0
    events["color"][:, :3] = rng.uniform(0, 9, (count * size, 3))
    ends = rng.uniform(1, 50, (2, count * size)) * 10.0 ** rng.integers(-6, 6, count * size)
    events["z0"], events["z1"] = ends
    slices = Slices(0.02, (20, 20))
    slices.take(events)
    deep = slices.result()
    colour = events["color"] * events["weight"][:, None].astype(np.float64)
    want = np.stack([np.bincount(events["pixel"], c, count) for c in colour.T], axis=1)
    flat = deep.flatten().reshape(-1, 4)
    assert np.abs(flat[:, 3] - np.minimum(want[:, 3], 1)).max() < 2e-6
    assert np.abs(flat - want).max() < 2e-5  # colours go up to 9
    assert np.isfinite(deep.rgba).all()
    assert deep.rgba[:, :3].max() < 9.01


def test_programs_that_are_not_ours_read_it_and_flatten_it_to_the_film(tmp_path):
    found = film(*seen_through(), samples=2, transparent=True)
    path = found.write(tmp_path / "a.deep.exr")
    image = oiio.ImageBuf(str(path))
    assert image.spec().deep
    assert image.spec().channelnames == ("R", "G", "B", "A", "Z", "ZBack")
    counts = [[image.deep_samples(x, y) for x in range(32)] for y in range(16)]
    assert np.array_equal(counts, found.deep.counts)
    flat = oiio.ImageBufAlgo.flatten(image).get_pixels(oiio.FLOAT)
    assert np.abs(flat[..., :4] - found.rgba).max() < 1e-6
    assert image.spec().getattribute("software").startswith("mbinterval")


def test_a_file_has_all_of_it_is_the_same_each_time_and_reads_back(tmp_path):
    of = Scene(meshes=[pane("a", 4, 9, 12, 2.0, 0.4), pane("b", 0, 30, 3, 3.0)], camera=UNIT_CAMERA)
    settings = mb.Settings(aovs="deep", samples=2)
    found = mb.render(of, width=32, height=16, settings=settings, crop=(3, 2, 20, 11))
    path = found.write(tmp_path / "a.deep.exr")
    again = mb.DeepImage.read(path)
    for name in ("counts", "z", "z_back", "rgba"):
        assert np.array_equal(getattr(again, name), getattr(found.deep, name)), name
    assert (again.resolution, again.origin) == ((32, 16), (3, 2))
    assert again.metadata["settings.deep_tolerance"] == 0.01
    assert again.write(tmp_path / "b.deep.exr").read_bytes() == path.read_bytes()
    assert found.write(tmp_path / "c.DEEP.EXR").read_bytes() == path.read_bytes()
    empty = film().write(tmp_path / "empty.deep.exr")
    assert mb.DeepImage.read(empty).counts.sum() == 0


def test_what_is_no_deep_image_is_told_apart(tmp_path):
    found = film(pane("a", 4, 9, 12, 2.0))
    deep, flat = found.write(tmp_path / "a.deep.exr"), found.write(tmp_path / "a.exr")
    with pytest.raises(OutputError, match=r"is deep; mbinterval\.DeepImage"):
        mb.Film.read(deep)
    with pytest.raises(OutputError, match="not a deep EXR"):
        mb.DeepImage.read(flat)
    with pytest.raises(OutputError, match="no such file"):
        mb.DeepImage.read(tmp_path / "none.deep.exr")
    data = deep.read_bytes()
    for part in (0, 3, 200, len(data) // 2, len(data) - 9):
        (tmp_path / "cut.deep.exr").write_bytes(data[:part])
        with pytest.raises(OutputError, match=r"cut\.deep\.exr: "):
            mb.DeepImage.read(tmp_path / "cut.deep.exr")
    plain = mb.render(Scene(meshes=[], camera=UNIT_CAMERA), width=4, height=4)
    with pytest.raises(UsageError, match=r"b\.deep\.exr: the film has no deep; .*aovs='deep'"):
        plain.write(tmp_path / "b.deep.exr")
