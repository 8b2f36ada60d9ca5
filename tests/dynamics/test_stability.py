"""Damping and springs that diverge, as predicted, against what the oracle does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import simspec
from simspec.dynamics.oracle import Oracle
from simspec.dynamics.stability import unstable
from simspec.errors import SpecError
from simspec.world.actions import Fluid, InertiaBox
from simspec.world.types import Body, Inertial, Joint, Physics, World
from tests import worlds

AT_REST = (0.0, 0.0, 0.0)


def wheel(timestep: float, inertia: float = 0.02, kind: str = "hinge", **joint: float) -> World:
    """One body on a joint through its centre of mass."""
    size = {"hinge": 1, "slide": 1, "ball": 4}[kind]
    position = (1.0, 0.0, 0.0, 0.0) if kind == "ball" else (0.0,) * size
    axis = (0.0, 0.0, 1.0) if kind != "ball" else AT_REST
    entry = Joint("j", kind, axis=axis, position=position, velocity=(0.0,) * (3 if kind == "ball" else 1), **joint)
    body = Body("wheel", "wheel", Inertial(0.7, inertia=(inertia,) * 3 + AT_REST), entry)
    return World("wheel", (body,), physics=Physics(AT_REST, timestep, 100))


@pytest.mark.parametrize("kind", ["hinge", "slide", "ball"])
@pytest.mark.parametrize(("damping", "stiffness"), [(3.2, 0.0), (0.0, 40.0), (0.8, 25.0)])
def test_a_joint_has_its_textbook_limit(kind, damping, stiffness):
    """2 d dt + k dt² = 4 m."""
    mass = 0.7 if kind == "slide" else 0.02
    limit = 2 * mass / damping if not stiffness else (np.sqrt(damping**2 + 4 * mass * stiffness) - damping) / stiffness
    spring = {"damping": damping, "spring_stiffness": stiffness}
    assert unstable(wheel(0.999 * limit, kind=kind, **spring)) == []
    (found,) = unstable(wheel(1.05 * limit, kind=kind, **spring))
    assert found.bodies == ("wheel",)
    assert found.largest_stable_step == pytest.approx(limit, rel=1e-3)
    assert found.growth > 1.0
    assert found.initially
    assert found.damping == (2 * damping * limit > stiffness * limit**2)


def swing(world: World, steps: int) -> np.ndarray:
    """The speed after each step of a small motion about the initial posture."""
    oracle = Oracle(world)
    q = np.array([body.joint.position[0] for body in world.bodies if body.joint.kind == "hinge"])
    return np.linalg.norm(oracle.motion(q, np.full(oracle.nv, 1e-12), np.zeros(oracle.nv), steps, 1)[1], axis=1)


def largest(world: World, steps: int) -> float:
    return float(swing(world, steps).max())


def grows(world: World) -> float:
    """By what factor the motion grows in a step, once it grows steadily."""
    speeds = swing(world, 20)
    return float(speeds[20] / speeds[19])


@pytest.mark.parametrize("damping", [0.05, 0.0])
def test_the_prediction_for_a_coupled_arm_happens(damping):
    """The prediction is of the arm as a whole, joints coupled by M, not of each joint by itself."""
    bodies = tuple(
        dataclasses.replace(
            body,
            joint=dataclasses.replace(
                body.joint, damping=damping, spring_stiffness=20.0, spring_rest=body.joint.position[0]
            ),
        )
        for body in worlds.tree(["hinge", "hinge", "hinge"], 4)
    )

    def at(timestep: float) -> World:
        return worlds.world(bodies, physics=Physics(AT_REST, timestep, 100))

    # of this posture alone: M, and with it the limit, changes with the others
    world = at(1.0)
    limits = [(body.joint.position[0] - 1e-9, body.joint.position[0] + 1e-9) for body in world.bodies]
    bodies = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, position_limits=limit))
        for body, limit in zip(bodies, limits, strict=True)
    )
    limit = unstable(at(1.0))[0].largest_stable_step
    assert unstable(at(0.999 * limit)) == []
    assert largest(at(0.97 * limit), 300) < 10.0 * largest(at(0.97 * limit), 60)
    (found,) = unstable(at(1.1 * limit))
    assert found.growth > 1.1
    assert grows(at(1.1 * limit)) == pytest.approx(found.growth, rel=0.02)


def test_the_joint_that_diverges_is_named_and_copies_of_a_model_too():
    def arm(prefix: str, heavy: float) -> tuple[Body, ...]:
        bodies = worlds.tree(["fixed", "hinge", "hinge", "hinge"], 9, prefix=prefix)
        changes = {2: {"damping": heavy}, 1: {"damping": 0.01}}
        return tuple(
            dataclasses.replace(body, joint=dataclasses.replace(body.joint, **changes.get(row, {})))
            for row, body in enumerate(bodies)
        )

    bodies = (*arm("a_", 300.0), *arm("b_", 0.02), *arm("c_", 300.0))
    found = unstable(worlds.world(bodies))
    assert [instability.bodies for instability in found] == [("a_link2",), ("c_link2",)]
    assert found[0].growth == found[1].growth


def test_a_posture_other_than_the_initial_counts_and_is_reported():
    """A slide moves the weight to the axis: the hinge's inertia falls from 1 to 0.1 kg m² within the slide's limits."""
    flat = Inertial(1.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    light = Inertial(1e-3, inertia=(1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0))
    hinge = Joint("turn", "hinge", axis=(0.0, 0.0, 1.0), damping=1.0, position=(0.0,), velocity=(0.0,))
    slide = Joint(
        "reach", "slide", "arm", axis=(1.0, 0.0, 0.0), position_limits=(-1.0, 1.0), position=(1.0,), velocity=(0.0,)
    )
    bodies = (Body("arm", "arm", light, hinge), Body("weight", "arm", flat, slide))
    assert unstable(worlds.world(bodies, physics=Physics(AT_REST, 0.1, 10))) == []
    (found,) = unstable(worlds.world(bodies, physics=Physics(AT_REST, 0.5, 10)))
    assert not found.initially
    assert "at some postures within its limits" in str(found)


def test_joints_without_friction_and_springs_are_not_checked(monkeypatch):
    monkeypatch.setattr("simspec.dynamics.stability.OracleTree", None)
    assert unstable(worlds.every_joint()) == []


SPEC = """
simspec: 1
name: stiff
physics: {gravity: [0, 0, -9.81], timestep: 10 ms, duration: 1 s}
bodies:
  mass:
    mass: 1 kg
    joint: {type: slide, axis: [1, 0, 0], spring: {stiffness: 1.0e9}, damping: DAMPING}
    shapes:
      - {box: {size: [0.1, 0.1, 0.1]}, collision: false}
