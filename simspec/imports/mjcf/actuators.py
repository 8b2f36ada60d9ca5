"""Actuators and keys of a compiled model, and what of a model is not carried."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from simspec.imports.mjcf.bodies import MjcfBodies, MjcfNames, numbers, pose, rotated
from simspec.imports.mjcf.compiled import BALL, FREE, HINGE, SLIDE, CompiledMjcf
from simspec.imports.mjcf.constraints import add_tendons
from simspec.language.beginning import Start
from simspec.language.joints import ROUND_OFF, nearest, scaled_to, within
from simspec.language.trees import MOST
from simspec.world.inertia import SINGULAR

TRANSMISSIONS: Final = (0, 1)
"""Types of transmission that are a hinge or a slide: of a joint, and of one in its parent's frame."""
NONE, FIXED, AFFINE = 0, 0, 1
"""Types of dynamics and bias (none), of gain (fixed), and of bias (affine)."""
NOTE: Final = "they act where `control: {NAME: {actuators: [...]}}` names them"


def add_actuators(bodies: MjcfBodies, constraints: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The actuators of a file, by their names; those that a spec has are carried, the others are told."""
    model, names = bodies.model, MjcfNames()
    following = {held["follow"]["joint"] for held in constraints.values() if "follow" in held}
    made: dict[str, dict[str, Any]] = {}
    for number, part in model.parts["actuator"].items():
        words = _words(bodies, number, following) if len(made) < MOST["actuators"] else None
        if words is not None:
            made[names.give(part.name, f"actuator_{number}")] = words
            bodies.features.carry(part.element)
            bodies.features.actuators.add(number)
    return made


def _words(bodies: MjcfBodies, number: int, following: set[str]) -> dict[str, Any] | None:
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


# --- keys as named states; the activation of actuators is not in them ---

MOST_STATES: Final = 1000


def add_states(
    bodies: MjcfBodies, constraints: Mapping[str, Any], actuators: Mapping[str, Mapping[str, Any]], starts: list[Start]
) -> dict[str, dict[str, Any]]:
    """The states of a model of one root, by their names; ``actuators``: those of the spec, by theirs. Joints that a key puts
    beyond their limits are at the nearest limit, and are added to ``starts``. A joint that follows another begins where that
    one says."""
    model, names = bodies.model, MjcfNames()
    following = {held["follow"]["joint"] for held in constraints.values() if "follow" in held}
    states: dict[str, dict[str, Any]] = {}
    for key in range(min(model.numbers["nkey"], MOST_STATES)):
        moved: list[Start] = []
        state = _state(bodies, model["key_qpos"][key], model["key_qvel"][key], following, moved)
        if state is not None:
            name = model.part("key", key).name
            if commands := _commands(bodies, model["key_ctrl"][key], actuators, name):
                state["commands"] = commands
            given = names.give(name, f"state_{key}")
            states[given] = state
            starts += [replace(one, state=given, path=("model", "states", given)) for one in moved]
            bodies.features.states.add(name)
    return states


def _commands(
    bodies: MjcfBodies, inputs: Any, actuators: Mapping[str, Mapping[str, Any]], key: str
) -> dict[str, float]:
    """The inputs of a key as commands of the spec's actuators, where they are others than these have anyway. An input beyond
    the limits acts as the nearest within."""
    model, numbered = bodies.model, list(bodies.model.parts["actuator"])
    if len(inputs) != len(numbered):
        return {}  # actuators with other than one input each
    carried = [number for number in numbered if number in bodies.features.actuators]
    if all(not inputs[number] for number in numbered if number not in bodies.features.actuators):
        bodies.features.commanded.add(key)
    commands = {}
    for number, (name, words) in zip(carried, actuators.items(), strict=True):
        value = float(inputs[number])
        if "command_limits" in words:
            low, high = (float(end) for end in model["actuator_ctrlrange"][number])
            value = min(max(value, low), high)
        if value != words.get("command", 0.0):
            commands[name] = value
    return commands


def _state(bodies: MjcfBodies, qpos: Any, qvel: Any, following: set[str], moved: list[Start]) -> dict[str, Any] | None:
    """A key as a state; None for a joint whose implied name is another's. Joints at a limit, since they would be beyond it, are
    added to ``moved``."""
    model = bodies.model
    state: dict[str, Any] = {}
    positions: dict[str, Any] = {}
    velocities: dict[str, Any] = {}
    for joint in range(model.numbers["njnt"]):
        kind, at, dof, body = (int(model[f"jnt_{word}"][joint]) for word in ("type", "qposadr", "dofadr", "bodyid"))
        own = bodies.names[body]
        name = bodies.joints.get(joint)
        if name is None and f"{own}_joint" in bodies.joint_names.taken:
            return None  # whose implied name is another's
        name = name or f"{own}_joint"
        if kind == FREE:
            turn, spin = np.asarray(qpos[at + 3 : at + 7]), np.asarray(qvel[dof + 3 : dof + 6])
            lever = rotated(turn, bodies.shifts[body])
            angular = rotated(turn, spin)
            state["pose"] = pose(np.asarray(qpos[at : at + 3]) + lever, turn) or {"xyz": [0, 0, 0]}
            if np.any(qvel[dof : dof + 6]):
                linear = np.asarray(qvel[dof : dof + 3]) + np.cross(angular, lever)
                state["velocity"] = {"linear": numbers(linear), "angular": numbers(angular)}
        elif name in following:
            continue
        elif kind == BALL:
            orientation = [float(value) for value in qpos[at : at + 4]]
            largest = bodies.joint_data(joint).get("limits", {}).get("angle", math.pi)
            angle = 2.0 * math.atan2(math.hypot(*orientation[1:]), abs(orientation[0]))
            if angle > largest + ROUND_OFF:
                orientation = list(scaled_to(orientation, largest))
                moved.append(Start(name, (), largest, angle))
            positions[name] = {"quat": numbers(orientation)}
            if np.any(qvel[dof : dof + 3]):
                velocities[name] = numbers(np.asarray(qvel[dof : dof + 3]))
        else:
            reference = float(model["qpos0"][at])
            value = float(qpos[at]) - reference
            if bool(model["jnt_limited"][joint]) and not model.disabled("limit", "constraint"):
                limits = [float(bound) - reference for bound in model["jnt_range"][joint]]
                if within(value, limits) is None:
                    moved.append(Start(name, (), nearest(value, limits), value))
                value = nearest(value, limits)
            positions[name] = value
            if qvel[dof]:
                velocities[name] = float(qvel[dof])
    state |= {key: values for key, values in (("positions", positions), ("velocities", velocities)) if values}
    return state


# --- what is not carried ---

JOINT: Final = 0
"""The type of transmission that is a joint."""
"""Types of dynamics and bias (none), of gain (fixed), and of bias (affine)."""


def outside_the_tree(bodies: MjcfBodies, constraints: dict[str, Any]) -> None:
    """Add sums of joint positions to ``constraints``, and say as features what the spec does not have of the rest."""
    model, features = bodies.model, bodies.features
    if model.has_fluid:
        _say_fluid(bodies)
    add_tendons(bodies, bodies.held_tendons, constraints)
    for number, part in model.parts["actuator"].items():
        if _has_inertia(bodies, number):
            features.add("actuator.inertia", part.element, _controller(bodies, number))
        elif number not in features.actuators:
            features.add("actuator", part.element, _controller(bodies, number))
    if model.numbers["nplugin"]:
        features.add("plugin", model.root)


def _say_fluid(bodies: MjcfBodies) -> None:
    """The bodies on which a fluid acts by another law, or by another box, than in the spec."""
    model, features = bodies.model, bodies.features
    for number in np.flatnonzero(model["geom_fluid"][:, 0]).tolist():
        features.add("geom.fluid", model.part("geom", number).element)
    groups: dict[int, list[int]] = {}
    for number in bodies.names:
        groups.setdefault(int(model["body_weldid"][number]), []).append(number)
    for top, members in groups.items():
        heavy = [number for number in members if float(model["body_mass"][number]) > 0.0]
        if top and len(heavy) > 1 and any(_singular(model, number) for number in {top, *heavy}):
            features.add("option.fluid", model.part("body", top).element)


def _singular(model: CompiledMjcf, number: int) -> bool:
    moments = model["body_inertia"][number]
    return float(model["body_mass"][number]) <= 0.0 or float(min(moments)) <= SINGULAR * float(max(moments))


def _has_inertia(bodies: MjcfBodies, number: int) -> bool:
    """Whether an actuator changes the inertia or damping of what it drives."""
    arrays = (bodies.model.get("actuator_armature"), bodies.model.get("actuator_damping"))
    return any(values is not None and values[number].any() for values in arrays)


def _controller(bodies: MjcfBodies, number: int) -> str:
    """The controller of a spec that acts as an actuator; empty where there is none. The effort is
    g (a u + b₀ + b₁ g q + b₂ g v) with the gear g, the gain a and the input u."""
    model = bodies.model
    joint = int(model["actuator_trnid"][number][0])
    kinds = [int(model[f"actuator_{word}"][number]) for word in ("trntype", "dyntype", "gaintype")]
    if kinds != [JOINT, NONE, FIXED] or joint not in bodies.joints:
        return ""
    gear, gain = float(model["actuator_gear"][number][0]), float(model["actuator_gainprm"][number][0])
    bias = (
        model["actuator_biasprm"][number][:3].astype(float)
        if int(model["actuator_biastype"][number]) == AFFINE
        else (0.0,) * 3
    )
    kp, kd = (-float(value) * gear**2 + 0.0 for value in bias[1:])
    if bias[0] or kp < 0.0 or kd < 0.0 or (kp and gain * gear**2 != kp):
        return ""
    said = [f"joints: [{bodies.joints[joint]}]"]
    if not kp:
        said.append(f"actuator: {'velocity' if kd else 'effort'}")
    said += [f"{word}: {value:.12g}" for word, value in (("kp", kp), ("kd", kd)) if value]
    limit = None
    if bool(model["actuator_forcelimited"][number]):
        limit = float(max(abs(model["actuator_forcerange"][number]))) * abs(gear)
    elif not kp and not kd and bool(model["actuator_ctrllimited"][number]):
        limit = float(max(abs(model["actuator_ctrlrange"][number]))) * abs(gain * gear)
    if limit is not None:
        said.append(f"effort_limit: {limit:.12g}")
    return f"control: {{NAME: {{{', '.join(said)}}}}}"
