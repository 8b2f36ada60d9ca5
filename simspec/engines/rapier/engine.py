"""Rapier: rigid bodies in single precision, stepped by its own solver under the common law of contact.

Facts marked *measured*: rapier3d 0.36.1, on one thread.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.contact.rules import Rules
from simspec.engines.kit.capabilities import SINGLE, Capability
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.refinements import only_balls_slide, static_or_massless, static_planes
from simspec.engines.kit.settings import Setting, SettingGroup
from simspec.engines.kit.world_simulation import Parts, WorldEngine
from simspec.engines.rapier.approximations import (
    COUPLED,
    CYLINDERS,
    DEVIATIONS,
    SMALL,
    STACKED,
    balls,
    cylinders,
    hull_support,
)
from simspec.engines.rapier.readback import expected, inventory, neutral, read_back
from simspec.engines.rapier.simulation import RapierSimulation
from simspec.support import classes, features
from simspec.support.declarations import Table, approximate, exact, exactly, for_each, never, shape_kinds
from simspec.support.features import Feature

_DRIFT = "Rapier integrates articulated bodies by a different first-order method; see docs/engines/rapier.md"
_NO_JOINTS = "simspec passes no joints to Rapier"
_ASIDE = (
    "Rapier's friction acts along K⁻¹ v, with the mobility K of the contact: oblong bodies are "
    "braked at an angle to their slip"
)
_BOUNCE = (
    "simspec adds an overlap that Rapier's error reduction removes at e times the approach speed. Rapier's own restitution "
    "adds energy where one body hits two; see docs/engines/rapier.md"
)


class Rapier(WorldEngine[RapierSimulation]):
    """Rapier's rigid bodies, by its pipeline with one iteration a step and many sweeps in it."""

    NAME: ClassVar[str] = "rapier"
    TITLE: ClassVar[str] = "Rapier"
    DIALECT: ClassVar[str] = "rapier"
    DISTRIBUTION: ClassVar[str] = "rapier3d"
    EXTRA: ClassVar[str] = "rapier"
    PRECISION: ClassVar[str] = SINGLE
    RULES: ClassVar[Rules] = Rules("table", "table", "table", "table", "table")
    LAYERS: ClassVar[bool] = False
    KEEPS_CONTACTS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.DRY_FRICTION_OFF: _NO_JOINTS,
        Capability.NATIVE_CONTROLLERS: _NO_JOINTS,
        Capability.FOREIGN_FILES: "simspec does not use Rapier's loaders of robot files",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.free_bodies_only("Rapier", _DRIFT),
        **exactly(Feature.HARDNESS_COMMON, *features.FILTERS),
        **shape_kinds("Rapier", ("sphere", "box", "capsule", "cylinder")),
        Feature.SHAPE_SPHERE: exact(
            "Rapier is exact for spheres with a radius of at least 0.1 mm", refine=balls, cases=(SMALL,)
        ),
        Feature.SHAPE_CYLINDER: exact(
            "Rapier's cylinders are exact on planes and spheres. Accept `shape.cylinder` where they may touch other shapes",
            refine=cylinders,
            cases=(CYLINDERS,),
        ),
        Feature.JOINT_FIXED: static_or_massless(
            "Rapier integrates the common centre of mass of {name} and the body that it is fixed to, and simspec's coordinates "
            "are those of one of the two; see docs/engines/rapier.md"
        ),
        Feature.SHAPE_PLANE: static_planes("simspec passes only static planes to Rapier, and {name} moves"),
        Feature.SHAPE_MESH: exact(
            "Rapier resolves hulls whose faces have up to four corners and meet at 1.5° or more; see docs/engines/rapier.md. "
            "Accept `shape.mesh` where hulls may touch each other",
            refine=hull_support,
            cases=(STACKED,),
        ),
        **for_each(classes.LAW_AT_CONTACTS, Feature.FRICTION, Feature.FRICTION_PAIRS),
        **COUPLED,
        **for_each(exact(_BOUNCE), Feature.RESTITUTION, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION_THRESHOLD: exact("contact points that approach more slowly do not bounce"),
        **for_each(
            never("Rapier has one contact softness for dynamic bodies, and one for their contact with static bodies"),
            *features.COMPLIANCES,
            Feature.HARDNESS_PAIRS,
        ),
        **for_each(never("Rapier bounds friction by a circular cone"), *features.PYRAMIDS),
        Feature.CONE_ELLIPTIC: approximate(
            "Rapier's friction model SIMPLIFIED acts along K⁻¹ v, with the mobility K of the contact: "
            "oblong bodies are braked at an angle to their slip, and bodies that slide on several shapes "
            "stop late. Spheres are exact; see docs/engines/rapier.md",
            only_balls_slide("friction model SIMPLIFIED"),
            "bodies that slide on several shapes stop late",
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "iterations": Setting(
            50,
            "Number of sweeps over all contacts in a step (num_internal_pgs_iterations). Fewer add energy in piles "
            "(see docs/engines/rapier.md).",
            minimum=1,
            group=SettingGroup.ACCURACY,
            finer=1000,
        )
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("push-oblong", 0.02, _ASIDE),
        Deviation("stop-oblong", 0.027, _ASIDE),
    )
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "Rapier filters pairs by a hook, and has no named groups"
    }

    PARTS: ClassVar[Parts[RapierSimulation]] = Parts(RapierSimulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        import rapier3d  # noqa: F401
