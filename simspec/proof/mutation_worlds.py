"""The worlds whose files the complete self-test changes: compact ones that use every feature between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import Setting, idle_settings
from simspec.proof.building import fixed, free, single_material, slab, with_bodies, with_shapes
from simspec.proof.selftest_worlds import CONTACT, EVERY, FRICTION, PHYSICS, SMALLER, TENSOR, bench
from simspec.world.actions import JointController, JointTrajectory
from simspec.world.damping import IMPLICIT, with_implicit_damping
from simspec.world.kinematics import joined
from simspec.world.shapes import heightfield_size
from simspec.world.types import (
    Body,
    Contact,
    EngineOptions,
    Hardness,
    Inertial,
    Joint,
    Material,
    PairContact,
    PairSettings,
    Pose,
    Shape,
    World,
)

AT = (0.0, 0.0, 0.6)
GROUND = heightfield_size(0.8, 0.6, 0.2, np.array([[0.1, 0.0, 0.05], [0.02, 0.12, 0.03]]))
"""Two rows of three heights, without symmetries."""


def _accept(world: World, *features: str, **fields: Any) -> World:
    """A world whose engine has these features accepted alone, and other fields."""
    (options,) = world.engines
    return replace(world, engines=(replace(options, accept=features),), **fields)


def uneven(name: str) -> Callable[[str], World]:
    """A world of the fast self-test in which the inertia of free bodies is no ball's: a turn of it then changes it."""

    def made(engine: str) -> World:
        world = with_bodies(EVERY[name](engine), _unevenly)
        # the cone of such a body is an approximation in some engines
        return _accept(world, *sorted({*world.options(engine).accept, "contact.cone.elliptic"}))

    return made


def _unevenly(body: Body) -> Body:
    return replace(body, inertial=replace(body.inertial, inertia=TENSOR)) if body.joint.kind == "free" else body


def armature(engine: str) -> World:
    """The bench with armature and implicit damping, which adds to it."""
    world = bench(engine, armature=0.03, damping=0.4)
    (options,) = world.engines
    options = replace(options, outside=("joint.armature", "joint.damping.implicit"))
    physics = replace(world.physics, damping=IMPLICIT)
    return with_implicit_damping(replace(world, name="self-test-damped-armature", physics=physics, engines=(options,)))


def ball_armature(engine: str) -> World:
    """A body on a ball joint with armature, at the end of an arm that moves."""
    world = EVERY["ball armature"](engine)
    (bob,) = world.bodies
    swing = Joint("arm_joint", "hinge", None, Pose(AT), (0.6, 0.0, 0.8), position=(0.2,), velocity=(0.1,))
    arm = Body("arm", "arm", Inertial(0.7, (0.0, 0.03, 0.05), TENSOR), swing)
    bob = replace(bob, model="arm", joint=replace(bob.joint, parent="arm"))
    contact = Contact(excluded_bodies=(("arm", "bob"),))
    options = EngineOptions(engine, outside=("joint.ball.armature",))
    name = "self-test-carried-ball-armature"
    return replace(world, name=name, bodies=(arm, bob), contact=contact, engines=(options,))


def native(engine: str) -> World:
    """The bench under the engine's own controllers: one by position, with a limit, one by velocity."""
    world = bench(engine)
    joints = ("upper_joint", "lower_joint")
    controller = JointController("own", joints, "native", kp=(30.0, 0.0), kd=(3.0, 2.0), effort_limits=(25.0, None))
    way = JointTrajectory(joints, (0.0, 1.0), ((0.2, 0.2), (0.5, -0.3)))
    # the friction of a solver that has controllers is an approximation in some engines
    controlled = replace(world, name="self-test-native", controllers=(controller,), trajectory=way)
    return replace(controlled, engines=(EngineOptions(engine, accept=(*CONTACT, "control.native")),))


