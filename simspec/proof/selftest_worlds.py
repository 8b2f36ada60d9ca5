"""The worlds into which the self-test plants its defects: small, and between them everything an engine can hold."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TypedDict, Unpack

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.proof.selftest_ground import GEM, WEDGE, on_rough_ground
from simspec.world import frames
from simspec.world.actions import Fluid, JointSum
from simspec.world.inertia import boxed
from simspec.world.kinematics import poses
from simspec.world.types import (
    Body,
    Connect,
    Contact,
    EngineOptions,
    Follow,
    Frame,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Shape,
    Weld,
    World,
)

TENSOR = (0.021, 0.024, 0.013, 0.0021, -0.0017, 0.0013)
FREE = (1.0, 0.0, 0.0, 0.0)
STILL = (0.0,) * 6
FRICTION = (
    *("contact.friction.carried", "contact.friction.impact", "contact.friction.self-locking", "contact.mass-ratio"),
    "contact.pressure",
)
"""To be accepted by name where engines have friction, by the name of each thing that they do not have of it."""
PHYSICS = Physics((0.3, -0.2, -9.81), 0.001, 2000)


def _options(engine: str, *accept: str, outside: tuple[str, ...] = ()) -> tuple[EngineOptions, ...]:
    return (EngineOptions(engine, accept=tuple(sorted(accept)), outside=outside),)


class _JointNumbers(TypedDict, total=False):
    """Limits and numbers of a joint (see :class:`simspec.world.types.Joint`)."""

    position_limits: tuple[float, float]
    velocity_limit: float
    effort_limit: float
    damping: float
    dry_friction: float
    armature: float
    spring_stiffness: float
    spring_rest: float


def _contact(
    restitution: float = 0.0,
    ignored_groups: tuple[tuple[str, str], ...] = (),
    excluded_bodies: tuple[tuple[str, str], ...] = (),
) -> Contact:
    return Contact(
        materials=(Material("rubber", 0.5, restitution),),
        pairs=(PairContact("rubber", "rubber", 0.5, restitution),),
        ignored_groups=ignored_groups,
        excluded_bodies=excluded_bodies,
    )


def _hinge(name: str, parent: str | None, **more: Unpack[_JointNumbers]) -> Joint:
    tilt = Pose((0.05, 0.02, 0.3), (math.sqrt(0.75), 0.5, 0.0, 0.0))
    return Joint(f"{name}_joint", "hinge", parent, tilt, (0.6, 0.0, 0.8), position=(0.2,), velocity=(0.1,), **more)


def model(engine: str) -> World:
    """A floor, an arm of a hinge and a slide with limits, damping and springs, a ball and two cubes; filters by group
    and by name."""
    shape = {
        "floor": Shape("floor_0", "box", (6.0, 6.0, 0.4), Pose((0.0, 0.0, -0.2)), "rubber"),
        "upper": Shape("upper_0", "capsule", (0.03, 0.2), Pose((0.01, 0.0, 0.1)), "rubber"),
        "lower": Shape("lower_0", "box", (0.1, 0.12, 0.14), Pose((0.0, 0.02, 0.05), (0.8, 0.0, 0.6, 0.0)), "rubber"),
        "ball": Shape("ball_0", "sphere", (0.08,), Pose((0.01, 0.0, 0.0)), "rubber"),
        "cube": Shape("cube_0", "box", (0.1, 0.1, 0.1), Pose(), "rubber"),
        "quiet": Shape("quiet_0", "box", (0.1, 0.1, 0.1), Pose(), "rubber"),
    }
    upper: _JointNumbers = {
        "position_limits": (-1.5, 1.7),
        "velocity_limit": 3.0,
        "effort_limit": 40.0,
        "damping": 0.4,
        "spring_stiffness": 5.0,
        "spring_rest": 0.1,
    }
    lower: _JointNumbers = {**upper, "position_limits": (-0.4, 0.5)}
    slide = Joint(
        "lower_joint",
        "slide",
        "upper",
        Pose((0.0, 0.1, 0.25), (0.8, 0.0, 0.0, 0.6)),
        (0.0, 0.6, 0.8),
        position=(0.05,),
        velocity=(0.2,),
        **lower,
    )
    solid = Inertial(1.2, (0.02, 0.01, 0.08), TENSOR)

    def free(name: str, x: float) -> Body:
        at = (x, 0.5, 0.4, *FREE)
        joint = Joint(f"{name}_joint", "free", position=at, velocity=(0.1, 0.0, 0.2, 0.3, 0.0, 0.0))
        group = "quiet" if name == "quiet" else "default"
        return Body(name, name, Inertial(0.8, (0.01, 0.0, 0.0), TENSOR), joint, (shape[name],), group)

    bodies = (
        Body("floor", "floor", Inertial(0.0), Joint("floor_joint", "fixed"), (shape["floor"],)),
        Body("base", "base", Inertial(2.0, inertia=TENSOR), Joint("base_joint", "fixed", origin=Pose((0.0, 0.0, 0.8)))),
        Body("upper", "base", solid, _hinge("upper", "base", **upper), (shape["upper"],), "arm"),
        Body("lower", "base", Inertial(0.7, (0.0, 0.03, 0.05), TENSOR), slide, (shape["lower"],), "arm"),
        free("ball", 0.0),
        free("cube", 0.5),
        free("quiet", -0.5),
    )
    contact = _contact(
        ignored_groups=(("arm", "quiet"),),
        excluded_bodies=(("ball", "cube"), ("base", "upper"), ("lower", "upper")),
    )
    return World(
        "self-test-model",
        bodies,
        contact,
        PHYSICS,
        engines=_options(
            engine,
            "contact.cone.elliptic",
            *FRICTION,
            "joint.limits.position",
            "shape.box",
        ),
    )


def core(engine: str) -> World:
    """What is left of :func:`model` for an engine that has hinges and free bodies only: its base, the arm as two hinges, and
    its free bodies, without shapes, limits, damping and springs."""

    def bare(body: Body) -> Body:
        joint = body.joint
        if joint.kind in SCALAR_JOINTS:
            joint = Joint(joint.name, "hinge", joint.parent, joint.origin, joint.axis, position=(0.2,), velocity=(0.1,))
        return dataclasses.replace(body, joint=joint, shapes=())

    bodies = tuple(bare(body) for body in model(engine).bodies if body.name != "floor")
    excluded = tuple(
        sorted(
            (min(body.name, body.joint.parent), max(body.name, body.joint.parent))
            for body in bodies
            if body.joint.parent is not None
        )
    )
    return World("self-test-core", bodies, Contact(excluded_bodies=excluded), PHYSICS, engines=_options(engine))


def bench(engine: str, **joint: Unpack[_JointNumbers]) -> World:
    """A fixed base and two hinges that touch nothing."""
    bodies = (
        Body("base", "base", Inertial(2.0, inertia=TENSOR), Joint("base_joint", "fixed")),
        Body("upper", "base", Inertial(1.2, (0.02, 0.01, 0.08), TENSOR), _hinge("upper", "base", **joint)),
        Body("lower", "base", Inertial(0.7, (0.0, 0.03, 0.05), TENSOR), _hinge("lower", "upper", **joint)),
    )
    contact = Contact(excluded_bodies=(("base", "upper"), ("lower", "upper")))
    options = _options(engine, "joint.dry_friction", outside=("joint.armature",))
    return World("self-test-bench", bodies, contact, PHYSICS, engines=options)


def armature(engine: str) -> World:
    """The bench with armature."""
    return bench(engine, armature=0.03)


def dry_friction(engine: str) -> World:
    """The bench with dry friction."""
    return bench(engine, dry_friction=0.4)


def ball_joint(engine: str) -> World:
    """A body on a ball joint with damping and a spring."""
    tilt = Pose((0.0, 0.0, 1.0), (0.8, 0.0, 0.6, 0.0))
    turn = (0.6, 0.0, 0.8, 0.0)
    joint = Joint(
        "bob_joint", "ball", None, tilt, damping=0.2, spring_stiffness=3.0, position=turn, velocity=(0.3, 0.1, -0.2)
    )
    bodies = (Body("bob", "bob", Inertial(1.2, (0.02, 0.01, -0.2), TENSOR), joint),)
    return World("self-test-ball", bodies, Contact(), PHYSICS, engines=_options(engine))


def ball_armature(engine: str) -> World:
    """The same with armature."""
    world = ball_joint(engine)
    (bob,) = world.bodies
    bob = dataclasses.replace(bob, joint=dataclasses.replace(bob.joint, armature=0.03))
    return dataclasses.replace(world, name="self-test-ball-armature", bodies=(bob,))


def ball_limit(engine: str) -> World:
    """A body on a ball joint with a largest angle."""
    world = ball_joint(engine)
    (bob,) = world.bodies
    bob = dataclasses.replace(bob, joint=dataclasses.replace(bob.joint, angle_limit=2.2))
    options = _options(engine, "joint.limits.angle")
    return dataclasses.replace(world, name="self-test-ball-limit", bodies=(bob,), engines=options)


def lifted(engine: str) -> World:
    """A free body with damping and a part of its weight, and on it an arm without any."""
    place = (0.1, 0.2, 1.0, 0.8, 0.0, 0.6, 0.0)
    kite = Body(
        "kite",
        "kite",
        Inertial(1.2, (0.02, 0.01, -0.1), TENSOR),
        Joint("kite_joint", "free", position=place, velocity=STILL, damping=0.3, angular_damping=0.3),
        gravity_scale=0.25,
    )
    tail = Body("tail", "kite", Inertial(0.4, (0.0, 0.03, 0.1), TENSOR), _hinge("tail", "kite"), gravity_scale=0.0)
    contact = Contact(excluded_bodies=(("kite", "tail"),))
    return World("self-test-lifted", (kite, tail), contact, PHYSICS, engines=_options(engine))


def framed(engine: str) -> World:
    """Named frames on two bodies, of which one is told from its centre of mass."""
    named = (
        Frame("nose", "kite", Pose((0.0, 0.2, 0.1))),
        Frame("tip", "tail", Pose((0.1, 0.0, 0.3), (0.8, 0.0, 0.6, 0.0))),
    )
    return dataclasses.replace(lifted(engine), name="self-test-frames", frames=named)


def immersed(engine: str) -> World:
    """A free body and an arm on it in a current, of water that is as thick as oil."""
    bodies = boxed([dataclasses.replace(body, gravity_scale=1.0) for body in lifted(engine).bodies], ())
    kite = dataclasses.replace(bodies[0].joint, damping=0.0, angular_damping=0.0)
    fluid = Fluid(1000.0, 0.4, (0.3, -0.2, 0.1))
    return World(
        "self-test-immersed",
        (dataclasses.replace(bodies[0], joint=kite), *bodies[1:]),
        Contact(excluded_bodies=(("kite", "tail"),)),
        dataclasses.replace(PHYSICS, fluid=fluid),
        engines=_options(engine),
    )


def free_armature(engine: str) -> World:
    """A free body with armature."""
    world = lifted(engine)
    kite = dataclasses.replace(world.bodies[0], gravity_scale=1.0)
    joint = dataclasses.replace(kite.joint, damping=0.0, angular_damping=0.0, armature=0.04, angular_armature=0.04)
    kite = dataclasses.replace(kite, joint=joint)
    return dataclasses.replace(world, name="self-test-free-armature", bodies=(kite,), contact=Contact())


def bouncing(engine: str) -> World:
    """A sphere above a floor, with restitution."""
    at = (0.0, 0.0, 0.5, *FREE)
    bodies = (
        Body(
            "floor",
            "floor",
            Inertial(0.0),
            Joint("floor_joint", "fixed"),
            (Shape("floor_0", "box", (6.0, 6.0, 0.4), Pose((0.0, 0.0, -0.2)), "rubber"),),
        ),
        Body(
            "ball",
            "ball",
            Inertial(1.0, inertia=(0.004, 0.004, 0.004, 0.0, 0.0, 0.0)),
            Joint("ball_joint", "free", position=at, velocity=STILL),
            (Shape("ball_0", "sphere", (0.1,), Pose(), "rubber"),),
        ),
    )
    options = _options(engine, "contact.cone.elliptic", *FRICTION, "material.restitution")
    return World("self-test-bouncing", bodies, _contact(0.5), PHYSICS, engines=options)


def _cube(name: str, x: float, material: str) -> Body:
    joint = Joint(f"{name}_joint", "free", position=(x, 0.0, 0.5, *FREE), velocity=STILL)
    shape = Shape(f"{name}_0", "box", (0.1, 0.1, 0.1), Pose(), material)
    return Body(name, name, Inertial(0.8, inertia=TENSOR), joint, (shape,))


def surfaces(engine: str) -> World:
    """A floor of two materials and a cube of each of three, with pair values that no combination rule gives; the ghost
    passes through ice."""
    tiles = {"ice": -1.0, "rubber": 1.0}
    floor = tuple(
        Shape(f"floor_{name}", "box", (2.0, 2.0, 0.4), Pose((x, 0.0, -0.2)), name) for name, x in tiles.items()
    )
    bodies = (
        Body("floor", "floor", Inertial(0.0), Joint("floor_joint", "fixed"), floor),
        _cube("ghost_cube", -0.5, "ghost"),
        _cube("ice_cube", 0.0, "ice"),
        _cube("rubber_cube", 0.5, "rubber"),
    )
    contact = Contact(
        materials=(Material("ghost", 0.5), Material("ice", 0.1), Material("rubber", 0.2)),
        pairs=(
            PairContact("ghost", "ghost", 0.5, 0.0),
            PairContact("ghost", "ice", 0.0, 0.0, collide=False),
            PairContact("ghost", "rubber", 0.4, 0.0),
            PairContact("ice", "ice", 0.1, 0.0),
            PairContact("ice", "rubber", 0.3, 0.0),
            PairContact("rubber", "rubber", 0.2, 0.0),
        ),
    )
    return World(
        "self-test-surfaces",
        bodies,
        contact,
        PHYSICS,
        engines=_options(engine, "contact.cone.elliptic", *FRICTION, "shape.box"),
    )


def rolling(engine: str) -> World:
    """A ball on a floor, with torsional and rolling friction."""
    world = bouncing(engine)
    law = PairContact("rubber", "rubber", 0.5, 0.0, torsional_friction=0.01, rolling_friction=0.002)
    contact = Contact(materials=(Material("rubber", 0.5, 0.0, 0.01, 0.002),), pairs=(law,))
    options = _options(
        engine,
        *FRICTION,
        "material.friction.rolling",
        "material.friction.torsional",
    )
    return dataclasses.replace(world, name="self-test-rolling", contact=contact, engines=options)


def meshes(engine: str) -> World:
    """A floor, a stone and a toy of two hulls, one of which is the stone's; stones and toys do not touch each other."""
    turned = Pose((0.01, 0.02, 0.0), (0.8, 0.0, 0.6, 0.0))
    shapes = {
        "stone": (Shape("stone_0", "mesh", WEDGE, turned, "rubber"),),
        "toy": (
            Shape("toy_0", "mesh", WEDGE, Pose((0.1, 0.0, 0.0)), "rubber"),
            Shape("toy_1", "mesh", GEM, turned, "rubber"),
        ),
    }
    floor = bouncing(engine).bodies[0]

    def free(name: str, x: float) -> Body:
        joint = Joint(f"{name}_joint", "free", position=(x, 0.0, 0.5, *FREE), velocity=STILL)
        return Body(name, name, Inertial(0.8, (0.01, 0.0, 0.0), TENSOR), joint, shapes[name], "parts")

    contact = _contact(ignored_groups=(("parts", "parts"),))
    options = _options(engine, "contact.cone.elliptic", *FRICTION, "shape.mesh")
    bodies = (floor, free("stone", 0.0), free("toy", 0.6))
    return World("self-test-meshes", bodies, contact, PHYSICS, engines=options)


