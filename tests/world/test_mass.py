"""Mass properties against integrals over the solids, and against laws that hold for every body."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simspec.world import frames
from simspec.world import inertia as mass
from simspec.world.shapes import SHAPES
from simspec.world.types import Pose


def test_round_figures_stay_round():
    """The paper's sphere of 10 kg and 0.1 m: 0.4 m r² as a reader computes it, to the last bits."""
    assert SHAPES["sphere"].moments((0.1,), 10.0) == pytest.approx((0.04, 0.04, 0.04), rel=3e-16)


@st.composite
def parts(draw):
    kind = draw(st.sampled_from(sorted(kind for kind, row in SHAPES.items() if not row.static)))
    names = SHAPES[kind].sizes or tuple("xyz")
    size = tuple(draw(st.floats(0.05, 1.0)) for _ in names)
    if SHAPES[kind].points:  # an octahedron of these semi-axes
        size = tuple(sign * half for axis in np.diag(size) for sign in (1.0, -1.0) for half in axis)
    raw = draw(st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 4))
    assume(sum(x * x for x in raw) > 1e-2)
    place = Pose(draw(st.tuples(*[st.floats(-2, 2, allow_subnormal=False)] * 3)), frames.normalise(raw))
    return mass.shape_part(kind, size, place, draw(st.floats(0.1, 5.0)))


def full(inertia) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@settings(max_examples=60)
@given(st.lists(parts(), min_size=1, max_size=5))
def test_a_body_is_the_sum_of_its_parts(found):
    """Parallel axes in matrix form: I = Σ R D Rᵀ + m (d·d 1 − d dᵀ)."""
    total = sum(entry.mass for entry in found)
    centre = sum(entry.mass * np.array(entry.pose.position) for entry in found) / total
    inertia = np.zeros((3, 3))
    for item in found:
        r, d = np.array(frames.matrix(item.pose.quaternion)), np.array(item.pose.position) - centre
        inertia += r @ np.diag(item.moments) @ r.T + item.mass * ((d @ d) * np.eye(3) - np.outer(d, d))
    whole = mass.combined_inertial(found)
    assert whole.mass == pytest.approx(total, rel=1e-14)
    np.testing.assert_allclose(whole.centre_of_mass, centre, atol=1e-13)
    np.testing.assert_allclose(full(whole.inertia), inertia, atol=1e-12)


@settings(max_examples=40)
@given(st.lists(parts(), min_size=1, max_size=4))
def test_no_body_breaks_the_triangle_inequality(found):
    low, middle, high = np.linalg.eigvalsh(full(mass.combined_inertial(found).inertia))
    assert low > 0
    assert high <= (low + middle) * (1 + 1e-12)


@settings(max_examples=40)
@given(parts())
def test_a_single_part_keeps_its_centre_and_mass_to_the_bit(entry):
    whole = mass.combined_inertial([entry])
    assert (whole.mass, whole.centre_of_mass) == (entry.mass, entry.pose.position)


def test_a_stated_total_is_kept_to_the_bit():
    third = [mass.shape_part("sphere", (0.1,), Pose((float(i), 0.0, 0.0)), 0.1) for i in range(3)]
    assert mass.combined_inertial(third).mass != 0.3  # 0.1 + 0.1 + 0.1
    assert mass.combined_inertial(third, 0.3).mass == 0.3


def test_a_box_cut_in_two_is_the_box():
    halves = [mass.shape_part("box", (0.5, 0.4, 0.3), Pose((x, 1.0, 0.0)), 1.0) for x in (-0.25, 0.25)]
    whole = mass.combined_inertial(halves)
    assert whole.centre_of_mass == pytest.approx((0.0, 1.0, 0.0), abs=1e-16)
    expected = (*SHAPES["box"].moments((1.0, 0.4, 0.3), 2.0), 0.0, 0.0, 0.0)
    assert whole.inertia == pytest.approx(expected, rel=1e-15, abs=1e-16)


def test_a_product_of_inertia_has_the_sign_of_the_tensor():
    """Two balls on the line x = y lie where x y > 0: Ixy = −∫ x y dm is negative."""
    balls = [mass.shape_part("sphere", (0.1,), Pose((s, s, 0.0)), 1.0) for s in (-1.0, 1.0)]
    assert mass.combined_inertial(balls).inertia[3] == pytest.approx(-2.0)


def test_principal_moments_are_turned_into_the_bodys_axes():
    quarter = frames.from_rpy(0.0, 0.0, math.pi / 2)
    assert mass.rotated_tensor((1.0, 2.0, 2.5), quarter) == pytest.approx((2.0, 1.0, 2.5, 0.0, 0.0, 0.0), abs=1e-15)
    assert mass.rotated_tensor((1.0, 2.0, 2.5), frames.IDENTITY) == (1.0, 2.0, 2.5, 0.0, 0.0, 0.0)
