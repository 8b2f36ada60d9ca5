"""Everything that gz-physics and its DART hold beside the fields of the read-back, and that can act; what it must be says
``expected.py``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from simspec.contact.plan import ContactPlan, parts
from simspec.engines.gazebo.building import asked
from simspec.engines.gazebo.readback import held_body, held_unit, unit_name
from simspec.engines.gazebo.simulation import Simulation
from simspec.engines.kit.inventory import Carrier, expected_apart, named_set, sidecar_labels
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.inertia import NO_INERTIA, lumped
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import Body, EngineValue, Inertial, Pose, World

BIG = 1e308
"""Stands for infinity, which is no number in JSON."""
FIT = 1e-12
"""The tolerance of text, proof level L0."""
WORLD = (
    *("error_reduction", "error_reduction_speed", "error_allowance", "force_mixing"),
    *("most_contacts", "contact_enabled", "filter", "shapes", "skeletons", "links"),
)
"""What ``gz_world`` says after gravity and timestep."""


def finite(values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(max(-BIG, min(BIG, float(value))) for value in values)


def near(place: Pose) -> bool:
    """Whether a joint stands at its child's frame, but for what comes of taking SDF's frames apart."""
    return max(map(abs, (*place.position, *place.quaternion[1:]))) < FIT


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """Everything else that is held, by name."""
    lib = sim.library
    found: dict[str, EngineValue] = dict(sidecar_labels(sim.sidecar))
    numbers = asked(lib.gz_world, (sim.sim,), lib.gz_world_numbers())
    found |= {f"world.{name}": value for name, value in zip(WORLD, numbers[4:], strict=True)}
    found["world.detector"], found["world.solver"] = (
        lib.gz_detector(sim.sim).decode(),
        lib.gz_solver(sim.sim).decode(),
    )
    for number in range(lib.gz_tree_count(sim.sim)):
        mobile, timestep, *gravity = asked(lib.gz_skeleton, (sim.sim, number), 5)
        found[f"tree.{number}.mobile"], found[f"tree.{number}.timestep"] = bool(mobile), timestep
        found[f"tree.{number}.gravity"] = tuple(gravity)
    for row, body in enumerate(sim.document.bodies):
        for name, value in _body(sim, row).items():
            found[f"body.{body.name}.{name}"] = value
    for number, unit in enumerate(sim.walk.units):
        held, name = held_unit(sim, number), unit_name(unit)
        found[f"unit.{name}.of"] = unit.of.owner.body.name
        found[f"unit.{name}.second_friction"] = held.friction[1]
        found[f"unit.{name}.restitution"] = held.restitution
        found[f"unit.{name}.slip"] = held.slip
        found[f"unit.{name}.direction"] = (*held.direction, held.in_frame)
        found[f"unit.{name}.collidable"] = held.collidable
    return found | _filter(sim)


def _body(sim: Simulation, row: int) -> dict[str, EngineValue]:
    told, held = sim.document.bodies[row], held_body(sim, row)
    found: dict[str, EngineValue] = {
        "model": told.model,
        "joint": told.joint.name,
        "shapes": tuple(shape.name for shape in told.shapes),
        "at_child": near(held.in_child),
        "actuator": held.actuator,
        "flags": held.flags,
        "enforced": held.enforced,
        "velocity_limits": finite(held.velocity),
        "force_limits": finite(held.force),
        "damping": held.damping,
        "spring": held.stiffness,
        "rest": held.rest,
    }
    mass = held.inertial
    if told.mass == 0.0:  # nor a centre
        found["centre_of_mass"] = mass.centre_of_mass
    if not sim.walk.bodies[row].moves:  # of what cannot move, the read-back compares no mass where there is none
        found |= {"mass": mass.mass, "centre_of_mass": mass.centre_of_mass, "inertia": mass.inertia}
    return found


def _filter(sim: Simulation) -> dict[str, EngineValue]:
    """For every copy of a shape the others that it does not touch, itself not counted."""
    names = [unit_name(unit) for unit in sim.walk.units]
    apart = np.zeros((len(names), len(names)), dtype=np.uint8)
    sim.library.gz_apart(sim.sim, apart.ctypes.data_as(ctypes.POINTER(ctypes.c_ubyte)))
    np.fill_diagonal(apart, 0)
    return {
        f"apart.{name}": named_set(names[other] for other in np.nonzero(row)[0].tolist())
        for name, row in zip(names, apart, strict=True)
    }


# What Gazebo's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.
#
# Runs outside the engine's process, without gz-physics.

Settings = Mapping[str, bool | int | float | str]
BIG_EXPECTED = 1e308
NONE = (0.0, 0.0)


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """None: everything is written."""
    return {}


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``."""
    carriers = [
        Carrier(f"{shape.name}.{part.layer}", body.name, part.material, part.layer)
        for body in world.bodies
        for part in parts(body, plan)
        for shape in part.shapes
    ]
    found: dict[str, EngineValue] = {
        "world.error_reduction": 0.01,
        "world.error_reduction_speed": 1e9,
        "world.error_allowance": 0.0,
        "world.force_mixing": 1e-5,
        "world.most_contacts": 1e6,
        "world.contact_enabled": 1.0,
        "world.filter": 1.0,
        "world.shapes": float(len(carriers)),
        "world.skeletons": float(len(trees(world))),
        "world.links": float(len(world.bodies)),
        "world.detector": "ode",
        "world.solver": SOLVERS[str(settings["contact_solver"])],
    }
    for number in range(len(trees(world))):
        found[f"tree.{number}.mobile"] = True
        found[f"tree.{number}.timestep"] = world.physics.timestep
        found[f"tree.{number}.gravity"] = world.physics.gravity
    groups, told = rigid_groups(world), lumped(world)
    for body in world.bodies:
        mass = told.get(body.name, body.inertial)
        for name, value in _body_expected(body, mass, world.physics.timestep, groups[body.name] == "world").items():
            found[f"body.{body.name}.{name}"] = value
        for part in parts(body, plan):
            for shape in part.shapes:
                name = f"unit.{shape.name}.{part.layer}"
                found[f"{name}.of"] = body.name
                found[f"{name}.second_friction"] = part.surface.friction or 0.0
                found[f"{name}.restitution"] = part.surface.restitution or 0.0
                found[f"{name}.slip"] = (-1.0, -1.0)  # none
                found[f"{name}.direction"] = (0.0, 0.0, 0.0, False)
                found[f"{name}.collidable"] = True
    return found | expected_apart(world, plan, carriers)


