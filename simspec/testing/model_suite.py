"""The engine's model, its states, its dynamics, contact in general: requirements that are the same for every engine.

An unsupported feature is refused with the declared error, which is asserted and never skipped; the proof does not request an
operation that the engine lacks (``Engine.LACKS``), and a request for it raises.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from simspec.contact import combine as combined
from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.kit.arrays import CONTACT_FIELDS, SECONDS
from simspec.engines.kit.process import Answer, Operation
from simspec.engines.kit.settings import check_settings, idle_settings
from simspec.errors import EngineError, UnsupportedError
from simspec.proof import limits
from simspec.proof.checks import Check
from simspec.proof.probes import dynamics_operation
from simspec.proof.selftest_worlds import constrained, sums
from simspec.proof.verify import read_back_checks
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.testing import worlds
from simspec.testing.bench import (
    DIRECT,
    NEEDING,
    Bench,
    Suite,
    failures,
    motion_operation,
    run_operation,
    state_error,
    touching_operation,
)
from simspec.world.kinematics import initial_state
from simspec.world.rotations import rotation_error
from simspec.world.types import Surface, World

WORLDS: Mapping[str, Callable[[], World]] = {
    "fall": worlds.fall,
    "hinges": worlds.hinges,
    "every joint": worlds.every_joint,
    "damped springs": worlds.damped_springs,
    "lifted": worlds.lifted,
    "immersed": worlds.immersed,
    "limits": worlds.limits_and_armature,
    "shapes": worlds.shapes_world,
    "meshes": worlds.meshes,
    "spheres": worlds.spheres,
    "gripper": worlds.gripper,
    "weightless": worlds.weightless,
    "several joints": worlds.several_joints,
    "held": lambda: dataclasses.replace(
        constrained(""), engines=()
    ),  # the bench adds the options that its engine needs
    "sums": lambda: dataclasses.replace(sums(""), engines=()),
}
"""From little to much: an engine may refuse some, by declaration, but not the first."""
MUST_BE_THERE = ("fall",)
STEPS = 300
"""Of the motion of each world."""
MOVED = 1e-4
"""Tolerance for engines in single precision after it (rad, m, m/s): ten times the effect of rounding on hinges there."""
CLOSED = 2e-3
"""The same of velocities in loops, where each step removes the gaps of places in single precision: 1e-7 m in 1 ms, on levers of
0.1 m."""


@dataclass(frozen=True)
class Known:
    """One world, and all answers of the engine about it, queried at once; ``q``, ``v`` are the states (k, nq), (k, nv) of the
    questions, ``effort`` (nv,) that of the motion, which begins in the first."""

    world: World
    oracle: Oracle
    q: np.ndarray
    v: np.ndarray
    effort: np.ndarray
    answers: Mapping[str, Answer]


def known(bench: Bench, world: World) -> Known:
    """Ask for all that the engine does not lack."""
    oracle = Oracle(world)
    q, v = random_states(world, 3)
    start, speed = (state[0] for state in random_states(world, 1, seed=5, speed=0.3))
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        if body.joint.position_limits is not None:
            start[at] = sum(body.joint.position_limits) / 2
    start = oracle.settled(start, initial_state(world)[0])
    speed = oracle.constrained_velocity(start, speed)
    q[0], v[0] = start, speed
    effort = 0.2 * np.diag(oracle.mass_matrix(start))
    channels = () if bench.lacks("energy") else ("energy",)
    operations = {
        "read_back": Operation("read_back", world=world),
        "kinematics": Operation("kinematics", {}, {"q": q, "v": v}, world),
        "run": run_operation(world, 20, 10, *channels),
    }
    quantities = tuple(name for name in ("mass_matrix", "bias_force") if not bench.lacks(name))
    if quantities:
        operations["dynamics"] = dynamics_operation(oracle, q, v, quantities)
    if not bench.lacks("contact_off"):
        operations["motion"] = motion_operation(world, start, speed, effort, STEPS, STEPS)
        operations["motion in parts"] = motion_operation(world, start, speed, effort, STEPS, 5)
    answers = dict(zip(operations, bench.ask(world, *operations.values()), strict=True))
    return Known(world, oracle, q, v, effort, answers)


class ModelSuite(Suite):
    """See the module."""

    @pytest.fixture(scope="class", params=WORLDS)
    @classmethod
    def known(cls, request: pytest.FixtureRequest, bench: Bench) -> Known | None:
        """One of the worlds with the engine's answers; None where the engine refuses it, as declared."""
        world = bench.allowed(WORLDS[request.param]())
        assert world is not None or request.param not in MUST_BE_THERE, f"{request.param}: no engine may refuse this"
        return None if world is None else known(bench, world)

    def test_the_engine_holds_the_world(self, bench: Bench, known: Known | None) -> None:
        if known is None:
            return
        read_back = known.answers["read_back"].read_back
        assert read_back is not None
        checks: list[Check] = read_back_checks(known.world, bench.kind, read_back)
        assert failures(checks) == []
        assert {"mass", "joint type", "gravity", "timestep"} <= {check.name for check in checks}

    def test_it_starts_in_the_initial_state(self, bench: Bench, known: Known | None) -> None:
        if known is None:
            return
        q, v = initial_state(known.world)
        recorded = known.answers["run"].arrays
        assert state_error(known.world, recorded["q"][0], q) < bench.near(1e-12)
        np.testing.assert_allclose(recorded["v"][0], v, rtol=0, atol=bench.near(1e-12))

    def test_states_go_in_and_come_out(self, bench: Bench, known: Known | None) -> None:
        if known is None:
            return
        given_back = known.answers["kinematics"].arrays
        for row in range(len(known.q)):
            assert state_error(known.world, given_back["q"][row], known.q[row]) < bench.near(1e-12)
            np.testing.assert_allclose(given_back["v"][row], known.v[row], rtol=0, atol=bench.near(1e-12))

    def test_poses_and_velocities_are_the_oracle_s(self, bench: Bench, known: Known | None) -> None:
        if known is None:
            return
        arrays = known.answers["kinematics"].arrays
        for row, (q, v) in enumerate(zip(known.q, known.v, strict=True)):
            expected = known.oracle.body_poses(q)
            np.testing.assert_allclose(arrays["pose"][row][:, :3], expected[:, :3], rtol=0, atol=bench.near(1e-11))
            assert rotation_error(arrays["pose"][row][:, 3:], expected[:, 3:]).max() < bench.near(1e-11)
            velocity = known.oracle.body_velocities(q, v)
            np.testing.assert_allclose(arrays["velocity"][row], velocity, rtol=0, atol=bench.near(1e-10))

    def test_mass_matrix_and_bias_force_are_the_oracle_s(self, bench: Bench, known: Known | None) -> None:
        if known is None:
            return
        for row, (q, v) in enumerate(zip(known.q, known.v, strict=True)):
            if not bench.lacks("mass_matrix"):
                mass = np.concatenate([block.ravel() for block in known.oracle.mass_blocks(q)] or [np.zeros(0)])
                scale = np.abs(mass).max(initial=0.0)
                actual = known.answers["dynamics"].arrays["mass"][row]
                np.testing.assert_allclose(actual, mass, rtol=0, atol=bench.near(1e-9) * scale)
            if not bench.lacks("bias_force"):
                bias = known.oracle.bias_force(q, v)
                actual = known.answers["dynamics"].arrays["bias_force"][row]
                scale = max(1.0, np.abs(bias).max(initial=0.0))
                np.testing.assert_allclose(actual, bias, rtol=0, atol=bench.near(1e-9) * scale)

    def test_sums_stop_at_their_limits(self, bench: Bench) -> None:
        world = bench.allowed(NEEDING[Feature.SUM_LIMITS]())
        if world is None or bench.lacks("contact_off"):
            return
        pressed = limits.plan(world, Oracle(world))
        assert pressed is not None
        (answer,) = bench.ask(world, pressed.operation(world))
        assert failures(pressed.checks(world, answer.arrays)) == []

    def test_lacking_operations_raise(self, bench: Bench) -> None:
        world = bench.allowed(worlds.fall())
        assert world is not None
        oracle = Oracle(world)
        q, v = random_states(world, 1)
        operations = {
            "mass_matrix": dynamics_operation(oracle, q, v, ("mass_matrix",)),
            "bias_force": dynamics_operation(oracle, q, v, ("bias_force",)),
            "pair_detection": touching_operation(world, q),
            "contact_off": motion_operation(world, q[0], v[0], 0.0 * v[0], 1, 1),
            "energy": run_operation(world, 1, 1, "energy"),
        }
        for capability, operation in operations.items():
            if bench.lacks(capability):
                with pytest.raises(EngineError):
                    bench.ask(world, operation)

    def test_contact_free_motion_is_the_oracle_s(self, bench: Bench, known: Known | None) -> None:
        if known is None or bench.lacks("contact_off"):
            return
        expected_q, expected_v = (
            states[-1] for states in known.oracle.motion(known.q[0], known.v[0], known.effort, STEPS, STEPS)
        )
        moved = known.answers["motion"].arrays
        assert state_error(known.world, moved["q"][-1], expected_q) < bench.near(1e-10, MOVED)
        near = bench.near(1e-9, CLOSED if known.world.constraints else MOVED)
        np.testing.assert_allclose(moved["v"][-1], expected_v, rtol=0, atol=near)

    def test_steps_in_a_single_call_and_in_many_are_the_same(self, bench: Bench, known: Known | None) -> None:
        if known is None or bench.lacks("contact_off"):
            return
        at_once, in_parts = (known.answers[name].arrays for name in ("motion", "motion in parts"))
        assert state_error(known.world, at_once["q"][-1], in_parts["q"][-1]) < bench.near(1e-12)
        np.testing.assert_allclose(at_once["v"][-1], in_parts["v"][-1], rtol=0, atol=bench.near(1e-12))

    def test_energy_is_that_of_the_moving_bodies(self, bench: Bench, known: Known | None) -> None:
        if known is None or bench.lacks("energy"):
            return
        recorded = known.answers["run"].arrays
        expected = np.array([known.oracle.energy(*state) for state in zip(recorded["q"], recorded["v"], strict=True)])
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(
            recorded["energy"][:, 0], expected[:, 0], rtol=bench.near(1e-9), atol=bench.near(1e-12) * scale
        )
        # a body that is fixed to the world has a constant potential, which an engine may or may not count
        gained, wanted = recorded["energy"][:, 1] - recorded["energy"][0, 1], expected[:, 1] - expected[0, 1]
        np.testing.assert_allclose(gained, wanted, rtol=bench.near(1e-8), atol=bench.near(1e-9) * scale)

    def test_two_loads_step_alike_to_the_last_bit(self, bench: Bench) -> None:
        world = bench.first_allowed()
        answer, other = bench.ask(world, run_operation(world, STEPS), run_operation(world, STEPS))
        for name in ("q", "v"):
            assert answer.arrays[name].tobytes() == other.arrays[name].tobytes()

    def test_seconds_are_recorded_for_each_row(self, bench: Bench) -> None:
        """A program of its own need not tell them; the totals are its word, which the rows must fit."""
        world = bench.first_allowed()
        answer = bench.run(world, 50, 10)
        if bench.kind.command(bench.place) is not None and "seconds" not in answer.arrays:
            return
        seconds = {name: answer.arrays["seconds"][:, column] for column, name in enumerate(SECONDS)}
        for name in ("step", "step_cpu", "record", "record_cpu"):
            assert seconds[name][0] == 0.0
            assert (np.diff(seconds[name]) > 0.0).all(), name
        assert seconds["step"][-1] == pytest.approx(answer.result["step_seconds"])
        assert seconds["step_cpu"][-1] == pytest.approx(answer.result["cpu_seconds"])
        assert 0.0 < seconds["record"][-1] < answer.result["record_seconds"]  # the last row's own is not in it
        assert not seconds["control"].any()

    # --- contact --------------------------------------------------------------------------------------------------

    def test_a_resting_sphere_is_pressed_up_by_its_weight(self, bench: Bench) -> None:
        world = bench.allowed(worlds.placed(worlds.spheres(1), 1, (0.3, 0.2, 0.1)))
        if world is None:
            return
        arrays = bench.run(world, 200, 200, "contacts").arrays
        contacts = {name: arrays[f"contact.{name}"][arrays["contact.row"] == 1] for name in CONTACT_FIELDS}
        assert {key: value.shape[1:] for key, value in contacts.items()} == dict(CONTACT_FIELDS)
        assert len(contacts["distance"]) == 1
        assert sorted(contacts["body"][0]) == [0, 1]
        up = contacts["normal"][0] * (1.0 if contacts["body"][0][0] == 1 else -1.0)
        np.testing.assert_allclose(up, (0.0, 0.0, 1.0), atol=bench.near(1e-9))
        np.testing.assert_allclose(contacts["position"][0], (0.3, 0.2, 0.0), atol=2e-3)
        assert -2e-3 < contacts["distance"][0] <= 1e-6
        assert contacts["normal_force"][0] == pytest.approx(98.1, rel=0.02)

    def test_bodies_in_the_air_touch_nothing(self, bench: Bench) -> None:
        world = bench.allowed(worlds.spheres())
        if world is None:
            return
        arrays = bench.run(world, 5, 1, "contacts").arrays
        assert arrays["contact.row"].shape == (0,)
        assert arrays["contact.body"].shape == (0, 2)

    def test_detection_obeys_the_filters(self, bench: Bench) -> None:
        world = bench.allowed(worlds.gripper())
        if world is None or bench.lacks("pair_detection"):
            return
        names = [body.name for body in world.bodies]
        q, _ = initial_state(world)
        air = q.copy()
        # the fingers slide to the middle, where they overlap each other, and the bar with both
        q[1], q[2] = 0.28, -0.28
        q[3:6] = (0.0, 0.03, -0.3)
        (answer,) = bench.ask(world, touching_operation(world, np.array([air, q])))
        touching = {(row, names[a], names[b]) for row, a, b in answer.arrays["touching"]}
        assert touching == {(1, "left", "bar"), (1, "right", "bar")}

    @pytest.mark.parametrize("fixed", [False, True], ids=["moving", "fixed"])
    def test_joined_bodies_touch_where_the_world_lets_them(self, bench: Bench, fixed: bool) -> None:
        world = bench.allowed(worlds.touching_link(fixed))
        if world is None or bench.lacks("pair_detection"):
            return
        names = [body.name for body in world.bodies]
        (answer,) = bench.ask(world, touching_operation(world, initial_state(world)[0][None]))
        assert {(names[a], names[b]) for _, a, b in answer.arrays["touching"]} == {("palm", "left")}

    def test_without_contact_a_sphere_falls_through_the_floor(self, bench: Bench) -> None:
        world = bench.allowed(worlds.spheres(1))
        if world is None or bench.lacks("contact_off"):
            return
        q, v = initial_state(world)
        (answer,) = bench.ask(world, motion_operation(world, q, v, 0.0 * v, 1000, 1000))
        # semi-implicit Euler falls g dt² n (n + 1) / 2
        assert answer.arrays["q"][-1, 2] == pytest.approx(
            0.5 - 9.81 * 1e-6 * 1000 * 1001 / 2, abs=bench.near(1e-9, 1e-4)
        )

    def test_armature_is_in_the_mass_matrix(self, bench: Bench) -> None:
        world = worlds.limits_and_armature(armature=0.05)
        bodies = tuple(
            dataclasses.replace(body, joint=dataclasses.replace(body.joint, position_limits=None))
            for body in world.bodies
        )
        allowed = bench.allowed(dataclasses.replace(world, bodies=bodies))
        if allowed is None or bench.lacks("mass_matrix"):
            return
        oracle = Oracle(allowed)
        q, v = (state[None] for state in initial_state(allowed))
        (answer,) = bench.ask(allowed, dynamics_operation(oracle, q, v, ("mass_matrix",)))
        expected = np.concatenate([block.ravel() for block in oracle.mass_blocks(q[0])])
        np.testing.assert_allclose(answer.arrays["mass"][0], expected, rtol=0, atol=bench.near(1e-9))

    # --- what is declared -----------------------------------------------------------------------------------------

    @pytest.mark.parametrize("feature", list(NEEDING), ids=str)
    def test_a_gap_raises_the_error_it_declares(self, bench: Bench, feature: Feature) -> None:
        """Every feature that the engine has only approximately, outside or not at all is refused unless named."""
        if bench.support[feature].level in DIRECT:
            return
        errors = [gap_error(bench, feature, settings) for settings in settings_of(bench)]
        assert any(feature.value in error for error in errors), f"{feature} is declared as less, and compiled"

    @pytest.mark.parametrize("feature", [Feature.GRAVITY, Feature.TIMESTEP, Feature.INERTIA], ids=str)
    def test_the_core_of_the_language_is_exact_everywhere(self, bench: Bench, feature: Feature) -> None:
        assert bench.support[feature].level in DIRECT

    def test_every_support_that_is_less_than_exact_says_how(self, bench: Bench) -> None:
        silent = [
            feature
            for feature, support in bench.support.items()
            if support.level is not Level.EXACT and not support.how
        ]
        assert silent == []

    def test_settings_say_what_they_do_and_refuse_what_they_cannot(self, bench: Bench) -> None:
        kind = bench.kind
        assert all(setting.meaning for setting in kind.SETTINGS.values())
        defaults = {key: setting.default for key, setting in kind.SETTINGS.items()}
        idle = idle_settings(kind, defaults)
        assert check_settings(kind, [(key, value) for key, value in defaults.items() if key not in idle]) == []
        (problem,) = check_settings(kind, [("no_such_setting", 1)])
        assert "no_such_setting" in problem.message
        half = Surface(0.5, restitution=0.5)
        assert kind.RULES.table or combined(kind.RULES, half, half)["friction"] > 0

    def test_the_same_world_gives_the_same_bytes(self, bench: Bench) -> None:
        world = bench.allowed(worlds.shapes_world()) or bench.first_allowed()
        first, second = (bench.compiled(world) for _ in range(2))
        assert dict(first.files) == dict(second.files)
        assert first.sha256 == second.sha256
        assert all("\r" not in text and text.endswith("\n") for text in first.files.values())
        assert all(not Path(path).is_absolute() and ".." not in Path(path).parts for path in first.files)


def gap_error(bench: Bench, feature: Feature, settings: tuple[tuple[str, object], ...]) -> str:
    """The message of compiling a world that needs the feature, under these settings and with nothing accepted; "" none."""
    world = worlds.with_options(NEEDING[feature](), bench.kind.NAME, settings=settings)
    try:
        bench.compiled(world)
    except UnsupportedError as error:
        return str(error)
    return ""


def settings_of(bench: Bench) -> list[tuple[tuple[str, object], ...]]:
    """No settings, and each choice of each setting by itself: some gaps are there under one of an engine's methods only."""
    found: list[tuple[tuple[str, object], ...]] = [()]
    for name, setting in bench.kind.SETTINGS.items():
        if setting.needs is None and not setting.only_with:
            found += [((name, choice),) for choice in setting.choices if choice != setting.default]
    return found