"""


@pytest.mark.parametrize(
    ("spec", "path", "largest"),
    [
        (SPEC.replace("DAMPING", "0"), "bodies.mass.joint.spring.stiffness", "up to 6.32e-05 s"),
        (SPEC.replace("1.0e9", "1").replace("DAMPING", "320"), "bodies.mass.joint.damping", "up to 0.00625 s"),
    ],
)
def test_check_says_the_joint_its_place_and_the_largest_timestep(spec, path, largest, tmp_path):
    file = tmp_path / "stiff.yaml"
    file.write_text(spec)
    with pytest.raises(SpecError) as caught:
        simspec.load(file).resolve()
    (problem,) = caught.value.problems
    assert problem.path == path
    assert problem.location.line == 8
    assert problem.allowed == largest
    assert "grow by a factor of" in problem.message


def test_masses_beyond_double_precision_are_reported():
    """Found by fuzzing a robot file: a mass of 1e20 kg, whose mass matrix has no inverse."""
    heavy = {"mass": 1e20, "centre_of_mass": [0, 0, 0.5], "inertia": {"principal": [0.1, 0.1, 0.1]}}
    light = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}
    data = {
        "simspec": 1,
        "name": "w",
        "bodies": {
            "base": {"fixed": True},
            "arm": {"parent": "base", "joint": {"type": "hinge", "axis": [0, 1, 0], "damping": 1}, **heavy},
            "wrist": {"parent": "arm", "joint": {"type": "slide", "axis": [1, 0, 0]}, **light},
            "tip": {"parent": "wrist", "joint": {"type": "hinge", "axis": [0, 1, 0]}, **heavy},
        },
    }
    with pytest.raises(SpecError, match="singular in double precision") as error:
        simspec.Spec.from_data(data).resolve()
    assert error.value.problems[0].path == "bodies.base"


def test_damping_of_a_joint_and_of_a_viscous_fluid_adds_up():
    """2 (d + b) dt = 4 m, with b = 3 π μ D of the box that the fluid resists; d = b here."""

    def world(timestep: float) -> World:
        dry = wheel(timestep, kind="slide", damping=resistance)
        (body,) = dry.bodies
        physics = dataclasses.replace(dry.physics, fluid=Fluid(viscosity=1.5))
        return dataclasses.replace(
            dry, bodies=(dataclasses.replace(body, box=InertiaBox((0.2, 0.2, 0.2))),), physics=physics
        )

    resistance = 3.0 * np.pi * 1.5 * 0.2
    limit = 0.7 / resistance
    assert unstable(world(0.99 * limit)) == []
    (found,) = unstable(world(1.01 * limit))
    assert found.largest_stable_step == pytest.approx(limit, rel=1e-3)
