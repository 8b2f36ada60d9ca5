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

from simspec.contact import Rules
from simspec.dialects.webots.dialect import JOINTED, LACKING, NO_MOTORS
from simspec.engines.kit.capabilities import FIXED_TIMESTEP, Capability, Deviation
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.refinements import no_friction, static_planes
from simspec.engines.kit.settings import Setting, SettingGroup, of_mobility
from simspec.engines.kit.simulated import GivenEngine
from simspec.engines.webots.program import INSTALLED
from simspec.engines.webots.simulation import WebotsSimulation, read_back
from simspec.language.vocabulary import TREE_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import (
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    shape_kinds,
    unsupported_if,
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
            return unsupported_if(f"Webots has no collision filter of bodies, and {name!r} would touch {other!r}")
    return Refinement(Level.EXACT, JOINTED)


_STOPS = (
    "joints pass a limit within a step and return by error reduction. simspec does not pass limits that exclude zero, "
    "nor those of hinges beyond ±π, and nothing stops there"
)
_MOMENTS = approximate(
    "Webots adds a constraint with the world's softness at each contact point; neither one point nor several have been "
    "measured. See docs/engines/webots.md",
    short="a torque for each contact point, never measured",
)


def _jointed(world: World) -> Refinement | None:
    passed = touches_less(world)
    return Refinement(note=passed) if passed else None


_JOINT = approximate(
    "Webots' copy of ODE integrates in maximal coordinates to first order, in which joints separate. Bodies that a joint joins "
    "never touch, nor do bodies jointed to the ground touch static ones; see docs/engines/webots.md",
    _jointed,
    "joints separate (ODE's integration is of first order), and jointed bodies never touch",
)


class Webots(GivenEngine[WebotsSimulation]):
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
    STEPS_UNMEASURED: ClassVar[str] = "accelerations of single steps were not measured in Webots"
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.TIMESTEP: FIXED_TIMESTEP,
        Capability.MASS_MATRIX: "Webots solves in maximal coordinates and has no mass matrix",
        Capability.BIAS_FORCE: "Webots reports no bias forces",
        Capability.ENERGY: "Webots reports no energies",
        Capability.CONTACTS: "Webots reports contact points of a Solid, but neither the other body, the normal nor the force",
        Capability.INVENTORY: "Webots reports the fields of its nodes only, which simspec compares like those of the file",
        Capability.PAIR_DETECTION: "Webots reports contacts of completed steps only",
        Capability.NATIVE_CONTROLLERS: NO_MOTORS,
        Capability.FOREIGN_FILES: "simspec does not load users' worlds through Webots",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.driven("Webots"),
        **exactly(
            *(Feature.FRICTION, Feature.FRICTION_PAIRS, *features.RESTITUTIONS, Feature.SELF_LOCKING),
            *(Feature.EVEN_PRESSURE, Feature.MASS_RATIO),
        ),
        **shape_kinds("Webots", ("sphere", "box", "capsule")),
        **LACKING,
        **for_each(_JOINT, Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL),
        Feature.JOINT_FREE: approximate(
            "Webots' copy of ODE integrates rotations to first order; see docs/engines/webots.md",
            short="Webots integrates the rotation of free bodies to first order",
        ),
        Feature.LIMIT_POSITION: approximate(
            _STOPS, short="a joint goes past a limit for some steps; hinges beyond ±π have no stops"
        ),
        Feature.DRY_FRICTION: exact(classes.ZERO_VELOCITY_MOTOR),
        **for_each(classes.explicit("Webots"), *features.DAMPERS_AND_SPRINGS),
        Feature.SHAPE_CYLINDER: approximate(
            "Webots has a copy of ODE, which misses some overlaps of cylinders with boxes, and has one contact point where "
            "cylinders touch cylinders or capsules along a line; see docs/engines/webots.md",
            short="ODE misses some overlaps of cylinders with boxes, and has one contact point along a line",
        ),
        Feature.SHAPE_PLANE: static_planes("Webots' Planes are static, and {name} moves"),
        **for_each(_MOMENTS, *features.MOMENTS),
        Feature.HARDNESS_COMMON: exact("simspec sets softERP to 0.01, with which ODE itself has the common law"),
        Feature.CONE_ELLIPTIC: approximate(classes.CIRCUMSCRIBED, no_friction, classes.CIRCUMSCRIBED_SHORT),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: approximate(
            "Webots uses ODE's pyramid axes: the world's x and its perpendicular where the normal is within 45° of z, "
            "the world's z elsewhere",
            no_friction,
            "a pyramid whose axes are the world's x and y on the ground, and others on walls",
        ),
        Feature.EXCLUDED_PAIRS: exact(JOINTED, refine=only_joined),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "softness": Setting(
            1e-10,
            "softCFM and forceDependentSlip of every contact (m/(N s)), which distributes forces among redundant "
            "points. It must be above 0, since Webots replaces 0 by its default.",
            minimum=1e-15,
            at_most=of_mobility,
            group=SettingGroup.SOFTNESS,
        ),
        "joint_softness": Setting(
            1e-10,
            "CFM of the world, of joints and of dry friction. With Webots' default of 1e-5 joints under 1 N separate "
            "at 1e-5 m/s.",
            minimum=1e-15,
            group=SettingGroup.JOINTS,
        ),
        "joint_error_reduction": Setting(
            0.2,
            "ERP of the world: the fraction of a joint's separation, and of a joint limit's violation, that each step "
            "removes. Webots' default.",
            minimum=0.0,
            maximum=1.0,
            group=SettingGroup.JOINTS,
        ),
        "contact_points": Setting(
            100,
            "maxContactJoints: the maximum number of contact points of two shapes; the deepest are kept. Webots' "
            "default of 10 leaves out points of boxes and cylinders.",
            minimum=1,
            group=SettingGroup.BOUNDS,
        ),
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = ()
    ACCEPTED_CONES: ClassVar[Mapping[str, str]] = {"elliptic": "pyramid-circumscribed"}

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> WebotsSimulation:
        return WebotsSimulation(folder, sidecar)

    def _read_model(self) -> ReadBack:
        return read_back(self._simulation)

    def ready(self) -> None:
        self._simulation.live()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
