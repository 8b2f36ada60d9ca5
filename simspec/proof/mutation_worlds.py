"""The worlds whose files the complete self-test changes: compact ones that use every feature between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import Setting, idle_settings
from simspec.proof import selftest_worlds
from simspec.proof.selftest_smaller import EVERY, SMALLER
from simspec.proof.selftest_worlds import FREE, FRICTION, STILL, TENSOR
from simspec.world.actions import Controller, Trajectory
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

AT = (0.0, 0.0, 0.6, *FREE)
GROUND = heightfield_size(0.8, 0.6, 0.2, np.array([[0.1, 0.0, 0.05], [0.02, 0.12, 0.03]]))
"""Two rows of three heights, without symmetries."""


def uneven(name: str) -> Callable[[str], World]:
    """A world of the fast self-test whose ball is no ball inside: a turn of its inertia then is one."""

    def made(engine: str) -> World:
        world = selftest_worlds.WORLDS[name](engine)
        bodies = tuple(
            dataclasses.replace(body, inertial=dataclasses.replace(body.inertial, inertia=TENSOR))
            if body.joint.kind == "free"
            else body
            for body in world.bodies
        )
        options = world.options(engine)
        # the cone of a body that is no ball is an approximation somewhere
        accept = tuple(sorted({*options.accept, "contact.cone.elliptic"}))
        return dataclasses.replace(world, bodies=bodies, engines=(dataclasses.replace(options, accept=accept),))

    return made


def native(engine: str) -> World:
    """The bench under the engine's own controllers: one by position, with a limit, one by velocity."""
    world = selftest_worlds.bench(engine)
    joints = ("upper_joint", "lower_joint")
    controller = Controller("own", joints, "native", kp=(30.0, 0.0), kd=(3.0, 2.0), effort_limits=(25.0, None))
    way = Trajectory(joints, (0.0, 1.0), ((0.2, 0.2), (0.5, -0.3)))
    # the friction of a solver that has controllers is an approximation somewhere
    accept = ("contact.cone.elliptic", *FRICTION, "control.native")
    options = EngineOptions(engine, accept=accept)
    return dataclasses.replace(
        world, name="self-test-native", controllers=(controller,), trajectory=way, engines=(options,)
    )


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
        Body("ground", "ground", Inertial(0.0), Joint("ground_joint", "fixed"), (ground,)),
        Body("post", "post", Inertial(0.0), Joint("post_joint", "fixed", origin=Pose((1.0, 0.0, 0.0))), (post,)),
        Body(
            "toy",
            "toy",
            Inertial(1.0, (0.0, 0.01, 0.0), TENSOR),
            Joint("toy_joint", "free", position=AT, velocity=STILL),
            solid,
        ),
        Body("knob", "toy", Inertial(0.2, (0.0, 0.0, 0.2), TENSOR), Joint("knob_joint", "fixed", "toy"), (knob,)),
    )
    law = PairContact("stone", "stone", 0.4, 0.0)
    contact = Contact(materials=(Material("stone", 0.4),), pairs=(law,), excluded_bodies=(("knob", "toy"),))
    accept = tuple(
        sorted(
            (
                "contact.cone.elliptic",
                *FRICTION,
                "shape.cylinder",
                "shape.plane",
            )
        )
    )
    options = EngineOptions(engine, accept=accept)
    return World("self-test-shapes", bodies, contact, selftest_worlds.PHYSICS, engines=(options,))


