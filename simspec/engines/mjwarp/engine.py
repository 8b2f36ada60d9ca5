"""MuJoCo Warp: an MJCF file in, arrays out. Its declarations; what it does is in ``simulation.py``."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, ClassVar

from simspec.contact.rules import Rules
from simspec.dialects.mujoco.contact import moment_hardness
from simspec.dialects.mujoco.sidecar import NATIVE
from simspec.engines.kit.capabilities import SINGLE, Capability, NativeLaw
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.foreign import Own, Reads
from simspec.engines.kit.settings import Group, Setting, resolve_settings
from simspec.engines.mjwarp.programs import AUTO, PROCESSOR
from simspec.engines.mjwarp.simulation import SEARCH_OF_FILE, MjWarpSimulation
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS as MUJOCO
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.expectation import Expectation
from simspec.engines.mujoco.inventory import expected_inventory
from simspec.engines.mujoco.rewritten import NO_EQUALITIES, met_exactly, no_friction, rubs, without_coulomb
from simspec.engines.mujoco.settings import SETTINGS as MUJOCO_SETTINGS
from simspec.support.declarations import EXACT, Refinement, Support, Table, exact, never, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import EngineValue, World

# How far MuJoCo Warp is from the contact law: as MuJoCo, in what singles leave of friction on springs, and where what slides
# hops otherwise in singles. Data, measured as in ``simulation.py``, at 1 ms where no timestep is said.

_SOFT = (
    "friction is as soft as its contact, and at most 1e5 times as hard (high_impratio): on springs a box creeps 4.9e-4 m/s at "
    "60 % of the limit"
)
_HOPS = (
    "friction's cone is associated, as MuJoCo's: what slides is lifted, and hops; in singles at other moments, so that more of "
    "a short slide, or of a push that is measured, can be without friction"
)


def _rows(probe: str, table: Mapping[float, Mapping[float, float]], **more: Any) -> tuple[Deviation, ...]:
    """``table``: by timestep (s), by least friction, the largest share of the expected value. From 0.9 of the timestep on."""
    return tuple(
        Deviation(probe, size, _HOPS, friction=friction, timestep=0.9 * timestep, **more)
        for timestep, sizes in table.items()
        for friction, size in sizes.items()
    )


_SINGLES: tuple[Deviation, ...] = (
    *_rows("push", {0.002: {1.2: 0.14}, 0.004: {0.25: 0.04}, 0.008: {0.15: 0.055, 1.2: 0.33}}),
    *_rows("push", {0.002: {0.4: 0.15}, 0.008: {0.9: 0.35}}, restitution=0.01),
    *_rows("push-oblong", {0.002: {1.4: 0.17}, 0.004: {0.25: 0.035, 0.9: 0.2, 1.2: 0.29}, 0.008: {1.2: 0.33}}),
    *_rows("push-oblong", {0.002: {0.0: 0.018}, 0.008: {0.9: 0.35}}, restitution=0.01),
    *_rows("stop", {0.002: {0.6: 0.035, 0.9: 0.045}, 0.008: {0.4: 0.025, 0.6: 0.045}, 0.016: {0.25: 0.03}}),
    *_rows("stop", {0.008: {0.4: 0.07, 0.9: 0.17}, 0.016: {0.9: 0.48}}, restitution=0.01),
    *_rows("stop-oblong", {0.002: {0.4: 0.035, 0.6: 0.055, 0.9: 0.1}, 0.016: {0.25: 0.03, 0.4: 0.1, 0.6: 0.145}}),
    *_rows("stop-oblong", {0.004: {0.4: 0.06}, 0.008: {0.4: 0.07}}, restitution=0.01),
)
"""Where it exceeds what MuJoCo's rows say, at 2, 4, 8 and 16 ms: the largest of what specs/contact/friction-laws.yaml shows
there, with its own μ of 0.05 to 1 and with 0.3, 0.7, 1.25 and 1.5, and restitution-laws.yaml, with μ of 0.05 to 1."""

CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *MUJOCO,
    *_SINGLES,
    Deviation("stick", 5.5e-4, _SOFT, relative=False, hardness="stiffness"),
    Deviation("stick", 5.5e-4, _SOFT, relative=False, hardness="time-constant"),
)

# MuJoCo Warp's solver settings: those of MuJoCo's files, as far as Warp has what they say, and the device. Measured as in
# ``simulation.py``.

LARGEST_RATIO = 1e5
"""Of friction's hardness to that of contact, in singles."""

