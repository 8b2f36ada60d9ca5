"""Surfaces that move while their shapes stay: friction is along v − v_s."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.errors import SpecError, UnsupportedError
from simspec.language.load import load
from simspec.proof.selftest import self_test
from simspec.world.canonical import canonical_json
from simspec.world.types import World

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """
simspec: 1
name: carried
physics: {timestep: 1 ms, duration: DURATION}
contact: {materials: {rubber: {friction: 0.5}}}
bodies:
  floor:
    fixed: true
    shapes:
      - {name: belt, box: {size: [4, 4, 0.2]}, pose: {xyz: [0, 0, -0.1], rpy: [0, 0, 30 deg]}, BELT}
      - {name: disc, cylinder: {radius: 1, length: 0.2}, pose: {xyz: [5, 0, -0.1]}, DISC}
  slider: {pose: {xyz: [0, 0, 0.02]}, shapes: [{box: {size: [0.2, 0.2, 0.04]}, density: 500}]}
  rider: {pose: {xyz: [5.5, 0, 0.01]}, shapes: [{box: {size: [0.06, 0.06, 0.02]}, density: 500}]}
  crawler:
    pose: {xyz: [-1.5, 0, 0.02]}
    shapes: [{box: {size: [0.2, 0.2, 0.04]}, density: 500, surface_velocity: {linear: [0.2, 0, 0]}}]
engines: {mujoco: {settings: {friction: coulomb}}}
"""
GRIP = 0.5 * 9.81
"""μ g (m/s²)."""
SPEED, TURN = 0.6, 0.8
"""Of the belt (m/s), of the disc (rad/s)."""


def carried(
    folder: Path,
    belt: str = "surface_velocity: {linear: [0.6, 0, 0]}",
    disc: str = "surface_velocity: {angular: [0, 0, 0.8]}",
    duration: str = "0.5 s",
) -> World:
    path = folder / "carried.yaml"
    path.write_text(SPEC.replace("BELT", belt).replace("DISC", disc).replace("DURATION", duration))
    return load(path).resolve()


def test_a_belt_and_a_turntable_carry_at_the_grip_of_friction(tmp_path):
    world = carried(tmp_path)
    run = simspec.run(world, "mujoco")
    place = {body.name: number for number, body in enumerate(world.bodies)}
    time, velocity = run.arrays["time"], run.arrays["velocity"]
    along = np.array([math.cos(math.radians(30.0)), math.sin(math.radians(30.0))])  # in the axes of the shape
    expected = np.minimum(GRIP * time, SPEED)[:, None] * along
    # a body placed at a gap of zero has contact one step later, with the impulse of both
    assert velocity[2:, place["slider"], :2] == pytest.approx(expected[2:], abs=1e-4)
    # on the disc it is taken along ω × r, and what moves in the crawler's own surface drives it the other way, on the belt
    rider = velocity[:, place["rider"]]
    early = int(np.searchsorted(time, 0.05))
    assert rider[early, 1] == pytest.approx(GRIP * time[early], rel=0.02)
    assert abs(rider[early, 0]) < 0.05 * rider[early, 1]
    assert rider[-1, 5] == pytest.approx(TURN, rel=0.02)
    crawler = velocity[-1, place["crawler"], :2]
    assert crawler == pytest.approx(SPEED * along - [0.2, 0.0], abs=2e-3)


def test_nothing_is_carried_by_surfaces_that_stay(tmp_path):
    world = carried(tmp_path, "visual: true", "visual: true", "0.1 s")
    assert canonical_json(world).count("surface_velocity") == 1  # the crawler's
    run = simspec.run(world, "mujoco")
    assert abs(run.arrays["velocity"][-1, 1, :2]).max() < 1e-9


@pytest.mark.parametrize("engine", ["pybullet", "dart", "drake"])
def test_engines_without_moving_surfaces_refuse_them_by_name(engine, tmp_path):
    with pytest.raises(UnsupportedError, match=r"does not support shape\.surface_velocity"):
        compile_world(dataclasses.replace(carried(tmp_path), engines=()), [engine])


def test_older_releases_refuse_them_by_name(tmp_path):
    from simspec.engines.mujoco.contact import CONTACT_SUPPORT
    from simspec.support.features import Feature

    assert CONTACT_SUPPORT[Feature.SURFACE_VELOCITY].since == "3.11"


@pytest.mark.parametrize(
    "belt",
    [
        "surface_velocity: [1, 0, 0]",
        "surface_velocity: {linear: [1, 0]}",
        "surface_velocity: {linear: [.nan, 0, 0]}",
        "surface_velocity: {linear: [1 rad/s, 0, 0]}",
        "surface_velocity: {linear: [1, 0, 0]}, collision: false",
    ],
)
def test_invalid_surface_velocities_are_rejected(belt, tmp_path):
    with pytest.raises(SpecError, match="surface_velocity"):
        carried(tmp_path, belt)


def test_a_lost_velocity_is_seen_in_motion_too():
    (outcome,) = self_test(["mujoco"], defects=("surface velocity, sign",)).outcomes
    assert outcome.caught
    assert {"L0", "L4", "L5"} <= set(outcome.by)
