"""MuJoCo Warp: an MJCF file in, arrays out. Its declarations; what it does is in ``simulation.py``."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

from simspec.contact.rules import Rules
from simspec.engines.kit.capabilities import NO_SNAPSHOTS_YET, Capability
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.foreign import Own, Reads
from simspec.engines.kit.native_law import NativeLaw
from simspec.engines.kit.precision import SINGLE
from simspec.engines.kit.settings import Setting, resolve_settings
from simspec.engines.mjwarp.settings import SETTINGS
from simspec.engines.mjwarp.simulation import MjWarpSimulation
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.expected import expected_inventory
from simspec.support.declarations import Table, alike, never
from simspec.support.features import Feature
from simspec.world.types import HeldValue, World

CONTACT = {
    feature: dataclasses.replace(MuJoCo.SUPPORT[feature], since="")
    for feature in (
        Feature.HARDNESS_COMMON,
        Feature.HARDNESS_TIME_CONSTANT,
        Feature.HARDNESS_STIFFNESS,
        Feature.HARDNESS_NATIVE,
    )
}
"""As MuJoCo's, whose bounds are of MuJoCo's releases."""


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
        **CONTACT,
        Feature.CONTROL_NATIVE: never("simspec drives MuJoCo Warp by efforts"),
        **alike(
            never("simspec's repeated solution of equalities in a step is written for MuJoCo alone"),
            Feature.CONSTRAINT_COUPLING,
            Feature.CONSTRAINT_LOOP,
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = MuJoCo.CONTACT_DEVIATIONS
    COMPILING: ClassVar[float] = 300.0
    HULL_PRECISION: ClassVar[float] = MuJoCo.HULL_PRECISION
    DRY_FRICTION_CREEP: ClassVar[float] = MuJoCo.DRY_FRICTION_CREEP
    UNREADABLE: ClassVar[Mapping[str, str]] = MuJoCo.UNREADABLE

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, HeldValue]) -> dict[str, HeldValue]:
        settings = resolve_settings(cls, world)
        found: dict[str, HeldValue] = expected_inventory(world, settings, neutral, cls.RULES, cls.LAYERS, cls.NAME)
        return found