def margins(engine: str) -> World:
    """A floor and a ball that are felt at a distance, and a pebble at another than the sum of both margins."""
    world = bouncing(engine)
    bodies = tuple(
        dataclasses.replace(
            body, shapes=tuple(dataclasses.replace(shape, margin=0.002 * number) for shape in body.shapes)
        )
        for number, body in enumerate(world.bodies, 1)
    )
    own = PairContact("rubber", "stone", 0.5, 0.0, margin=0.003)
    contact = dataclasses.replace(
        world.contact,
        materials=(*world.contact.materials, Material("stone", 0.5)),
        pairs=(*world.contact.pairs, own, PairContact("stone", "stone", 0.5, 0.0)),
    )
    pebble = _cube("pebble", 1.5, "stone")
    return dataclasses.replace(world, name="self-test-margins", bodies=(*bodies, pebble), contact=contact)


def belts(engine: str) -> World:
    """A floor whose surface moves, and one that turns, both turned themselves, and a cube."""
    world = bouncing(engine)
    floor, turn = world.bodies[0], frames.from_axis_angle((0.0, 0.0, 1.0), 0.4)
    (slab,) = floor.shapes
    belt = dataclasses.replace(
        slab, pose=Pose(slab.pose.position, turn), surface_velocity=(0.3, -0.1, 0.0, 0.0, 0.0, 0.0)
    )
    round_about = Shape(
        "turntable", "cylinder", (0.5, 0.2), Pose((6.0, 0.0, -0.1)), "rubber", surface_velocity=(0.0,) * 5 + (0.7,)
    )
    floor = dataclasses.replace(floor, shapes=(belt, round_about))
    contact, options = (
        _contact(),
        _options(engine, "contact.cone.elliptic", *FRICTION),
    )
    bodies = (floor, _cube("cube", 0.0, "rubber"))
    return World("self-test-belts", bodies, contact, PHYSICS, engines=options)