def weightless(engine: str) -> World:
    """A free root without mass, which carries a shape, a body with mass, a point mass and an arm; at the arm's end a body
    without mass."""
    ground = Shape("ground_0", "box", (6.0, 6.0, 0.4), Pose((0.0, 0.0, -0.2)), "rubber")
    skid = Shape("skid_0", "box", (0.1, 0.12, 0.14), Pose((0.0, 0.0, 0.05)), "rubber")
    tilt = Pose((0.05, 0.02, 0.3), (0.8, 0.6, 0.0, 0.0))
    swing = Joint("arm_joint", "hinge", "root", tilt, (0.6, 0.0, 0.8), position=(0.2,), velocity=(0.1,))
    bodies = (
        Body("ground", "ground", Inertial(0.0), Joint("ground_joint", "fixed"), (ground,)),
        Body("root", "root", Inertial(0.0), Joint("root_joint", "free", position=AT, velocity=STILL), (skid,)),
        Body("load", "root", Inertial(0.8, (0.01, 0.02, 0.0), TENSOR), Joint("load_joint", "fixed", "root", tilt)),
        Body("bob", "root", Inertial(0.3, (0.0, 0.0, 0.1)), Joint("bob_joint", "fixed", "load", tilt)),
        Body("arm", "root", Inertial(0.5, (0.0, 0.03, 0.05), TENSOR), swing),
        Body("tip", "root", Inertial(0.0), Joint("tip_joint", "fixed", "arm", tilt)),
    )
    law = PairContact("rubber", "rubber", 0.5, 0.0)
    apart = (("arm", "root"), ("arm", "tip"), ("bob", "load"), ("load", "root"))
    contact = Contact(materials=(Material("rubber", 0.5),), pairs=(law,), excluded_bodies=apart)
    options = EngineOptions(engine, accept=("contact.cone.elliptic", *FRICTION))
    return World("self-test-weightless", bodies, contact, selftest_worlds.PHYSICS, engines=(options,))


def several_joints(engine: str) -> World:
    """A wheel that steers, lifts and spins on a fixed base, and a body on a universal joint, with a shape each."""
    ground = Shape("ground_0", "box", (6.0, 6.0, 0.4), Pose((0.0, 0.0, -0.2)), "rubber")
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
        Body("ground", "ground", Inertial(0.0), Joint("ground_joint", "fixed"), (ground,)),
        Body("wheel.steer", "ground", Inertial(0.0), steer),
        Body("wheel.lift", "ground", Inertial(0.0), lift),
        Body("wheel", "ground", Inertial(0.8, (0.01, 0.02, 0.0), TENSOR), spin, (skid,)),
        Body("bob.yaw", "ground", Inertial(0.0), yaw),
        Body("bob", "ground", Inertial(0.5, (0.0, 0.03, 0.05), TENSOR), turn),
    )
    law = PairContact("rubber", "rubber", 0.5, 0.0)
    contact = Contact(materials=(Material("rubber", 0.5),), pairs=(law,), excluded_bodies=tuple(sorted(joined(bodies))))
    options = EngineOptions(engine, accept=("contact.cone.elliptic", *FRICTION))
    return World("self-test-several-joints", bodies, contact, selftest_worlds.PHYSICS, engines=(options,))


def ellipsoid(engine: str) -> World:
    """An ellipsoid on a floor."""
    world = hard("common", Hardness())(engine)
    bodies = tuple(
        dataclasses.replace(body, shapes=(Shape("egg_0", "ellipsoid", (0.05, 0.06, 0.07), Pose(), "rubber"),))
        if body.joint.kind == "free"
        else body
        for body in world.bodies
    )
    return dataclasses.replace(world, name="self-test-ellipsoid", bodies=bodies)


def bouncing(engine: str) -> World:
    """A ball that bounces where it arrives at more than a threshold."""
    world = uneven("bouncing")(engine)
    (law,) = world.contact.pairs
    contact = dataclasses.replace(world.contact, pairs=(dataclasses.replace(law, restitution_threshold=0.3),))
    options = world.options(engine)
    accept = tuple(sorted({*options.accept, "material.restitution.threshold"}))
    return dataclasses.replace(world, contact=contact, engines=(dataclasses.replace(options, accept=accept),))


def height_field(engine: str) -> World:
    """A ball above uneven ground."""
    world = hard("common", Hardness())(engine)
    ground = Shape("ground_0", "heightfield", GROUND, Pose((0.01, 0.0, 0.0)), "rubber")
    bodies = tuple(
        dataclasses.replace(body, shapes=(ground,)) if body.joint.kind == "fixed" else body for body in world.bodies
    )
    return dataclasses.replace(world, name="self-test-height-field", bodies=bodies)


