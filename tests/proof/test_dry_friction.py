"""Dry friction is measured, and hides nothing else: its own probe, and motion in worlds that have some."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.registry import engines
from simspec.proof import forces
from simspec.proof.forces import REST_CHECK, SLIDING_CHECK
from simspec.proof.verify import verify
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world.types import FollowConstraint, Physics, World
from tests import worlds
from tests.installed import INSTALLED

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = sorted(
    name
    for name, engine in engines().items()
    if name in INSTALLED and engine.SUPPORT[Feature.DRY_FRICTION].level is not Level.UNSUPPORTED
)
ACCEPT = ("joint.dry_friction", "joint.limits.position")


def arm_with_friction(seed: int = 5, timestep: float = 0.001) -> World:
    """A base with friction, a damped spring hinge, a slide with friction and limits, a ball, a loose arm with friction."""
    first = worlds.tree(["fixed", "hinge", "hinge", "slide", "ball"], seed)
    changes = {
        1: {"dry_friction": 0.4},
        2: {"damping": 0.3, "spring_stiffness": 4.0},
        3: {"dry_friction": 5.0, "position_limits": (-0.3, 0.4)},
    }
    bodies = [
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, **changes.get(index, {})))
        for index, body in enumerate(first)
    ]
    bodies += worlds.tree(["free", "hinge", "hinge"], seed + 1, prefix="loose_", dry_friction=0.02)
    found = worlds.world(tuple(bodies), physics=Physics((0.3, -0.2, -9.81), timestep, 2000))
    for name in ENGINES:
        found = worlds.with_options(found, name, accept=ACCEPT)
    return found


# --- the probe, against a solver of stick and slip that shares nothing with it ----------------------------------------


def stick_and_slip(world: World, plan: forces.DryFriction, friction: np.ndarray) -> np.ndarray:
    """The answer of a perfect engine: |f| ≤ F, f = −F sign(v') where a joint slides, v' = 0 where it does not, solved by
    projected Gauss-Seidel. ``friction`` (nv, 2): the limits against moving down and up."""
    oracle, found = Oracle(world), []
    places, step = plan.places, world.physics.timestep
    for trial in plan.trials:
        q, v = trial.q, trial.v
        for _ in range(trial.steps):
            gain = step * np.linalg.inv(oracle.mass_matrix(q))[np.ix_(places, places)]
            free = (v + step * oracle.acceleration(q, v, trial.effort))[places]
            force = np.zeros(len(places))
            for _ in range(40):
                for index, at in enumerate(places):
                    wanted = force[index] - (free[index] + gain[index] @ force) / gain[index, index]
                    force[index] = min(max(wanted, -friction[at, 1]), friction[at, 0])
            effort = trial.effort.copy()
            effort[places] += force
            q, v = oracle.step(q, v, effort)
        found.append(v)
    return np.array(found)


@pytest.fixture(scope="module")
def probe():
    world = arm_with_friction()
    plan = forces.plan_friction(world, Oracle(world))
    friction = np.zeros((Oracle(world).nv, 2))
    friction[plan.places] = np.array([[0.4], [5.0], [0.02], [0.02]])
    return world, plan, friction


def failures(world, plan, friction, creep=0.0) -> set[str]:
    checks = plan.checks(world, {"v": stick_and_slip(world, plan, friction)}, creep)
    assert {check.name for check in checks} == {SLIDING_CHECK, REST_CHECK}
    assert sum(check.count for check in checks) == len(plan.trials) * 4
    return {check.where for check in checks if not check.passed}


def test_a_perfect_engine_passes(probe):
    assert failures(*probe) == set()
    assert failures(*probe, creep=1e-7) == set()


@pytest.mark.parametrize("factor", [0.99, 1.01, 0.0, 1.001])
def test_a_wrong_friction_is_found(probe, factor):
    world, plan, friction = probe
    joints = ["joints.link1_joint", "joints.link3_joint", "joints.loose_link1_joint", "joints.loose_link2_joint"]
    for place, joint in zip(plan.places, joints, strict=True):
        for sides in ([0], [1], [0, 1]):
            wrong = friction.copy()
            wrong[place, sides] *= factor
            assert failures(world, plan, wrong, 1e-7)
            if len(sides) == 2 and factor in (0.99, 1.01):
                assert joint in failures(world, plan, wrong, 1e-7)


def test_non_finite_friction_fails(probe):
    world, plan, friction = probe
    found = stick_and_slip(world, plan, friction)
    found[3, plan.places[1]] = np.nan
    checks = plan.checks(world, {"v": found}, 0.0)
    assert [check.where for check in checks if not check.passed] == ["joints.link3_joint"]


def test_joints_stay_within_their_limits_and_slide_from_both_sides(probe):
    world, plan, _ = probe
    oracle = Oracle(world)
    at = plan.places[1]
    signs = set()
    for trial in plan.trials:
        states, speeds = oracle.motion(trial.q, trial.v, np.zeros(oracle.nv), 0, 1)
        assert states.shape[0] == speeds.shape[0] == 1
        assert -0.3 < trial.q[oracle.layout.position[3].start] < 0.4
        signs.add(np.sign(trial.expected[at]))
    assert signs == {-1.0, 0.0, 1.0}


def test_a_world_without_dry_friction_has_no_trials():
    world = worlds.every_joint()
    assert forces.plan_friction(world, Oracle(world)) is None


# --- in the engines ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("timestep", [0.001, 0.008])
def test_engines_rub_as_they_should(timestep):
    certificate = verify(arm_with_friction(timestep=timestep), ENGINES)
    for name, proof in certificate.engines.items():
        assert proof.valid, (name, certificate.failures())
        assert {check.name for check in proof.level("L6")} == {"motion", SLIDING_CHECK, REST_CHECK}


def xml(change: Callable[[ElementTree.Element], None]) -> Callable[[str], str]:
    def edit(text: str) -> str:
        root = ElementTree.fromstring(text)
        change(root)
        return ElementTree.tostring(root, encoding="unicode")

    return edit


def setting(path: str, **values: str) -> Callable[[str], str]:
    return xml(lambda root: root.find(path).attrib.update(values))


def adding(text: str, under: str = ".") -> Callable[[str], str]:
    return xml(lambda root: root.find(under).append(ElementTree.fromstring(text)))


def doubled(key: str) -> Callable[[str], str]:
    def edit(text: str) -> str:
        data = json.loads(text)
        assert data[key]
        data[key] = data[key] * 2
        return json.dumps(data)

    return edit


def number(path: str, text: str) -> Callable[[str], str]:
    def edit(root: ElementTree.Element) -> None:
        root.find(path).text = text

    return xml(edit)


ARM = ".//body[@name='link1']"
TENDON = (
    "<tendon><fixed {}><joint joint='link1_joint' coef='1'/><joint joint='link2_joint' coef='0.5'/></fixed></tendon>"
)
DEFECTS = {
    "mujoco": {
        "implicit": ("model.xml", setting("option", integrator="implicitfast")),
        "Runge-Kutta": ("model.xml", setting("option", integrator="RK4")),
        "implicit damping": ("model.xml", setting("option/flag", eulerdamp="enable")),
        "fluid": ("model.xml", setting("option", density="1.2", viscosity="2e-5")),
        "gravity compensation": ("model.xml", setting(f"{ARM}", gravcomp="0.01")),
        "coupled joints": (
            "model.xml",
            adding("<equality><joint joint1='link1_joint' joint2='link2_joint' polycoef='0 0.5 0 0 0'/></equality>"),
        ),
        "pinned body": (
            "model.xml",
            adding("<equality><connect body1='link4' body2='link0' anchor='0 0 0'/></equality>"),
        ),
        "spring tendon": ("model.xml", adding(TENDON.format("name='t' stiffness='1' springlength='0.1'"))),
        "damped tendon": ("model.xml", adding(TENDON.format("name='t' damping='0.01'"))),
        "tendon with friction": ("model.xml", adding(TENDON.format("name='t' frictionloss='0.01'"))),
        "tendon with armature": ("model.xml", adding(TENDON.format("name='t' armature='0.001'"))),
        "joint that should not rub": ("model.xml", setting(".//joint[@name='link2_joint']", frictionloss="0.001")),
        "friction": ("model.xml", setting(".//joint[@name='link1_joint']", frictionloss="0.404")),
        "no friction": ("model.xml", setting(".//joint[@name='link3_joint']", frictionloss="0")),
        "soft friction": ("model.xml", setting(".//joint[@name='link1_joint']", solimpfriction="0.9 0.9 0.001 0.5 2")),
        "friction switched off": ("model.xml", setting("option/flag", frictionloss="disable")),
    },
    "pybullet": {
        "spring twice": ("sidecar.json", doubled("springs")),
        "joint that should not rub": (
            "link0.urdf",
            setting(".//joint[@name='link2_joint']/dynamics", friction="0.001"),
        ),
        "friction": ("link0.urdf", setting(".//joint[@name='link1_joint']/dynamics", friction="0.404")),
        "no friction": ("link0.urdf", setting(".//joint[@name='link3_joint']/dynamics", friction="0")),
        "damping": ("link0.urdf", setting(".//joint[@name='link2_joint']/dynamics", damping="0.31")),
    },
    "dart": {
        "joint that should not rub": (
            "world.skel",
            number(".//joint[@name='link2_joint']/axis/dynamics/friction", "0.001"),
        ),
        "friction": ("world.skel", number(".//joint[@name='link1_joint']/axis/dynamics/friction", "0.404")),
        "no friction": ("world.skel", number(".//joint[@name='link3_joint']/axis/dynamics/friction", "0")),
        "no gravity": ("world.skel", number(".//body[@name='link4']/gravity", "false")),
    },
}


@pytest.mark.parametrize(("engine", "defect"), [(engine, name) for engine, some in DEFECTS.items() for name in some])
def test_defects_visible_only_in_motion_are_found_with_dry_friction(engine, defect, tmp_path):
    """Each of these went unseen while worlds with dry friction had no L6."""
    world = arm_with_friction()
    file, change = DEFECTS[engine][defect]
    files = dict(compile_world(world, [engine])[engine].files)
    before = files[file]
    files[file] = change(before)
    assert files[file] != before
    write_folder(files, tmp_path / engine)
    proof = verify(world, [engine], artifacts={engine: tmp_path / engine}).engines[engine]
    found = {check.name for check in proof.level("L6") if not check.passed}
    if any(check.name == "engine" for check in proof.checks):
        return  # refused by the engine's side when it was loaded
    assert found, [check for check in proof.checks if not check.passed]
    has_friction = defect in ("friction", "no friction", "soft friction", "friction switched off")
    assert found <= {SLIDING_CHECK, REST_CHECK} if has_friction else "motion" in found


def test_coupled_joints_are_tried_within_the_limits_of_both():
    """A thread: a cap that turns rises, and is let in by the limits of what follows it alone."""
    turn, rise = worlds.tree(["hinge", "slide"], 12)
    limits = dataclasses.replace(rise.joint, position_limits=(0.0, 0.032), position=(0.001,), velocity=(0.0,))
    turning = dataclasses.replace(turn.joint, position_limits=None, dry_friction=0.02, position=(0.4,), velocity=(0.0,))
    bodies = (dataclasses.replace(turn, joint=turning), dataclasses.replace(rise, joint=limits))
    thread = FollowConstraint("thread", limits.name, turning.name, 0.0025, 0.0)
    world = dataclasses.replace(worlds.world(bodies, "thread"), constraints=(thread,))
    made = forces.plan_friction(world, Oracle(world))
    for trial in made.trials:
        assert trial.q[1] == pytest.approx(0.0025 * trial.q[0], abs=1e-12)
        assert 0.004 < trial.q[1] < 0.028
