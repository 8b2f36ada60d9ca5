"""A world for Webots: one ``world.wbt`` in which every tree is a nest of Solids and joints, with a sidecar for the data that
simspec passes at run time; nothing is left to a default. Facts are of the reference manual and the sources of R2023b.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final

from simspec.contact import ContactPlan
from simspec.dialects.kit.contract import Dialect, Lowered, NeededSetting
from simspec.dialects.kit.sidecar import JointValue, Sidecar, Target, common_fields, springs_of
from simspec.dialects.webots.nodes import (
    BallStart,
    Range,
    WebotsShapeEntry,
    WebotsSidecar,
    bounding,
    contact_properties,
    downwards,
    joint_node,
    seen,
    stops,
    turn,
    turned_all,
)
from simspec.formats.kit.contract import recentre_free_roots
from simspec.formats.wbt.format import WbtNodeTree, WbtWorld
from simspec.formats.wbt.reading import WbtDocument
from simspec.language.vocabulary import TREE_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import (
    Refinement,
    Support,
    Table,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.contact_pairs import solid_shapes
from simspec.world.inertia import lumped_inertial, rigid_members, summed_inertial
from simspec.world.kinematics import poses, rigid_groups
from simspec.world.types import Body, Inertial, PairContact, Pose, Quaternion, ReadBack, Vector3, World

# Where bodies are at the beginning and how they move: what a .wbt says of jointed bodies in place of joint rates.

Twist = tuple[Vector3, Vector3]
"""Velocity of a point (m/s) and angular velocity (rad/s), in world axes."""
AT_REST: Twist = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def twists(world: World) -> dict[str, Twist]:
    """The twist of every body at its frame's origin, at the initial state."""
    placed = poses(world)
    found: dict[str, Twist] = {}
    for body in world.bodies:
        joint, here = body.joint, placed[body.name]
        linear, angular = AT_REST
        if joint.parent is not None:
            linear, angular = moved(found[joint.parent], placed[joint.parent].position, here.position)
        if joint.kind == "hinge":
            angular = frames.add(angular, _along(here, joint.axis, joint.velocity[0]))
        elif joint.kind == "slide":
            linear = frames.add(linear, _along(here, joint.axis, joint.velocity[0]))
        elif joint.kind == "ball":
            angular = frames.add(angular, frames.rotate(here.quaternion, _vector(joint.velocity)))
        elif joint.kind == "free":
            linear, angular = _vector(joint.velocity[:3]), _vector(joint.velocity[3:])
        found[body.name] = (linear, angular)
    return found


def centres(bodies: Sequence[Body]) -> Mapping[str, Vector3]:
    """Of the topmost body of each rigid group that moves the group's centre of mass in its frame (m), of which Webots' body has
    the velocity."""
    return {
        top: summed_inertial((body.inertial, pose) for body, pose in members).centre_of_mass
        for top, members in rigid_members(bodies).items()
    }


def moved(twist: Twist, from_point: Vector3, to_point: Vector3) -> Twist:
    """The same motion of a rigid body at another of its points."""
    linear, angular = twist
    return frames.add(linear, frames.cross(angular, frames.subtract(to_point, from_point))), angular


def _along(here: Pose, axis: Vector3, rate: float) -> Vector3:
    x, y, z = frames.rotate(here.quaternion, axis)
    return (x * rate, y * rate, z * rate)


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return (x, y, z)


KINDS: Final = ("sphere", "box", "cylinder", "capsule", "plane")
WHOLE: Final = 1e-9
"""Milliseconds by which a step may be off a whole number of them: the round-off of seconds times a thousand."""
ALWAYS: Final = 1e9
"""Seconds after which a body that rests is taken out of the simulation: longer than any run."""
SUPERVISOR: Final = "simspec supervisor"
"""The name of the Robot that simspec controls; no body has a blank in its name."""

NO_MOTORS = "simspec writes no Webots motors, which control velocity"
JOINTED = "Webots excludes contact of bodies that a joint joins, and has no other collision filter of bodies"
LACKING: Final[Table] = {
    **for_each(never("Webots has no armature, and contact would ignore a computed one"), *features.ARMATURES),
    Feature.DAMPING_IMPLICIT: never("Webots has no armature, and simspec does not write its implicit dampers"),
    Feature.JOINT_SEVERAL: classes.NO_MASSLESS,
    Feature.BALL_LIMIT: never("Webots' BallJoint limits three angles about axes, not the angle of the whole rotation"),
    Feature.TREE_DEPTH: never("simspec has not tested whether Webots reads Solids nested this deep"),
    **for_each(
        never("simspec does not implement it for Webots"),
        *(Feature.KINEMATIC, Feature.HARDNESS_STIFFNESS, Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS),
    ),
    Feature.MATERIALS_PER_BODY: never("a Solid has one contactMaterial"),
    **for_each(classes.no_margin("Webots"), *features.MARGINS),
    Feature.SURFACE_VELOCITY: never("only Webots' Tracks have moving surfaces, and simspec does not write them"),
    Feature.HARDNESS_TIME_CONSTANT: never("Webots' contact softness in m/(N s) does not scale with mass"),
    Feature.CONE_PYRAMID_INSCRIBED: never("simspec cannot pass pyramid axes to Webots"),
    **for_each(
        never("Webots has no collision filter of materials or groups"), Feature.PASSING_PAIRS, Feature.COLLISION_GROUPS
    ),
    Feature.TOUCHING_PAIRS: never(JOINTED),
    Feature.CONTROL_NATIVE: never(NO_MOTORS),
    **for_each(classes.IN_TREES_ONLY, *features.CONSTRAINTS, Feature.SUM_DRY_FRICTION, Feature.SUM_LIMITS),
}
"""Features that neither Webots nor its files support."""


