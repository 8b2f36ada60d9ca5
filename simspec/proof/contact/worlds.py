"""Worlds of contact probes: a floor of a pair's first material and free bodies of its second, how they are driven, and trials
in several worlds for engines whose time grows faster than the number of bodies in one."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from simspec.engines.kit.process import Answer, Operation
from simspec.proof.building import AT_REST, fixed, free
from simspec.proof.contact.probe import FLOOR, GRAVITY, Law, Motion, Phase, Trial
from simspec.world import frames
from simspec.world.frames import vector6
from simspec.world.kinematics import joined as joined_bodies
from simspec.world.kinematics import layout_of
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Contact, EngineOptions, Inertial, Physics, Pose, Quaternion, Shape, Vector3, World

FLOOR_SIZE = (400.0, 400.0, 2.0)
"""m. A box, not a plane: on one engine's planes boxes tumble, and another's gives one contact for a face."""
MOVING = "probe"
"""Collision group of bodies that meet the floor alone."""
STEPS_BEFORE = 2
"""Whole steps of flight before the one in which a body arrives."""


def floor(law: Law, size: Vector3 = FLOOR_SIZE) -> Body:
    """A fixed box whose upper face is at z = 0."""
    return fixed_box(FLOOR, size, (0.0, 0.0, -size[2] / 2), law.pair.first)


def plane(law: Law) -> Body:
    """A fixed plane at z = 0."""
    return fixed(FLOOR, Shape(f"{FLOOR}_0", "plane", (), Pose(), law.pair.first))


def fixed_box(name: str, size: Vector3, at: Vector3, material: str, turn: Quaternion = frames.IDENTITY) -> Body:
    """A fixed box with its centre at ``at``."""
    return fixed(name, Shape(f"{name}_0", "box", size, Pose(at, turn), material))


def cluster(
    law: Law,
    name: str,
    balls: Mapping[str, Vector3],
    radius: float,
    mass: float,
    inertia: float,
    at: Vector3,
    turn: Quaternion = frames.IDENTITY,
    velocity: tuple[float, ...] = AT_REST,
) -> Body:
    """A free body of several balls of one radius (m), by name the places of their centres in its frame; its centre of mass at
    ``at``, and one moment of inertia (kg m²) about every axis."""
    shapes = (
        Shape(f"{name}_{part}", "sphere", (radius,), Pose(place), law.pair.second) for part, place in balls.items()
    )
    return free(name, (*at, *turn), Inertial(mass, inertia=(inertia,) * 3 + (0.0,) * 3), *shapes, velocity=velocity)


def ball(
    law: Law,
    name: str,
    radius: float,
    mass: float,
    at: Vector3,
    velocity: tuple[float, ...] = AT_REST,
    material: str | None = None,
    group: str = "default",
) -> Body:
    """A free solid ball with its centre at ``at``; ``material`` by default the pair's second; ``group``: see :class:`Trial`."""
    moment = 0.4 * mass * radius * radius
    shape = Shape(f"{name}_0", "sphere", (radius,), Pose(), material or law.pair.second)
    return free(name, at, _uniform(mass, (moment, moment, moment)), shape, velocity=velocity, group=group)


def box(
    law: Law,
    name: str,
    size: Vector3,
    mass: float,
    at: Vector3,
    velocity: tuple[float, ...] = AT_REST,
    turn: Quaternion = frames.IDENTITY,
    material: str | None = None,
    group: str = "default",
) -> Body:
    """A free box of uniform density with its centre at ``at``; ``material`` and ``group`` as of :func:`ball`."""
    x, y, z = (edge * edge for edge in size)
    moments = (mass / 12.0 * (y + z), mass / 12.0 * (x + z), mass / 12.0 * (x + y))
    shape = Shape(f"{name}_0", "box", size, Pose(), material or law.pair.second)
    return free(name, (*at, *turn), _uniform(mass, moments), shape, velocity=velocity, group=group)


def solid(
    law: Law,
    name: str,
    kind: str,
    size: tuple[float, ...],
    mass: float,
    at: Vector3,
    turn: Quaternion = frames.IDENTITY,
) -> Body:
    """A free body of uniform density of a kind of shape, with its centre at ``at``."""
    shape = Shape(f"{name}_0", kind, size, Pose(), law.pair.second)
    return free(name, (*at, *turn), _uniform(mass, SHAPES[kind].moments(size, mass)), shape)


def _uniform(mass: float, moments: Vector3) -> Inertial:
    return Inertial(mass, inertia=vector6((*moments, 0.0, 0.0, 0.0)))


