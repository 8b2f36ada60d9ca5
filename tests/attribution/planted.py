"""A small scene in which everything happens that a difference may come from, and differences planted into it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import simspec
from simspec.attribution.configuration import Asking, Configuration
from simspec.attribution.explanation import COLD, Explanation, explain_sides
from simspec.attribution.windows import MOST_WINDOWS
from simspec.world.types import World

SCENE = """\
simspec: 1
name: planted
description: A ball that falls and bounces, a box that slides, a box that rests, an arm that is driven
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 0.2 s}
contact:
  friction_cone: elliptic
  materials:
    ground: {friction: 0.4}
    wood: {friction: 0.4}
    rubber: {friction: 0.4, restitution: 0.5}
  pairs:
    - {between: [ground, wood], friction: 0.4}
    - {between: [ground, rubber], friction: 0.4, restitution: 0.5}
bodies:
  floor:
    fixed: true
    shapes:
      - {plane: {}, material: ground}
  ball:
    pose: {xyz: [0, 1, 0.15]}
    mass: 1 kg
    velocity: {linear: [0.5, 0.3, 0]}
    shapes:
      - {sphere: {radius: 0.1}, material: rubber}
  slider:
    pose: {xyz: [0, 0, 0.06]}
    mass: 1 kg
    velocity: {linear: [0.8, 0.5, 0]}
    shapes:
      - {box: {size: [0.1, 0.1, 0.1]}, material: wood}
  rester:
    pose: {xyz: [0, -1, 0.06]}
    mass: 1 kg
    shapes:
      - {box: {size: [0.1, 0.1, 0.1]}, material: wood}
  post:
    fixed: true
    pose: {xyz: [0, 3, 1]}
  arm:
    mass: 1 kg
    parent: post
    joint: {type: hinge, axis: [0, 1, 0], damping: 0.1, position: 0.3}
    shapes:
      - {box: {size: [0.4, 0.05, 0.05]}, pose: {xyz: [0.2, 0, 0]}, material: wood}
control:
  drive:
    law: pd
    joints: [arm_joint]
    kp: 20 N m/rad
    kd: 1 N m s/rad
engines:
  mujoco: {accept: [contact.friction.carried, contact.friction.impact, contact.pressure, material.restitution]}
  pybullet: {accept: [contact.cone.elliptic, contact.pressure]}
  dart: {accept: [contact.pressure, material.restitution]}
"""
STANDING = """\
simspec: 1
name: standing
description: A cylinder that stands, on points that an engine may find one after another
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 0.1 s}
contact:
  materials:
    wood: {friction: 0.6}
bodies:
  floor:
    fixed: true
    shapes:
      - {plane: {}, material: wood}
  cylinder:
    pose: {xyz: [0, 0, 0.05]}
    mass: 0.125 kg
    shapes:
      - {cylinder: {radius: 0.02, length: 0.1}, material: wood}
engines:
  mujoco: {accept: [contact.friction.carried, contact.friction.impact]}
  pybullet: {accept: [contact.cone.elliptic]}
"""
FALL = """\
simspec: 1
name: fall
description: A body that tumbles and touches nothing
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 0.05 s}
bodies:
  box:
    pose: {xyz: [0, 0, 1]}
    mass: 1 kg
    velocity: {linear: [1, 0, 0], angular: [0, 2, 1]}
    shapes:
      - {box: {size: [0.1, 0.2, 0.3]}, collision: false}
"""


@cache
def world(text: str = SCENE, *sets: str) -> World:
    """The world of a spec's text."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "planted.yaml")
        path.write_text(text, encoding="utf-8")
        return simspec.load(path, sets=sets).resolve()


@dataclass(frozen=True)
class Planted:
    """Overrides of the second side, and what must be named: the first cause, and the classes in which it acts. ``shared``: of
    both sides, so that the planted one acts at all."""

    engines: tuple[str, str]
    sets: tuple[str, ...]
    culprit: str
    classes: tuple[str, ...]
    shared: tuple[str, ...] = ()

    def explain(self, windows: int = MOST_WINDOWS, asking: Asking = COLD) -> Explanation:
        """Its explanation by ``simspec explain``; ``asking``: with warm processes of several cases."""
        sides = (world(SCENE, *self.shared), world(SCENE, *self.shared, *self.sets))
        first, second = (Configuration(side, engine) for side, engine in zip(sides, self.engines, strict=True))
        return explain_sides(first, second, ("A", "B"), most=windows, asking=asking)


def alone(engine: str, sets: str, culprit: str, *classes: str) -> Planted:
    """One change, between an engine and itself."""
    return Planted((engine, engine), (sets,), culprit, classes)


