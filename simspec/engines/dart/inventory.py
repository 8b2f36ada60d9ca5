"""Everything that DART holds beside the fields of the read-back, and that can act.

All that dartpy can be asked, of the instance
that runs. The pairs of nodes that do not touch cannot be asked for; they are those that DART was told. What the inventory must
be says ``dart_expected.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from simspec.contact.plan import ContactPlan, parts
from simspec.engines.dart.nodes import collision_nodes
from simspec.engines.dart.simulation import Simulation
from simspec.engines.kit.inventory import Carrier, expected_apart, listed, named_set, sidecar_labels
from simspec.world.contact_pairs import frictionless, only_free_spheres
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import VELOCITY_SIZE, Body, EngineValue, PlainValue, World

SOLVER_FLAGS = ("enableContact", "maxNumContacts", "maxNumContactsPerPair", "allowNegativePenetrationDepthContacts")
DEACTIVATION = ("mEnabled", "mLinearSpeedThreshold", "mAngularSpeedThreshold", "mTimeUntilSleep", "mWakeThresholdScale")
MATRIX_FREE = (
    *("mEnabled", "mMinRows", "mMaxIterations", "mSor", "mDeltaTolerance", "mRelativeDeltaTolerance"),
    "mEpsilonForDivision",
)
NSGS = ("law", "maxSweeps", "tolerance", "boxForAnisotropic")
LIMITS = {
    "position_limits": ("getPositionLowerLimit", "getPositionUpperLimit"),
    "velocity_limits": ("getVelocityLowerLimit", "getVelocityUpperLimit"),
    "acceleration_limits": ("getAccelerationLowerLimit", "getAccelerationUpperLimit"),
    "force_limits": ("getForceLowerLimit", "getForceUpperLimit"),
}
PER_COORDINATE = {
    "spring": "getSpringStiffness",
    "rest": "getRestPosition",
    "damping": "getDampingCoefficient",
    "dry_friction": "getCoulombFriction",
    "command": "getCommand",
}


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """Everything else that is held, by name."""
    sidecar = sim.sidecar
    found = of_world(sim.dartpy, sim.world)
    found["count.skeletons"] = sim.world.getNumSkeletons()
    found["group.shapes"] = sim.solver.getCollisionGroup().getNumShapeFrames()
    found["group.automatic_update"] = sim.solver.getCollisionGroup().getAutomaticUpdate()
    found["solver.timestep"] = sim.solver.getTimeStep()
    for index in range(sim.world.getNumSkeletons()):
        found.update(_skeleton(sim.world.getSkeleton(index)))
    shapes: dict[str, list[str]] = {}
    seen: dict[str, list[bool]] = {}
    for shape in sidecar.shapes:
        shapes.setdefault(shape.body, []).append(shape.name)
        seen.setdefault(shape.body, []).append(shape.visual)
    for index, (name, body) in enumerate(zip(sim.names, sim.bodies, strict=True)):
        joint = body.getParentJoint()
        found[f"body.{name}.joint"], found[f"body.{name}.skeleton"] = joint.getName(), body.getSkeleton().getName()
        found[f"body.{name}.shapes"], found[f"body.{name}.seen"] = (
            tuple(shapes.get(name, ())),
            tuple(seen.get(name, ())),
        )
        if not body.isReactive():  # of what cannot move the read-back tells no mass
            held = body.getInertia()
            found[f"body.{name}.mass"] = held.getMass()
            found[f"body.{name}.centre_of_mass"] = tuple(held.getLocalCOM().tolist())
            found[f"body.{name}.inertia"] = tuple(held.getMoment().reshape(-1).tolist())
        found.update(_joint(name, joint))
        found.update(_nodes(name, sim.nodes.of(index)))
    found.update(sidecar_labels(sidecar.plain()))
    found["sidecar.bodies"] = listed(sim.names)
    models = zip(sim.names, sidecar.models, strict=True)
    found.update({f"body.{name}.model": model for name, model in models})
    found.update({f"velocity_limit.{entry.body}": entry.value for entry in sidecar.velocity_limits})
    found["exact_rotation"] = sim.exact_rotation
    found.update(_parts(sim))
    return found


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """What a world of DART's holds that was told nothing but its collision detector."""
    world = sim.dartpy.simulation.World("neutral")
    world.setCollisionDetector(
        getattr(sim.dartpy.simulation.CollisionDetectorType, sim.world.getCollisionDetector().getType().upper())
    )
    found = of_world(sim.dartpy, world)
    options = sim.dartpy.constraint.NsgsFrictionSolver.Options()
    return found | {f"nsgs.{name}": _value(getattr(options, name)) for name in NSGS}


