"""Gazebo: its physics library gz-physics with its engine dartsim, which is DART behind SDF.

Facts marked *measured*: gz-physics 5.1.0, libdart 6.12.1, libsdformat 12.3.0, as Debian 12 has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from simspec.contact.rules import Rules
from simspec.engines.gazebo import building
from simspec.engines.gazebo.approximations import CASES, COUPLED, DEVIATIONS, SWEEPS, capsules, cylinders
from simspec.engines.gazebo.readback import expected, inventory, neutral, read_back
from simspec.engines.gazebo.simulation import Simulation
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.efforts import outside_constraints
from simspec.engines.kit.refinements import implicit_damping_armature, leans, no_friction, only_static_planes
from simspec.engines.kit.settings import Group, Setting
from simspec.engines.kit.world_simulation import Parts, WorldEngine
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
    shape_kinds,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.types import World

TINY_FRICTION = 0.001
"""DART treats a friction coefficient of up to this as zero."""
_HULLS = (
    "the convex hull, to the last bit, put into DART's detector ode as a class of geoms of simspec's own, whose points of "
    "contact with everything, up to 16 of a pair, simspec's part in C finds, in place of DART's meshes of triangles"
)
_GIVEN = "given as efforts at every step, explicit in time: DART's own are implicit"
_COPIES = "copies of shapes in layers, of which simspec's filter lets one pair touch"
_FILTER = "by simspec's filter in place of gz-physics' bit masks"
_NO_MOMENT = "DART's contacts have three rows, one normal and two tangential: no torque"
_RIGID = "simspec gives DART's contacts the common law, by numbers that all of them share"
_PREDICTED = (
    "DART multiplies the speed at the end of the step, gravity included: the ratio is e (1 + g dt / v), at 1 m/s"
)
_HOPS = "with a restitution of 0.5 a body hops for ever, 2 mm and 0.16 m/s: g dt alone is above DART's least bounce"
_LIVELY = (
    "with a restitution of 0.8 a body hops for ever, by up to 5 mm, since every bounce adds e g dt; pushed, it slides"
)
_LATE = (
    "between the pyramid's axes, where its friction is 1.41 times that along them, sliders stop late: by 0.5 % at 4 ms"
)
_PYRAMID = "the circumscribed pyramid in place of the elliptic cone, as accepted"


_TINY = Refinement(
    Level.APPROXIMATE,
    f"a coefficient of up to {TINY_FRICTION} is treated as zero",
    short=f"friction of up to {TINY_FRICTION} is none",
)


def _friction(world: World) -> Refinement | None:
    """Friction below DART's least, and by pgs where it can change a normal force, is accepted by name."""
    if any(pair.collide and 0.0 < pair.friction <= TINY_FRICTION for pair in world.contact.pairs):
        return _TINY
    return SWEEPS if ("contact_solver", "pgs") in world.options(Gazebo.NAME).settings and leans(world) else None


