"""Forces on bodies: their fields in a spec, their values in the world, the steps in which they act and their sizes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.control.request import AppliedForces, brought_forward, forces_from_request, forces_to_request
from simspec.errors import SpecError
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world.actions import Force
from simspec.world.canonical import canonical_json
from simspec.world.types import World

TOP = """simspec: 1
name: pushed
physics: {timestep: 1 ms, duration: 1 s}
bodies:
  base: {fixed: true}
  trunk: {mass: 2, inertia: {principal: [1, 1, 1]}, array: {grid: [2, 1, 1], spacing: [1, 1, 1]}}
forces:
"""


def scenario(folder: Path, *forces: str, overrides: tuple[str, ...] = ()) -> World:
    path = folder / "pushed.yaml"
    path.write_text(TOP + "".join(f"  - {force}\n" for force in forces), encoding="utf-8")
    return simspec.load(path, sets=overrides).resolve()


def test_forces_are_stored_in_the_order_of_the_file(tmp_path):
    world = scenario(
        tmp_path,
        "{body: trunk_1, force: [1 kN, 0, 0], at: [0, 0, 10 cm], from: 100 ms, until: 0.2}",
        "{body: trunk_0, torque: [0, 0, 2 N m]}",
    )
    assert world.forces == (
        Force("trunk_1", (1000.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 0.1, 0.2),
        Force("trunk_0", torque=(0.0, 0.0, 2.0)),
    )
    (need,) = (need for need in needs(world) if need.feature is Feature.FORCES)
    assert need.paths == ("forces.0", "forces.1")
    assert '"forces"' not in canonical_json(dataclasses.replace(world, forces=()))
    changed = scenario(
        tmp_path, "{body: trunk_1, force: [1, 0, 0]}", overrides=("forces.0.force.0=7 N", "forces.0.from=1 ms")
    )
    assert changed.forces == (Force("trunk_1", (7.0, 0.0, 0.0), start=0.001),)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        ("{body: trunk, force: [1, 0, 0]}", "there is no body 'trunk'"),
        ("{body: base, force: [1, 0, 0]}", "base is fixed to the world: no force moves it"),
        ("{body: trunk_0}", "neither force nor torque"),
        ("{body: trunk_0, torque: [1, 0, 0], at: [1, 0, 0]}", "at no point"),
        ("{body: trunk_0, force: [1, 0, 0], from: 0.2, until: 0.2}", "it ends before it begins"),
        ("{body: trunk_0, force: [1, 0, 0], from: 1 s}", "it begins after the end of the run"),
        ("{body: trunk_0, force: [1 N m, 0, 0]}", "force"),
        ("{body: trunk_0, force: [1, 0, 0], from: -1}", "from"),
        ("{body: trunk_0, force: [1, .nan, 0]}", "force"),
        ("{body: trunk_0, force: [1, 0, 0], start: 0.1}", "from"),
    ],
)
def test_errors_are_reported_at_their_location(tmp_path, force, message):
    with pytest.raises(SpecError) as error:
        scenario(tmp_path, force)
    assert message in str(error.value)
    assert all(problem.location is not None and problem.location.line == 8 for problem in error.value.problems)


def test_expectations_that_forces_break_are_refused(tmp_path):
    text = TOP + "  - {body: trunk_0, force: [1, 0, 0]}\nexpect:\n  - follows_oracle: {tolerance: 1 mm}\n"
    (tmp_path / "pushed.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match="the oracle's motion has no forces on bodies"):
        simspec.load(tmp_path / "pushed.yaml").resolve()


def shares(force: Force, timestep: float, steps: int) -> np.ndarray:
    """Of each step the force along x over its value."""
    world = simspec.load(simspec.find_spec("tumbling-body")).resolve()
    (body,) = world.bodies
    entry = dataclasses.replace(force, body=body.name, force=(1.0, 0.0, 0.0))
    physics = dataclasses.replace(world.physics, timestep=timestep)
    applied = forces_from_request(forces_to_request(dataclasses.replace(world, forces=(entry,), physics=physics)))
    assert applied is not None
    pose = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    acting = np.array([applied.effort(step, pose)[0] for step in range(steps)])
    assert [applied.acts(step) for step in range(steps)] == (acting > 0.0).tolist()
    pieces = list(applied.stretches(0, steps))
    assert [first for first, _, _ in pieces] == np.cumsum([0, *(count for _, count, _ in pieces)])[:-1].tolist()
    assert sum(count for _, count, _ in pieces) == steps
    assert all(acts == (acting[first : first + count] > 0.0).all() for first, count, acts in pieces)
    assert all(acts or not (acting[first : first + count] > 0.0).any() for first, count, acts in pieces)
    return acting


@pytest.mark.parametrize("timestep", [0.001, 0.003, 0.007, 0.1])
def test_the_impulse_is_exact_at_every_timestep(timestep):
    force = Force("", start=0.0101, until=0.0473)
    acting = shares(force, timestep, 100)
    assert acting.sum() * timestep == pytest.approx(0.0372, rel=1e-12)
    assert acting.max() <= 1.0


def test_times_in_decimals_are_whole_steps():
    acting = shares(Force("", start=0.3, until=0.7), 0.1, 10)  # 0.3 / 0.1 is not 3 in doubles
    assert acting.tolist() == [0, 0, 0, 1, 1, 1, 1, 0, 0, 0]
    assert shares(Force("", start=0.002), 0.001, 5).tolist() == [0, 0, 1, 1, 1]


def test_a_proof_brings_forces_forward_with_their_shares():
    forces = (Force("a", start=5.0004, until=5.0021), Force("b", start=5.01), Force("c", start=9.0, until=9.5))
    first, second, third = brought_forward(forces, 0.001, 3, 60)
    assert (first.start, first.until) == pytest.approx((0.0034, 0.0051))
    assert (second.start, second.until) == pytest.approx((0.013, 0.073))
    assert (third.start, third.until) == pytest.approx((0.063, 0.123))


def test_a_request_without_forces_is_empty():
    assert forces_to_request(simspec.load(simspec.find_spec("tumbling-body")).resolve()) == {}
    assert forces_from_request({}) is None
    assert isinstance(AppliedForces(simspec.load(simspec.find_spec("double-pendulum")).resolve()), AppliedForces)
