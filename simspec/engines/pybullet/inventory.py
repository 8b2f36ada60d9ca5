"""The values that PyBullet stores besides the fields of the read-back, and that can act, and what they must be (``expected``,
which runs without PyBullet; its numbers are those of PyBullet's manual and headers).

Three sources, in this order: PyBullet's getters, its dump of the world's memory (a ``.bullet`` file: the solver's numbers, the
collision masks and flags of every link), and the calls made while loading, for values that neither has. Facts marked
*measured*: pybullet 3.2.7.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from simspec.contact import CollisionPart, ContactPlan, parts
from simspec.dialects.pybullet.sidecar import faces_meet, frames_alongside
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
from simspec.engines.pybullet.bullet_file import COLLIDER, Margins, colliders, dump, plain, world_values
from simspec.engines.pybullet.simulation import PybulletSimulation, import_pybullet
from simspec.engines.pybullet.trees import Client, PybulletTree, joint_pose, link_names, pose_at
from simspec.errors import EngineError
from simspec.files import scratch_folder
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
"""The margin (m) that PyBullet keeps around the shapes of links other than bases, whatever the request (measured)."""
ROUND = ("sphere", "capsule", "plane")
"""Kinds of shapes without a margin of their own."""
FIXED = 4
"""Joint type."""
STRONG, UNSAID = 1e9, 0
"""The largest force of a constraint, and what PyBullet reports for the link of a gear's housing where it received none."""
NEVER = 1e30
"""A velocity clamp that never acts."""
SLEEPY, SLOW = 1, 1e-4
"""Activation state that lets a body sleep, and below which v² + ω² it does."""


PARAMETERS: Mapping[str, str] = {
    "fixedTimeStep": "a field of the read-back",
    "gravityAccelerationX": "a field of the read-back",
    "gravityAccelerationY": "a field of the read-back",
    "gravityAccelerationZ": "a field of the read-back",
}
"""Keys of getPhysicsEngineParameters that are not in the inventory, with the reason."""
OF_THE_READ_BACK: Mapping[str | None, set[str]] = {"fixed": set(), "ball": {"damping"}, None: set()}
"""Which values of joints are fields of the read-back, by the kind of joint; of other kinds all are."""
NEUTRAL_MODEL = """<robot name="neutral">
<link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><sphere radius="1"/></geometry></collision></link>
<link name="link"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><sphere radius="1"/></geometry></collision></link>
<joint name="joint" type="spherical"><parent link="base"/><child link="link"/><axis xyz="1 0 0"/></joint></robot>
"""
"""A model without attributes: the values of PyBullet's defaults."""
Settings = Mapping[str, bool | int | float | str]


@dataclass(frozen=True, slots=True)
class ExpectedLink:
    """A link: its name, body, and what it carries (None: the body has no collision shape); ``primary``: whether it is the link
    of the body itself."""

    name: str
    body: Body
    part: CollisionPart | None
    primary: bool
    base: bool

    @property
    def kind(self) -> str | None:
        """Of its joint; None of a link that only carries shapes."""
        return self.body.joint.kind if self.primary else None

    @property
    def surface(self) -> Surface | None:
        return None if self.part is None else self.part.surface


class Collider(NamedTuple):
    link: ExpectedLink
    static: bool
    settings: Settings


def _number(field: str) -> Any:
    """The number of a surface, 0 without shapes."""
    return lambda surface: getattr(surface, field, 0.0) or 0.0