SOLVERS = {"dantzig": "DantzigBoxedLcpSolver in passes", "pgs": "PgsBoxedLcpSolver"}
"""DART's names of its solvers, and the name of the C++ part that runs Dantzig's in passes."""


def _body_expected(body: Body, mass: Inertial, timestep: float, still: bool) -> dict[str, EngineValue]:
    joint = body.joint
    none = NONE if joint.kind == "fixed" else (-BIG_EXPECTED, BIG_EXPECTED)
    limit = joint.effort_limit
    scalar = joint.kind in SCALAR_JOINTS
    found: dict[str, EngineValue] = {
        "model": body.model,
        "joint": joint.name,
        "shapes": tuple(shape.name for shape in body.shapes),
        "at_child": True,
        "actuator": 0,
        "flags": 3,
        "enforced": scalar,
        "velocity_limits": none,
        "force_limits": none if limit is None else (-limit, limit),
        "damping": joint.armature / timestep,
        "spring": 0.0,
        "rest": 0.0,
    }
    if mass.mass == 0.0:
        found["centre_of_mass"] = (0.0, 0.0, 0.0)
    if still:
        whole = mass if mass.mass else NO_INERTIA  # what is told of a fixed body without mass
        found |= {"mass": whole.mass, "centre_of_mass": whole.centre_of_mass, "inertia": whole.inertia}
    return found
