"""Mass properties against integrals over the solids, and against laws that hold for every body."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simspec.world import frames, mass
from simspec.world.types import Pose

SOLIDS = [
    ("sphere", (0.3,)),
    ("box", (0.2, 0.5, 0.7)),
    ("cylinder", (0.2, 0.9)),
    ("cylinder", (0.9, 0.05)),
    ("capsule", (0.2, 0.6)),
    ("capsule", (0.5, 0.01)),
    ("ellipsoid", (0.2, 0.5, 0.4)),
]
KINDS = {"sphere": 1, "box": 3, "cylinder": 2, "capsule": 2, "ellipsoid": 3}
PIECES = 200
"""Gauss points along z in each stretch of a solid."""


def half_widths(kind: str, size: tuple[float, ...], z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half widths along x and y of the section at height z: of a rectangle (box) or an ellipse (all others)."""
    if kind == "box":
        return np.full_like(z, size[0] / 2), np.full_like(z, size[1] / 2)
    if kind == "cylinder":
        return np.full_like(z, size[0]), np.full_like(z, size[0])
    if kind == "capsule":
        beyond = np.maximum(np.abs(z) - size[1] / 2, 0.0)
        radius = np.sqrt(np.maximum(size[0] ** 2 - beyond**2, 0.0))
        return radius, radius
    a, b, c = size * 3 if kind == "sphere" else size
    share = np.sqrt(np.maximum(1 - (z / c) ** 2, 0.0))
    return a * share, b * share


def integrals(kind: str, size: tuple[float, ...]) -> tuple[float, np.ndarray]:
    """Volume, and (∫y²+z², ∫x²+z², ∫x²+y²), by Gauss quadrature of the sections along z."""
    height = {
        "sphere": lambda: size[0],
        "box": lambda: size[2] / 2,
        "cylinder": lambda: size[1] / 2,
        "capsule": lambda: size[1] / 2 + size[0],
        "ellipsoid": lambda: size[2],
    }[kind]()
    edges = [-height, height] if kind != "capsule" else [-height, -size[1] / 2, size[1] / 2, height]
    nodes, weights = np.polynomial.legendre.leggauss(PIECES)
    total, sums = 0.0, np.zeros(3)
    for low, high in itertools.pairwise(edges):
        z, w = (low + high) / 2 + nodes * (high - low) / 2, weights * (high - low) / 2
        a, b = half_widths(kind, size, z)
        if kind == "box":
            area, xx, yy = 4 * a * b, a**2 / 3, b**2 / 3
        else:
            area, xx, yy = math.pi * a * b, a**2 / 4, b**2 / 4
        total += w @ area
        x2, y2, z2 = w @ (area * xx), w @ (area * yy), w @ (area * z**2)
        sums += (y2 + z2, x2 + z2, x2 + y2)
    return total, sums


@pytest.mark.parametrize(("kind", "size"), SOLIDS)
def test_volume_and_moments_are_the_integrals_over_the_solid(kind, size):
    total, sums = integrals(kind, size)
    # the sections are polynomials in z, which the quadrature takes exactly
    assert mass.volume(kind, size) == pytest.approx(total, rel=1e-12)
    np.testing.assert_allclose(mass.moments(kind, size, 2.5), 2.5 * sums / total, rtol=1e-12)


def test_a_plane_has_no_volume_and_no_moments():
    assert mass.volume("plane", ()) == 0.0
    with pytest.raises(ValueError, match="plane"):
        mass.moments("plane", (), 1.0)


@pytest.mark.parametrize("function", [lambda: mass.volume("cone", (1.0,)), lambda: mass.moments("cone", (1.0,), 1.0)])
def test_an_unknown_solid_is_refused(function):
    with pytest.raises(ValueError, match="cone"):
        function()


def test_limits_of_the_solids():
    """A capsule without length is a sphere, an ellipsoid of equal axes too, a long thin capsule is a rod m L²/12."""
    sphere = mass.moments("sphere", (0.4,), 3.0)
    assert mass.moments("capsule", (0.4, 0.0), 3.0) == pytest.approx(sphere, rel=1e-15)
    assert mass.moments("ellipsoid", (0.4, 0.4, 0.4), 3.0) == pytest.approx(sphere, rel=1e-15)
    assert mass.moments("capsule", (1e-6, 2.0), 3.0)[0] == pytest.approx(3.0 * 4 / 12, rel=1e-5)