SURFACE = Items[Any, Surface | None](
    {
        "friction": (itemgetter(1), _number("friction")),
        "restitution": (itemgetter(5), _number("restitution")),
        "rolling": (itemgetter(6), _number("rolling_friction")),
        "spinning": (itemgetter(7), _number("torsional_friction")),
        "damping": (itemgetter(8), NEUTRAL),
        "stiffness": (itemgetter(9), NEUTRAL),
    }
)
"""Of getDynamicsInfo, as ``link.NAME.…``."""
MASSLESS = Items[Any, tuple[float, ...]](
    {
        "mass": (itemgetter(0), 0.0),
        "inertia": (lambda dynamics: tuple(dynamics[2]), (0.0, 0.0, 0.0)),
        "place": (lambda dynamics: tuple(dynamics[3]), lambda centre: centre),
        "turn": (lambda dynamics: tuple(dynamics[4]), (0.0, 0.0, 0.0, 1.0)),
    }
)
"""The same of links without mass, which only carry shapes, stand for the world, or are a static base; from their centre."""
JOINT_INFO = {"damping": 6, "friction": 7, "lower": 8, "upper": 9, "max_force": 10, "max_velocity": 11}
"""Numbers of getJointInfo."""


def _joint_items(kind: str | None) -> Items[Any, None]:
    """The values of a joint that are not fields of the read-back for its kind."""
    excluded = OF_THE_READ_BACK.get(kind, set(JOINT_INFO))
    return Items({key: (itemgetter(at), NEUTRAL) for key, at in JOINT_INFO.items() if key not in excluded})


def _flags(of: Collider) -> int:
    # of links other than bases PyBullet keeps its own anchor and threshold, whichever simspec passes (measured)
    flags = int(of.static) * STATIC | (FRICTION_ANCHOR if of.settings["friction_erp"] and of.link.base else 0)
    hardness = None if of.link.surface is None else of.link.surface.hardness
    return flags | (STIFFNESS_DAMPING if hardness is not None and hardness.kind == "stiffness" else 0)


COLLIDERS = Items[Mapping[str, Any], Collider].named(
    lambda collider, name: collider[name],
    {**{member: NEUTRAL for member, why in COLLIDER.items() if not why}, "collisionFlags": _flags},
)
CONSTRAINT = Items[Any, None](
    {"max_force": (itemgetter(10), STRONG), "erp": (itemgetter(14), 1.0), "auxiliary": (itemgetter(12), UNSAID)}
)
"""Of getConstraintInfo."""
MOTORS: Mapping[str, Mapping[str, EngineValue]] = {
    **{kind: {"mode": "velocity", "targetVelocity": 0.0} for kind in SCALAR_JOINTS},
    "ball": {
        **{"mode": "position", "targetPosition": (0.0, 0.0, 0.0, 1.0), "force": (0.0, 0.0, 0.0)},
        **{"positionGain": 0.0, "velocityGain": 0.0},
    },
}
"""The motor of a ball is off; the force of others is their dry friction."""


def inventory(sim: PybulletSimulation) -> dict[str, EngineValue]:
    """The stored values by name; links by the world's names (:func:`link_names`)."""
    p, sidecar = sim.bullet, sim.sidecar
    names = link_names(sim)
    found = _parameters(p) | sidecar_labels(sidecar.plain()) | {"sidecar.bodies": listed(sim.names)}
    # contacts are solved in the order in which the trees were loaded
    found["trees"] = listed([instance.bodies[0] for instance in sidecar.instances])
    for tree, instance in zip(sim.trees, sidecar.instances, strict=True):
        found[f"tree.{instance.bodies[0]}.model"] = instance.model
        for body, joint, shapes, places in zip(
            instance.bodies, instance.joints, instance.shapes, instance.visual_only, strict=True
        ):
            found |= _body_labels(body, joint, tuple(shapes), tuple(places))
        for link in [link.link for link in tree.links] + [link for link, _ in tree.copies]:
            found[f"link.{names[tree.uid, link]}.layer"] = sim.layer[tree.uid, link]
    for frame in sidecar.frames or ():
        found |= _body_labels(frame.name, frame.joint, (), ()) | {f"body.{frame.name}.on": frame.parent}
    found["count.bodies"] = p.getNumBodies()
    found["count.constraints"] = p.getNumConstraints()
    for constraint in sim.stored_constraints:
        info = p.getConstraintInfo(constraint.number)
        found |= CONSTRAINT.read(info, f"constraint.{constraint.name}")
    found["count.user_data"] = sum(p.getNumUserData(tree.uid) for tree in sim.trees)
    blocks = dump(p)
    found |= world_values(blocks)
    masks = {}
    margins = Margins(blocks)
    for key, shape, collider in colliders([tree.uid for tree in sim.trees], blocks):
        if key not in names:
            raise EngineError("pybullet", f"stores a link {key} that the sidecar does not name")
        if p.getCollisionShapeData(*key):  # without shapes nothing touches it
            name = names[key]
            masks[name] = (collider["collisionFilterGroup"], collider["collisionFilterMask"])
            found |= COLLIDERS.read(collider, f"collider.{name}")
            found[f"shape.{name}.margins"] = margins.of(shape)
    for tree in sim.trees:
        found |= _links(sim, tree, names)
    return found | _calls(sim, names) | _excluded(masks, _disabled(sim, names))


