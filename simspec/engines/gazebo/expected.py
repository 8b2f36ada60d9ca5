"""What Gazebo's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.

Runs outside the engine's process, without gz-physics.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.contact.parts import parts
from simspec.contact.plan import ContactPlan
from simspec.engines.kit.inventory import Carrier, expected_apart
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.gathering import NOTHING, gathered
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import Body, HeldValue, Inertial, World

Settings = Mapping[str, bool | int | float | str]
BIG = 1e308
NONE = (0.0, 0.0)


def expected(world: World, settings: Settings, plan: ContactPlan) -> dict[str, HeldValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``."""
    carriers = [
        Carrier(f"{shape.name}.{part.layer}", body.name, part.material, part.layer)
        for body in world.bodies
        for part in parts(body, plan)
        for shape in part.shapes
    ]
    found: dict[str, HeldValue] = {
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
    groups, told = rigid_groups(world), gathered(world)
    for body in world.bodies:
        mass = told.get(body.name, body.inertial)
        for name, value in _body(body, mass, world.physics.timestep, groups[body.name] == "world").items():
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


def _body(body: Body, mass: Inertial, timestep: float, still: bool) -> dict[str, HeldValue]:
    joint = body.joint
    none = NONE if joint.kind == "fixed" else (-BIG, BIG)
    limit = joint.effort_limit
    scalar = joint.kind in SCALAR_JOINTS
    found: dict[str, HeldValue] = {
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
        whole = mass if mass.mass else NOTHING  # what is told of a fixed body without mass
        found |= {"mass": whole.mass, "centre_of_mass": whole.centre_of_mass, "inertia": whole.inertia}
    return found
