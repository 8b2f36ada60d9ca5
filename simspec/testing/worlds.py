"""Worlds built in Python, for tests of engines: each is small and uses a known set of features.

They say nothing to engines: :func:`accepting` adds the features that must be accepted or requested for an engine.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from simspec.compiler import missing_options
from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.proof.building import fixed, free, single_material, slab, with_bodies, with_joint, with_shapes
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.actions import Fluid
from simspec.world.damping import with_implicit_damping
from simspec.world.frames import quaternion, sorted_pair, vector3
from simspec.world.inertia import boxed
from simspec.world.kinematics import carrier_name
from simspec.world.shapes import heightfield_size
from simspec.world.types import (
    Body,
    Contact,
    Hardness,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Shape,
    Vector3,
    World,
)

SIZES = {
    "sphere": (0.05,),
    "box": (0.1, 0.2, 0.3),
    "cylinder": (0.05, 0.2),
    "capsule": (0.04, 0.15),
    "ellipsoid": (0.05, 0.08, 0.11),
    "plane": (),
    "mesh": (
        *(0.05, 0.0, 0.0, -0.05, 0.0, 0.0, 0.0, 0.08, 0.0, 0.0, -0.08, 0.0, 0.0, 0.0, 0.11, 0.0, 0.0, -0.11),
        *(0.04, 0.05, 0.05, 0.04, -0.05, 0.05, -0.04, 0.05, 0.05, -0.04, -0.05, 0.05),
        *(0.04, 0.05, -0.05, 0.04, -0.05, -0.05, -0.04, 0.05, -0.05, -0.04, -0.05, -0.05),
    ),
}


def pose(generator: random.Random, reach: float = 0.3) -> Pose:
    """A random pose."""
    position = vector3(generator.uniform(-reach, reach) for _ in range(3))
    turn = frames.normalise(quaternion(generator.gauss(0, 1) for _ in range(4)))
    return Pose(position, turn)


def inertial(generator: random.Random, reach: float = 0.1) -> Inertial:
    """A random physical mass, centre of mass and full tensor."""
    mass = generator.uniform(0.5, 3.0)
    moments = [mass * generator.uniform(0.002, 0.02) for _ in range(3)]
    principal = (moments[1] + moments[2], moments[0] + moments[2], moments[0] + moments[1])
    turn = frames.normalise(quaternion(generator.gauss(0, 1) for _ in range(4)))
    centre = vector3(generator.uniform(-reach, reach) for _ in range(3))
    return Inertial(mass, centre, frames.rotate_inertia(turn, (*principal, 0.0, 0.0, 0.0)))


def joint(kind: str, name: str, parent: str | None, generator: random.Random, **more: Any) -> Joint:
    """A random joint with an initial state."""
    axis = (0.0, 0.0, 0.0)
    if kind in SCALAR_JOINTS:
        raw = [generator.gauss(0, 1) for _ in range(3)]
        length = math.sqrt(sum(x * x for x in raw))
        axis = vector3(x / length for x in raw)
    start = pose(generator)
    position = {
        "fixed": (),
        "hinge": (generator.uniform(-1, 1),),
        "slide": (generator.uniform(-0.2, 0.2),),
        "ball": start.quaternion,
        "free": (*start.position, *start.quaternion),
    }[kind]
    velocity = tuple(
        generator.uniform(-1, 1) for _ in range({"fixed": 0, "hinge": 1, "slide": 1, "ball": 3, "free": 6}[kind])
    )
    origin = Pose() if kind == "free" else pose(generator)
    return Joint(name, kind, parent, origin, axis, position=position, velocity=velocity, **more)


def tree(
    kinds: list[str], seed: int, parents: list[int] | None = None, prefix: str = "", **more: object
) -> tuple[Body, ...]:
    """A tree of bodies with joints of the given kinds; ``parents`` are indices, −1 the world (default: a chain)."""
    generator = random.Random(seed)
    bodies: list[Body] = []
    for index, kind in enumerate(kinds):
        above = (parents or range(-1, len(kinds) - 1))[index]
        name = f"{prefix}link{index}"
        given = {key: value for key, value in more.items() if kind in TREE_JOINTS}
        if kind == "ball":
            given = {key: value for key, value in given.items() if key in ("damping", "spring_stiffness")}
        parent = bodies[above].name if above >= 0 else None
        model = bodies[above].model if above >= 0 else name
        bodies.append(Body(name, model, inertial(generator), joint(kind, f"{name}_joint", parent, generator, **given)))
    return tuple(bodies)


def parent_pairs(bodies: tuple[Body, ...]) -> tuple[tuple[str, str], ...]:
    """The sorted pairs of bodies joined by a joint."""
    return tuple(sorted(sorted_pair(body.name, body.joint.parent) for body in bodies if body.joint.parent is not None))


def world(bodies: tuple[Body, ...], name: str = "test", **more: Any) -> World:
    """A world of ``bodies`` without contact laws."""
    contact = more.pop("contact", Contact(excluded_bodies=parent_pairs(bodies)))
    physics = more.pop("physics", Physics(timestep=0.001, steps=2000))
    return World(name, bodies, contact=contact, physics=physics, **more)


def every_joint(**more: Any) -> World:
    """A free root with a fixed, hinge, slide and ball joint, full tensors, skew axes, offsets."""
    bodies = tree(["free", "hinge", "fixed", "slide", "ball", "hinge"], 7, [-1, 0, 1, 2, 0, 4], **more)
    return world(bodies, "every-joint")


def lifted() -> World:
    """A free body with damping and an arm, and an arm on a fixed base; all but the base with a part of their weight."""
    bodies = tree(["free", "hinge", "ball"], 7) + tree(["fixed", "slide", "hinge"], 8, prefix="fixed-")
    scales = (0.4, 0.0, -0.3, 1.0, 0.9, 0.7)
    first, *others = (replace(body, gravity_scale=scale) for body, scale in zip(bodies, scales, strict=True))
    return world((with_joint(first, damping=0.3, angular_damping=0.3), *others), "lifted")


def immersed() -> World:
    """A free body with an arm, and an arm on a fixed base, in a current of oil."""
    bodies = boxed(
        tree(["free", "hinge", "ball", "slide"], 17) + tree(["fixed", "hinge", "fixed"], 18, prefix="fixed-"), ()
    )
    fluid = Fluid(900.0, 0.3, (0.4, -0.3, 0.2))
    return world(bodies, "immersed", physics=Physics(timestep=0.001, steps=2000, fluid=fluid))


def damped_springs() -> World:
    """Damping and springs on hinge, slide and ball, on a fixed base."""
    bodies = tree(["fixed", "hinge", "slide", "ball"], 11, damping=0.3, spring_stiffness=4.0)
    sprung = (with_joint(body, spring_rest=0.1) if body.joint.kind in SCALAR_JOINTS else body for body in bodies)
    return world(tuple(sprung), "damped-springs")


def implicitly_damped(armature: float = 0.0) -> World:
    """Two hinges and a slide, whose damping is unstable at 1 ms where it is explicit."""
    bodies = tree(["fixed", "hinge", "slide", "hinge"], 5, damping=400.0, armature=armature)
    return with_implicit_damping(world(bodies, "implicitly-damped", physics=Physics(steps=100, damping="implicit")))


POINT = Inertial(0.4, (0.02, -0.03, 0.05))
"""A point mass."""


def rod(mass: float, length: float, turn: tuple[float, float, float, float] = frames.IDENTITY) -> Inertial:
    """A rod along z of the turned axes, which no torque about itself stops from turning."""
    across = mass * length * length / 12.0
    return Inertial(mass, (0.0, 0.03, 0.0), frames.rotate_inertia(turn, (across, across, 0.0, 0.0, 0.0, 0.0)))


def weightless() -> World:
    """Bodies without mass and with singular tensors wherever they may be: a free root without mass, on which a chain of more
    carries the first mass, with a hinge that hangs on it and leaves; an arm whose every link is a body without mass with one
    welded to it; two crossed rods on a ball joint, of which none could turn by itself; a leaf of a fixed base."""
    kinds = ["free", "fixed", "fixed", "fixed", "hinge", "fixed", "slide", "fixed", "fixed"]
    drone = tree(kinds, 21, [-1, 0, 1, 1, 1, 4, 5, 6, 0])
    arm = tree(
        ["fixed", "hinge", "fixed", "fixed", "slide", "fixed", "fixed"], 22, [-1, 0, 1, 1, 2, 4, 0], prefix="arm-"
    )
    cross = tree(["ball", "fixed", "fixed"], 23, [-1, 0, 0], prefix="cross-")
    slanted = frames.normalise((0.6, 0.3, -0.5, 0.2))
    other = {
        **dict.fromkeys(("link0", "link1", "link5", "link7", "arm-link1", "arm-link4", "arm-link6"), Inertial(0.0)),
        **{"link8": POINT, "arm-link3": rod(0.3, 0.4, slanted), "cross-link0": Inertial(0.0)},
        **{"cross-link1": rod(0.7, 0.5), "cross-link2": rod(0.5, 0.6, slanted)},
    }
    bodies = tuple(replace(body, inertial=other.get(body.name, body.inertial)) for body in (*drone, *arm, *cross))
    return world(bodies, "weightless")


def point_mass() -> World:
    """A point mass that is fixed to a body on a hinge."""
    bodies = tree(["hinge", "fixed"], 24)
    return world((bodies[0], replace(bodies[1], inertial=POINT)), "point-mass")


def tool_frame() -> World:
    """A body without mass at the end of a pendulum."""
    bodies = tree(["hinge", "fixed"], 25)
    return world((bodies[0], replace(bodies[1], inertial=Inertial(0.0))), "tool-frame")


def several_joints() -> World:
    """Bodies with several joints: a wheel that steers, lifts and spins on a fixed base, with a universal joint below it; a free
    body as three slides and a ball."""
    arm = tree(["fixed", "hinge", "slide", "hinge", "hinge", "hinge"], 26)
    loose = tree(["slide", "slide", "slide", "ball"], 27, prefix="loose-")
    owner = {"link1": "link3", "link2": "link3", "link4": "link5"} | {f"loose-link{k}": "loose-link3" for k in range(3)}
    called = {name: carrier_name(body, f"{name}_joint") for name, body in owner.items()}
    bodies = []
    for body in (*arm, *loose):
        joint, name = body.joint, called.get(body.name, body.name)
        joint = replace(joint, parent=called.get(joint.parent or "", joint.parent))
        inertia = body.inertial if name == body.name else Inertial(0.0)
        bodies.append(replace(body, name=name, joint=joint, inertial=inertia))
    # slides along the axes, so that no draw makes two of them parallel
    for index, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), start=len(arm)):
        bodies[index] = with_joint(bodies[index], axis=axis, origin=Pose())
    return world(tuple(bodies), "several-joints")


def jointed(kind: str, **more: Any) -> World:
    """One body on a joint of this kind."""
    (body,) = tree([kind], 6)
    return world((with_joint(body, **more),), kind)


def limits_and_armature(armature: float = 0.0, dry_friction: float = 0.0) -> World:
    """A fixed-base arm of three hinges with all limits; armature and dry friction where requested."""
    bodies = tree(
        ["fixed", "hinge", "hinge", "slide"],
        13,
        position_limits=(-2.5, 2.0),
        velocity_limit=3.0,
        effort_limit=50.0,
        armature=armature,
        dry_friction=dry_friction,
    )
    return world(bodies, "limits")


def accepting(base: World, *engines: str) -> World:
    """The same world, in which each of ``engines`` is allowed everything that it has approximately or outside, and that the
    world needs. Raises UnsupportedError with what an engine does not support at all."""
    for engine in engines:
        options = base.options(engine)
        wanted = missing_options(base, engine)
        base = with_options(
            base, engine, **{key: tuple(sorted({*getattr(options, key), *names})) for key, names in wanted.items()}
        )
    return base


def with_options(base: World, engine: str, **options: Any) -> World:
    """The same world with other options for one engine (settings, accept, outside)."""
    others = tuple(o for o in base.engines if o.engine != engine)
    return replace(base, engines=(*others, replace(base.options(engine), **options)))


MATERIAL = Material("default", 0.4, 0.0)


def shapes_world(kinds: tuple[str, ...] = ("sphere", "box", "cylinder", "capsule"), friction: float = 0.4) -> World:
    """One free body of each shape kind above a big fixed box, all of one material; shape frames are turned and moved."""
    generator = random.Random(3)
    bodies = [slab("floor", (4.0, 4.0, 0.2), "default")]
    for index, kind in enumerate(kinds):
        solid = inertial(generator, 0.02)
        shape = Shape(f"{kind}_0", kind, SIZES[kind], pose(generator, 0.02), "default")
        bodies.append(free(kind, (float(index), 0.0, 0.5), solid, shape))
    return world(tuple(bodies), "shapes", contact=single_material("default", friction))


GROUND = heightfield_size(
    0.8, 0.6, 0.2, np.array([[0.1, 0.0, 0.05, 0.02], [0.02, 0.12, 0.0, 0.06], [0.06, 0.03, 0.09, 0.0]])
)
"""Rough ground."""


def ground(kinds: tuple[str, ...] = ("sphere",)) -> World:
    """One free body of each shape kind above rough ground."""
    base = shapes_world(kinds)
    floor, *others = base.bodies
    field = Shape("floor_0", "heightfield", GROUND, Pose((0.1, 0.0, -0.1)), "default")
    return replace(base, name="ground", bodies=(replace(floor, shapes=(field,)), *others))


def meshes() -> World:
    """A free body of a mesh above a floor, and one that is seen alone, moved and turned, on another."""
    base = shapes_world(("mesh", "sphere"))
    floor, hull, ball = base.bodies
    seen = replace(hull.shapes[0], name="seen", collision=False, material="", pose=Pose((0.1, 0.0, 0.2)))
    return replace(base, name="meshes", bodies=(floor, hull, replace(ball, shapes=(*ball.shapes, seen))))


def spheres(count: int = 8) -> World:
    """Frictionless spheres above a plane; the second scenario of the seed paper in small."""
    generator = random.Random(216)
    bodies = [fixed("floor", Shape("floor_0", "plane", (), Pose(), "slick"))]
    solid = Inertial(10.0, inertia=(0.04, 0.04, 0.04, 0.0, 0.0, 0.0))
    for index in range(count):
        x, y, z = index % 2, index // 2 % 2, index // 4
        at = (0.21 * x + generator.uniform(0, 1e-3), 0.21 * y + generator.uniform(0, 1e-3), 0.5 + 0.21 * z)
        name = f"ball_{index}"
        bodies.append(free(name, at, solid, Shape(f"{name}_0", "sphere", (0.1,), Pose(), "slick")))
    return world(tuple(bodies), "spheres", contact=single_material("slick", 0.0))


def gripper() -> World:
    """Two fingers on slides on a palm that slides itself; the fingers ignore each other by group, palm and bar by name."""

    def box(name: str) -> Shape:
        return Shape(f"{name}_0", "box", (0.1, 0.1, 0.1), Pose(), "default")

    def sliding(name: str, parent: str | None, origin: Pose, axis: Vector3, group: str = "default") -> Body:
        joint = Joint(f"{name}_joint", "slide", parent, origin, axis, position=(0.0,), velocity=(0.0,))
        return Body(name, "palm", solid, joint, (box(name),), group)

    solid = Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    bodies = (
        sliding("palm", None, Pose(), z),
        sliding("left", "palm", Pose((-0.3, 0.0, -0.3)), x, "finger"),
        sliding("right", "palm", Pose((0.3, 0.0, -0.3)), x, "finger"),
        free("bar", (0.0, 0.0, -1.0), solid, box("bar")),
    )
    excluded = (("bar", "palm"), ("left", "palm"), ("palm", "right"))
    contact = single_material("default", 0.4, ignored_groups=(("finger", "finger"),), excluded_bodies=excluded)
    return world(bodies, "gripper", contact=contact)


def touching_link(on_base: bool = False) -> World:
    """The gripper with fingers that begin within the palm, which may touch the left one although a joint joins them;
    ``on_base``: the palm is fixed to the world."""
    shift = {"left": Pose((0.3, 0.0, 0.25)), "right": Pose((-0.3, 0.0, 0.25))}

    def change(body: Body) -> Body:
        if body.name in shift:
            return with_shapes(body, lambda shape: replace(shape, pose=shift[body.name]))
        return replace(body, joint=Joint(body.joint.name, "fixed")) if body.name == "palm" and on_base else body

    base = gripper()
    contact = replace(base.contact, excluded_bodies=(("bar", "palm"), ("palm", "right")))
    return with_bodies(base, change, name="touching-link", contact=contact)


def ball_with_law(**law: Any) -> World:
    """A ball above a floor, of one material with this law."""
    pair = PairContact("default", "default", **({"friction": 0.5, "restitution": 0.0} | law))
    contact = Contact(materials=(Material("default"),), pairs=(pair,))
    return with_bodies(
        spheres(1), lambda body: with_shapes(body, lambda shape: replace(shape, material="default")), contact=contact
    )


def lying(**law: Any) -> World:
    """The same of a capsule, which touches in two points."""
    capsule = Shape("capsule_0", "capsule", (0.1, 0.4), material="default")
    return with_bodies(
        ball_with_law(**law), lambda body: body if body.joint.kind == "fixed" else replace(body, shapes=(capsule,))
    )


def fall() -> World:
    """A free body with a full tensor, a bent path and nothing around it."""
    return world(tree(["free"], 3), "fall")


def hinges() -> World:
    """A pendulum of two hinges with skew axes on a fixed base, and a free body with another fixed to it."""
    bodies = tree(["fixed", "hinge", "hinge"], 4) + tree(["free", "fixed"], 5, prefix="free-")
    return world(bodies, "hinges")


def placed(base: World, index: int, position: tuple[float, float, float]) -> World:
    """``base`` with its body at ``index``, a free one, beginning at rest at ``position``."""
    chosen = base.bodies[index]
    moved = with_joint(chosen, position=(*position, *chosen.joint.position[3:]), velocity=(0.0,) * 6)
    return with_bodies(base, lambda body: moved if body is chosen else body)


CONTACT_GAPS: Mapping[Feature, dict[str, Any]] = {
    Feature.FRICTION: {},
    Feature.RESTITUTION: {"restitution": 0.5},
    Feature.RESTITUTION_THRESHOLD: {"restitution": 0.5, "restitution_threshold": 0.3},
    Feature.TORSIONAL_FRICTION: {"torsional_friction": 0.01},
    Feature.ROLLING_FRICTION: {"rolling_friction": 0.01},
    Feature.HARDNESS_COMMON: {},
    Feature.HARDNESS_TIME_CONSTANT: {
        "friction": 0.0,
        "hardness": Hardness("time-constant", time_constant=0.02, damping_ratio=1.0),
    },
    Feature.HARDNESS_STIFFNESS: {"friction": 0.0, "hardness": Hardness("stiffness", stiffness=1e5, damping=100.0)},
    Feature.HARDNESS_NATIVE: {"hardness": Hardness("native")},
}
"""For each feature of one pair's law the law that needs it."""


