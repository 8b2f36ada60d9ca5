"""How far bodies are moved, of motions whose every displacement is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.analysis.conservation import displacement
from simspec.errors import SpecError
from simspec.world.types import Pose, Shape
from tests.runner.synthetic import column, free_body, run, world


def cube(name, edge=0.2):
    shape = Shape(f"{name}/solid", "box", (edge, edge, 3 * edge), Pose(), "m")
    return dataclasses.replace(free_body(name), shapes=(shape,))


WORLD = world(cube("low"), cube("high"), free_body("ghost"))


def moved(of=WORLD, low=lambda t: column(0.0, 0.0, 0.0 * t), high=lambda t: column(0.0, 0.0, 0.0 * t)):
    """Only those with shapes count: the ghost flies off."""
    ways = {"low": low, "high": high, "ghost": lambda t: column(9.0 * t, 0.0, 0.0 * t)}
    return run(of, lambda name, t: ways[name](t))


def test_bodies_at_rest_are_not_moved():
    given = displacement(moved())
    assert (given.sideways, given.down, given.left, given.bodies) == (0.0, 0.0, None, 2)


def test_the_furthest_way_sideways_and_the_lowest_end_count():
    """Out by 80 mm at 0.5 s and back again; 30 mm down at the end."""
    out = lambda t: column(0.0, 0.08 * np.sin(np.pi * t), -0.03 * t)  # noqa: E731
    given = displacement(moved(high=out))
    assert given.sideways == pytest.approx(0.08)
    assert given.whose == "high"
    assert given.down == pytest.approx(0.03)
    assert given.left is None


def test_a_way_and_back_counts_sideways_and_not_down():
    """80 mm aside and 50 mm down at 0.5 s, and back at the end; the other one ends 20 mm aside."""
    back = lambda t: column(0.0, 0.08 * np.sin(np.pi * t), -0.05 * np.sin(np.pi * t))  # noqa: E731
    given = displacement(moved(low=back, high=lambda t: column(0.02 * t, 0.0, 0.0 * t)))
    assert (given.sideways, given.whose) == (pytest.approx(0.08), "low")
    assert given.down == pytest.approx(0.0, abs=1e-12)
    last = displacement(moved(high=back, low=lambda t: column(0.02 * t, 0.0, 0.0 * t)))
    assert (last.sideways, last.whose) == (pytest.approx(0.08), "high")


def test_a_displaced_body_is_reported_with_its_first_time():
    """0.3 m/s along x: beyond half a width of 0.1 m from 1/3 s on; records every 0.1 s."""
    given = displacement(
        moved(low=lambda t: column(0.3 * t, 0.0, 0.0 * t), high=lambda t: column(0.15 * t, 0.0, 0.0 * t))
    )
    assert given.left == pytest.approx(0.4)
    assert given.whose == "low"


def test_up_is_not_down():
    assert displacement(moved(high=lambda t: column(0.0, 0.0, 0.5 * t))).down == 0.0


def test_down_is_along_gravity():
    """Under gravity along x what goes along z is moved sideways."""
    tilted = dataclasses.replace(WORLD, physics=dataclasses.replace(WORLD.physics, gravity=(10.0, 0.0, 0.0)))
    given = displacement(moved(tilted, high=lambda t: column(0.02 * t, 0.0, 0.05 * t)))
    assert given.down == pytest.approx(0.02)
    assert given.sideways == pytest.approx(0.05)


def test_without_gravity_every_way_is_sideways():
    given = displacement(moved(world(*WORLD.bodies, gravity=0.0), high=lambda t: column(0.0, 0.03 * t, -0.04 * t)))
    assert given.down == 0.0
    assert given.sideways == pytest.approx(0.05)


def test_where_a_body_starts_is_its_place():
    assert displacement(moved(high=lambda t: column(5.0, 5.0, 5.0 + 0.0 * t))).sideways == 0.0


def test_a_place_that_is_no_number_is_far_away():
    lost = lambda t: column(np.where(t > 0.55, np.nan, 0.0), 0.0, 0.0)  # noqa: E731
    given = displacement(moved(low=lost))
    assert given.left == pytest.approx(0.6)
    assert given.sideways == np.inf
    assert given.down == np.inf


def test_nothing_to_look_at_is_an_error():
    with pytest.raises(SpecError, match="no free body has a collision shape"):
        displacement(run(world(free_body("ghost"))))
    with pytest.raises(SpecError, match="poses were not recorded"):
        displacement(dataclasses.replace(moved(), arrays={}))
