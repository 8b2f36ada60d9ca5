"""The normalisations that every format shares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.dialects.kit.sidecar import sidecar_text
from simspec.formats.kit import contract
from simspec.formats.kit.text import number
from simspec.world import frames, kinematics
from simspec.world import inertia as principal
from tests import worlds

unit = st.floats(-1, 1).filter(lambda x: x == 0 or abs(x) > 1e-3)


@settings(max_examples=200, deadline=None)
@given(st.tuples(*[st.floats(1e-3, 1)] * 3), st.tuples(unit, unit, unit, unit).filter(any), st.integers(-9, 4))
def test_principal_axes_rebuild_the_tensor(parts, raw, exponent):
    scale = 10.0**exponent
    a, b, c = parts
    inertia = frames.rotate_inertia(frames.normalise(raw), tuple(scale * x for x in (b + c, a + c, a + b)) + (0.0,) * 3)
    moments, turn = principal.principal_axes(inertia)
    # 2⁻⁴⁰ ≈ 9e-13 may be clipped from a flat body's largest moment; the rest is round-off
    np.testing.assert_allclose(contract.tensor(moments, turn), inertia, rtol=0, atol=2e-12 * max(inertia[:3]))
    assert max(moments) < sum(moments) - max(moments)


def test_a_flat_body_stays_inside_the_triangle_inequality():
    moments, _ = principal.principal_axes((1.0, 2.0, 3.0000000000000004, 0.0, 0.0, 0.0))
    assert moments[2] < moments[0] + moments[1]


@settings(max_examples=100, deadline=None)
@given(st.tuples(*[st.floats(1e-3, 1)] * 2), st.tuples(unit, unit, unit, unit).filter(any), st.integers(-9, 4))
def test_a_flat_body_of_any_size_and_turn_keeps_the_margin(parts, raw, exponent):
    """The largest moment of a plate is the sum of the others: engines that sum them in another order must not find it above."""
    a, b = (10.0**exponent * part for part in parts)
    inertia = frames.rotate_inertia(frames.normalise(raw), (a, b, a + b, 0.0, 0.0, 0.0))
    moments, _ = principal.principal_axes(inertia)
    smaller, middle, largest = sorted(moments)
    assert largest <= (smaller + middle) * (1.0 - 2.0**-41)
    assert largest >= (smaller + middle) * (1.0 - 2.0**-39)


def test_a_diagonal_tensor_is_left_as_it_is():
    assert principal.principal_axes((3.0, 1.5, 2.0, 0.0, 0.0, 0.0)) == ((3.0, 1.5, 2.0), frames.IDENTITY)


def test_recentring_changes_no_physics_and_can_be_undone():
    world = worlds.every_joint()
    moved, offsets = contract.recentre_free_roots(world)
    assert list(offsets) == ["link0"]
    assert moved.bodies[0].inertial.centre_of_mass == (0.0, 0.0, 0.0)
    before, after = kinematics.poses(world), kinematics.poses(moved)
    for body in world.bodies[1:]:
        np.testing.assert_allclose(after[body.name].position, before[body.name].position, atol=1e-15)
    for values, other in zip(kinematics.initial_state(world), kinematics.initial_state(moved), strict=True):
        np.testing.assert_allclose(values, other, atol=1e-15)
    back = contract.restore_frames(moved.bodies, offsets)
    for values, other in zip(world.bodies, back, strict=True):
        np.testing.assert_allclose(other.joint.origin.position, values.joint.origin.position, atol=1e-15)
        np.testing.assert_allclose(other.joint.position, values.joint.position, atol=1e-15)
        np.testing.assert_allclose(other.joint.velocity, values.joint.velocity, atol=1e-15)
        np.testing.assert_allclose(other.inertial.centre_of_mass, values.inertial.centre_of_mass, atol=1e-15)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_round_trip(value):
    assert float(number(value)) == value
    assert not number(value).startswith("-0") or value != 0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_non_finite_numbers_are_not_written(value):
    with pytest.raises(ValueError, match="cannot be written"):
        number(value)


def test_sidecars_keep_short_lists_on_a_single_line():
    assert sidecar_text({"b": [1.0, 2.5], "a": {"c": []}}) == '{\n  "a": {\n    "c": []\n  },\n  "b": [1.0, 2.5]\n}\n'