def table(friction: dict[tuple[str, str], float], **law: Any) -> World:
    """Tiles of each material in a row, each with a small box of every material resting on it, far enough from each other.

    ``friction`` gives the value of every unordered pair (sorted names). Boxes are called "<material>_on_<tile>".
    """
    names = sorted({name for pair in friction for name in pair})
    flat = Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
    bodies = []
    for row, tile in enumerate(names):
        floor = Shape(f"tile_{tile}_0", "box", (20.0, 10.0, 0.4), Pose(), tile)
        body = fixed(f"tile_{tile}", floor, origin=Pose((0.0, 20.0 * row, -0.2)))
        bodies.append(replace(body, joint=replace(body.joint, name=f"{tile}_joint")))
    for row, tile in enumerate(names):
        for column, name in enumerate(names):
            on, place = f"{name}_on_{tile}", (column - len(names) / 2, 20.0 * row, 0.02)
            shape = Shape(f"{on}_0", "box", (0.2, 0.2, 0.04), Pose(), name)
            bodies.append(free(on, place, flat, shape, velocity=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)))
    pairs = tuple(PairContact(first, second, value, 0.0, **law) for (first, second), value in sorted(friction.items()))
    contact = Contact(materials=tuple(Material(name, friction[name, name]) for name in names), pairs=pairs)
    return world(tuple(bodies), "table", contact=contact)


def with_cone(cone: str) -> World:
    """:func:`shapes_world` under a friction cone."""
    base = shapes_world()
    return replace(base, contact=replace(base.contact, friction_cone=cone))
