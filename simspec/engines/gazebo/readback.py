"""What gz-physics says it holds, in the world's frames and order: DART's own objects, which it hands out, are asked."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simspec.engines.gazebo.building import NAME, asked, hull_library
from simspec.engines.gazebo.simulation import Simulation
from simspec.engines.kit.building import Unit
from simspec.engines.kit.hulls import vertices_of
from simspec.engines.kit.world_simulation import free_joint, visual_shape
from simspec.errors import EngineError
from simspec.formats.sdf.format import UNLIMITED
from simspec.formats.world.tree import AxisJoint, FixedJoint, FreeJoint, JsonBody, JsonShape
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion, ReadBack, Shape, Surface, Vector3

KINDS = {"SphereShape": "sphere", "BoxShape": "box", "CylinderShape": "cylinder", "CapsuleShape": "capsule"}
"""DART's shape types."""
SIZES = {"sphere": 1, "box": 3, "cylinder": 2, "capsule": 2}
PLANE = 2100.0
"""m: gz-physics makes a box of each plane, with these edges, below it (measured)."""


class HeldBody(NamedTuple):
    """What DART says of a body and its joint; see ``gz_body``."""

    inertial: Inertial
    parent: int
    place: Pose
    in_child: Pose
    axis: Vector3
    position: tuple[float, float]
    velocity: tuple[float, float]
    force: tuple[float, float]
    enforced: bool
    dry_friction: float
    damping: float
    stiffness: float
    rest: float
    actuator: int
    flags: int


class HeldUnit(NamedTuple):
    """What DART says of a shape; see ``gz_unit``."""

    kind: str
    size: tuple[float, ...]
    pose: Pose
    friction: tuple[float, float]
    slip: tuple[float, float]
    restitution: float
    direction: Vector3
    collidable: bool
    in_frame: bool


def held_body(sim: Simulation, row: int) -> HeldBody:
    lib = sim.library
    n = asked(lib.gz_body, (sim.sim, row), lib.gz_body_numbers())
    inertial = Inertial(n[0], _vector(n[1:4]), tuple(n[4:10]))  # type: ignore[arg-type]
    return HeldBody(
        inertial,
        int(n[10]),
        _pose(n[11:23]),
        _pose(n[23:35]),
        _vector(n[35:38]),
        (n[38], n[39]),
        (n[40], n[41]),
        (n[42], n[43]),
        bool(n[44]),
        n[45],
        n[46],
        n[47],
        n[48],
        int(n[49]),
        int(n[50]),
    )


def held_unit(sim: Simulation, number: int) -> HeldUnit:
    lib = sim.library
    n = asked(lib.gz_unit, (sim.sim, number), lib.gz_unit_numbers())
    name = lib.gz_shape_type(sim.sim, number).decode()
    kind, pose = KINDS.get(name), _pose(n[3:15])
    if kind is None:
        raise EngineError(NAME, f"holds a {name}, unknown here")
    if number in sim.hulls and hull_library().hull_is(sim.hulls[number]):
        kind, size = "mesh", vertices_of(hull_library(), sim.hulls[number])
    else:
        size = tuple(n[: SIZES[kind]])
    return HeldUnit(
        kind, size, pose, (n[15], n[16]), (n[17], n[18]), n[19], _vector(n[20:23]), bool(n[23]), bool(n[25])
    )


def own_of(sim: Simulation, row: int) -> list[float]:
    """Damping, stiffness, rest, armature that a joint has by efforts."""
    return asked(sim.library.gz_own, (sim.sim, row), 4)


def read_back(sim: Simulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as gz-physics holds it, and its present state."""
    q, v = sim.get_state()
    units: dict[tuple[int, int], list[int]] = {}
    for unit in sim.walk.units:
        units.setdefault((unit.of.owner.row, unit.of.place), []).append(unit.number)
    bodies = []
    for row, told in enumerate(sim.document.bodies):
        held = held_body(sim, row)
        shapes = tuple(_shape(sim, shape, units.get((row, place), ())) for place, shape in enumerate(told.shapes))
        bodies.append(Body(told.name, told.model, held.inertial, _joint(sim, row, told, held, q, v), shapes))
    world = asked(sim.library.gz_world, (sim.sim,), sim.library.gz_world_numbers())
    return sim.model(bodies, _vector(world[:3]), world[3], unreadable, sim.cone)


def _joint(sim: Simulation, row: int, body: JsonBody, held: HeldBody, q: np.ndarray, v: np.ndarray) -> Joint:
    joint = body.joint
    position, velocity = q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist()
    if isinstance(joint, FreeJoint):
        return free_joint(joint.name, position, velocity)
    parent = sim.names[held.parent] if held.parent >= 0 else None
    found = Joint(joint.name, joint.kind, parent, held.place, position=tuple(position), velocity=tuple(velocity))
    if isinstance(joint, FixedJoint):
        return found
    damping, stiffness, rest, armature = own_of(sim, row)
    implicit = armature / sim.document.timestep
    found = dataclasses.replace(
        found,
        # DART's own damping stands for the armature; what it has beyond that damps
        damping=damping + (held.damping - implicit),
        spring_stiffness=stiffness + held.stiffness,
    )
    if not isinstance(joint, AxisJoint):
        return found
    limited = held.enforced and any(abs(value) < UNLIMITED for value in held.position)
    return dataclasses.replace(
        found,
        axis=held.axis,
        position_limits=held.position if limited else None,
        velocity_limit=joint.velocity_limit,
        effort_limit=held.force[1] if abs(held.force[1]) < UNLIMITED else None,
        dry_friction=held.dry_friction,
        armature=armature,
        spring_rest=rest,
    )


def _shape(sim: Simulation, told: JsonShape, copies: Sequence[int]) -> Shape:
    """A collision shape as DART has it, and what is only seen, which it does not have."""
    seen = visual_shape(told)
    if not copies:
        return seen
    held = [held_unit(sim, number) for number in copies]
    if any((one.kind, one.size, one.pose) != (held[0].kind, held[0].size, held[0].pose) for one in held):
        raise EngineError(NAME, f"holds copies of {told.name!r} that differ")
    kind, size, pose = as_told(held[0])
    surfaces = tuple(Surface(one.friction[0], restitution=one.restitution) for one in held)
    return dataclasses.replace(seen, kind=kind, size=size, pose=pose, collision=True, surfaces=surfaces)


def as_told(held: HeldUnit) -> tuple[str, tuple[float, ...], Pose]:
    """Kind, size and pose as the world has them: a plane is the top of a box of its size."""
    if held.kind == "box" and held.size == (PLANE, PLANE, PLANE):
        return "plane", (), frames.compose(held.pose, Pose((0.0, 0.0, 0.5 * PLANE)))
    return held.kind, held.size, held.pose


def unit_name(unit: Unit) -> str:
    """What a copy of a shape is called: by the shape's name and the layer."""
    return f"{unit.of.shape.name}.{unit.copy.layer}"


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return (x + 0.0, y + 0.0, z + 0.0)


def _pose(values: Sequence[float]) -> Pose:
    turn: Quaternion = frames.from_matrix((tuple(values[3:6]), tuple(values[6:9]), tuple(values[9:12])))  # type: ignore[arg-type]
    return Pose(_vector(values[:3]), turn)