def flight(law: Law, speed: float, phase: float) -> tuple[float, float]:
    """The speed (m/s) downwards at the start, and the way (m), of a body that falls and arrives at ``speed`` after this share
    of the step that follows ``STEPS_BEFORE``."""
    dt = law.timestep
    start = speed - (STEPS_BEFORE + 1) * GRAVITY * dt
    return start, (sum(start + GRAVITY * dt * step for step in range(1, STEPS_BEFORE + 1)) + phase * speed) * dt


def world_of_trial(trial: Trial, contact: Contact, physics: Physics, options: EngineOptions) -> World:
    """The world of a trial under a contact law: what moves meets fixed bodies alone, but for what the trial lets meet."""
    meeting = {group for pair in trial.meets for group in pair}
    bodies = tuple(
        body
        if body.joint.kind == "fixed" or body.collision_group in meeting
        else dataclasses.replace(body, collision_group=MOVING)
        for body in trial.bodies
    )
    groups = sorted({MOVING, *meeting})
    ignored = tuple(pair for pair in itertools.combinations_with_replacement(groups, 2) if pair not in set(trial.meets))
    contact = dataclasses.replace(contact, ignored_groups=ignored, excluded_bodies=tuple(sorted(joined_bodies(bodies))))
    physics = dataclasses.replace(physics, steps=sum(phase.steps for phase in trial.phases))
    return World("contact-probe", bodies, contact, physics, engines=(options,))


def drive_of(world: World, trial: Trial) -> Operation:
    """The operation that drives the world of a trial."""
    places = layout_of(world)
    index = {body.name: number for number, body in enumerate(world.bodies)}
    effort = np.zeros((len(trial.phases), places.nv))
    for row, phase in zip(effort, trial.phases, strict=True):
        for name, values in phase.effort.items():
            row[places.velocity[index[name]]] = values
    phases = [[phase.steps, phase.every] for phase in trial.phases]
    return Operation("drive", {"timestep": world.physics.timestep, "phases": phases}, {"effort": effort}, world)


def motion_of(world: World, answer: Answer) -> Motion:
    """The motion of a driven world, by body."""
    time, pose, velocity = (answer.arrays[name] for name in ("time", "pose", "velocity"))
    places = {body.name: number for number, body in enumerate(world.bodies)}
    return Motion(time, *({name: rows[:, at] for name, at in places.items()} for rows in (pose, velocity)))


# --- trials in several worlds ------------------------------------------------------------------------------------


def split(trial: Trial, most: int | None) -> list[Trial]:
    """``trial`` in parts of at most ``most`` moving bodies each, in their order; None: whole. Fixed roots are in every part;
    bodies that are joined, or that may meet, stay together even where they are more."""
    chunks: list[set[str]] = []
    for unit in () if most is None else _together(trial):
        if not chunks or len(chunks[-1]) + len(unit) > (most or 0):
            chunks.append(set())
        chunks[-1] |= unit
    return [trial] if len(chunks) < 2 else [_part(trial, chunk) for chunk in chunks]


def _stands(body: Body) -> bool:
    return body.joint.kind == "fixed" and body.joint.parent is None


def _together(trial: Trial) -> Iterable[set[str]]:
    """The names of bodies that have to be in one world, in the order of the first of each."""
    units = {body.name: {body.name} for body in trial.bodies if not _stands(body)}
    order = {name: number for number, name in enumerate(units)}
    of_group: dict[str, list[str]] = {}
    for body in trial.bodies:
        of_group.setdefault(body.collision_group, []).append(body.name)
    ties = [(body.name, body.joint.parent) for body in trial.bodies]
    ties += [
        (name, other)
        for pair in trial.meets
        for name, other in itertools.pairwise(
            name for group in pair for name in of_group.get(group, ()) if name in units
        )
    ]
    for name, other in ties:
        if name in units and other in units and units[name] is not units[other]:
            units[name] |= units[other]
            units |= dict.fromkeys(units[other], units[name])
    return sorted(
        {id(unit): unit for unit in units.values()}.values(), key=lambda unit: min(order[name] for name in unit)
    )


def _part(trial: Trial, names: set[str]) -> Trial:
    bodies = tuple(body for body in trial.bodies if body.name in names or _stands(body))
    phases = tuple(
        Phase(phase.steps, phase.every, {name: effort for name, effort in phase.effort.items() if name in names})
        for phase in trial.phases
    )
    groups = {body.collision_group for body in bodies}
    return Trial(bodies, phases, tuple(pair for pair in trial.meets if set(pair) <= groups))


def joined(motions: Sequence[Motion]) -> Motion:
    """The motion of a whole trial from those of its parts. Raises ValueError where their times differ."""
    time = motions[0].time
    if any(not np.array_equal(time, motion.time) for motion in motions[1:]):
        raise ValueError("parts of a trial were seen at different times")
    pose = {name: rows for motion in motions for name, rows in motion.pose.items()}
    return Motion(time, pose, {name: rows for motion in motions for name, rows in motion.velocity.items()})
