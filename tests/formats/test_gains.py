"""Gains of controllers in plain files: the efforts of MJCF's actuators and of USD's drives are those of the world's law at the
start, at whatever state."""

from __future__ import annotations

import dataclasses
import math
import re

import mujoco
import numpy as np
import pytest
from pxr import Usd, UsdPhysics

from simspec.control.reference import drives
from simspec.formats.mjcf.format import MODEL, Mjcf
from simspec.formats.usd.format import Usd as UsdFormat
from simspec.language.load import load
from simspec.support.features import Feature
from simspec.world.types import World
from tests.files import write
from tests.formats.exported_worlds import exported_world

DRIVEN = ("chain", "arm", "quadruped", "claw")
REST = {  # joints at the start, that the reference is at time 0: position, velocity, feed-forward
    "chain": {"cart_joint": (0.0, 0.0, 0.0), "bob_joint": (0.3, 0.0, 0.0)},
}


def aims(world: World) -> dict[str, tuple[float, float, float]]:
    """The reference at time 0 as the spec says it, without the code that the writers use."""
    if world.name in REST:
        return REST[world.name]
    start = {body.joint.name: body.joint.position for body in world.bodies}
    return {name: (start[name][0], 0.0, 0.0) for controller in world.controllers for name in controller.joints}


def law(world: World, name: str, q: float, v: float, aim: tuple[float, float, float]) -> float:
    """The effort of the world's pd law (``world/actions.py``)."""
    for controller in world.controllers:
        if name in controller.joints:
            index = controller.joints.index(name)
            kp, kd, limit = controller.kp[index], controller.kd[index], controller.effort_limits[index]
            effort = kp * (aim[0] - q) + kd * (aim[1] - v) + aim[2]
            return effort if limit is None else max(-limit, min(limit, effort))
    raise KeyError(name)


def moving(world: World) -> World:
    """The chain with a reference that moves at the start, and feed-forward."""
    trajectory = dataclasses.replace(world.trajectory, interpolation="linear", efforts=((1.5, -0.4), (0.0, 0.0)))
    return dataclasses.replace(world, trajectory=trajectory)


def checked(world: World, aim: dict[str, tuple[float, float, float]]) -> int:
    """Load the file in MuJoCo, and compare the forces of its actuators after one step from seeded states; how many differ from
    zero."""
    model = mujoco.MjModel.from_xml_string(
        Mjcf().plain(world).files[MODEL], {name: text.encode() for name, text in Mjcf().plain(world).files.items()}
    )
    data = mujoco.MjData(model)
    draw = np.random.default_rng(3)
    count = 0
    for _ in range(5):
        mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
        for name in aim:
            joint = model.joint(name)
            data.qpos[joint.qposadr[0]] += draw.uniform(-0.3, 0.3)
            data.qvel[joint.dofadr[0]] = draw.uniform(-2.0, 2.0)
        states = {
            name: (data.qpos[model.joint(name).qposadr[0]], data.qvel[model.joint(name).dofadr[0]]) for name in aim
        }
        mujoco.mj_step(model, data)
        for name, (q, v) in states.items():
            force = data.qfrc_actuator[model.joint(name).dofadr[0]]
            assert force == pytest.approx(law(world, name, q, v, aim[name]), rel=1e-12, abs=1e-12), name
            count += force != 0.0
    assert model.nu == len(aim)
    return count


@pytest.mark.parametrize("name", DRIVEN)
def test_actuators_give_the_laws_efforts(name):
    world = exported_world(name)
    assert checked(world, aims(world)) == 5 * sum(len(controller.joints) for controller in world.controllers)


def test_a_reference_that_moves_and_feed_forward_are_in_the_control_at_the_start():
    world = moving(exported_world("chain"))
    assert checked(world, {"cart_joint": (0.0, 0.2, 1.5), "bob_joint": (0.3, 0.2, -0.4)}) == 10