def shapes(engine: str) -> World:
    """Every kind of shape: solid and seen, solid and unseen, seen alone; a body welded to a moving one."""
    turned = Pose((0.01, 0.02, 0.0), (0.8, 0.0, 0.6, 0.0))
    ground = Shape("ground_0", "plane", (), Pose(), "stone")
    post = Shape("post_0", "cylinder", (0.05, 0.3), Pose((0.0, 0.0, 0.15)), "stone", visual=False)
    solid = (
        Shape("toy_0", "cylinder", (0.05, 0.12), turned, "stone"),
        Shape("toy_1", "capsule", (0.03, 0.1), Pose((0.1, 0.0, 0.0)), "stone", visual=False),
        Shape("toy_2", "sphere", (0.05,), turned, "", collision=False),
        Shape("toy_3", "box", (0.1, 0.12, 0.14), turned, "", collision=False, colour=(0.1, 0.2, 0.3, 1.0)),
    )
    knob = Shape("knob_0", "sphere", (0.04,), Pose((0.0, 0.0, 0.2)), "stone")
    bodies = (
        fixed("ground", ground),
        fixed("post", post, origin=Pose((1.0, 0.0, 0.0))),
        free("toy", AT, Inertial(1.0, (0.0, 0.01, 0.0), TENSOR), *solid),
        Body("knob", "toy", Inertial(0.2, (0.0, 0.0, 0.2), TENSOR), Joint("knob_joint", "fixed", "toy"), (knob,)),
    )
    contact = single_material("stone", 0.4, excluded_bodies=(("knob", "toy"),))
    options = EngineOptions(engine, accept=(*CONTACT, "shape.cylinder", "shape.plane"))
    return World("self-test-shapes", bodies, contact, PHYSICS, engines=(options,))


def weightless(engine: str) -> World:
    """A free root without mass, which carries a shape, a body with mass, a point mass and an arm; at the arm's end a body
    without mass."""
    skid = Shape("skid_0", "box", (0.1, 0.12, 0.14), Pose((0.0, 0.0, 0.05)), "rubber")
    tilt = Pose((0.05, 0.02, 0.3), (0.8, 0.6, 0.0, 0.0))
    swing = Joint("arm_joint", "hinge", "root", tilt, (0.6, 0.0, 0.8), position=(0.2,), velocity=(0.1,))
    bodies = (
        slab("ground", (6.0, 6.0, 0.4), "rubber"),
        free("root", AT, Inertial(0.0), skid),
        Body("load", "root", Inertial(0.8, (0.01, 0.02, 0.0), TENSOR), Joint("load_joint", "fixed", "root", tilt)),
        Body("bob", "root", Inertial(0.3, (0.0, 0.0, 0.1)), Joint("bob_joint", "fixed", "load", tilt)),
        Body("arm", "root", Inertial(0.5, (0.0, 0.03, 0.05), TENSOR), swing),
        Body("tip", "root", Inertial(0.0), Joint("tip_joint", "fixed", "arm", tilt)),
    )
    excluded = (("arm", "root"), ("arm", "tip"), ("bob", "load"), ("load", "root"))
    contact = single_material("rubber", 0.5, excluded_bodies=excluded)
    options = EngineOptions(engine, accept=(*CONTACT, "shape.box"))
    return World("self-test-weightless", bodies, contact, PHYSICS, engines=(options,))


def several_joints(engine: str) -> World:
    """A wheel that steers, lifts and spins on a fixed base, and a body on a universal joint, with a shape each."""
    skid = Shape("wheel_0", "box", (0.1, 0.12, 0.14), Pose((0.0, 0.0, 0.05)), "rubber")
    tilt = Pose((0.05, 0.02, 0.3), (0.8, 0.6, 0.0, 0.0))
    steer = Joint("steer", "hinge", "ground", tilt, (0.6, 0.0, 0.8), damping=0.1, position=(0.2,), velocity=(0.1,))
    lift = Joint(
        "lift", "slide", "wheel.steer", tilt, (0.0, 0.0, 1.0), spring_stiffness=30.0, position=(0.1,), velocity=(0.2,)
    )
    spin = Joint(
        "spin", "hinge", "wheel.lift", Pose((0.1, 0.0, 0.0)), (0.0, 1.0, 0.0), position=(0.4,), velocity=(1.0,)
    )
    yaw = Joint("yaw", "hinge", "wheel", tilt, (0.0, 0.0, 1.0), position=(0.3,), velocity=(-0.2,))
    turn = Joint("turn", "hinge", "bob.yaw", Pose(), (1.0, 0.0, 0.0), position=(-0.3,), velocity=(0.4,))
    bodies = (
        slab("ground", (6.0, 6.0, 0.4), "rubber"),
        Body("wheel.steer", "ground", Inertial(0.0), steer),
        Body("wheel.lift", "ground", Inertial(0.0), lift),
        Body("wheel", "ground", Inertial(0.8, (0.01, 0.02, 0.0), TENSOR), spin, (skid,)),
        Body("bob.yaw", "ground", Inertial(0.0), yaw),
        Body("bob", "ground", Inertial(0.5, (0.0, 0.03, 0.05), TENSOR), turn),
    )
    contact = single_material("rubber", 0.5, excluded_bodies=tuple(sorted(joined(bodies))))
    options = EngineOptions(engine, accept=CONTACT)
    return World("self-test-several-joints", bodies, contact, PHYSICS, engines=(options,))


