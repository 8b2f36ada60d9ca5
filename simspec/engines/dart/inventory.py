"""The values that DART stores besides the fields of the read-back, and that can act, and what they must be (``expected``, which
runs without DART).

The test of the inventory lists every getter of dartpy. The pairs of nodes that do not touch cannot be queried: they are those
that simspec passed to DART.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from simspec.contact import ContactPlan, parts
from simspec.engines.dart.coordinates import collision_nodes
from simspec.engines.dart.simulation import DartSimulation
from simspec.engines.kit.inventory import (
    NEUTRAL,
    FilterCarrier,
    Items,
    below,
    expected_separate,
    listed,
    named_set,
    sidecar_labels,
)
from simspec.world.contact_pairs import frictionless, only_free_spheres
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import VELOCITY_SIZE, Body, EngineValue, PlainValue, World

SOLVERS = {"nsgs": "NsgsFrictionSolver", "dantzig": "DantzigBoxedLcpSolver"}
LAWS = {"elliptic": "Coulomb", "pyramid-circumscribed": "Box"}
Settings = Mapping[str, bool | int | float | str]


class ExpectedWorld(NamedTuple):
    """A world, its settings, and the detector for which the setting ``collision_detector`` stands."""

    world: World
    settings: Settings
    detector: str

    @property
    def tolerance(self) -> bool | int | float | str:
        tolerance, dry = self.settings["tolerance"], self.settings["dry_friction_tolerance"]
        return min(tolerance, dry) if any(body.joint.dry_friction for body in self.world.bodies) else tolerance


class ExpectedTree(NamedTuple):
    world: World
    moves: bool


class DartExpectedJoint(NamedTuple):
    body: Body
    timestep: float

    def each(self, *values: float) -> tuple[PlainValue, ...]:
        """The values for every coordinate."""
        return tuple(map(plain, values)) * VELOCITY_SIZE[self.body.joint.kind]


def plain(value: Any) -> PlainValue:
    """A finite number or a flag as it is, other numbers and the names of choices as text."""
    if isinstance(value, (bool, int, float)):
        return value if math.isfinite(value) else str(value)
    return str(getattr(value, "name", value))


def _field(options: Any, name: str) -> PlainValue:
    return plain(getattr(options, name))


WORLD = Items[Any, ExpectedWorld](
    {
        "count.frames": (lambda world: world.getNumSimpleFrames(), NEUTRAL),
        "count.constraints": (lambda world: world.getConstraintSolver().getNumConstraints(), NEUTRAL),
        "world.threads": (lambda world: world.getNumSimulationThreads(), 1),
        "detector.type": (lambda world: world.getCollisionDetector().getType(), lambda of: of.detector),
        **{
            f"detector.{name}": (
                lambda world, name=name: _detector_field(world.getCollisionDetector(), f"get{name}"),  # type: ignore[misc]
                NEUTRAL,
            )
            for name in ("PrimitiveShapeType", "ContactPointComputationMethod")
        },
    }
)
SOLVER = Items[Any, ExpectedWorld](
    {
        "solver.type": (lambda solver: type(solver).__name__, NEUTRAL),
        "solver.threads": (lambda solver: solver.getNumSimulationThreads(), 1),
        "solver.split_impulse": (lambda solver: solver.isSplitImpulseEnabled(), False),
        "solver.primary": (
            lambda solver: type(solver.getBoxedLcpSolver()).__name__,
            lambda of: SOLVERS[chosen_solver(of.world, of.settings)],
        ),
        "solver.secondary": (lambda solver: type(solver.getSecondaryBoxedLcpSolver()).__name__, NEUTRAL),
        "solver.detector": (lambda solver: solver.getCollisionDetector().getType(), lambda of: of.detector),
        "group.detector": (
            lambda solver: solver.getCollisionGroup().getCollisionDetector().getType(),
            lambda of: of.detector,
        ),
        "collision.most_per_pair": (
            lambda solver: solver.getCollisionOption().getEffectiveMaxNumContactsPerPair(),
            NEUTRAL,
        ),
        "collision.filter": (lambda solver: type(solver.getCollisionOption().collisionFilter).__name__, NEUTRAL),
    }
)
COLLISION = Items[Any, ExpectedWorld].named(
    _field,
    {
        **dict.fromkeys(("enableContact", "maxNumContacts", "maxNumContactsPerPair"), NEUTRAL),
        "allowNegativePenetrationDepthContacts": NEUTRAL,
    },
)
MATRIX_FREE = Items[Any, ExpectedWorld].named(
    _field,
    {
        "mEnabled": False,
        **dict.fromkeys(("mMinRows", "mMaxIterations", "mSor", "mDeltaTolerance"), NEUTRAL),
        **dict.fromkeys(("mRelativeDeltaTolerance", "mEpsilonForDivision"), NEUTRAL),
    },
)
DEACTIVATION = Items[Any, ExpectedWorld].named(
    _field,
    {
        "mEnabled": lambda of: of.settings["sleeping"],
        **dict.fromkeys(("mLinearSpeedThreshold", "mAngularSpeedThreshold", "mTimeUntilSleep"), NEUTRAL),
        "mWakeThresholdScale": NEUTRAL,
    },
)
"""The threshold of linear speed is DART's with the fall of a step added."""
NSGS = Items[Any, ExpectedWorld].named(
    _field,
    {
        "law": lambda of: LAWS[of.world.contact.friction_cone],
        "maxSweeps": lambda of: of.settings["iterations"],
        "tolerance": lambda of: of.tolerance,
        "boxForAnisotropic": NEUTRAL,
    },
)
SIMULATION = Items[DartSimulation, ExpectedWorld](
    {
        "count.skeletons": (lambda sim: sim.world.getNumSkeletons(), lambda of: len(trees(of.world))),
        "group.automatic_update": (lambda sim: sim.solver.getCollisionGroup().getAutomaticUpdate(), False),
        "solver.timestep": (lambda sim: sim.solver.getTimeStep(), lambda of: of.world.physics.timestep),
        "sidecar.bodies": (
            lambda sim: listed(sim.names),
            lambda of: listed([body.name for body in of.world.bodies]),
        ),
    }
)
SKELETON = Items[Any, ExpectedTree](
    {
        "mobile": (lambda skeleton: skeleton.isMobile(), lambda of: of.moves),
        "self_collision": (lambda skeleton: skeleton.getSelfCollisionCheck(), True),
        "adjacent_bodies": (lambda skeleton: skeleton.getAdjacentBodyCheck(), True),
        "gravity": (lambda skeleton: tuple(skeleton.getGravity().tolist()), lambda of: of.world.physics.gravity),
        "timestep": (lambda skeleton: skeleton.getTimeStep(), lambda of: of.world.physics.timestep),
        "soft_nodes": (lambda skeleton: skeleton.getNumSoftBodyNodes(), 0),
        "markers": (lambda skeleton: skeleton.getNumMarkers(), 0),
        "end_effectors": (lambda skeleton: skeleton.getNumEndEffectors(), 0),
        "trees": (lambda skeleton: skeleton.getNumTrees(), 1),
    }
)


