"""The model as gz-physics stores it, in the world's frames and order, read from its DART objects."""

from __future__ import annotations

import ctypes
import dataclasses
import operator
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simspec.contact import ContactPlan, parts
from simspec.engines.gazebo.building import NAME, hull_library, query
from simspec.engines.gazebo.simulation import GazeboSimulation
from simspec.engines.kit.building import ShapeUnit
from simspec.engines.kit.hulls import vertices_of
from simspec.engines.kit.inventory import FilterCarrier, Items, expected_separate, named_set, sidecar_labels
from simspec.engines.kit.world_simulation import free_joint, visual_shape
from simspec.errors import EngineError
from simspec.formats.sdf.format import UNLIMITED
from simspec.formats.world import AxisJoint, FixedJoint, FreeJoint, JsonBody, JsonShape
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA, lumped
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import (
    Body,
    EngineValue,
    Inertial,
    Joint,
    Pose,
    Quaternion,
    ReadBack,
    Shape,
    Surface,
    Vector3,
    World,
)

KINDS = {"SphereShape": "sphere", "BoxShape": "box", "CylinderShape": "cylinder", "CapsuleShape": "capsule"}
"""DART's shape types."""
SIZES = {"sphere": 1, "box": 3, "cylinder": 2, "capsule": 2}
PLANE = 2100.0
"""m: gz-physics makes a box of each plane, with these edges, below it (measured)."""


class ReadBody(NamedTuple):
    """A body and its joint in DART; see ``gz_body``."""

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


class ReadUnit(NamedTuple):
    """A shape in DART; see ``gz_unit``."""

    kind: str
    size: tuple[float, ...]
    pose: Pose
    friction: tuple[float, float]
    slip: tuple[float, float]
    restitution: float
    direction: Vector3
    collidable: bool
    in_frame: bool