def _with_shape(kind: str, shape: Shape, name: str) -> Callable[[str], World]:
    """A ball on a floor, of which the body with this kind of joint has another shape."""

    def made(engine: str) -> World:
        return with_bodies(
            common(engine), lambda body: replace(body, shapes=(shape,)) if body.joint.kind == kind else body, name=name
        )

    return made


def bouncing(engine: str) -> World:
    """A ball that bounces where it arrives at more than a threshold."""
    world = uneven("bouncing")(engine)
    (law,) = world.contact.pairs
    contact = replace(world.contact, pairs=(replace(law, restitution_threshold=0.3),))
    accept = sorted({*world.options(engine).accept, "material.restitution.threshold"})
    return _accept(world, *accept, contact=contact)


def hard(kind: str, hardness: Hardness) -> Callable[[str], World]:
    """A ball on a floor of that hardness, without restitution."""

    def made(engine: str) -> World:
        contact = single_material("rubber", 0.5, hardness=hardness)
        accept = (*CONTACT, f"contact.hardness.{kind}")
        return _accept(uneven("bouncing")(engine), *accept, name=f"self-test-{kind}", contact=contact)

    return made


common = hard("common", Hardness())


def cone(name: str) -> Callable[[str], World]:
    """A ball on a floor under that friction cone."""

    def made(engine: str) -> World:
        world = common(engine)
        contact = replace(world.contact, friction_cone=name)
        return _accept(world, f"contact.cone.{name}", *FRICTION, name=f"self-test-{name}", contact=contact)

    return made


def light_shapes(engine: str) -> World:
    """:func:`shapes` where the body that is welded to a moving one has no mass."""
    name = "self-test-light-shapes"
    return with_bodies(
        shapes(engine), lambda body: replace(body, inertial=Inertial(0.0)) if body.name == "knob" else body, name=name
    )


def _with_capsules(world: World, name: str) -> World:
    """A world under this name, with capsules in place of cylinders."""

    def change(shape: Shape) -> Shape:
        return replace(shape, kind="capsule") if shape.kind == "cylinder" else shape

    return with_bodies(world, lambda body: with_shapes(body, change), name=name)


def _with_settings(world: World, name: str) -> World:
    """A world with every setting of the engine other than it is by default, but those that then have no effect."""
    (options,) = world.engines
    engine = find_engine(options.engine)
    every = {name: _other(setting) for name, setting in sorted(engine.SETTINGS.items())}
    idle = idle_settings(engine, every)
    used = tuple((name, value) for name, value in every.items() if name not in idle and _free(engine.SETTINGS[name]))
    return replace(world, name=name, engines=(replace(options, settings=used),))


def pairs(engine: str) -> World:
    """Two balls of two materials on a floor, with settings of their own for each pair of materials that meets."""
    world = common(engine)
    floor, ball = world.bodies
    bodies = (
        _of_material(floor, "floor", "stone", 0.0),
        _of_material(ball, "pebble", "stone", 0.5),
        _of_material(ball, "ball", "rubber", 0.0),
    )
    contact = replace(
        world.contact,
        materials=(Material("rubber", 0.5), Material("stone", 0.4)),
        pairs=(
            PairContact("rubber", "rubber", 0.5, 0.0),
            PairContact("rubber", "stone", 0.5, 0.0),
            PairContact("stone", "stone", 0.4, 0.0),
        ),
    )
    (options,) = world.engines
    options = replace(options, pairs=_pair_settings(engine))
    return replace(world, name="self-test-pairs", bodies=bodies, contact=contact, engines=(options,))


def _pair_settings(engine: str) -> tuple[PairSettings, ...]:
    """Of rubber with stone all settings that can be by pair, of stone with itself the first one. An engine without any gets
    another one, which it refuses with the reason, and one without any settings none."""
    table = find_engine(engine).SETTINGS
    if not table:
        return ()
    by_pair = {name: setting for name, setting in sorted(table.items()) if setting.by_pair}
    if not by_pair:
        unused = idle_settings(find_engine(engine), {name: setting.default for name, setting in table.items()})
        by_pair = dict([min(item for item in table.items() if item[0] not in unused)])
    near = {name: _near(setting, 0.96) for name, setting in by_pair.items()}
    idle = idle_settings(find_engine(engine), {name: setting.default for name, setting in table.items()} | near)
    used = tuple((name, value) for name, value in near.items() if name not in idle)
    first = next((name, _near(setting, 0.92)) for name, setting in by_pair.items() if name not in idle)
    return PairSettings("rubber", "stone", used), PairSettings("stone", "stone", (first,))


