"""The parts that a world's proof must contain, from the world alone: parts that it does not have are named with the reason.

A stored certificate is judged by the same function as a new one (:func:`shortfalls`).
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from simspec.compiler import compile_world
from simspec.control.reference import natives
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.kit.capabilities import DOUBLE, Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engine_name, find_engine
from simspec.errors import UnsupportedError
from simspec.proof import accelerations, motion
from simspec.proof.checks import INVENTORY, INVENTORY_LEVEL, NOTHING, PRECISIONS, TOO_CHAOTIC, Check, Part, failed
from simspec.proof.contact.size import NAME as SIZE
from simspec.proof.contact.size import size_trial
from simspec.proof.forces import FORCES_CHECK, PRESCRIBED_CHECK, REST_CHECK, SLIDING_CHECK
from simspec.proof.limits import BALLS_CHECK, STOPS_CHECK, followers, left_to, no_ball_stops, nothing_stops
from simspec.proof.motion import MOTION
from simspec.proof.touch.plan import nothing_to_try, oracle_of
from simspec.support.declarations import Level
from simspec.support.negotiation import Decision
from simspec.world.canonical import derived
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import frictional_coordinates, initial_state
from simspec.world.types import VELOCITY_SIZE, Pair, ReadBack, World

# Worlds of which every motion is at a limit of a joint, where motion proofs cannot follow: why, from the world alone.

LOCKED = 1e-9
"""Share of a joint's speed that constraints leave it, below which they hold it: of what they leave free it is 0.1 and more, of
what they hold round-off (measured: 1e-13 at most)."""
MARGIN = 0.05
"""Share of its range within which a joint is near a limit."""


@derived
def motionless(world: World) -> str:
    """Why every motion of a world is at a limit; "" where one may be found that is not."""
    for body in world.bodies:
        limits = body.joint.position_limits
        if limits is not None and limits[0] >= limits[1]:
            return f"the limits of joint {body.joint.name!r} leave it one position, so that every motion is at a limit"
    return (_without_room(world) or _kept_at_a_limit(world)) if world.constraints else ""


def _without_room(world: World) -> str:
    """The same of a world in which joints that follow one other have no position at which all are inside their limits, as two
    that turn against each other and may both turn one way only."""
    limits = {body.joint.name: body.joint.position_limits for body in world.bodies}
    for first, chain in followers(world).items():
        low, high = left_to(chain, limits, MARGIN)
        if low >= high:
            names = ", ".join(repr(name) for name, _, _ in chain)
            return (
                f"no position of joint {first!r} leaves all of {names} away from their limits by {MARGIN:.0%} of their ranges, "
                "so that every motion is at a limit"
            )
    return ""


def _kept_at_a_limit(world: World) -> str:
    """The same of a world whose constraints hold a joint where it begins, and that is at a limit or beyond. It is held where it
    cannot move at the beginning, nor where the other joints are as far inside their limits as they come: in one of the two a
    linkage that can move may be at the end of its way."""
    oracle = oracle_of(world)
    start, _ = initial_state(world)
    q = oracle.inwards(start)
    for body, at_q, at_v in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True):
        if body.joint.position_limits is None:
            continue
        low, high = body.joint.position_limits
        stands = float(q[at_q.start])
        if low + MARGIN * (high - low) <= stands <= high - MARGIN * (high - low):
            continue
        unit = np.zeros(oracle.nv)
        unit[at_v.start] = 1.0
        if all(abs(oracle.constrained_velocity(where, unit)[at_v.start]) < LOCKED for where in (start, q)):
            at = f"at {stands + 0.0:.6g}, within {MARGIN:.0%} of its range to a limit, or beyond: {low:g} to {high:g}"
            return f"constraints hold joint {body.joint.name!r} {at}, so that every motion is at a limit"
    return ""


# Worlds whose contact-free motion cannot be compared, since round-off alone makes two computations of it differ.


@derived
def chaotic(world: World, precision: str = DOUBLE) -> str:
    """Why level L6 cannot compare the motion of a world in numbers of a precision; "" where it can.

    From the world alone, so that a certificate that says so can be judged. It costs a plan of the motion.
    """
    if motionless(world):
        return ""
    return motion.plan(world, oracle_of(world), PRECISIONS[precision]).chaos


NOT_REQUESTED = "not requested"
"""The reason of a part that the caller of ``verify`` left out."""
MATRIX = "collision matrix"
OPTIONAL = (("L4", MATRIX), ("L5", ""), ("L6", ""), ("L7", ""))
"""The parts that are left out where their level is not requested; all else comes from one read-back and two quick probes."""


@dataclass(frozen=True, slots=True)
class PartRule:
    """``missing``: "" where a world has a part, or why it has none (None: the part is compared where it can be). ``needs``:
    capabilities in addition to an engine's core. ``frictionless``: joints' dry friction is switched off in it. ``mentioned``: a
    certificate says why a world has none."""

    missing: Callable[[World], str] | None
    needs: tuple[Capability, ...] = ()
    frictionless: bool = False
    mentioned: bool = True
    by_steps: bool = False
    """Whether accelerations of a step stand for what an engine lacks (``proof/accelerations.py``)."""


def _moves(world: World) -> str:
    moving = any(VELOCITY_SIZE[body.joint.kind] for body in world.bodies)
    return "" if moving else "nothing moves in this world"


def _driven(world: World) -> str:
    if not world.controllers:
        return "nothing is driven in this world"
    native = all(controller.law == "native" for controller in world.controllers)
    return "joints are driven by the engines' own controllers alone, a declared difference" if native else ""


def _frictional(world: World) -> str:
    return "" if len(frictional_coordinates(world)) else "no joint has dry friction"


_ALWAYS = PartRule(lambda world: "")
_FREE = (Capability.CONTACT_OFF,)
PARTS: Mapping[Part, PartRule] = {
    ("L0", ""): _ALWAYS,
    ("L1", ""): _ALWAYS,
    ("L2", ""): _ALWAYS,
    ("L2", "pose, position"): _ALWAYS,
    ("L3", ""): PartRule(_moves),
    ("L3", "mass matrix"): PartRule(_moves, (Capability.MASS_MATRIX,), by_steps=True),
    ("L3", "bias force"): PartRule(_moves, (Capability.BIAS_FORCE,), by_steps=True),
    ("L3", "gravity force"): PartRule(_moves, (Capability.BIAS_FORCE,), by_steps=True),
    ("L4", ""): _ALWAYS,
    (INVENTORY_LEVEL, INVENTORY): PartRule(None, (Capability.INVENTORY,)),
    ("L4", MATRIX): PartRule(nothing_to_try, (Capability.PAIR_DETECTION,)),
    ("L5", ""): PartRule(lambda world: "" if meeting_laws(world) else "no two shapes of this world may touch"),
    ("L5", SIZE): PartRule(None, (Capability.PAIR_DETECTION,)),
    ("L6", ""): PartRule(lambda world: _frictional(world) and motionless(world)),
    MOTION: PartRule(motionless, _FREE, frictionless=True),
    ("L6", SLIDING_CHECK): PartRule(_frictional, _FREE),
    ("L6", REST_CHECK): PartRule(_frictional, _FREE),
    ("L6", STOPS_CHECK): PartRule(nothing_stops, _FREE, True, False),
    ("L6", BALLS_CHECK): PartRule(no_ball_stops, _FREE, True, False),
    ("L7", ""): PartRule(lambda world: "" if world.forces or world.motions else _driven(world)),
    ("L7", "step response"): PartRule(_driven, _FREE, True),
    ("L7", FORCES_CHECK): PartRule(
        lambda world: "" if world.forces else "no force acts on a body of this world", _FREE, True, False
    ),
    ("L7", PRESCRIBED_CHECK): PartRule(
        lambda world: "" if world.motions else "no body of this world is kinematic", _FREE, True, False
    ),
}
"""The parts of a proof, in its order."""


def title(level: str, name: str) -> str:
    """How a part is called in a certificate: its level, and the check's name."""
    return f"{level} {name}".strip()


