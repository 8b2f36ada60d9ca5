"""Worlds said to MuJoCo, and trees of frozen types compared."""

from __future__ import annotations

import dataclasses

from simspec.compiler import target_of
from simspec.contact import contact_plan, surfaces
from simspec.dialects.mujoco.dialect import MujocoDialect
from simspec.engines.mujoco.engine import MuJoCo
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Pose, Shape, World
from tests import worlds

ALL_SHAPES = ("sphere", "box", "cylinder", "capsule", "ellipsoid")
WORLDS = {
    "every joint": worlds.every_joint(),
    "damped springs": worlds.damped_springs(),
    "limits": worlds.limits_and_armature(armature=0.1, dry_friction=0.2),
    "shapes": worlds.shapes_world(ALL_SHAPES),
    "spheres": worlds.spheres(),
    "gripper": worlds.gripper(),
    "several joints": worlds.several_joints(),
}


def emit(world: World) -> dict[str, str]:
    target = target_of(world, MuJoCo)
    return MujocoDialect().emit(world, target)


def differences(want: object, got: object, path: str = "") -> list[str]:
    """Where two trees of frozen types differ by more than 1e-12 of the larger of 1 and the value: proof level L0's bound."""
    if dataclasses.is_dataclass(want):
        names = [field.name for field in dataclasses.fields(want)]
        return [d for name in names for d in differences(getattr(want, name), getattr(got, name), f"{path}.{name}")]
    if isinstance(want, tuple) and isinstance(got, tuple) and len(want) == len(got):
        return [d for i, pair in enumerate(zip(want, got, strict=True)) for d in differences(*pair, f"{path}[{i}]")]
    if isinstance(want, float) and isinstance(got, float):
        return [] if abs(want - got) <= 1e-12 * max(1.0, abs(want)) else [f"{path}: {want!r} {got!r}"]
    return [] if want == got else [f"{path}: {want!r} {got!r}"]


def as_stored(world: World) -> tuple[Body, ...]:
    """The world's bodies as a file holds them: surfaces as numbers in place of materials, no names of groups."""
    plan = contact_plan(world, MuJoCo.RULES, MuJoCo.LAYERS)

    def actual(shape: Shape) -> Shape:
        return dataclasses.replace(shape, material="", surfaces=surfaces(shape, plan) if shape.collision else ())

    return tuple(
        dataclasses.replace(body, collision_group="default", shapes=tuple(map(actual, body.shapes)))
        for body in world.bodies
    )


def box_world(groups: list[str], ignored: tuple[tuple[str, str], ...]) -> World:
    bodies = tuple(
        Body(
            f"b{i}",
            f"b{i}",
            Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)),
            Joint(f"j{i}", "free", position=(float(i), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
            (Shape(f"s{i}", "box", (0.1, 0.1, 0.1), Pose(), "slick"),),
            group,
        )
        for i, group in enumerate(groups)
    )
    material = Material("slick")
    pairs = (PairContact("slick", "slick", 0.0, 0.0),)
    return World("boxes", bodies, Contact("elliptic", (material,), pairs, ignored))


def frictional(restitution: float, limit: int) -> World:
    world = worlds.shapes_world()
    contact = dataclasses.replace(
        world.contact,
        materials=(Material("default", 0.4, restitution),),
        pairs=(PairContact("default", "default", 0.4, restitution),),
    )
    world = dataclasses.replace(world, contact=contact)
    return worlds.with_options(world, "mujoco", settings=(("explicit_pairs_limit", limit),))