def test_round_figures_stay_round():
    """The paper's sphere of 10 kg and 0.1 m: 0.4 m r² as a reader computes it, to the last bits."""
    assert mass.moments("sphere", (0.1,), 10.0) == pytest.approx((0.04, 0.04, 0.04), rel=3e-16)


@st.composite
def parts(draw):
    kind = draw(st.sampled_from(sorted(KINDS)))
    size = tuple(draw(st.floats(0.05, 1.0)) for _ in range(KINDS[kind]))
    raw = draw(st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 4))
    assume(sum(x * x for x in raw) > 1e-2)
    place = Pose(draw(st.tuples(*[st.floats(-2, 2, allow_subnormal=False)] * 3)), frames.normalise(raw))
    return mass.part(kind, size, place, draw(st.floats(0.1, 5.0)))


def full(inertia) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@settings(max_examples=60)
@given(st.lists(parts(), min_size=1, max_size=5))
def test_a_body_is_the_sum_of_its_parts(found):
    """Parallel axes in matrix form: I = Σ R D Rᵀ + m (d·d 1 − d dᵀ)."""
    total = sum(one.mass for one in found)
    centre = sum(one.mass * np.array(one.pose.position) for one in found) / total
    inertia = np.zeros((3, 3))
    for one in found:
        r, d = np.array(frames.matrix(one.pose.quaternion)), np.array(one.pose.position) - centre
        inertia += r @ np.diag(one.moments) @ r.T + one.mass * ((d @ d) * np.eye(3) - np.outer(d, d))
    whole = mass.combined(found)
    assert whole.mass == pytest.approx(total, rel=1e-14)
    np.testing.assert_allclose(whole.centre_of_mass, centre, atol=1e-13)
    np.testing.assert_allclose(full(whole.inertia), inertia, atol=1e-12)


@settings(max_examples=40)
@given(st.lists(parts(), min_size=1, max_size=4))
def test_no_body_breaks_the_triangle_inequality(found):
    low, middle, high = np.linalg.eigvalsh(full(mass.combined(found).inertia))
    assert low > 0
    assert high <= (low + middle) * (1 + 1e-12)


@settings(max_examples=40)
@given(parts())
def test_one_part_keeps_its_centre_and_mass_to_the_bit(one):
    whole = mass.combined([one])
    assert (whole.mass, whole.centre_of_mass) == (one.mass, one.pose.position)


def test_a_stated_total_is_kept_to_the_bit():
    third = [mass.part("sphere", (0.1,), Pose((float(i), 0.0, 0.0)), 0.1) for i in range(3)]
    assert mass.combined(third).mass != 0.3  # 0.1 + 0.1 + 0.1
    assert mass.combined(third, 0.3).mass == 0.3


def test_a_box_cut_in_two_is_the_box():
    halves = [mass.part("box", (0.5, 0.4, 0.3), Pose((x, 1.0, 0.0)), 1.0) for x in (-0.25, 0.25)]
    whole = mass.combined(halves)
    assert whole.centre_of_mass == pytest.approx((0.0, 1.0, 0.0), abs=1e-16)
    expected = (*mass.moments("box", (1.0, 0.4, 0.3), 2.0), 0.0, 0.0, 0.0)
    assert whole.inertia == pytest.approx(expected, rel=1e-15, abs=1e-16)


def test_a_product_of_inertia_has_the_tensors_own_sign():
    """Two balls on the line x = y lie where x y > 0: Ixy = −∫ x y dm is negative."""
    balls = [mass.part("sphere", (0.1,), Pose((s, s, 0.0)), 1.0) for s in (-1.0, 1.0)]
    assert mass.combined(balls).inertia[3] == pytest.approx(-2.0)


def test_principal_moments_are_turned_into_the_bodys_axes():
    quarter = frames.from_rpy(0.0, 0.0, math.pi / 2)
    assert mass.turned((1.0, 2.0, 2.5), quarter) == pytest.approx((2.0, 1.0, 2.5, 0.0, 0.0, 0.0), abs=1e-15)
    assert mass.turned((1.0, 2.0, 2.5), frames.IDENTITY) == (1.0, 2.0, 2.5, 0.0, 0.0, 0.0)
