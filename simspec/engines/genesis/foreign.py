"""A URDF or MJCF file as Genesis loads it, by ``scene.add_entity(gs.morphs.MJCF(file=...))`` and URDF, with their defaults.

Read from the description of the entity, from which Genesis builds. It is complete except for the armature of joints without
any, and for parameters of contact, both of which Genesis replaces when it builds. Facts marked *measured*: Genesis 1.4.5.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.engines.genesis.modules import NAME, begun
from simspec.engines.kit.foreign import (
    MESH,
    EngineAddition,
    EngineLink,
    Reads,
    bodies_of_links,
    distinct_names,
    support,
)
from simspec.errors import EngineError
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Surface, Vector3

FOREIGN: Final[Mapping[str, Reads]] = {
    "urdf": Reads("scene.add_entity(gs.morphs.URDF(file=file))", (".urdf",), "robot"),
    "mjcf": Reads("scene.add_entity(gs.morphs.MJCF(file=file))", (".xml", ".mjcf"), "mujoco"),
}
LEAST_FRICTION: Final = 0.01
"""Of a contact, whatever its shapes have."""
FOREIGN_ADDITIONS: Final[Mapping[str, EngineAddition]] = {
    "timestep": EngineAddition(None, "default", "10 ms; that of the file is not read: give SimOptions(dt=)"),
    "integrator": EngineAddition(
        None, "default", "damping is implicit under it; RigidOptions(integrator=gs.integrator.Euler) has that, too"
    ),
    "friction_cone": EngineAddition(None, "default", "that of the file is not read: give RigidOptions(friction_cone=)"),
    "contact_time_constant": EngineAddition(
        None, "default", "s, of shapes and limits without solref: give RigidOptions(constraint_timeconst=)"
    ),
    "contact_of_overlapping_links": EngineAddition(
        None,
        "default",
        "shapes of one tree that overlap with all joints at zero never touch, nor do those of neighbours",
    ),
    "raised_frictions": EngineAddition(
        0, "physics", "shapes whose friction is below 0.01, which every contact has at least"
    ),
    "replaced_solrefs": EngineAddition(
        0,
        "physics",
        "shapes and joints with stiffness and damping as solref (negative): they get the default time constant",
    ),
    "bounded_planes": EngineAddition(
        0, "physics", "planes that end at their size, or at 1 km: bodies fall beyond; for the language they have no end"
    ),
    "dropped_pairs": EngineAddition(0, "physics", "<pair>: their laws of contact are not read"),
    "dropped_tendons": EngineAddition(0, "physics", "tendons, with their springs, dampers and limits"),
    "dropped_weights": EngineAddition(0, "physics", "bodies with gravcomp, which have their whole weight"),
    "dropped_ball_limits": EngineAddition(0, "physics", "ball joints, whose limits are not read"),
    "dropped_fluid": EngineAddition(False, "physics", "density and viscosity of the medium are not read"),
    "realigned_bodies": EngineAddition(
        None,
        "default",
        "free bodies whose frames are turned into their principal axes: set_qpos means those; give align=False",
    ),
}
"""Genesis's additions that a file need not state."""
WORLD: Final = "world"
"""Genesis's link for what is fixed to the world."""
KINDS: Final = {"REVOLUTE": "hinge", "PRISMATIC": "slide", "SPHERICAL": "ball", "FREE": "free", "FIXED": "fixed"}
SIZED: Final = {"SPHERE": 1, "BOX": 3, "CAPSULE": 2, "CYLINDER": 2, "ELLIPSOID": 3}
"""Numbers of the size of a shape, which are simspec's."""


class GenesisWarnings(logging.Handler):
    """Genesis's warnings, without colours."""

    def __init__(self, log: list[str]):
        super().__init__(logging.WARNING)
        self._log = log

    def emit(self, record: logging.LogRecord) -> None:
        self._log.append(record.getMessage().replace("~<", "").replace(">~", ""))


