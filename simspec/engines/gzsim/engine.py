"""gz sim, Gazebo's simulator, through its Python bindings. No gz sim has ever been asked by this module.

It was written to gz sim's documentation and the sources of its bindings and physics system (gz sim 8 to 10), and tried on a
stand-in of the functions that it calls. Nothing in this package was measured in gz sim; what was measured in DART says so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.contact.rules import Rules
from simspec.engines.gazebo.building import proper_inertia
from simspec.engines.gzsim import bindings
from simspec.engines.gzsim.readback import read_back
from simspec.engines.gzsim.simulation import Simulation
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.efforts import GIVEN_DAMPING, GIVEN_FLUID, GIVEN_GRAVITY_SCALE
from simspec.engines.kit.settings import Setting
from simspec.engines.kit.simulated import SteppedEngine
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.support.declarations import (
    AS_EFFORTS,
    FRAMES_ALONGSIDE,
    Level,
    Refinement,
    Support,
    Table,
    approximate,
    exactly,
    for_each,
    never,
    via_api,
)
from simspec.support.features import COUPLED_CONTACT, Feature
from simspec.world.contact_pairs import solid_shapes
from simspec.world.inertia import lumped
from simspec.world.kinematics import rigid_groups
from simspec.world.types import ReadBack, World

_NO_CONTACT = "simspec tells gz sim no shapes: its Python bindings tell no contacts, so that nothing could be compared"
_GIVEN = "given as efforts at every step, explicit in time: DART's own are implicit"
_NOT_TOLD = "simspec does not tell gz sim of it"
_NO_MATRIX = "gz sim's Python bindings tell nothing of its dynamics"
MICROSECOND = 1e-6
"""s: gz sim's bindings tell times in Python's timedelta, which has no shorter ones."""


def _nothing_solid(world: World) -> Refinement | None:
    """Whatever is said of contact does not matter where there is no solid shape."""
    if any(solid_shapes(body) for body in world.bodies):
        return None
    return Refinement(Level.EXACT, "no shape of this world is solid")


def _only_seen(world: World) -> Refinement | None:
    """Shapes that are seen alone are not told, and do nothing."""
    name = next((shape.name for body in world.bodies for shape in solid_shapes(body)), None)
    return not_told(name)


def not_told(name: str | None) -> Refinement | None:
    """Refused, since the shape ``name`` is solid."""
    return None if name is None else Refinement(Level.UNSUPPORTED, f"{_NO_CONTACT}, and {name!r} is solid")


def _all_weigh(world: World) -> Refinement | None:
    """Refused where a body moves that SDF's reader would not take."""
    groups, told = rigid_groups(world), lumped(world)
    inertials = (
        (body.name, told.get(body.name, body.inertial)) for body in world.bodies if groups[body.name] != "world"
    )
    light = (name for name, inertial in inertials if not proper_inertia(inertial.mass, inertial.inertia))
    name = next(light, None)
    if name is None:
        return None
    return Refinement(
        Level.UNSUPPORTED, f"SDF has no bodies without mass or a moment of inertia that move, as {name!r} does"
    )


def _whole_microseconds(world: World) -> Refinement | None:
    """Refused where the timestep could not be told, nor read."""
    steps = world.physics.timestep / MICROSECOND
    if steps >= 0.5 and abs(steps - round(steps)) < 1e-9 * steps:
        return None
    return Refinement(
        Level.UNSUPPORTED, "gz sim steps whole nanoseconds, and its bindings tell them in whole microseconds"
    )


def _without_contact(*features: Feature) -> dict[Feature, Support]:
    return {feature: dataclasses.replace(never(_NO_CONTACT), refine=_nothing_solid) for feature in features}