def read_body(sim: GazeboSimulation, row: int) -> ReadBody:
    lib = sim.library
    n = query(lib.gz_body, (sim.sim, row), lib.gz_body_numbers())
    inertial = Inertial(n[0], _vector(n[1:4]), tuple(n[4:10]))  # type: ignore[arg-type]
    return ReadBody(
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


def read_unit(sim: GazeboSimulation, number: int) -> ReadUnit:
    lib = sim.library
    n = query(lib.gz_unit, (sim.sim, number), lib.gz_unit_numbers())
    name = lib.gz_shape_type(sim.sim, number).decode()
    kind, pose = KINDS.get(name), _pose(n[3:15])
    if kind is None:
        raise EngineError(NAME, f"holds a {name}, unknown here")
    if number in sim.hulls and hull_library().hull_is(sim.hulls[number]):
        kind, size = "mesh", vertices_of(hull_library(), sim.hulls[number])
    else:
        size = tuple(n[: SIZES[kind]])
    return ReadUnit(
        kind, size, pose, (n[15], n[16]), (n[17], n[18]), n[19], _vector(n[20:23]), bool(n[23]), bool(n[25])
    )


def effort_parts_of(sim: GazeboSimulation, row: int) -> list[float]:
    """Damping, stiffness, rest, armature that a joint has by efforts."""
    return query(sim.library.gz_joint_efforts, (sim.sim, row), 4)


def read_back(sim: GazeboSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as gz-physics holds it, and its present state."""
    q, v = sim.get_state()
    units: dict[tuple[int, int], list[int]] = {}
    for unit in sim.walk.units:
        units.setdefault((unit.of.owner.row, unit.of.place), []).append(unit.number)
    bodies = []
    for row, body in enumerate(sim.document.bodies):
        actual = read_body(sim, row)
        shapes = tuple(_shape(sim, shape, units.get((row, place), ())) for place, shape in enumerate(body.shapes))
        bodies.append(Body(body.name, body.model, actual.inertial, _joint(sim, row, body, actual, q, v), shapes))
    world = query(sim.library.gz_world, (sim.sim,), sim.library.gz_world_numbers())
    return sim.model(bodies, _vector(world[:3]), world[3], unreadable, sim.cone)


def _joint(sim: GazeboSimulation, row: int, body: JsonBody, data: ReadBody, q: np.ndarray, v: np.ndarray) -> Joint:
    joint = body.joint
    position, velocity = q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist()
    if isinstance(joint, FreeJoint):
        return free_joint(joint.name, position, velocity)
    parent = sim.names[data.parent] if data.parent >= 0 else None
    found = Joint(joint.name, joint.kind, parent, data.place, position=tuple(position), velocity=tuple(velocity))
    if isinstance(joint, FixedJoint):
        return found
    damping, stiffness, rest, armature = effort_parts_of(sim, row)
    implicit = armature / sim.document.timestep
    found = dataclasses.replace(
        found,
        # DART's damping stands for the armature; the rest of it damps
        damping=damping + (data.damping - implicit),
        spring_stiffness=stiffness + data.stiffness,
    )
    if not isinstance(joint, AxisJoint):
        return found
    limited = data.enforced and any(abs(value) < UNLIMITED for value in data.position)
    return dataclasses.replace(
        found,
        axis=data.axis,
        position_limits=data.position if limited else None,
        velocity_limit=joint.velocity_limit,
        effort_limit=data.force[1] if abs(data.force[1]) < UNLIMITED else None,
        dry_friction=data.dry_friction,
        armature=armature,
        spring_rest=rest,
    )


def _shape(sim: GazeboSimulation, shape: JsonShape, copies: Sequence[int]) -> Shape:
    """A collision shape as DART has it, and what is only seen, which it does not have."""
    seen = visual_shape(shape)
    if not copies:
        return seen
    actual = [read_unit(sim, number) for number in copies]
    if any(
        (entry.kind, entry.size, entry.pose) != (actual[0].kind, actual[0].size, actual[0].pose) for entry in actual
    ):
        raise EngineError(NAME, f"holds copies of {shape.name!r} that differ")
    kind, size, pose = as_written(actual[0])
    surfaces = tuple(Surface(entry.friction[0], restitution=entry.restitution) for entry in actual)
    return dataclasses.replace(seen, kind=kind, size=size, pose=pose, collision=True, surfaces=surfaces)


def as_written(data: ReadUnit) -> tuple[str, tuple[float, ...], Pose]:
    """Kind, size and pose as the world has them: a plane is the top of a box of its size."""
    if data.kind == "box" and data.size == (PLANE, PLANE, PLANE):
        return "plane", (), frames.compose(data.pose, Pose((0.0, 0.0, 0.5 * PLANE)))
    return data.kind, data.size, data.pose


def unit_name(unit: ShapeUnit) -> str:
    """The name of a copy of a shape: the shape's name and the layer."""
    return f"{unit.of.shape.name}.{unit.copy.layer}"


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return (x + 0.0, y + 0.0, z + 0.0)


def _pose(values: Sequence[float]) -> Pose:
    turn: Quaternion = frames.from_matrix((tuple(values[3:6]), tuple(values[6:9]), tuple(values[9:12])))  # type: ignore[arg-type]
    return Pose(_vector(values[:3]), turn)


# The values that gz-physics and its DART store besides the fields of the read-back, and that can act, and what they must be.
#
# ``expected`` runs without gz-physics.

BIG = 1e308
"""In place of infinity, which JSON does not have."""
FIT = 1e-12
"""The tolerance of text, proof level L0."""
SOLVERS = {"dantzig": "DantzigBoxedLcpSolver in passes", "pgs": "PgsBoxedLcpSolver"}
"""DART's names of its solvers, and the name of the part in C++ that runs Dantzig's in passes."""
Settings = Mapping[str, bool | int | float | str]


WORLD: Mapping[str, float | None] = {
    "error_reduction": 0.01,
    "error_reduction_speed": 1e9,
    "error_allowance": 0.0,
    "force_mixing": 1e-5,
    "most_contacts": 1e6,
    "contact_enabled": 1.0,
    "filter": 1.0,
    "shapes": None,
    "skeletons": None,
    "links": None,
}
"""The numbers of ``gz_world`` after gravity and timestep, in its order; None: by the world."""


class GazeboPlacedBody(NamedTuple):
    """A body of the world, with the mass that is written for it."""

    body: Body
    mass: Inertial
    timestep: float

    def limits(self, limit: float | None) -> tuple[float, float]:
        """Of a joint's one coordinate, or of the first; none of a fixed joint."""
        if limit is not None:
            return (-limit, limit)
        return (0.0, 0.0) if self.body.joint.kind == "fixed" else (-BIG, BIG)


def finite(values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(max(-BIG, min(BIG, float(value))) for value in values)


def near(place: Pose) -> bool:
    """Whether a joint is at its child's frame, except for the round-off of SDF's frames."""
    return max(map(abs, (*place.position, *place.quaternion[1:]))) < FIT


BODY = Items[ReadBody, GazeboPlacedBody](
    {
        "at_child": (lambda entry: near(entry.in_child), True),
        "actuator": (lambda entry: entry.actuator, 0),
        "flags": (lambda entry: entry.flags, 3),
        "enforced": (lambda entry: entry.enforced, lambda placed: placed.body.joint.kind in SCALAR_JOINTS),
        "velocity_limits": (lambda entry: finite(entry.velocity), lambda placed: placed.limits(None)),
        "force_limits": (
            lambda entry: finite(entry.force),
            lambda placed: placed.limits(placed.body.joint.effort_limit),
        ),
        "damping": (lambda entry: entry.damping, lambda placed: placed.body.joint.armature / placed.timestep),
        "spring": (lambda entry: entry.stiffness, 0.0),
        "rest": (lambda entry: entry.rest, 0.0),
    }
)
MASS = Items[Inertial, Inertial].named(
    getattr, {name: operator.attrgetter(name) for name in ("mass", "centre_of_mass", "inertia")}
)
UNIT = Items[ReadUnit, Surface](
    {
        "second_friction": (lambda entry: entry.friction[1], lambda surface: surface.friction or 0.0),
        "restitution": (lambda entry: entry.restitution, lambda surface: surface.restitution or 0.0),
        "slip": (lambda entry: entry.slip, (-1.0, -1.0)),  # none
        "direction": (lambda entry: (*entry.direction, entry.in_frame), (0.0, 0.0, 0.0, False)),
        "collidable": (lambda entry: entry.collidable, True),
    }
)


def inventory(sim: GazeboSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    lib = sim.library
    found: dict[str, EngineValue] = dict(sidecar_labels(sim.sidecar))
    numbers = query(lib.gz_world, (sim.sim,), lib.gz_world_numbers())
    found |= {f"world.{name}": value for name, value in zip(WORLD, numbers[4:], strict=True)}
    found["world.detector"] = lib.gz_detector(sim.sim).decode()
    found["world.solver"] = lib.gz_solver(sim.sim).decode()
    for number in range(lib.gz_tree_count(sim.sim)):
        mobile, timestep, *gravity = query(lib.gz_skeleton, (sim.sim, number), 5)
        found |= _tree(number, bool(mobile), timestep, tuple(gravity))
    for row, body in enumerate(sim.document.bodies):
        at, stored = f"body.{body.name}", read_body(sim, row)
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        found |= BODY.read(stored, at)
        if body.mass == 0.0:
            found[f"{at}.centre_of_mass"] = stored.inertial.centre_of_mass
        if not sim.walk.bodies[row].moves:  # the read-back compares no mass of massless static bodies
            found |= MASS.read(stored.inertial, at)
    for unit in sim.walk.units:
        at = f"unit.{unit_name(unit)}"
        found |= UNIT.read(read_unit(sim, unit.number), at) | {f"{at}.of": unit.of.owner.body.name}
    return found | _filter(sim)


def _tree(number: int, mobile: bool, timestep: float, gravity: tuple[float, ...]) -> dict[str, EngineValue]:
    at = f"tree.{number}"
    return {f"{at}.mobile": mobile, f"{at}.timestep": timestep, f"{at}.gravity": gravity}


def _filter(sim: GazeboSimulation) -> dict[str, EngineValue]:
    """For every copy of a shape the others that it does not touch, itself not counted."""
    names = [unit_name(unit) for unit in sim.walk.units]
    excluded = np.zeros((len(names), len(names)), dtype=np.uint8)
    sim.library.gz_excluded(sim.sim, excluded.ctypes.data_as(ctypes.POINTER(ctypes.c_ubyte)))
    np.fill_diagonal(excluded, 0)
    return {
        f"apart.{name}": named_set(names[other] for other in np.nonzero(row)[0].tolist())
        for name, row in zip(names, excluded, strict=True)
    }


def neutral(sim: GazeboSimulation) -> dict[str, EngineValue]:
    """None: everything is written."""
    return {}


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``."""
    units = [(body, part, shape) for body in world.bodies for part in parts(body, plan) for shape in part.shapes]
    carriers = [
        FilterCarrier(f"{shape.name}.{part.layer}", body.name, part.material, part.layer) for body, part, shape in units
    ]
    counts = {"shapes": len(units), "skeletons": len(trees(world)), "links": len(world.bodies)}
    found: dict[str, EngineValue] = {
        f"world.{name}": float(counts[name]) if value is None else value for name, value in WORLD.items()
    }
    found |= {"world.detector": "ode", "world.solver": SOLVERS[str(settings["contact_solver"])]}
    for number in range(len(trees(world))):
        found |= _tree(number, True, world.physics.timestep, world.physics.gravity)
    groups, masses = rigid_groups(world), lumped(world)
    for body in world.bodies:
        at, mass = f"body.{body.name}", masses.get(body.name, body.inertial)
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        found |= BODY.expect(GazeboPlacedBody(body, mass, world.physics.timestep), at)
        if mass.mass == 0.0:
            found[f"{at}.centre_of_mass"] = (0.0, 0.0, 0.0)
        if groups[body.name] == "world":
            found |= MASS.expect(mass if mass.mass else NO_INERTIA, at)  # as massless fixed bodies are written
    for carrier, (_, part, _) in zip(carriers, units, strict=True):
        found |= UNIT.expect(part.surface, f"unit.{carrier.name}") | {f"unit.{carrier.name}.of": carrier.body}
    return found | expected_separate(world, plan, carriers)