def of_world(dartpy: Any, world: Any) -> dict[str, EngineValue]:
    """A world's own numbers: threads, sleeping, the solvers of its constraints and the detection of its contacts."""
    solver, detector = world.getConstraintSolver(), world.getCollisionDetector()
    lcp = solver.getBoxedLcpSolver()
    found: dict[str, EngineValue] = {
        "count.frames": world.getNumSimpleFrames(),
        "count.constraints": solver.getNumConstraints(),
        "world.threads": world.getNumSimulationThreads(),
        "solver.type": type(solver).__name__,
        "solver.threads": solver.getNumSimulationThreads(),
        "solver.split_impulse": solver.isSplitImpulseEnabled(),
        "solver.primary": type(lcp).__name__,
        "solver.secondary": type(solver.getSecondaryBoxedLcpSolver()).__name__,
        "detector.type": detector.getType(),
        "solver.detector": solver.getCollisionDetector().getType(),
        "group.detector": solver.getCollisionGroup().getCollisionDetector().getType(),
    }
    for name, options, fields in (
        ("deactivation", world.getDeactivationOptions(), DEACTIVATION),
        ("matrix_free", solver.getMatrixFreeContactSolverOptions(), MATRIX_FREE),
        ("collision", solver.getCollisionOption(), SOLVER_FLAGS),
    ):
        found.update({f"{name}.{field}": _value(getattr(options, field)) for field in fields})
    found["collision.most_per_pair"] = solver.getCollisionOption().getEffectiveMaxNumContactsPerPair()
    found["collision.filter"] = type(solver.getCollisionOption().collisionFilter).__name__
    if isinstance(lcp, dartpy.constraint.NsgsFrictionSolver):
        found.update({f"nsgs.{field}": _value(getattr(lcp.getOptions(), field)) for field in NSGS})
    for name in ("getPrimitiveShapeType", "getContactPointComputationMethod"):
        if hasattr(detector, name):
            found[f"detector.{name.removeprefix('get')}"] = _value(getattr(detector, name)())
    return found


def _value(value: Any) -> PlainValue:
    """A number or flag as it is, unlimited ones and the names of choices as words."""
    if isinstance(value, bool):
        return value
    if isinstance(value, (int, float)):
        return str(value) if not math.isfinite(value) else value
    return str(getattr(value, "name", value))


def _skeleton(skeleton: Any) -> dict[str, EngineValue]:
    held: dict[str, EngineValue] = {
        "mobile": skeleton.isMobile(),
        "self_collision": skeleton.getSelfCollisionCheck(),
        "adjacent_bodies": skeleton.getAdjacentBodyCheck(),
        "gravity": tuple(skeleton.getGravity().tolist()),
        "timestep": skeleton.getTimeStep(),
        "soft_nodes": skeleton.getNumSoftBodyNodes(),
        "markers": skeleton.getNumMarkers(),
        "end_effectors": skeleton.getNumEndEffectors(),
        "trees": skeleton.getNumTrees(),
    }
    return {f"skeleton.{skeleton.getName()}.{name}": value for name, value in held.items()}


def _joint(name: str, joint: Any) -> dict[str, EngineValue]:
    """The joint of a body, by the body's name."""
    every = range(joint.getNumDofs())
    held: dict[str, EngineValue] = {
        "actuator": _value(joint.getActuatorType()),
        "actuators": tuple(_value(joint.getActuatorTypeForDof(index)) for index in every),
        "enforced": joint.areLimitsEnforced(),
        "coupled": joint.isUsingCouplerConstraint(),
        "kinematic": joint.isKinematic(),
        "mimics": _mimics(joint),
    }
    for key, (low, high) in LIMITS.items():
        held[key] = tuple(_value(getattr(joint, side)(index)) for index in every for side in (low, high))
    for key, getter in PER_COORDINATE.items():
        held[key] = tuple(_value(getattr(joint, getter)(index)) for index in every)
    return {f"joint.{name}.{key}": value for key, value in held.items()}