DULL = (
    "contact.materials.rubber.restitution=0",
    "contact.pairs.1.restitution=0",
    "engines.drake.accept=[contact.pressure, shape.box]",
)
"""For an engine without restitution."""
CASES = {
    "gravity": alone("mujoco", "physics.gravity=[0,0,-9.7]", "gravity", "free", "impact", "contact"),
    "timestep": alone("dart", "physics.timestep=2 ms", "timestep", "free", "contact"),
    "friction": alone("pybullet", "contact.pairs.0.friction=0.5", "friction of ground and wood", "contact"),
    "restitution": alone("pybullet", "contact.pairs.1.restitution=0.6", "restitution of ground and rubber", "impact"),
    "mass": alone("mujoco", "bodies.arm.mass=1.1 kg", "mass and inertia of arm", "contact"),
    "gain": alone("mujoco", "control.drive.kp=30", "controller of drive", "contact"),
    "armature": alone("mujoco", "bodies.arm.joint.armature=0.02", "armature of arm", "contact"),
    "damping": alone("dart", "bodies.arm.joint.damping=0.3", "joint damping of arm", "contact"),
    "shape": alone("pybullet", "bodies.ball.shapes.0.sphere.radius=0.101", "shapes of ball", "impact"),
    "erp": alone("pybullet", "engines.pybullet.settings.contact_erp=0.2", "PyBullet's contact_erp", "contact"),
    "cone": alone("pybullet", "contact.friction_cone=pyramid-circumscribed", "friction cone", "contact"),
    "impratio": alone("mujoco", "engines.mujoco.settings.impratio=1", "MuJoCo's impratio", "contact"),
    "iterations": alone("pybullet", "engines.pybullet.settings.iterations=2", "PyBullet's iterations", "contact"),
    "reduction": alone(
        "mujoco", "engines.mujoco.settings.contact_error_reduction=0.2", "MuJoCo's contact_error_reduction", "contact"
    ),
    "dart-erp-of-another": Planted(
        ("dart", "pybullet"), ("engines.pybullet.settings.contact_erp=0.2",), "PyBullet's contact_erp", ("contact",)
    ),
    "dart-solver": Planted(
        ("dart", "dart"),
        (
            "engines.dart.settings.contact_solver=dantzig",
            "engines.dart.accept=[material.restitution, contact.cone.elliptic, contact.pressure]",
        ),
        "DART's contact_solver",
        ("contact",),
    ),
    "dart-iterations": alone("dart", "engines.dart.settings.iterations=3", "DART's iterations", "contact"),
    "dart-detector": Planted(
        ("dart", "dart"),
        (
            "engines.dart.settings.collision_detector=bullet",
            "engines.dart.accept=[contact.pressure, material.restitution, shape.box, shape.plane]",
        ),
        "DART's collision_detector",
        ("contact",),
    ),
    "drake-gravity": Planted(("drake", "drake"), ("physics.gravity=[0,0,-9.7]",), "gravity", ("free", "contact"), DULL),
    "drake-friction": Planted(
        ("drake", "drake"), ("contact.pairs.0.friction=0.5",), "friction of ground and wood", ("contact",), DULL
    ),
    "drake-dissipation": Planted(
        ("drake", "drake"), ("engines.drake.settings.dissipation=100",), "Drake's dissipation", ("contact",), DULL
    ),
    "drake-stiction-of-another": Planted(
        ("pybullet", "drake"),
        ("engines.drake.settings.stiction_tolerance=0.001",),
        "Drake's stiction_tolerance",
        ("contact",),
        DULL,
    ),
    "friction-in-drake": Planted(
        ("mujoco", "drake"), ("contact.pairs.0.friction=0.5",), "friction of ground and wood", ("contact",), DULL
    ),
    "erp-beside-drake": Planted(
        ("drake", "pybullet"),
        ("engines.pybullet.settings.contact_erp=0.2",),
        "PyBullet's contact_erp",
        ("contact",),
        DULL,
    ),
    "mass-in-drake": Planted(
        ("dart", "drake"), ("bodies.arm.mass=1.1 kg",), "mass and inertia of arm", ("free", "contact"), DULL
    ),
    "gravity-of-another": Planted(
        ("mujoco", "pybullet"), ("physics.gravity=[0,0,-9.7]",), "gravity", ("free", "contact")
    ),
    "gain-of-another": Planted(
        ("dart", "mujoco"), ("control.drive.kp=30",), "controller of drive", ("free", "contact")
    ),
    "armature-of-another": Planted(
        ("dart", "mujoco"), ("bodies.arm.joint.armature=0.02",), "armature of arm", ("free", "contact")
    ),
    "restitution-of-another": Planted(
        ("dart", "pybullet"), ("contact.pairs.1.restitution=0.7",), "restitution of ground and rubber", ("impact",)
    ),
    "timestep-of-another": Planted(("mujoco", "dart"), ("physics.timestep=2 ms",), "timestep", ("free", "contact")),
    "impratio-of-another": Planted(
        ("pybullet", "mujoco"), ("engines.mujoco.settings.impratio=1",), "MuJoCo's impratio", ("contact",)
    ),
    "pair-of-another": Planted(
        ("dart", "mujoco"),
        ("engines.mujoco.pairs=[{between: [ground, wood], settings: {friction_share: 0.05}}]",),
        "MuJoCo's friction_share between ground and wood",
        ("contact",),
    ),
    "two-of-another": Planted(
        ("mujoco", "pybullet"),
        ("bodies.arm.joint.damping=0.2", "engines.pybullet.settings.contact_erp=0.2"),
        "joint damping of arm",
        ("free",),
    ),
    "initial-state": alone("mujoco", "bodies.ball.pose.xyz=[0,1,0.2]", "initial state of ball", "whole run"),
    "nothing": alone("mujoco", "physics.gravity=[0,0,-9.81]", "", ""),
}
