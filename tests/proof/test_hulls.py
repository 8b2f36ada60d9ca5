"""The distance of two hulls: the bound by their vertices, the directions of the search, and the misses of each."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.proof.checks import _directions, _support, hull_distance
from simspec.world.hull import corners, mesh_size

SHAPES = {"round": (1.0, 1.0, 1.0), "flat": (1.0, 0.01, 0.4), "needle": (0.02, 0.02, 1.0)}
GRID = 4.0
"""Corners rounded to its inverse: faces of many corners, which Qhull cuts into triangles."""


def a_hull(name: str, count: int, grid: bool) -> np.ndarray:
    points = np.random.default_rng(count).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    if grid:
        points = np.round(points * GRID) / GRID
    points = points * SHAPES[name] + (0.2, 0.0, -0.1)
    return points[corners(points)]


@pytest.mark.parametrize("grid", [False, True])
@pytest.mark.parametrize("count", [12, 400])
@pytest.mark.parametrize("name", SHAPES)
def test_how_far_the_wanted_hull_reaches_is_known_without_looking_at_every_vertex(name, count, grid):
    size = mesh_size(a_hull(name, count, grid))
    directions, reach = _directions(size)
    assert np.abs(_support(size, directions) - reach).max() < 1e-14


@pytest.mark.parametrize("name", SHAPES)
def test_the_bound_is_above_the_distance_and_taken_only_where_it_is_tolerated(name):
    points = a_hull(name, 200, False)
    generator = np.random.default_rng(3)
    for off in (1e-12, 1e-7, 1e-4):
        moved = points + off * generator.uniform(-1.0, 1.0, points.shape)
        wanted, actual = mesh_size(points), mesh_size(moved[generator.permutation(len(moved))])
        bound, exact = hull_distance(wanted, actual, 1.0), hull_distance(wanted, actual)
        assert 0.0 < exact <= bound <= 4.0 * off  # of an extent of 1 m at least: √3, and round-off
        assert hull_distance(wanted, actual, 0.99 * bound) == exact


@pytest.mark.parametrize("name", SHAPES)
def test_a_moved_or_missing_vertex_is_found_at_any_lower_tolerance(name):
    points = a_hull(name, 200, False)
    wanted = mesh_size(points)
    least = np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1))
    without = np.delete(points, least, axis=0)
    beyond = points.copy()
    beyond[least] = points.mean(axis=0) + 1.01 * (points[least] - points.mean(axis=0))
    for values in (without, beyond):
        found = hull_distance(wanted, mesh_size(values), 1e-7)
        assert found == hull_distance(wanted, mesh_size(values)) > 1e-7


def test_points_within_a_hull_are_no_difference():
    points = a_hull("round", 100, False)
    more = np.concatenate([points, [points.mean(axis=0)]])
    assert hull_distance(mesh_size(points), mesh_size(more), 1e-12) < 1e-15


def test_a_place_that_is_no_number_is_no_hull_that_passes():
    points = a_hull("round", 30, False)
    wrong = points.copy()
    wrong[3, 1] = np.nan
    assert not hull_distance(mesh_size(points), mesh_size(wrong), 1.0) <= 1.0
