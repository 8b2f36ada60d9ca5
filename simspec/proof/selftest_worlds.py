"""The worlds into which the self-test plants its defects: small, and between them everything an engine can hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, TypedDict, Unpack

import numpy as np

from simspec.dialects.kit.defects import NAMES
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.proof.building import fixed, free, single_material, slab, with_bodies, with_joint, with_shapes
from simspec.world import frames
from simspec.world.actions import Fluid, JointSum
from simspec.world.hull import centred
from simspec.world.hull import mesh_size as hull_size
from simspec.world.inertia import boxed
from simspec.world.kinematics import joined, poses
from simspec.world.shapes import heightfield_size
from simspec.world.types import (
    Body,
    ConnectConstraint,
    Contact,
    EngineOptions,
    FollowConstraint,
    Frame,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Shape,
    WeldConstraint,
    World,
)

TENSOR = (0.021, 0.024, 0.013, 0.0021, -0.0017, 0.0013)
BASE = Inertial(2.0, inertia=TENSOR)
FRICTION = (
    *("contact.friction.carried", "contact.friction.impact", "contact.friction.self-locking", "contact.mass-ratio"),
    "contact.pressure",
)
"""Features of friction that some engines approximate: to be accepted by name."""
CONTACT = ("contact.cone.elliptic", *FRICTION)
ROUGH: Final = heightfield_size(
    *(3.0, 2.4, 0.4), np.array([[0.1, 0.0, 0.05, 0.2], [0.02, 0.12, 0.3, 0.06], [0.06, 0.25, 0.09, 0.0]])
)
"""Ground without symmetries."""
_WEDGE = (
    *((-0.06, -0.05, -0.04), (0.07, -0.05, -0.04), (-0.06, 0.06, -0.04), (0.07, 0.06, -0.04)),
    *((-0.05, 0.0, 0.08), (0.04, 0.01, 0.07)),
)
_GEM = (
    *((0.06, 0.0, 0.01), (-0.05, 0.01, 0.0), (0.0, 0.07, -0.01), (0.01, -0.06, 0.0)),
    *((0.0, 0.01, 0.09), (0.01, 0.0, -0.05)),
)
WEDGE, GEM = (hull_size(centred(np.array(points))[1]) for points in (_WEDGE, _GEM))
"""Hulls of points without symmetries (m)."""
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


def _hinge(name: str, parent: str | None, **more: Unpack[_JointNumbers]) -> Joint:
    tilt = Pose((0.05, 0.02, 0.3), (math.sqrt(0.75), 0.5, 0.0, 0.0))
    return Joint(f"{name}_joint", "hinge", parent, tilt, (0.6, 0.0, 0.8), position=(0.2,), velocity=(0.1,), **more)


def model(engine: str) -> World:
    """A floor, an arm of a hinge and a slide with limits, damping and springs, a ball and two cubes; filters by group
    and by name."""
    shape = {
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
    velocity, light = (0.1, 0.0, 0.2, 0.3, 0.0, 0.0), Inertial(0.8, (0.01, 0.0, 0.0), TENSOR)
    loose = (
        free(
            name, (x, 0.5, 0.4), light, shape[name], velocity=velocity, group="quiet" if name == "quiet" else "default"
        )
        for name, x in (("ball", 0.0), ("cube", 0.5), ("quiet", -0.5))
    )
    bodies = (
        slab("floor", (6.0, 6.0, 0.4), "rubber"),
        fixed("base", origin=Pose((0.0, 0.0, 0.8)), inertial=BASE),
        Body("upper", "base", solid, _hinge("upper", "base", **upper), (shape["upper"],), "arm"),
        Body("lower", "base", Inertial(0.7, (0.0, 0.03, 0.05), TENSOR), slide, (shape["lower"],), "arm"),
        *loose,
    )
    excluded = (("ball", "cube"), ("base", "upper"), ("lower", "upper"))
    contact = single_material("rubber", 0.5, ignored_groups=(("arm", "quiet"),), excluded_bodies=excluded)
    options = _options(engine, *CONTACT, "joint.limits.position", "shape.box")
    return World("self-test-model", bodies, contact, PHYSICS, engines=options)


def core(engine: str) -> World:
    """The part of :func:`model` for an engine that has hinges and free bodies only: its base, the arm as two hinges, and
    its free bodies, without shapes, limits, damping and springs."""

    def bare(body: Body) -> Body:
        joint = body.joint
        if joint.kind in SCALAR_JOINTS:
            joint = Joint(joint.name, "hinge", joint.parent, joint.origin, joint.axis, position=(0.2,), velocity=(0.1,))
        return replace(body, joint=joint, shapes=())

    bodies = tuple(bare(body) for body in model(engine).bodies if body.name != "floor")
    excluded = tuple(sorted(joined(bodies)))
    return World("self-test-core", bodies, Contact(excluded_bodies=excluded), PHYSICS, engines=_options(engine))


def bench(engine: str, **joint: Unpack[_JointNumbers]) -> World:
    """A fixed base and two hinges that touch nothing."""
    bodies = (
        fixed("base", inertial=BASE),
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
    name = "self-test-ball-armature"
    return with_bodies(ball_joint(engine), lambda bob: with_joint(bob, armature=0.03), name=name)


def ball_limit(engine: str) -> World:
    """A body on a ball joint with a largest angle."""
    options = _options(engine, "joint.limits.angle")
    named = {"name": "self-test-ball-limit", "engines": options}
    return with_bodies(ball_joint(engine), lambda bob: with_joint(bob, angle_limit=2.2), **named)


def lifted(engine: str) -> World:
    """A free body with damping and a part of its weight, and on it an arm without any."""
    place = (0.1, 0.2, 1.0, 0.8, 0.0, 0.6, 0.0)
    kite = replace(free("kite", place, Inertial(1.2, (0.02, 0.01, -0.1), TENSOR)), gravity_scale=0.25)
    kite = with_joint(kite, damping=0.3, angular_damping=0.3)
    tail = Body("tail", "kite", Inertial(0.4, (0.0, 0.03, 0.1), TENSOR), _hinge("tail", "kite"), gravity_scale=0.0)
    contact = Contact(excluded_bodies=(("kite", "tail"),))
    return World("self-test-lifted", (kite, tail), contact, PHYSICS, engines=_options(engine))


def framed(engine: str) -> World:
    """Named frames on two bodies, one of them given from its centre of mass."""
    named = (
        Frame("nose", "kite", Pose((0.0, 0.2, 0.1))),
        Frame("tip", "tail", Pose((0.1, 0.0, 0.3), (0.8, 0.0, 0.6, 0.0))),
    )
    return replace(lifted(engine), name="self-test-frames", frames=named)


def immersed(engine: str) -> World:
    """A free body and an arm on it in a current, of water that is as thick as oil."""
    kite, tail = boxed([replace(body, gravity_scale=1.0) for body in lifted(engine).bodies], ())
    bodies = (with_joint(kite, damping=0.0, angular_damping=0.0), tail)
    physics = replace(PHYSICS, fluid=Fluid(1000.0, 0.4, (0.3, -0.2, 0.1)))
    contact = Contact(excluded_bodies=(("kite", "tail"),))
    return World("self-test-immersed", bodies, contact, physics, engines=_options(engine))


def free_armature(engine: str) -> World:
    """A free body with armature."""
    world = lifted(engine)
    numbers = {"damping": 0.0, "angular_damping": 0.0, "armature": 0.04, "angular_armature": 0.04}
    kite = with_joint(replace(world.bodies[0], gravity_scale=1.0), **numbers)
    return replace(world, name="self-test-free-armature", bodies=(kite,), contact=Contact())


def bouncing(engine: str) -> World:
    """A sphere above a floor, with restitution."""
    solid = Inertial(1.0, inertia=(0.004, 0.004, 0.004, 0.0, 0.0, 0.0))
    ball = free("ball", (0.0, 0.0, 0.5), solid, Shape("ball_0", "sphere", (0.1,), Pose(), "rubber"))
    options, contact = _options(engine, *CONTACT, "material.restitution"), single_material("rubber", 0.5, 0.5)
    bodies = (slab("floor", (6.0, 6.0, 0.4), "rubber"), ball)
    return World("self-test-bouncing", bodies, contact, PHYSICS, engines=options)


def _cube(name: str, x: float, material: str) -> Body:
    shape = Shape(f"{name}_0", "box", (0.1, 0.1, 0.1), Pose(), material)
    return free(name, (x, 0.0, 0.5), Inertial(0.8, inertia=TENSOR), shape)


def surfaces(engine: str) -> World:
    """A floor of two materials and a cube of each of three, with pair values that no combination rule gives; the ghost
    passes through ice."""
    tiles = {"ice": -1.0, "rubber": 1.0}
    floor = tuple(
        Shape(f"floor_{name}", "box", (2.0, 2.0, 0.4), Pose((x, 0.0, -0.2)), name) for name, x in tiles.items()
    )
    bodies = (
        fixed("floor", *floor),
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
    options = _options(engine, *CONTACT, "shape.box")
    return World("self-test-surfaces", bodies, contact, PHYSICS, engines=options)


def rolling(engine: str) -> World:
    """A ball on a floor, with torsional and rolling friction."""
    law = PairContact("rubber", "rubber", 0.5, 0.0, torsional_friction=0.01, rolling_friction=0.002)
    contact = Contact(materials=(Material("rubber", 0.5, 0.0, 0.01, 0.002),), pairs=(law,))
    options = _options(engine, *FRICTION, "material.friction.rolling", "material.friction.torsional")
    return replace(bouncing(engine), name="self-test-rolling", contact=contact, engines=options)


def ground(engine: str) -> World:
    """A ball above rough ground."""
    floor, ball = bouncing(engine).bodies
    field = Shape("floor_0", "heightfield", ROUGH, Pose((0.2, 0.1, -0.3), (0.8, 0.0, 0.0, 0.6)), "rubber")
    return replace(bouncing(engine), name="self-test-ground", bodies=(replace(floor, shapes=(field,)), ball))


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
    solid = Inertial(0.8, (0.01, 0.0, 0.0), TENSOR)
    loose = (
        free(name, (x, 0.0, 0.5), solid, *shapes[name], group="parts") for name, x in (("stone", 0.0), ("toy", 0.6))
    )
    contact = single_material("rubber", 0.5, ignored_groups=(("parts", "parts"),))
    bodies = (slab("floor", (6.0, 6.0, 0.4), "rubber"), *loose)
    return World("self-test-meshes", bodies, contact, PHYSICS, engines=_options(engine, *CONTACT, "shape.mesh"))


def margins(engine: str) -> World:
    """A floor and a ball that are felt at a distance, and a pebble at another than the sum of both margins."""
    world = bouncing(engine)
    margins = {"floor_0": 0.002, "ball_0": 0.004}
    felt = [with_shapes(body, lambda shape: replace(shape, margin=margins[shape.name])) for body in world.bodies]
    pair = PairContact("rubber", "stone", 0.5, 0.0, margin=0.003)
    contact = replace(
        world.contact,
        materials=(*world.contact.materials, Material("stone", 0.5)),
        pairs=(*world.contact.pairs, pair, PairContact("stone", "stone", 0.5, 0.0)),
    )
    return replace(world, name="self-test-margins", bodies=(*felt, _cube("pebble", 1.5, "stone")), contact=contact)


def belts(engine: str) -> World:
    """A floor whose surface moves, and one that turns, both turned themselves, and a cube."""
    turn, moves = frames.from_axis_angle((0.0, 0.0, 1.0), 0.4), (0.3, -0.1, 0.0, 0.0, 0.0, 0.0)
    belt = Shape("floor_0", "box", (6.0, 6.0, 0.4), Pose((0.0, 0.0, -0.2), turn), "rubber", surface_velocity=moves)
    turning, at = (0.0,) * 5 + (0.7,), Pose((6.0, 0.0, -0.1))
    turntable = Shape("turntable", "cylinder", (0.5, 0.2), at, "rubber", surface_velocity=turning)
    bodies = (fixed("floor", belt, turntable), _cube("cube", 0.0, "rubber"))
    return World("self-test-belts", bodies, single_material("rubber", 0.5), PHYSICS, engines=_options(engine, *CONTACT))


def constrained(engine: str) -> World:
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
        replace(_hinge(name, parent), velocity=(0.0,)) for name, parent in (("crank", "base"), ("tip", "swing"))
    )
    chain = (
        fixed("base", inertial=BASE),
        Body("lead", "base", inertial, leader),
        Body("follow", "base", inertial, slide),
        Body("crank", "base", inertial, crank),
        Body("swing", "base", inertial, ball),
        Body("tip", "base", inertial, tip),
    )
    loose = (free("near", (1.5, 0.0, 0.4), inertial), free("far", (1.8, 0.2, 0.4, 0.8, 0.0, 0.6, 0.0), inertial))
    bodies = (*chain, *loose)
    place = poses(World("", bodies))
    at = (0.1, 0.0, 0.05)
    meets = frames.compose(frames.inverse(place["base"]), frames.compose(place["tip"], Pose(at))).position
    constraints = (
        WeldConstraint("glue", "near", "far", frames.compose(frames.inverse(place["near"]), place["far"])),
        FollowConstraint("mirror", "follow_joint", "lead_joint", ratio, offset),
        ConnectConstraint("pin", "tip", "base", at, meets),
    )
    excluded = joined(chain) | {("far", "near"), ("base", "tip")}
    options = _options(engine, outside=("constraint.coupling", "constraint.loop"))
    contact = Contact(excluded_bodies=tuple(sorted(excluded)))
    return World("self-test-held", bodies, contact, PHYSICS, engines=options, constraints=constraints)


def _summed(engine: str, name: str, accept: Sequence[str] = (), **numbers: Any) -> World:
    along = JointSum("tendon", (("lower_joint", -0.3), ("upper_joint", 0.5)), **numbers)
    world = bench(engine)
    return replace(world, name=name, sums=(along,), engines=_options(engine, *accept) if accept else world.engines)


def sums(engine: str) -> World:
    """The bench with a spring and a damper along a sum of both joints."""
    return _summed(engine, "self-test-sums", stiffness=90.0, rest=0.02, damping=4.0)


def sum_limits(engine: str) -> World:
    """The bench with stops of a sum of both joints."""
    return _summed(engine, "self-test-sum-limits", ["constraint.sum.limits"], position_limits=(-0.2, 0.4))


def sum_friction(engine: str) -> World:
    """The bench with dry friction along a sum of both joints."""
    return _summed(engine, "self-test-sum-friction", ["constraint.sum.dry_friction"], dry_friction=0.4)


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
    "ground": ground,
    "margins": margins,
    "belts": belts,
    "held": constrained,
    "sums": sums,
    "sum limits": sum_limits,
    "sum friction": sum_friction,
}
"""By name, each for one engine, with the acceptance of features that engines have only approximately or outside."""

# --- worlds that stand in for others where an engine refuses these: with fewer joints, or none -------------------------


def _freed(body: Body, row: int) -> Body:
    """A body on a hinge or slide as a free one; others as they are."""
    if body.joint.kind not in SCALAR_JOINTS:
        return body
    at = (0.1 * row, -0.5, 0.9, 0.8, 0.0, 0.6, 0.0)
    free = Joint(body.joint.name, "free", position=at, velocity=(0.1, 0.2, 0.0, 0.3, -0.2, 0.1))
    return replace(body, joint=free)


def without_joints(make: Callable[[str], World], name: str) -> Callable[[str], World]:
    """The part of a world for an engine without joints: its bodies, free, with all that is theirs."""

    def made(engine: str) -> World:
        whole = make(engine)
        bodies = tuple(_freed(body, row) for row, body in enumerate(whole.bodies))
        # without joints bodies have friction with each other
        return replace(whole, name=name, bodies=bodies, engines=_options(engine, *CONTACT, "shape.box"))

    return made


EVERY: Mapping[str, Callable[[str], World]] = {
    **WORLDS,
    "loose": without_joints(model, "self-test-loose"),
    "loose and lifted": without_joints(lifted, "self-test-loose-lifted"),
    "loose and immersed": without_joints(immersed, "self-test-loose-immersed"),
}
"""Those of the self-test by name, and what stands in for them alone."""
_OF_BODIES = (
    *("mass", "centre of mass", "inertia, diagonal", "inertia, sign of a product", "body dropped"),
    *("initial position", "initial velocity", "gravity", "timestep"),
)
_OF_JOINTS = ("joint type", "axis", "axis reversed", "joint origin, position", "joint origin, orientation")
_OF_SHAPES = (
    *("shape type", "shape size", "shape position", "shape orientation", "shape not solid"),
    *("excluded pair dropped", "excluded pair too many", "collision group", "group filter dropped"),
)


def _planted_into(world: str) -> frozenset[str]:
    return frozenset(defect for defect, name in NAMES.items() if name == world)


SMALLER: Mapping[str, tuple[str, frozenset[str]]] = {
    "model": ("core", frozenset((*_OF_BODIES, *_OF_JOINTS))),
    "core": ("loose", frozenset((*_OF_BODIES, *_OF_SHAPES))),
    "lifted": ("loose and lifted", _planted_into("lifted")),
    "immersed": ("loose and immersed", _planted_into("immersed")),
}
"""The world that takes another's place where an engine refuses that one, and the defects that it can hold."""
