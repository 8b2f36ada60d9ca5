"""What PyBullet's inventory must be (``pybullet_inventory.py``), from the world and the settings that follow from it alone.

Runs outside the engine's process, without PyBullet: its numbers stand here as PyBullet's manual and headers give them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from simspec.contact.plan import CollisionPart, ContactPlan, parts
from simspec.dialects.pybullet.contact import faces_meet
from simspec.dialects.pybullet.sidecar import held_beside
from simspec.engines.kit.inventory import Carrier, expected_apart, listed
from simspec.engines.pybullet.bullet_file import COLLIDER
from simspec.engines.pybullet.inventory import JOINT_INFO, OF_THE_READ_BACK
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.contact_pairs import meeting_laws
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import free_rigid, rigid_groups, trees
from simspec.world.types import Body, EngineValue, Inertial, Surface, World

LOAD_FLAGS = 2 | 8 | 128 | 8192 | 131072
"""URDF_USE_INERTIA_FROM_FILE, _SELF_COLLISION, _IMPLICIT_CYLINDER, _MAINTAIN_LINK_ORDER, _SELF_COLLISION_INCLUDE_PARENT."""
HULL_FACES = 4096
"""URDF_INITIALIZE_SAT_FEATURES."""
MULTI_BODY = 2
"""Body type of getDynamicsInfo."""
STATIC, STIFFNESS_DAMPING, FRICTION_ANCHOR = 1, 128, 512
"""Flags of a collider: cannot move; has a stiffness and a damping; friction remembers where it took hold."""
NO_CONE = 2048
"""Mode of the solver: friction along each of two axes for itself."""
LINK_MARGIN = 0.001
"""The margin (m) that PyBullet keeps around the shapes of links other than bases, whatever it is told (measured)."""
ROUND = ("sphere", "capsule", "plane")
"""Kinds of shapes without a margin of their own."""
FIXED = 4
"""Joint type."""
STRONG, UNSAID = 1e9, 0
"""The largest force of a constraint, and what PyBullet reports for the link of a gear's housing where it was told none."""
NEVER = 1e30
"""A velocity clamp that never acts."""
SLEEPY, SLOW = 1, 1e-4
"""Activation state that lets a body sleep, and below which v² + ω² it does."""


@dataclass(frozen=True, slots=True)
class _Link:
    """A link: its name, body, and what it carries (None: the body has no collision shape); ``own``: the body's own link."""

    name: str
    body: Body
    part: CollisionPart | None
    own: bool
    base: bool


