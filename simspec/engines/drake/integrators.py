"""Drake's own methods of integration, by the setting ``integrator``: their orders, and what Drake leaves out by them.

Facts marked *measured*: Drake 1.51.1 (docs/records/limit-proof.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from simspec.control.reference import natives
from simspec.engines.kit.methods import IntegrationMethod, integration
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import COMMON_METHOD, Setting, SettingGroup, resolve_settings
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.support.classes import AS_ARMATURE, no_armed_ball
from simspec.support.declarations import Refinement, Support, exact, unsupported_if
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import World

DISCRETE = "discrete"
"""Drake's steps of a plant with a timestep, without simspec's rotations and efforts of dampers."""
ORDERS: Mapping[str, int] = {
    "semi_explicit_euler": 1,
    "implicit_euler": 1,
    "runge_kutta2": 2,
    "runge_kutta3": 3,
    "radau3": 3,
    "runge_kutta5": 5,
}
"""Drake's integrators of continuous plants, by fixed steps, with their orders (measured)."""
METHODS: Mapping[str, IntegrationMethod] = {
    DISCRETE: IntegrationMethod(
        "Drake's discrete steps",
        1,
        "Drake's discrete plant makes the damping of joints implicit, and integrates rotations to first order",
        True,
    ),
    **{
        name: IntegrationMethod(
            f"Drake's {name}",
            order,
            f"Drake's continuous plant, by its integrator {name} in fixed steps",
            True,
        )
        for name, order in ORDERS.items()
    },
}
GIVEN = "; simspec's efforts for bodies, constant during a step, make it first order"
SETTING = Setting(
    COMMON_METHOD,
    "Method of integration. common: semi-implicit Euler with explicit damping, as in all engines. Drake's are proven in the "
    "limit of small timesteps: discrete (its default: implicit damping of joints, first-order rotations), and by a "
    "continuous plant, without contact, in fixed steps: semi_explicit_euler, implicit_euler, runge_kutta2, runge_kutta3, "
    "radau3, runge_kutta5.",
    (COMMON_METHOD, *METHODS),
    only_with="integrator",
    usual=DISCRETE,
    group=SettingGroup.INTEGRATION,
)


def scheme(settings: Mapping[str, Any]) -> str:
    """Drake's integrator of a continuous plant that written settings select; "" for a discrete one."""
    name = str(settings.get("integrator", COMMON_METHOD))
    return "" if name in (COMMON_METHOD, DISCRETE) else name


def native(settings: Mapping[str, Any]) -> bool:
    """Whether written settings select a method of Drake's, with its damping and rotations."""
    return "integrator" in settings


def chosen(world: World) -> str:
    """The value of the setting in a world."""
    return str(resolve_settings(find_engine("drake"), world)["integrator"])


def method(world: World) -> IntegrationMethod | None:
    """:meth:`Engine.method`. Discrete steps are semi-implicit Euler where no joint has damping or turns freely (measured)."""
    name, joints = chosen(world), [body.joint for body in world.bodies]
    if name == DISCRETE and not any(joint.damping or joint.kind in QUATERNION_JOINTS for joint in joints):
        return None
    found = METHODS.get(name)
    if found is None or found.order == 1 or not _given(world):
        return found
    return dataclasses.replace(found, order=1, how=found.how + GIVEN)


def _given(world: World) -> bool:
    """Whether simspec applies efforts of the state, which are constant during a step."""
    scaled = any(body.gravity_scale != 1.0 for body in world.bodies)
    damped = any(
        body.joint.kind == "free" and (body.joint.damping or body.joint.angular_damping) for body in world.bodies
    )
    return scaled or damped or world.physics.fluid is not None or bool(world.sums)


def _left_out(world: World) -> str | None:
    """Why Drake's continuous plant does not simulate a world; None where it does."""
    name = chosen(world)
    if name in (COMMON_METHOD, DISCRETE):
        return None
    by, instead = f"by integrator: {name}", "Set integrator: discrete"
    if (joint := next((body.joint.name for body in world.bodies if body.joint.position_limits), None)) is not None:
        return f"{by} Drake ignores the limits of joints, such as {joint!r}. {instead}"
    if natives(world):
        return f"{by} Drake has no PD controllers. {instead}"
    if meeting_laws(world):
        return (
            f"{by} contact is a spring without the common law's error reduction, which diverges at fixed steps or lets "
            f"bodies sink (docs/engines/drake.md). {instead}"
        )
    if world.motions:
        return f"{by} kinematic bodies miss their motions: simspec's efforts suit steps of Euler. {instead}"
    return None


def _support() -> Support:
    declared = integration(method, *METHODS.values())
    refine = declared.refine

    def in_world(world: World) -> Refinement | None:
        if (reason := _left_out(world)) is not None:
            return unsupported_if(reason)
        if chosen(world) != COMMON_METHOD and world.constraints:
            return unsupported_if(
                "simspec's forces for constraints suit steps of semi-implicit Euler. Set integrator: common"
            )
        return None if refine is None else refine(world)

    return dataclasses.replace(declared, refine=in_world)


SUPPORT = _support()


def _implicit_damping(world: World) -> Refinement | None:
    if (named := chosen(world)) != COMMON_METHOD:
        return unsupported_if(f"the integrator {named} has damping of Drake's, to which dt × damping would add")
    return no_armed_ball(world)


IMPLICIT_DAMPING = exact(AS_ARMATURE, refine=_implicit_damping)
