"""A world in PhysX, built by calls of SAPIEN's API from ``world.json`` and its sidecar.

Static bodies are static actors; a free body with the massless bodies that are fixed to it is one dynamic actor; all other trees
are articulations (``links.py``). A shape with several laws has a copy with its own material for each. Facts marked *measured*:
SAPIEN 3.0.3, PhysX 5.3.1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from simspec.dialects.physx import PhysxSidecar
from simspec.engines.kit.arrays import checked_singles
from simspec.engines.kit.building import PlacedBody, ShapeUnit, Walk, refuse, surface_numbers
from simspec.engines.physx.cylinders import prism
from simspec.engines.physx.filter import exclusions, kinds
from simspec.engines.physx.homes import Homes
from simspec.engines.physx.links import PhysxLinks
from simspec.engines.physx.units import CONTACT_OFFSET, FASTEST, FASTEST_LINEAR, LEAST, NAME, SCALE, imported, lengths
from simspec.errors import EngineError
from simspec.formats.world import FreeJoint, JsonBody
from simspec.world import frames
from simspec.world.frames import quaternion, vector3
from simspec.world.inertia import principal_axes
from simspec.world.types import Pose

MOST_ITERATIONS = 255
SHAPES = ("sphere", "box", "capsule", "cylinder", "plane", "mesh")
_HALF = math.sqrt(0.5)
AXES: Mapping[str, Pose] = {
    "plane": Pose(quaternion=(_HALF, 0.0, -_HALF, 0.0)),
    "capsule": Pose(quaternion=(_HALF, 0.0, -_HALF, 0.0)),
}
"""Poses of PhysX's shapes, whose axis is x, in those of the world."""


