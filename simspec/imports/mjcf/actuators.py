"""Actuators of a compiled model as those of a spec: a force that is affine in the command, the position and the velocity of one
joint, without a state of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from simspec.imports.mjcf.bodies import Bodies, Names, numbers
from simspec.imports.mjcf.compiled import HINGE, SLIDE
from simspec.language.amounts import MOST_ACTUATORS

TRANSMISSIONS: Final = (0, 1)
"""Types of transmission that are a hinge or a slide: of a joint, and of one in its parent's frame."""
NONE, FIXED, AFFINE = 0, 0, 1
"""Types of dynamics and bias (none), of gain (fixed), and of bias (affine)."""
NOTE: Final = "they act where `control: {NAME: {actuators: [...]}}` names them"


def add_actuators(bodies: Bodies, constraints: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The actuators of a file, by their names; those that a spec has are carried, the others are told."""
    model, names = bodies.model, Names()
    following = {held["follow"]["joint"] for held in constraints.values() if "follow" in held}
    made: dict[str, dict[str, Any]] = {}
    for number, part in model.parts["actuator"].items():
        words = _words(bodies, number, following) if len(made) < MOST_ACTUATORS else None
        if words is not None:
            made[names.give(part.name, f"actuator_{number}")] = words
            bodies.features.carry(part.element)
            bodies.features.actuators.add(number)
    return made


def _words(bodies: Bodies, number: int, following: set[str]) -> dict[str, Any] | None:
    """What a spec says of an actuator; None where it does not."""
    model = bodies.model
    joint = int(model["actuator_trnid"][number][0])
    kinds = [int(model[f"actuator_{word}"][number]) for word in ("dyntype", "gaintype")]
    if int(model["actuator_trntype"][number]) not in TRANSMISSIONS or kinds != [NONE, FIXED]:
        return None
    if int(model["jnt_type"][joint]) not in (HINGE, SLIDE) or int(model["actuator_biastype"][number]) not in (
        NONE,
        AFFINE,
    ):
        return None
    gear = float(model["actuator_gear"][number][0])
    affine = int(model["actuator_biastype"][number]) == AFFINE
    constant, stiffness, damping = (float(value) if affine else 0.0 for value in model["actuator_biasprm"][number][:3])
    if not gear or stiffness > 0.0 or damping > 0.0:
        return None
    limit = _symmetric(model["actuator_forcerange"][number]) if bool(model["actuator_forcelimited"][number]) else None
    if bool(model["actuator_forcelimited"][number]) and limit is None:
        return None
    name = bodies.joint_name(joint)
    if name in following:
        return None
    # the position of a spec counts from the file's reference
    constant += stiffness * gear * float(model["qpos0"][int(model["jnt_qposadr"][joint])])
    words = {"joint": name, **_law(float(model["actuator_gainprm"][number][0]), constant, stiffness, damping)}
    if gear != 1.0:
        words["gear"] = gear
    if limit is not None:
        words["effort_limit"] = limit
    if bool(model["actuator_ctrllimited"][number]):
        low, high = (float(value) for value in model["actuator_ctrlrange"][number])
        words["command_limits"] = numbers([low, high])
        if not low <= 0.0 <= high:
            words["command"] = low if low > 0.0 else high
    return words


def _law(gain: float, constant: float, stiffness: float, damping: float) -> dict[str, Any]:
    """The law of a force gain u + constant + stiffness ℓ + damping ℓ', and its numbers."""
    kp, kd = 0.0 - stiffness, 0.0 - damping
    if kp and gain == kp and not constant:
        return {"kp": kp, **({"kd": kd} if kd else {})}
    if kd and gain == kd and not kp and not constant:
        return {"law": "velocity", "kd": kd}
    if gain == 1.0 and not (constant or kp or kd):
        return {"law": "effort"}
    return {"law": "affine", "gain": gain, "bias": numbers([constant, stiffness, damping])}


def _symmetric(ends: Any) -> float | None:
    """The size of a range around zero; None for others."""
    low, high = (float(value) for value in ends)
    return high if low == -high and high > 0.0 else None
