"""Everything that DART holds beside the fields of the read-back, and that can act.

All that dartpy can be asked (which methods there are, and what becomes of each, is in ``dart_getters.py``), of the instance
that runs. The pairs of nodes that do not touch cannot be asked for; they are those that DART was told. What the inventory must
be says ``dart_expected.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from simspec.engines.dart.nodes import collision_nodes
from simspec.engines.dart.simulation import Simulation
from simspec.engines.kit.inventory import listed, named_set
from simspec.engines.kit.labels import sidecar_labels
from simspec.world.types import EngineValue, PlainValue

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
    for node, parts in on.items():
        others = set().union(*(on[name] for name in apart[node]))
        for part in parts:
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