class GzSim(SteppedEngine[Simulation]):
    """The simulator gz sim with its physics system, through its Python bindings: poses, velocities and joint states of its
    server's components, efforts as its commands. Files only: where it is not installed, the files are proven (L0). *simspec
    has never run a real gz sim:* the interface follows its documentation and was tested with a stand-in. Mass matrix, bias
    force and
    contact cannot be queried."""

    NAME: ClassVar[str] = bindings.NAME
    TITLE: ClassVar[str] = "gz sim"
    DIALECT: ClassVar[str] = "gazebo"
    DISTRIBUTION: ClassVar[str] = ""
    EXTRA: ClassVar[str] = ""
    NEEDS: ClassVar[Needs] = Needs(program=bindings.INSTALLED, elsewhere=bindings.WANTED)
    FILES_ALONE: ClassVar[str] = (
        "no gz sim is installed that simspec could run: files only. simspec has never run a real gz sim"
    )
    RULES: ClassVar[Rules] = Rules("min", "product")
    LAYERS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.MASS_MATRIX: f"{_NO_MATRIX}: no mass matrix",
        Capability.BIAS_FORCE: f"{_NO_MATRIX}: no forces of inertia",
        Capability.ENERGY: f"{_NO_MATRIX}: no potential energy",
        Capability.INVENTORY: "what gz sim's physics system makes of its components cannot be asked of it",
        Capability.PAIR_DETECTION: _NO_CONTACT,
        Capability.NATIVE_CONTROLLERS: "simspec drives gz sim by efforts",
        Capability.FOREIGN_FILES: "simspec does not load users' worlds through gz sim",
    }
    SUPPORT: ClassVar[Table] = {
        **exactly(
            *(Feature.JOINT_FIXED, Feature.JOINT_HINGE, Feature.JOINT_SLIDE),
            *(Feature.DRY_FRICTION, Feature.LIMIT_EFFORT),
            *(Feature.INITIAL_POSITION, Feature.INITIAL_VELOCITY),
            *(Feature.INERTIA, Feature.INERTIA_FULL, Feature.TREE_SIZE, Feature.TREE_DEPTH),
            *(Feature.SHAPES_PER_BODY, Feature.MATERIALS_PER_BODY, Feature.GRAVITY),
        ),
        **for_each(
            Support(Level.EXACT, "of what cannot move", refine=_all_weigh), Feature.MASSLESS, Feature.INERTIA_SINGULAR
        ),
        Feature.JOINT_FREE: approximate(
            "as DART moves them, which follows the law to round-off (measured there), but told late: gz sim tells pose and "
            "velocity of a link only once it has moved or turned by 1e-6 since it last told them",
            short="pose and velocity of a free body are told only once it has moved or turned by 1e-6",
        ),
        **for_each(never(_NOT_TOLD), Feature.JOINT_BALL, Feature.BALL_LIMIT, Feature.BALL_DAMPING, Feature.BALL_SPRING),
        Feature.JOINT_SEVERAL: never(
            "SDF has no bodies without mass that move, which stand between two joints of one body"
        ),
        Feature.LIMIT_POSITION: Support(Level.EXACT, "limits stop dead within the step, in DART itself"),
        Feature.LIMIT_VELOCITY: Support(Level.EXACT, "not told to gz sim, whose DART would enforce it"),
        Feature.DAMPING: via_api(_GIVEN),
        Feature.SPRING: via_api(_GIVEN),
        **for_each(
            never("DART has no armature, and simspec does not compute it for gz sim"),
            *(Feature.ARMATURE, Feature.BALL_ARMATURE, Feature.FREE_ARMATURE),
        ),
        **{
            Feature(f"shape.{kind}"): Support(Level.EXACT, "seen, and not told to gz sim", refine=_only_seen)
            for kind in SHAPE_KINDS
        },
        Feature.SHAPE_VISUAL: Support(Level.EXACT, "not told to gz sim, whose physics does not know it"),
        **_without_contact(
            *(Feature.SHAPE_MARGIN, Feature.MARGIN_PAIRS, Feature.SURFACE_VELOCITY),
            *(Feature.FRICTION, Feature.FRICTION_PAIRS, Feature.IMPACT_FRICTION),
            *COUPLED_CONTACT,
            *(Feature.RESTITUTION, Feature.RESTITUTION_PAIRS, Feature.RESTITUTION_THRESHOLD),
            *(Feature.TORSIONAL_FRICTION, Feature.ROLLING_FRICTION),
            *(Feature.HARDNESS_COMMON, Feature.HARDNESS_TIME_CONSTANT, Feature.HARDNESS_STIFFNESS),
            *(Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS),
            *(Feature.CONE_ELLIPTIC, Feature.CONE_PYRAMID_INSCRIBED, Feature.CONE_PYRAMID_CIRCUMSCRIBED),
            *(Feature.PASSING_PAIRS, Feature.COLLISION_GROUPS, Feature.EXCLUDED_PAIRS, Feature.TOUCHING_PAIRS),
        ),
        Feature.KINEMATIC: never(_NOT_TOLD),
        Feature.FORCES: via_api(AS_EFFORTS),
        Feature.FRAME: FRAMES_ALONGSIDE,
        Feature.GRAVITY_SCALE: GIVEN_GRAVITY_SCALE,
        Feature.FREE_DAMPING: GIVEN_DAMPING,
        Feature.FLUID: GIVEN_FLUID,
        Feature.TIMESTEP: Support(Level.EXACT, "whole microseconds", refine=_whole_microseconds),
        Feature.CONTROL: via_api("efforts given before every step"),
        Feature.CONTROL_NATIVE: never("simspec drives gz sim by efforts"),
        Feature.SUM: via_api("given as efforts before every step"),
        **for_each(
            never("simspec tells gz sim no constraints outside the tree"),
            *(Feature.CONSTRAINT_LOOP, Feature.CONSTRAINT_COUPLING, Feature.SUM_DRY_FRICTION, Feature.SUM_LIMITS),
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {}
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = ()
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "gz sim is told no shapes",
        "shape.visual": "gz sim is told no shapes",
        "friction_cone": "gz sim is told no shapes",
        "joint.velocity_limit": "not told to gz sim, whose DART would enforce it",
        "static.inertial": "what cannot move is told an inertia of its own where SDF takes none",
    }

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> Simulation:
        return Simulation(folder, sidecar)

    def _held(self) -> ReadBack:
        return read_back(self._simulation, dict(self.UNREADABLE))

    def contacts(self) -> dict[str, np.ndarray]:
        return self._simulation.contacts()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