def _each(joint: Any, *getters: str) -> tuple[PlainValue, ...]:
    """The values of every coordinate."""
    return tuple(plain(getattr(joint, getter)(dof)) for dof in range(joint.getNumDofs()) for getter in getters)


def _limits(joint: Any, name: str) -> tuple[PlainValue, ...]:
    word = name.removesuffix("_limits").capitalize()
    return _each(joint, f"get{word}LowerLimit", f"get{word}UpperLimit")


def _mimics(joint: Any) -> str:
    """The names of the joints that a joint follows."""
    rows = joint.getGenericJointProperties().mMimicDofProps if joint.getNumDofs() else ()
    return named_set(row.mReferenceJoint.getName() for row in rows if row.mReferenceJoint is not None)


def _efforts(of: DartExpectedJoint) -> tuple[PlainValue, ...]:
    effort = math.inf if (limit := of.body.joint.effort_limit) is None else limit
    return of.each(-effort, effort)


JOINT = Items[Any, DartExpectedJoint](
    {
        "actuator": (lambda joint: plain(joint.getActuatorType()), "FORCE"),
        "actuators": (
            lambda joint: _each(joint, "getActuatorTypeForDof"),
            lambda of: ("FORCE",) * VELOCITY_SIZE[of.body.joint.kind],
        ),
        "enforced": (
            lambda joint: joint.areLimitsEnforced(),
            lambda of: of.body.joint.position_limits is not None,
        ),
        "coupled": (lambda joint: joint.isUsingCouplerConstraint(), False),
        "kinematic": (lambda joint: joint.isKinematic(), False),
        "mimics": (_mimics, ""),
        # DART's own spring and damping are none but for the damping that stands for the armature
        "spring": (lambda joint: _each(joint, "getSpringStiffness"), lambda of: of.each(0.0)),
        "rest": (lambda joint: _each(joint, "getRestPosition"), lambda of: of.each(0.0)),
        "damping": (
            lambda joint: _each(joint, "getDampingCoefficient"),
            lambda of: of.each(of.body.joint.armature / of.timestep),
        ),
        "dry_friction": (
            lambda joint: _each(joint, "getCoulombFriction"),
            lambda of: of.each(of.body.joint.dry_friction),
        ),
        "command": (lambda joint: _each(joint, "getCommand"), lambda of: of.each(0.0)),
    }
) | Items[Any, DartExpectedJoint].named(
    _limits,
    {
        "position_limits": lambda of: of.each(*(of.body.joint.position_limits or (-math.inf, math.inf))),
        "velocity_limits": lambda of: of.each(-math.inf, math.inf),
        "acceleration_limits": lambda of: of.each(-math.inf, math.inf),
        "force_limits": _efforts,
    },
)
"""As ``joint.BODY.NAME``."""
NODE = Items[Any, Body](
    {
        "kind": (lambda node: type(node).__name__, "BodyNode"),
        "gravity": (lambda node: node.getGravityMode(), True),
        "collidable": (lambda node: node.isCollidable(), True),
        "markers": (lambda node: node.getNumMarkers(), 0),
        "end_effectors": (lambda node: node.getNumEndEffectors(), 0),
        "force": (lambda node: tuple(node.getExternalForceGlobal().tolist()), (0.0,) * 6),
    }
)
"""As ``node.BODY.NAME``, of all nodes of a body."""


