"""Control in every engine: laws act as in the oracle, runs record targets and efforts, and an engine's own controllers act only
while they track a target. Forces and torques on bodies.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.arrays import SECONDS
from simspec.engines.kit.capabilities import DOUBLE
from simspec.errors import UnsupportedError
from simspec.proof.verify import verify
from simspec.runner.execution import run
from simspec.runner.run import Run
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.testing import worlds
from simspec.testing.bench import (
    SERVOS,
    Bench,
    OracleJoints,
    Suite,
    chain,
    closed_form,
    driven,
    failures,
    native,
    pushes,
    run_operation,
    servo_world,
    state_error,
    wheel,
    windows_operation,
    with_targets,
)
from simspec.world.actions import Force, JointController, JointTrajectory, KinematicMotion
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint, Physics, RecordOptions, World

STEPS = 250
EFFORT = 1e-3
"""N m: tolerance of an effort in single precision: a gain times the errors in position and speed."""
HINGES = ("hinge", "hinge", "hinge")


def with_load(damping: float = 0.0) -> World:
    """A driven chain of hinges, a falling free body with a hinge, and another chain that no controller drives."""
    first = chain(HINGES, damping=damping) if damping else chain(HINGES)
    more = worlds.tree(["free", "hinge"], 11, prefix="free-") + worlds.tree(["fixed", "hinge"], 12, prefix="idle-")
    joints = tuple(body.joint.name for body in first.bodies)
    q = np.array([body.joint.position[0] for body in first.bodies])
    world = driven(worlds.world(more + first.bodies, physics=first.physics), joints=joints)
    rows = (tuple(q.tolist()), tuple((q + 0.3).tolist()))
    return dataclasses.replace(world, trajectory=JointTrajectory(joints, (0.0, 0.5), rows, interpolation="quintic"))


HOLDS = (4, 3)
GAINS = (8.0, 0.3)


def wheels_with_hold(discretisation: str) -> World:
    """Two wheels under pd towards 0.5 rad, whose controllers act every 4 and every 3 steps."""
    bodies = tuple(
        dataclasses.replace(
            body, name=name, model=name, joint=dataclasses.replace(body.joint, name=f"{name}_joint"), shapes=()
        )
        for name in ("slow", "slower")
        for body in wheel(0.02).bodies
    )
    controllers = tuple(
        JointController(
            body.name,
            (body.joint.name,),
            discretisation=discretisation,
            kp=GAINS[:1],
            kd=GAINS[1:],
            effort_limits=(None,),
            every_steps=hold,
        )
        for body, hold in zip(bodies, HOLDS, strict=True)
    )
    world = dataclasses.replace(
        worlds.world(bodies, physics=Physics(timestep=0.002, steps=200)), controllers=controllers
    )
    return with_targets(world, np.array([0.5, 0.5]), tuple(body.joint.name for body in bodies))


def rows_with_hold(discretisation: str, steps: int) -> list[tuple[list[float], list[float]]]:
    """Of each wheel its positions, the first one included, and the efforts of the steps."""
    dt, inertia, (kp, kd) = 0.002, 0.02, GAINS
    found = []
    for hold in HOLDS:
        q = v = effort = 0.0
        time = hold * dt
        positions, efforts = [q], []
        for step in range(steps):
            if step % hold == 0 and discretisation == "explicit":
                effort = kp * (0.5 - q) - kd * v
            elif step % hold == 0:
                divisor = inertia + time * kd + time**2 * kp
                effort = inertia * (kp * (0.5 - q - time * v) - kd * v) / divisor
            v += dt * effort / inertia
            q += dt * v
            positions.append(q)
            efforts.append(effort)
        found.append((positions, efforts))
    return found


def recorded(bench: Bench, world: World) -> Run:
    """A whole run, as ``simspec run`` makes it."""
    made = run(world, bench.engine, python=bench.python)
    assert made.failed is None
    return made


class ControlSuite(Suite):
    """See the module."""

    @pytest.mark.parametrize("law", ["computed-torque", "pd"])
    @pytest.mark.parametrize("discretisation", ["explicit", "implicit"])
    def test_it_moves_as_the_oracle_does(self, bench: Bench, law: str, discretisation: str) -> None:
        controller = dataclasses.replace(driven(chain(HINGES), law).controllers[0], discretisation=discretisation)
        world = bench.allowed(dataclasses.replace(with_load(), controllers=(controller,)))
        if world is None:
            return
        control = Control(world, reference(world))
        oracle = OracleJoints(world, control)
        control.advance(oracle, 0, STEPS)
        q = bench.run(world, STEPS).arrays["q"][-1]
        np.testing.assert_allclose(q[control.q_places], oracle.q[control.q_places], atol=bench.near(1e-12))

    @pytest.mark.parametrize("discretisation", ["explicit", "implicit"])
    def test_efforts_are_constant_between_controller_updates(self, bench: Bench, discretisation: str) -> None:
        """One wheel looks every 4 steps, one every 3, recorded every 5: q and τ by a recursion of their own."""
        world = bench.allowed(wheels_with_hold(discretisation))
        if world is None:
            return
        steps, rows = 120, rows_with_hold(discretisation, 120)
        answer = bench.run(world, steps, 5)
        q, effort = answer.arrays["q"], answer.arrays["control.effort"]
        for column, (positions, efforts) in enumerate(rows):
            np.testing.assert_allclose(q[:, column], positions[::5], rtol=0.0, atol=bench.near(1e-13))
            np.testing.assert_allclose(effort[1:, column], efforts[4::5], rtol=0.0, atol=bench.near(1e-11, EFFORT))
        (windows,) = bench.ask(world, windows_operation(world, bench.run(world, steps, 12)))
        np.testing.assert_allclose(windows.arrays["q"][:, 0], rows[0][0][12::12], rtol=0.0, atol=bench.near(1e-13))

    def test_a_run_records_targets_and_efforts(self, bench: Bench) -> None:
        channels = () if bench.lacks("energy") else ("energy",)
        world = bench.allowed(dataclasses.replace(with_load(), record=RecordOptions(50, channels)))
        if world is None:
            return
        made = recorded(bench, dataclasses.replace(world, physics=dataclasses.replace(world.physics, steps=500)))
        about = made.provenance["control"]
        order = [list(reference(world).joints).index(joint) for joint in about["joints"]]
        (wanted,) = reference(world).position.at(made.time)
        np.testing.assert_allclose(made.arrays["control.target"], wanted[:, order], atol=1e-15)
        assert made.arrays["control.effort"].shape == (11, len(HINGES))
        assert not made.arrays["control.effort"][0].any()
        assert made.arrays["control.effort"][1:].all()
        assert max(about["error"]) < 0.05
        assert about["clipped"] == [0] * len(HINGES)
        assert made.provenance["seconds"]["control"] > 0.0
        if made.seconds is not None:
            assert (np.diff(made.seconds[:, SECONDS.index("control")]) > 0.0).all()

    def test_the_same_controlled_run_twice_gives_the_same_bits(self, bench: Bench) -> None:
        world = bench.allowed(with_load())
        if world is None:
            return
        answer, other = bench.ask(world, run_operation(world, STEPS, 10), run_operation(world, STEPS, 10))
        for name in ("q", "control.effort"):
            assert answer.arrays[name].tobytes() == other.arrays[name].tobytes()

    def test_windows_from_the_rows_of_a_run_end_in_the_next_rows(self, bench: Bench) -> None:
        """Under controllers, whose references begin in the middle, and without contact: nothing is remembered but the state."""
        world = bench.allowed(with_load())
        if world is None:
            return
        whole = bench.run(world, STEPS, 50)
        (ends,) = bench.ask(world, windows_operation(world, whole))
        assert len(ends.arrays["q"]) == STEPS // 50
        for name in ("q", "v", "pose", "velocity"):
            np.testing.assert_allclose(ends.arrays[name], whole.arrays[name][1:], rtol=0.0, atol=1e-12)

    @pytest.mark.parametrize("law", ["computed-torque", "pd"])
    def test_the_proof_holds_the_step_response(self, bench: Bench, law: str) -> None:
        world = bench.allowed(driven(chain(HINGES), law))
        if world is None:
            return
        proof = bench.proof(world, "L7")
        if bench.lacks("contact_off"):
            assert proof.not_checked["L7"] == bench.lacks("contact_off")
            return
        checks = proof.level("L7")
        assert [check.name for check in checks] == ["step response", "step response, closed form"][: len(checks)]
        assert len(checks) == (2 if law == "computed-torque" else 1)
        assert all(
            check.passed and check.worst is not None and check.worst < bench.near(1e-12) and check.count >= 100
            for check in checks
        )

    def test_an_engine_that_holds_another_mass_fails_the_step_response(self, bench: Bench) -> None:
        """M of the law is the world's: files of another world move otherwise."""
        world = bench.allowed(driven(chain(HINGES)))
        if world is None or bench.lacks("contact_off"):
            return
        heavy = world.bodies[-1]
        inertial = dataclasses.replace(heavy.inertial, mass=heavy.inertial.mass * 1.001)
        other = dataclasses.replace(world, bodies=(*world.bodies[:-1], dataclasses.replace(heavy, inertial=inertial)))
        folder = bench.place / "other-mass"
        write_folder(compile_world(other, [bench.engine])[bench.engine].files, folder)
        pythons = {} if bench.python is None else {bench.engine: bench.python}
        proven = verify(world, [bench.engine], artifacts={bench.engine: folder}, pythons=pythons, levels=["L7"])
        assert [check.passed for check in proven.engines[bench.engine].level("L7")] == [False, False]

    # --- the engine's own controllers -----------------------------------------------------------------------------

    def test_native_controllers_are_declared_alike(self, bench: Bench) -> None:
        """As a capability of the engine, and as a feature of the language."""
        supported = bench.support[Feature.CONTROL_NATIVE].level is not Level.UNSUPPORTED
        assert supported == (not bench.lacks("native_controllers"))

    @pytest.mark.parametrize("timestep", [0.001, 0.008])
    def test_a_native_controller_follows_its_declared_law(self, bench: Bench, timestep: float) -> None:
        """Step by step: at its limit and below, with a target at rest and in motion, and under a constant load."""
        world = bench.allowed(servo_world(timestep))
        if world is None:
            return
        declared = bench.kind.NATIVE_LAW
        assert declared is not None
        steps = round(1.0 / timestep)
        answer = bench.run(world, steps, 1)
        measured = answer.arrays["q"]
        largest_error = dict(zip(answer.result["control"]["joints"], answer.result["control"]["error"], strict=True))
        for column, servo in enumerate(SERVOS):
            expected = closed_form(declared.law, servo, steps, timestep)
            np.testing.assert_allclose(
                measured[:, column], expected, rtol=0.0, atol=declared.accuracy, err_msg=servo.name
            )
            if not servo.speed:
                error = np.abs(measured[1:, column] - servo.target).max()
                assert largest_error[f"{servo.name}_joint"] == pytest.approx(error, abs=1e-15)

    @pytest.mark.parametrize("limit", [None, 0.4])
    def test_a_native_controller_settles_at_its_target_without_gravity(self, bench: Bench, limit: float | None) -> None:
        world = bench.allowed(with_targets(native(wheel(0.02), limit=limit), np.array([0.5])))
        if world is None:
            return
        declared = bench.kind.NATIVE_LAW
        assert declared is not None
        # the remaining error after 6 s is below 1e-9 of it; beyond that, the declared accuracy
        assert bench.run(world, 6000).arrays["q"][-1, 0] == pytest.approx(0.5, abs=max(1e-9, declared.accuracy))

    def test_a_native_controller_acts_only_while_it_tracks(self, bench: Bench) -> None:
        """In the probes of the proof, the files' controllers must not hold the joints."""
        base = wheel()
        joint = dataclasses.replace(base.bodies[0].joint, velocity=(1.0,))
        base = dataclasses.replace(base, bodies=(dataclasses.replace(base.bodies[0], joint=joint),))
        world = bench.allowed(with_targets(native(base), np.array([0.0])))
        if world is None:
            return
        assert bench.drive(world, (100, None))["velocity"][-1, 0, 5] == pytest.approx(1.0, abs=1e-13)
        assert abs(bench.run(world, 100).arrays["v"][-1, 0]) < 0.9

    def test_a_joint_without_gains_is_left_alone(self, bench: Bench) -> None:
        world = bench.allowed(with_targets(native(wheel(), kp=0.0, kd=0.0), np.array([1.0])))
        if world is None:
            return
        assert bench.run(world, 100).arrays["q"][-1, 0] == pytest.approx(0.0, abs=1e-13)

    def test_the_same_native_run_twice_gives_the_same_bits(self, bench: Bench) -> None:
        world = bench.allowed(with_targets(native(chain(HINGES), kp=200.0, kd=2.0), np.full(len(HINGES), 0.1)))
        if world is None:
            return
        answer, other = bench.ask(world, run_operation(world, STEPS), run_operation(world, STEPS))
        assert answer.arrays["q"].tobytes() == other.arrays["q"].tobytes()

    def test_the_proof_passes_a_native_world(self, bench: Bench) -> None:
        world = bench.allowed(
            with_targets(native(chain(HINGES), kp=200.0, kd=2.0, limit=100.0), np.full(len(HINGES), 0.1))
        )
        if world is None:
            return
        assert failures(bench.proof(world, "L0", "L1", "L2", "L3", "L6").checks) == []

    def test_feed_forward_is_refused_and_not_lost(self, bench: Bench) -> None:
        world = with_targets(native(wheel()), np.array([0.5]))
        assert world.trajectory is not None
        fed = dataclasses.replace(world, trajectory=dataclasses.replace(world.trajectory, efforts=((0.1,),)))
        with pytest.raises(UnsupportedError, match=r"feed-forward|control\.native"):
            bench.compiled(fed)

    def test_motors_under_a_law_reach_what_the_oracle_reaches(self, bench: Bench) -> None:
        """A whole second of pd on one wheel, against M v̇ = τ."""
        world = bench.allowed(with_targets(driven(wheel(), "pd"), np.array([1.0])))
        if world is None:
            return
        control = Control(world, reference(world))
        oracle = OracleJoints(world, control)
        control.advance(oracle, 0, 1000)
        assert isinstance(oracle.oracle, Oracle)
        np.testing.assert_allclose(bench.run(world, 1000).arrays["q"][-1], oracle.q, atol=bench.near(1e-12))


# Forces and torques on bodies: against closed forms, against the oracle, and together with controllers.

FORCE_STEPS = 120


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
        physics = Physics(timestep=0.001, steps=FORCE_STEPS)
        world = bench.allowed(dataclasses.replace(worlds.world(bodies, physics=physics), forces=(last, middle)))
        if world is None:
            return
        answer = bench.run(world, FORCE_STEPS)
        q, v = moved(world, FORCE_STEPS)
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
        free = worlds.world(bodies, physics=Physics(timestep=0.001, steps=FORCE_STEPS))
        world = bench.allowed(dataclasses.replace(driven(free, "pd", joints), forces=forces))
        if world is None:
            return
        control = Control(world, reference(world))
        oracle = OracleJoints(world, control)
        control.advance(oracle, 0, FORCE_STEPS)
        whole = bench.run(world, FORCE_STEPS, 30)
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
        world = worlds.world(bodies, physics=Physics(timestep=0.001, steps=FORCE_STEPS))
        allowed = bench.allowed(dataclasses.replace(world, motions=motions))
        if allowed is None:
            return
        pose = bench.run(allowed, FORCE_STEPS, 20).arrays["pose"]
        times = np.arange(0, FORCE_STEPS + 1, 20) * 0.001
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
