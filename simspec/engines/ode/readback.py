"""The model that ODE stores, in the world's frames and order.

Masses, gravity and shapes are read from ODE, laws from the table from which its contacts are made. Places, damping and
coordinates of joints are read from the part in C, which lays the bodies: ODE's own joints, made at the joints' zero, must
agree, as must everything else that ODE stores and that can act (:func:`inventory`).
"""

from __future__ import annotations

import ctypes
import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from simspec.contact import ContactPlan
from simspec.engines.kit.building import inertial_of, range_of, vector
from simspec.engines.kit.hulls import vertices_of
from simspec.engines.kit.inventory import (
    NEUTRAL,
    FilterCarrier,
    Items,
    below,
    excluded_carriers,
    expected_separate,
    finite,
    sidecar_labels,
)
from simspec.engines.kit.world_simulation import free_joint, pose_of_row, visual_shape
from simspec.engines.ode.simulation import (
    CONES,
    ERROR_REDUCTION,
    SOLVERS,
    Mass,
    Numbers,
    OdeSimulation,
    numbers,
    quaternions,
)
from simspec.formats.world import AxisJoint, FixedJoint, FreeJoint, JsonBody, JsonShape, parent_of
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.inertia import NO_INERTIA, lumped_inertial
from simspec.world.kinematics import rigid_groups
from simspec.world.types import (
    Body,
    EngineValue,
    Inertial,
    Joint,
    PairContact,
    Pose,
    Quaternion,
    ReadBack,
    Shape,
    Surface,
    Vector3,
    World,
)

CLASSES = {0: "sphere", 1: "box", 2: "capsule", 3: "cylinder", 4: "plane"}
"""ODE's numbers of classes of geoms."""
BODY_VALUES = 25
"""Numbers of a body in the part in C."""
LAW = 8


def queried(function: Any, of: Any, count: int) -> list[float]:
    """Numbers that one of ODE's functions writes."""
    values = (ctypes.c_double * max(4, count))()
    function(of, ctypes.cast(values, Numbers))
    return list(values[:count])


