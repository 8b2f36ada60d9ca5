"""The table of shape kinds: every row against integrals over the solid, and against its own support function."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from simspec.language.vocabulary import SHAPE_KINDS
from simspec.world import hull
from simspec.world.overlap import SPREAD
from simspec.world.shapes import SHAPES, Round

SOLIDS = [
    ("sphere", (0.3,)),
    ("box", (0.2, 0.5, 0.7)),
    ("cylinder", (0.2, 0.9)),
    ("cylinder", (0.9, 0.05)),
    ("capsule", (0.2, 0.6)),
    ("capsule", (0.5, 0.01)),
    ("ellipsoid", (0.2, 0.5, 0.4)),
]
LENGTHS = SOLIDS
"""Those that lengths define."""
WEDGE = hull.mesh_size(
    hull.centred(np.array([[0, 0, 0], [0.6, 0, 0], [0, 0.5, 0], [0.6, 0.5, 0], [0.2, 0.1, 0.4], [0.2, 0.4, 0.4]]))[1]
)
SOLIDS = [*LENGTHS, ("mesh", WEDGE)]
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


@pytest.mark.parametrize(("kind", "size"), LENGTHS)
def test_volume_and_moments_are_the_integrals_over_the_solid(kind, size):
    total, sums = integrals(kind, size)
    # the sections are polynomials in z, which the quadrature takes exactly
    assert SHAPES[kind].volume(size) == pytest.approx(total, rel=1e-12)
    np.testing.assert_allclose(SHAPES[kind].moments(size, 2.5), 2.5 * sums / total, rtol=1e-12)


def test_a_plane_has_no_volume_and_no_moments():
    assert SHAPES["plane"].volume(()) == 0.0
    with pytest.raises(ValueError, match="plane"):
        SHAPES["plane"].moments((), 1.0)


def test_limits_of_the_solids():
    """A capsule without length is a sphere, an ellipsoid of equal axes too, a long thin capsule is a rod m L²/12."""
    sphere = SHAPES["sphere"].moments((0.4,), 3.0)
    assert SHAPES["capsule"].moments((0.4, 0.0), 3.0) == pytest.approx(sphere, rel=1e-15)
    assert SHAPES["ellipsoid"].moments((0.4, 0.4, 0.4), 3.0) == pytest.approx(sphere, rel=1e-15)
    assert SHAPES["capsule"].moments((1e-6, 2.0), 3.0)[0] == pytest.approx(3.0 * 4 / 12, rel=1e-5)


def test_every_kind_has_a_row_and_every_solid_is_tried():
    assert tuple(SHAPES) == SHAPE_KINDS
    assert {kind for kind, _ in SOLIDS} == {kind for kind, row in SHAPES.items() if not row.static}
    assert all(SHAPES[kind].wrong_size(size) is None for kind, size in SOLIDS)


def test_the_count_of_a_sizes_numbers_is_checked():
    assert SHAPES["box"].wrong_size((1.0,)) == "has 1 entries, should have 3"
    for count in (0, 9, 13):
        assert "x y z of at least 4 vertices" in SHAPES["mesh"].wrong_size((0.0,) * count)


@pytest.mark.parametrize(("kind", "size"), SOLIDS)
def test_radii_are_those_of_the_support_function(kind, size):
    row = SHAPES[kind]
    reach = row.support(size, SPREAD)
    assert row.inner_radius(size) <= reach.min() * 1.001
    assert reach.max() <= row.outer_radius(size) * (1.0 + 1e-15)
    axes = np.vstack([np.eye(3), -np.eye(3)])
    if row.points:  # its faces look along no axis
        return
    assert reach.max() == pytest.approx(row.outer_radius(size), rel=0.03)
    assert min(reach.min(), row.support(size, axes).min()) == pytest.approx(row.inner_radius(size), rel=0.15)


@pytest.mark.parametrize(("kind", "size"), LENGTHS)
def test_volume_and_moments_are_of_the_solid_of_the_support_function(kind, size):
    """Two ways to say what the solid is: a point is in it where n·x ≤ h(n) for every n (here for many)."""
    row = SHAPES[kind]
    directions = np.vstack([SPREAD, np.eye(3), -np.eye(3), np.random.default_rng(1).normal(size=(900, 3))])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    half = row.support(size, np.eye(3))
    generator = np.random.default_rng(2)
    points = generator.uniform(-1.0, 1.0, (20_000, 3)) * half
    inside = points[((points @ directions.T) <= row.support(size, directions)).all(axis=1)]
    cuboid = 8.0 * float(np.prod(half))
    # the planes cut a little less than the solid, and 20,000 points are good to about a hundredth
    assert cuboid * len(inside) / len(points) == pytest.approx(row.volume(size), rel=0.06)
    squares = (inside**2).mean(axis=0)
    np.testing.assert_allclose(squares.sum() - squares, row.moments(size, 1.0), rtol=0.06)


@pytest.mark.parametrize(("kind", "size"), SOLIDS)
def test_declared_symmetries_of_shapes_hold(kind, size):
    row = SHAPES[kind]
    reach = row.support(size, SPREAD)
    upside_down = SPREAD * (1.0, 1.0, -1.0)
    assert np.allclose(row.support(size, upside_down), reach, rtol=1e-12) is row.upside_down
    about_z = SPREAD @ np.array(
        [[math.cos(1.0), -math.sin(1.0), 0.0], [math.sin(1.0), math.cos(1.0), 0.0], [0.0, 0.0, 1.0]]
    )
    about_x = SPREAD[:, [2, 0, 1]]
    assert np.allclose(row.support(size, about_z), reach, rtol=1e-12) is (row.round is not Round.NONE)
    assert np.allclose(row.support(size, about_x), reach, rtol=1e-12) is (row.round is Round.EVERY)
