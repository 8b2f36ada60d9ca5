"""MJX: an MJCF file in, arrays out. Its declarations; what it does is in ``simulation.py``."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

from simspec.contact.rules import Rules
from simspec.dialects.mujoco.sidecar import NATIVE
from simspec.engines.kit.capabilities import Capability, NativeLaw
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.foreign import Own, Reads
from simspec.engines.kit.settings import Setting, resolve_settings
from simspec.engines.mjx.simulation import CONE_OF_FILE, MjxSimulation, turns
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS as MUJOCO
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.expectation import Expectation
from simspec.engines.mujoco.inventory import expected_inventory
from simspec.engines.mujoco.rewritten import (
    NO_EQUALITIES,
    OF_MUJOCO,
    hardnesses,
    met_exactly,
    no_friction,
    rubs,
    without_coulomb,
)
from simspec.engines.mujoco.settings import SETTINGS as MUJOCO_SETTINGS
from simspec.support.declarations import EXACT, Refinement, Table, approximate, exact, for_each, never, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws, shape_pairs, solid_shapes
from simspec.world.kinematics import layout_of
from simspec.world.types import EngineValue, World

# How far MJX is from the contact law: as MuJoCo, and in what its own function for the contacts of two boxes does. Data,
# measured with MJX 3.17.0 at 0.5 to 16 ms, μ of 0.5 and 0.9, and e of 0.01 to 0.7.

_CORNERS = (
    "a pair that bounces has no cushion, and of two faces that overlap by less than 1 µm MJX takes one corner up to three "
    "times, so that a box is tilted and hops"
)
_BOUNCES = 0.01

CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *MUJOCO,
    Deviation("stick", 1e-3, _CORNERS, relative=False, restitution=_BOUNCES),
    Deviation("push", 0.14, _CORNERS, restitution=_BOUNCES, timestep=0.0009),
    Deviation("push-oblong", 0.14, _CORNERS, restitution=_BOUNCES, timestep=0.0009),
)

# MJX's solver settings: those of MuJoCo's files, as far as MJX has what they say.

_UNUSED = "MuJoCo's, of the file; MJX has nothing of the kind, so that this alone is allowed."

SETTINGS: Mapping[str, Setting] = {
    **{name: setting for name, setting in MUJOCO_SETTINGS.items() if name not in ("sleeping", "sleep_tolerance")},
    "solver": dataclasses.replace(
        MUJOCO_SETTINGS["solver"],
        meaning="The constraint solver. Newton solves MuJoCo's convex problem to round-off in a handful of iterations. "
        "MJX's cg ends before that: a ball that should lose 0.6 m/s along the surface in an impact gains 0.17 (measured, "
        "1 ms). It has no pgs.",
        choices=("newton",),
        frictionless=None,
        frictionless_unless=None,
    ),
    "tolerance": dataclasses.replace(
        MUJOCO_SETTINGS["tolerance"],
        meaning="The solver ends when it improves by less than this. MuJoCo's own number; smaller where bodies are light "
        "beside others, as for MuJoCo.",
    ),
    "friction": dataclasses.replace(
        MUJOCO_SETTINGS["friction"],
        meaning="native: MuJoCo's own friction, which leaves out most of the friction of an impact. To be accepted by name "
        "(contact.friction.impact, contact.friction.carried). simspec's loop around MuJoCo's solver is not written for MJX.",
        choices=(NATIVE,),
    ),
    "noslip_iterations": dataclasses.replace(MUJOCO_SETTINGS["noslip_iterations"], meaning=_UNUSED, maximum=0),
    "multiccd": dataclasses.replace(
        MUJOCO_SETTINGS["multiccd"],
        default=False,
        meaning="MuJoCo's, of the file, and without effect: MJX has functions of its own for every two kinds of shapes, which "
        "find a face's points always.",
    ),
    "ccd_tolerance": dataclasses.replace(
        MUJOCO_SETTINGS["ccd_tolerance"], meaning="MuJoCo's, of the file, and without effect in MJX.", finer=None
    ),
    "island": dataclasses.replace(
        MUJOCO_SETTINGS["island"],
        meaning="MuJoCo's, of the file, and without effect: MJX solves all bodies together.",
        needs=None,
    ),
}

MOST_NUMBERS = 1_000_000
"""Of a step's Jacobian: what each contact there can be has, for every degree of freedom."""
_TOO_MANY = (
    f"MJX computes every contact there can be in each step, by a dense matrix, here of more than {MOST_NUMBERS:,} numbers: "
    "with 64 balls on a floor, which have 800,000, a step takes 50 ms (measured)"
)
FACE, RUBBING = 4, 3
"""Points of contact of two shapes, neither of which is a sphere, and rows of a point with friction."""
PYRAMIDAL = 0
"""MuJoCo's number of the cone that frictionless contacts are solved with."""
SMOOTH = ("ellipsoid", "cylinder")
"""Kinds that MJX meets others with by searching on distance functions, but planes and spheres."""
EXACTLY_MET = ("plane", "sphere")
_NOT_EXACTLY = "MJX has no function for the two, or one that searches on distance functions"
_HOPS = (
    "under the pyramid what rests overlaps by 0.2 nm, and of faces that overlap by less than 1 µm MJX takes some corners "
    "more than once: a cube at rest hops again and again, by g dt (measured)"
)


def _friction_everywhere(world: World) -> Refinement | None:
    """Refused where some contacts have friction and others none."""
    smooth = next((pair for pair, law in meeting_laws(world).items() if not rubs(law)), None)
    if smooth is None or not any(map(rubs, meeting_laws(world).values())):
        return None
    return unsupported_if(
        f"under the elliptic cone MJX has no contacts without friction, which {' and '.join(smooth)} have"
    )


