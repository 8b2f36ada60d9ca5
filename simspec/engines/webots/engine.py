"""Webots: its worlds as files, and an installed Webots that steps them.

No number in this package was measured in Webots: it follows the reference manual, the sources of R2023b, and
measurements of the Open Dynamics Engine, of which Webots has a copy. The code that starts and queries a Webots was
tested with a stand-in that has its interface, and never with Webots itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.contact.rules import Rules
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.refinements import no_friction, static_planes
from simspec.engines.kit.settings import Group, Setting, of_mobility
from simspec.engines.kit.simulated import GivenEngine
from simspec.engines.webots.program import INSTALLED
from simspec.engines.webots.simulation import Simulation, read_back
from simspec.language.vocabulary import TREE_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import (
    Level,
    Refinement,
    Support,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.canonical import derived
from simspec.world.contact_pairs import CollisionFilter, solid_shapes
from simspec.world.kinematics import poses, rigid_groups
from simspec.world.types import Body, ReadBack, Vector3, World

# Collision filter. Webots has none except for joints (its collision callback, R2023b): two bodies that a joint connects never
# touch; a joint to a static body connects to all static bodies; bodies connected by hinges and balls alone, all with one
# anchor in the Solids around them, never touch.

ALIKE = 1e-4
"""Metres within which two anchors may be one to Webots."""
ROUND = ("hinge", "ball")


@derived
def excluded_by_joints(world: World) -> tuple[tuple[str, str], ...]:
    """The sorted pairs of bodies that may touch in ``world`` and never do in Webots."""
    groups = rigid_groups(world)
    solid: dict[str, list[str]] = {}
    for body in world.bodies:
        if solid_shapes(body):
            solid.setdefault(groups[body.name], []).append(body.name)
    allowed = CollisionFilter(world)
    found = {
        (min(name, other), max(name, other))
        for first, second in _joined(world)
        for name in solid.get(first, ())
        for other in solid.get(second, ())
        if allowed.may_touch(name, other)
    }
    return tuple(sorted(found))


def _joined(world: World) -> Iterator[tuple[str, str]]:
    """Pairs of rigid groups that Webots excludes from contact."""
    groups = rigid_groups(world)
    bodies = {body.name: body for body in world.bodies}
    anchors = _anchors(world)
    for body in world.bodies:
        if body.joint.kind not in TREE_JOINTS:
            continue
        top: Body | None = body
        first: Vector3 | None = None
        near = True
        while top is not None and top.joint.parent is not None:
            if top.joint.kind in ROUND:
                if first is None:
                    first = anchors[top.name]
                elif math.dist(first, anchors[top.name]) > ALIKE:
                    break
            above = groups[top.joint.parent]
            if near or (first is not None and above != "world"):
                yield groups[body.name], above
            near = False
            top = bodies.get(above)


def _anchors(world: World) -> dict[str, Vector3]:
    """Where joints stand in the Solids around them, at the initial state."""
    placed = poses(world)
    return {
        body.name: frames.compose(frames.inverse(placed[body.joint.parent]), placed[body.name]).position
        for body in world.bodies
        if body.joint.parent is not None
    }


def touches_less(world: World) -> str:
    """A sentence on the pairs of a world that Webots excludes from contact; "" where there is none."""
    pairs = excluded_by_joints(world)
    if not pairs:
        return ""
    (name, other), more = pairs[0], len(pairs) - 1
    others = f" and {more} more pair{'s' if more > 1 else ''}" if more else ""
    return f"{name!r} never touches {other!r}{others}, since Webots excludes joined bodies"


def only_joined(world: World) -> Refinement | None:
    """Not supported where bodies are excluded that no joint joins."""
    groups = rigid_groups(world)
    joined = {frozenset(pair) for pair in _joined(world)}
    solid = {body.name for body in world.bodies if solid_shapes(body)}
    for name, other in world.contact.excluded_bodies:
        pair = frozenset((groups[name], groups[other]))
        if len(pair) > 1 and {name, other} <= solid and pair not in joined:
            return unsupported_if(f"Webots has no filter of bodies, and would let {name!r} touch {other!r}")
    return Refinement(Level.EXACT, "of bodies that a joint joins")


_NOT_WRITTEN = "simspec does not write it for Webots"
_GIVEN = "given as torques and forces before every step, explicit in time: Webots' own are implicit"
_RIGID = "Webots' contacts have a softness in s²/kg, for whatever mass"
_FIRST_ORDER = (
    "by the steps of Webots' copy of ODE in the bodies' coordinates, which are of first order and let joints separate: in "
    "ODE itself, after 2,000 steps of 1 ms, a tumbling body is 2e-4 rad off, two hinges 0.02, seven 0.65 (measured there)"
)
_PASSED = "; bodies that a joint joins never touch, and bodies joined to the ground never touch any of it"
_STOPS = (
    "a joint goes past a limit within the step in which it arrives, and comes back by the joints' error reduction; limits that "
    "do not hold zero between them, and of hinges beyond ±π, are not passed to Webots, and nothing stops there"
)
_MOMENTS = "a row for each point, with the softness of the world: never measured, nor what several points of one pair sum up to"


def _joint(noun: str) -> Support:
    def refine(world: World) -> Refinement | None:
        passed = touches_less(world)
        return Refinement(note=passed) if passed else None

    return approximate(
        _FIRST_ORDER + _PASSED,
        refine,
        f"{noun} by ODE's own steps, of first order, separate; joined bodies never touch",
    )


class Webots(GivenEngine[Simulation]):
    """Webots' copy of ODE, with a .wbt that leaves nothing to a default. Files only: where no Webots is installed, the
    independent reader proves the files (L0). An installed Webots is started without a window, once for every state that
    is set, and controlled through its Supervisor. simspec has never run a real Webots: the interface was tested with a
    stand-in."""

    NAME: ClassVar[str] = "webots"
    TITLE: ClassVar[str] = "Webots"
    DIALECT: ClassVar[str] = "webots"
    DISTRIBUTION: ClassVar[str] = ""
    EXTRA: ClassVar[str] = ""
    NEEDS: ClassVar[Needs] = Needs(program=INSTALLED, elsewhere="Webots R2023b or later, as its makers offer it")
    FILES_ALONE: ClassVar[str] = "no Webots is installed: files only (.wbt, R2023b)"
    RULES: ClassVar[Rules] = Rules("table", "table", "table", "table", "table")
    LAYERS: ClassVar[bool] = False
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.MASS_MATRIX: "Webots solves in the bodies' coordinates and forms no mass matrix",
        Capability.BIAS_FORCE: "Webots gives no forces of inertia",
        Capability.ENERGY: "Webots gives no energies",
        Capability.CONTACTS: "Webots reports where a Solid is touched, but neither the other body, the direction nor the force",
        Capability.INVENTORY: "all fields of Webots' nodes are compared as those of the file are, and it reports nothing else",
        Capability.PAIR_DETECTION: "Webots reports the contacts of a completed step, and of no state",
        Capability.NATIVE_CONTROLLERS: "simspec writes no motors",
        Capability.FOREIGN_FILES: "simspec does not load users' worlds through Webots",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.driven("Webots"),
        **exactly(
            *(Feature.FRICTION, Feature.FRICTION_PAIRS, *features.RESTITUTIONS, Feature.SELF_LOCKING),
            *(Feature.EVEN_PRESSURE, Feature.MASS_RATIO),
        ),
        **shape_kinds("Webots", ("sphere", "box", "capsule")),
        Feature.JOINT_HINGE: _joint("hinges"),
        Feature.JOINT_SLIDE: _joint("slides"),
        Feature.JOINT_BALL: _joint("balls"),
        Feature.JOINT_FREE: approximate(
            "by the steps of Webots' copy of ODE, which turn bodies to first order: in ODE itself a tumbling body is 2e-4 rad "
            "off after 2,000 steps of 1 ms (measured there)",
            short="free bodies turn by ODE's own steps, of first order: 2e-4 rad after 2 s at 1 ms in ODE itself",
        ),
        Feature.JOINT_SEVERAL: never("Webots' bodies have mass, and between two joints of one body stands one without"),
        Feature.LIMIT_POSITION: approximate(
            _STOPS, short="a joint goes past a limit for some steps; hinges beyond ±π have no stops"
        ),
        Feature.BALL_LIMIT: never("a BallJoint stops three angles about axes, and no angle of the whole turn"),
        Feature.DRY_FRICTION: exact("staticFriction, a motor of speed 0 with this largest effort"),
        **for_each(via_api(_GIVEN), *features.DAMPERS_AND_SPRINGS),
        **for_each(never("Webots has no armature, and contact would ignore a computed one"), *features.ARMATURES),
        Feature.TREE_DEPTH: never("untested: whether Webots reads Solids nested so deep"),
        Feature.SHAPE_CYLINDER: approximate(
            "by Webots' copy of ODE, whose cylinders overlook 4 of 100 overlaps with boxes in ODE itself, and meet each other "
            "and capsules along a line in one point (measured there)",
            short="cylinders by ODE's own code, which overlooks some overlaps and has one point along a line",
        ),
        Feature.SHAPE_PLANE: static_planes("a Plane cannot be of a Solid that moves, as {name} does"),
        **for_each(never("Webots' contact begins where shapes touch"), *features.MARGINS),
        Feature.SURFACE_VELOCITY: never("in Webots only Tracks have surfaces that move, which simspec does not write"),
        Feature.MATERIALS_PER_BODY: never("a Solid has one contactMaterial"),
        Feature.TORSIONAL_FRICTION: approximate(
            _MOMENTS, short="torque about a normal, point by point: never measured"
        ),
        Feature.ROLLING_FRICTION: approximate(
            f"{_MOMENTS}; in ODE itself 0.7 of it between the axes of its pyramid (measured there)",
            short="torque across a normal, point by point: never measured; 0.7 of it between the axes in ODE",
        ),
        Feature.HARDNESS_COMMON: exact("softERP 0.01, with which ODE itself has the common law (measured there)"),
        **for_each(never(_RIGID), *features.COMPLIANCES),
        **for_each(never(_NOT_WRITTEN), Feature.KINEMATIC, Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS),
        Feature.CONE_ELLIPTIC: approximate(
            "the circumscribed pyramid on ODE's own axes: up to 1.41 times the friction between them",
            no_friction,
            "a pyramid: between its axes friction is up to 1.41 times that of the cone",
        ),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: approximate(
            "on ODE's own axes: along the world's x and across it where the normal is within 45° of z, along z elsewhere",
            no_friction,
            "a pyramid whose axes are the world's x and y on the ground, and others on walls",
        ),
        Feature.CONE_PYRAMID_INSCRIBED: never("simspec cannot tell Webots the axes of its pyramid"),
        Feature.PASSING_PAIRS: never("Webots has no contact of two materials without contact"),
        Feature.COLLISION_GROUPS: never("Webots has no groups that pass through each other"),
        Feature.EXCLUDED_PAIRS: exact("of bodies that a joint joins", refine=only_joined),
        Feature.TOUCHING_PAIRS: never("bodies that a joint joins never touch in Webots"),
        Feature.CONTROL_NATIVE: never("simspec writes no motors, whose controllers follow speeds"),
        **for_each(
            never("simspec gives Webots no constraints outside the tree"),
            *(*features.CONSTRAINTS, Feature.SUM_DRY_FRICTION, Feature.SUM_LIMITS),
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "softness": Setting(
            1e-10,
            "softCFM and forceDependentSlip of every contact (m/(N s)): redundant points share their forces by it. 0, which "
            "ODE does not solve, Webots takes for its own number.",
            minimum=1e-15,
            at_most=of_mobility,
            group=Group.SOFTNESS,
        ),
        "joint_softness": Setting(
            1e-10,
            "CFM of the world, of joints and dry friction. Webots' own default, 1e-5, lets joints under 1 N part by 1e-5 m/s.",
            minimum=1e-15,
            group=Group.JOINTS,
        ),
        "joint_error_reduction": Setting(
            0.2,
            "ERP of the world: the share of a joint's parting, and of an overrun limit, that a step takes back. Webots' own.",
            minimum=0.0,
            maximum=1.0,
            group=Group.JOINTS,
        ),
        "contact_points": Setting(
            100,
            "maxContactJoints: the points that two shapes may touch in at once, deepest first. Webots' own default, 10, leaves "
            "out some of a box's or cylinder's.",
            minimum=1,
            group=Group.BOUNDS,
        ),
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = ()
    ACCEPTED_CONES: ClassVar[Mapping[str, str]] = {"elliptic": "pyramid-circumscribed"}

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> Simulation:
        return Simulation(folder, sidecar)

    def _read_model(self) -> ReadBack:
        return read_back(self._simulation)

    def ready(self) -> None:
        self._simulation.live()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