SETTINGS: Mapping[str, Setting] = {
    **{name: setting for name, setting in MUJOCO_SETTINGS.items() if name not in ("sleeping", "sleep_tolerance")},
    "device": Setting(
        AUTO,
        "What computes. auto: the first graphics processor that Warp finds (CUDA), where there is one, else the processor "
        "(cpu). Others than the processor are told with the run's messages; nobody has run simspec on one.",
        (AUTO, PROCESSOR, *(f"cuda:{index}" for index in range(8))),
        group=Group.ORDER,  # of sums, which a graphics processor takes otherwise
    ),
    "solver": dataclasses.replace(
        MUJOCO_SETTINGS["solver"],
        meaning="The constraint solver. Newton solves MuJoCo's convex problem to the round-off of singles in a handful of "
        "iterations. Warp's cg is not offered, since 100 iterations, MuJoCo's number, are too few for it: a box that should "
        "lose 0.6 m/s along the surface in an impact gains 0.12, where newton's loses 0.06; of 1000 iterations it has newton's "
        "answer (one world, only these settings changed; measured, 1 ms). It has no pgs.",
        choices=("newton",),
        frictionless=None,
        frictionless_unless=None,
    ),
    "impratio": dataclasses.replace(MUJOCO_SETTINGS["impratio"], maximum=LARGEST_RATIO),
    "high_impratio": dataclasses.replace(
        MUJOCO_SETTINGS["high_impratio"],
        default=LARGEST_RATIO,
        meaning="impratio of worlds where compliant contact has friction, or something has torsional or rolling friction: "
        "MuJoCo makes friction as soft as its contact, and moments softer by (μ/c)². At most 1e5: at 1e7, MuJoCo's here, a "
        "box that friction holds on a slope is no number (NaN) after 2 to 228 steps, since singles have seven digits; at 1e5 "
        "it creeps 1e-6 m/s (measured).",
        maximum=LARGEST_RATIO,
    ),
    "friction": dataclasses.replace(
        MUJOCO_SETTINGS["friction"],
        meaning="native: MuJoCo's own friction, which leaves out most of the friction of an impact. To be accepted by name "
        "(contact.friction.impact, contact.friction.carried). simspec's loop around MuJoCo's solver is not written for Warp.",
        choices=(NATIVE,),
    ),
    "island": dataclasses.replace(
        MUJOCO_SETTINGS["island"],
        meaning="MuJoCo's, of the file, and without effect: Warp solves groups of bodies apart only where bodies sleep.",
        needs=None,
    ),
}

# What of a world becomes no number (NaN) in MuJoCo Warp, and is therefore refused.
#
# Its Newton solver factors its matrix in singles without a floor under the pivots, where MuJoCo has one (tile_cholesky in its
# solver; google-deepmind/mujoco_warp, issue 1415), and the matrix is the worse conditioned the harder friction is
# (``impratio``): most likely that is why. Warp compiles for the processor that it runs on: what is no number on one may be one
# on another. *Measured* at 1 ms, MuJoCo Warp 4.0.0 on processors of Intel and AMD:
#
# - Under the pyramid a box with friction that is pushed.
# - Under the elliptic cone a free body of which the first part weighs nothing, and the parts that are fixed to it 1.1 kg: it
#   lands on a box with 3 m/s and is no number 0.1 s later, with a hinge on it or without; not where the first part weighs 0.5
#   kg, not without friction.
# - Torsional friction without rolling friction (contacts of four rows), of 1 to 100 mm, μ = 0.2 to 1: a ball that lands, at an
#   impratio of 1e4 and more, on AMD; at 1000 all probes of L5 are met. With rolling friction (six rows) they are met at 1e5,
#   too.
# - A box that bounces may be by chance: of 240 pushes of boxes with restitution one is (L5, which says so and is not valid
#   then).

PYRAMID = (
    "under the pyramid a box with friction that is pushed becomes no number (NaN), in single precision (L5; measured)"
)
MOST_TORSIONAL_RATIO = 1000.0
"""``impratio`` up to which torsional friction by itself is met."""


def weightless_rub(world: World) -> Refinement | None:
    """Refused where a body without mass has shapes with friction on what moves."""
    groups = rigid_groups(world)
    rubbing = {name for pair, law in meeting_laws(world).items() if rubs(law) for name in pair}
    for body in world.bodies:
        weightless = not body.inertial.mass and groups[body.name] != "world"
        if weightless and any(shape.material in rubbing for shape in solid_shapes(body)):
            return unsupported_if(
                f"{body.name!r} has no mass and touches with friction, of which MuJoCo Warp's solver makes no numbers (NaN) "
                "within 0.1 s, in single precision (measured); give it mass, or its shapes to the body that carries it"
            )
    return None


def torsional_alone(world: World, ratio: float) -> Refinement | None:
    """Refused where two shapes that may meet have torsional friction and no rolling friction; ``ratio``: impratio."""
    if ratio <= MOST_TORSIONAL_RATIO:
        return None
    for pair, law in sorted(meeting_laws(world).items()):
        if law.torsional_friction and not law.rolling_friction:
            return unsupported_if(
                f"{' and '.join(map(repr, pair))} have torsional friction and no rolling friction: a ball that lands so is no "
                f"number (NaN), in single precision at impratio {ratio:g} (measured); give them rolling friction, or set "
                f"engines.mjwarp.settings.high_impratio to {MOST_TORSIONAL_RATIO:g}, at which friction on springs creeps faster"
            )
    return None


