"""All suites in one class, for one line of a test module."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import pytest

from simspec.engines.kit.settings import check_settings, resolve_settings, written_settings
from simspec.proof.selftest import SelfTest, self_test
from simspec.testing import worlds
from simspec.testing.bench import Bench, Suite, driven
from simspec.testing.contact_suite import ContactSuite
from simspec.testing.control_suite import ControlSuite, ForcesSuite
from simspec.testing.model_suite import ModelSuite
from simspec.world.actions import Force, JointTrajectory
from simspec.world.types import Body, Contact, Inertial, Joint, PairContact, Physics, Pose, Shape, World

# The quick self-test as a suite: every planted defect that the engine can hold must be noticed above level L0.


class SelfTestSuite(Suite):
    """See the module."""

    defects: ClassVar[tuple[str, ...] | None] = None
    """Those to plant; None: all."""

    @pytest.fixture(scope="class")
    @classmethod
    def planted(cls) -> SelfTest:
        """The outcome of each defect."""
        pythons = {} if cls.python is None else {cls.engine: cls.python}
        return self_test([cls.engine], defects=cls.defects, pythons=pythons)

    def test_every_planted_defect_is_caught(self, planted: SelfTest) -> None:
        assert [outcome.defect for outcome in planted.outcomes if outcome.caught is False] == []
        assert planted.planted > 0

    def test_unplanted_defects_have_a_reason(self, planted: SelfTest) -> None:
        assert all(outcome.reason for outcome in planted.outcomes if outcome.caught is None)


# Sleeping, in every engine that has the setting: off by default; a sleeping body stays where it is and wakes when something
# happens to it; a driven one is unaffected. An engine without the setting refuses it.

SETTING = "sleeping"
ON = ((SETTING, True),)
RADIUS, LENGTH, MASS = 0.02, 0.1, 0.125
SETTLED = 3000
"""Steps of 1 ms after which every engine has put to sleep what rests: the slowest takes 2 s (measured)."""


def shape(name: str, kind: str, size: tuple[float, ...], pose: Pose | None = None) -> Shape:
    return Shape(name, kind, size, pose or Pose(), worlds.MATERIAL.name)


def cylinder(name: str, x: float, z: float = LENGTH / 2, y: float = 0.0) -> Body:
    across, along = MASS * (3 * RADIUS**2 + LENGTH**2) / 12, MASS * RADIUS**2 / 2
    joint = Joint(f"{name}_joint", "free", None, position=(x, y, z, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
    inertial = Inertial(MASS, (0.0, 0.0, 0.0), (across, across, along, 0.0, 0.0, 0.0))
    return Body(name, name, inertial, joint, (shape(f"{name}_shape", "cylinder", (RADIUS, LENGTH)),))


def floor() -> Body:
    return Body("floor", "floor", Inertial(0.0), Joint("floor_joint", "fixed"), (shape("floor_0", "plane", ()),))


def scene(*bodies: Body, **more: Any) -> World:
    """Bodies on a floor, at 1 ms."""
    law = PairContact(worlds.MATERIAL.name, worlds.MATERIAL.name, worlds.MATERIAL.friction, 0.0)
    contact = Contact(materials=(worlds.MATERIAL,), pairs=(law,), excluded_bodies=worlds.parent_pairs(bodies))
    return worlds.world((floor(), *bodies), contact=contact, **more)


def hinge(name: str, parent: str | None, origin: Pose, shapes: tuple[Shape, ...] = (), length: float = 0.2) -> Body:
    """A rod along x on a hinge about z, so that gravity needs no effort."""
    inertial = Inertial(0.5, (length / 2, 0.0, 0.0), (1e-4, 2e-3, 2e-3, 0.0, 0.0, 0.0))
    joint = Joint(f"{name}_joint", "hinge", parent, origin, (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    return Body(name, "arm", inertial, joint, shapes)


def arm() -> tuple[Body, Body]:
    """Two rods in a plane 5 cm above the floor, with a ball at the end of the second."""
    reach = Pose((0.2, 0.0, 0.0))
    ball = (shape("forearm_0", "sphere", (0.02,), reach),)
    return hinge("upper", None, Pose((0.0, 0.0, 0.05))), hinge("forearm", "upper", reach, ball)


def drifting(speed: float) -> World:
    """A body that nothing touches or pulls, which moves along x."""
    body = cylinder("one", 0.0, 1.0)
    body = dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=(speed, 0.0, 0.0, 0.0, 0.0, 0.0)))
    return scene(body, physics=Physics((0.0, 0.0, 0.0), 0.001, 1))


def sweep() -> World:
    """A driven arm that stands still for 3 s, which is enough to fall asleep, then sweeps slowly into a standing cylinder."""
    world = driven(scene(*arm(), cylinder("target", 0.33, y=0.22), cylinder("other", -0.4)))
    joints = world.controllers[0].joints
    rows = ((0.0, 0.0), (0.0, 0.0), (0.9, 0.0))
    path = JointTrajectory(joints, (0.0, 3.0, 5.0), rows, interpolation="linear")
    return dataclasses.replace(world, trajectory=path)


def with_sleeping(bench: Bench, base: World, sleeping: bool = True) -> World | None:
    """``base`` with sleeping on or off; None where the engine refuses the world, or the setting, which is seen."""
    if SETTING not in bench.kind.SETTINGS:
        (problem,) = check_settings(bench.kind, ON)
        assert SETTING in problem.message
        return None
    return bench.allowed(worlds.with_options(base, bench.kind.NAME, settings=ON if sleeping else ()))


def rows(bench: Bench, world: World, steps: int, every: int | None = None) -> Mapping[str, np.ndarray]:
    """q, v and pose of a run."""
    return bench.run(world, steps, every).arrays


class SleepingSuite(Suite):
    """See the module."""

    # --- off by default -------------------------------------------------------------------------------------------

    def test_it_is_off_and_leaves_no_trace_in_files(self, bench: Bench) -> None:
        world = scene(cylinder("one", 0.0))
        on = with_sleeping(bench, world)
        if on is None:
            return
        assert resolve_settings(bench.kind, world)[SETTING] is False
        assert SETTING not in written_settings(bench.kind, world)
        plain = with_sleeping(bench, world, sleeping=False)
        assert plain is not None
        off = worlds.with_options(plain, bench.kind.NAME, settings=((SETTING, False),))
        of_plain, of_off, of_on = (bench.compiled(world).files for world in (plain, off, on))
        assert not any("sleep" in text for text in of_plain.values())
        assert {path: text for path, text in of_off.items() if path != "sidecar.json"} == {
            path: text for path, text in of_plain.items() if path != "sidecar.json"
        }
        assert '"sleeping": true' in of_on["sidecar.json"]

    def test_a_word_for_it_is_refused(self, bench: Bench) -> None:
        assert check_settings(bench.kind, [(SETTING, "yes")])

    def test_resting_bodies_are_simulated_by_default(self, bench: Bench) -> None:
        """A body slower than any threshold for sleeping goes on."""
        world = with_sleeping(bench, drifting(1e-5), sleeping=False)
        if world is None:
            return
        x = rows(bench, world, SETTLED)["pose"][:, 1, 0]
        assert x[-1] - x[0] == pytest.approx(1e-5 * SETTLED * 1e-3, rel=1e-6)

    def test_a_force_wakes_what_sleeps(self, bench: Bench) -> None:
        """Above its friction, for 40 ms; its neighbour stays where it is."""
        push = Force("one", (0.0, 30.0 * MASS, 0.0), start=SETTLED * 1e-3, until=SETTLED * 1e-3 + 0.04)
        base = dataclasses.replace(scene(cylinder("one", 0.0), cylinder("other", 0.4)), forces=(push,))
        world = with_sleeping(bench, base)
        if world is None:
            return
        pose = rows(bench, world, SETTLED + 40, SETTLED)["pose"]
        assert pose[-1, 1, 1] - pose[1, 1, 1] > 0.005
        after, before = pose[-1, 2, :3], pose[1, 2, :3]
        assert np.abs(after - before).max() < 1e-5

    # --- what sleeps ----------------------------------------------------------------------------------------------

    def test_sleeping_bodies_stay_in_place_to_the_last_bit(self, bench: Bench) -> None:
        base = scene(cylinder("one", 0.0), cylinder("dropped", 0.3, LENGTH / 2 + 0.002))
        awake, world = with_sleeping(bench, base, sleeping=False), with_sleeping(bench, base)
        if awake is None or world is None:
            return
        expected = rows(bench, awake, SETTLED + 1000)["pose"][-1, 1:, :3]
        asleep = rows(bench, world, SETTLED + 1000, 1000)
        assert not asleep["v"][-2].any()
        for name in ("q", "v"):
            assert asleep[name][-2].tobytes() == asleep[name][-1].tobytes()
        np.testing.assert_allclose(asleep["pose"][-1, 1:, :3], expected, atol=2e-6)

    @pytest.mark.parametrize("timestep", [0.0005, 0.004, 0.008])
    def test_resting_bodies_sleep_at_any_timestep(self, bench: Bench, timestep: float) -> None:
        base = scene(cylinder("one", 0.0), cylinder("other", 0.3))
        base = dataclasses.replace(base, physics=dataclasses.replace(base.physics, timestep=timestep))
        world = with_sleeping(bench, base)
        if world is None:
            return
        assert not rows(bench, world, round(1e-3 * SETTLED / timestep))["v"][-1].any()

    def test_a_stack_stands_as_it_does_awake(self, bench: Bench) -> None:
        base = scene(cylinder("low", 0.0), cylinder("high", 0.0, 1.5 * LENGTH))
        ends = []
        for sleeping in (True, False):
            world = with_sleeping(bench, base, sleeping)
            if world is None:
                return
            ends.append(rows(bench, world, SETTLED)["pose"][-1])
        np.testing.assert_allclose(ends[0][:, :3], ends[1][:, :3], atol=5e-6)

    def test_sleeping_bodies_wake_when_hit(self, bench: Bench) -> None:
        """A ball that comes late knocks over a cylinder that sleeps as it knocks over one that does not."""
        gravity, late, speed = 0.1, 4.3, 1.0
        start = (-speed * late, 0.0, 0.07 + gravity * late**2 / 2, 1.0, 0.0, 0.0, 0.0)
        thrown = Joint("ball_joint", "free", position=start, velocity=(speed, 0.0, 0.0, 0.0, 0.0, 0.0))
        inertia = 0.4 * MASS * RADIUS**2
        solid = Inertial(MASS, inertia=(inertia, inertia, inertia, 0.0, 0.0, 0.0))
        ball = Body("ball", "ball", solid, thrown, (shape("ball_0", "sphere", (RADIUS,)),))
        physics = Physics((0.0, 0.0, -gravity), 0.001, 1)
        base = scene(cylinder("target", 0.0), ball, cylinder("far", 0.5, y=0.5), physics=physics)
        ends = []
        for sleeping in (True, False):
            world = with_sleeping(bench, base, sleeping)
            if world is None:
                return
            arrays = rows(bench, world, 4800, 800)
            assert arrays["v"][5, :6].any() == (not sleeping)  # after 4000 steps
            ends.append(arrays["pose"][-1, 1:, :3])
        assert np.linalg.norm(ends[1][0] - (0.0, 0.0, LENGTH / 2)) > 0.05
        # the edge it hits makes mm of the µm by which rest differs
        np.testing.assert_allclose(ends[0], ends[1], atol=5e-3)

    def test_an_effort_wakes_within_the_step(self, bench: Bench) -> None:
        ends = []
        for sleeping in (True, False):
            world = with_sleeping(bench, scene(cylinder("one", 0.0)), sleeping)
            if world is None:
                return
            lift = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
            ends.append(bench.drive(world, (SETTLED, None), (200, lift))["pose"][-1, 1, :3])
            assert ends[-1][2] > LENGTH / 2 + 0.05
        np.testing.assert_allclose(ends[0], ends[1], atol=5e-6)

    # --- what does not --------------------------------------------------------------------------------------------

    def test_driven_bodies_are_unaffected_by_sleeping(self, bench: Bench) -> None:
        """The arm's motion is the same, in which it stands still for long, begins slowly, and pushes what slept."""
        ends = []
        for sleeping in (True, False):
            world = with_sleeping(bench, sweep(), sleeping)
            if world is None:
                return
            arrays = rows(bench, world, 5200, 1000)
            assert arrays["v"][3, 2:].any() == (not sleeping)
            ends.append((arrays["q"][4, :2], arrays["q"][-1, :2], arrays["pose"][-1, 1:, :3]))
        np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-9)
        np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-3)
        assert np.linalg.norm(ends[1][2][2, :2] - (0.33, 0.22)) > 0.02
        np.testing.assert_allclose(ends[0][2], ends[1][2], atol=2e-3)

    def test_jointed_bodies_move_on_however_slowly(self, bench: Bench) -> None:
        wheel = hinge("upper", None, Pose((0.0, 0.0, 0.5)))
        wheel = dataclasses.replace(wheel, joint=dataclasses.replace(wheel.joint, velocity=(1e-7,)))
        world = with_sleeping(bench, scene(wheel, cylinder("one", 0.5)))
        if world is None:
            return
        arrays = rows(bench, world, SETTLED)
        assert arrays["q"][-1, 0] == pytest.approx(1e-7 * SETTLED * 1e-3, rel=1e-6)
        assert not arrays["v"][-1, 1:].any()


class EngineSuite(ModelSuite, ContactSuite, ControlSuite, ForcesSuite, SleepingSuite, SelfTestSuite):
    """All requirements of simspec on an engine; about 100 tests."""