def _whole_milliseconds(world: World) -> Refinement | None:
    step = world.physics.timestep * 1e3
    whole = step > 1.0 - WHOLE and abs(step - round(step)) < WHOLE
    return unsupported_if(None if whole else "Webots' controllers step whole milliseconds, one at least")


def _massless_unsolid(world: World) -> Refinement | None:
    groups = rigid_groups(world)
    names = (
        body.name
        for body in world.bodies
        if groups[body.name] != "world" and not lumped_inertial(world, body).mass and solid_shapes(body)
    )
    name = next(names, None)
    why = f"Webots ignores contacts of a Solid without mass, and {name!r} has none"
    return unsupported_if(why if name is not None else None)


class WebotsDialect(Dialect):
    """VRML97 without PROTO, for Webots R2023b and later."""

    NAME: ClassVar[str] = "webots"
    FORMAT: ClassVar[str] = "wbt"
    SUPPORT: ClassVar[Table] = {
        **classes.with_sidecar("Webots", classes.EFFORTS),
        **exactly(
            *(Feature.FRICTION, Feature.FRICTION_PAIRS, Feature.CONE_ELLIPTIC, Feature.CONE_PYRAMID_CIRCUMSCRIBED),
            Feature.EXCLUDED_PAIRS,
        ),
        **shape_kinds("Webots", KINDS),
        **{
            feature: Support(support.level, support.how, refine=_massless_unsolid)
            for feature, support in classes.LUMPED.items()
        },
        Feature.GRAVITY: exact(
            "Webots' gravity acts along -z; simspec rotates the world by a Pose for other directions"
        ),
        Feature.TIMESTEP: exact("Webots' timestep is a multiple of 1 ms", refine=_whole_milliseconds),
        Feature.LIMIT_POSITION: exact(
            "simspec writes minStop and maxStop within ±π, and other limits into the sidecar"
        ),
        **for_each(via_api("simspec stores it in the sidecar; no motion depends on it"), *features.LIMIT_RATINGS),
        **for_each(classes.explicit("Webots"), *features.DAMPERS_AND_SPRINGS),
        **LACKING,
    }
    SIDECAR: ClassVar[type[Sidecar]] = WebotsSidecar
    SETTINGS: ClassVar[Mapping[str, NeededSetting]] = {
        "softness": NeededSetting(float),
        "joint_softness": NeededSetting(float),
        "joint_error_reduction": NeededSetting(float),
        "contact_points": NeededSetting(int),
    }

    def lower(self, world: World, target: Target) -> Lowered:
        """The nodes of ``world`` and their sidecar."""
        given, offsets = recentre_free_roots(world)
        settings = target.settings
        laws = _laws(world, target.plan)
        strength, turned = downwards(given.physics.gravity)
        info = {
            "title": world.name,
            "gravity": strength,
            "CFM": settings["joint_softness"],
            "ERP": settings["joint_error_reduction"],
            "basicTimeStep": float(round(given.physics.timestep * 1e3)),
            "physicsDisableTime": ALWAYS,
            "contactProperties": tuple(contact_properties(law, settings) for law in laws),
        }
        robot = {"name": SUPERVISOR, "controller": "<extern>", "supervisor": True, "window": "<none>"}
        nodes = (
            WbtNodeTree("WorldInfo", info),
            WbtNodeTree("Viewpoint"),
            WbtNodeTree("DirectionalLight"),
            *turned_all(_Nest(given, turned).roots(), turned),
            WbtNodeTree("Robot", robot, "simspec"),
        )
        sidecar = WebotsSidecar(
            **common_fields(self.NAME, self.FORMAT, world, target, offsets), **_sidecar_fields(world)
        )
        return Lowered(WbtWorld(nodes), sidecar)

    def raise_(self, document: WbtDocument, sidecar: WebotsSidecar) -> ReadBack:
        """See ``dialects/webots/raising.py``."""
        from simspec.dialects.webots.raising import raised

        return raised(document, sidecar)


