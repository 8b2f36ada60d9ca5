"""Worlds of contact probes: a floor of a pair's first material and free bodies of its second, how they are driven, and trials
in several worlds for engines whose time grows faster than the number of bodies in one.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from simspec.contact import ContactPlan, contact_plan
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation
from simspec.engines.kit.settings import idle_settings
from simspec.errors import Problem, UnsupportedError
from simspec.language.vocabulary import COMBINED_QUANTITIES, FRICTION_CONES
from simspec.proof.building import AT_REST, fixed, free
from simspec.proof.contact.probe import FLOOR, GRAVITY, Phase, ProbeLaw, ProbeTrial, TrialMotion
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.contact_pairs import meeting_laws, shape_pairs, solid_shapes
from simspec.world.frames import sorted_pair, vector3, vector6
from simspec.world.kinematics import joined as joined_bodies
from simspec.world.kinematics import layout_of
from simspec.world.shapes import SHAPES
from simspec.world.types import (
    Body,
    Contact,
    EngineOptions,
    Hardness,
    Inertial,
    Pair,
    PairContact,
    PairSettings,
    Physics,
    Pose,
    Quaternion,
    ReadBack,
    Shape,
    Surface,
    Vector3,
    World,
)

FLOOR_SIZE = (400.0, 400.0, 2.0)
"""m. A box, not a plane: on one engine's planes boxes tumble, and another's gives one contact for a face."""
MOVING = "probe"
"""Collision group of bodies that meet the floor alone."""
STEPS_BEFORE = 2
"""Whole steps of flight before the one in which a body arrives."""


def floor(law: ProbeLaw, size: Vector3 = FLOOR_SIZE) -> Body:
    """A fixed box whose upper face is at z = 0."""
    return fixed_box(FLOOR, size, (0.0, 0.0, -size[2] / 2), law.pair.first)


def plane(law: ProbeLaw) -> Body:
    """A fixed plane at z = 0."""
    return fixed(FLOOR, Shape(f"{FLOOR}_0", "plane", (), Pose(), law.pair.first))


def fixed_box(name: str, size: Vector3, at: Vector3, material: str, turn: Quaternion = frames.IDENTITY) -> Body:
    """A fixed box with its centre at ``at``."""
    return fixed(name, Shape(f"{name}_0", "box", size, Pose(at, turn), material))


def cluster(
    law: ProbeLaw,
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
    law: ProbeLaw,
    name: str,
    radius: float,
    mass: float,
    at: Vector3,
    velocity: tuple[float, ...] = AT_REST,
    material: str | None = None,
    group: str = "default",
) -> Body:
    """A free solid ball with its centre at ``at``; ``material`` by default the pair's second; ``group``: see
    :class:`ProbeTrial`."""
    moment = 0.4 * mass * radius * radius
    shape = Shape(f"{name}_0", "sphere", (radius,), Pose(), material or law.pair.second)
    return free(name, at, _uniform(mass, (moment, moment, moment)), shape, velocity=velocity, group=group)


def box(
    law: ProbeLaw,
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
    law: ProbeLaw,
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


def flight(law: ProbeLaw, speed: float, phase: float) -> tuple[float, float]:
    """The speed (m/s) downwards at the start, and the way (m), of a body that falls and arrives at ``speed`` after this share
    of the step that follows ``STEPS_BEFORE``."""
    dt = law.timestep
    start = speed - (STEPS_BEFORE + 1) * GRAVITY * dt
    return start, (sum(start + GRAVITY * dt * step for step in range(1, STEPS_BEFORE + 1)) + phase * speed) * dt


def world_of_trial(trial: ProbeTrial, contact: Contact, physics: Physics, options: EngineOptions) -> World:
    """The world of a trial under a contact law: moving bodies meet fixed ones alone, except those that the trial lets meet."""
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


def drive_of(world: World, trial: ProbeTrial) -> Operation:
    """The operation that drives the world of a trial."""
    places = layout_of(world)
    index = {body.name: number for number, body in enumerate(world.bodies)}
    effort = np.zeros((len(trial.phases), places.nv))
    for row, phase in zip(effort, trial.phases, strict=True):
        for name, values in phase.effort.items():
            row[places.velocity[index[name]]] = values
    phases = [[phase.steps, phase.every] for phase in trial.phases]
    return Operation("drive", {"timestep": world.physics.timestep, "phases": phases}, {"effort": effort}, world)


def motion_of(world: World, answer: Answer) -> TrialMotion:
    """The motion of a driven world, by body."""
    time, pose, velocity = (answer.arrays[name] for name in ("time", "pose", "velocity"))
    places = {body.name: number for number, body in enumerate(world.bodies)}
    return TrialMotion(time, *({name: rows[:, at] for name, at in places.items()} for rows in (pose, velocity)))


# --- trials in several worlds ------------------------------------------------------------------------------------


def split(trial: ProbeTrial, most: int | None) -> list[ProbeTrial]:
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


def _together(trial: ProbeTrial) -> Iterable[set[str]]:
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


def _part(trial: ProbeTrial, names: set[str]) -> ProbeTrial:
    bodies = tuple(body for body in trial.bodies if body.name in names or _stands(body))
    phases = tuple(
        Phase(phase.steps, phase.every, {name: effort for name, effort in phase.effort.items() if name in names})
        for phase in trial.phases
    )
    groups = {body.collision_group for body in bodies}
    return ProbeTrial(bodies, phases, tuple(pair for pair in trial.meets if set(pair) <= groups))


def joined(motions: Sequence[TrialMotion]) -> TrialMotion:
    """The motion of a whole trial from those of its parts. Raises ValueError where their times differ."""
    time = motions[0].time
    if any(not np.array_equal(time, motion.time) for motion in motions[1:]):
        raise ValueError("parts of a trial were seen at different times")
    pose = {name: rows for motion in motions for name, rows in motion.pose.items()}
    return TrialMotion(time, pose, {name: rows for motion in motions for name, rows in motion.velocity.items()})


# The contact law as a scenario's *files* hold it, so that probes measure what was written, not what was meant.
#
# Read with the independent reader of proof level L0. Where shapes of one material disagree, the one furthest from the plan
# counts: a slip in one shape must not hide behind the others.

EVERYTHING = tuple(sorted(feature.value for feature in Feature))
"""Features that probe worlds accept: the scenario was compiled, and a probe only measures."""
HARDNESS_NUMBERS = ("time_constant", "damping_ratio", "stiffness", "damping")


@dataclass(frozen=True)
class FileLaw:
    """The contents of the files of one engine: contact laws, the numbers of materials, solver settings, the timestep (s)."""

    contact: Contact
    plan: ContactPlan
    options: EngineOptions
    timestep: float
    belts: Mapping[Pair, Vector3] = field(default_factory=dict)
    """Velocities (m/s) of surfaces that move, by the pairs of materials that they are measured with."""


def belts(world: World) -> dict[Pair, tuple[str, int, Vector3]]:
    """For each two materials that meet, the first solid shape of one of them whose surface moves along: its body, its number
    among the body's solid shapes, and the velocity (m/s) in its own axes."""
    moving = [
        (shape.material, (body.name, number, vector3(shape.surface_velocity[:3])))
        for body in world.bodies
        for number, shape in enumerate(solid_shapes(body))
        if any(shape.surface_velocity[:3])
    ]
    chosen: dict[Pair, tuple[str, int, Vector3]] = {}
    for material, belt in moving:
        for pair in meeting_laws(world):
            if material in pair:
                chosen.setdefault(pair, belt)
    return chosen


