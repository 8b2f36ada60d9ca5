"""The format ``urdf``: one tree of links a file; where the trees stand is in ``placement.json``."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.formats.kit.contract import Format, Loss, LossFate, PlainFiles, losses
from simspec.formats.kit.mesh_reading import read_meshes
from simspec.formats.kit.text import FIELDS, environment, field_files, json_text, mesh_files
from simspec.formats.urdf.reading import UrdfDocument
from simspec.formats.urdf.robots import (
    KINDS,
    UNLIMITED,
    WORLD_LINK,
    RobotFiles,
    Robots,
    UrdfExtension,
    UrdfGeometry,
    UrdfInertial,
    UrdfJoint,
    UrdfLink,
    UrdfOrigin,
    UrdfRobot,
    standard_robot,
    unlike,
)
from simspec.language.vocabulary import TREE_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import (
    Refinement,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from simspec.world import types
from simspec.world.damping import without_implicit_damping
from simspec.world.kinematics import trees
from simspec.world.types import Body, FollowConstraint, World

PLACEMENT: Final = "placement.json"
PLACEMENT_SCHEMA: Final = 1

PROFILES: Final = ("fixed-base", "floating")
"""fixed-base: the root link of a free tree has no joint, as in nearly every file; readers choose whether it is free. floating:
a joint of type ``floating`` from a link ``world`` says that it is."""
NOTHING: Final = UrdfInertial(UrdfOrigin(), 0.0, (0.0,) * 6)
"""The inertia of a link without mass: readers give one that says none 1 kg, or that of its shapes as water."""
COMPILER: Final[tuple[tuple[str, str], ...]] = (
    ("fusestatic", "false"),
    ("discardvisual", "false"),
    ("strippath", "false"),
    ("inertiafromgeom", "false"),
)
"""Attributes of the extension ``<compiler>`` (:func:`_complete`), without which its reader merges links on fixed joints, drops
visual shapes, drops folders of meshes, and takes inertias of shapes. Other readers skip the element."""
LEAST: Final[tuple[tuple[str, str], ...]] = (("boundmass", "1e-9"), ("boundinertia", "1e-12"))
"""The same where a link without mass moves, which that reader refuses."""

_NO_CONTACT = "URDF has no contact parameters"
_IN_PLACEMENT = f"in {PLACEMENT}"


def within_trees(world: World) -> Refinement | None:
    """Not supported where a joint follows one of another tree, which stands in another file."""
    root = {body.joint.name: root for root, bodies in trees(world).items() for body in bodies}
    across = [coupling.name for coupling in _follows(world) if root[coupling.joint] != root[coupling.leader]]
    return unsupported_if(f"{across[0]!r} couples joints of two trees, which are separate files") if across else None


def _follows(world: World) -> Iterator[FollowConstraint]:
    return (coupling for coupling in world.constraints if isinstance(coupling, FollowConstraint))


SUPPORT: Final[Table] = {
    **classes.file_language("URDF"),
    **exactly(
        Feature.JOINT_SEVERAL, Feature.LIMIT_POSITION, *features.LIMIT_RATINGS, Feature.DAMPING, Feature.DRY_FRICTION
    ),
    Feature.JOINT_FREE: via_api(f"simspec writes a tree without a joint to the world, and its pose {_IN_PLACEMENT}"),
    **for_each(via_api(_IN_PLACEMENT), *features.INITIAL_STATE),
    Feature.JOINT_BALL: approximate(
        "simspec writes three hinges about x, y and z with two massless links, which are singular with the second at 90°"
    ),
    Feature.BALL_DAMPING: approximate("simspec writes the same damping at each of three hinges"),
    **shape_kinds("URDF", KINDS),
    Feature.SHAPE_CAPSULE: approximate("simspec writes the same solid as a cylinder and two spheres"),
    Feature.SHAPE_PLANE: approximate("simspec writes a box of 200 x 200 x 1 m below the plane"),
    Feature.CONSTRAINT_LOOP: never("URDF has trees only"),
    Feature.CONSTRAINT_COUPLING: exact("mimic of a joint", refine=within_trees),
    Feature.BALL_LIMIT: never("URDF has no ball joints"),
    Feature.FRAME: exact("a link without mass on a fixed joint, NAME_joint"),
    Feature.FLUID: never("URDF has no fluid"),
    Feature.FREE_ARMATURE: never("URDF has no armature of free bodies"),
    **for_each(never("URDF has no springs"), Feature.SPRING, Feature.BALL_SPRING),
    **for_each(never(_NO_CONTACT), Feature.MATERIALS_PER_BODY, *features.CONTACT_LAWS, *features.HARDNESSES),
    **for_each(never("URDF has no collision filter"), *features.FILTERS),
    **for_each(
        never("URDF has no gains; <transmission> and <ros2_control> name interfaces of drivers"),
        *features.CONTROLS,
    ),
    Feature.GRAVITY: never("URDF has no gravity"),
    Feature.TIMESTEP: never("URDF has no timestep"),
}
"""Plain URDF's support of each feature."""


