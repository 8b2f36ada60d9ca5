"""MuJoCo's own methods of integration, by the setting ``integrator``: their orders, and the functions that end a step.

Facts marked *measured*: MuJoCo 4.0.1 (docs/records/limit-proof.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from simspec.dialects.mujoco.sidecar import COULOMB, RK4
from simspec.engines.kit.methods import IntegrationMethod, implicit_damping, integration
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import COMMON_METHOD, Setting, SettingGroup, resolve_settings
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.support.classes import AS_ARMATURE
from simspec.support.declarations import Refinement, Support, unsupported_if
from simspec.world.types import World

METHODS: Mapping[str, IntegrationMethod] = {
    "euler": IntegrationMethod(
        "MuJoCo's Euler",
        1,
        "MuJoCo's Euler with its flag eulerdamp makes the damping of joints implicit: (M + dt D) v̇",
        True,
    ),
    "implicit": IntegrationMethod(
        "MuJoCo's implicit",
        1,
        "MuJoCo's implicit solves (M − dt ∂f/∂v) v̇ = f, with the derivatives of damping, fluid and Coriolis forces",
        True,
    ),
    "implicitfast": IntegrationMethod(
        "MuJoCo's implicitfast",
        1,
        "MuJoCo's implicitfast solves (M − dt ∂f/∂v) v̇ = f, with the derivatives of damping and fluid forces",
        True,
    ),
    RK4: IntegrationMethod(
        "MuJoCo's RK4",
        4,
        "MuJoCo's RK4 is the fourth-order method of Runge and Kutta, by four evaluations of all forces in a step",
        True,
    ),
}
SETTING = Setting(
    COMMON_METHOD,
    "Method of integration. common: semi-implicit Euler with explicit damping, as in all engines. MuJoCo's own are proven in "
    "the limit of small timesteps: euler (its default, with implicit damping of joints), implicit, implicitfast, RK4.",
    (COMMON_METHOD, *METHODS),
    only_with="integrator",
    usual="euler",
    group=SettingGroup.INTEGRATION,
)


def chosen(world: World) -> str:
    """The value of the setting in a world."""
    return str(resolve_settings(find_engine("mujoco"), world)["integrator"])


def method(world: World) -> IntegrationMethod | None:
    """:meth:`Engine.method`. ``euler`` and ``implicitfast`` are semi-implicit Euler where they have nothing to make implicit:
    damping, and of ``implicitfast`` also a fluid and the gyroscopic torques of free bodies and balls (measured)."""
    name = chosen(world)
    damped = any(body.joint.damping or body.joint.angular_damping for body in world.bodies)
    damped = (
        damped or any(total.damping for total in world.sums) or any(law.law == "native" for law in world.controllers)
    )
    turning = any(body.joint.kind in QUATERNION_JOINTS for body in world.bodies)
    implicit = {"euler": damped, "implicitfast": damped or turning or world.physics.fluid is not None}
    return METHODS.get(name) if implicit.get(name, True) else None


def _support() -> Support:
    declared = integration(method, *METHODS.values())
    refine = declared.refine

    def in_world(world: World) -> Refinement | None:
        if chosen(world) == RK4:
            coulomb = resolve_settings(find_engine("mujoco"), world)["friction"] == COULOMB
            if coulomb:
                return unsupported_if(
                    "friction: coulomb corrects one solution in a step, and RK4 has four. Set friction: native"
                )
            if world.constraints:
                return unsupported_if(
                    "simspec makes MuJoCo's equalities exact by several solutions of a step, and RK4 has steps of its own"
                )
        return None if refine is None else refine(world)

    return dataclasses.replace(declared, refine=in_world)


SUPPORT = _support()


def _in_words(world: World) -> str:
    named = chosen(world)
    return "" if named == COMMON_METHOD else f"the integrator {named}"


IMPLICIT_DAMPING = implicit_damping(
    _in_words, f"{AS_ARMATURE}. Without contact, limits and friction this is MuJoCo's Euler with its flag eulerdamp"
)


def last_stage(mujoco: Any, model: Any) -> Callable[[Any, Any], None]:
    """The function of MuJoCo that ends a step of one evaluation, by the integrator of a model."""
    by_number = {
        int(mujoco.mjtIntegrator.mjINT_EULER): mujoco.mj_Euler,
        int(mujoco.mjtIntegrator.mjINT_IMPLICIT): mujoco.mj_implicit,
        int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): mujoco.mj_implicit,
    }
    function: Callable[[Any, Any], None] = by_number[int(model.opt.integrator)]
    return function