def _near(setting: Setting, share: float) -> bool | int | float | str:
    """A value that is allowed and not the default: of a number that share of it, with which contact is still right."""
    value = setting.default
    return value * share if isinstance(value, float) and value else _other(setting)


def _of_material(body: Body, name: str, material: str, away: float) -> Body:
    """A body with another name, of one material, moved along x."""
    shapes = tuple(
        replace(shape, name=f"{name}_{index}", material=material if shape.collision else shape.material)
        for index, shape in enumerate(body.shapes)
    )
    joint = replace(body.joint, name=f"{name}_joint")
    if joint.kind == "free":
        joint = replace(joint, position=(joint.position[0] + away, *joint.position[1:]))
    return replace(body, name=name, model=name, joint=joint, shapes=shapes)


def choices(engine: str) -> World:
    """A ball on a floor, with every setting of the engine that is a choice chosen otherwise."""
    world = common(engine)
    (options,) = world.engines
    used = tuple(
        (name, _other(setting))
        for name, setting in sorted(find_engine(engine).SETTINGS.items())
        if isinstance(setting.default, str) and _free(setting)
    )
    return replace(world, name="self-test-choices", engines=(replace(options, settings=used),))


def _free(setting: Setting) -> bool:
    """Whether it may be other than its default: some are there to say that an engine has one way only."""
    return len(setting.choices) != 1 and (setting.minimum is None or setting.minimum != setting.maximum)


def _other(setting: Setting) -> bool | int | float | str:
    """A value that is allowed and, where there is another, is not the default."""
    value = setting.default
    if not _free(setting):
        return value
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return next(word for word in setting.choices if word != value)
    half = value // 2 if isinstance(value, int) else value / 2.0
    if half == value or (setting.minimum is not None and half < setting.minimum):
        half = value + 1 if isinstance(value, int) else value * 2.0 or 0.01
        if setting.maximum is not None and half > setting.maximum:
            half = type(half)(setting.maximum)
    return half


WORLDS: Mapping[str, Callable[[str], World]] = {
    **EVERY,
    "armature": armature,
    "ball armature": ball_armature,
    "ball armature at rest": EVERY["ball armature"],
    "bouncing": bouncing,
    "rolling": uneven("rolling"),
    "native control": native,
    "shapes": shapes,
    "light shapes": light_shapes,
    "shapes but cylinders": lambda engine: _with_capsules(light_shapes(engine), "self-test-shapes-but-cylinders"),
    "heavy shapes but cylinders": lambda engine: _with_capsules(shapes(engine), "self-test-heavy-shapes-but-cylinders"),
    "weightless": weightless,
    "several joints": several_joints,
    "ellipsoid": _with_shape(
        "free", Shape("egg_0", "ellipsoid", (0.05, 0.06, 0.07), Pose(), "rubber"), "self-test-ellipsoid"
    ),
    "height field": _with_shape(
        "fixed", Shape("ground_0", "heightfield", GROUND, Pose((0.01, 0.0, 0.0)), "rubber"), "self-test-height-field"
    ),
    "time constant": hard("time-constant", Hardness("time-constant", time_constant=0.02, damping_ratio=0.9)),
    "stiffness": hard("stiffness", Hardness("stiffness", stiffness=20000.0, damping=100.0)),
    "native hardness": hard("native", Hardness("native")),
    "inscribed pyramid": cone("pyramid-inscribed"),
    "circumscribed pyramid": cone("pyramid-circumscribed"),
    "settings": lambda engine: _with_settings(bench(engine), "self-test-settings"),
    "settings on a floor": lambda engine: _with_settings(common(engine), "self-test-settings-on-floor"),
    "choices": choices,
    "pairs": pairs,
}
"""By name, each for one engine."""
STAND_INS: Mapping[str, str] = {
    **{name: smaller for name, (smaller, _) in SMALLER.items()},
    "shapes": "light shapes",
    "light shapes": "shapes but cylinders",
    "shapes but cylinders": "heavy shapes but cylinders",
    "settings": "settings on a floor",
    "ball armature": "ball armature at rest",
}
"""The world that takes another's place where an engine refuses that one; it comes after that."""