def _laws(world: World, plan: ContactPlan) -> tuple[PairContact, ...]:
    """Of the pairs of the plan those of which both materials are there."""
    every = {(law.first, law.second): law for law in world.contact.pairs}
    there = {shape.material for body in world.bodies for shape in solid_shapes(body)}
    return tuple(every[pair] for pair in sorted(plan.layer_of) if set(pair) <= there)


class _Nest:
    """The Solids of a world, whose free roots stand at their centres of mass."""

    def __init__(self, world: World, turned: Quaternion):
        self._world = world
        self._turned = turned
        self._placed = poses(world)
        self._twists = twists(world)
        self._centres = centres(world.bodies)
        self._groups = rigid_groups(world)

    def roots(self) -> list[WbtNodeTree]:
        """The trees, from their leaves to their roots, so that no chain is too long."""
        below: dict[str, list[WbtNodeTree]] = {}
        found: list[WbtNodeTree] = []
        for index, body in reversed(list(enumerate(self._world.bodies))):
            node = self._solid(index, body, tuple(reversed(below.pop(body.name, []))))
            joint = body.joint
            if joint.kind in TREE_JOINTS:
                node = joint_node(joint, node, self._place(body), f"joint_{index}")
            if joint.parent is None and joint.kind in ("fixed", "free"):
                found.append(node)
            elif joint.parent is None:  # a joint stands in a Solid: one that is the ground
                ground = {"name": f"ground {index}", "children": (node,)}
                found.append(WbtNodeTree("Solid", ground, f"ground_{index}"))
            else:
                below.setdefault(joint.parent, []).append(node)
        return found[::-1]

    def _place(self, body: Body) -> Pose:
        """Where a body stands in the node around it, at the initial state."""
        if body.joint.parent is None:
            return self._placed[body.name]
        return frames.compose(frames.inverse(self._placed[body.joint.parent]), self._placed[body.name])

    def _solid(self, index: int, body: Body, below: tuple[WbtNodeTree, ...]) -> WbtNodeTree:
        place = self._place(body)
        material = next((shape.material for shape in solid_shapes(body)), "default")
        fields: dict[str, object] = {
            "translation": place.position,
            "rotation": turn(place.quaternion),
            "children": (*seen(body), *below),
            "name": body.name,
            "model": body.model,
            "contactMaterial": material,
            "boundingObject": bounding(body),
        }
        if self._groups[body.name] != "world" and body.inertial.mass:
            fields["physics"] = _physics(body.inertial)
        if body.name in self._centres:
            linear, angular = self._motion(body)
            fields |= {"linearVelocity": linear, "angularVelocity": angular}
        return WbtNodeTree("Solid", fields, f"body_{index}")

    def _motion(self, body: Body) -> tuple[object, object]:
        """Of the topmost body of a rigid group: of the group's centre of mass, in world axes."""
        here, twist = self._placed[body.name], self._twists[body.name]
        if twist == AT_REST:
            return twist
        centre = frames.add(here.position, frames.rotate(here.quaternion, self._centres[body.name]))
        linear, angular = moved(twist, here.position, centre)
        return frames.rotate(self._turned, linear), frames.rotate(self._turned, angular)


def _physics(inertial: Inertial) -> WbtNodeTree:
    xx, yy, zz, xy, xz, yz = inertial.inertia
    fields = {
        "density": -1.0,
        "mass": inertial.mass,
        "centerOfMass": (inertial.centre_of_mass,),
        "inertiaMatrix": ((xx, yy, zz), (xy, xz, yz)),
    }
    return WbtNodeTree("Physics", fields)


def _sidecar_fields(world: World) -> dict[str, Any]:
    def values(field: str) -> tuple[JointValue, ...]:
        # forces that act on free bodies at all times are among the common fields
        found = ((body.name, getattr(body.joint, field)) for body in world.bodies if body.joint.kind != "free")
        none = (None,) if field.endswith("_limit") else (None, 0.0)  # a rating of 0 is another than none
        return tuple(JointValue(name, value) for name, value in found if value not in none)

    return {
        "models": tuple(body.model for body in world.bodies),
        "joints": tuple(body.joint.name for body in world.bodies),
        "shapes": tuple(
            WebotsShapeEntry(shape.name, body.name, shape.visual, shape.collision)
            for body in world.bodies
            for shape in body.shapes
        ),
        "velocity_limits": values("velocity_limit"),
        "effort_limits": values("effort_limit"),
        "damping": values("damping"),
        "springs": springs_of(world),
        "untold_limits": tuple(
            Range(body.name, *body.joint.position_limits)
            for body in world.bodies
            if body.joint.position_limits is not None and not stops(body.joint)
        ),
        "starts": tuple(
            BallStart(body.name, body.joint.position)  # type: ignore[arg-type]
            for body in world.bodies
            if body.joint.kind == "ball"
        ),
    }
