"""Balls in Rapier: which are too small for its numbers, and bodies that stand on several."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.rapier.engine import Rapier
from simspec.errors import UnsupportedError
from simspec.testing.worlds import accepting, with_options
from simspec.world.types import Inertial, Pose, Shape
from tests.engines.free_bodies import ball, loader, scene

ROOT = Path(__file__).resolve().parents[3]
STOP = 0.1014
"""m: where what slides at 1 m/s stops under μ = 0.5, in steps of 1 ms."""
CUBE = 2.0 * 0.2**2 / 6.0
"""kg m²: of a cube of 2 kg and 0.2 m."""
installed = pytest.mark.skipif(Rapier.version() is None, reason="rapier3d is not installed")


@pytest.fixture
def load(load_files):
    of = loader(Rapier, load_files)
    return lambda world: of(accepting(world, "rapier"))


def table(radius: float, height: float = 0.1, inertia: float = CUBE):
    """A body whose centre of mass is so high above the floor, on four balls at distances of 0.2 m."""
    corners = [(x, y, radius - height) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    feet = tuple(Shape(f"foot {k}", "sphere", (radius,), Pose(at), "m") for k, at in enumerate(corners))
    body = ball("table", (0.0, 0.0, height))
    return scene(
        dataclasses.replace(body, shapes=feet, inertial=Inertial(2.0, inertia=(*[inertia] * 3, 0.0, 0.0, 0.0)))
    )


def slid(engine, height: float, turn: float, tilt=(0.0, 0.0)) -> tuple[float, float]:
    """How far it comes that starts at 1 m/s in this direction, and its largest speed upwards."""
    turned = np.array([1.0, 0.5 * tilt[0], 0.5 * tilt[1], 0.0])
    velocity = np.array([np.cos(turn), np.sin(turn), 0.0, 0.0, 0.0, 0.0])
    engine.set_state(np.array([0.0, 0.0, height, *(turned / np.linalg.norm(turned))]), velocity)
    up = 0.0
    for _ in range(60):
        engine.step(5)
        up = max(up, engine.get_state()[1][2])
    return float(np.hypot(*engine.get_state()[0][:2])), up


@installed
def test_bodies_on_several_balls_slide_and_do_not_jam(load):
    engine, draw = load(table(1e-3)), np.random.default_rng(2)
    ways = [slid(engine, 0.1, *draw.uniform(0.0, 6.3, 1), tilt=1e-5 * draw.normal(size=2)) for _ in range(12)]
    assert max(up for _, up in ways) < 1e-3
    assert [way / STOP for way, _ in ways] == pytest.approx([1.035] * 12, abs=0.04)
    assert max(way for way, _ in ways) > 1.05 * STOP, "the declared lateness of bodies on several shapes"


@installed
def test_a_light_body_on_four_shapes_stops_as_late_as_is_declared(load):
    engine = load(table(0.01, 0.02, 0.49 * CUBE))
    ways = [slid(engine, 0.02, turn)[0] / STOP for turn in np.linspace(0.0, np.pi / 4.0, 4)]
    assert 1.2 < max(ways) < 1.26
    assert min(ways) == pytest.approx(1.0, abs=2e-3)
    assert "by 25 % with half its inertia" in (ROOT / "docs/engines/rapier.md").read_text(encoding="utf-8")


@installed
def test_tiny_balls_jam_as_is_declared(load):
    """Were they to slide, balls would have no least radius."""
    engine, draw = load(table(3e-6)), np.random.default_rng(4)
    ways = [slid(engine, 0.1, *draw.uniform(0.0, 6.3, 1), tilt=2e-5 * draw.normal(size=2)) for _ in range(40)]
    assert max(up for _, up in ways) > 0.05
    assert min(way for way, _ in ways) < 0.95 * STOP


def test_tiny_balls_are_accepted_by_name():
    world = table(0.99e-4)
    with pytest.raises(UnsupportedError, match=r"dominated by round-off"):
        compile_world(with_options(world, "rapier", accept=("contact.cone.elliptic",)), ["rapier"])
    assert compile_world(accepting(world, "rapier"), ["rapier"])
    assert "shape.sphere" not in accepting(table(1e-4), "rapier").options("rapier").accept
