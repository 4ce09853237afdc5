"""Keys and transforms against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from mbinterval.errors import SceneError
from mbinterval.scene.formats.load import load
from mbinterval.scene.rotations import quaternion_matrix, quaternion_product, slerp
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform


def about(axis, degrees):
    """Rotation matrix by Rodrigues' formula, independent of quaternions."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def quaternion(axis, degrees):
    half = np.radians(degrees) / 2
    return np.append(np.sin(half) * np.asarray(axis, float) / np.linalg.norm(axis), np.cos(half))


def transform_of(**fields):
    table = {"objects": [{"primitive": {"kind": "box"}, "transform": fields}]}
    return load(table).meshes[0].transform


@pytest.mark.parametrize("angle", [1e-8, 1e-3, 30.0, 90.0, 179.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_slerp_turns_at_constant_speed_the_short_way(angle, sign):
    axis = (1, 2, -3)
    start, end = quaternion(axis, 10), sign * quaternion(axis, 10 + angle)
    for part in (0.0, 0.2, 0.5, 0.9, 1.0):
        matrix = quaternion_matrix(slerp(start, end, part))
        np.testing.assert_allclose(matrix, about(axis, 10 + part * angle), atol=1e-14)
    wrong = quaternion_matrix((start + sign * 0.8 * end) / 2)  # nlerp is not slerp
    if angle >= 90:
        assert np.abs(wrong - about(axis, 10 + 0.4 * angle)).max() > 1e-3


def test_quaternion_product_is_the_product_of_the_matrices():
    a, b = quaternion((1, 2, 3), 40), quaternion((-1, 0, 1), 100)
    product = quaternion_matrix(quaternion_product(a, b))
    np.testing.assert_allclose(product, about((1, 2, 3), 40) @ about((-1, 0, 1), 100), atol=1e-15)
    reverse = quaternion_matrix(quaternion_product(b, a))
    assert np.abs(product - reverse).max() > 0.1


@pytest.mark.parametrize("order", ["xyz", "zyx", "yzx"])
def test_euler_angles_turn_about_fixed_axes_in_the_stated_order(order):
    degrees = {"x": 20.0, "y": 50.0, "z": -70.0}
    matrix = transform_of(euler=[20, 50, -70], euler_order=order).at(0)[:3, :3]
    expected = np.eye(3)
    for axis in order:
        expected = about(np.eye(3)["xyz".index(axis)], degrees[axis]) @ expected
    np.testing.assert_allclose(matrix, expected, atol=1e-14)


@pytest.mark.parametrize("turn", [40.0, 179.0, 180.0, 360.0, -720.0, 1000.0])
def test_euler_keys_make_the_turns_that_they_say(turn):
    keys = [{"frame": 0, "euler": [0, 0, 5]}, {"frame": 8, "euler": [0, 0, 5 + turn]}]
    transform = transform_of(keys=keys)
    for frame in np.linspace(0, 8, 23):
        expected = about((0, 0, 1), 5 + turn * frame / 8)
        np.testing.assert_allclose(transform.at(frame)[:3, :3], expected, atol=1e-12)


@pytest.mark.parametrize("order", ["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"])
def test_each_euler_angle_goes_its_own_way(order):
    start, end = np.array([10.0, -20.0, 5.0]), np.array([180.0, 150.0, -700.0])
    keys = [{"frame": 0, "euler": start.tolist()}, {"frame": 1, "euler": end.tolist()}]
    transform = transform_of(keys=keys, euler_order=order)
    expected = np.eye(3)
    for axis in order:
        index = "xyz".index(axis)
        angle = 0.7 * start[index] + 0.3 * end[index]
        expected = about(np.eye(3)[index], angle) @ expected
    np.testing.assert_allclose(transform.at(0.3)[:3, :3], expected, atol=1e-12)


def test_step_keys_hold_the_latest_value():
    keys = [{"frame": f, "translation": [v, 0, 0]} for f, v in [(1, 10), (2, 20), (4, 40)]]
    transform = transform_of(keys=keys, interpolation="step")
    at = [transform.at(f)[0, 3] for f in (0, 1, 1.999, 2, 3.9, 4, 9)]
    assert at == [10, 10, 10, 20, 20, 40, 40]
    linear = transform_of(keys=keys)
    assert [linear.at(f)[0, 3] for f in (0, 1.5, 3, 9)] == [10, 15, 30, 40]


def test_keys_hold_what_they_mention():
    keys = [
        {"frame": 0, "translation": [0, 0, 0], "scale": 1},
        {"frame": 5, "scale": [3, 1, 1]},
        {"frame": 10, "translation": [10, 0, 0], "rotation": [0, 0, 1, 0]},
    ]
    matrix = transform_of(keys=keys).at(4)
    assert matrix[0, 3] == 4
    np.testing.assert_allclose(matrix[:3, :3], np.diag([-2.6, -1, 1]), atol=1e-15)


def test_a_transform_is_parent_times_translation_rotation_scale_matrix():
    rng = np.random.default_rng(1)
    inner, outer = rng.normal(size=(2, 4, 4))
    inner[3] = outer[3] = (0, 0, 0, 1)
    child = Transform((1, 2, 3), tuple(quaternion((1, 1, 0), 70)), (2, 3, 4), inner)
    child = Transform(
        child.translation, child.rotation, child.scale, inner, Transform(matrix=outer)
    )
    local = np.eye(4)
    local[:3, :3] = about((1, 1, 0), 70) @ np.diag([2, 3, 4])
    local[:3, 3] = (1, 2, 3)
    np.testing.assert_allclose(child.at(0), outer @ local @ inner, atol=1e-13)


def test_a_thousand_levels_of_hierarchy():
    node = None
    for _ in range(5000):
        node = Transform(translation=(1, 0, 0), parent=node)
    assert node.at(0)[0, 3] == 5000


def test_cubic_rotation_is_normalized():
    values = np.zeros((2, 3, 4))
    values[:, 1] = quaternion((0, 0, 1), 0), quaternion((0, 0, 1), 90)
    track = Track(np.array([0.0, 1.0]), values, "cubic", quaternion=True)
    np.testing.assert_allclose(track.at(0.5), quaternion((0, 0, 1), 45), atol=1e-15)
    np.testing.assert_allclose(track.at(1.0), values[1, 1])
    assert np.linalg.norm(track.at(0.2)) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("frames", "values", "options", "message"),
    [
        ([0, 1], [[1.0]], {}, "as many times as values"),
        ([1, 1], [[1.0], [2.0]], {}, "must increase"),
        ([0, 1], [[1.0], [np.inf]], {}, "must be finite"),
        ([0], [[1.0]], {"interpolation": "spline"}, "interpolation='spline'"),
        ([0], [[1.0, 2.0]], {"interpolation": "cubic"}, "expected \\(n, 3, d\\)"),
        ([0], [[0.0] * 4], {"quaternion": True}, "non-zero quaternions"),
    ],
)
def test_bad_tracks_are_scene_errors(frames, values, options, message):
    with pytest.raises(SceneError, match=message):
        Track(np.array(frames), np.array(values), **options)