class Gazebo(WorldEngine[Simulation]):
    """gz-physics' dartsim: DART's Featherstone dynamics (semi-implicit Euler) and its boxed solvers."""

    NAME: ClassVar[str] = "gazebo"
    TITLE: ClassVar[str] = "Gazebo"
    DIALECT: ClassVar[str] = "gazebo"
    DISTRIBUTION: ClassVar[str] = ""
    EXTRA: ClassVar[str] = ""
    NEEDS: ClassVar[Needs] = building.NEEDS
    CLASHES: ClassVar[Mapping[str, str]] = {
        "dartpy": "each brings a version of libdart, whose symbols one takes for its own (a segmentation fault, measured)"
    }
    RULES: ClassVar[Rules] = Rules("min", "product")
    LAYERS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.NATIVE_CONTROLLERS: "gz-physics' dartsim follows speeds, and simspec does not drive them",
        Capability.FOREIGN_FILES: "simspec does not load users' SDF files through it yet",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.driven("DART"),
        **shape_kinds("Gazebo's DART", ("sphere", "box", "cylinder", "capsule", "plane")),
        Feature.DRY_FRICTION: EXACT,
        Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS,
        Feature.LIMIT_POSITION: exact("limits stop dead within the step"),
        Feature.LIMIT_VELOCITY: exact("not passed to DART, which would enforce it together with the position limits"),
        **for_each(via_api(_GIVEN), *features.DAMPERS_AND_SPRINGS),
        Feature.ARMATURE: implicit_damping_armature(
            TITLE, "a joint's armature by DART's damping in SDF, and an effort against it at every step"
        ),
        Feature.BALL_ARMATURE: never("DART has no armature, and what stands for it is of one axis"),
        Feature.BALL_LIMIT: never("DART limits the components of the rotation vector, and no angle"),
        Feature.SHAPE_PLANE: exact(
            "of bodies that cannot move, as the top of gz-physics' box of 2.1 km: beyond that nothing bears",
            refine=only_static_planes("planes are boxes here, and {name} would move as one"),
        ),
        Feature.SHAPE_CYLINDER: exact(
            "the flat faces touch at the corners of the octagon around the circle", refine=cylinders, cases=CASES
        ),
        Feature.SHAPE_CAPSULE: exact(refine=capsules),
        Feature.SHAPE_MESH: via_api(_HULLS),
        Feature.SURFACE_VELOCITY: never("gz-physics 5 has no velocity of a contact's surface"),
        Feature.FRICTION: exact(
            "up to 0.001 is accepted by name: DART treats it as zero", refine=_friction, cases=(_TINY, SWEEPS)
        ),
        **COUPLED,
        **for_each(via_api(_COPIES), Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION: approximate(
            "e (1 + g dt / v): up to 0.009 above the asked ratio at 1 ms from 1 m/s on; none at all where the body would "
            "leave at less than 0.1 m/s, so that it settles sooner than elsewhere; nothing leaves faster than 100 m/s",
            short="nothing bounces that would leave at less than 0.1 m/s; else e is up to 0.009 too large",
        ),
        Feature.RESTITUTION_THRESHOLD: approximate(
            "DART's own, which cannot be set: nothing bounces that would leave at less than 0.1 m/s (e v < 0.1 m/s), "
            "and all else does, for every requested threshold",
            short="the threshold is 0.1 m/s after the impact, for every requested one",
        ),
        Feature.TORSIONAL_FRICTION: never(f"{_NO_MOMENT} about the normal"),
        Feature.ROLLING_FRICTION: never(f"{_NO_MOMENT} across the normal"),
        Feature.HARDNESS_COMMON: via_api("DART's error reduction of 0.01, once its largest speed is set to 1e9 m/s"),
        **for_each(never(_RIGID), *features.COMPLIANCES, Feature.HARDNESS_PAIRS),
        Feature.HARDNESS_NATIVE: never(
            "DART's own takes overlaps back at 0.01 m/s at most, and simspec sets that aside"
        ),
        Feature.CONE_ELLIPTIC: approximate(
            "the circumscribed pyramid: up to 1.41 times the friction between its axes",
            no_friction,
            "the circumscribed pyramid: between its axes friction is up to 1.41 times that of the cone",
        ),
        Feature.CONE_PYRAMID_INSCRIBED: never("DART has the circumscribed pyramid only here"),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(
            "Dantzig's solver in passes, bound by the last one's normal forces"
        ),
        **for_each(via_api(_FILTER), *features.FILTERS),
        Feature.CONTROL_NATIVE: never("gz-physics' dartsim has no controllers of positions"),
        **outside_constraints(TITLE),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "contact_solver": Setting(
            "dantzig",
            "dantzig: gz-physics' default, of which DART falls back to pgs where it fails. By itself it bounds friction by the "
            "normal forces that would be without it (a rod that leans on a smooth wall falls at 1.6 times the friction that "
            "it needs); simspec's part in C++ has it solve each group of bodies in contact in up to 20 passes, bound by the "
            "normal forces of the pass before, until they fit within 0.1 %, and a run counts those that end before. Ten boxes "
            "on one another cost no more so. pgs: sweeps over the rows, approximate where many bodies bear each other.",
            ("dantzig", "pgs"),
            group=Group.SOLVER,
        )
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("restitution", 0.08, _PREDICTED, relative=False, timestep=0.008),
        Deviation("restitution", 0.16, _PREDICTED, relative=False, timestep=0.016),
        Deviation("threshold", 1.02, "DART's own threshold, e v < 0.1 m/s, cannot be set", relative=False),
        Deviation("rest", 0.16, _HOPS, relative=False, timestep=0.016),
        Deviation("rest", 0.005, _LIVELY, relative=False, timestep=0.008, restitution=0.8),
        Deviation("stick", 0.18, _LIVELY, relative=False, timestep=0.008, restitution=0.8),
        *(Deviation(name, 0.065, _LATE, friction=1.0, timestep=0.008) for name in ("stop", "stop-oblong")),
        *(Deviation(name, 0.125, _LATE, friction=1.0, timestep=0.016) for name in ("stop", "stop-oblong")),
        *(Deviation(name, 0.415, _PYRAMID, friction_cone="elliptic") for name in ("push", "push-oblong")),
        *(Deviation(name, 0.36, _PYRAMID, friction_cone="elliptic") for name in ("stop", "stop-oblong")),
        # slips of 1.6 times what friction takes, 39° from an axis: 0.435, and DART's own 2.6 % on top
        Deviation("oblique", 0.46, _PYRAMID, friction_cone="elliptic"),
    )
    ACCEPTED_CONES: ClassVar[Mapping[str, str]] = {"elliptic": "pyramid-circumscribed"}
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "simspec's filter has classes of shapes, in which groups are merged with materials"
    }

    PARTS: ClassVar[Parts[Simulation]] = Parts(Simulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        building.library()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
