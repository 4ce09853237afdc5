"""Translucent surfaces: closed forms, the float64 twin, any order, hard cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.closed_forms import UNIT_CAMERA, overlap, rectangle, scene, slab, slab_times, world
from support.kernels import render_with
from support.nightly import nightly
from support.random_triangles import triangles
from support.translucent_scenes import CASES, SIZE, blended, glass, made, textured, twin

import mbinterval as mb
from mbinterval.errors import UsageError
from mbinterval.scene.model import Material, Mesh, Scene, Shutter, Texture


def pane(left: float, right: float, speed: float, w: float, color, opacity: float) -> Mesh:
    """A slab over all rows; opaque at opacity 1."""
    plain = slab(rectangle(left, right, -50, 50), (speed, 0), w, SIZE, color)
    return replace(plain, material=glass(opacity))


def film(of: Scene, samples: int = 1, **settings: object) -> mb.Film:
    settings = {"samples": samples} | settings
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=mb.Settings(**settings))


def contents(of: mb.Film) -> tuple[bytes, bytes, bytes]:
    return of.rgba.tobytes(), of.depth.tobytes(), of.intervals.tobytes()


# The twin


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


PARTS = ("over what moves", "at rest", "lit", "textured, at rest", "ignored")
"""Of what "everything" has together, for the night alone."""


@pytest.mark.parametrize("seed", [1, nightly(2)])
@pytest.mark.parametrize(
    "name", [nightly(name) if name in (*PARTS, "everything") else name for name in CASES]
)
def test_random_scenes_agree_with_the_twin(name, seed):
    of, settings = made(name, seed)
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings)
    truth = twin(of, settings)
    error = found.rgba - truth.rgba
    print(f"\n{name}: RMSE {rms(error):.1e}, greatest {np.abs(error).max():.1e}")
    assert rms(error) < 1e-5
    assert np.abs(error).max() < 1e-3
    covered = found.rgba[..., 3] > 1e-2
    assert found.depth[covered] == pytest.approx(truth.depth[covered], rel=2e-4)
    assert np.all(found.intervals <= truth.intervals + 1)


@pytest.mark.parametrize("name", ["constant", "tested", "vertices", nightly("lit")])
def test_a_hundredth_of_the_shutter_or_of_opacity_is_noticed(name):
    of, settings = made(name, 1)
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings)
    assert rms(found.rgba - twin(of, settings, 0.01).rgba) > 1e-4
    thinner = replace(
        of,
        meshes=[
            replace(m, material=replace(m.material, opacity=0.99 * m.material.opacity))
            for m in of.meshes
        ],
    )
    assert rms(found.rgba - twin(thinner, settings).rgba) > 1e-4


# Closed forms, at the centres of pixels

RED, GREEN, BLUE = np.eye(3)


def blend(layers: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Premultiplied colour and alpha of (alpha, colour) front to back."""
    result, rest = np.zeros(4), 1.0
    for alpha, color in layers:
        result += rest * alpha * np.append(color, 1.0)
        rest *= 1.0 - alpha
    return result


def test_a_moving_pane_over_a_moving_wall():
    back = (0.3, 0.2, 0.1)
    of = scene([pane(-6, 10, 20, 2.0, RED, 0.25), pane(30, 44, -18, 3.0, GREEN, 1.0)], back)
    found = film(of, transparent=True)
    x = np.arange(SIZE[0]) + 0.5
    glassy, wall = slab_times(x, -6, 10, 20), slab_times(x, 30, 44, -18)
    both = overlap(glassy, wall)
    alone, bare = glassy[1] - glassy[0] - both, wall[1] - wall[0] - both
    parts = (both, blend([(0.25, RED), (1, GREEN)])), (alone, blend([(0.25, RED)])), (
        bare, blend([(1, GREEN)]),
    )  # fmt: skip
    want = sum(np.multiply.outer(share, color) for share, color in parts)
    assert both.max() > 0.2
    assert np.abs(found.rgba - want).max() < 2e-6
    over = want[:, :3] + (1 - want[:, 3:]) * back
    assert np.abs(film(of).rgba[..., :3] - over).max() < 2e-6
    seen = want[:, 3] > 0
    far = 2.0 * 0.25 * (both + alone) + 3.0 * (0.75 * both + bare)
    assert found.depth[7, seen] == pytest.approx((far[seen] / want[seen, 3]), rel=1e-5)
    assert np.all(np.isinf(found.depth[7, ~seen]))