def _moments(body: Body) -> EngineValue:
    xx, yy, zz, xy, xz, yz = body.inertial.inertia
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


STATIC_MASS = Items[Any, Body](
    {
        "mass": (lambda inertia: inertia.getMass(), lambda body: body.inertial.mass),
        "centre_of_mass": (
            lambda inertia: tuple(inertia.getLocalCOM().tolist()),
            lambda body: body.inertial.centre_of_mass,
        ),
        "inertia": (lambda inertia: tuple(inertia.getMoment().reshape(-1).tolist()), _moments),
    }
)
"""Of static bodies, whose mass is not in the read-back."""


def inventory(sim: DartSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    sidecar = sim.sidecar
    found = _world(sim.dartpy, sim.world) | SIMULATION.read(sim) | sidecar_labels(sidecar.plain())
    found["group.shapes"] = sim.solver.getCollisionGroup().getNumShapeFrames()
    for index in range(sim.world.getNumSkeletons()):
        skeleton = sim.world.getSkeleton(index)
        found |= SKELETON.read(skeleton, f"skeleton.{skeleton.getName()}")
    for index, (name, body, model) in enumerate(zip(sim.names, sim.bodies, sidecar.models, strict=True)):
        joint, shapes = body.getParentJoint(), [shape for shape in sidecar.shapes if shape.body == name]
        found |= {f"body.{name}.model": model, f"body.{name}.joint": joint.getName()}
        found[f"body.{name}.skeleton"] = body.getSkeleton().getName()
        found[f"body.{name}.shapes"] = tuple(shape.name for shape in shapes)
        found[f"body.{name}.seen"] = tuple(shape.visual for shape in shapes)
        if not body.isReactive():
            found |= STATIC_MASS.read(body.getInertia(), f"body.{name}")
        found |= JOINT.read(joint, f"joint.{name}") | _nodes(name, sim.nodes.of(index))
    found |= {f"velocity_limit.{entry.body}": entry.value for entry in sidecar.velocity_limits}
    return found | {"exact_rotation": sim.exact_rotation} | _parts(sim)


def neutral(sim: DartSimulation) -> dict[str, EngineValue]:
    """The values of an empty world with the same detector."""
    world = sim.dartpy.simulation.World("neutral")
    detector = sim.world.getCollisionDetector().getType().upper()
    world.setCollisionDetector(getattr(sim.dartpy.simulation.CollisionDetectorType, detector))
    options = sim.dartpy.constraint.NsgsFrictionSolver.Options()
    return _world(sim.dartpy, world) | NSGS.read(options, "nsgs")


def _world(dartpy: Any, world: Any) -> dict[str, EngineValue]:
    """The values of a world: threads, sleeping, the solvers of its constraints and the detection of its contacts."""
    solver = world.getConstraintSolver()
    lcp = solver.getBoxedLcpSolver()
    found = WORLD.read(world) | SOLVER.read(solver)
    found |= DEACTIVATION.read(world.getDeactivationOptions(), "deactivation")
    found |= MATRIX_FREE.read(solver.getMatrixFreeContactSolverOptions(), "matrix_free")
    found |= COLLISION.read(solver.getCollisionOption(), "collision")
    return found | (
        NSGS.read(lcp.getOptions(), "nsgs") if isinstance(lcp, dartpy.constraint.NsgsFrictionSolver) else {}
    )


def _detector_field(detector: Any, getter: str) -> PlainValue | None:
    return plain(getattr(detector, getter)()) if hasattr(detector, getter) else None


def _nodes(name: str, nodes: Sequence[Any]) -> dict[str, EngineValue]:
    """The values of a body's nodes; one that differs between them with the name of the node."""
    found: dict[str, EngineValue] = {}
    for node in nodes:
        for key, value in NODE.read(node, f"node.{name}").items():
            if found.setdefault(key, value) != value:
                found[key] = f"{value} on {node.getName()}"
    return found


def _parts(sim: DartSimulation) -> dict[str, EngineValue]:
    """Of every body's material in every layer the numbers of its shapes, and the others that it does not touch: those on nodes
    that are excluded, on its own node, and, for immovable shapes, on all others of that kind."""
    on: dict[str, set[str]] = {}
    static: set[str] = set()
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
                    static.add(part)
    excluded: dict[str, set[str]] = {name: {name} for name in on}
    for node, other in sim.excluded:
        if node in on and other in on:
            excluded[node].add(other)
            excluded[other].add(node)
    found: dict[str, set[str]] = {}
    for node, labels in on.items():
        others = set().union(*(on[name] for name in excluded[node]))
        for part in labels:
            found.setdefault(part, set()).update(others | static if part in static else others)
    values: dict[str, EngineValue] = {f"apart.{part}": named_set(others - {part}) for part, others in found.items()}
    values.update(
        {f"surface.{part}.{key}": values for key, by_part in numbers.items() for part, values in by_part.items()}
    )
    return values


def part_name(body: str, material: str, layer: int) -> str:
    """The name of the shapes of one material of a body in one layer."""
    return f"{body}/{material}/{layer}"


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue], detector: str
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are DART's defaults, ``detector`` that for
    which the setting ``collision_detector`` stands."""
    groups, of = rigid_groups(world), ExpectedWorld(world, settings, detector)
    found = WORLD.expect(of, "", neutral) | SOLVER.expect(of, "", neutral) | SIMULATION.expect(of)
    options = {"deactivation": DEACTIVATION, "matrix_free": MATRIX_FREE, "collision": COLLISION}
    if chosen_solver(world, settings) == "nsgs":
        options["nsgs"] = NSGS
    for prefix, items in options.items():
        found |= items.expect(of, prefix, below(prefix, neutral))
    # DART compares the speeds before contact is solved: bodies at rest have that of the fall of a step
    fall = math.dist((0.0, 0.0, 0.0), world.physics.gravity) * world.physics.timestep
    found["deactivation.mLinearSpeedThreshold"] = float(neutral["deactivation.mLinearSpeedThreshold"]) + fall  # type: ignore[arg-type]
    carriers: list[FilterCarrier] = []
    shapes = 0
    for root, bodies in trees(world).items():
        moves = any(groups[body.name] != "world" for body in bodies)
        found |= SKELETON.expect(ExpectedTree(world, moves), f"skeleton.{root}")
        for body in bodies:
            name, at = body.name, f"body.{body.name}"
            found |= JOINT.expect(DartExpectedJoint(body, world.physics.timestep), f"joint.{name}")
            found |= NODE.expect(body, f"node.{name}")
            found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.skeleton": root}
            found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
            found[f"{at}.seen"] = tuple(shape.visual for shape in body.shapes)
            for part in parts(body, plan):
                label, count = part_name(name, part.material, part.layer), len(part.shapes)
                carriers.append(FilterCarrier(label, name, part.material, part.layer))
                found[f"surface.{label}.friction"] = (part.surface.friction or 0.0,) * count
                found[f"surface.{label}.restitution"] = (part.surface.restitution or 0.0,) * count
                shapes += count
            if groups[name] == "world":
                found |= STATIC_MASS.expect(body, at)
            if body.joint.velocity_limit is not None:
                found[f"velocity_limit.{name}"] = body.joint.velocity_limit
    choice, touching = settings["exact_rotation"], any(groups[carrier.body] != "world" for carrier in carriers)
    found |= {"group.shapes": shapes, "exact_rotation": choice == "always" or (choice == "auto" and not touching)}
    return found | expected_separate(world, plan, carriers)


def chosen_solver(world: World, settings: Settings) -> str:
    """The solver that the setting ``contact_solver`` selects."""
    chosen = str(settings["contact_solver"])
    if chosen != "auto":
        return chosen
    pyramid = world.contact.friction_cone == "pyramid-circumscribed"
    return "dantzig" if only_free_spheres(world) or (pyramid and frictionless(world)) else "nsgs"
