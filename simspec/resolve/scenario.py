"""The rest of the world: time, what to record, what to expect, what to say to engines."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from simspec.errors import Problem
from simspec.files import RECORDED_BYTES
from simspec.language.actions import Motion as SpecMotion
from simspec.language.contact import EngineOptions as SpecOptions
from simspec.language.document import Details, Key
from simspec.language.expectations import BODIES, KINDS, TIMES, ExpectationKind
from simspec.language.physics import Physics as SpecPhysics
from simspec.language.physics import Record as SpecRecord
from simspec.language.physics import whole_steps
from simspec.language.sources import Source
from simspec.language.strict import near
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.resolve.bodies import places_of
from simspec.resolve.shapes import orientation
from simspec.world import frames
from simspec.world.actions import KINEMATIC_MASS_RATIO, Fluid, Force, KinematicMotion, Quaternion, Vector3
from simspec.world.kinematics import layout_of, poses, rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import (
    Body,
    EngineOptions,
    Expectation,
    Frame,
    Inertial,
    PairSettings,
    Physics,
    Pose,
    RecordOptions,
    World,
)


def physics(written: SpecPhysics) -> Physics:
    """Gravity, time in steps, and the fluid: one without density and viscosity is a vacuum."""
    steps = whole_steps(written.duration, written.timestep)
    if steps is None:
        raise ValueError("a validated duration is a whole number of steps")
    around = written.fluid
    fluid = None
    if around is not None and (around.density or around.viscosity):
        fluid = Fluid(around.density, around.viscosity, around.velocity)
    return Physics(written.gravity, written.timestep, steps, fluid, written.integrator, written.damping)


def shortened(time: Physics, until: float | None) -> Physics:
    """The time of a run that ends at ``until`` (s; `trajectory.until`), where that is earlier than its own end."""
    if until is None:
        return time
    steps = whole_steps(until, time.timestep)
    if steps is None:
        raise ValueError("a validated end is a whole number of steps")
    return dataclasses.replace(time, steps=min(time.steps, steps))


def record(written: SpecRecord, time: Physics) -> RecordOptions:
    """The recorded channels, and every how many steps."""
    every = 1 if written.every is None else whole_steps(written.every, time.timestep)
    if not every:
        raise ValueError("a validated recording interval is a whole number of steps")
    return RecordOptions(every, tuple(sorted(set(written.channels))))


def unknown_shown(source: Source, bodies: Sequence[Body]) -> list[Problem]:
    """The problems of `record.show`: names of no body and no joint that has one position."""
    known = {body.name for body in bodies} | {body.joint.name for body in bodies if body.joint.kind in SCALAR_JOINTS}
    return [
        source.document.problem(
            ("record", "show", index),
            f"there is no body, hinge or slide {name!r}",
            found=name,
            hint=near(name, known),
            code="S302",
        )
        for index, name in enumerate(source.content.record.show)
        if name not in known
    ]


def too_much(source: Source, world: World) -> list[Problem]:
    """The problem of a recording that would be larger than is kept; contacts, of unknown number, are not counted."""
    where = layout_of(world)
    energy = 2 * ("energy" in world.record.channels)
    driven = sum(len(controller.joints) for controller in world.controllers)
    row = 8 * (1 + where.nq + where.nv + 13 * len(world.bodies) + energy + 2 * driven)
    rows = 1 + -(-world.physics.steps // world.record.every_steps)
    if rows * row <= RECORDED_BYTES:
        return []
    least = -(-rows * row // RECORDED_BYTES) * world.record.every_steps * world.physics.timestep
    return [
        source.document.problem(
            ("record", "every") if "record" in source.document.data else ("physics", "duration"),
            "the run would record too much",
            found=f"{rows:,} rows of {row:,} bytes, {rows * row / 2**30:,.0f} GiB",
            allowed=f"{RECORDED_BYTES / 2**30:g} GiB",
            hint=f"record: {{every: {least:g} s}}, or a shorter physics.duration",
            code="S803",
        )
    ]


def engines(written: Mapping[str, SpecOptions], timestep: float) -> tuple[EngineOptions, ...]:
    """Options by engine, sorted, with the settings that hold at a timestep (s)."""
    return tuple(
        EngineOptions(
            name,
            tuple(sorted(options.settings_at(timestep).items())),
            tuple(sorted(set(options.accept))),
            tuple(sorted(set(options.outside))),
            tuple(
                PairSettings(first, second, tuple(sorted(settings.items())))
                for (first, second), settings in sorted(options.pairs_at(timestep).items())
            ),
        )
        for name, options in sorted(written.items())
    )


def expectations(
    source: Source, bodies: Sequence[Body], whole: Physics, time: Physics, recorded: RecordOptions
) -> tuple[tuple[Expectation, ...], list[Problem]]:
    """The expectations in the order of the file, and the problems of those that no run could answer.

    ``whole`` is the time of the whole scenario, ``time`` that of the run, which `trajectory.until` may cut short: an
    expectation at a later time, or at the end of the whole, is then checked, but not required of the run.
    """
    names = {body.name for body in bodies}
    resolved, problems = [], []
    driven, pushed = bool(source.content.control), bool(source.content.forces or source.content.motion)
    for index, entry in enumerate(source.content.expect):
        kind = next(kind for kind in KINDS if getattr(entry, kind) is not None)
        written = getattr(entry, kind)
        values = {name: getattr(written, name) for name in KINDS[kind].parameters}
        values = {name: value for name, value in values.items() if value is not None}
        path = ("expect", index, kind)
        named: list[tuple[str, tuple[Key, ...], bool]]
        named = [(values[name], (*path, name), False) for name in BODIES if name in values]
        named += [(body, (*path, "targets", body), True) for body, _ in values.get("targets", ())]
        for body, place, key in named:
            if body not in names:
                message = f"there is no body {body!r}"
                hint = near(body, sorted(names))
                problems.append(source.document.problem(place, message, key=key, found=body, hint=hint, code="S302"))
        requested = time == whole or not _later(KINDS[kind], values, time)
        for name in TIMES:
            if name in values and (why := _not_recorded(values[name], time if requested else whole, recorded)):
                end = (time if requested else whole).steps * time.timestep
                late = values[name] > end
                hint = (
                    f"a longer physics.duration, or --set {'.'.join(map(str, (*path, name)))}={end:g}s"
                    if late
                    else None
                )
                found_at = f"{values[name]:g} s"
                problems.append(
                    source.document.problem(
                        (*path, name), why[0], found=found_at, allowed=why[1], hint=hint, code="S801"
                    )
                )
        for below, message, more in _never(kind, values, bodies, time, recorded, driven, pushed):
            problems.append(source.document.problem((*path, *below), f"cannot be satisfied: {message}", **more))
        if kind == "momentum_conserved" and any(time.gravity):
            shown = ", ".join(f"{value:g}" for value in time.gravity)
            message = "momentum is conserved only without gravity"
            problems.append(source.document.problem(path, message, found=f"gravity [{shown}] m/s²", code="S801"))
        if requested:
            resolved.append(Expectation(kind, tuple(sorted(values.items()))))
    return tuple(resolved), problems


def _never(
    kind: str,
    values: Mapping[str, Any],
    bodies: Sequence[Body],
    time: Physics,
    recorded: RecordOptions,
    driven: bool,
    pushed: bool,
) -> Iterator[tuple[tuple[str, ...], str, Details]]:
    """Why an expectation fails in every run (place, message, more): a run could not be measured for it."""
    if kind == "no_penetration_deeper_than" and "contacts" not in recorded.channels:
        yield (), "contacts are not recorded", {"code": "S801", "hint": "add contacts to record.channels"}
    if kind == "keeps_place" and values.get("until") is not None and values["until"] < values["after"]:
        yield (
            ("until",),
            "until is before after",
            {"code": "S801", "found": f"{values['until']:g} s < {values['after']:g} s"},
        )
    if kind == "apex_height" and values["after"] >= time.steps * time.timestep > 0.0:
        yield ("after",), "after the end of the run", {"code": "S801", "found": f"{values['after']:g} s"}
    if kind in ("follows_oracle", "momentum_conserved") and pushed:
        why = "momentum changes under them"
        if kind == "follows_oracle":
            why = "the oracle's motion has no forces on bodies, and no kinematic ones"
        yield (), f"{why}, and this scenario has `forces` or `motion`", {"code": "S801", "hint": "remove it"}
    if kind != "follows_oracle":
        return
    if driven:
        hint = "remove it; proof level L7 compares the controllers with the oracle"
        yield (
            (),
            "the oracle does not support control, and this scenario has controllers",
            {"code": "S801", "hint": hint},
        )
    if rough := [body.joint.name for body in bodies if body.joint.dry_friction]:
        shown = ", ".join(rough[:6]) + (", ..." if len(rough) > 6 else "")
        yield (
            (),
            "the oracle does not support dry friction",
            {"code": "S801", "found": shown, "hint": "leave it out, or dry_friction"},
        )
    until = values.get("until")
    last = time.steps if until is None else round(until / time.timestep)
    if last < min(recorded.every_steps, time.steps) or not time.steps:
        hint = "a longer physics.duration" if until is None else "a later until, or a shorter record.every"
        yield (), "no motion is recorded up to that time", {"code": "S801", "hint": hint}


def fixed_for_ever(source: Source, world: World) -> list[Problem]:
    """The problems of expectations that the initial state decides: of bodies that cannot move, and of places that count from
    the beginning on."""
    start = {name: np.array(pose.position) for name, pose in poses(world).items()}
    static = {name for name, group in rigid_groups(world).items() if group == "world"}
    problems = []
    for index, entry in enumerate(source.content.expect):
        kind = next(kind for kind in KINDS if getattr(entry, kind) is not None)
        expected = getattr(entry, kind)
        for place, message, found in _decided(kind, expected, start, static):
            path: tuple[Key, ...] = ("expect", index, kind, *place)
            problems.append(source.document.problem(path, f"cannot be satisfied: {message}", found=found, code="S801"))
    return problems


def _decided(
    kind: str, expected: Any, start: Mapping[str, np.ndarray], static: set[str]
) -> Iterator[tuple[tuple[str, ...], str, str]]:
    """Why the initial state alone makes an expectation fail: place, message, what is there."""
    if kind == "position" and expected.body in static:
        away = float(np.linalg.norm(start[expected.body] - np.array(expected.xyz)))
        if away > expected.tolerance:
            yield ("xyz",), f"{expected.body} cannot move", f"it is {away:.4g} m away"
    elif kind == "at_target":
        for body, target in expected.targets:
            away = float(np.linalg.norm(start[body] - np.array(target)))
            if body in static and away > expected.tolerance:
                yield ("targets", body), f"{body} cannot move", f"it is {away:.4g} m away"
    elif kind == "displacement" and expected.body in static:
        distance = expected.distance if expected.xyz is None else float(np.linalg.norm(expected.xyz))
        if distance > expected.tolerance:
            yield (), f"{expected.body} cannot move", f"a displacement of {distance:.4g} m"
    elif kind == "apex_height" and expected.body in static:
        if abs(start[expected.body][2] - expected.height) > expected.tolerance:
            yield ("height",), f"{expected.body} cannot move", f"it is at {start[expected.body][2]:.4g} m"
    elif kind == "angular_speed" and expected.body in static:
        if expected.speed > expected.tolerance:
            yield ("speed",), f"{expected.body} cannot move", f"{expected.speed:.4g} rad/s"
    elif kind == "stays_within":
        # round-off of resolving: a body may begin on the boundary
        out = float(
            np.maximum(
                np.array(expected.lower) - start[expected.body], start[expected.body] - np.array(expected.upper)
            ).max()
        )
        if out > ROUND_OFF:
            yield (), f"{expected.body} starts outside", f"by {out:.4g} m"
    elif kind == "bodies_apart":
        distance = float(np.linalg.norm(start[expected.first] - start[expected.second]))
        if distance < expected.at_least - ROUND_OFF:
            yield ("at_least",), "the two start closer than that", f"{distance:.4g} m"


ROUND_OFF = 1e-9
"""m: places that are equal but for the arithmetic of poses."""


def _later(kind: ExpectationKind, values: Mapping[str, Any], time: Physics) -> bool:
    """Whether an expectation looks at what comes after the run's last step, of a scenario that goes on."""
    if kind.of_end and kind.of_end not in values:
        return True
    return any(round(values[name] / time.timestep) > time.steps for name in TIMES if name in values)