def held(engine: str) -> World:
    """An arm whose slide follows its hinge; a chain of a hinge, a ball and a hinge, closed at a point; two free bodies that are
    held together. Nothing touches anything."""
    inertial = Inertial(0.7, (0.0, 0.03, 0.05), TENSOR)
    ratio, offset = -0.3, 0.02
    leader = _hinge("lead", "base", damping=0.1)
    slide = Joint(
        "follow_joint",
        "slide",
        "lead",
        Pose((0.0, 0.1, 0.25), (0.8, 0.0, 0.0, 0.6)),
        (0.0, 0.6, 0.8),
        position=(ratio * leader.position[0] + offset,),
        velocity=(ratio * leader.velocity[0],),
    )
    ball = Joint(
        "swing_joint", "ball", "crank", Pose((0.3, 0.0, 0.0)), position=(0.8, 0.6, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)
    )
    crank, tip = (
        dataclasses.replace(_hinge(name, parent), velocity=(0.0,))
        for name, parent in (("crank", "base"), ("tip", "swing"))
    )
    base = Body("base", "base", Inertial(2.0, inertia=TENSOR), Joint("base_joint", "fixed"))
    chain = (
        base,
        Body("lead", "base", inertial, leader),
        Body("follow", "base", inertial, slide),
        Body("crank", "base", inertial, crank),
        Body("swing", "base", inertial, ball),
        Body("tip", "base", inertial, tip),
    )
    loose = tuple(
        Body(name, name, inertial, Joint(f"{name}_joint", "free", position=place, velocity=STILL))
        for name, place in (("near", (1.5, 0.0, 0.4, *FREE)), ("far", (1.8, 0.2, 0.4, 0.8, 0.0, 0.6, 0.0)))
    )
    bodies = (*chain, *loose)
    place = poses(World("", bodies))
    at = (0.1, 0.0, 0.05)
    meets = frames.compose(frames.inverse(place["base"]), frames.compose(place["tip"], Pose(at))).position
    constraints = (
        Weld("glue", "near", "far", frames.compose(frames.inverse(place["near"]), place["far"])),
        Follow("mirror", "follow_joint", "lead_joint", ratio, offset),
        Connect("pin", "tip", "base", at, meets),
    )
    joined = [(body.name, body.joint.parent or "") for body in chain[1:]]
    excluded = {(min(pair), max(pair)) for pair in (*joined, ("far", "near"), ("base", "tip"))}
    options = _options(engine, outside=("constraint.coupling", "constraint.loop"))
    contact = Contact(excluded_bodies=tuple(sorted(excluded)))
    return World("self-test-held", bodies, contact, PHYSICS, engines=options, constraints=constraints)