class PhysxBuild:
    """``entities`` and ``actors``: the actor or link that represents each body of ``walk``, or the body that it is a part of;
    ``shapes``: those of each unit; ``links``: those of its articulations."""

    def __init__(self, walk: Walk, sidecar: PhysxSidecar, bare: bool = False):
        """``bare``: without limits and dry friction of joints. Raises EngineError for what PhysX does not support."""
        refuse(walk, NAME, cones=("elliptic",), shapes=SHAPES, moving_planes=False)
        self.sapien, self.walk = imported(), walk
        self.physx = self.sapien.physx
        self.iterations = int(sidecar.settings["iterations"])
        if not 1 <= self.iterations <= MOST_ITERATIONS:
            raise EngineError(NAME, f"takes from 1 to {MOST_ITERATIONS} iterations, not {self.iterations}")
        self.homes = Homes.in_walk(walk)
        self.system = self._system(sidecar.restitution_threshold)
        self.scene = self.sapien.Scene([self.system])
        self.shapes: list[Any] = []
        of_home: dict[int, list[Any]] = {}
        for unit, words in zip(walk.units, self._words(), strict=True):
            shape = self._shape(unit)
            shape.set_collision_groups(list(words))
            self.shapes.append(shape)
            of_home.setdefault(self.homes.of[unit.of.owner.row].row, []).append(shape)
        self.links = PhysxLinks(self, bare)
        self.links.build(of_home)
        self.entities: list[Any] = []
        self.actors: list[Any] = []
        for placed, home in zip(walk.bodies, self.homes.of, strict=True):
            if home.row != placed.row:
                entity, actor = self.entities[home.row], self.actors[home.row]
            elif placed.row in self.links.of:
                entity, actor = self.links.entities[placed.row], self.links.of[placed.row]
            else:
                entity, actor = self._body(placed, of_home.get(placed.row, []))
            self.entities.append(entity)
            self.actors.append(actor)

    def touch(self, row: int, other: int) -> bool:
        """Whether bodies of two homes may touch, as far as the filter of pairs of bodies says."""
        excluded = {frozenset(pair) for pair in self.walk.document.excluded.bodies}
        named: list[list[str]] = [[], []]
        for unit in self.walk.units:
            for names, home in zip(named, (row, other), strict=True):
                if self.homes.of[unit.of.owner.row].row == home:
                    names.append(unit.of.owner.body.name)
        return any(frozenset((a, b)) not in excluded for a in named[0] for b in named[1])

    def _system(self, threshold: float) -> Any:
        """A scene; SAPIEN takes its settings from a configuration for all scenes that are made next."""
        physx, document = self.physx, self.walk.document
        config = physx.PhysxSceneConfig()
        config.gravity = lengths(document.gravity, "gravity")
        timestep = checked_singles(NAME, (document.timestep,), "timestep")[0]
        config.bounce_threshold = lengths((max(threshold, LEAST),), "restitution_threshold")[0]
        config.enable_pcm = False  # it would keep contacts of earlier steps
        config.enable_tgs = False  # with it slow slides stop a quarter too soon, and bodies at rest creep (measured)
        config.enable_ccd = False
        config.enable_enhanced_determinism = True
        config.enable_friction_every_iteration = True
        physx.set_scene_config(config)
        system = physx.PhysxCpuSystem()
        system.timestep = timestep
        return system

    def _words(self) -> list[tuple[int, int, int, int]]:
        """The filter of every unit."""
        try:
            first = kinds(self.walk.kinds, self.walk.meet)
            last = exclusions(self.walk.document.excluded.bodies)
        except ValueError as error:
            raise EngineError(NAME, str(error)) from error
        return [(*first[unit.kind], *last.get(unit.of.owner.body.name, (0, 0))) for unit in self.walk.units]

    def _body(self, placed: PlacedBody, shapes: list[Any]) -> tuple[Any, Any]:
        body, joint = placed.body, placed.body.joint
        actor = self._dynamic(body) if placed.moves else self.physx.PhysxRigidStaticComponent()
        for shape in shapes:
            actor.attach(shape)
        if placed.moves:
            self._set_mass(actor, body)
        pose = placed.pose
        if isinstance(joint, FreeJoint):
            pose = Pose(vector3(joint.position[:3]), frames.normalise(quaternion(joint.position[3:])))
        entity = self.sapien.Entity()
        entity.add_component(actor)
        entity.pose = self.pose(pose, f"pose of {body.name}")
        self.scene.add_entity(entity)
        return entity, actor

    def _dynamic(self, body: JsonBody) -> Any:
        if not body.mass > 0.0:
            raise EngineError(NAME, f"does not support {body.name!r}, which moves and has no mass")
        actor = self.physx.PhysxRigidDynamicComponent()
        actor.linear_damping = actor.angular_damping = 0.0
        actor.max_angular_velocity, actor.max_linear_velocity = FASTEST, FASTEST_LINEAR
        actor.max_depenetration_velocity = SCALE * LEAST
        actor.sleep_threshold = 0.0
        actor.solver_position_iterations, actor.solver_velocity_iterations = self.iterations, 1
        return actor

    def _set_mass(self, actor: Any, body: JsonBody) -> None:
        moments, axes = principal_axes(body.inertia)
        if not min(moments) > 0.0:
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
        actor.mass = checked_singles(NAME, (body.mass,), f"mass of {body.name}")[0]
        actor.inertia = checked_singles(NAME, (SCALE * SCALE * moment for moment in moments), f"inertia of {body.name}")
        actor.cmass_local_pose = self.pose(Pose(body.centre_of_mass, axes), f"centre of mass of {body.name}")

    def _shape(self, unit: ShapeUnit) -> Any:
        shape, physx = unit.of.shape, self.physx
        size = lengths(shape.size, f"size of {shape.name}")
        # PhysX would replace other numbers, with a message on the error output alone
        friction, restitution = surface_numbers(NAME, unit, size)
        material = physx.PhysxMaterial(friction, friction, restitution)
        match shape.kind:
            case "sphere":
                made = physx.PhysxCollisionShapeSphere(*size, material)
            case "box":
                made = physx.PhysxCollisionShapeBox([0.5 * edge for edge in size], material)
            case "capsule":
                made = physx.PhysxCollisionShapeCapsule(size[0], 0.5 * size[1], material)
            case "cylinder":
                made = prism(physx, size[0], size[1], material)
            case "plane":
                made = physx.PhysxCollisionShapePlane(material)
            case _:
                made = self._hull(shape.name, size, material)
        pose = frames.compose(self.homes.of[unit.of.owner.row].pose, shape.pose)
        if shape.kind in AXES:
            pose = frames.compose(pose, AXES[shape.kind])
        made.local_pose = self.pose(pose, f"pose of {shape.name}")
        made.contact_offset, made.rest_offset = SCALE * CONTACT_OFFSET, 0.0
        made.patch_radius = made.min_patch_radius = 0.0
        return made

    def _hull(self, name: str, size: tuple[float, ...], material: Any) -> Any:
        """A convex hull of vertices (1/512 m, flat). PhysX computes the hull again: it drops some vertices silently
        (``approximations.py``), and makes a solid with other vertices of flat ones."""
        vertices = np.array(size, dtype=np.float32).reshape(-1, 3)
        try:
            made = self.physx.PhysxCollisionShapeConvexMesh(vertices, np.ones(3, dtype=np.float32), material)
        except RuntimeError as error:
            raise EngineError(NAME, f"makes no hull of the {len(vertices)} corners of {name!r}: {error}") from error
        wanted, actual = ({tuple(corner) for corner in points.tolist()} for points in (vertices, made.vertices))
        if actual != wanted:
            lost, added = len(wanted - actual), len(actual - wanted)
            raise EngineError(
                NAME, f"leaves {lost} of the {len(vertices)} corners of {name!r} out of its hull, and adds {added}"
            )
        return made

    def pose(self, pose: Pose, name: str) -> Any:
        return self.sapien.Pose(list(lengths(pose.position, name)), list(pose.quaternion))
