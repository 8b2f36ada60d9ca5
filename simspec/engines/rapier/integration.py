"""Rapier's own method of integration, by the setting ``native_motion``.

Facts marked *measured*: rapier3d 0.36.1 (docs/records/limit-proof.md).
"""

from __future__ import annotations

from simspec.engines.kit.methods import IntegrationMethod, implicit_damping, integration
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import Setting, SettingGroup, resolve_settings
from simspec.engines.rapier.simulation import NATIVE_MOTION
from simspec.engines.rapier.units import NAME
from simspec.world.types import World

NATIVE = IntegrationMethod(
    "Rapier's implicit steps",
    1,
    "Rapier solves (M + dt C + dt D) v̇ = f, with a Coriolis matrix C, or with M alone where C would add energy, with the "
    "damping D of joints, and with implicit gyroscopic torques of free bodies",
    requested=True,
)
SETTING = Setting(
    False,
    "Integrate as other programs with Rapier do: Rapier's Coriolis matrix and damping of joints, both implicit, and its "
    "gyroscopic torques, in place of semi-implicit Euler. It is a method of first order, proven in the limit of small "
    "timesteps.",
    only_with=NATIVE_MOTION,
    usual=True,
    group=SettingGroup.INTEGRATION,
)


def _chosen(world: World) -> bool:
    return bool(resolve_settings(find_engine(NAME), world)[NATIVE_MOTION])


def method(world: World) -> IntegrationMethod | None:
    """:meth:`Engine.method`."""
    return NATIVE if _chosen(world) else None


SUPPORT = integration(method, NATIVE)
IMPLICIT_DAMPING = implicit_damping(lambda world: NATIVE_MOTION if _chosen(world) else "")