def robots_and_placement(world: World, profile: str = PROFILES[0]) -> tuple[Robots, str]:
    """The robots by file, in one of ``PROFILES``, and the text of ``placement.json``: of each tree the file, whether its root
    is free, how it begins, and its own names of links and joints in addition to those in the file, which equal trees share."""
    files = RobotFiles({PLACEMENT})
    first: dict[str, tuple[Body, ...]] = {}
    placed = []
    for bodies in trees(world).values():
        joints = {body.joint.name for body in bodies}
        within = [coupling for coupling in _follows(world) if {coupling.joint, coupling.leader} <= joints]
        names = {body.name for body in bodies}
        named = [frame for frame in world.frames if frame.body in names]
        robot = standard_robot(bodies, follows=within, named=named)
        if profile == "floating" and bodies[0].joint.kind == "free":
            robot = _floating(robot, bodies[0])
        file = files.add(_complete(robot))
        placed.append(_placed(file, first.setdefault(file, bodies), bodies))
    return files.robots, json_text({"schema": PLACEMENT_SCHEMA, "trees": placed})


def _complete(robot: UrdfRobot) -> UrdfRobot:
    """The robot with all that readers would fill in for themselves."""
    links = tuple(
        dataclasses.replace(link, inertial=NOTHING) if link.inertial is None and link.name != WORLD_LINK else link
        for link in robot.links
    )
    massless = {link.name for link in links if link.inertial is NOTHING}
    moving = any(joint.child in massless and joint.type != "fixed" for joint in robot.joints)
    compiler = UrdfExtension("compiler", (*COMPILER, *(LEAST if moving else ())))
    return dataclasses.replace(robot, links=links, extensions=(UrdfExtension("mujoco", children=(compiler,)),))


def _floating(robot: UrdfRobot, root: Body) -> UrdfRobot:
    """The robot with a joint of six freedoms between the world and its root."""
    world = unlike(WORLD_LINK, {link.name for link in robot.links})
    joint = UrdfJoint(root.joint.name, "floating", world, root.name, UrdfOrigin())
    return dataclasses.replace(robot, links=(UrdfLink(world), *robot.links), joints=(joint, *robot.joints))


def _placed(file: str, first: tuple[Body, ...], bodies: tuple[Body, ...]) -> dict[str, Any]:
    """``first``: the bodies whose names the file has. Positions and velocities are those of ``world/types.py``."""
    root = bodies[0].joint
    joints = [
        {
            "name": body.joint.name,
            "in_file": in_file.joint.name,
            "kind": body.joint.kind,
            "position": body.joint.position,
            "velocity": body.joint.velocity,
        }
        for in_file, body in zip(first, bodies, strict=True)
        if body.joint.kind in TREE_JOINTS
    ]
    start = {
        "position": root.position[:3],
        "quaternion": root.position[3:7],
        "linear_velocity": root.velocity[:3],
        "angular_velocity": root.velocity[3:],
    }
    return {
        "file": file,
        "name": bodies[0].model,
        "free": root.kind == "free",
        "links": [{"name": body.name, "in_file": in_file.name} for in_file, body in zip(first, bodies, strict=True)],
        "joints": joints,
        **(start if root.kind == "free" else {}),
    }