def hard(kind: str, hardness: Hardness) -> Callable[[str], World]:
    """A ball on a floor of that hardness, without restitution."""

    def made(engine: str) -> World:
        world = uneven("bouncing")(engine)
        law = PairContact("rubber", "rubber", 0.5, 0.0, hardness=hardness)
        contact = dataclasses.replace(world.contact, materials=(Material("rubber", 0.5),), pairs=(law,))
        options = EngineOptions(
            engine,
            accept=(
                "contact.cone.elliptic",
                *FRICTION,
                f"contact.hardness.{kind}",
            ),
        )
        return dataclasses.replace(world, name=f"self-test-{kind}", contact=contact, engines=(options,))

    return made


def cone(name: str) -> Callable[[str], World]:
    """A ball on a floor under that friction cone."""

    def made(engine: str) -> World:
        world = hard("common", Hardness())(engine)
        contact = dataclasses.replace(world.contact, friction_cone=name)
        options = EngineOptions(engine, accept=(f"contact.cone.{name}", *FRICTION))
        return dataclasses.replace(world, name=f"self-test-{name}", contact=contact, engines=(options,))

    return made


def light_shapes(engine: str) -> World:
    """The same where what is welded to a moving body has no mass."""
    world = shapes(engine)
    bodies = tuple(
        dataclasses.replace(body, inertial=Inertial(0.0)) if body.name == "knob" else body for body in world.bodies
    )
    return dataclasses.replace(world, name="self-test-light-shapes", bodies=bodies)


def shapes_but_cylinders(engine: str) -> World:
    """The same with capsules in place of cylinders."""
    return _with_capsules(light_shapes(engine), "self-test-shapes-but-cylinders")


def heavy_shapes_but_cylinders(engine: str) -> World:
    """The same where what is welded to a moving body has a mass."""
    return _with_capsules(shapes(engine), "self-test-heavy-shapes-but-cylinders")


def _with_capsules(world: World, name: str) -> World:
    """Under this name, with capsules in place of cylinders."""
    bodies = tuple(
        dataclasses.replace(
            body,
            shapes=tuple(
                dataclasses.replace(shape, kind="capsule") if shape.kind == "cylinder" else shape
                for shape in body.shapes
            ),
        )
        for body in world.bodies
    )
    return dataclasses.replace(world, name=name, bodies=bodies)


def settings(engine: str) -> World:
    """The bench with every setting of the engine other than it is by default, but those that then do nothing."""
    return _with_settings(selftest_worlds.bench(engine), "self-test-settings")


def settings_on_floor(engine: str) -> World:
    """The same of a ball on a floor."""
    return _with_settings(hard("common", Hardness())(engine), "self-test-settings-on-floor")


def _with_settings(world: World, name: str) -> World:
    (options,) = world.engines
    engine = options.engine
    table = find_engine(engine).SETTINGS
    every = {name: _other(setting) for name, setting in sorted(table.items())}
    idle = idle_settings(find_engine(engine), every)
    used = tuple((name, value) for name, value in every.items() if name not in idle and _free(table[name]))
    return dataclasses.replace(world, name=name, engines=(dataclasses.replace(options, settings=used),))


def pairs(engine: str) -> World:
    """Two balls of two materials on a floor, with settings of their own for each pair of materials that meets."""
    world = hard("common", Hardness())(engine)
    (floor,) = (body for body in world.bodies if body.joint.kind == "fixed")
    (ball,) = (body for body in world.bodies if body.joint.kind == "free")
    bodies = [_of_material(floor, floor.name, "stone", 0.0)]
    bodies += [
        _of_material(ball, name, material, x)
        for name, material, x in (("pebble", "stone", 0.5), ("ball", "rubber", 0.0))
    ]
    friction = {"rubber": 0.5, "stone": 0.4}
    names = list(friction)
    laws = tuple(
        PairContact(a, b, max(friction[a], friction[b]), 0.0) for index, a in enumerate(names) for b in names[index:]
    )
    contact = dataclasses.replace(world.contact, materials=tuple(map(Material, names, friction.values())), pairs=laws)
    (options,) = world.engines
    return dataclasses.replace(
        world,
        name="self-test-pairs",
        bodies=tuple(bodies),
        contact=contact,
        engines=(dataclasses.replace(options, pairs=_own_settings(engine)),),
    )