def _mimics(joint: Any) -> str:
    """The names of the joints that a joint follows."""
    if not joint.getNumDofs():
        return ""
    rows = joint.getGenericJointProperties().mMimicDofProps
    return named_set(row.mReferenceJoint.getName() for row in rows if row.mReferenceJoint is not None)


def _nodes(name: str, nodes: Sequence[Any]) -> dict[str, EngineValue]:
    """Of a body's nodes what each holds, where all hold the same."""
    found: dict[str, EngineValue] = {}
    for node in nodes:
        held: dict[str, EngineValue] = {
            "kind": type(node).__name__,
            "gravity": node.getGravityMode(),
            "collidable": node.isCollidable(),
            "markers": node.getNumMarkers(),
            "end_effectors": node.getNumEndEffectors(),
            "force": tuple(node.getExternalForceGlobal().tolist()),
        }
        for key, value in held.items():
            if found.setdefault(f"node.{name}.{key}", value) != value:
                found[f"node.{name}.{key}"] = f"{value} on {node.getName()}"
    return found


def _parts(sim: Simulation) -> dict[str, EngineValue]:
    """Of every body's material in every layer the numbers of its shapes, and the others that it does not touch: those on nodes
    that were told to be apart, on its own node, and, for what cannot move, on all others of that kind."""
    on: dict[str, set[str]] = {}
    still: set[str] = set()
    shapes = sim.sidecar.shapes
    numbers: dict[str, dict[str, tuple[PlainValue, ...]]] = {"friction": {}, "restitution": {}}
    for index, body in enumerate(sim.bodies):
        for node in sim.nodes.of(index):
            for shape in collision_nodes(node):
                number, copy = sim.nodes.copy(shape)
                part = part_name(shapes[number].body, shapes[number].material, shapes[number].surfaces[copy].layer)
                on.setdefault(node.getName(), set()).add(part)
                surface = shape.getDynamicsAspect()
                for key, value in (
                    ("friction", surface.getFrictionCoeff()),
                    ("restitution", surface.getRestitutionCoeff()),
                ):
                    numbers[key][part] = (*numbers[key].get(part, ()), value)
                if not body.isReactive():
                    still.add(part)
    apart: dict[str, set[str]] = {name: {name} for name in on}
    for one, other in sim.apart:
        if one in on and other in on:
            apart[one].add(other)
            apart[other].add(one)
    found: dict[str, set[str]] = {}
    for node, own in on.items():
        others = set().union(*(on[name] for name in apart[node]))
        for part in own:
            found.setdefault(part, set()).update(others | still if part in still else others)
    held: dict[str, EngineValue] = {f"apart.{part}": named_set(others - {part}) for part, others in found.items()}
    held.update(
        {f"surface.{part}.{key}": values for key, by_part in numbers.items() for part, values in by_part.items()}
    )
    return held


def part_name(body: str, material: str, layer: int) -> str:
    """What the shapes of one material of a body in one layer are called."""
    return f"{body}/{material}/{layer}"


def finite(values: Iterable[float]) -> tuple[PlainValue, ...]:
    """Numbers as an inventory has them."""
    return tuple(_value(value) for value in values)


# What DART's inventory must be (``dart_inventory.py``), from the world and the settings that follow from it alone.
#
# Runs outside the engine's process, without DART.

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
        found |= _skeleton_expected(root, world, moves)
        for body in bodies:
            found |= _joint_expected(body, world.physics.timestep) | _node(body)
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


def _skeleton_expected(root: str, world: World, moves: bool) -> dict[str, EngineValue]:
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


def _joint_expected(body: Body, timestep: float) -> dict[str, EngineValue]:
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
