"""MuJoCo Warp: an MJCF file in, arrays out. Its declarations; what it does is in ``simulation.py``."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

from simspec.contact.rules import Rules
from simspec.dialects.mujoco.contact import moment_hardness
from simspec.engines.kit.capabilities import NO_SNAPSHOTS_YET, Capability
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.foreign import Own, Reads
from simspec.engines.kit.native_law import NativeLaw
from simspec.engines.kit.precision import SINGLE
from simspec.engines.kit.settings import Setting, resolve_settings
from simspec.engines.mjwarp.contact import CONTACT_DEVIATIONS
from simspec.engines.mjwarp.no_numbers import MOST_TORSIONAL_RATIO, PYRAMID, torsional_alone, weightless_rub
from simspec.engines.mjwarp.settings import SETTINGS
from simspec.engines.mjwarp.simulation import SEARCH_OF_FILE, MjWarpSimulation
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.expectation import Expectation
from simspec.engines.mujoco.inventory import expected_inventory
from simspec.engines.mujoco.rewritten import NO_EQUALITIES, met_exactly, no_friction, without_coulomb
from simspec.support.declarations import EXACT, Level, Refinement, Support, Table, never
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import EngineValue, World

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
    return Support(
        Level.EXACT,
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
        Capability.SNAPSHOTS: NO_SNAPSHOTS_YET,
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
        Feature.MASSLESS: Support(Level.EXACT, "of what touches nothing with friction", refine=weightless_rub),
        Feature.TORSIONAL_FRICTION: dataclasses.replace(
            _TORSIONAL,
            how=f"beside rolling friction, or at an impratio of up to {MOST_TORSIONAL_RATIO:g}: {_TORSIONAL.how}",
            refine=_torsional,
        ),
        Feature.CONTROL_NATIVE: never("simspec drives MuJoCo Warp by efforts"),
        Feature.CONE_PYRAMID_INSCRIBED: Support(
            Level.EXACT,
            "where nothing has friction: a pyramid of one edge",
            refine=functools.partial(no_friction, why=PYRAMID),
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