def _written_belts(world: World, read: ReadBack) -> dict[Pair, Vector3]:
    """The velocities in the files; none of a missing shape, which other checks find."""
    shapes = {body.name: solid_shapes(body) for body in read.bodies}
    return {
        pair: vector3(shapes[name][number].surface_velocity[:3])
        for pair, (name, number, _) in belts(world).items()
        if number < len(shapes.get(name, ()))
    }


def law_of_files(world: World, engine: type[Engine], folder: Path, read: ReadBack | None = None) -> FileLaw:
    """Read the contact law from the artifacts in ``folder``; ``read`` is what the independent reader made of them (default:
    read here).

    Raises what readers raise at damaged files, and UnsupportedError for numbers that no file could be written with.
    """
    read = dialects()[engine.DIALECT].read(folder) if read is None else read
    # the engine's own file counts, not the sidecar
    sidecar = read_sidecar(folder)
    settings = sidecar["settings"] | {
        name.removeprefix("settings."): value for name, value in read.inventory.items() if name.startswith("settings.")
    }
    plan = contact_plan(world, engine.RULES, engine.LAYERS)
    cone = world.contact.friction_cone if "friction_cone" in read.unreadable else read.friction_cone
    timestep = world.physics.timestep if "timestep" in read.unreadable else read.timestep
    contact = dataclasses.replace(world.contact, friction_cone=cone, pairs=_pairs(world, read))
    numbers = _numbers(world, read, plan)
    problems = list(_impossible(contact, numbers, timestep))
    if problems:
        raise UnsupportedError(problems)
    # files contain all settings; those without effect may not be given
    idle = idle_settings(engine, {name: setting.default for name, setting in engine.SETTINGS.items()} | settings)
    written = tuple((name, value) for name, value in sorted(settings.items()) if name not in idle)
    pairs = tuple(
        PairSettings(entry["between"][0], entry["between"][1], tuple(sorted(entry["settings"].items())))
        for entry in sidecar.get("pair_settings", ())
    )
    options = EngineOptions(engine.NAME, written, EVERYTHING, pairs=pairs)
    plan = dataclasses.replace(plan, numbers=numbers, explicit=_explicit(world, read))
    return FileLaw(contact, plan, options, timestep, _written_belts(world, read))