def expected(world: World) -> dict[Part, str]:
    """For every part of a proof (level, name of a check or "" for any) the reason why this world has none; "" where it must
    have been compared."""
    return {part: rule.missing(world) for part, rule in PARTS.items() if rule.missing is not None}


def left_out(world: World, levels: Iterable[str] | None = None) -> dict[str, str]:
    """The parts that a world does not have by its nature, or of ``OPTIONAL`` what is not in ``levels`` (None: all are
    requested), by :func:`title`, with the reason. A check is named only where the rest of its level is compared."""
    reasons: dict[str, str] = {}
    for (level, name), why in expected(world).items():
        if (level, name) in OPTIONAL and levels is not None and level not in levels:
            why = NOT_REQUESTED
        if why and level not in reasons and (why == NOT_REQUESTED or PARTS[level, name].mentioned):
            reasons[title(level, name)] = why
    return reasons


def uncomparable(world: World, precision: str = DOUBLE) -> dict[str, str]:
    """The parts that a world has and that numbers of a precision cannot compare, by :func:`title`, with the reason: too chaotic
    a motion. It is named by its level where the world has nothing else of that level. It costs a plan of the motion."""
    why = chaotic(world, precision)
    if not why:
        return {}
    alone = all(
        reason for (level, name), reason in expected(world).items() if level == "L6" and name not in ("", "motion")
    )
    return {"L6" if alone else "L6 motion": why}