def read_back(sim: OdeSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as ODE stores it, and its present state."""
    lib = sim.library
    q, v = sim.get_state()
    solid = {(shape.owner.row, shape.place): shape.number for shape in sim.built.walk.shapes}
    bodies = []
    for row, body in enumerate(sim.document.bodies):
        shapes = tuple(
            _shape(sim, row, solid[row, place], shape) if (row, place) in solid else visual_shape(shape)
            for place, shape in enumerate(body.shapes)
        )
        values = BodyValues.of(sim, row)
        joint = _joint(body, values, q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist())
        bodies.append(Body(body.name, body.model, _inertial(sim, row, values.centre), joint, shapes))
    gravity = vector(queried(lib.dWorldGetGravity, lib.sim_world(sim.sim), 3))
    timestep, cone = float(lib.sim_timestep(sim.sim)), CONES[lib.sim_cone(sim.sim)]
    laws = tuple(
        PairContact(first, second, sliding, bounce, torsional, rolling, threshold)
        for first, second, (sliding, bounce, threshold, rolling, torsional, *_) in read_laws(sim)
    )
    return sim.model(bodies, gravity, timestep, unreadable, cone, laws)


class BodyValues(NamedTuple):
    """The values that the part in C stores of a body and its joint."""

    origin: Pose
    axis: Vector3
    centre: Vector3
    damping: float
    stiffness: float
    rest: float
    dry_friction: float
    armature: float
    lower: float
    upper: float

    @classmethod
    def of(cls, sim: OdeSimulation, row: int) -> BodyValues:
        n = queried(lambda of, values: sim.library.sim_body_values(of, row, values), sim.sim, BODY_VALUES)
        (turn,) = quaternions(np.array(n[3:12]).reshape(1, 3, 3)).tolist()
        return cls(Pose(tuple(n[:3]), tuple(turn)), vector(n[12:15]), tuple(n[15:18]), *n[18:])  # type: ignore[arg-type]


def _inertial(sim: OdeSimulation, row: int, centre: Vector3) -> Inertial:
    """The mass properties of a body; the document's of static ones, for which ODE has no body."""
    body = sim.library.sim_body_of(sim.sim, row)
    if not body:
        given = sim.document.bodies[row]
        static = sim.library.sim_carrier(sim.sim, row) < 0
        return Inertial(given.mass, given.centre_of_mass, given.inertia) if static else NO_INERTIA
    mass = Mass()
    sim.library.dBodyGetMass(body, ctypes.byref(mass))
    offset = np.array(centre) + mass.centre[:3]
    return inertial_of(mass.mass, offset, np.reshape(mass.inertia, (3, 4)))


def _joint(body: JsonBody, values: BodyValues, position: list[float], velocity: list[float]) -> Joint:
    joint = body.joint
    if isinstance(joint, FreeJoint):
        return free_joint(joint.name, position, velocity)
    found = Joint(
        joint.name,
        joint.kind,
        parent_of(joint),
        values.origin,
        position=tuple(position),
        velocity=tuple(velocity),
    )
    if isinstance(joint, FixedJoint):
        return found
    found = dataclasses.replace(found, damping=values.damping, spring_stiffness=values.stiffness)
    if not isinstance(joint, AxisJoint):
        return found
    return dataclasses.replace(
        found,
        axis=values.axis,
        position_limits=range_of(values.lower, values.upper),
        velocity_limit=joint.velocity_limit,
        effort_limit=joint.effort_limit,
        dry_friction=values.dry_friction,
        armature=values.armature,
        spring_rest=values.rest,
    )


def _shape(sim: OdeSimulation, row: int, number: int, shape: JsonShape) -> Shape:
    """A collision shape as ODE stores it, with the visual part of the file."""
    geom = sim.library.sim_geom(sim.sim, number)
    kind = "mesh" if sim.library.hull_is(geom) else CLASSES[sim.library.dGeomGetClass(geom)]
    return dataclasses.replace(
        visual_shape(shape),
        kind=kind,
        size=_size(sim.library, geom, kind),
        pose=frames.compose(frames.inverse(pose_of_row(sim.file_frames()[0][row])), _pose(sim.library, geom, kind)),
        collision=True,
        surfaces=(Surface(0.0, 0.0, 0.0, 0.0),),
    )


def _size(lib: Any, geom: Any, kind: str) -> tuple[float, ...]:
    """The size of a geom as the world has it."""
    if kind == "sphere":
        return (float(lib.dGeomSphereGetRadius(geom)),)
    if kind == "box":
        return tuple(queried(lib.dGeomBoxGetLengths, geom, 3))
    if kind == "plane":
        return ()
    if kind == "mesh":
        return vertices_of(lib, geom)
    radius, length = numbers((0.0,)), numbers((0.0,))
    (lib.dGeomCapsuleGetParams if kind == "capsule" else lib.dGeomCylinderGetParams)(geom, radius, length)
    return radius[0], length[0]


def _pose(lib: Any, geom: Any, kind: str) -> Pose:
    """The pose of a geom in the world."""
    if kind == "plane":
        a, b, c, d = queried(lib.dGeomPlaneGetParams, geom, 4)
        return Pose((a * d, b * d, c * d), _turn_to((a, b, c)))
    turn = frames.normalise(tuple(queried(lib.dGeomGetQuaternion, geom, 4)))  # type: ignore[arg-type]
    return Pose(tuple(lib.dGeomGetPosition(geom)[:3]), turn)


def _turn_to(normal: Vector3) -> Quaternion:
    """A turn that brings z to a normal."""
    x, y, z = normal
    if z < -0.5:  # by way of x, half a turn about which brings z to −z
        return frames.multiply((0.0, 1.0, 0.0, 0.0), _turn_to((x, -y, -z)))
    return frames.normalise((1.0 + z, -y, x, 0.0))


def read_laws(sim: OdeSimulation) -> Iterator[tuple[str, str, list[float]]]:
    """The laws of materials that touch: friction, restitution, threshold, rolling, torsional, soft_erp, soft_cfm, touches."""
    for first, second in itertools.combinations_with_replacement(enumerate(sim.built.materials), 2):
        law = queried(lambda of, v: sim.library.sim_law_values(of, first[0], second[0], v), sim.sim, LAW)  # noqa: B023
        if law[7]:
            yield first[1], second[1], law


# The inventory: values that ODE stores besides the fields of the read-back, and what they must be (``expected``, which runs
# without ODE).

JOINT_TYPES = {1: "ball", 2: "hinge", 3: "slider", 5: "universal", 6: "hinge2", 7: "fixed", 9: "amotor", 10: "lmotor"}
"""ODE's numbers of types of joints."""
ROWS = ("joint", "rotor", "rub", "stop")
"""The joints of a body, as the part in C numbers them."""
TYPE_OF_KIND = {"hinge": "hinge", "slide": "slider", "ball": "ball", "fixed": "fixed"}
MOTOR_TYPES = {"hinge": "amotor", "slide": "lmotor"}
FIT = 1e-9
"""How far ODE's joints may be from the coordinates that bodies are laid by (rad, m): the proof's tolerance."""

Settings = Mapping[str, bool | int | float | str]


class OdeObject(NamedTuple):
    """One of ODE's objects, of the body at ``row``."""

    sim: OdeSimulation
    row: int
    handle: Any

    def get(self, function: str, *arguments: int) -> Any:
        """The value of one of ODE's functions."""
        return getattr(self.sim.library, function)(self.handle, *arguments)


class OdeExpectedBody(NamedTuple):
    """A body of the world, ODE's number of its joints, and whether it moves by ODE's steps alone."""

    body: Body
    joints: int
    native: bool


def _native(settings: Settings) -> bool:
    return bool(settings.get("native_motion", False))


WORLD = Items[tuple[Any, Any], Settings].named(
    lambda of, name: finite(getattr(of[0], f"dWorldGet{name}")(of[1])),
    {
        **dict.fromkeys(("ERP", "QuickStepW", "ContactMaxCorrectingVel", "ContactSurfaceLayer"), NEUTRAL),
        **dict.fromkeys(("LinearDamping", "AngularDamping", "MaxAngularSpeed"), NEUTRAL),
        **dict.fromkeys(("CFM", "AutoDisableFlag"), 0.0),
        "QuickStepNumIterations": lambda settings: float(settings["iterations"]),
    },
)
"""Of ODE's library and one of its worlds, as ``world.NAME``, by the ends of the names of ODE's functions."""

SIMULATION = Items[OdeSimulation, tuple[World, Settings]](
    {
        "solver": (lambda sim: SOLVERS[sim.library.sim_quick(sim.sim)], lambda of: of[1]["solver"]),
        "laid before every step": (lambda sim: not sim.library.sim_native(sim.sim), lambda of: not _native(of[1])),
        "count.geoms": (
            lambda sim: int(sim.library.dSpaceGetNumGeoms(sim.library.sim_space(sim.sim))),
            lambda of: sum(len(solid_shapes(body)) for body in of[0].bodies),
        ),
    }
)
LABELS = Items[tuple[Any, bool], tuple[Body, bool]](
    {
        "model": (lambda of: of[0].model, lambda of: of[0].model),
        "held": (lambda of: of[1], lambda of: of[1]),
        "joint": (lambda of: of[0].joint.name, lambda of: of[0].joint.name),
        "seen": (
            lambda of: ", ".join(shape.name for shape in of[0].shapes if not shape.copies),
            lambda of: ", ".join(shape.name for shape in of[0].shapes if not shape.collision),
        ),
    }
)
"""Of a body of the document, or of the world, and whether ODE has a body for it."""

BODY = Items[OdeObject, OdeExpectedBody].named(
    lambda body, name: finite(body.get(f"dBodyGet{name}")),
    {
        "FiniteRotationMode": lambda of: float(not of.native),
        "GravityMode": 1.0,
        **dict.fromkeys(("AutoDisableFlag", "LinearDamping", "AngularDamping"), 0.0),
        "MaxAngularSpeed": 1e308,
        "NumJoints": lambda of: float(of.joints),
    },
) | Items[OdeObject, OdeExpectedBody](
    {
        # ODE returns the bit of a flag
        "GyroscopicMode": (lambda body: float(bool(body.get("dBodyGetGyroscopicMode"))), lambda of: float(of.native)),
        "enabled": (lambda body: bool(body.get("dBodyIsEnabled")), True),
        "kinematic": (lambda body: bool(body.get("dBodyIsKinematic")), False),
    }
)
JOINT = Items[OdeObject, str](
    {
        "type": (lambda joint: JOINT_TYPES.get(joint.get("dJointGetType"), "unknown"), lambda kind: kind),
        "enabled": (lambda joint: bool(joint.get("dJointIsEnabled")), True),
        "of": (lambda joint: joint.get("dJointGetBody", 0) == _body_at(joint.sim, joint.row), True),
    }
)
"""As ``body.NAME.ROW.NAME``, from the name of ODE's type."""


def _moves_with(geom: OdeObject) -> bool:
    carrier = geom.sim.library.sim_carrier(geom.sim.sim, geom.row)
    return bool(geom.get("dGeomGetBody") == (None if carrier < 0 else _body_at(geom.sim, carrier)))


SHAPE = Items[OdeObject, Body](
    {
        "of": (lambda geom: geom.sim.names[geom.row], lambda body: body.name),
        "enabled": (lambda geom: bool(geom.get("dGeomIsEnabled")), True),
        "bits": (lambda geom: bool(geom.get("dGeomGetCategoryBits") & geom.get("dGeomGetCollideBits")), True),
        "moves_with": (_moves_with, True),
    }
)


def _body_at(sim: OdeSimulation, row: int) -> Any:
    return sim.library.sim_body_of(sim.sim, row)


def inventory(sim: OdeSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    lib = sim.library
    found = WORLD.read((lib, lib.sim_world(sim.sim)), "world") | sidecar_labels(sim.sidecar) | SIMULATION.read(sim)
    for row, body in enumerate(sim.document.bodies):
        handle, at = _body_at(sim, row), f"body.{body.name}"
        found |= LABELS.read((body, bool(handle)), at)
        if handle:
            found |= BODY.read(OdeObject(sim, row, handle), at)
        for number, name in enumerate(ROWS):
            if joint := lib.sim_joint(sim.sim, row, number):
                found |= JOINT.read(OdeObject(sim, row, joint), f"{at}.{name}")
        if body.joint.kind in SCALAR_JOINTS and (joint := lib.sim_joint(sim.sim, row, 0)):
            found[f"{at}.joint.fits"] = _fits(sim, row, joint)
    for number, (row, name) in enumerate(sim.units()):
        found |= SHAPE.read(OdeObject(sim, row, lib.sim_geom(sim.sim, number)), f"shape.{name}")
    for first, second, law in read_laws(sim):
        found[f"law.{first}.{second}.softness"] = tuple(law[5:7])
    names = [f"{name}.0" for _, name in sim.units()]  # of carriers, all in one layer
    return found | excluded_carriers(names, lambda index, other: bool(lib.sim_excluded(sim.sim, index, other)))


def neutral(sim: OdeSimulation) -> dict[str, EngineValue]:
    """The values of an empty world."""
    world = sim.library.dWorldCreate()
    try:
        return WORLD.read((sim.library, world), "world")
    finally:
        sim.library.dWorldDestroy(world)


def _fits(sim: OdeSimulation, row: int, joint: Any) -> bool:
    """Whether ODE's joint has the axis and position of the coordinates by which bodies are laid."""
    lib, hinge = sim.library, sim.document.bodies[row].joint.kind == "hinge"
    axis = queried(lib.dJointGetHingeAxis if hinge else lib.dJointGetSliderAxis, joint, 3)
    position = float(sim.get_state()[0][sim.q_places[row]][0])
    off = float((lib.dJointGetHingeAngle if hinge else lib.dJointGetSliderPosition)(joint)) - position
    if hinge:
        off = math.remainder(off, 2.0 * math.pi)
    turn = tuple(sim.file_frames()[0][row, 3:].tolist())
    local = frames.rotate(frames.conjugate(turn), tuple(axis))  # type: ignore[arg-type]
    given = sim.document.bodies[row].joint.axis  # type: ignore[union-attr]
    deviation = max(abs(a - b) for a, b in zip(local, given, strict=True))
    return abs(off) <= FIT * max(1.0, abs(position)) and deviation <= FIT


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are ODE's defaults."""
    native = _native(settings)
    found = WORLD.expect(settings, "world", below("world", neutral)) | SIMULATION.expect((world, settings))
    if not native:
        found["world.ERP"] = 1e-300
    movers = _movers(world)
    joints = _joints(world, movers)
    carriers = []
    for body in world.bodies:
        at, stored = f"body.{body.name}", movers[body.name] == body.name
        found |= LABELS.expect((body, stored), at)
        if stored:
            found |= BODY.expect(OdeExpectedBody(body, joints[body.name], native), at)
            for name, kind in _rows(body).items():
                found |= JOINT.expect(kind, f"{at}.{name}")
            if body.joint.kind in MOTOR_TYPES:
                found[f"{at}.joint.fits"] = True
        for shape in solid_shapes(body):
            carriers.append(FilterCarrier(f"{shape.name}.0", body.name, shape.material, 0))
            found |= SHAPE.expect(body, f"shape.{shape.name}")
    used = {carrier.material for carrier in carriers}
    for pair in meeting_laws(world):
        if used.issuperset(pair):
            found[f"law.{'.'.join(pair)}.softness"] = (ERROR_REDUCTION, float(settings["softness"]))
    return found | expected_separate(world, plan, carriers)


def _rows(body: Body) -> dict[str, str]:
    """The types of the joints that ODE has for one of the world, by ROWS."""
    joint = body.joint
    rows = {} if joint.kind == "free" else {"joint": TYPE_OF_KIND[joint.kind]}
    if joint.kind in MOTOR_TYPES:
        motor = MOTOR_TYPES[joint.kind]
        rows |= {"rotor": motor} if joint.armature else {}
        rows |= {"rub": motor} if joint.dry_friction else {}
        if joint.position_limits is not None:
            rows["stop"] = "amotor" if joint.kind == "hinge" else "slider"
    return rows


def _movers(world: World) -> dict[str, str | None]:
    """By body the name of the one that ODE has a body for and that carries it; None for static bodies."""
    groups = rigid_groups(world)
    movers: dict[str, str | None] = {}
    for body in world.bodies:
        if groups[body.name] == "world":
            movers[body.name] = None
        else:
            massive = lumped_inertial(world, body).mass > 0.0
            movers[body.name] = body.name if massive else movers[body.joint.parent or ""]
    return movers


def _joints(world: World, movers: Mapping[str, str | None]) -> Counter[str]:
    """The number of ODE's joints on each of its bodies. The stop of a slide is its slider."""
    count: Counter[str] = Counter()
    for body in world.bodies:
        above = movers.get(body.joint.parent or "")
        if movers[body.name] != body.name or (body.joint.kind == "fixed" and above is None):
            continue
        rows = set(_rows(body)) - ({"stop"} if body.joint.kind == "slide" else set())
        for name in (body.name, above):
            if name is not None:
                count[name] += len(rows)
    return count