def _impossible(contact: Contact, numbers: Mapping[tuple[str, int], Surface], timestep: float) -> Iterator[Problem]:
    """Values in the files with which no probe world can be written."""
    if contact.friction_cone not in FRICTION_CONES:
        yield Problem("the files hold an unknown friction cone", found=contact.friction_cone, code="P102")
    if not 0.0 < timestep < math.inf:
        yield Problem("the files hold an impossible timestep", found=f"{timestep}", code="P102")
    surfaces: list[tuple[str, Surface | PairContact]] = [
        *((f"{name} in layer {layer}", surface) for (name, layer), surface in numbers.items()),
        *((f"{pair.first} with {pair.second}", pair) for pair in contact.pairs),
    ]
    for where, numbers_actual in surfaces:
        hardness = numbers_actual.hardness or Hardness()
        values = {name: getattr(numbers_actual, name) for name in COMBINED_QUANTITIES}
        values |= {name: getattr(hardness, name) for name in HARDNESS_NUMBERS}
        for name, value in values.items():
            if value is not None and not math.isfinite(value):
                yield Problem(
                    f"the files hold an impossible {name.replace('_', ' ')} of {where}", found=f"{value}", code="P102"
                )


def of_pair(whole: FileLaw, first: str, second: str) -> FileLaw:
    """The part of a law that concerns two materials: the rest of a scenario cannot matter to probes of these."""
    names = {first, second}
    contact = Contact(
        whole.contact.friction_cone,
        tuple(material for material in whole.contact.materials if material.name in names),
        # without a margin: probed bodies begin in touch
        tuple(
            dataclasses.replace(pair, margin=None) for pair in whole.contact.pairs if {pair.first, pair.second} <= names
        ),
    )
    plan = ContactPlan(
        {key: surface for key, surface in whole.plan.numbers.items() if key[0] in names},
        {pair: layer for pair, layer in whole.plan.layer_of.items() if set(pair) <= names},
        tuple(pair for pair in whole.plan.missed if set(pair) <= names),
        tuple(pair for pair in whole.plan.explicit or () if set(pair) <= names),
    )
    pairs = tuple(pair for pair in whole.options.pairs if {pair.first, pair.second} <= names)
    return FileLaw(contact, plan, dataclasses.replace(whole.options, pairs=pairs), whole.timestep, whole.belts)


