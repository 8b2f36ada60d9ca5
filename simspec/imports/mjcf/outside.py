"""What a compiled model has beside its tree of bodies: constraints, tendons, actuators, fluids, named states."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from simspec.imports.mjcf.bodies import Bodies
from simspec.imports.mjcf.compiled import Compiled
from simspec.imports.mjcf.tendons import add_tendons
from simspec.world.inertia import SINGULAR

JOINT: Final = 0
"""The type of transmission that is a joint."""
NONE, FIXED, AFFINE = 0, 0, 1
"""Types of dynamics and bias (none), of gain (fixed), and of bias (affine)."""


def outside_the_tree(bodies: Bodies, constraints: dict[str, Any]) -> None:
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


def _say_fluid(bodies: Bodies) -> None:
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


def _singular(model: Compiled, number: int) -> bool:
    moments = model["body_inertia"][number]
    return float(model["body_mass"][number]) <= 0.0 or float(min(moments)) <= SINGULAR * float(max(moments))


def _has_inertia(bodies: Bodies, number: int) -> bool:
    """Whether an actuator changes the inertia or damping of what it drives."""
    arrays = (bodies.model.get("actuator_armature"), bodies.model.get("actuator_damping"))
    return any(values is not None and values[number].any() for values in arrays)


def _controller(bodies: Bodies, number: int) -> str:
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
