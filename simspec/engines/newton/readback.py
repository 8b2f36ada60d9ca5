"""The model as Newton stores it, in the world's frames and order.

Masses, joints, shapes with their numbers, gravity and coordinates are read from Newton's model and state; stiffness and rest of
springs from what simspec applies; the timestep from what is recorded; visual shapes are those of the file.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simspec.contact import ContactPlan
from simspec.engines.kit.array_inventory import ArrayInventory, StoredRows
from simspec.engines.kit.building import HALVED, ShapeUnit, inertial_of, shape_of_copies, vector
from simspec.engines.kit.inventory import (
    LARGEST,
    NEUTRAL,
    ArrayRows,
    Items,
    arguments,
    below,
    sidecar_labels,
    stored,
)
from simspec.engines.kit.links import pose_of_xyzw, tree_joint
from simspec.engines.kit.world_simulation import free_joint, visual_shape
from simspec.engines.newton.building import NAME, UNLIMITED
from simspec.engines.newton.simulation import NewtonSimulation
from simspec.errors import EngineError
from simspec.formats.world import FreeJoint
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import trees
from simspec.world.types import Body, EngineValue, Inertial, Joint, ReadBack, Shape, Surface, World

KINDS = {
    **{name.upper(): name for name in ("sphere", "box", "capsule", "cylinder", "ellipsoid", "plane")},
    "CONVEX_MESH": "mesh",
}
"""Newton's names of types of shapes."""
JOINTS = {"FREE": "free", "FIXED": "fixed", "REVOLUTE": "hinge", "PRISMATIC": "slide", "BALL": "ball"}
"""Newton's names of types of joints."""


