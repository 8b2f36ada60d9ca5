"""The values that gz-physics and its DART store besides the fields of the read-back, and that can act, and what they must be.

``expected`` runs without gz-physics.
"""

from __future__ import annotations

import ctypes
import operator
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from simspec.contact.plan import ContactPlan, parts
from simspec.engines.gazebo.building import asked
from simspec.engines.gazebo.readback import HeldBody, HeldUnit, held_body, held_unit, unit_name
from simspec.engines.gazebo.simulation import Simulation
from simspec.engines.kit.inventory import Carrier, Items, expected_apart, named_set, sidecar_labels
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.inertia import NO_INERTIA, lumped
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import Body, EngineValue, Inertial, Pose, Surface, World

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


class Placed(NamedTuple):
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


BODY = Items[HeldBody, Placed](
    {
        "at_child": (lambda one: near(one.in_child), True),
        "actuator": (lambda one: one.actuator, 0),
        "flags": (lambda one: one.flags, 3),
        "enforced": (lambda one: one.enforced, lambda placed: placed.body.joint.kind in SCALAR_JOINTS),
        "velocity_limits": (lambda one: finite(one.velocity), lambda placed: placed.limits(None)),
        "force_limits": (lambda one: finite(one.force), lambda placed: placed.limits(placed.body.joint.effort_limit)),
        "damping": (lambda one: one.damping, lambda placed: placed.body.joint.armature / placed.timestep),
        "spring": (lambda one: one.stiffness, 0.0),
        "rest": (lambda one: one.rest, 0.0),
    }
)
MASS = Items[Inertial, Inertial].named(
    getattr, {name: operator.attrgetter(name) for name in ("mass", "centre_of_mass", "inertia")}
)
UNIT = Items[HeldUnit, Surface](
    {
        "second_friction": (lambda one: one.friction[1], lambda surface: surface.friction or 0.0),
        "restitution": (lambda one: one.restitution, lambda surface: surface.restitution or 0.0),
        "slip": (lambda one: one.slip, (-1.0, -1.0)),  # none
        "direction": (lambda one: (*one.direction, one.in_frame), (0.0, 0.0, 0.0, False)),
        "collidable": (lambda one: one.collidable, True),
    }
)


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    lib = sim.library
    found: dict[str, EngineValue] = dict(sidecar_labels(sim.sidecar))
    numbers = asked(lib.gz_world, (sim.sim,), lib.gz_world_numbers())
    found |= {f"world.{name}": value for name, value in zip(WORLD, numbers[4:], strict=True)}
    found["world.detector"] = lib.gz_detector(sim.sim).decode()
    found["world.solver"] = lib.gz_solver(sim.sim).decode()
    for number in range(lib.gz_tree_count(sim.sim)):
        mobile, timestep, *gravity = asked(lib.gz_skeleton, (sim.sim, number), 5)
        found |= _tree(number, bool(mobile), timestep, tuple(gravity))
    for row, body in enumerate(sim.document.bodies):
        at, stored = f"body.{body.name}", held_body(sim, row)
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        found |= BODY.read(stored, at)
        if body.mass == 0.0:
            found[f"{at}.centre_of_mass"] = stored.inertial.centre_of_mass
        if not sim.walk.bodies[row].moves:  # the read-back compares no mass of massless static bodies
            found |= MASS.read(stored.inertial, at)
    for unit in sim.walk.units:
        at = f"unit.{unit_name(unit)}"
        found |= UNIT.read(held_unit(sim, unit.number), at) | {f"{at}.of": unit.of.owner.body.name}
    return found | _filter(sim)


def _tree(number: int, mobile: bool, timestep: float, gravity: tuple[float, ...]) -> dict[str, EngineValue]:
    at = f"tree.{number}"
    return {f"{at}.mobile": mobile, f"{at}.timestep": timestep, f"{at}.gravity": gravity}


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


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """None: everything is written."""
    return {}


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``."""
    units = [(body, part, shape) for body in world.bodies for part in parts(body, plan) for shape in part.shapes]
    carriers = [Carrier(f"{one.name}.{part.layer}", body.name, part.material, part.layer) for body, part, one in units]
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
        found |= BODY.expect(Placed(body, mass, world.physics.timestep), at)
        if mass.mass == 0.0:
            found[f"{at}.centre_of_mass"] = (0.0, 0.0, 0.0)
        if groups[body.name] == "world":
            found |= MASS.expect(mass if mass.mass else NO_INERTIA, at)  # as massless fixed bodies are written
    for carrier, (_, part, _) in zip(carriers, units, strict=True):
        found |= UNIT.expect(part.surface, f"unit.{carrier.name}") | {f"unit.{carrier.name}.of": carrier.body}
    return found | expected_apart(world, plan, carriers)
