"""Control in every engine: laws act as in the oracle, runs record targets and efforts, and an engine's own controllers act only
while they track a target."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.arrays import SECONDS
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
    run_operation,
    servo_world,
    wheel,
    windows_operation,
    with_targets,
)
from simspec.world.actions import JointController, JointTrajectory
from simspec.world.types import Physics, RecordOptions, World

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
