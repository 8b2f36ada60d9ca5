"""Height fields as files of triangles, and back; and triangles that are none."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.formats.kit.mesh_reading import field_of_triangles, read_meshes
from simspec.formats.kit.text import FIELDS, field_file, field_files
from simspec.proof.checks import field_distance
from simspec.world.shapes import field_of, heightfield_size

ROUGH = heightfield_size(2.0, 1.0, 0.5, np.random.default_rng(5).uniform(0.0, 0.3, (4, 6)))


def corners(size=ROUGH) -> np.ndarray:
    points, triangles = field_of(size).closed()
    return points[triangles]


def test_a_file_is_read_back_to_the_bit(tmp_path):
    flat = heightfield_size(0.3, 0.7, 1e-3, np.zeros((2, 2)))
    for name, text in field_files([ROUGH, flat, ROUGH]).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert read_meshes(tmp_path, FIELDS) == {field_file(ROUGH): ROUGH, field_file(flat): flat}


def test_triangles_may_come_in_any_order_and_in_single_precision():
    generator = np.random.default_rng(1)
    mixed = generator.permutation(corners())
    turns = generator.integers(0, 3, len(mixed))
    mixed = np.array([np.roll(each, turn, axis=0) for each, turn in zip(mixed, turns, strict=True)])
    assert field_of_triangles(mixed) == ROUGH
    actual = field_of_triangles(mixed.astype(np.float32).astype(float))
    assert 0.0 < field_distance(ROUGH, actual) < 2.0**-24


def other_diagonal(all_corners: np.ndarray) -> np.ndarray:
    """With the first cell's two triangles along the other diagonal."""
    low, high = all_corners[0], all_corners[1]
    changed = all_corners.copy()
    a, b, c, d = low[0], low[1], low[2], high[2]
    changed[0], changed[1] = (a, b, d), (b, c, d)
    return changed


def moved(all_corners: np.ndarray, axis: int) -> np.ndarray:
    """With one inner point moved along an axis, in all its triangles."""
    point = field_of(ROUGH).points[7]
    changed = all_corners.copy()
    changed[(all_corners == point).all(axis=2), axis] += 0.01
    return changed


def two_swapped(first: int, second: int) -> np.ndarray:
    """With two points swapped in all triangles, counted from the end."""
    points, triangles = field_of(ROUGH).closed()
    points[[-first, -second]] = points[[-second, -first]]
    return points[triangles]


BAD = {
    "the other diagonal": (lambda: other_diagonal(corners()), "diagonal"),
    "mirrored": (lambda: corners() * np.array([-1.0, 1.0, 1.0]), "diagonal"),
    "inside out": (lambda: corners()[:, ::-1], "diagonal"),
    "a hole": (lambda: corners()[:-1], "not closed"),
    "a hole above": (lambda: corners()[1:], "diagonal"),
    "twice": (lambda: np.concatenate([corners(), corners()[:1]]), "diagonal"),
    "a point aside": (lambda: moved(corners(), 0), "grid"),
    "two feet of its walls swapped": (lambda: two_swapped(2, 3), "upright"),
    "a foot and the middle of the bottom swapped": (lambda: two_swapped(1, 2), "upright"),
    "off its middle": (lambda: corners() + np.array([0.01, 0.0, 0.0]), "origin"),
    "nothing": (lambda: np.zeros((0, 3, 3)), "no closed surface"),
    "a tetrahedron": (
        lambda: np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)[
            [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
        ],
        "no grid",
    ),
    "not a number": (lambda: np.where(corners() == corners()[0, 0, 0], np.nan, corners()), "finite"),
}


@pytest.mark.parametrize("name", BAD)
def test_triangles_that_are_not_a_height_field_are_rejected(name):
    made, said = BAD[name]
    with pytest.raises(ValueError, match=said):
        field_of_triangles(made())


def test_a_height_that_is_another_is_read_as_it_is():
    assert field_distance(ROUGH, field_of_triangles(moved(corners(), 2))) == pytest.approx(0.005, rel=1e-6)