def load(file: Path, language: str, log: list[str]) -> ReadBack:
    """Genesis's model of a file. Raises EngineError where it refuses it."""
    gs = begun()
    handler = GenesisWarnings(log)
    gs.logger._logger.addHandler(handler)
    try:
        morph = (gs.morphs.URDF if language == "urdf" else gs.morphs.MJCF)(file=str(file))
        scene = gs.Scene(show_viewer=False)
        entity = scene.add_entity(morph)
        dropped = _dropped(file) if language == "mjcf" else {}
    except (gs.GenesisException, ValueError, AssertionError, KeyError, AttributeError) as error:
        raise EngineError(NAME, f"refuses the file: {error}") from error
    finally:
        gs.logger._logger.removeHandler(handler)
    return GenesisDescription(entity, morph).read_back(scene, dropped)


def _dropped(file: Path) -> dict[str, EngineValue]:
    """How much of a file its description has no place for, by the model that Genesis makes it of."""
    from genesis.utils.mjcf import build_model

    model = build_model(str(file), False)
    balls = model.jnt_type == 1
    return {
        "dropped_pairs": int(model.npair),
        "dropped_tendons": int(model.ntendon),
        "dropped_weights": int(np.count_nonzero(model.body_gravcomp)),
        "dropped_ball_limits": int(np.count_nonzero(balls & (model.jnt_limited != 0))),
        "dropped_fluid": bool(model.opt.density or model.opt.viscosity),
    }