def _not_recorded(at: float, time: Physics, recorded: RecordOptions) -> tuple[str, str] | None:
    """Why nothing is recorded at a time, and what would do; every ``every_steps`` steps are, and the last step."""
    end = time.steps * time.timestep
    step = at / time.timestep
    nearest = round(step)
    if nearest > time.steps:
        return "this time is after the end of the run", f"0 to {end:g} s"
    # half a step: the requested record is the one nearest to the time
    every = recorded.every_steps
    if nearest == time.steps or (abs(step - nearest) < 0.5 and nearest % every == 0):
        return None
    lower = (nearest // every) * every * time.timestep
    upper = min((nearest // every + 1) * every, time.steps) * time.timestep
    return "nothing is recorded at this time", f"the nearest: {lower:.12g} s or {upper:.12g} s"


# Forces of the world: bodies that are there and can move, and times within the run.

NOWHERE = (0.0, 0.0, 0.0)


def forces(
    source: Source,
    bodies: Sequence[Body],
    whole: Physics,
    kinematic: Container[str] = (),
    named: Sequence[Frame] = (),
) -> tuple[tuple[Force, ...], list[Problem]]:
    """The forces in the order of the file, and what is wrong with them. ``whole``: the time of the whole scenario;
    ``named``: the frames that may be named in place of a body."""
    places = places_of(bodies, named)
    groups = rigid_groups(World("", tuple(bodies)))
    end = whole.steps * whole.timestep
    resolved, problems = [], []
    for index, written in enumerate(source.content.forces):
        path: tuple[Key, ...] = ("forces", index)
        start = getattr(written, "from")
        body, place = places.get(written.body, ("", Pose()))
        if not body:
            message, hint = f"there is no body {written.body!r}", near(written.body, sorted(places))
            problems.append(
                source.document.problem((*path, "body"), message, found=written.body, hint=hint, code="S302")
            )
        elif groups[body] == "world":
            message = f"{body} is fixed to the world: no force moves it"
            problems.append(source.document.problem((*path, "body"), message, found=written.body, code="S802"))
        elif groups[body] in kinematic:
            message = f"{body} is kinematic: no force moves it"
            problems.append(source.document.problem((*path, "body"), message, found=written.body, code="S802"))
        if whole.steps and start >= end:
            late, found = "it begins after the end of the run", f"{start:g} s"
            hint = "a longer physics.duration"
            problems.append(
                source.document.problem(
                    (*path, "from"), late, found=found, allowed=f"below {end:g} s", hint=hint, code="S802"
                )
            )
        resolved.append(
            Force(
                body,
                written.force or NOWHERE,
                written.torque or NOWHERE,
                frames.compose(place, Pose(written.at or NOWHERE)).position,
                start,
                written.until,
            )
        )
    return tuple(resolved), problems


# Kinematic bodies of the world: their masses compared to all that moves, bodies that do not touch them, and how they move.

LEAST = 1.0
"""kg of all that moves that a kinematic body is heavier than at least, where nothing or a feather moves."""


class Kinematic(NamedTuple):
    """The result of `kinematic` and `motion`.

    motions   one for each kinematic body, in the order of the world's bodies
    bodies    the world's bodies, kinematic ones with their mass, and where they begin
    separated pairs of bodies that nothing separates: both are where `motion` says
    problems  what is wrong
    """

    motions: tuple[KinematicMotion, ...]
    bodies: tuple[Body, ...]
    separated: list[tuple[str, str]]
    problems: list[Problem]


def motions(source: Source, bodies: tuple[Body, ...], kinematic: Sequence[str]) -> Kinematic:
    """The motions of a spec; ``kinematic``: the full names of the bodies that are."""
    written, problems = source.content.motion, []
    names = {body.name for body in bodies}
    for name in written:
        if name in kinematic:
            continue
        path: tuple[Key, ...] = ("motion", name)
        if name not in names:
            message, hint = f"there is no body {name!r}", near(name, sorted(kinematic or names))
            problems.append(source.document.problem(path, message, key=True, found=name, hint=hint, code="S302"))
        else:
            hint = "kinematic: true, of a root without joint"
            problems.append(source.document.problem(path, f"{name} is not kinematic", key=True, hint=hint, code="S802"))
    if not kinematic or problems:
        return Kinematic((), bodies, [], problems)
    moved = tuple(_motion(body, written.get(body.name)) for body in bodies if body.name in kinematic)
    groups = rigid_groups(World("", bodies))
    solid = [body.name for body in bodies if any(shape.collision for shape in body.shapes)]
    moving = [name for name in solid if groups[name] in kinematic]
    static = [name for name in solid if groups[name] == "world"]
    separate = [(first, second) for first in moving for second in static]
    separate += [
        (first, second) for first in moving for second in moving if first < second and groups[first] != groups[second]
    ]
    carried = sum(body.inertial.mass for body in bodies if groups[body.name] not in ("world", *kinematic))
    placed = {motion.body: _placed(motion, KINEMATIC_MASS_RATIO * max(carried, LEAST)) for motion in moved}
    return Kinematic(
        moved, tuple(placed[body.name](body) if body.name in placed else body for body in bodies), separate, []
    )


def _motion(body: Body, written: SpecMotion | None) -> KinematicMotion:
    """The motion of a body; where nothing is written it stands where its pose says."""
    x, y, z, qw, qx, qy, qz = body.joint.position
    place, turn = (x, y, z), (qw, qx, qy, qz)
    if written is None:
        return KinematicMotion(body.name, (0.0,), (place,), (turn,))
    places: list[Vector3] = []
    turns: list[Quaternion] = []
    for point in written.points:
        place = point.xyz or place
        turn = orientation(point) if point.rpy is not None or point.quat is not None else turn
        places.append(place)
        turns.append(turn)
    times = tuple(point.at for point in written.points)
    return KinematicMotion(body.name, times, tuple(places), tuple(turns), written.interpolation)


def _placed(motion: KinematicMotion, mass: float) -> Callable[[Body], Body]:
    """The changes that give a body this mass, at rest where its motion begins: round, about its frame's origin, as far out as
    its shapes."""

    def placed(body: Body) -> Body:
        reach = max(
            [
                1.0,
                *(
                    (math.hypot(*shape.pose.position) + SHAPES[shape.kind].outer_radius(shape.size))
                    for shape in body.shapes
                ),
            ]
        )
        inertia = mass * reach**2
        joint = replace(
            body.joint,
            position=(*motion.positions[0], *motion.quaternions[0]),
            velocity=(0.0,) * len(body.joint.velocity),
        )
        return replace(body, inertial=Inertial(mass, inertia=(inertia, inertia, inertia, 0.0, 0.0, 0.0)), joint=joint)

    return placed