def without_gains(world: World) -> World:
    """The arm under computed torque, and with a velocity servo at its last joint."""
    (first,) = world.controllers
    torque = dataclasses.replace(
        first, joints=first.joints[:2], law="computed-torque", kp=(), kd=(), natural_frequency=30.0, damping_ratio=1.0,
        gravity_compensation=False, effort_limits=first.effort_limits[:2],
    )  # fmt: skip
    servo = dataclasses.replace(
        first, name="servo", joints=first.joints[2:], kp=(0.0,), kd=(5.0,), effort_limits=first.effort_limits[2:]
    )
    return dataclasses.replace(world, controllers=(torque, servo))


def test_laws_without_gains_are_motors_and_without_stiffness_velocity_servos():
    plain = Mjcf().plain(without_gains(exported_world("arm")))
    kinds = re.findall(r'<(\w+) name="\w+" joint="(\w+)"', plain.files[MODEL])
    assert kinds == [("motor", "shoulder_joint"), ("motor", "upper_joint"), ("velocity", "fore_joint")]
    (loss,) = [loss for loss in plain.losses if loss.feature == Feature.CONTROL.value]
    assert "gravity compensation" in loss.how


@pytest.mark.parametrize("name", DRIVEN)
def test_drives_have_the_gains_in_units_of_the_schema(name, tmp_path):
    """Stiffness per degree, targets in degrees; passive springs and dampers add up with the gains."""
    world = exported_world(name)
    write(UsdFormat().plain(world).files, tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "world.usda"))
    prims = {str(prim.GetName()): prim for prim in stage.Traverse()}
    bodies = {body.joint.name: body.joint for body in world.bodies}
    for drive in drives(world):
        joint = bodies[drive.joint]
        kind, degrees = ("angular", 180.0 / math.pi) if joint.kind == "hinge" else ("linear", 1.0)
        api = UsdPhysics.DriveAPI(prims[drive.joint], kind)
        assert api.GetTypeAttr().Get() == "force"
        stiffness, damping = joint.spring_stiffness + drive.kp, joint.damping + drive.kd
        assert api.GetStiffnessAttr().Get() * degrees == pytest.approx(stiffness, rel=1e-6)
        assert api.GetDampingAttr().Get() * degrees == pytest.approx(damping, rel=1e-6)
        aim = aims(world)[drive.joint]
        assert api.GetTargetPositionAttr().Get() / degrees == pytest.approx(aim[0], rel=1e-6, abs=1e-9)
        assert api.GetTargetVelocityAttr().Get() == 0.0
        assert api.GetMaxForceAttr().Get() == pytest.approx(drive.effort_limit or math.inf)


def test_an_import_takes_gains_for_those_of_a_controller(tmp_path):
    """The joint has its own damper and no spring again; a drive that was changed since is a spring and a damper."""
    world = exported_world("chain")
    plain = UsdFormat().plain(world)
    write(plain.files, tmp_path)
    again = load(tmp_path / "world.usda").resolve()
    joints = {body.joint.name.rpartition("/")[2]: body.joint for body in again.bodies}
    assert (joints["cart_joint"].damping, joints["cart_joint"].spring_stiffness) == (1.5, 0.0)
    assert (joints["bob_joint"].damping, joints["bob_joint"].spring_stiffness) == (0.0, 0.0)
    (tmp_path / "world.usda").write_text(
        plain.files["world.usda"].replace("drive:linear:physics:stiffness = 100", "drive:linear:physics:stiffness = 70")
    )
    changed = load(tmp_path / "world.usda").resolve()
    (cart,) = [body.joint for body in changed.bodies if body.joint.name.endswith("cart_joint")]
    assert cart.spring_stiffness == pytest.approx(70.0)


def test_gains_are_left_out_where_the_largest_effort_is_zero():
    world = exported_world("claw")
    (first,) = world.controllers
    none = dataclasses.replace(world, controllers=(dataclasses.replace(first, effort_limits=(0.0,)),))
    assert "<actuator>" not in Mjcf().plain(none).files[MODEL]
    text = UsdFormat().plain(none).files["world.usda"]
    assert "simspec:gains" not in text
    assert "simspec:gains" in UsdFormat().plain(world).files["world.usda"]
