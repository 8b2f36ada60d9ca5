"""What DART's inventory must be (``dart_inventory.py``), from the world and the settings that follow from it alone.

Runs outside the engine's process, without DART.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from simspec.contact.parts import parts
from simspec.contact.plan import ContactPlan
from simspec.engines.dart.inventory import finite, part_name
from simspec.engines.kit.inventory import Carrier, expected_apart, listed
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.meeting import frictionless, only_free_spheres
from simspec.world.types import VELOCITY_SIZE, Body, EngineValue, World

SOLVERS = {"nsgs": "NsgsFrictionSolver", "dantzig": "DantzigBoxedLcpSolver"}
LAWS = {"elliptic": "Coulomb", "pyramid-circumscribed": "Box"}

Settings = Mapping[str, bool | int | float | str]


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue], detector: str
) -> dict[str, EngineValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``; ``neutral`` are DART's own values,
    ``detector`` what the setting ``collision_detector`` stands for."""
    groups = rigid_groups(world)
    carriers = [
        Carrier(part_name(body.name, part.material, part.layer), body.name, part.material, part.layer)
        for body in world.bodies
        for part in parts(body, plan)
    ]
    found = _world(world, settings, neutral, detector)
    found["count.skeletons"] = len(trees(world))
    found["sidecar.bodies"] = listed([body.name for body in world.bodies])
    found["group.shapes"] = sum(len(part.shapes) for body in world.bodies for part in parts(body, plan))
    touching = any(groups[one.body] != "world" for one in carriers)
    choice = settings["exact_rotation"]
    found["exact_rotation"] = choice == "always" or (choice == "auto" and not touching)
    for root, bodies in trees(world).items():
        moves = any(groups[body.name] != "world" for body in bodies)
        found |= _skeleton(root, world, moves)
        for body in bodies:
            found |= _joint(body, world.physics.timestep) | _node(body)
            found[f"body.{body.name}.model"], found[f"body.{body.name}.joint"] = body.model, body.joint.name
            found[f"body.{body.name}.skeleton"] = root
            for part in parts(body, plan):
                at = f"surface.{part_name(body.name, part.material, part.layer)}"
                found[f"{at}.friction"] = (part.surface.friction or 0.0,) * len(part.shapes)
                found[f"{at}.restitution"] = (part.surface.restitution or 0.0,) * len(part.shapes)
            found[f"body.{body.name}.shapes"] = tuple(shape.name for shape in body.shapes)
            found[f"body.{body.name}.seen"] = tuple(shape.visual for shape in body.shapes)
            if groups[body.name] == "world":
                found |= _still(body)
            if body.joint.velocity_limit is not None:
                found[f"velocity_limit.{body.name}"] = body.joint.velocity_limit
    return found | expected_apart(world, plan, carriers)


def chosen_solver(world: World, settings: Settings) -> str:
    """What the setting ``contact_solver`` stands for."""
    chosen = str(settings["contact_solver"])
    if chosen != "auto":
        return chosen
    pyramid = world.contact.friction_cone == "pyramid-circumscribed"
    return "dantzig" if only_free_spheres(world) or (pyramid and frictionless(world)) else "nsgs"


def _world(
    world: World, settings: Settings, neutral: Mapping[str, EngineValue], detector: str
) -> dict[str, EngineValue]:
    solver = chosen_solver(world, settings)
    found = {name: value for name, value in neutral.items() if not name.startswith("nsgs.")}
    fall = math.dist((0.0, 0.0, 0.0), world.physics.gravity) * world.physics.timestep
    found |= {
        "solver.timestep": world.physics.timestep,
        "solver.primary": SOLVERS[solver],
        "detector.type": detector,
        "solver.detector": detector,
        "group.detector": detector,
        "group.automatic_update": False,
        "solver.split_impulse": False,
        "matrix_free.mEnabled": False,
        "deactivation.mEnabled": settings["sleeping"],
        "deactivation.mLinearSpeedThreshold": float(neutral["deactivation.mLinearSpeedThreshold"]) + fall,  # type: ignore[arg-type]
        "world.threads": 1,
        "solver.threads": 1,
    }
    if solver == "nsgs":
        found |= {name: value for name, value in neutral.items() if name.startswith("nsgs.")}
        found["nsgs.law"] = LAWS[world.contact.friction_cone]
        least = [settings["tolerance"]]
        if any(body.joint.dry_friction for body in world.bodies):
            least.append(settings["dry_friction_tolerance"])
        found |= {"nsgs.maxSweeps": settings["iterations"], "nsgs.tolerance": min(least)}
    return found


def _skeleton(root: str, world: World, moves: bool) -> dict[str, EngineValue]:
    held: dict[str, EngineValue] = {
        "mobile": moves,
        "self_collision": True,
        "adjacent_bodies": True,
        "gravity": world.physics.gravity,
        "timestep": world.physics.timestep,
        "soft_nodes": 0,
        "markers": 0,
        "end_effectors": 0,
        "trees": 1,
    }
    return {f"skeleton.{root}.{name}": value for name, value in held.items()}


def _joint(body: Body, timestep: float) -> dict[str, EngineValue]:
    """DART's own spring and damping are none but for the damping that stands for the armature."""
    joint, every = body.joint, VELOCITY_SIZE[body.joint.kind]
    free = (-math.inf, math.inf) * every
    effort = joint.effort_limit
    held: dict[str, EngineValue] = {
        "actuator": "FORCE",
        "actuators": ("FORCE",) * every,
        "enforced": joint.position_limits is not None,
        "coupled": False,
        "kinematic": False,
        "mimics": "",
        "position_limits": finite(joint.position_limits or free),
        "velocity_limits": finite(free),
        "acceleration_limits": finite(free),
        "force_limits": finite((-effort, effort) if effort is not None else free),
        "damping": (joint.armature / timestep,) * every,
        "dry_friction": (joint.dry_friction,) * every,
    }
    held |= dict.fromkeys(("spring", "rest", "command"), (0.0,) * every)
    return {f"joint.{body.name}.{name}": value for name, value in held.items()}


def _still(body: Body) -> dict[str, EngineValue]:
    """The mass of a body that cannot move."""
    xx, yy, zz, xy, xz, yz = body.inertial.inertia
    held: dict[str, EngineValue] = {
        "mass": body.inertial.mass,
        "centre_of_mass": body.inertial.centre_of_mass,
        "inertia": (xx, xy, xz, xy, yy, yz, xz, yz, zz),
    }
    return {f"body.{body.name}.{name}": value for name, value in held.items()}


def _node(body: Body) -> dict[str, EngineValue]:
    held: dict[str, EngineValue] = {
        "kind": "BodyNode",
        "gravity": True,
        "collidable": True,
        "markers": 0,
        "end_effectors": 0,
        "force": (0.0,) * 6,
    }
    return {f"node.{body.name}.{name}": value for name, value in held.items()}