def passing(near: float, far: float, color: np.ndarray, opacity: float) -> Mesh:
    """A pane over the whole frame that goes from one depth to another."""
    corners = rectangle(-50, 100, -50, 80)
    ends = np.stack([world(corners, w, SIZE) for w in (near, far)])
    faces = [[0, 1, 2], [0, 2, 3]]
    return Mesh(positions=ends, faces=faces, color=color, material=glass(opacity))


@pytest.mark.parametrize("wall", [False, True])
def test_panes_that_pass_through_each_other_change_order_when_they_meet(wall):
    # 2 + 2 t and 4 - 3 t meet at 0.4; the wall stands at 2.5, where they come to and from it.
    of = scene([passing(2, 4, RED, 0.5), passing(4, 1, GREEN, 0.25)])
    red, green, blue = (0.5, RED), (0.25, GREEN), (1.0, BLUE)
    want = 0.4 * blend([red, green]) + 0.6 * blend([green, red])
    if wall:
        of = replace(of, meshes=[*of.meshes, pane(-50, 100, 0, 2.5, BLUE, 1.0)])
        # Red is before it until 0.25, green from 0.5 on.
        want = 0.25 * (blend([red, blue]) + blend([blue])) + 0.5 * blend([green, blue])
    found = film(of, transparent=True)
    assert np.abs(found.rgba - want).max() < 1e-6


@pytest.mark.parametrize("count", [40, 3000])
def test_thousands_of_panes_on_one_pixel_all_count(count):
    """Half-planes that arrive one after the other, each before those that are there already."""
    rng = np.random.default_rng(3)
    color, speed = rng.uniform(0, 1, (count, 3)), 100.0
    alpha = rng.uniform(0, 0.3, count).astype(np.float32)
    arrival = (np.arange(count)[::-1] + 0.5) / count
    edge = 4.5 - speed * arrival
    start = np.stack([np.stack([edge, edge * 0 - 5000], 1), np.stack([edge, edge * 0 + 5000], 1),
                      np.stack([edge - 5000, edge * 0], 1)], axis=1)  # fmt: skip
    w = 1.0 + 1e-3 * np.arange(count)[:, None]
    positions = world(np.stack([start, start + [speed, 0]]), w, (9, 3)).reshape(2, -1, 3)
    order = rng.permutation(count)
    mesh = Mesh(
        positions=positions, faces=np.arange(3 * count).reshape(-1, 3)[order],
        color=np.column_stack([color, alpha])[order], color_domain="face",
        material=glass(1.0, alpha_mode="blend"),
    )  # fmt: skip
    found = mb.render(
        scene([mesh]), width=9, height=3, crop=(4, 1, 1, 1), settings=mb.Settings(samples=1)
    )
    blended, total = np.zeros(4), np.zeros(4)
    for k in range(count)[::-1]:  # in order of arrival
        blended = alpha[k] * np.append(color[k], 1.0) + (1.0 - alpha[k]) * blended
        total += blended * ((arrival[k - 1] if k else 1.0) - arrival[k])
    assert found.intervals.tolist() == [[count]]
    assert found.rgba[0, 0] == pytest.approx(total, abs=1e-5)


