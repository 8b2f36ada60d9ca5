"""What a world's proof must hold, from the world alone: what the world does not have is not compared and says why; all else is.

A stored certificate is judged by the same function as a new one (:func:`shortfalls`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

from simspec.engines.kit.capabilities import DOUBLE
from simspec.proof.chaos import chaotic
from simspec.proof.checks import NOTHING, TOO_CHAOTIC, Check, failed
from simspec.proof.dry_friction import REST_CHECK, SLIDING_CHECK
from simspec.proof.forces import FORCES_CHECK, PRESCRIBED_CHECK
from simspec.proof.motionless import motionless
from simspec.proof.sum_limits import BALLS_CHECK, STOPS_CHECK, no_ball_stops, nothing_stops
from simspec.proof.touch.plan import nothing_to_try
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import frictional_coordinates
from simspec.world.types import VELOCITY_SIZE, World

NOT_ASKED = "not asked for"
"""The reason of a part that the caller of ``verify`` left out."""
OPTIONAL = (("L4", "collision matrix"), ("L5", ""), ("L6", ""), ("L7", ""))
"""The parts that are left out where their level is not asked for; all else comes from one read-back and two quick probes."""


def _always(world: World) -> str:
    return ""


def _moves(world: World) -> str:
    moving = any(VELOCITY_SIZE[body.joint.kind] for body in world.bodies)
    return "" if moving else "nothing moves in this world"


def _contact(world: World) -> str:
    return "" if meeting_laws(world) else "no two shapes of this world may touch"


def _driven(world: World) -> str:
    if not world.controllers:
        return "nothing is driven in this world"
    native = all(controller.law == "native" for controller in world.controllers)
    return "joints are driven by the engines' own controllers alone, a declared difference" if native else ""


def _pushed(world: World) -> str:
    return "" if world.forces else "no force acts on a body of this world"


def _prescribed(world: World) -> str:
    return "" if world.motions else "no body of this world is kinematic"


def _acts(world: World) -> str:
    return "" if world.forces or world.motions else _driven(world)


def _rubs(world: World) -> str:
    return "" if len(frictional_coordinates(world)) else "no joint has dry friction"


def _moves_or_rubs(world: World) -> str:
    return _rubs(world) and motionless(world)


PARTS: Mapping[tuple[str, str], Callable[[World], str]] = {
    ("L0", ""): _always,
    ("L1", ""): _always,
    ("L2", ""): _always,
    ("L2", "pose, position"): _always,
    ("L3", ""): _moves,
    ("L3", "mass matrix"): _moves,
    ("L3", "bias force"): _moves,
    ("L3", "gravity force"): _moves,
    ("L4", ""): _always,
    ("L4", "collision matrix"): nothing_to_try,
    ("L5", ""): _contact,
    ("L6", ""): _moves_or_rubs,
    ("L6", "motion"): motionless,
    ("L6", SLIDING_CHECK): _rubs,
    ("L6", REST_CHECK): _rubs,
    ("L6", STOPS_CHECK): nothing_stops,
    ("L6", BALLS_CHECK): no_ball_stops,
    ("L7", ""): _acts,
    ("L7", "step response"): _driven,
    ("L7", FORCES_CHECK): _pushed,
    ("L7", PRESCRIBED_CHECK): _prescribed,
}
"""Level, and name of a check ("" any), to the function that says "" where a world has it, or why a world has none."""


UNMENTIONED = (("L6", STOPS_CHECK), ("L6", BALLS_CHECK), ("L7", FORCES_CHECK), ("L7", PRESCRIBED_CHECK))
"""Parts of which a certificate says nothing where a world has none."""


def title(level: str, name: str) -> str:
    """How a part is called in a certificate: its level, and the check's name."""
    return f"{level} {name}".strip()


def expected(world: World) -> dict[tuple[str, str], str]:
    """For every part of a proof (level, name of a check or "" for any) the reason why this world has none; "" where it must
    have been compared."""
    return {part: why(world) for part, why in PARTS.items()}


def left_out(world: World, levels: Iterable[str] | None = None) -> dict[str, str]:
    """What a world does not have by its nature, or of ``OPTIONAL`` what is not in ``levels`` (None: all are asked for), by
    :func:`title`, with the reason. A check is named only where the rest of its level is compared."""
    reasons: dict[str, str] = {}
    for (level, name), why in expected(world).items():
        if (level, name) in OPTIONAL and levels is not None and level not in levels:
            why = NOT_ASKED
        if why and level not in reasons and (why == NOT_ASKED or (level, name) not in UNMENTIONED):
            reasons[title(level, name)] = why
    return reasons


def uncomparable(world: World, precision: str = DOUBLE) -> dict[str, str]:
    """What a world has and numbers of a precision cannot compare, by :func:`title`, with the reason: too chaotic a motion.
    It is named by its level where the world has nothing else of that level. It costs a plan of the motion."""
    why = chaotic(world, precision)
    if not why:
        return {}
    alone = all(
        reason for (level, name), reason in expected(world).items() if level == "L6" and name not in ("", "motion")
    )
    return {"L6" if alone else "L6 motion": why}


def shortfalls(world: World, checks: Sequence[Check], not_compared: Mapping[str, str]) -> list[Check]:
    """A failed check for each part that nobody compared, though it is expected of ``world`` and ``not_compared`` (by
    :func:`title`) does not name it."""
    compared = {check.level for check in checks if check.count}
    compared_checks = {(check.level, check.name) for check in checks if check.count}
    known = {(check.level, check.name) for check in checks} | {(check.level, "") for check in checks}
    failures: list[Check] = []
    for (level, name), why in expected(world).items():
        done = (level, name) in compared_checks if name else level in compared
        if done or why or level in not_compared or title(level, name) in not_compared or (level, name) in known:
            continue  # a check that is there and compared nothing has failed by itself
        if name and any(check.level == level and check.name == NOTHING for check in failures):
            continue
        failures.append(failed(level, NOTHING, f"{name}: no comparison was made" if name else "no comparison was made"))
    return failures


def judge(
    world: World,
    checks: Sequence[Check],
    not_compared: Mapping[str, str],
    lacking: Mapping[str, str] = MappingProxyType({}),
    precision: str = DOUBLE,
) -> list[str]:
    """Why checks, and what is listed as not compared, do not prove ``world``, a line each; [] when they do. For a certificate
    from a file, whose every word may be wrong. ``lacking``: the parts that the engine declares not to be askable for.
    ``precision``: of the engine's numbers."""
    own = left_out(world)
    if any(why.startswith(TOO_CHAOTIC) for why in not_compared.values()):
        own |= {name: why for name, why in uncomparable(world, precision).items() if name in not_compared}
    faults = [
        f"{name} is listed as not compared ({why}), which does not apply to this world"
        for name, why in not_compared.items()
        if name not in own
    ]
    by_nature = {name: why for name, why in not_compared.items() if name in own}
    every = itertools.chain(checks, shortfalls(world, checks, {**by_nature, **lacking}))
    faults += [
        f"{title(check.level, check.name)}: {check.detail or check.worst}" for check in every if not check.passed
    ]
    return faults