def _body_labels(
    name: str, joint: str, shapes: tuple[str, ...], visual_only: tuple[int, ...]
) -> dict[str, EngineValue]:
    at = f"body.{name}"
    return {f"{at}.joint": joint, f"{at}.shapes": shapes, f"{at}.visual_only": visual_only}


def _parameters(bullet: Any) -> dict[str, EngineValue]:
    parameters = bullet.getPhysicsEngineParameters()
    return {f"parameter.{key}": value for key, value in parameters.items() if key not in PARAMETERS}


def neutral(sim: PybulletSimulation) -> dict[str, EngineValue]:
    """PyBullet's defaults: of its world, and of the colliders, the surface and the joint of a model without attributes."""
    module = import_pybullet()
    p = Client(module, module.connect(module.DIRECT))
    try:
        with scratch_folder("bullet") as place:
            (place / "neutral.urdf").write_text(NEUTRAL_MODEL, encoding="utf-8")
            uid = p.loadURDF(str(place / "neutral.urdf"))
            blocks = dump(p)
        found = world_values(blocks) | _parameters(p)
        for row in (row for block in blocks if block.code == "MBLC" for row in block.rows):
            kind = "base" if int(row["m_link"]) < 0 else "link"
            found |= COLLIDERS.read(plain(row["m_colObjData"]), f"collider.{kind}")
        found |= SURFACE.read(p.getDynamicsInfo(uid, 0), "link")
        info = p.getJointInfo(uid, 0)
        return found | {f"joint.{name}": info[place] for name, place in JOINT_INFO.items()}
    finally:
        p.disconnect()


def _links(sim: PybulletSimulation, tree: PybulletTree, names: Mapping[tuple[int, int], str]) -> dict[str, EngineValue]:
    """The values of every link by getDynamicsInfo and getJointInfo besides the fields of the read-back."""
    p = sim.bullet
    kinds = {link.link: link.kind for link in tree.links}
    found: dict[str, EngineValue] = {}
    for link in range(-1, p.getNumJoints(tree.uid)):
        name, kind = names[tree.uid, link], kinds.get(link)
        dynamics = p.getDynamicsInfo(tree.uid, link)
        found[f"link.{name}.body_type"] = dynamics[10]
        found |= SURFACE.read(dynamics, f"link.{name}")
        if not dynamics[0]:
            found |= MASSLESS.read(dynamics, f"link.{name}")
        if link < 0:
            continue
        info = p.getJointInfo(tree.uid, link)
        found |= _joint_items(kind).read(info, f"joint.{name}")
        if kind is None:
            found |= {f"joint.{name}.type": info[2], f"joint.{name}.parent": names[tree.uid, info[16]]}
            # where the link is on its body: (0, 0, 0) and no rotation, as distances in m and rad
            parent = pose_at(p.getDynamicsInfo(tree.uid, info[16]), 3)
            place = joint_pose(info, parent, pose_at(dynamics, 3))
            found[f"joint.{name}.place"] = _rounded(place.position)
            found[f"joint.{name}.turn"] = _rounded(place.quaternion[1:])
    return found


