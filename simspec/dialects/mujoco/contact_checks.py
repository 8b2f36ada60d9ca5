"""What MuJoCo cannot have of the laws of materials that meet, and of settings together."""

from __future__ import annotations

import math
from collections.abc import Iterator

from simspec.dialects.kit.target import Target
from simspec.dialects.mujoco.contact import COMPLIANT, inverse_masses, is_coulomb
from simspec.errors import Problem
from simspec.world.contact_pairs import meeting_laws, shape_pairs
from simspec.world.types import PairContact, World

MOST_PER_STEP = 4.0
"""Of k dt²/m + 2 c dt/m: where the semi-implicit step of an oscillator, v' = v − dt (k r + c v)/m, r' = r + dt v', stops being
stable (its characteristic polynomial at −1)."""


def _faults(world: World, law: PairContact) -> Iterator[tuple[str, str, str]]:
    """What is wrong with one law: quantity, message, hint."""
    pyramid = world.contact.friction_cone != "elliptic"
    hardness, dt = law.hardness, world.physics.timestep
    if pyramid:
        for name in ("torsional_friction", "rolling_friction"):
            if getattr(law, name):
                yield name, f"under MuJoCo's pyramid {name.replace('_', ' ')} is wrong (measured)", _ELLIPTIC
        if law.friction and hardness.kind in COMPLIANT:
            yield "hardness", "under MuJoCo's pyramid friction of compliant contact does not stick", _ELLIPTIC
    if law.restitution and hardness.kind != "common":
        yield (
            "restitution",
            f"MuJoCo does not support restitution with {hardness.kind} hardness",
            "set the restitution to zero",
        )
    if hardness.kind == "time-constant" and hardness.time_constant < 2.0 * dt:
        yield (
            "hardness",
            "MuJoCo raises a time constant below two timesteps to two",
            f"at least {2.0 * dt:g} s, or a smaller timestep",
        )


_ELLIPTIC = "use friction_cone: elliptic"


def check_friction(target: Target) -> list[Problem]:
    """What does not go together with Coulomb's law."""
    if not is_coulomb(target) or target.settings["solver"] != "pgs":
        return []
    return [
        Problem(
            "MuJoCo's solver pgs does not converge to Coulomb's law: a slider is off by 47 % and hops 133 mm (measured)",
            "engines.mujoco.settings.friction",
            found="friction: coulomb with solver: pgs",
            hint="solver: newton or cg",
        )
    ]


def check_laws(world: World) -> list[Problem]:
    """What MuJoCo cannot have of the laws of materials that meet."""
    laws = meeting_laws(world)
    problems = [
        Problem(message, f"contact.pairs.{first}.{second}.{name}", hint=hint)
        for (first, second), law in laws.items()
        for name, message, hint in _faults(world, law)
    ]
    springs = {pair: law.hardness for pair, law in laws.items() if law.hardness.kind == "stiffness"}
    inverse = inverse_masses(world) if springs else {}
    dt = world.physics.timestep
    for pair, spring in springs.items():
        weights = {inverse[one] + inverse[two]: (one, two) for one, two in shape_pairs(world, [pair])}
        for weight, shapes in weights.items():
            if math.isnan(weight):
                message = (
                    "MuJoCo's stiffness is known between free single bodies and what cannot move, not for mechanisms"
                )
                hint = "use {time_constant, damping_ratio}"
            elif spring.stiffness * weight * dt * dt + 2.0 * spring.damping * weight * dt >= MOST_PER_STEP:
                message = (
                    "the spring is too hard for the timestep and these masses: MuJoCo's steps would amplify its motion"
                )
                hint = "a smaller timestep, less stiffness or less damping"
            else:
                continue
            problems.append(
                Problem(message, f"contact.pairs.{pair[0]}.{pair[1]}.hardness", found=" with ".join(shapes), hint=hint)
            )
            break
    return problems