def _numbers(world: World, read: ReadBack, plan: ContactPlan) -> dict[tuple[str, int], Surface]:
    numbers = dict(plan.numbers)
    bodies = {body.name: body for body in read.bodies}
    for body in world.bodies:
        if body.name not in bodies:
            continue  # a missing body is L0's and L1's to find
        for shape, other in zip(solid_shapes(body), solid_shapes(bodies[body.name]), strict=False):
            for layer, surface in zip(plan.layers(shape.material), other.surfaces, strict=False):
                key = (shape.material, layer)
                whole = _filled(surface, plan.numbers[key])
                if _distance(whole, plan.numbers[key]) > _distance(numbers[key], plan.numbers[key]):
                    numbers[key] = whole
    return numbers


def _filled(surface: Surface, wanted: Surface) -> Surface:
    """The surface, with values that are not readable taken from the plan."""
    names = (*COMBINED_QUANTITIES, "hardness")
    given = {name: value for name in names if (value := getattr(surface, name)) is not None}
    return dataclasses.replace(wanted, **given)


def _distance(surface: Surface, other: Surface) -> float:
    return _far(
        surface.hardness == other.hardness,
        ((getattr(surface, name), getattr(other, name)) for name in COMBINED_QUANTITIES),
    )


def _known(number: float | None, law: float) -> float:
    """The engine's number, or the law's where it has none."""
    return law if number is None else number


def _pairs(world: World, read: ReadBack) -> tuple[PairContact, ...]:
    """The world's laws, with those of explicit pairs and of a table as they are held."""
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    laws = {(pair.first, pair.second): pair for pair in world.contact.pairs}
    worst = dict(laws)
    worst.update({names: law for law in read.laws if (names := (law.first, law.second)) in laws})
    for pair in read.pairs:
        names = sorted_pair(material.get(pair.first, ""), material.get(pair.second, ""))
        if names not in laws:
            continue  # a stray pair is the comparator's to find
        law, surface = laws[names], pair.surface
        contact = dataclasses.replace(
            law,
            friction=_known(surface.friction, law.friction),
            torsional_friction=_known(surface.torsional_friction, law.torsional_friction),
            rolling_friction=_known(surface.rolling_friction, law.rolling_friction),
            restitution=_known(surface.restitution, law.restitution),
            hardness=law.hardness if surface.hardness is None else surface.hardness,
            margin=None if law.margin is None else pair.margin,
        )
        if _law_distance(contact, law) > _law_distance(worst[names], law):
            worst[names] = contact
    return tuple(worst.values())


def _explicit(world: World, read: ReadBack) -> tuple[Pair, ...]:
    """The pairs of materials of which every two shapes that may touch are held as an explicit pair.

    Where one is missing, it is the shapes' numbers that count there, and they are measured.
    """
    there = {(pair.first, pair.second) for pair in read.pairs}
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    named = {tuple(sorted(material.get(name, "") for name in pair)) for pair in there}
    return tuple(
        pair
        for pair in meeting_laws(world)
        if pair in named and all(two in there for two in shape_pairs(world, [pair]))
    )


def _law_distance(law: PairContact, other: PairContact) -> float:
    return _far(
        law.hardness == other.hardness,
        ((getattr(law, name), getattr(other, name)) for name in (*COMBINED_QUANTITIES, "margin")),
    )


def _far(as_hard: bool, values: Iterable[tuple[float | None, float | None]]) -> float:
    """The distance of two laws, to find the worst one; NaN is beyond any number."""
    numbers = sum(abs((number or 0.0) - (other or 0.0)) for number, other in values)
    return math.inf if math.isnan(numbers) else numbers + (0.0 if as_hard else 1.0)