def _own_settings(engine: str) -> tuple[PairSettings, ...]:
    """Of rubber with stone all settings that can be by pair, of stone with itself the first one. An engine without any gets
    another one, which it refuses with the reason, and one without any settings none."""
    table = find_engine(engine).SETTINGS
    if not table:
        return ()
    by_pair = {name: setting for name, setting in sorted(table.items()) if setting.by_pair}
    if not by_pair:
        unused = idle_settings(find_engine(engine), {name: setting.default for name, setting in table.items()})
        by_pair = dict([min(item for item in table.items() if item[0] not in unused)])
    own = {name: _near(setting, 0.96) for name, setting in by_pair.items()}
    idle = idle_settings(find_engine(engine), {name: setting.default for name, setting in table.items()} | own)
    used = tuple((name, value) for name, value in own.items() if name not in idle)
    first = next((name, _near(setting, 0.92)) for name, setting in by_pair.items() if name not in idle)
    return PairSettings("rubber", "stone", used), PairSettings("stone", "stone", (first,))


def _near(setting: Setting, share: float) -> bool | int | float | str:
    """A value that is allowed and not the default: of a number that share of it, with which contact is still right."""
    value = setting.default
    return value * share if isinstance(value, float) and value else _other(setting)


def _of_material(body: Body, name: str, material: str, away: float) -> Body:
    """A body with another name, of one material, moved along x."""
    shapes = tuple(
        dataclasses.replace(shape, name=f"{name}_{index}", material=material if shape.collision else shape.material)
        for index, shape in enumerate(body.shapes)
    )
    joint = dataclasses.replace(body.joint, name=f"{name}_joint")
    if joint.kind == "free":
        joint = dataclasses.replace(joint, position=(joint.position[0] + away, *joint.position[1:]))
    return dataclasses.replace(body, name=name, model=name, joint=joint, shapes=shapes)


def choices(engine: str) -> World:
    """A ball on a floor, with every setting of the engine that is a choice chosen otherwise."""
    world = hard("common", Hardness())(engine)
    (options,) = world.engines
    table = find_engine(engine).SETTINGS
    used = tuple(
        (name, _other(setting))
        for name, setting in sorted(table.items())
        if isinstance(setting.default, str) and _free(setting)
    )
    return dataclasses.replace(world, name="self-test-choices", engines=(dataclasses.replace(options, settings=used),))


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
    return half


WORLDS: Mapping[str, Callable[[str], World]] = {
    **EVERY,
    "bouncing": bouncing,
    "rolling": uneven("rolling"),
    "native control": native,
    "shapes": shapes,
    "light shapes": light_shapes,
    "shapes but cylinders": shapes_but_cylinders,
    "heavy shapes but cylinders": heavy_shapes_but_cylinders,
    "weightless": weightless,
    "several joints": several_joints,
    "ellipsoid": ellipsoid,
    "height field": height_field,
    "time constant": hard("time-constant", Hardness("time-constant", time_constant=0.02, damping_ratio=0.9)),
    "stiffness": hard("stiffness", Hardness("stiffness", stiffness=20000.0, damping=100.0)),
    "native hardness": hard("native", Hardness("native")),
    "inscribed pyramid": cone("pyramid-inscribed"),
    "circumscribed pyramid": cone("pyramid-circumscribed"),
    "settings": settings,
    "settings on a floor": settings_on_floor,
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
}
"""The world that takes another's place where an engine refuses that one; it comes after that."""
