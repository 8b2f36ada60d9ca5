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
from simspec.engines.kit.settings import Group, Setting
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
from simspec.engines.rapier.simulation import Simulation
from simspec.support import classes, features
from simspec.support.declarations import Table, approximate, exact, exactly, for_each, never, shape_kinds
from simspec.support.features import Feature

_DRIFT = (
    "Rapier's chains of joints step by another law: two hinges are 1e-6 off after 20 steps of 1 ms and 0.24 after 2,000, seven "
    "2.0 (measured), where the round-off of single precision makes 1e-4"
)
_ASIDE = "friction is along K⁻¹ v, K the mobility of the contact: an oblong body is braked up to 1.1° aside of its slip"
_LAW = "the law of the two materials, written into every pair that touches before it is solved"
_BOUNCE = (
    "in the sweeps of all contacts, as an overlap that error reduction undoes at e times the speed of approach: Rapier's own, "
    "added in one sweep after them, makes energy where one body hits two at once (12.5 % at e = 1)"
)


class Rapier(WorldEngine[Simulation]):
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
        Capability.DRY_FRICTION_OFF: "simspec gives Rapier no joints, which alone have dry friction",
        Capability.NATIVE_CONTROLLERS: "simspec gives Rapier no joints, which its motors would move",
        Capability.FOREIGN_FILES: "simspec does not use Rapier's loaders of robot files",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.free_bodies_only("Rapier", _DRIFT),
        **exactly(Feature.HARDNESS_COMMON, *features.FILTERS),
        **shape_kinds("Rapier", ("sphere", "box", "capsule", "cylinder")),
        Feature.SHAPE_SPHERE: exact("balls of at least 0.1 mm of radius", refine=balls, cases=(SMALL,)),
        Feature.SHAPE_CYLINDER: exact(
            "those that may meet more than planes and balls are approximate, and accepted by name",
            refine=cylinders,
            cases=(CYLINDERS,),
        ),
        Feature.JOINT_FIXED: static_or_massless(
            "Rapier would move the common centre of mass of {name} and what it is fixed to, where the coordinates are those of "
            "one of them: 1e-4 of difference after 2 s"
        ),
        Feature.SHAPE_PLANE: static_planes("simspec gives Rapier planes of static bodies only, and {name} moves"),
        Feature.SHAPE_MESH: exact(
            "the convex hull, where no two faces meet at less than 1.5°, none has more than four corners, and on planes the "
            "deepest corner is always one of the face that looks down; hulls that touch balls alone may have any faces. Hulls "
            "that may touch each other are approximate, and accepted by name",
            refine=hull_support,
            cases=(STACKED,),
        ),
        **for_each(exact(_LAW), Feature.FRICTION, Feature.FRICTION_PAIRS),
        **COUPLED,
        **for_each(exact(_BOUNCE), Feature.RESTITUTION, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION_THRESHOLD: exact("points that approach slower do not bounce"),
        **for_each(
            never("Rapier has one softness for all that moves, and one for what meets the still"),
            *features.COMPLIANCES,
            Feature.HARDNESS_PAIRS,
        ),
        **for_each(never("Rapier's friction is bound by a circle"), *features.PYRAMIDS),
        Feature.CONE_ELLIPTIC: approximate(
            "friction model SIMPLIFIED, which takes the points of a pair together, and acts along K⁻¹ v, K the mobility of the "
            "contact: exact for balls; an oblong body is braked up to 1.1° aside of its slip, and a tripod that slides and "
            "spins at 30 rad/s stops 6 % short. Each shape of a body is braked aside of its own, so that on several as feet a "
            "body stops late: by 7 % where four stand under the corners of a cube of even density, by 25 % where it has half "
            "its inertia and its centre of mass near the floor. The other model, COULOMB, is a pyramid",
            only_balls_slide("friction model SIMPLIFIED"),
            "a body that slides on several shapes stops late (7 % on a cube's corners, 25 % at half its inertia)",
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "iterations": Setting(
            50,
            "Sweeps over all contacts in a step (num_internal_pgs_iterations). With 10, 216 spheres gain 52 J of 12627 J.",
            minimum=1,
            group=Group.ACCURACY,
            finer=1000,
        )
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("push-oblong", 0.02, _ASIDE),
        Deviation("stop-oblong", 0.027, _ASIDE),
    )
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "Rapier is told by a hook what touches, and has no groups of that name"
    }

    PARTS: ClassVar[Parts[Simulation]] = Parts(Simulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        import rapier3d  # noqa: F401