def expected(
    world: World,
    settings: Mapping[str, bool | int | float | str],
    plan: ContactPlan,
    neutral: Mapping[str, EngineValue],
) -> dict[str, EngineValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``; ``neutral`` are PyBullet's own values."""
    groups = rigid_groups(world)
    sleepers = free_rigid(world) if settings["sleeping"] else frozenset()
    found = _world(world, settings, plan, neutral)
    faces = HULL_FACES if faces_meet(world, plan, float(str(settings["collision_margin"]))) else 0
    found["trees"] = listed(list(trees(world)))
    found |= {f"tree.{root}.model": bodies[0].model for root, bodies in trees(world).items()}
    found |= {f"body.{body.name}.joint": body.joint.name for body in world.bodies}
    found |= {f"body.{body.name}.shapes": tuple(shape.name for shape in body.shapes) for body in world.bodies}
    found |= {
        f"body.{body.name}.visual_only": tuple(i for i, shape in enumerate(body.shapes) if not shape.collision)
        for body in world.bodies
    }
    found["count.bodies"] = len(trees(world))
    found["sidecar.bodies"] = listed([body.name for body in world.bodies])
    beside = held_beside(world)
    found |= {f"body.{body.name}.on": body.joint.parent or "" for body in world.bodies if body.name in beside}
    solid = []
    for root, tree in trees(world).items():
        bodies = tuple(body for body in tree if body.name not in beside)
        links = list(_tree_links(bodies, plan))
        world_link = not links[0].base
        welded = _welded(bodies, world_link)
        for link in links:
            found.update(_link(link, lumped_inertial(world, link.body), settings, neutral))
            if link.part is not None:
                solid.append(Carrier(link.name, link.body.name, link.part.material, link.part.layer))
                still = groups[link.body.name] == "world" if link.base else link.body.name in welded[link.own]
                found.update(_collider(link, still, settings, neutral))
        if world_link:
            name = f"{root}/world"
            found |= _told(name, settings) | _empty(name) | _untouched(name, neutral)
            found[f"link.{name}.body_type"] = MULTI_BODY
        base = f"{root}/world" if world_link else root
        found[f"calls.loadURDF.{base}.flags"] = LOAD_FLAGS | faces
        found[f"calls.loadURDF.{base}.useFixedBase"] = int(bodies[0].joint.kind != "free")
    for name in sleepers:
        found[f"calls.changeDynamics.{name}.activationState"] = SLEEPY
        found[f"calls.changeDynamics.{name}.sleepThreshold"] = SLOW
    for body in world.bodies:
        found.update(_motor(body))
    return found | expected_apart(world, plan, solid)


def _welded(bodies: tuple[Body, ...], world_link: bool) -> tuple[frozenset[str], frozenset[str]]:
    """Of a tree the bodies whose copies, and those whose own links, PyBullet takes for unmoved.

    On a base without mass it walks up from a link over fixed joints, and stops before link 0, whatever joint that has
    (measured): what is welded to the first link counts as unmoved although it moves; contact with it is found all the same.
    """
    if bodies[0].joint.kind == "free":
        return frozenset(), frozenset()
    first = 0 if world_link else 1
    own: set[str] = set()
    for number, body in enumerate(bodies):
        above = next((k for k, one in enumerate(bodies) if one.name == body.joint.parent), -1)
        if (body.joint.kind == "fixed" and (above <= first or bodies[above].name in own)) or number < first:
            own.add(body.name)
    copies = {body.name for number, body in enumerate(bodies) if number <= first or body.name in own}
    return frozenset(copies), frozenset(own)


def _tree_links(bodies: tuple[Body, ...], plan: ContactPlan) -> Iterator[_Link]:
    """The links of one tree but for one that stands for the world. A root on a joint, or fixed with a mass, is not the base."""
    root = bodies[0]
    on_base = root.joint.kind == "free" or (root.joint.kind == "fixed" and not root.inertial.mass)
    for body in bodies:
        first, *copies = parts(body, plan) or (None,)
        yield _Link(body.name, body, first, True, on_base and body is root)
        for part in copies:
            yield _Link(f"{body.name}__{part.material}.{part.layer}", body, part, False, False)


def _world(
    world: World,
    settings: Mapping[str, bool | int | float | str],
    plan: ContactPlan,
    neutral: Mapping[str, EngineValue],
) -> dict[str, EngineValue]:
    """The world's own numbers, and what its parameters were set to."""
    found = {name: value for name, value in neutral.items() if name.startswith(("world.", "count.", "parameter."))}
    solid = (shape for body in world.bodies for part in parts(body, plan) for shape in part.shapes)
    if fields := sum(shape.kind == "heightfield" for shape in solid):
        found["count.QBVH"] = fields  # the tree of boxes around the triangles of each
    laws = meeting_laws(world).values()
    rubs = any(part.surface.friction for body in world.bodies for part in parts(body, plan))
    elliptic = rubs and world.contact.friction_cone == "elliptic"
    mode = int(neutral["world.solverInfo.solverMode"])  # type: ignore[arg-type]
    closed = any(constraint.kind != "follow" for constraint in world.constraints)
    joint_erp = 1.0 if closed else settings["joint_erp"]
    told: dict[str, EngineValue] = {
        "numSolverIterations": settings["iterations"],
        "solverResidualThreshold": settings["residual_threshold"],
        "erp": joint_erp,
        "frictionERP": settings["friction_erp"],
        "restitutionVelocityThreshold": max((x.restitution_threshold for x in laws if x.restitution), default=0.0),
        "contactBreakingThreshold": settings["contact_breaking_threshold"],
        "enableConeFriction": int(elliptic),
        "deterministicOverlappingPairs": int(settings["deterministic_pairs"]),
        "numSubSteps": 0,
    }
    found["world.solverInfo.numIterations"] = found["parameter.numSolverIterations"] = settings["iterations"]
    found["world.solverInfo.erp"] = joint_erp
    found["world.solverInfo.solverMode"] = mode & ~NO_CONE if elliptic else mode | NO_CONE
    if not any(law.hardness.kind == "native" for law in laws):
        told |= {"contactERP": settings["contact_erp"], "contactSlop": settings["contact_slop"]}
        found["world.solverInfo.erp2"] = settings["contact_erp"]
        found["world.solverInfo.linearSlop"] = settings["contact_slop"]
    found |= {f"calls.setPhysicsEngineParameter.{name}": value for name, value in told.items()}
    for constraint in world.constraints:
        held: dict[str, EngineValue] = {"max_force": STRONG, "erp": 1.0, "auxiliary": UNSAID}
        found |= {f"constraint.{constraint.name}.{key}": value for key, value in held.items()}
    if world.constraints:
        found["calls.createConstraint"] = found["calls.changeConstraint"] = len(world.constraints)
    return found | {"count.constraints": len(world.constraints), "count.user_data": 0}


def _told(name: str, settings: Mapping[str, bool | int | float | str]) -> dict[str, EngineValue]:
    """What was asked for every link."""
    asked: dict[str, EngineValue] = {
        "linearDamping": 0.0,
        "angularDamping": 0.0,
        "maxJointVelocity": NEVER,
        "contactProcessingThreshold": settings["contact_processing_threshold"],
        "collisionMargin": settings["collision_margin"],
    }
    if settings["friction_erp"]:
        asked["frictionAnchor"] = 1
    return {f"calls.changeDynamics.{name}.{key}": value for key, value in asked.items()}


def _link(
    link: _Link, told: Inertial, settings: Mapping[str, bool | int | float | str], neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """Of a link; ``told``: the inertia that PyBullet is told of its body."""
    found = _told(link.name, settings)
    found[f"link.{link.name}.body_type"] = MULTI_BODY
    kind = link.body.joint.kind if link.own else None
    found |= _untouched(link.name, neutral) | (_surface(link.name, link.part.surface) if link.part else {})
    found[f"link.{link.name}.layer"] = link.part.layer if link.part is not None else 0
    if link.own and not told.mass:
        found |= _empty(link.name) | {f"link.{link.name}.place": told.centre_of_mass}
    if not link.own:
        found |= _empty(link.name)
        found |= {f"joint.{link.name}.type": FIXED, f"joint.{link.name}.parent": link.body.name}
        found |= {f"joint.{link.name}.place": (0.0, 0.0, 0.0), f"joint.{link.name}.turn": (0.0, 0.0, 0.0)}
    if not link.base:
        left_out = OF_THE_READ_BACK.get(kind, set(JOINT_INFO))
        found |= {f"joint.{link.name}.{key}": neutral[f"joint.{key}"] for key in JOINT_INFO if key not in left_out}
    return found


def _empty(name: str) -> dict[str, EngineValue]:
    """A link without mass, its inertial frame its own."""
    held: Mapping[str, EngineValue] = {
        "mass": 0.0,
        "inertia": (0.0, 0.0, 0.0),
        "place": (0.0, 0.0, 0.0),
        "turn": (0.0, 0.0, 0.0, 1.0),
    }
    return {f"link.{name}.{key}": value for key, value in held.items()}


def _untouched(name: str, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
    """The surface of a link that has no shapes."""
    held: dict[str, EngineValue] = dict.fromkeys(("friction", "restitution", "rolling", "spinning"), 0.0)
    held |= {key: neutral[f"link.{key}"] for key in ("damping", "stiffness")}
    return {f"link.{name}.{key}": value for key, value in held.items()}


def _surface(name: str, surface: Surface) -> dict[str, EngineValue]:
    """The numbers of a link's shapes. Two links' springs stand in series, and their dampers add up."""
    held: dict[str, EngineValue] = {
        "friction": surface.friction or 0.0,
        "restitution": surface.restitution or 0.0,
        "rolling": surface.rolling_friction or 0.0,
        "spinning": surface.torsional_friction or 0.0,
    }
    if surface.hardness is not None and surface.hardness.kind == "stiffness":
        held |= {"stiffness": 2.0 * surface.hardness.stiffness, "damping": surface.hardness.damping / 2.0}
    return {f"link.{name}.{key}": value for key, value in held.items()}


def _collider(
    link: _Link, still: bool, settings: Mapping[str, bool | int | float | str], neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    kind = "base" if link.base else "link"
    found = {
        f"collider.{link.name}.{member}": neutral[f"collider.{kind}.{member}"]
        for member, why in COLLIDER.items()
        if not why
    }
    # of links other than bases PyBullet keeps its own anchor and threshold, whatever it is told (measured)
    flags = int(still) * STATIC | (FRICTION_ANCHOR if settings["friction_erp"] and link.base else 0)
    if link.part is not None and link.part.surface.hardness is not None:
        flags |= STIFFNESS_DAMPING if link.part.surface.hardness.kind == "stiffness" else 0
    found[f"collider.{link.name}.collisionFlags"] = flags
    margin = float(np.float32(settings["collision_margin"] if link.base else LINK_MARGIN))
    edged = [shape for shape in (link.part.shapes if link.part else ()) if shape.kind not in ROUND]
    found[f"shape.{link.name}.margins"] = (margin,) * len(edged)
    if link.base:
        found[f"collider.{link.name}.contactProcessingThreshold"] = settings["contact_processing_threshold"]
    return found


def _motor(body: Body) -> dict[str, EngineValue]:
    """A hinge's and slide's motor is its dry friction; a ball's is off."""
    if body.joint.kind in SCALAR_JOINTS:
        held: dict[str, EngineValue] = {"mode": "velocity", "targetVelocity": 0.0, "force": body.joint.dry_friction}
    elif body.joint.kind == "ball":
        held = {"mode": "position", "targetPosition": (0.0, 0.0, 0.0, 1.0), "force": (0.0, 0.0, 0.0)}
        held |= {"positionGain": 0.0, "velocityGain": 0.0}
    else:
        held = {}
    return {f"calls.motor.{body.name}.{key}": value for key, value in held.items()}
