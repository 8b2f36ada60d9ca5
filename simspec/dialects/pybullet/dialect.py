"""World to URDF, in the dialect that PyBullet reads: one file for each distinct tree, and a sidecar for the rest.

The dialect: joints of type ``spherical``, geometries ``capsule`` and ``plane``, and a ``contact`` element in a link with its
friction and restitution. What URDF cannot say (where a tree stands, its initial state, springs, armature, collision
filters, solver settings) goes into the sidecar.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.coordinates import Coordinates
from simspec.dialects.kit.joints import armature_of, springs_of
from simspec.dialects.kit.settings import NeededSetting
from simspec.dialects.kit.sidecar import SIDECAR, Sidecar, common_fields
from simspec.dialects.kit.target import Target
from simspec.dialects.pybullet.beside import MOST_LINKS, NO_LINKS, TREE_SIZE, held_beside
from simspec.dialects.pybullet.contact import (
    collision_filter,
    native_contact,
    problems,
    restitution_threshold,
    split,
)
from simspec.dialects.pybullet.raising import OWN_GEOMETRIES, raised
from simspec.dialects.pybullet.sidecar import PybulletSidecar
from simspec.dialects.pybullet.trees import frame_of, instance_of, robot_of
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.passes import recentre_free_roots
from simspec.formats.urdf.document import Document
from simspec.formats.urdf.from_world import KINDS, Files
from simspec.support.declarations import (
    BETWEEN_JOINTS,
    EXACT,
    FRAMES_ALONGSIDE,
    LUMPED,
    Support,
    Table,
    exactly,
    for_each,
    never,
    shape_kinds,
    via_api,
)
from simspec.support.features import COUPLED_CONTACT, Feature
from simspec.world.kinematics import free_rigid, trees
from simspec.world.types import POSITION_SIZE, ReadBack, World

POSITION_NUMBERS = 128
"""Numbers that PyBullet exchanges of one tree's position, 7 of them for its base, fixed or not; beyond that it gives
states of some joints as empty, without a word (measured: 121 hinges work, 122 do not)."""

_SIDECAR = "in the sidecar, set through the engine's API"
_COPIES = (
    "massless links on fixed joints carry further materials and copies of shapes; who meets whom is in the sidecar"
)


class PybulletDialect(Dialect):
    """URDF with PyBullet's extensions."""

    NAME: ClassVar[str] = "pybullet"
    FORMAT: ClassVar[str] = "urdf"
    SIDECAR: ClassVar[type[Sidecar]] = PybulletSidecar
    SETTINGS: ClassVar[Mapping[str, NeededSetting]] = {
        "sleeping": NeededSetting(bool, optional=True),
        "collision_margin": NeededSetting(float),
    }
    SUPPORT: ClassVar[Table] = {
        Feature.JOINT_FIXED: EXACT,
        Feature.JOINT_HINGE: EXACT,
        Feature.JOINT_SLIDE: EXACT,
        Feature.JOINT_BALL: Support(EXACT.level, "as type spherical, PyBullet's extension"),
        Feature.JOINT_FREE: EXACT,
        Feature.LIMIT_POSITION: EXACT,
        Feature.LIMIT_VELOCITY: EXACT,
        Feature.LIMIT_EFFORT: EXACT,
        Feature.DAMPING: EXACT,
        Feature.BALL_DAMPING: EXACT,
        Feature.DRY_FRICTION: EXACT,
        Feature.ARMATURE: via_api(_SIDECAR),
        Feature.SPRING: via_api(_SIDECAR),
        Feature.BALL_SPRING: via_api(_SIDECAR),
        Feature.INITIAL_POSITION: via_api(_SIDECAR),
        Feature.INITIAL_VELOCITY: via_api(_SIDECAR),
        Feature.INERTIA: EXACT,
        Feature.INERTIA_FULL: Support(EXACT.level, "as principal moments with an orientation"),
        Feature.TREE_SIZE: TREE_SIZE,
        Feature.TREE_DEPTH: never(NO_LINKS),
        **shape_kinds("PyBullet", (*KINDS, *OWN_GEOMETRIES, "heightfield")),
        Feature.SHAPE_CAPSULE: Support(EXACT.level, "PyBullet's extension"),
        Feature.SHAPE_PLANE: Support(EXACT.level, "PyBullet's extension"),
        Feature.BALL_ARMATURE: never("PyBullet has no armature: what stands for it is of one axis"),
        Feature.MARGIN_PAIRS: never("PyBullet's contact begins where shapes touch"),
        Feature.SURFACE_VELOCITY: never("simspec writes no surfaces that move by themselves beside URDF"),
        **for_each(via_api(_SIDECAR), Feature.GRAVITY_SCALE, Feature.FREE_DAMPING, Feature.FLUID),
        Feature.FREE_ARMATURE: never("PyBullet has no armature of free bodies"),
        Feature.SHAPE_MARGIN: never("PyBullet's contact begins where shapes touch"),
        Feature.SHAPE_VISUAL: EXACT,
        Feature.SHAPES_PER_BODY: EXACT,
        Feature.MATERIALS_PER_BODY: via_api(_COPIES),
        Feature.FRICTION: EXACT,
        Feature.FRICTION_PAIRS: via_api(_COPIES),
        Feature.RESTITUTION: EXACT,
        Feature.RESTITUTION_PAIRS: via_api(_COPIES),
        Feature.RESTITUTION_THRESHOLD: via_api(_SIDECAR),
        Feature.TORSIONAL_FRICTION: EXACT,
        Feature.ROLLING_FRICTION: EXACT,
        Feature.HARDNESS_COMMON: EXACT,
        Feature.HARDNESS_TIME_CONSTANT: never("PyBullet's springs are in N/m, for whatever mass"),
        Feature.HARDNESS_STIFFNESS: EXACT,
        Feature.HARDNESS_NATIVE: via_api(_SIDECAR),
        Feature.HARDNESS_PAIRS: via_api(_COPIES),
        Feature.PASSING_PAIRS: via_api(_SIDECAR),
        Feature.IMPACT_FRICTION: EXACT,
        **exactly(*COUPLED_CONTACT),
        Feature.CONE_ELLIPTIC: via_api(_SIDECAR),
        Feature.CONE_PYRAMID_INSCRIBED: never("PyBullet has the elliptic cone and the circumscribed pyramid only"),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(_SIDECAR),
        Feature.COLLISION_GROUPS: via_api(_SIDECAR),
        Feature.EXCLUDED_PAIRS: via_api(_SIDECAR),
        Feature.KINEMATIC: EXACT,
        Feature.FORCES: EXACT,
        Feature.TOUCHING_PAIRS: via_api(_SIDECAR),
        Feature.CONTROL: EXACT,
        Feature.CONTROL_NATIVE: EXACT,
        Feature.GRAVITY: via_api(_SIDECAR),
        Feature.TIMESTEP: via_api(_SIDECAR),
        **LUMPED,
        Feature.JOINT_SEVERAL: BETWEEN_JOINTS,
        **for_each(via_api(_SIDECAR), Feature.CONSTRAINT_LOOP, Feature.CONSTRAINT_COUPLING),
        **for_each(via_api(_SIDECAR), Feature.SUM, Feature.SUM_LIMITS, Feature.SUM_DRY_FRICTION),
        Feature.BALL_LIMIT: never("PyBullet's spherical joints have no limits"),
        Feature.FRAME: FRAMES_ALONGSIDE,
    }

    def lower(self, world: World, target: Target) -> Lowered:
        """Robots by file, and the sidecar. Raises UnsupportedError for a tree with too many joints for PyBullet."""
        _check(world, target)
        moved, offsets = recentre_free_roots(world)
        coordinates = Coordinates(world)
        files = Files({SIDECAR})
        instances = []
        beside = held_beside(world)
        for tree in trees(moved).values():
            bodies = tuple(body for body in tree if body.name not in beside)
            parts = {body.name: split(body, target.plan) for body in bodies}
            robot = robot_of(bodies, parts, float(target.settings["collision_margin"]))
            instances.append(instance_of(files.add(robot), bodies, parts, coordinates))
        sidecar = PybulletSidecar(
            **common_fields(self.NAME, self.FORMAT, world, target, offsets),
            gravity=world.physics.gravity,
            timestep=world.physics.timestep,
            instances=tuple(instances),
            springs=springs_of(world),
            armature=armature_of(world),
            collision_filter=collision_filter(world, target.plan),
            restitution_threshold=restitution_threshold(world),
            native_contact=native_contact(world),
            frames=tuple(frame_of(body) for body in moved.bodies if body.name in beside) or None,
            sleepers=tuple(sorted(free_rigid(world))) if target.settings.get("sleeping", False) else None,
        )
        return Lowered(files.robots, sidecar)

    def raise_(self, document: Document, sidecar: PybulletSidecar) -> ReadBack:
        return raised(document, sidecar)


def _check(world: World, target: Target) -> None:
    """Raise UnsupportedError with all that PyBullet cannot have of this world."""
    refused = problems(world)
    beside = held_beside(world)
    for root, tree in trees(world).items():
        bodies = [body for body in tree if body.name not in beside]
        links = sum(len(split(body, target.plan)) for body in bodies)
        if links > MOST_LINKS:
            refused.append(
                Problem(
                    f"PyBullet supports at most {MOST_LINKS} links in one tree",
                    f"bodies.{root}",
                    found=f"{links}, of which {links - len(bodies)} carry further materials or copies of shapes",
                    hint="split the tree, use fewer materials in it, or run without this engine",
                )
            )
        numbers = 7 + sum(POSITION_SIZE[body.joint.kind] for body in bodies if body.joint.kind != "free")
        if numbers > POSITION_NUMBERS:
            refused.append(
                Problem(
                    "PyBullet does not support tree.size: it exchanges at most "
                    f"{POSITION_NUMBERS} position numbers of one tree, 7 of them for the base",
                    f"bodies.{root}",
                    found=f"{numbers}: a hinge or slide counts 1, a ball 4",
                    hint="split the tree, or run without this engine",
                )
            )
    if refused:
        raise UnsupportedError(refused)