def placeholders(world: World) -> Iterator[Loss]:
    """The limits that URDF demands and the world does not have."""
    without: dict[str, list[str]] = {"position": [], "velocity": [], "effort": []}
    for body in world.bodies:
        joint = body.joint
        limited = joint.kind == "slide" or (joint.kind == "hinge" and joint.position_limits is not None)
        rated = joint.kind == "hinge" and (joint.velocity_limit is not None or joint.effort_limit is not None)
        if joint.kind == "slide" and joint.position_limits is None:
            without["position"].append(body.name)
        if limited or rated:
            for name, value in (("velocity", joint.velocity_limit), ("effort", joint.effort_limit)):
                if value is None:
                    without[name].append(body.name)
    for name, bodies in without.items():
        if bodies:
            feature = Feature(f"joint.limits.{name}").value
            how = f"none in the spec, and URDF demands one: {UNLIMITED:g} stands for none"
            yield Loss(feature, LossFate.PLACEHOLDER, how, tuple(f"bodies.{body}.joint" for body in bodies))


INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
"""The attributes of an ``inertia``, in the order of :class:`simspec.formats.urdf.robots.UrdfInertial`."""


class Urdf(Format):
    """Files of the format ``urdf``: NAME.urdf for each distinct tree."""

    NAME: ClassVar[str] = "urdf"
    SUPPORT: ClassVar[Table] = SUPPORT
    RANGED: ClassVar[tuple[str, ...]] = ("slide",)
    PROFILES: ClassVar[tuple[str, ...]] = PROFILES

    def __init__(self, profile: str = PROFILES[0]):
        self.profile = profile

    def in_profile(self, name: str) -> Format:
        """The format in this layout. Raises SpecError for a name that is not of ``PROFILES``."""
        return Urdf(name) if name in self.PROFILES else super().in_profile(name)

    def write(self, tree: Robots) -> dict[str, str]:
        """A file for each robot, and the files of their meshes."""
        template = environment().get_template("urdf/model.urdf.j2")
        robots = {name: template.render(robot=robot, inertia=INERTIA) for name, robot in tree.items()}
        fields = (geometry.field for geometry in _geometries(tree) if geometry.field)
        hulls = (geometry.mesh for geometry in _geometries(tree) if geometry.mesh)
        return {**robots, **mesh_files(hulls), **field_files(fields)}

    def plain(self, world: World) -> PlainFiles:
        """One file for each distinct tree; where the trees stand and how they begin goes into ``placement.json``."""
        world = without_implicit_damping(world)
        robots, placement = robots_and_placement(world, self.profile)
        return PlainFiles({**self.write(robots), PLACEMENT: placement}, losses(world, SUPPORT, placeholders(world)))

    def parts(self, world: World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """The file of each distinct tree, with the bodies of the first tree that has it."""
        bodies = {body.name: body for body in world.bodies}
        found: dict[str, tuple[types.Body, ...]] = {}
        for tree in json.loads(files[PLACEMENT])["trees"]:
            found.setdefault(tree["file"], tuple(bodies[link["name"]] for link in tree["links"]))
        return found

    def read(self, folder: Path) -> UrdfDocument:
        """All robots of a folder, with the files of meshes below it. Raises ValueError, which names the place."""
        from simspec.formats.urdf.reading import read_folder

        return dataclasses.replace(read_folder(folder), meshes=read_meshes(folder, FIELDS))


def _geometries(robots: Robots) -> Iterator[UrdfGeometry]:
    for robot in robots.values():
        for link in robot.links:
            yield from (visual.geometry for visual in link.visuals)
            yield from (collision.geometry for collision in link.collisions)