SEARCHED = (
    "MuJoCo Warp finds the contacts of the two by a search in single precision, which loses digits with size: a 10 cm box on "
    "one of 4 m it so finds 12 µm deep, on one of 20 m 0.17 mm, on one of 400 m 1.3 mm and in half of all steps not at all "
    "(measured)"
)
EXACTLY_MET: Mapping[str, tuple[str, ...]] = {
    "capsule": ("plane", "sphere", "capsule", "box"),
    "cylinder": ("plane", "sphere"),
    "ellipsoid": ("plane",),
    "mesh": ("plane",),
}
"""By kind of shape those for which there is a function of the two; planes, spheres and boxes have one for each other."""


_TORSIONAL = MuJoCo.SUPPORT[Feature.TORSIONAL_FRICTION]


def _torsional(world: World) -> Refinement | None:
    settings = resolve_settings(MjWarp, world)
    needed = moment_hardness(world.physics.timestep, meeting_laws(world).values())
    return torsional_alone(world, max(float(settings["impratio"]), min(float(settings["high_impratio"]), needed)))


def _of_kind(kind: str) -> Support:
    met = EXACTLY_MET[kind]
    return exact(
        f"with what is a {' or a '.join(met)}, and what never meets anything",
        refine=functools.partial(met_exactly, kind, met, SEARCHED),
    )


class MjWarp(MjWarpSimulation):
    """MuJoCo Warp, the form of MuJoCo's dynamics for graphics processors, in single precision: the same law of contact and the
    same numbers as in :class:`MuJoCo`, solved by code of its own. It computes on a processor, too.
    """

    NAME: ClassVar[str] = "mjwarp"
    TITLE: ClassVar[str] = "MuJoCo Warp"
    DIALECT: ClassVar[str] = "mujoco"
    DISTRIBUTION: ClassVar[str] = "mujoco-warp"
    EXTRA: ClassVar[str] = ""
    APART: ClassVar[str] = "4.0"
    PRECISION: ClassVar[str] = SINGLE
    RULES: ClassVar[Rules] = MuJoCo.RULES
    LAYERS: ClassVar[bool] = False
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.NATIVE_CONTROLLERS: "simspec drives MuJoCo Warp by efforts",
        Capability.FOREIGN_FILES: "MuJoCo Warp reads no files: it is given a model that MuJoCo has read",
    }
    FOREIGN: ClassVar[Mapping[str, Reads]] = {}
    FOREIGN_OWN: ClassVar[Mapping[str, Own]] = {}
    NATIVE_LAW: ClassVar[NativeLaw | None] = None
    SUPPORT: ClassVar[Table] = {
        **MuJoCo.SUPPORT,
        **{
            feature: without_coulomb(MuJoCo.SUPPORT[feature])
            for feature in (Feature.IMPACT_FRICTION, Feature.CARRIED_FRICTION, Feature.SELF_LOCKING)
        },
        Feature.SHAPE_BOX: EXACT,  # by a function of its own, whatever MuJoCo's release
        Feature.SHAPE_CAPSULE: _of_kind("capsule"),
        Feature.SHAPE_CYLINDER: _of_kind("cylinder"),
        Feature.SHAPE_ELLIPSOID: _of_kind("ellipsoid"),
        Feature.SHAPE_MESH: _of_kind("mesh"),
        Feature.SHAPE_HEIGHTFIELD: never(
            "MuJoCo Warp meets height fields by prisms of their cells, by the search that loses digits with size"
        ),
        Feature.MASSLESS: exact("of what touches nothing with friction", refine=weightless_rub),
        Feature.TORSIONAL_FRICTION: dataclasses.replace(
            _TORSIONAL,
            how=f"beside rolling friction, or at an impratio of up to {MOST_TORSIONAL_RATIO:g}: {_TORSIONAL.how}",
            refine=_torsional,
        ),
        Feature.CONTROL_NATIVE: never("simspec drives MuJoCo Warp by efforts"),
        Feature.CONE_PYRAMID_INSCRIBED: exact(
            "where nothing has friction: a pyramid of one edge", refine=functools.partial(no_friction, why=PYRAMID)
        ),
        **NO_EQUALITIES,
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = CONTACT_DEVIATIONS
    COMPILING: ClassVar[float] = 300.0
    HULL_PRECISION: ClassVar[float] = MuJoCo.HULL_PRECISION
    DRY_FRICTION_CREEP: ClassVar[float] = 2e-5  # of 0.22 rad/s after 20 steps its solver misses 8e-6 (measured)
    UNREADABLE: ClassVar[Mapping[str, str]] = MuJoCo.UNREADABLE

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        settings = resolve_settings(cls, world)
        found: dict[str, EngineValue] = expected_inventory(
            Expectation(world, settings, neutral, cls.RULES, cls.LAYERS, cls.NAME)
        )
        found[SEARCH_OF_FILE] = found["flags.disable_nativeccd"]
        found["flags.disable_nativeccd"] = True
        return found