def shortfalls(world: World, checks: Sequence[Check], not_compared: Mapping[str, str]) -> list[Check]:
    """A failed check for each part that was not compared, though it is expected of ``world`` and ``not_compared`` (by
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
    by_world = left_out(world)
    if any(why.startswith(TOO_CHAOTIC) for why in not_compared.values()):
        by_world |= {name: why for name, why in uncomparable(world, precision).items() if name in not_compared}
    faults = [
        f"{name} is listed as not compared ({why}), which does not apply to this world"
        for name, why in not_compared.items()
        if name not in by_world
    ]
    by_nature = {name: why for name, why in not_compared.items() if name in by_world}
    every = itertools.chain(checks, shortfalls(world, checks, {**by_nature, **lacking}))
    faults += [
        f"{title(check.level, check.name)}: {check.detail or check.worst}" for check in every if not check.passed
    ]
    return faults


# Parts that a proof does not check because an engine lacks what it takes (``Engine.LACKS``): parts of levels, with the reason.
#
# Such a part is neither passed nor failed. A certificate says that it was not checked, and a stored one is compared with the
# engine's declarations, so that nothing else can hide there.

ENGINE_LEVELS = ("L1", "L2", "L3", "L4", "L5", "L6", "L7")
"""The levels that need the engine: all but that of the files."""
NAMED_LEVELS = ("L3", "L6", "L7")
"""The levels that are made of named parts and nothing else."""
TITLES = frozenset({title(*part) for part, rule in PARTS.items() if rule.needs} | set(ENGINE_LEVELS))
"""Every name under which a certificate says that a part was not checked."""


def unchecked(world: World, engine: type[Engine]) -> dict[Part, str]:
    """The parts (level, name of a check) that ``engine`` does not support, with the reason that it declares."""
    off = (Capability.DRY_FRICTION_OFF,) if len(frictional_coordinates(world)) else ()
    parts = {}
    for part, rule in PARTS.items():
        finer = (Capability.TIMESTEP,) if part == MOTION and engine.method(world) is not None else ()
        taken = (*rule.needs, *(off if rule.frictionless else ()), *finer)
        reasons = [engine.LACKS[capability] for capability in taken if capability in engine.LACKS]
        if reasons and rule.by_steps:
            reasons = reasons if _no_steps(part, world, engine) else []
        if reasons:
            parts[part] = "; ".join(dict.fromkeys(reasons))
    return parts


def _no_steps(part: Part, world: World, engine: type[Engine]) -> str:
    """Why accelerations of a step do not stand for a part that an engine lacks; "" where they do."""
    if part == ("L3", accelerations.BIAS) and engine.method(world) is not None:
        return "another method of integration adds terms of the order of the timestep; its motion in the limit contains them"
    return accelerations.uncomparable(world, engine)


def by_steps(world: World, engine: type[Engine]) -> tuple[str, ...]:
    """The checks of L3 that are made by accelerations of one step."""
    return tuple(
        name
        for (level, name), rule in PARTS.items()
        if rule.by_steps
        and any(capability in engine.LACKS for capability in rule.needs)
        and rule.missing is not None
        and not rule.missing(world)
        and not _no_steps((level, name), world, engine)
    )


def not_checked_parts(world: World, engine: type[Engine], not_compared: Mapping[str, str]) -> dict[str, str]:
    """The same as a certificate says it: by title, and by level where nothing of a level is left; without what ``not_compared``
    names, which this world does not have, or that were not requested."""
    lacking, wanted = unchecked(world, engine), expected(world)
    parts: dict[str, str] = {}
    for (level, name), why in lacking.items():
        if level in not_compared or title(level, name) in not_compared or wanted.get((level, name)):
            continue
        if (level, name) == ("L5", SIZE) and size_trial(world) is None:
            continue
        others = [part for part, absent in wanted.items() if part[0] == level and part[1] and not absent]
        whole = level in NAMED_LEVELS and all(part in lacking for part in others)
        key = level if whole else title(level, name)
        parts[key] = "; ".join(dict.fromkeys([*parts[key].split("; "), why])) if key in parts else why
    return parts


def of_files_alone(not_compared: Mapping[str, str], why: str) -> dict[str, str]:
    """The levels that are not checked of an engine that is not installed (``why``): every level but that of the files, without
    those that ``not_compared`` names."""
    return {level: why for level in ENGINE_LEVELS if level not in not_compared}


NO_FRAMES = "simspec passes no frames to the engine"
"""Why frames are not readable back."""


def not_checked(world: World, read_back: ReadBack) -> dict[str, str]:
    """The fields that a read-back does not contain, with the reasons, sorted; of engines' own controllers and of frames only
    where the world has some."""
    left = unreadable(world, read_back.unreadable)
    if world.frames and read_back.frames is None:
        left["frames"] = NO_FRAMES
    return dict(sorted(left.items()))


def unreadable(world: World, declared: Mapping[str, str]) -> dict[str, str]:
    """Of the fields that an engine declares not to be readable back those that the world has."""
    native = natives(world)
    return {field: why for field, why in declared.items() if native or field != "control.native"}


# How an engine's files realise a world: the decisions on its features and the settings in force, from which follow the
# accepted approximations of a certificate and the declared deviations that may count in it.


@dataclass(frozen=True)
class Realised:
    """``approximations``: as a certificate has them; ``settings``: of the whole world, and ``pairs``, those of pairs of
    materials, which replace them there; ``refused``: why the world cannot be compiled for the engine, "" where it can."""

    approximations: Mapping[str, str]
    settings: Mapping[str, Any]
    pairs: Mapping[Pair, Mapping[str, Any]]
    refused: str = ""

    def between(self, pair: Pair) -> Mapping[str, Any]:
        """The settings that are in force between two materials (sorted names)."""
        return {**self.settings, **self.pairs.get(pair, {})}


def approximations(decisions: Iterable[Decision]) -> dict[str, str]:
    """The features that are approximate, or computed outside the engine, with how: those that a spec accepts by name."""
    return {
        decision.feature.value: f"{decision.level.value}: {decision.how}"
        for decision in decisions
        if decision.level in (Level.APPROXIMATE, Level.OUTSIDE)
    }


@derived
def realised(world: World, engine: str, version: str) -> Realised:
    """The realisation of ``world`` by an engine (a name or label) of a version."""
    label = f"{engine_name(engine)}@{version}" if find_engine(engine).version() is not None else engine
    try:
        compiled = compile_world(world, [label])[label]
    except UnsupportedError as error:
        return Realised({}, {}, {}, error.problems[0].message)
    sidecar = json.loads(compiled.files[SIDECAR])
    pairs = {
        (entry["between"][0], entry["between"][1]): entry["settings"] for entry in sidecar.get("pair_settings", ())
    }
    return Realised(approximations(compiled.decisions), sidecar["settings"], pairs)
