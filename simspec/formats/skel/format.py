"""The format ``skel``: one XML file, ``world.skel``.

Poses are a position and intrinsic X-Y-Z Euler angles: of bodies in the world at zero configuration, of shapes in their body, of
joints in their child.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.formats.kit.contract import Format
from simspec.formats.kit.text import environment
from simspec.formats.skel.document import Document
from simspec.formats.skel.tree import Body, Joint, Shape, World
from simspec.support.declarations import Level, Support, Table, alike, exactly, never, outside, shape_kinds
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.types import Pose

WORLD: Final = "world.skel"

JOINT_TYPES: Mapping[str, str] = {
    "fixed": "weld",
    "hinge": "revolute",
    "slide": "prismatic",
    "ball": "ball",
    "free": "free",
}
"""The name of each kind of joint in .skel."""

GEOMETRY: Mapping[str, tuple[tuple[tuple[str, slice], ...], float]] = {
    "sphere": ((("radius", slice(0, 1)),), 1.0),
    "box": ((("size", slice(0, 3)),), 1.0),
    "cylinder": ((("radius", slice(0, 1)), ("height", slice(1, 2))), 1.0),
    "capsule": ((("radius", slice(0, 1)), ("height", slice(1, 2))), 1.0),
    "ellipsoid": ((("size", slice(0, 3)),), 2.0),
}
"""For each kind of shape which part of its size goes into which element, and what it is multiplied with: an ellipsoid's size
are its diameters."""
PLANE = (("normal", (0.0, 0.0, 1.0)), ("offset", (0.0,)))

_IMPLICIT = ".skel has implicit ones only"
_SURFACE = ".skel has no numbers of surfaces"
_FILTER = ".skel does not say what touches what"
_HARDNESS = ".skel has no hardness of contact"


class Skel(Format):
    """The .skel language, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "skel"
    SUPPORT: ClassVar[Table] = {
        **exactly(
            *(Feature.JOINT_FIXED, Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_FREE),
            Feature.DRY_FRICTION,
            *(Feature.INITIAL_POSITION, Feature.INITIAL_VELOCITY),
            *(Feature.INERTIA, Feature.TREE_SIZE, Feature.TREE_DEPTH),
            *(Feature.SHAPE_VISUAL, Feature.SHAPES_PER_BODY),
            *(Feature.GRAVITY, Feature.TIMESTEP),
        ),
        **shape_kinds(".skel", ("plane", *GEOMETRY)),
        Feature.INERTIA_FULL: Support(Level.EXACT, "the full tensor"),
        Feature.LIMIT_POSITION: never(".skel has limits, but not whether they are enforced"),
        Feature.LIMIT_VELOCITY: never(".skel has limits of velocity that are enforced, and no ratings"),
        Feature.LIMIT_EFFORT: never(".skel has limits of effort that are enforced, and no ratings"),
        Feature.DAMPING: never(_IMPLICIT),
        Feature.BALL_DAMPING: never(_IMPLICIT),
        Feature.SPRING: never(_IMPLICIT),
        Feature.BALL_SPRING: never(_IMPLICIT),
        Feature.ARMATURE: never(".skel has no armature"),
        **alike(
            never(_SURFACE),
            *(Feature.MATERIALS_PER_BODY, Feature.FRICTION, Feature.FRICTION_PAIRS, Feature.RESTITUTION),
            *(Feature.RESTITUTION_PAIRS, Feature.RESTITUTION_THRESHOLD, Feature.TORSIONAL_FRICTION),
            *(Feature.ROLLING_FRICTION, Feature.IMPACT_FRICTION, Feature.CONE_ELLIPTIC),
            *(Feature.CONE_PYRAMID_INSCRIBED, Feature.CONE_PYRAMID_CIRCUMSCRIBED),
        ),
        **alike(
            never(_HARDNESS),
            *(Feature.HARDNESS_COMMON, Feature.HARDNESS_TIME_CONSTANT, Feature.HARDNESS_STIFFNESS),
            *(Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS),
        ),
        Feature.PASSING_PAIRS: never(_FILTER),
        Feature.COLLISION_GROUPS: never(_FILTER),
        Feature.EXCLUDED_PAIRS: never(_FILTER),
        Feature.CONSTRAINT_LOOP: never(".skel has no constraints between bodies"),
        Feature.CONSTRAINT_COUPLING: never(".skel has no couplings of joints"),
        Feature.CONTROL: outside(".skel has no control laws"),
        Feature.CONTROL_NATIVE: never(".skel has no gains of controllers"),
    }

    def write(self, tree: World) -> dict[str, str]:
        """``world.skel``. Raises KeyError for kinds of joints and shapes that the language does not have, and ValueError for
        numbers that are not finite."""
        content = {
            "name": tree.name,
            "timestep": tree.timestep,
            "gravity": tree.gravity,
            "collision_detector": tree.collision_detector,
            "skeletons": [
                {
                    "name": skeleton.name,
                    "mobile": "true" if skeleton.mobile else "false",
                    "bodies": [_body(body) for body in skeleton.bodies],
                    "joints": [_joint(joint) for joint in skeleton.joints],
                }
                for skeleton in tree.skeletons
            ],
        }
        return {WORLD: environment().get_template("skel/world.skel.j2").render(content)}

    def read(self, folder: Path) -> Document:
        """The document of ``world.skel`` in ``folder``.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no
        .skel.
        """
        from simspec.formats.skel.reading import read_document

        return read_document(folder / WORLD)


def _transformation(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *frames.to_euler_xyz(pose.quaternion))


def _body(body: Body) -> dict[str, Any]:
    return {
        "name": body.name,
        "pose": _transformation(body.pose),
        "mass": body.inertial.mass,
        "inertia": body.inertial.inertia,
        "centre_of_mass": body.inertial.centre_of_mass,
        "visual": [_shape(shape) for shape in body.visual],
        "collision": [_shape(shape) for shape in body.collision],
    }


def _shape(shape: Shape) -> dict[str, Any]:
    sizes: tuple[tuple[str, tuple[float, ...]], ...] = PLANE
    if shape.kind != "plane":
        parts, factor = GEOMETRY[shape.kind]
        sizes = tuple((name, tuple(value * factor for value in shape.size[part])) for name, part in parts)
    return {"kind": shape.kind, "sizes": sizes, "pose": _transformation(shape.pose), "colour": shape.colour}


def _joint(joint: Joint) -> dict[str, Any]:
    return {
        "name": joint.name,
        "type": JOINT_TYPES[joint.kind],
        "parent": "world" if joint.parent is None else joint.parent,
        "child": joint.child,
        "axis": joint.axis,
        "limits": joint.position_limits,
        "dry_friction": joint.dry_friction,
        "position": joint.position,
        "velocity": joint.velocity,
    }
