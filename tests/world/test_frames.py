"""Rotations against numpy's linear algebra, and angles against 60-digit decimal arithmetic."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simspec.world import frames
from simspec.world.types import Pose

ANGLES = st.floats(-10, 10, allow_subnormal=False)
COMPONENT = st.floats(-1, 1, allow_subnormal=False)
POINTS = st.tuples(*[st.floats(-5, 5, allow_subnormal=False)] * 3)


@st.composite
def rotations(draw):
    raw = draw(st.tuples(*[COMPONENT] * 4))
    assume(sum(x * x for x in raw) > 1e-3)
    return frames.normalise(raw)


POSES = st.builds(Pose, POINTS, rotations())


def elementary(axis: int, turn: float) -> np.ndarray:
    """The rotation matrix about one coordinate axis, from its definition: x, y, z turn into each other in this order."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found = np.eye(3)
    found[i, i] = found[j, j] = math.cos(turn)
    found[j, i], found[i, j] = math.sin(turn), -math.sin(turn)
    return found


def homogeneous(pose: Pose) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = frames.matrix(pose.quaternion), pose.position
    return found


def series(x: float, first: int) -> float:
    """Sine (first 1) or cosine (first 0) by its Taylor series, rounded once."""
    with localcontext() as context:
        context.prec = 60
        value, term, total, k = Decimal(x), Decimal(1), Decimal(0), 0
        while k < 120:
            if k % 2 == first % 2:
                total += term if (k // 2) % 2 == 0 else -term
            k += 1
            term *= value / k
        return float(total)


@given(ANGLES)
def test_sine_and_cosine_are_rounded_correctly(x):
    quarters = round(x / (math.pi / 2))
    assume(x != quarters * (math.pi / 2) and abs(x) > 1e-30)
    assert frames.sine_cosine(x) == (series(x, 1), series(x, 0))


@pytest.mark.parametrize("quarters", range(-8, 9))
def test_right_angles_are_exact(quarters):
    assert frames.sine_cosine(quarters * (math.pi / 2)) == [(0, 1), (1, 0), (0, -1), (-1, 0)][quarters % 4]


def test_a_neighbour_of_a_right_angle_is_not_a_right_angle():
    """Only the double nearest to π/2 stands for π/2: the next one has the cosine that it has."""
    x = math.nextafter(math.pi / 2, 2)
    assert frames.sine_cosine(x)[1] == series(x, 0) != 0.0


@given(st.floats(-3.1, 3.1), st.floats(1e-3, 1e3))
def test_angle_inverts_sine_and_cosine(x, scale):
    sine, cosine = frames.sine_cosine(x)
    # the point itself is rounded: two units in the last place of the angle's size and of 1
    assert frames.angle(scale * sine, scale * cosine) == pytest.approx(x, rel=4e-16, abs=4e-16)


@pytest.mark.parametrize(("y", "x"), [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (-0.0, -1.0), (0.0, 0.0)])
def test_angle_on_the_axes(y, x):
    assert frames.angle(y, x) == math.atan2(y, x)


@given(rotations(), POINTS)
def test_a_quaternion_turns_as_the_exponential_of_its_axis_and_angle(q, v):
    """Rodrigues' formula is independent of the matrix in frames."""
    axis, s = np.array(q[1:]), math.sqrt(sum(x * x for x in q[1:]))
    assume(s > 1e-6)
    axis, turn = axis / s, 2 * math.atan2(s, q[0])
    v = np.array(v)
    expected = v * math.cos(turn) + np.cross(axis, v) * math.sin(turn) + axis * (axis @ v) * (1 - math.cos(turn))
    np.testing.assert_allclose(frames.rotate(q, tuple(v)), expected, atol=1e-13)


@given(rotations(), rotations())
def test_a_product_is_the_product_of_the_matrices(a, b):
    expected = np.array(frames.matrix(a)) @ np.array(frames.matrix(b))
    np.testing.assert_allclose(frames.matrix(frames.multiply(a, b)), expected, atol=1e-14)


@given(rotations())
def test_a_matrix_gives_its_quaternion_back(q):
    m = frames.matrix(q)
    np.testing.assert_allclose(np.array(m) @ np.array(m).T, np.eye(3), atol=1e-14)
    found = frames.from_matrix(m)
    # near w = 0 the sign of the whole may differ: both are the same rotation
    assert min(np.abs(np.subtract(found, q)).max(), np.abs(np.add(found, q)).max()) < 1e-14


@pytest.mark.parametrize("q", [(0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)])
def test_half_turns_come_through_a_matrix(q):
    assert frames.from_matrix(frames.matrix(q)) == q


@given(st.tuples(*[st.floats(-100, 100)] * 4))
def test_normalised_quaternions_are_unique(raw):
    assume(sum(x * x for x in raw) > 1e-6)
    q = frames.normalise(raw)
    assert math.fsum(x * x for x in q) == pytest.approx(1, abs=1e-15)
    assert next(x for x in q if x != 0.0) > 0.0
    assert frames.normalise(q) == q
    assert frames.normalise(tuple(-x for x in raw)) == q


def test_a_zero_quaternion_is_refused():
    with pytest.raises(ValueError, match="zero quaternion"):
        frames.normalise((0.0, 0.0, 0.0, 0.0))


@given(ANGLES, ANGLES, ANGLES)
def test_rpy_is_about_fixed_axes_as_in_urdf(roll, pitch, yaw):
    expected = elementary(2, yaw) @ elementary(1, pitch) @ elementary(0, roll)
    np.testing.assert_allclose(frames.matrix(frames.from_rpy(roll, pitch, yaw)), expected, atol=1e-14)


@given(rotations())
def test_rpy_of_a_rotation_makes_it_again(q):
    roll, pitch, yaw = frames.to_rpy(q)
    assert -math.pi / 2 <= pitch <= math.pi / 2
    np.testing.assert_allclose(frames.matrix(frames.from_rpy(roll, pitch, yaw)), frames.matrix(q), atol=1e-14)


@pytest.mark.parametrize("off", [0.0, 1e-16, 1e-12, 1e-9, 1e-7, 1e-3])
@pytest.mark.parametrize("sign", [-1, 1])
def test_rpy_keeps_its_precision_at_gimbal_lock(off, sign):
    q = frames.from_rpy(0.7, sign * (math.pi / 2 - off), -1.1)
    np.testing.assert_allclose(frames.matrix(frames.from_rpy(*frames.to_rpy(q))), frames.matrix(q), atol=1e-14)


@given(rotations())
def test_euler_angles_are_about_turning_axes(q):
    a, b, c = frames.to_euler_xyz(q)
    np.testing.assert_allclose(elementary(0, a) @ elementary(1, b) @ elementary(2, c), frames.matrix(q), atol=1e-14)


@given(POINTS, ANGLES)
def test_axis_and_angle(raw, turn):
    length = math.sqrt(sum(x * x for x in raw))
    assume(length > 1e-3)
    axis = tuple(x / length for x in raw)
    q = frames.from_axis_angle(axis, turn)
    np.testing.assert_allclose(frames.rotate(q, axis), axis, atol=1e-14)
    assert np.trace(frames.matrix(q)) == pytest.approx(1 + 2 * math.cos(turn), abs=1e-13)
    across = np.cross(axis, (axis[1], axis[2], -axis[0]))
    assume(np.linalg.norm(across) > 1e-3)
    turned = np.cross(across, frames.rotate(q, tuple(across))) @ np.array(axis) / (across @ across)
    assert turned == pytest.approx(math.sin(turn), abs=1e-8)  # right-handed; the small `across` costs digits


@given(POSES, POSES)
def test_composed_poses_are_multiplied_homogeneous_matrices(a, b):
    np.testing.assert_allclose(homogeneous(frames.compose(a, b)), homogeneous(a) @ homogeneous(b), atol=1e-13)


@given(POSES)
def test_an_inverse_undoes_its_pose(a):
    np.testing.assert_allclose(homogeneous(frames.inverse(a)), np.linalg.inv(homogeneous(a)), atol=1e-13)


@given(rotations(), st.tuples(*[st.floats(-3, 3)] * 6))
def test_an_inertia_is_turned_from_both_sides(q, inertia):
    xx, yy, zz, xy, xz, yz = inertia
    full, r = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), np.array(frames.matrix(q))
    expected = r @ full @ r.T
    found = frames.rotate_inertia(q, inertia)
    np.testing.assert_allclose(found, expected[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)], atol=1e-13)


@settings(max_examples=20)
@given(st.tuples(POINTS, POINTS))
def test_vectors(both):
    a, b = both
    np.testing.assert_array_equal(frames.add(a, b), np.add(a, b))
    np.testing.assert_array_equal(frames.subtract(a, b), np.subtract(a, b))
    np.testing.assert_allclose(frames.cross(a, b), np.cross(a, b), atol=1e-13)
    assert frames.dot(a, b) == pytest.approx(np.dot(a, b), abs=1e-13)


def test_a_quarter_turn_leaves_no_dust():
    """90° about z has no x and y parts at all, and w and z that differ by rounding only."""
    q = frames.from_rpy(0.0, 0.0, math.pi / 2)
    assert (q[1], q[2]) == (0.0, 0.0)
    assert (q[0], q[3]) == pytest.approx((math.sqrt(0.5),) * 2, rel=2.3e-16)
    np.testing.assert_allclose(frames.rotate(q, (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0), atol=3e-16)
