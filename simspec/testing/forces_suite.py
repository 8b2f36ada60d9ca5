"""Forces and torques on bodies in every engine: against closed forms, against the oracle, and together with controllers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import DOUBLE
from simspec.proof.verify import verify
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.testing import worlds
from simspec.testing.bench import Bench, OracleJoints, Suite, driven, pushes, state_error, windows_operation
from simspec.world.actions import Force, KinematicMotion
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint, Physics, World

STEPS = 120


def brick(forces: tuple[Force, ...], timestep: float = 0.001, turned: bool = True) -> World:
    """A free rigid body at rest, without gravity, whose centre of mass is not its frame's origin."""
    turn = (0.5, 0.5, 0.5, 0.5) if turned else (1.0, 0.0, 0.0, 0.0)
    joint = Joint("brick_joint", "free", position=(0.1, -0.2, 0.3, *turn), velocity=(0.0,) * 6)
    body = Body("brick", "brick", Inertial(2.0, (0.05, 0.0, 0.1), (0.02, 0.02, 0.02, 0.0, 0.0, 0.0)), joint)
    physics = Physics((0.0, 0.0, 0.0), timestep, 1000)
    return dataclasses.replace(worlds.world((body,), physics=physics), forces=forces)


def moved(world: World, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The oracle's state after so many steps, with its own Jacobians of the forces."""
    oracle = Oracle(world)
    q, v = initial_state(world)
    for step in range(steps):
        q, v = oracle.step(q, v, pushes(oracle, q, step))
    return q, v


class ForcesSuite(Suite):
    """See the module."""

    def test_forces_are_declared(self, bench: Bench) -> None:
        level = bench.support[Feature.FORCES].level
        assert level is not Level.UNSUPPORTED or bench.allowed(brick((Force("brick", (1.0, 0.0, 0.0)),))) is None

    @pytest.mark.parametrize("timestep", [0.001, 0.004])
    def test_a_push_gives_its_impulse_at_any_timestep(self, bench: Bench, timestep: float) -> None:
        """A push from 10.4 ms to 31.7 ms, on no bounds of steps: v = F t/m. A torque: ω = T t/I of a body that is round."""
        push = Force("brick", (3.0, -2.0, 5.0), (0.0, 0.0, 0.0), (0.05, 0.0, 0.1), 0.0104, 0.0317)
        twist = Force("brick", torque=(0.02, 0.05, -0.03), start=0.002, until=0.0317)
        world = bench.allowed(brick((push, twist), timestep))
        if world is None:
            return
        v = bench.run(world, round(0.048 / timestep)).arrays["v"][-1]
        np.testing.assert_allclose(v[:3], np.array(push.force) * 0.0213 / 2.0, rtol=bench.near(1e-12, 1e-5))
        turn = bench.run(world, round(0.048 / timestep)).arrays["velocity"][-1, 0, 3:]
        np.testing.assert_allclose(turn, np.array(twist.torque) * 0.0297 / 0.02, rtol=bench.near(1e-12, 1e-5))

    def test_a_push_off_the_centre_of_mass_turns_the_body(self, bench: Bench) -> None:
        """In the first step the lever is exactly known: Δω = r × F dt/I, Δv = F dt/m."""
        force = Force("brick", (0.0, 6.0, 0.0), at=(0.05, 0.0, 0.4), until=0.001)
        world = bench.allowed(brick((force,), turned=False))
        if world is None:
            return
        velocity = bench.run(world, 1).arrays["velocity"][-1, 0]
        spin = np.cross((0.0, 0.0, 0.3), force.force) * 0.001 / 0.02
        lever = np.array([0.05, 0.0, 0.1])
        np.testing.assert_allclose(velocity[3:], spin, atol=bench.near(1e-15), rtol=bench.near(1e-12))
        # the frame's origin, after the turn of the step
        np.testing.assert_allclose(velocity[:3], np.array([0.0, 0.003, 0.0]) - np.cross(spin, lever), atol=1e-5)

    @pytest.mark.parametrize(
        "kinds", [("free", "hinge", "slide"), ("hinge", "ball", "hinge"), ("slide", "fixed", "hinge")]
    )
    def test_bodies_of_trees_move_as_in_the_oracle(self, bench: Bench, kinds: tuple[str, ...]) -> None:
        bodies = worlds.tree(list(kinds), 21)
        last = Force("link2", (20.0, -10.0, 5.0), (0.3, 0.2, -0.1), (0.1, 0.02, -0.05), 0.0053, 0.0407)
        middle = Force("link1", (-4.0, 6.0, 9.0), start=0.03)
        physics = Physics(timestep=0.001, steps=STEPS)
        world = bench.allowed(dataclasses.replace(worlds.world(bodies, physics=physics), forces=(last, middle)))
        if world is None:
            return
        answer = bench.run(world, STEPS)
        q, v = moved(world, STEPS)
        assert state_error(world, answer.arrays["q"][-1], q) < bench.near(1e-10, 1e-4)
        np.testing.assert_allclose(answer.arrays["v"][-1], v, atol=bench.near(1e-9, 1e-3))

    def test_forces_act_together_with_controllers_and_leave_nothing_behind(self, bench: Bench) -> None:
        """On a driven tree and on an undriven one, with pauses, recorded at moments that are no bounds of forces."""
        bodies = worlds.tree(["hinge", "hinge"], 5) + worlds.tree(["free", "hinge"], 6, prefix="loose-")
        joints = tuple(body.joint.name for body in bodies[:2])
        forces = (
            Force("link1", (3.0, 1.0, -2.0), at=(0.1, 0.0, 0.0), start=0.0105, until=0.0212),
            Force("loose-link1", (1.0, -2.0, 3.0), (0.1, 0.0, 0.2), start=0.03, until=0.05),
            Force("loose-link0", (0.0, 5.0, 0.0), start=0.08, until=0.0801),
        )
        free = worlds.world(bodies, physics=Physics(timestep=0.001, steps=STEPS))
        world = bench.allowed(dataclasses.replace(driven(free, "pd", joints), forces=forces))
        if world is None:
            return
        control = Control(world, reference(world))
        oracle = OracleJoints(world, control)
        control.advance(oracle, 0, STEPS)
        whole = bench.run(world, STEPS, 30)
        assert state_error(world, whole.arrays["q"][-1], oracle.q) < bench.near(1e-10, 1e-4)
        (windows,) = bench.ask(world, windows_operation(world, whole))
        for name in ("q", "v"):
            np.testing.assert_allclose(
                windows.arrays[name], whole.arrays[name][1:], rtol=0.0, atol=bench.near(1e-12, 1e-4)
            )

    def test_a_kinematic_body_follows_its_motion_and_carries_its_children(self, bench: Bench) -> None:
        """A slide on it along its direction of motion stays where it is; a hinge about its axis does not turn with it."""
        base = Joint("base_joint", "free", position=(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
        isotropic = (0.01, 0.01, 0.01, 0.0, 0.0, 0.0)
        slider = Joint("slider_joint", "slide", "base", axis=(1.0, 0.0, 0.0), position=(0.0,), velocity=(0.0,))
        wheel = Joint("wheel_joint", "hinge", "second", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
        second = dataclasses.replace(base, name="second_joint", position=(0.0, 5.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        heavy = Inertial(1e5, inertia=(1e5, 1e5, 1e5, 0.0, 0.0, 0.0))
        bodies = (
            Body("base", "base", heavy, base),
            Body("slider", "base", Inertial(1.0, inertia=isotropic), slider),
            Body("second", "second", heavy, second),
            Body("wheel", "second", Inertial(1.0, inertia=isotropic), wheel),
        )
        turn = (np.cos(1.5), 0.0, 0.0, np.sin(1.5))
        motions = (
            KinematicMotion(
                "base", (0.0, 0.1), ((0.0, 0.0, 1.0), (0.7, 0.0, 1.0)), ((1.0, 0.0, 0.0, 0.0),) * 2, "quintic"
            ),
            KinematicMotion("second", (0.02, 0.1), ((0.0, 5.0, 0.0),) * 2, ((1.0, 0.0, 0.0, 0.0), turn), "linear"),
        )
        world = worlds.world(bodies, physics=Physics(timestep=0.001, steps=STEPS))
        allowed = bench.allowed(dataclasses.replace(world, motions=motions))
        if allowed is None:
            return
        pose = bench.run(allowed, STEPS, 20).arrays["pose"]
        times = np.arange(0, STEPS + 1, 20) * 0.001
        share = np.clip(times / 0.1, 0.0, 1.0)
        np.testing.assert_allclose(
            pose[:, 0, 0], 0.7 * share**3 * (10 - 15 * share + 6 * share**2), atol=bench.near(1e-8)
        )
        np.testing.assert_allclose(pose[:, 1, 0], 0.0, atol=bench.near(1e-8))
        angle = 2.0 * np.arctan2(pose[:, 2, 6], pose[:, 2, 3])
        np.testing.assert_allclose(angle, 3.0 * np.clip((times - 0.02) / 0.08, 0.0, 1.0), atol=bench.near(1e-8))
        np.testing.assert_allclose(pose[:, 3, 6], 0.0, atol=bench.near(1e-8))
        proof = bench.proof(allowed, "L7")
        if bench.lacks("contact_off"):
            assert proof.not_checked["L7"] == bench.lacks("contact_off")
            return
        (check,) = proof.level("L7")
        assert (check.name, check.passed, check.count) == ("prescribed motion", True, 202), check
        # the bodies that hang on it weigh 1e-5 of it, so that 0.1 % of its mass is less than singles are compared to; L1
        # compares masses
        lighter = dataclasses.replace(heavy, mass=heavy.mass * bench.near(0.999, 0.98))
        other = dataclasses.replace(allowed, bodies=(dataclasses.replace(bodies[0], inertial=lighter), *bodies[1:]))
        folder = bench.place / "other-base"
        write_folder(compile_world(other, [bench.engine])[bench.engine].files, folder)
        proven = verify(allowed, [bench.engine], artifacts={bench.engine: folder}, pythons=bench.pythons, levels=["L7"])
        assert [check.passed for check in proven.engines[bench.engine].level("L7")] == [False]

    def test_the_proof_holds_the_forces(self, bench: Bench) -> None:
        """With a defect: files of a body that is a thousandth heavier."""
        bodies = worlds.tree(["free", "hinge", "hinge"], 8)
        forces = (Force("link2", (2.0, 1.0, 0.5), at=(0.1, 0.0, 0.0), start=0.5004, until=0.6),)
        world = bench.allowed(dataclasses.replace(worlds.world(bodies), forces=forces))
        if world is None:
            return
        proof = bench.proof(world, "L7")
        if bench.lacks("contact_off"):
            assert proof.not_checked["L7"] == bench.lacks("contact_off")
            return
        (check,) = proof.level("L7")
        assert (check.name, check.passed) == ("applied forces", True), check
        assert check.tolerance == 1e-9 or bench.kind.PRECISION != DOUBLE
        heavy = dataclasses.replace(bodies[2].inertial, mass=bodies[2].inertial.mass * 1.001)
        other = dataclasses.replace(world, bodies=(*bodies[:2], dataclasses.replace(bodies[2], inertial=heavy)))
        folder = bench.place / "other-mass-pushed"
        write_folder(compile_world(other, [bench.engine])[bench.engine].files, folder)
        proven = verify(world, [bench.engine], artifacts={bench.engine: folder}, pythons=bench.pythons, levels=["L7"])
        assert [check.passed for check in proven.engines[bench.engine].level("L7")] == [False]