def sums(engine: str) -> World:
    """The bench with a spring and a damper along a sum of both joints."""
    along = JointSum("tendon", (("lower_joint", -0.3), ("upper_joint", 0.5)), 90.0, 0.02, 4.0)
    return dataclasses.replace(bench(engine), name="self-test-sums", sums=(along,))


def sum_limits(engine: str) -> World:
    """The bench with stops of a sum of both joints."""
    along = JointSum("tendon", (("lower_joint", -0.3), ("upper_joint", 0.5)), position_limits=(-0.2, 0.4))
    options = _options(engine, "constraint.sum.limits")
    return dataclasses.replace(bench(engine), name="self-test-sum-limits", sums=(along,), engines=options)


def sum_friction(engine: str) -> World:
    """The bench with dry friction along a sum of both joints."""
    along = JointSum("tendon", (("lower_joint", -0.3), ("upper_joint", 0.5)), dry_friction=0.4)
    options = _options(engine, "constraint.sum.dry_friction")
    return dataclasses.replace(bench(engine), name="self-test-sum-friction", sums=(along,), engines=options)


WORLDS: Mapping[str, Callable[[str], World]] = {
    "model": model,
    "core": core,
    "armature": armature,
    "dry friction": dry_friction,
    "ball joint": ball_joint,
    "ball armature": ball_armature,
    "ball limit": ball_limit,
    "lifted": lifted,
    "immersed": immersed,
    "free armature": free_armature,
    "frames": framed,
    "bouncing": bouncing,
    "surfaces": surfaces,
    "rolling": rolling,
    "meshes": meshes,
    "ground": lambda engine: on_rough_ground(bouncing(engine)),
    "margins": margins,
    "belts": belts,
    "held": held,
    "sums": sums,
    "sum limits": sum_limits,
    "sum friction": sum_friction,
}
"""By name, each for one engine: what an engine has only approximately or outside is asked for there."""
