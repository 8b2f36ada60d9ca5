"""Rotations as arrays and as plain floats: one group, one meaning, the same as that of the world's own frames."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.world import frames, rotations
from simspec.world.rotations import FEW_VECTORS, cross

COMPONENTS = st.floats(-1.0, 1.0)
VECTORS = st.tuples(COMPONENTS, COMPONENTS, COMPONENTS).map(np.array)
QUATERNIONS = (
    st.tuples(*[COMPONENTS] * 4).filter(lambda q: math.hypot(*q) > 1e-3).map(lambda q: np.array(q) / math.hypot(*q))
)
AXES = VECTORS.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))
ANGLES = st.one_of(
    st.floats(0.0, math.pi).filter(lambda angle: angle == 0.0 or angle > 1e-150),
    st.floats(-150.0, -1.0).map(lambda power: 10.0**power),
    st.floats(-15.0, -1.0).map(lambda power: math.pi - 10.0**power),
    st.sampled_from([0.0, math.pi, math.pi / 2.0]),
)
TINY = 1e-15
"""Rounding of a few operations on numbers up to 1."""


def same(a, b, tolerance=4 * TINY):
    """Whether two quaternions are one rotation."""
    return min(np.abs(np.asarray(a) - b).max(), np.abs(np.asarray(a) + b).max()) <= tolerance


@pytest.mark.parametrize("count", [0, 1, 7, FEW_VECTORS, FEW_VECTORS + 1])
def test_cross_products_are_to_the_last_bit_those_of_numpy(count):
    entry, other = np.random.default_rng(count).normal(size=(2, count, 3))
    other[::3] *= 1e200
    assert cross(entry, other).tobytes() == np.cross(entry, other).tobytes()
    assert cross(entry[:1], other).tobytes() == np.cross(entry[:1], other).tobytes()


@given(QUATERNIONS, QUATERNIONS, VECTORS)
def test_a_product_turns_by_the_second_and_then_by_the_first(a, b, v):
    turned = rotations.rotate(rotations.multiply(a, b), v)
    np.testing.assert_allclose(turned, rotations.rotate(a, rotations.rotate(b, v)), atol=10 * TINY, rtol=0)
    np.testing.assert_allclose(
        rotations.matrices(rotations.multiply(a, b)),
        rotations.matrices(a) @ rotations.matrices(b),
        atol=10 * TINY,
        rtol=0,
    )


@given(QUATERNIONS, VECTORS)
def test_the_conjugate_turns_back(q, v):
    back = rotations.rotate(rotations.conjugate(q), rotations.rotate(q, v))
    np.testing.assert_allclose(back, v, atol=10 * TINY, rtol=0)
    assert same(rotations.multiply(q, rotations.conjugate(q)), frames.IDENTITY)


@given(QUATERNIONS, VECTORS)
def test_a_matrix_turns_as_its_quaternion(q, v):
    matrix = rotations.matrices(q)
    np.testing.assert_allclose(matrix @ v, rotations.rotate(q, v), atol=10 * TINY, rtol=0)
    assert same(frames.from_matrix(tuple(map(tuple, matrix.tolist()))), q, 10 * TINY)


@given(AXES, ANGLES)
def test_a_rotation_vector_is_axis_times_angle_from_zero_to_half_a_turn(axis, angle):
    q = rotations.exponential(axis * angle)
    assert same(q, frames.from_axis_angle(tuple(axis.tolist()), angle))
    vector = rotations.logarithm(q)
    np.testing.assert_allclose(np.linalg.norm(vector), angle, rtol=1e-14, atol=1e-300)
    assert min(np.abs(vector - axis * angle).max(), np.abs(vector + axis * angle).max()) <= 1e-14 * max(angle, 1e-300)
    if angle < math.pi - 1e-14:
        np.testing.assert_allclose(vector, axis * angle, rtol=0, atol=1e-14 * angle + 1e-300)
    np.testing.assert_allclose(rotations.logarithm(-q), vector, rtol=0, atol=1e-14 if angle > 3.0 else 0.0)


@given(VECTORS.map(lambda v: 20.0 * v))
def test_a_rotation_vector_of_any_length_has_its_rotation(vector):
    q = rotations.exponential(vector)
    assert q[0] >= 0.0
    angle = float(np.linalg.norm(vector))
    assert np.linalg.norm(rotations.logarithm(q)) <= math.pi + TINY
    rest = rotations.multiply(rotations.exponential(vector / 2.0), rotations.exponential(vector / 2.0))
    assert same(q, rest, 10 * TINY * max(1.0, angle))


@given(QUATERNIONS, QUATERNIONS, VECTORS)
def test_single_and_vectorised_rotations_are_equal(a, b, v):
    many = np.tile(a, (5, 2, 1)), np.tile(b, (5, 2, 1)), np.tile(v, (5, 2, 1))
    for function, places in (
        (rotations.multiply, (0, 1)),
        (rotations.relative, (0, 1)),
        (rotations.rotation_error, (0, 1)),
        (rotations.rotate, (0, 2)),
        (rotations.cross, (2, 2)),
        (rotations.matrices, (0,)),
        (rotations.logarithm, (0,)),
        (rotations.exponential, (2,)),
        (rotations.conjugate, (0,)),
        (rotations.positive, (0,)),
        (rotations.unit, (0,)),
        (rotations.to_xyzw, (0,)),
    ):
        arguments = a, b, v
        alone = function(*(arguments[k] for k in places))
        assert (function(*(many[k] for k in places))[3, 1] == alone).all(), function.__name__


@given(QUATERNIONS, QUATERNIONS, VECTORS)
def test_plain_floats_are_the_same_as_arrays(a, b, v):
    a, b = rotations.positive(a), rotations.positive(b)
    assert same(rotations.multiply_of(a.tolist(), b.tolist()), rotations.multiply(a, b))
    np.testing.assert_allclose(rotations.logarithm_of(a.tolist()), rotations.logarithm(a), rtol=1e-15, atol=0)
    np.testing.assert_allclose(rotations.exponential_of(v.tolist()), rotations.exponential(v), rtol=1e-15, atol=0)
    assert rotations.to_xyzw_of(a.tolist()) == rotations.to_xyzw(a).tolist() == [*a[1:], a[0]]
    assert [*rotations.from_xyzw_of(a.tolist())] == rotations.from_xyzw(a).tolist() == [a[3], *a[:3]]


@given(QUATERNIONS, QUATERNIONS, VECTORS)
def test_array_functions_agree_with_the_frames_of_the_world(a, b, v):
    entry, other = tuple(a.tolist()), tuple(b.tolist())
    assert same(frames.multiply(entry, other), rotations.multiply(a, b))
    assert same(frames.conjugate(entry), rotations.conjugate(a))
    np.testing.assert_allclose(frames.rotate(entry, tuple(v.tolist())), rotations.rotate(a, v), rtol=0, atol=10 * TINY)
    assert (np.array(frames.matrix(entry)) == rotations.matrices(a)).all()
    assert same(frames.normalise(tuple((3.0 * a).tolist())), rotations.unit(3.0 * a))


@given(QUATERNIONS, AXES, ANGLES)
def test_the_error_of_a_rotation_keeps_the_digits_of_small_angles(q, axis, angle):
    turned = rotations.multiply(q, rotations.exponential(axis * angle))
    error = rotations.rotation_error(q, turned)
    assert error == pytest.approx(2.0 * math.sin(angle / 2.0), rel=1e-6, abs=4 * TINY)
    assert error == pytest.approx(float(rotations.rotation_error(q, -turned)), abs=0.0)


def test_an_engines_process_can_have_it():
    """Imported alone, it brings numpy and nothing else of a third party."""
    code = "import sys, simspec.world.rotations; print(sorted({'pydantic', 'scipy', 'lxml'} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