def _rounded(values: Iterable[float]) -> tuple[float, ...]:
    """Zero where only round-off of frames put together is left (1e-12 m and rad, the tolerance of text)."""
    return tuple(0.0 if abs(value) <= 1e-12 else value for value in values)


def _calls(sim: PybulletSimulation, names: Mapping[tuple[int, int], str]) -> dict[str, EngineValue]:
    """The calls made while loading, under the function's name; pairs that do not touch are left to :func:`_excluded`, masks and
    gravity to the dump and the read-back."""
    found: dict[str, EngineValue] = {}
    modes = {sim.bullet.VELOCITY_CONTROL: "velocity", sim.bullet.POSITION_CONTROL: "position"}
    loaded = iter(sim.trees)
    for function, positional, named in sim.calls:
        if function == "setPhysicsEngineParameter":
            found.update({f"calls.{function}.{key}": value for key, value in named.items()})
        elif function == "changeDynamics":
            name = names[positional[0], positional[1]]
            found.update({f"calls.{function}.{name}.{key}": value for key, value in named.items()})
        elif function in ("setJointMotorControl2", "setJointMotorControlMultiDof"):
            name = names[positional[0], positional[1]]
            found[f"calls.motor.{name}.mode"] = modes.get(positional[2], str(positional[2]))
            found.update({f"calls.motor.{name}.{key}": _value(value) for key, value in named.items()})
        elif function == "loadURDF":
            name = names[next(loaded).uid, -1]
            found[f"calls.{function}.{name}.flags"] = named["flags"]
            found[f"calls.{function}.{name}.useFixedBase"] = named["useFixedBase"]
        elif function not in ("setCollisionFilterPair", "setCollisionFilterGroupMask", "setGravity", "setTimeStep"):
            found[f"calls.{function}"] = int(found.get(f"calls.{function}", 0)) + 1  # type: ignore[arg-type]
    return found


def _value(value: Any) -> EngineValue:
    return tuple(value) if isinstance(value, (list, tuple)) else value


def _disabled(sim: PybulletSimulation, names: Mapping[tuple[int, int], str]) -> set[tuple[str, str]]:
    """The pairs of links that are excluded from contact, in both orders."""
    found: dict[tuple[str, str], bool] = {}
    for function, positional, _ in sim.calls:
        if function == "setCollisionFilterPair":
            uid, other_uid, link, other_link, enabled = positional
            name, other = names[uid, link], names[other_uid, other_link]
            found[name, other] = found[other, name] = not enabled
    return {pair for pair, off in found.items() if off}