def read_back(sim: NewtonSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as Newton stores it, and its present state."""
    bodies = sim.bodies(lambda row: _inertial(sim, row), lambda row: _joint(sim, row), lambda units: _shape(sim, units))
    model = sim.model(bodies, vector(sim.gravity), sim.timestep, unreadable)
    return dataclasses.replace(model, servos=sim.built.drives.servos())


def _inertial(sim: NewtonSimulation, row: int) -> Inertial:
    mass, centre, inertia = (sim.of_bodies(name)[row] for name in ("mass", "com", "inertia"))
    return inertial_of(float(mass), centre, inertia)


def _joint(sim: NewtonSimulation, row: int) -> Joint:
    """A joint as Newton stores it."""
    model, number, given = sim.built.model, sim.built.links[row], sim.document.bodies[row].joint
    kind = JOINTS.get(sim.newton.JointType(int(model.joint_type.numpy()[number])).name, "none")
    q, v = sim.get_state()
    state = (q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist())
    if kind != given.kind:
        raise EngineError(NAME, f"stores {given.name!r} as a joint of the kind {kind}")
    if isinstance(given, FreeJoint):
        return free_joint(given.name, *state)
    parent, at = int(model.joint_parent.numpy()[number]), int(model.joint_qd_start.numpy()[number])
    springs = {"spring_stiffness": float(sim.springs.stiffness[row]), "spring_rest": float(sim.springs.rest[row])}

    def read(name: str) -> float:
        value = springs[name] if name in springs else float(getattr(model, f"joint_{name}").numpy()[at])
        return math.copysign(math.inf, value) if name.startswith("limit") and abs(value) == UNLIMITED else value

    axis = vector(model.joint_axis.numpy()[at]) if given.kind in SCALAR_JOINTS else (0.0, 0.0, 0.0)
    name = None if parent < 0 else sim.names[sim.built.links.index(parent)]
    return tree_joint(given, name, pose_of_xyzw(model.joint_X_p.numpy()[number]), state, read, axis)


def _shape(sim: NewtonSimulation, units: Sequence[ShapeUnit]) -> Shape:
    """A collision shape as Newton stores its copies, with the visual part of the file."""
    model, shape = sim.built.model, units[0].of.shape
    numbers = [sim.built.shapes[unit.number] for unit in units]
    poses, frictions, bounces = (
        getattr(model, f"shape_{name}").numpy() for name in ("transform", "material_mu", "material_restitution")
    )
    return shape_of_copies(
        NAME,
        visual_shape(shape),
        [(kind_of(sim, number), size_of(sim, number), pose_of_xyzw(poses[number])) for number in numbers],
        [Surface(float(frictions[number]), restitution=float(bounces[number])) for number in numbers],
    )


def kind_of(sim: NewtonSimulation, number: int) -> str:
    """The kind of a shape by the world's name; Newton's name of a kind that the world does not have."""
    name = str(sim.newton.GeoType(int(sim.built.model.shape_type.numpy()[number])).name)
    return KINDS.get(name, name)


def size_of(sim: NewtonSimulation, number: int) -> tuple[float, ...]:
    """The size of a shape as the world has it."""
    kind, scale = kind_of(sim, number), sim.built.model.shape_scale.numpy()[number].astype(float)
    if kind == "mesh":
        vertices = np.array(sim.built.model.shape_source[number].vertices, dtype=float)
        return tuple((vertices * scale).ravel().tolist())
    factors = HALVED.get(kind, ())
    return tuple(value / factor for factor, value in zip(factors, scale.tolist(), strict=False))


# The values that Newton stores besides the fields of the read-back, and that can act, and what they must be.
#
# ``expected`` runs without Newton; it repeats the numbers of ``building.py`` on purpose. Defaults are those of Newton's
# builder, which has the same arrays as a model, and of the arguments of its solver.


BODY = Items[ArrayRows, Body].named(
    ArrayRows.read,
    {
        "body_flags": NEUTRAL,
        "steel.rigid_body_angular_damping": 0.0,
        "steel.rigid_body_linear_damping": 0.0,
        **dict.fromkeys(
            (
                "steel.rigid_body_max_linear_velocity",
                "steel.rigid_body_max_angular_velocity",
                "steel.rigid_body_max_depenetration_velocity",
            ),
            LARGEST,
        ),
    },
)
JOINT = Items[ArrayRows, Body].named(
    ArrayRows.read,
    dict.fromkeys(("joint_enabled", "joint_X_c", "joint_mimic_joint", "joint_mimic_coeffs", "joint_dof_dim"), NEUTRAL),
)
UNDRIVEN = ("joint_target_ke", "joint_target_kd", "joint_target_mode", "joint_target_qd", "joint_act")
DOF = Items[ArrayRows, Body].named(
    ArrayRows.read,
    dict.fromkeys((*UNDRIVEN, "joint_stiffness", "joint_limit_ke", "joint_limit_kd"), NEUTRAL),
)
OTHERS = ("joint_friction", "joint_limit_lower", "joint_limit_upper", "joint_velocity_limit", "joint_effort_limit")
"""Arrays that are fields of the read-back for hinges and slides."""
BALL = DOF | Items[ArrayRows, Body].named(
    ArrayRows.read, {**dict.fromkeys(OTHERS, NEUTRAL), "joint_armature": lambda body: (body.joint.armature,) * 3}
)
FREE = BALL | Items[ArrayRows, Body].named(ArrayRows.read, dict.fromkeys(("joint_armature", "joint_damping"), NEUTRAL))
DOFS = {"hinge": DOF, "slide": DOF, "ball": BALL, "free": FREE}
SHAPE = Items[ArrayRows, Shape].named(
    ArrayRows.read,
    {
        **dict.fromkeys(("shape_flags", "shape_collision_group", "shape_margin", "shape_is_solid"), NEUTRAL),
        **dict.fromkeys([f"shape_material_{name}" for name in ("ka", "kd", "ke", "kf", "kh")], NEUTRAL),
        "shape_gap": 5e-6,
        "shape_material_mu_torsional": 0.0,
        "shape_material_mu_rolling": 0.0,
        "steel.min_torsional_patch_radius": 0.0,
    },
)
ROWS = ArrayInventory(BODY, JOINT, DOFS, SHAPE, ("shape_material_mu", "shape_material_restitution"))
NONE = ("particle", "muscle", "spring", "tendon", "tri", "edge", "tet", "constraint_mimic", "attachment_particle_body")
COUNTS = Items[Any, World].named(
    lambda model, name: int(getattr(model, f"{name}_count")),
    {
        "body": lambda world: len(world.bodies),
        "joint": lambda world: len(world.bodies),
        "articulation": lambda world: len(trees(world)),
        "world": 1,
        **dict.fromkeys(NONE, 0),
    },
)
SET = {
    "baumgarte": 0.01,
    "cfm": 1e-9,
    "friction_anchor_beta": 0.0,
    "enable_joint_limits": True,
    "joint_limit_activation_gap": 1e9,
    "warn_constraint_overflow": False,
}
"""Arguments of the solver, by their names, that are the same for every world."""
ROOM = ("articulation_constraint_max", "free_body_constraint_max", "propagation_constraint_max", "deterministic")
"""Its arguments that say for how much there is room, which grows, or that have no effect on a processor."""


def inventory(sim: NewtonSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    model, solver = sim.built.model, sim.recorded().solver
    found = {**sidecar_labels(sim.sidecar), **COUNTS.read(model, "count")}
    found |= {f"solver.{name}": stored(getattr(solver, name)) for name in arguments(type(solver), ROOM)}
    pairs = {tuple(pair) for pair in sim.built.pairs.numpy().tolist()}
    return found | ROWS.read(sim.walk, _stored(sim), lambda unit, other: (unit, other) not in pairs)


def _stored(sim: NewtonSimulation) -> StoredRows:
    """Where Newton's model has the parts of the world."""
    model, links, shapes = sim.built.model, sim.built.links, sim.built.shapes
    rows = {link: row for row, link in enumerate(links)}
    first = model.articulation_start.numpy()[model.joint_articulation.numpy()]
    return StoredRows(
        model,
        links,
        model.joint_qd_start.numpy(),
        shapes,
        roots=[rows[int(first[link])] for link in links],
        kinds=[kind_of(sim, number) for number in shapes],
        owners=[rows[int(model.shape_body.numpy()[number])] for number in shapes],
    )


def neutral(sim: NewtonSimulation) -> dict[str, EngineValue]:
    """Newton's defaults: of its solver's arguments, and of a bare link, joint of each kind, and shape."""
    b, options = sim.newton.ModelBuilder(), arguments(sim.newton.solvers.SolverSteel, ROOM)
    kinds = {
        "fixed": b.add_joint_fixed,
        "hinge": b.add_joint_revolute,
        "slide": b.add_joint_prismatic,
        "ball": b.add_joint_ball,
        "free": b.add_joint_free,
    }
    for add in kinds.values():
        add(child=b.add_link(), parent=-1)
    b.add_shape_sphere(0, radius=1.0)
    starts = (*b.joint_qd_start, b.joint_dof_count)
    found = ROWS.bare(tuple(kinds), StoredRows(b, range(len(kinds)), starts, (0,)))
    return found | {f"solver.{name}": value for name, value in options.items()}


def expected(
    world: World, settings: Mapping[str, Any], plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are Newton's defaults."""
    thresholds = [law.restitution_threshold for law in meeting_laws(world).values() if law.restitution]
    options = {**below("solver", neutral), **SET, "iterations": settings["iterations"]}
    options |= {"restitution_velocity_threshold": max(1e-6, *thresholds, 0.0)}
    if settings.get("warm_start"):
        options |= {"contact_warmstart": True, "contact_regularization": 0.001}
    found = COUNTS.expect(world, "count") | ROWS.expect(world, plan, neutral)
    return found | {f"solver.{name}": value for name, value in options.items()}
