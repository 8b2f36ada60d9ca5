"""Named states: keys of a model as ``states`` of the spec's, their inputs as commands of actuators. The memory of actuators is
not in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from simspec.imports.mjcf.bodies import Bodies, Names, numbers, pose, rotated
from simspec.imports.mjcf.compiled import BALL, FREE
from simspec.language.beginning import Start
from simspec.language.joints import ROUND_OFF, nearest, scaled_to, within

MOST_STATES: Final = 1000


def add_states(
    bodies: Bodies,
    constraints: Mapping[str, Any],
    actuators: Mapping[str, Mapping[str, Any]],
    starts: list[Start],
) -> dict[str, dict[str, Any]]:
    """The states of a model of one root, by their names; ``actuators``: those of the spec, by theirs. Joints that a key puts
    beyond their limits are at the nearest limit, and are added to ``starts``. A joint that follows another begins where that
    one says."""
    model, names = bodies.model, Names()
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


def _commands(bodies: Bodies, inputs: Any, actuators: Mapping[str, Mapping[str, Any]], key: str) -> dict[str, float]:
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


def _state(bodies: Bodies, qpos: Any, qvel: Any, following: set[str], moved: list[Start]) -> dict[str, Any] | None:
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