def _small_enough(world: World) -> Refinement | None:
    """Refused where the rows of all contacts there can be, times the degrees of freedom, are too many."""
    degrees = layout_of(world).nv
    most = MOST_NUMBERS // max(degrees, 1)
    kinds = {shape.name: shape.kind for body in world.bodies for shape in solid_shapes(body)}
    rows = 0
    for pair, law in meeting_laws(world).items():
        for one, other in shape_pairs(world, [pair]):
            points = 1 if "sphere" in (kinds[one], kinds[other]) else FACE
            rows += points * (RUBBING if rubs(law) else 1)
            if rows > most:
                return unsupported_if(_TOO_MANY)
    return None


class Mjx(MjxSimulation):
    """MJX, the JAX form of MuJoCo's dynamics: the same law of contact and the same numbers as in :class:`MuJoCo`, solved by
    code of its own, with functions of its own for the contacts of every two kinds of shapes.

    Every contact there can be is computed in every step, whether anything touches or not, by dense matrices: a step's cost
    is that of all pairs of shapes, and of all degrees of freedom cubed.

    Of two faces that overlap by less than 1 µm it takes some corners more than once, so that what rests on them hops. Without
    friction, and with restitution, a cube rests 0.98 µm deep at 1 ms: level L5 fails there (steady, push), and is not declared.
    """

    NAME: ClassVar[str] = "mjx"
    TITLE: ClassVar[str] = "MJX"
    DIALECT: ClassVar[str] = "mujoco"
    DISTRIBUTION: ClassVar[str] = "mujoco-mjx"
    EXTRA: ClassVar[str] = ""
    APART: ClassVar[str] = "3.17"
    RULES: ClassVar[Rules] = MuJoCo.RULES
    LAYERS: ClassVar[bool] = False
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.NATIVE_CONTROLLERS: "simspec drives MJX by efforts",
        Capability.FOREIGN_FILES: "MJX reads no files: it is given a model that MuJoCo has read",
    }
    FOREIGN: ClassVar[Mapping[str, Reads]] = {}
    FOREIGN_OWN: ClassVar[Mapping[str, Own]] = {}
    NATIVE_LAW: ClassVar[NativeLaw | None] = None
    SUPPORT: ClassVar[Table] = {
        **MuJoCo.SUPPORT,
        **hardnesses(MuJoCo.SUPPORT, _small_enough),
        Feature.SHAPE_BOX: EXACT,  # by a function of its own, whatever MuJoCo's release
        Feature.SHAPE_CYLINDER: exact(
            "against planes and spheres, and what never meets anything",
            refine=functools.partial(met_exactly, "cylinder", EXACTLY_MET, _NOT_EXACTLY),
        ),
        Feature.SHAPE_ELLIPSOID: exact(
            "against planes and spheres", refine=functools.partial(met_exactly, "ellipsoid", EXACTLY_MET, _NOT_EXACTLY)
        ),
        Feature.SHAPE_HEIGHTFIELD: never(
            "MJX meets height fields by prisms of their cells, and with spheres, capsules, boxes and hulls alone"
        ),
        **for_each(
            never("a box with a margin over a floor meets it 3.5 mm later than it should (L5, size; measured)"),
            *(Feature.SHAPE_MARGIN, Feature.MARGIN_PAIRS),
        ),
        Feature.CARRIED_FRICTION: without_coulomb(MuJoCo.SUPPORT[Feature.CARRIED_FRICTION]),
        Feature.SELF_LOCKING: without_coulomb(MuJoCo.SUPPORT[Feature.SELF_LOCKING]),
        Feature.EVEN_PRESSURE: MuJoCo.SUPPORT[Feature.EVEN_PRESSURE],
        Feature.MASS_RATIO: MuJoCo.SUPPORT[Feature.MASS_RATIO],
        Feature.CONTROL_NATIVE: never("simspec drives MJX by efforts"),
        Feature.CONE_ELLIPTIC: exact(
            "cone=elliptic; a pyramid of one edge where nothing has friction", refine=_friction_everywhere
        ),
        Feature.CONE_PYRAMID_INSCRIBED: exact(
            "where nothing has friction: a pyramid of one edge", refine=functools.partial(no_friction, why=_HOPS)
        ),
        Feature.IMPACT_FRICTION: approximate(
            "most of it is missing, as in MuJoCo: of the speed along the surface that an impact should take away 80 to 90 % "
            f"stays at 1 ms; {OF_MUJOCO}",
            short="80 to 90 % of the friction in an impact is missing, at 1 ms",
        ),
        Feature.SURFACE_VELOCITY: never("MJX has no surfacevel"),
        **NO_EQUALITIES,
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = CONTACT_DEVIATIONS
    COMPILING: ClassVar[float] = 100.0
    HULL_PRECISION: ClassVar[float] = MuJoCo.HULL_PRECISION
    DRY_FRICTION_CREEP: ClassVar[float] = MuJoCo.DRY_FRICTION_CREEP
    UNREADABLE: ClassVar[Mapping[str, str]] = MuJoCo.UNREADABLE

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        settings = resolve_settings(cls, world)
        found: dict[str, EngineValue] = expected_inventory(
            Expectation(world, settings, neutral, cls.RULES, cls.LAYERS, cls.NAME)
        )
        found[CONE_OF_FILE] = found["opt.cone"]
        if not any(map(rubs, meeting_laws(world).values())):
            found["opt.cone"] = PYRAMIDAL
        return found | turns(world.bodies)