def test_what_is_seen_at_one_moment_is_what_a_still_scene_shows():
    of, settings = made("everything", 3)
    of = replace(of, camera=UNIT_CAMERA, shutter=Shutter(open=0, close=1))
    settings = replace(settings, aovs=("sharp",), aov_time=0.25, texture_samples=1)

    def frozen(mesh: Mesh) -> Mesh:
        def at(values: np.ndarray | None, rank: int) -> np.ndarray | None:
            varies = values is not None and values.ndim == rank
            return 0.75 * values[0] + 0.25 * values[1] if varies else values

        return replace(
            mesh, positions=at(mesh.positions, 3), normals=at(mesh.normals, 3),
            color=at(mesh.color, 3),
        )  # fmt: skip

    sharp = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).layers["sharp"]
    still = replace(of, meshes=[frozen(mesh) for mesh in of.meshes])
    settings = replace(settings, aovs=())
    want = mb.render(still, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    # A point at an edge, or on a texel's threshold, may fall to either side.
    differ = np.abs(sharp - want).max(axis=-1) > 1e-4
    assert differ.mean() < 0.01
    moved = replace(still, camera=replace(UNIT_CAMERA, position=(0.02, 0, 0)))
    other = mb.render(moved, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    assert (np.abs(sharp - other).max(axis=-1) > 1e-4).mean() > 0.2


def test_layers_at_a_moment_are_of_the_first_surface_of_half_alpha():
    """As Cycles' pass_alpha_threshold of 0.5 has it, for each surface alone."""
    image = np.ones((1, 2, 4))
    image[0, :, 3] = 0.2, 0.7  # half way between the centres of texels at 16 and 32 it is 0.45
    corners = rectangle(0, 48, -50, 82)
    ends = np.stack([world(corners, w, SIZE) for w in (2.0, 3.0)])
    uv = corners / [48, 132] * [1, -1] + [0, 0.5]
    material = glass(1.0, texture=Texture(image, wrap="clamp"), alpha_mode="blend")
    half = Mesh(positions=ends, faces=[[0, 1, 2], [0, 2, 3]], uv=uv, material=material)
    meshes = [
        passing(1.0, 1.5, RED, 0.45), half, passing(3.0, 4.0, GREEN, 0.5),
        pane(-50, 100, 3, 9.0, BLUE, 1.0),
    ]  # fmt: skip
    found = film(scene(meshes), aovs=("depth", "object"), aov_time=0.5).layers
    # 0.2 + 0.5 (x - 12) / 24 is a half at 26.4.
    seen = np.arange(48) + 0.5 > 26.4
    assert np.all(found["object"] == np.where(seen, 2, 3))
    assert found["depth"] == pytest.approx(np.tile(np.where(seen, 2.5, 3.5), (32, 1)), rel=1e-5)
    tested = replace(material, alpha_mode="mask", alpha_cutoff=0.6)  # from 31.2 on
    meshes[1] = replace(half, material=tested)
    found = film(scene(meshes), aovs=("depth", "object"), aov_time=0.5).layers
    assert np.all(found["object"] == np.where(np.arange(48) + 0.5 > 31.2, 2, 3))


# What does not matter


def shuffled(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    order = rng.permutation(len(mesh.faces))
    by_face = mesh.color is not None and mesh.color_domain == "face"
    color = mesh.color[order] if by_face else mesh.color
    return replace(mesh, faces=mesh.faces[order], color=color)


@pytest.mark.parametrize(
    ("name", "tile"),
    [("everything", 8), nightly("constant", 8), nightly("at rest", 32),
     nightly("constant", 32), nightly("at rest", 8), nightly("everything", 32)],
)  # fmt: skip
def test_any_order_of_triangles_and_any_tile_give_the_same_bytes(name, tile):
    of, settings = made(name, 5)
    whole = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings)
    rng = np.random.default_rng(1)
    other = replace(of, meshes=[shuffled(mesh, rng) for mesh in of.meshes][::-1])
    again = mb.render(other, width=SIZE[0], height=SIZE[1], settings=settings)
    assert contents(again) == contents(whole)
    settings_of_tile = replace(settings, tile_size=tile)
    sized = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings_of_tile)
    assert contents(sized) == contents(whole)
    part = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings, crop=(9, 5, 21, 19))
    assert np.array_equal(part.rgba, whole.rgba[5:24, 9:30])


@pytest.mark.parametrize("name", ["constant", "everything"])
def test_pools_of_any_size_give_the_same_bytes(name):
    of, settings = made(name, 6)
    large = render_with(of, settings, *SIZE)
    for capacity in (1, 40, 600):
        small = render_with(of, settings, *SIZE, capacity=capacity)
        for part in ("rgba", "depth", "intervals"):
            assert np.array_equal(getattr(small, part), getattr(large, part)), (capacity, part)


