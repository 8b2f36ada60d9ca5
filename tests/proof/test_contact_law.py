"""The one-step law of friction, against its definition and the textbook's slide."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.language.vocabulary import FRICTION_CONES
from simspec.proof.contact.probe import GRAVITY, ProbeLaw, outline, project, slide
from simspec.world.types import PairContact

GAUGES = {
    "elliptic": lambda v: np.hypot(v[..., 0], v[..., 1]),
    "pyramid-inscribed": lambda v: np.abs(v[..., 0]) + np.abs(v[..., 1]),
    "pyramid-circumscribed": lambda v: np.maximum(np.abs(v[..., 0]), np.abs(v[..., 1])),
}
"""Forces that must not exceed μ N, by cone: the inequalities of the language's reference."""


def law(friction, timestep, cone):
    return ProbeLaw(PairContact("base", "body", friction, 0.0), cone, timestep)


component = st.floats(-5.0, 5.0, allow_nan=False)


@pytest.mark.parametrize("cone", FRICTION_CONES)
@given(x=component, y=component, size=st.floats(0.01, 3.0))
def test_a_projection_is_the_nearest_point_of_the_section(cone, x, y, size):
    vector = np.array([x, y])
    found = project(vector, size, cone)
    assert GAUGES[cone](found) <= size * (1.0 + 1e-12)
    if GAUGES[cone](vector) <= size:
        assert np.array_equal(found, vector)
        return
    # of a convex set: every point of it lies beyond the plane through the projection, seen from the vector
    corners = size * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1, 1], [1, -1], [-1, 1], [-1, -1]])
    inside = np.concatenate([outline(size, cone), corners[GAUGES[cone](corners) <= size]])
    assert np.all((inside - found) @ (vector - found) <= 1e-9)


@pytest.mark.parametrize("cone", FRICTION_CONES)
def test_an_outline_is_the_boundary_of_the_section(cone):
    points = outline(0.7, cone)
    assert np.allclose(GAUGES[cone](points), 0.7)
    angles = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    assert angles[-1] - angles[0] == pytest.approx(2.0 * math.pi)


def test_the_cones_differ_by_the_root_of_two_on_the_diagonal():
    push = np.array([1.0, 1.0])
    sizes = {cone: float(np.linalg.norm(project(push, 0.5, cone))) for cone in FRICTION_CONES}
    assert sizes["elliptic"] == pytest.approx(0.5)
    assert sizes["pyramid-inscribed"] == pytest.approx(0.5 / math.sqrt(2.0))
    assert sizes["pyramid-circumscribed"] == pytest.approx(0.5 * math.sqrt(2.0))


@given(
    steps=st.integers(20, 300), part=st.floats(0.0, 1.0), friction=st.floats(0.05, 1.5), degrees=st.floats(0.0, 360.0)
)
def test_a_slide_stops_where_the_textbook_says(steps, part, friction, degrees):
    """v²/2μg − v dt/2; where the last step is not a whole one, up to an eighth of what one step adds."""
    gravity, dt = GRAVITY, 0.002
    speed = (steps + part) * friction * gravity * dt
    direction = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    place, velocity = slide(speed * direction, law(friction, dt, "elliptic"), steps + 2)
    textbook = speed**2 / (2.0 * friction * gravity) - speed * dt / 2.0
    assert np.linalg.norm(velocity[-1]) <= 1e-12
    assert place[-1] @ direction == pytest.approx(textbook, abs=0.126 * friction * gravity * dt * dt)
    assert abs(place[-1] @ np.array([-direction[1], direction[0]])) <= 1e-12


def test_under_pyramids_the_coordinates_of_a_slide_are_independent():
    """Circumscribed: each coordinate is braked on its own, so a slide ends parallel to an axis. Inscribed: the diamond's
    faces brake both alike, by half of μ g each."""
    friction, gravity, dt = 0.4, GRAVITY, 0.001
    square, _ = slide(np.array([0.8, 0.2]), law(friction, dt, "pyramid-circumscribed"), 400)
    stop = [speed**2 / (2.0 * friction * gravity) - speed * dt / 2.0 for speed in (0.8, 0.2)]
    assert square[-1] == pytest.approx(stop, abs=1e-6)
    diamond, _ = slide(np.array([0.5, 0.5]), law(friction, dt, "pyramid-inscribed"), 400)
    both = 0.5**2 / (friction * gravity) - 0.5 * dt / 2.0
    assert diamond[-1] == pytest.approx([both, both], abs=1e-6)