def _excluded(masks: Mapping[str, tuple[int, int]], disabled: set[tuple[str, str]]) -> dict[str, EngineValue]:
    """Of every link the others that it does not touch, by Bullet's rule for masks and the pairs that were switched off."""
    kinds: dict[tuple[int, int], list[str]] = {}
    for name, kind in masks.items():
        kinds.setdefault(kind, []).append(name)
    by_kind = {
        (group, mask): frozenset(
            name
            for (other_group, other_mask), kind in kinds.items()
            if not (group & other_mask and other_group & mask)
            for name in kind
        )
        for group, mask in kinds
    }
    pairs: dict[str, set[str]] = {}
    for name, other in disabled:
        pairs.setdefault(name, set()).add(other)
    return {
        f"apart.{name}": named_set((by_kind[kind] | pairs.get(name, set())) - {name}) for name, kind in masks.items()
    }


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are PyBullet's defaults."""
    groups = rigid_groups(world)
    found = _expected_world(world, settings, plan, neutral)
    faces = HULL_FACES if faces_meet(world, plan, float(str(settings["collision_margin"]))) else 0
    found |= {"trees": listed(list(trees(world))), "count.bodies": len(trees(world))}
    found["sidecar.bodies"] = listed([body.name for body in world.bodies])
    alongside = frames_alongside(world)
    for body in world.bodies:
        visual_only = tuple(place for place, shape in enumerate(body.shapes) if not shape.collision)
        found |= _body_labels(body.name, body.joint.name, tuple(shape.name for shape in body.shapes), visual_only)
        if body.name in alongside:
            found[f"body.{body.name}.on"] = body.joint.parent or ""
        motor = dict(MOTORS.get(body.joint.kind, {}))
        if body.joint.kind in SCALAR_JOINTS:
            motor["force"] = body.joint.dry_friction
        found |= {f"calls.motor.{body.name}.{key}": value for key, value in motor.items()}
    solid = []
    for root, tree in trees(world).items():
        bodies = tuple(body for body in tree if body.name not in alongside)
        links = list(_tree_links(bodies, plan))
        base = root if links[0].base else f"{root}/world"
        welded = _welded(bodies, base != root)
        for link in links:
            found |= _link(link, lumped_inertial(world, link.body), settings, neutral)
            if link.part is not None:
                solid.append(FilterCarrier(link.name, link.body.name, link.part.material, link.part.layer))
                static = groups[link.body.name] == "world" if link.base else link.body.name in welded[link.primary]
                found |= _collider(Collider(link, static, settings), neutral)
        if base != root:
            found |= _changed(base, settings) | SURFACE.expect(None, f"link.{base}", below("link", neutral))
            found |= MASSLESS.expect((0.0, 0.0, 0.0), f"link.{base}") | {f"link.{base}.body_type": MULTI_BODY}
        found |= {f"tree.{root}.model": bodies[0].model, f"calls.loadURDF.{base}.flags": LOAD_FLAGS | faces}
        found[f"calls.loadURDF.{base}.useFixedBase"] = int(bodies[0].joint.kind != "free")
    for name in free_rigid(world) if settings["sleeping"] else ():
        found[f"calls.changeDynamics.{name}.activationState"] = SLEEPY
        found[f"calls.changeDynamics.{name}.sleepThreshold"] = SLOW
    return found | expected_separate(world, plan, solid)


def _welded(bodies: tuple[Body, ...], world_link: bool) -> tuple[frozenset[str], frozenset[str]]:
    """Of a tree the bodies whose copies, and those whose own links, PyBullet takes for unmoved.

    On a base without mass it walks up from a link over fixed joints, and stops before link 0, whatever joint that has
    (measured): a body that is welded to the first link counts as unmoved although it moves; contact with it is found all the
    same.
    """
    if bodies[0].joint.kind == "free":
        return frozenset(), frozenset()
    first = 0 if world_link else 1
    welded: set[str] = set()
    for number, body in enumerate(bodies):
        above = next((k for k, entry in enumerate(bodies) if entry.name == body.joint.parent), -1)
        if (body.joint.kind == "fixed" and (above <= first or bodies[above].name in welded)) or number < first:
            welded.add(body.name)
    copies = {body.name for number, body in enumerate(bodies) if number <= first or body.name in welded}
    return frozenset(copies), frozenset(welded)


def _tree_links(bodies: tuple[Body, ...], plan: ContactPlan) -> Iterator[ExpectedLink]:
    """The links of one tree but for one that stands for the world. A root on a joint, or fixed with a mass, is not the base."""
    root = bodies[0]
    on_base = root.joint.kind == "free" or (root.joint.kind == "fixed" and not root.inertial.mass)
    for body in bodies:
        first, *copies = parts(body, plan) or (None,)
        yield ExpectedLink(body.name, body, first, True, on_base and body is root)
        for part in copies:
            yield ExpectedLink(f"{body.name}__{part.material}.{part.layer}", body, part, False, False)