def test_what_changes_behind_a_wall_does_not_cut_what_is_before_it():
    """Else a pane's texture would be read at other times."""
    rng = np.random.default_rng(4)
    front = replace(textured(rng, "blend"), color=None)
    wall = pane(-50, 100, 3, 6.0, BLUE, 1.0)
    hidden = blended(rng, 40)
    away = hidden.positions * 8.0  # the same picture, behind the wall
    alone = scene([front, wall])
    both = scene([front, wall, replace(hidden, positions=away)])
    assert np.array_equal(film(both).rgba, film(alone).rgba)
    assert not np.array_equal(film(scene([front, hidden, wall])).rgba, film(alone).rgba)


# Hard cases


@pytest.mark.parametrize("speed", [0.0, 4.0])
def test_of_coplanar_panes_the_first_is_in_front(speed):
    panes = [pane(-50, 100, speed, 2.0, color, 0.5) for color in (RED, GREEN, BLUE)]
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        found = film(scene([panes[k] for k in order]), transparent=True)
        want = blend([(0.5, np.eye(3)[k]) for k in order])
        assert np.abs(found.rgba - want).max() < 1e-6


def test_a_wall_at_the_same_depth_hides_panes_that_come_after_it():
    wall, glassy = pane(-50, 100, 4.0, 2.0, BLUE, 1.0), pane(-50, 100, 4.0, 2.0, RED, 0.5)
    assert np.abs(film(scene([wall, glassy])).rgba - [0, 0, 1, 1]).max() < 1e-6
    assert np.abs(film(scene([glassy, wall])).rgba - [0.5, 0, 0.5, 1]).max() < 1e-6


def test_a_closed_sheet_covers_each_sample_once():
    """Its triangles share edges and vertices on the samples: no gap, no double cover."""
    x, y = np.meshgrid(np.linspace(-8, 56, 65), np.linspace(-8, 40, 49))
    corners = world(np.stack([x, y], -1).reshape(-1, 2) + 0.5, 2.0, SIZE)
    index = np.arange(x.size).reshape(x.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1)
    quads = quads.reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    ends = np.stack([corners, corners + [0.125, 0.0625, 0.0]])
    mesh = Mesh(positions=ends, faces=faces, color=(1, 1, 1), material=glass(0.5))
    assert np.abs(film(scene([mesh])).rgba - 0.5).max() < 1e-6


def test_full_opacity_is_opaque_to_the_bit_and_none_is_nothing():
    rng = np.random.default_rng(7)
    plain = [triangles(rng, 20), triangles(rng, 9, 1)]
    background = (0.2, 0.3, 0.4)

    def given(**fields: object) -> mb.Film:
        meshes = [replace(m, material=Material(shading="unlit", **fields)) for m in plain]
        return film(scene(meshes, background))

    whole = given()
    assert contents(given(alpha_mode="blend")) == contents(whole)
    assert contents(given(alpha_mode="opaque", opacity=0.2)) == contents(whole)
    assert contents(given(alpha_mode="mask", opacity=0.6)) == contents(whole)
    for fields in ({"opacity": 0.0}, {"alpha_mode": "mask", "opacity": 0.4}):
        empty = given(**fields)
        assert np.all(empty.rgba == np.float32([*background, 0.0]))
        assert np.all(np.isinf(empty.depth))
    assert not np.array_equal(given(opacity=0.999).rgba, whole.rgba)


def test_where_no_light_passes_what_lies_behind_is_left_out():
    panes = [pane(-50, 100, 3, 2.0 + 0.1 * k, RED, 0.999) for k in range(12)]
    found = film(scene([*panes, pane(-50, 100, 3, 9.0, GREEN, 1.0)]))
    assert found.rgba[0, 0] == pytest.approx([1, 0, 0, 1], abs=3e-6)
    assert found.rgba[0, 0, 1] == 0.0
    assert found.rgba[0, 0, 3] < 1.0


@pytest.mark.parametrize("values", [{"paths": "triangulated"}, {"occlusion": 64}])
def test_masks_and_triangulated_paths_refuse_what_is_translucent(values):
    of = scene([pane(0, 9, 3, 2.0, RED, 0.5)])
    with pytest.raises(UsageError, match=r"translucent needs paths='exact' and .*alpha_mode"):
        film(of, **values)
    film(scene([pane(0, 9, 3, 2.0, RED, 1.0)]), **values)