class GenesisDescription:
    """An entity that is not built."""

    def __init__(self, entity: Any, morph: Any):
        self._links = list(entity.desc.links)
        self._armature = float(morph.default_armature or 0.0)
        self._names = distinct_names([link.name for link in self._links])
        self._poses: list[Pose] = []  # of the links in their file's frames, at zero
        self._turned: list[Pose] = []  # of Genesis's frame in the file's
        theirs: list[Pose] = []
        for link in self._links:
            local, offset = _pose(link.pos, link.quat), _pose(link.offset_pos, link.offset_quat)
            above = link.parent_idx
            theirs.append(frames.compose(theirs[above], local) if above >= 0 else local)
            said = frames.compose(self._poses[above], local) if above >= 0 else local
            self._poses.append(frames.compose(said, frames.inverse(offset)))
            self._turned.append(frames.compose(frames.inverse(self._poses[-1]), theirs[-1]))

    def read_back(self, scene: Any, dropped: Mapping[str, EngineValue]) -> ReadBack:
        options, rigid = scene.options.sim, scene.options.rigid
        solids = [geom for link in self._links for geom in link.geoms]
        joints = [joint for link in self._links for joint in link.joints]
        planes = [geom for geom in solids if geom.type.name == "PLANE"]
        inventory: dict[str, EngineValue] = {
            "timestep": float(options.dt),
            "integrator": str(rigid.integrator.name),
            "friction_cone": str(rigid.friction_cone.name),
            "contact_time_constant": float(rigid.constraint_timeconst),
            "contact_of_overlapping_links": bool(rigid.enable_neutral_collision),
            "raised_frictions": sum(float(geom.friction) < LEAST_FRICTION for geom in solids),
            "replaced_solrefs": sum(float(entry.sol_params[0]) < 0.0 for entry in (*solids, *joints)),
            "bounded_planes": len(planes),
            "realigned_bodies": sum(bool(link.is_aligned) for link in self._links),
            **dropped,
        }
        bodies = bodies_of_links([link for index in range(len(self._links)) for link in self._chain(index)])
        named = [body for body in bodies if body.name != WORLD or body.shapes]
        return ReadBack(tuple(named), _vector(options.gravity), float(options.dt), inventory=inventory)

    def _chain(self, index: int) -> Iterator[EngineLink]:
        """A link; with several joints, after links without mass that carry the joints before the last."""
        link, name, pose = self._links[index], self._names[index], self._poses[index]
        above = self._names[link.parent_idx] if link.parent_idx >= 0 else None
        if above == WORLD and not self._links[link.parent_idx].joints:
            above = None
        inertial, shapes = self._inertial(index), tuple(self._shapes(index))
        joints = list(link.joints)
        if not joints:
            yield EngineLink(name, above, pose, inertial, Joint("", "fixed"), shapes=shapes)
            return
        for place, joint in enumerate(joints):
            last = place == len(joints) - 1
            text = name if last else f"{name}/{joint.name}"
            actual = self._joint(joint, len(joints) == 1)
            anchor = (0.0, 0.0, 0.0) if actual.kind == "free" else _vector(joint.pos)
            yield EngineLink(
                text, above, pose, inertial if last else Inertial(0.0), actual, anchor, shapes if last else ()
            )
            above = text

    def _joint(self, joint: Any, alone: bool) -> Joint:
        kind = KINDS[joint.type.name]
        if kind == "free":
            return Joint(joint.name, kind)
        scalar = kind in SCALAR_JOINTS
        armature = float(joint.dofs_armature[0])
        if scalar and alone and armature <= 0.0:
            armature = self._armature  # given when Genesis builds
        axis, start = (0.0, 0.0, 0.0), 0.0
        if scalar:
            axis = _vector((joint.dofs_motion_ang if kind == "hinge" else joint.dofs_motion_vel)[0])
            start = float(np.ravel(joint.init_qpos)[0])
        lower, upper = (np.asarray(joint.dofs_limit, dtype=float)[0] - start).tolist()
        effort = float(np.asarray(joint.dofs_force_range)[0][1])
        return Joint(
            joint.name,
            kind,
            axis=axis,
            position_limits=(lower, upper) if scalar and math.isfinite(upper - lower) else None,
            effort_limit=effort if math.isfinite(effort) else None,
            damping=float(joint.dofs_damping[0]),
            dry_friction=float(joint.dofs_frictionloss[0]),
            armature=armature,
            spring_stiffness=float(joint.dofs_stiffness[0]),
        )

    def _inertial(self, index: int) -> Inertial:
        link, turned = self._links[index], self._turned[index]
        if not link.mass:
            return Inertial(0.0)
        place = _pose(link.inertial_pos, link.inertial_quat)
        place = frames.compose(turned, place)
        t = np.asarray(link.inertia, dtype=float).tolist()
        six = (t[0][0], t[1][1], t[2][2], t[0][1], t[0][2], t[1][2])
        return Inertial(float(link.mass), place.position, frames.rotate_inertia(place.quaternion, six))

    def _shapes(self, index: int) -> Iterator[Shape]:
        link, turned = self._links[index], self._turned[index]
        for geom in link.geoms:
            kind, size = geom.type.name.lower(), tuple(np.ravel(geom.data).tolist()) if geom.data is not None else ()
            if geom.type.name in SIZED:
                size = size[: SIZED[geom.type.name]]
            elif kind == "plane":
                size = ()
            else:
                kind, size = (MESH if kind == "mesh" else "heightfield"), support(np.asarray(geom.mesh.verts))
            pose = frames.compose(turned, _pose(geom.pos, geom.quat))
            surface = Surface(float(geom.friction), float(geom.friction_torsional), float(geom.friction_rolling))
            yield Shape("", kind, size, pose, visual=False, surfaces=(surface,))
        for geom in link.vgeoms:
            points = support(np.asarray(geom.vmesh.verts))
            yield Shape("", MESH, points, frames.compose(turned, _pose(geom.pos, geom.quat)), collision=False)


def _vector(values: Any) -> Vector3:
    x, y, z = np.asarray(values, dtype=float).ravel().tolist()
    return (x + 0.0, y + 0.0, z + 0.0)


def _pose(position: Any, quaternion: Any) -> Pose:
    w, x, y, z = np.asarray(quaternion, dtype=float).ravel().tolist()
    return Pose(_vector(position), frames.normalise((w, x, y, z)))
