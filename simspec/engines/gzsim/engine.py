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
from simspec.engines.kit.settings import Setting
from simspec.engines.kit.simulated import GivenEngine
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.support import classes, features
from simspec.support.declarations import (
    EXACT,
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    for_each,
    never,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
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
    """Declarations of contact do not matter where no shape is solid."""
    return None if _solid(world) else Refinement(Level.EXACT, "no shape of this world is solid")


def _only_visual(world: World) -> Refinement | None:
    name = _solid(world)
    return unsupported_if(f"{_NO_CONTACT}, and {name!r} is solid" if name else None)


def _solid(world: World) -> str | None:
    return next((shape.name for body in world.bodies for shape in solid_shapes(body)), None)


def _proper_inertias(world: World) -> Refinement | None:
    """Not supported where a body moves whose inertia SDF's reader rejects."""
    groups, inertials = rigid_groups(world), lumped(world)
    for body in world.bodies:
        inertial = inertials.get(body.name, body.inertial)
        if groups[body.name] != "world" and not proper_inertia(inertial.mass, inertial.inertia):
            return unsupported_if(
                f"SDF has no bodies without mass or a moment of inertia that move, as {body.name!r} does"
            )
    return None


def _whole_microseconds(world: World) -> Refinement | None:
    steps = world.physics.timestep / MICROSECOND
    whole = steps >= 0.5 and abs(steps - round(steps)) < 1e-9 * steps
    return unsupported_if(
        None if whole else "gz sim steps whole nanoseconds, and its bindings tell them in whole microseconds"
    )


class GzSim(GivenEngine[Simulation]):
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
        **classes.driven("gz sim"),
        Feature.DRY_FRICTION: EXACT,
        **for_each(exact("of what cannot move", refine=_proper_inertias), Feature.INERTIA_SINGULAR, Feature.MASSLESS),
        Feature.JOINT_FREE: approximate(
            "as DART moves them, which follows the law to round-off (measured there), but told late: gz sim tells pose and "
            "velocity of a link only once it has moved or turned by 1e-6 since it last told them",
            short="pose and velocity of a free body are told only once it has moved or turned by 1e-6",
        ),
        **for_each(
            never(_NOT_TOLD),
            *(Feature.JOINT_BALL, Feature.BALL_LIMIT, Feature.BALL_DAMPING, Feature.BALL_SPRING, Feature.KINEMATIC),
        ),
        Feature.JOINT_SEVERAL: never(
            "SDF has no bodies without mass that move, which stand between two joints of one body"
        ),
        Feature.LIMIT_POSITION: exact("limits stop dead within the step, in DART itself"),
        Feature.LIMIT_VELOCITY: exact("not told to gz sim, whose DART would enforce it"),
        **for_each(via_api(_GIVEN), Feature.DAMPING, Feature.SPRING),
        **for_each(never("DART has no armature, and simspec does not compute it for gz sim"), *features.ARMATURES),
        **{
            Feature(f"shape.{kind}"): exact("seen, and not told to gz sim", refine=_only_visual) for kind in SHAPE_KINDS
        },
        Feature.SHAPE_VISUAL: exact("not told to gz sim, whose physics does not know it"),
        **for_each(
            dataclasses.replace(never(_NO_CONTACT), refine=_nothing_solid),
            *(*features.MARGINS, Feature.SURFACE_VELOCITY),
            *(*features.CONTACT_LAWS, *features.HARDNESSES, *features.FILTERS),
        ),
        Feature.TIMESTEP: exact("whole microseconds", refine=_whole_microseconds),
        Feature.CONTROL_NATIVE: never("simspec drives gz sim by efforts"),
        **for_each(
            never("simspec tells gz sim no constraints outside the tree"),
            *(*features.CONSTRAINTS, Feature.SUM_DRY_FRICTION, Feature.SUM_LIMITS),
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