def _expected_world(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The world's numbers, and the parameters that simspec passes."""
    found = {name: value for name, value in neutral.items() if name.startswith(("world.", "count.", "parameter."))}
    solid = (shape for body in world.bodies for part in parts(body, plan) for shape in part.shapes)
    if fields := sum(shape.kind == "heightfield" for shape in solid):
        found["count.QBVH"] = fields  # the tree of boxes around the triangles of each
    laws = meeting_laws(world).values()
    rough = any(part.surface.friction for body in world.bodies for part in parts(body, plan))
    elliptic = rough and world.contact.friction_cone == "elliptic"
    mode = int(neutral["world.solverInfo.solverMode"])  # type: ignore[arg-type]
    closed = any(constraint.kind != "follow" for constraint in world.constraints)
    joint_erp = 1.0 if closed else settings["joint_erp"]
    given: dict[str, EngineValue] = {
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
        given |= {"contactERP": settings["contact_erp"], "contactSlop": settings["contact_slop"]}
        found["world.solverInfo.erp2"] = settings["contact_erp"]
        found["world.solverInfo.linearSlop"] = settings["contact_slop"]
    found |= {f"calls.setPhysicsEngineParameter.{name}": value for name, value in given.items()}
    for constraint in world.constraints:
        found |= CONSTRAINT.expect(None, f"constraint.{constraint.name}")
    if world.constraints:
        found["calls.createConstraint"] = found["calls.changeConstraint"] = len(world.constraints)
    return found | {"count.constraints": len(world.constraints), "count.user_data": 0}


def _changed(name: str, settings: Settings) -> dict[str, EngineValue]:
    """The arguments of changeDynamics for every link."""
    given: dict[str, EngineValue] = {
        "linearDamping": 0.0,
        "angularDamping": 0.0,
        "maxJointVelocity": NEVER,
        "contactProcessingThreshold": settings["contact_processing_threshold"],
        "collisionMargin": settings["collision_margin"],
    }
    if settings["friction_erp"]:
        given["frictionAnchor"] = 1
    return {f"calls.changeDynamics.{name}.{key}": value for key, value in given.items()}


def _link(
    link: ExpectedLink, inertial: Inertial, settings: Settings, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """Of a link; ``inertial``: that of its body in PyBullet."""
    at, joint = f"link.{link.name}", f"joint.{link.name}"
    found = _changed(link.name, settings) | SURFACE.expect(link.surface, at, below("link", neutral))
    found |= {f"{at}.body_type": MULTI_BODY, f"{at}.layer": 0 if link.part is None else link.part.layer}
    hardness = None if link.surface is None else link.surface.hardness
    if hardness is not None and hardness.kind == "stiffness":
        # two links' springs are in series, and their dampers add up
        found |= {f"{at}.stiffness": 2.0 * hardness.stiffness, f"{at}.damping": hardness.damping / 2.0}
    if not link.primary:
        found |= MASSLESS.expect((0.0, 0.0, 0.0), at) | {f"{joint}.type": FIXED, f"{joint}.parent": link.body.name}
        found |= {f"{joint}.place": (0.0, 0.0, 0.0), f"{joint}.turn": (0.0, 0.0, 0.0)}
    elif not inertial.mass:
        found |= MASSLESS.expect(inertial.centre_of_mass, at)
    if not link.base:
        found |= _joint_items(link.kind).expect(None, joint, below("joint", neutral))
    return found


def _collider(of: Collider, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
    link, at = of.link, f"collider.{of.link.name}"
    found = COLLIDERS.expect(of, at, below("collider.base" if link.base else "collider.link", neutral))
    margin = float(np.float32(of.settings["collision_margin"] if link.base else LINK_MARGIN))
    edged = [shape for shape in (link.part.shapes if link.part else ()) if shape.kind not in ROUND]
    found[f"shape.{link.name}.margins"] = (margin,) * len(edged)
    if link.base:
        found[f"{at}.contactProcessingThreshold"] = of.settings["contact_processing_threshold"]
    return found
