"""Candidate causes of a difference: changes of the two sides, each of which removes one possible difference."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from simspec.attribution.configuration import Configuration
from simspec.attribution.differences import INITIAL_STATE, Difference, differences, taking
from simspec.attribution.windows import map_states
from simspec.engines.kit.settings import SettingGroup, Value, finer_settings, pair_settings, resolve_settings
from simspec.language.vocabulary import COMBINED_QUANTITIES, FRICTION_CONES
from simspec.world.damping import retimed
from simspec.world.types import Body, PairContact, World

Pair = tuple[Configuration, Configuration]


class CandidateKind(StrEnum):
    """Kinds of candidates."""

    DIFFERENCE = "difference"
    """The second side takes the first side's value of what differs between them."""
    DEFAULT = "default"
    """A side takes its engine's declared default of a setting that is away from it."""
    ALTERNATIVE = "alternative"
    """A side takes another choice, or the finer value, of a setting of its engine."""
    REFINEMENT = "refinement"
    """Both sides take something finer, or another form of the same thing."""
    REMOVAL = "removal"
    """Something is taken away from both sides: it says where the difference is, not why."""


CAUSES = (CandidateKind.DIFFERENCE, CandidateKind.DEFAULT)
"""Kinds of differences that a user set; the other kinds are properties of the engines."""
SILENT = (SettingGroup.SLEEPING, SettingGroup.ORDER, SettingGroup.BOUNDS)
"""Groups whose settings are no alternatives: they do not say how a step is computed."""
WHOLE_RUN = (SettingGroup.SLEEPING.value, INITIAL_STATE)
"""Groups that windows do not show: they act over longer times, or before the first window."""


@dataclass(frozen=True)
class Candidate:
    """One change of the two sides. ``values``: before and after it, or in the first and in the second side; ``about``: the
    changed quantities, each once in a combination."""

    name: str
    kind: CandidateKind
    group: str
    values: tuple[str, str]
    about: tuple[str, ...]
    apply: Callable[[Pair], Pair]

    @property
    def whole_run(self) -> bool:
        """Whether only the whole run can show it."""
        return self.group in WHOLE_RUN


def causes(first: Configuration, second: Configuration) -> list[Candidate]:
    """Differences in the two sides' worlds, settings and versions. Raises SpecError where the worlds are of different
    scenes."""
    found = [_of_world(first, difference) for difference in differences(first.world, second.world)]
    if not any(candidate.group == INITIAL_STATE for candidate in found) and _starts_differ(first, second):
        found.append(_of_world(first, Difference(INITIAL_STATE, "", (), ())))
    if first.kind is second.kind:
        return [*found, *_same_engine(first, second)]
    stated = [*_stated_otherwise(first, second, 0), *_stated_otherwise(second, first, 1)]
    given = {about for candidate in stated for about in candidate.about}
    away = [*_away_from_default(first, 0), *_away_from_default(second, 1)]
    return [*found, *stated, *(candidate for candidate in away if not given & set(candidate.about))]


def _starts_differ(first: Configuration, second: Configuration) -> bool:
    q, v = map_states(first.world, second.world, *first.initial)
    return not (np.array_equal(q, second.initial[0]) and np.array_equal(v, second.initial[1]))


def _of_world(first: Configuration, difference: Difference) -> Candidate:
    def apply(pair: Pair) -> Pair:
        configuration, other = pair
        changed = other.in_world(taking(other.world, first.world, [difference]))
        if difference.group == INITIAL_STATE:
            start = map_states(first.world, other.world, *first.initial)
            changed = dataclasses.replace(changed, start=start)
        return configuration, changed

    values = difference.values if difference.changes else ("", "moved")
    return Candidate(difference.name, CandidateKind.DIFFERENCE, difference.group, values, (difference.name,), apply)


def _same_engine(first: Configuration, second: Configuration) -> Iterator[Candidate]:
    name, title = first.kind.NAME, first.kind.TITLE
    ours, theirs = (resolve_settings(side.kind, side.world) for side in (first, second))
    at_work = first.settings, second.settings
    for setting, declared in first.kind.SETTINGS.items():
        # a value that one engine chooses by default may be set explicitly on the other side
        if ours[setting] == theirs[setting] or at_work[0][setting] == at_work[1][setting]:
            continue
        value = ours[setting]
        yield Candidate(
            f"{title}'s {setting}",
            CandidateKind.DIFFERENCE,
            declared.group.value,
            (written(ours[setting]), written(theirs[setting])),
            (f"{name}.{setting}",),
            _setting(1, {setting: value}),
        )
    yield from _same_pairs(first, second)
    options = [side.world.options(name) for side in (first, second)]
    for word in ("accept", "outside"):
        here, there = (", ".join(getattr(option, word)) or "nothing" for option in options)
        if word == "outside" and here != there:
            yield Candidate(
                f"features computed outside {title}",
                CandidateKind.DIFFERENCE,
                "computed outside the engine",
                (here, there),
                (f"{name}.outside",),
                lambda pair: (pair[0], pair[1].with_options_of(first)),
            )
    if (first.engine, first.python) != (second.engine, second.python):
        yield Candidate(
            f"{title}'s version",
            CandidateKind.DIFFERENCE,
            "version",
            (first.engine, second.engine),
            (f"{name}.version",),
            lambda pair: (pair[0], dataclasses.replace(pair[1], engine=first.engine, python=first.python)),
        )


def _stated_otherwise(configuration: Configuration, other: Configuration, side: int) -> Iterator[Candidate]:
    """Settings, also of pairs of materials, that a side's world states of its engine, and that the other side's world, of
    another engine, has otherwise: both are of one scene, in which a user changed them. A world without options of the engine
    adds nothing."""
    name, at_work = configuration.kind.NAME, configuration.settings
    if not any(options.engine == name for options in other.world.engines):
        return
    given = resolve_settings(configuration.kind, configuration.world)
    theirs = resolve_settings(configuration.kind, other.world)
    for setting, _ in configuration.world.options(name).settings:
        declared = configuration.kind.SETTINGS[setting]
        changed = configuration.with_settings({setting: theirs[setting]})
        if given[setting] == theirs[setting] or changed.settings[setting] == at_work[setting]:
            continue
        values = written(given[setting]), written(theirs[setting])
        yield Candidate(
            f"{configuration.kind.TITLE}'s {setting}",
            CandidateKind.DIFFERENCE,
            declared.group.value,
            values if side == 0 else values[::-1],
            (f"{name}.{setting}",),
            _setting(side, {setting: theirs[setting]}),
        )
    of_pairs, their_pairs = (pair_settings(configuration.kind, side.world) for side in (configuration, other))
    for pair in sorted({*of_pairs, *their_pairs}):
        here, there = of_pairs.get(pair, {}), their_pairs.get(pair, {})
        for setting in sorted({*here, *there}):
            values = written(here.get(setting, given[setting])), written(there.get(setting, theirs[setting]))
            if values[0] == values[1]:
                continue
            yield Candidate(
                _of_pair(configuration.kind.TITLE, setting, pair),
                CandidateKind.DIFFERENCE,
                configuration.kind.SETTINGS[setting].group.value,
                values if side == 0 else values[::-1],
                (f"{name}.{pair[0]}+{pair[1]}.{setting}",),
                _pair_setting(side, pair, setting, there.get(setting, theirs[setting])),
            )


def _same_pairs(first: Configuration, second: Configuration) -> Iterator[Candidate]:
    """Settings of pairs of materials: where only one side gives one, the other has the engine's own."""
    name, title = first.kind.NAME, first.kind.TITLE
    stated = [pair_settings(side.kind, side.world) for side in (first, second)]
    at_work = first.settings, second.settings
    for pair in sorted({*stated[0], *stated[1]}):
        here, there = (settings.get(pair, {}) for settings in stated)
        for setting in sorted({*here, *there}):
            values = here.get(setting, at_work[0][setting]), there.get(setting, at_work[1][setting])
            if values[0] == values[1]:
                continue
            yield Candidate(
                _of_pair(title, setting, pair),
                CandidateKind.DIFFERENCE,
                first.kind.SETTINGS[setting].group.value,
                (written(values[0]), written(values[1])),
                (f"{name}.{pair[0]}+{pair[1]}.{setting}",),
                _pair_setting(1, pair, setting, values[0]),
            )


def _of_pair(title: str, setting: str, pair: tuple[str, str]) -> str:
    return f"{title}'s {setting} between {pair[0]} and {pair[1]}"


def _pair_setting(side: int, pair: tuple[str, str], setting: str, value: Value) -> Callable[[Pair], Pair]:
    def apply(sides: Pair) -> Pair:
        changed = sides[side].with_pair_setting(pair, setting, value)
        return (changed, sides[1]) if side == 0 else (sides[0], changed)

    return apply


def written(value: Value) -> str:
    """A setting as people write it."""
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def _setting(side: int, values: dict[str, Value]) -> Callable[[Pair], Pair]:
    def apply(pair: Pair) -> Pair:
        changed = pair[side].with_settings(values)
        return (changed, pair[1]) if side == 0 else (pair[0], changed)

    return apply


def _away_from_default(configuration: Configuration, side: int) -> Iterator[Candidate]:
    name, at_work = configuration.kind.NAME, configuration.settings
    given = resolve_settings(configuration.kind, configuration.world)
    for setting, declared in configuration.kind.SETTINGS.items():
        default = configuration.with_settings({setting: declared.default})
        if given[setting] == declared.default or default.settings[setting] == at_work[setting]:
            continue
        yield Candidate(
            f"{configuration.kind.TITLE}'s {setting}",
            CandidateKind.DEFAULT,
            declared.group.value,
            (written(given[setting]), written(declared.default)),
            (f"{name}.{setting}",),
            _setting(side, {setting: declared.default}),
        )
    for pair, pair_setting in pair_settings(configuration.kind, configuration.world).items():
        for setting, value in pair_setting.items():
            declared = configuration.kind.SETTINGS[setting]
            if value != declared.default:
                yield Candidate(
                    _of_pair(configuration.kind.TITLE, setting, pair),
                    CandidateKind.DEFAULT,
                    declared.group.value,
                    (written(value), written(declared.default)),
                    (f"{name}.{pair[0]}+{pair[1]}.{setting}",),
                    _pair_setting(side, pair, setting, declared.default),
                )


def probes(pair: Pair) -> Iterator[Candidate]:
    """Candidates for two different engines: their choices, their accuracy, settings in common, and the place of the
    difference."""
    for side, configuration in enumerate(pair):
        yield from _alternatives(configuration, side)
    yield from _refinements(pair)
    for name, (acts, without) in REMOVALS.items():
        if any(acts(side.world) for side in pair):
            yield Candidate(
                f"no {name}", CandidateKind.REMOVAL, name, ("as it is", "none"), (name,), _both_worlds(without)
            )


def _alternatives(configuration: Configuration, side: int) -> Iterator[Candidate]:
    name, at_work = configuration.kind.NAME, configuration.settings
    finer = finer_settings(configuration.kind, at_work)
    for setting, declared in configuration.kind.SETTINGS.items():
        if declared.group in SILENT:
            continue
        others: list[Value] = [choice for choice in declared.choices if choice != "auto"]
        if isinstance(declared.default, bool):
            others = [True, False]
        elif setting in finer:
            others = [finer[setting]]
        for value in others:
            changed = configuration.with_settings({setting: value})
            if value == at_work[setting] or changed.settings[setting] != value:
                continue
            yield Candidate(
                f"{configuration.kind.TITLE}'s {setting}: {written(value)}",
                CandidateKind.ALTERNATIVE,
                declared.group.value,
                (written(at_work[setting]), written(value)),
                (f"{name}.{setting}",),
                _setting(side, {setting: value}),
            )


def _refinements(pair: Pair) -> Iterator[Candidate]:
    steps = tuple(f"{side.world.physics.timestep:g} s" for side in pair)
    yield Candidate(
        "timestep halved",
        CandidateKind.REFINEMENT,
        "timestep",
        (steps[0], "half"),
        ("timestep",),
        _both_worlds(_halved),
    )
    if any(_finer(side) for side in pair):
        yield Candidate(
            "solvers' accuracy",
            CandidateKind.REFINEMENT,
            SettingGroup.ACCURACY.value,
            ("as it is", "finer"),
            tuple(f"{side.kind.NAME}.{setting}" for side in pair for setting in _finer(side)),
            lambda sides: (sides[0].with_settings(_finer(sides[0])), sides[1].with_settings(_finer(sides[1]))),
        )
    if any(_has_friction(side.world) for side in pair):
        for cone in FRICTION_CONES:
            if any(side.world.contact.friction_cone != cone for side in pair):
                yield Candidate(
                    f"friction cone: {cone}",
                    CandidateKind.REFINEMENT,
                    "friction cone",
                    (pair[0].world.contact.friction_cone, cone),
                    ("friction cone",),
                    _both_worlds(_with_cone(cone)),
                )


def _finer(side: Configuration) -> dict[str, Value]:
    finer = finer_settings(side.kind, side.settings)
    return {name: value for name, value in finer.items() if side.kind.SETTINGS[name].group is SettingGroup.ACCURACY}


def _both_worlds(change: Callable[[World], World]) -> Callable[[Pair], Pair]:
    def apply(pair: Pair) -> Pair:
        configuration, other = (side.in_world(change(side.world)) for side in pair)
        return configuration, other

    return apply


def _halved(world: World) -> World:
    return retimed(world, 0.5 * world.physics.timestep, 2 * world.physics.steps)


def _with_cone(cone: str) -> Callable[[World], World]:
    return lambda world: dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))


def _with_pairs(world: World, change: Callable[[PairContact], PairContact]) -> World:
    contact = world.contact
    materials = tuple(
        dataclasses.replace(
            material, **{name: getattr(change(_self_pair(world, material.name)), name) for name in COMBINED_QUANTITIES}
        )
        for material in contact.materials
    )
    pairs = tuple(change(pair) for pair in contact.pairs)
    return dataclasses.replace(world, contact=dataclasses.replace(contact, materials=materials, pairs=pairs))


def _self_pair(world: World, material: str) -> PairContact:
    return next(pair for pair in world.contact.pairs if pair.first == pair.second == material)


def _with_bodies(world: World, change: Callable[[Body], Body]) -> World:
    return dataclasses.replace(world, bodies=tuple(map(change, world.bodies)))


def _has_friction(world: World) -> bool:
    return any(pair.friction or pair.torsional_friction or pair.rolling_friction for pair in world.contact.pairs)


def _untouched(world: World) -> World:
    return _with_bodies(
        world,
        lambda body: dataclasses.replace(
            body, shapes=tuple(dataclasses.replace(shape, collision=False) for shape in body.shapes)
        ),
    )


def _smooth(world: World) -> World:
    return _with_pairs(
        world, lambda pair: dataclasses.replace(pair, friction=0.0, torsional_friction=0.0, rolling_friction=0.0)
    )


def _dead(world: World) -> World:
    return _with_pairs(world, lambda pair: dataclasses.replace(pair, restitution=0.0))


def _undriven(world: World) -> World:
    return dataclasses.replace(world, controllers=(), trajectory=None)


def _left_alone(world: World) -> World:
    return dataclasses.replace(world, forces=())


def _limited(world: World) -> bool:
    return any((*(body.joint.position_limits for body in world.bodies), *(sum_.position_limits for sum_ in world.sums)))


def _unlimited(world: World) -> World:
    sums = tuple(dataclasses.replace(sum_, position_limits=None) for sum_ in world.sums)
    return _with_bodies(
        dataclasses.replace(world, sums=sums),
        lambda body: dataclasses.replace(
            body, joint=dataclasses.replace(body.joint, position_limits=None, angle_limit=None)
        ),
    )


def _oiled(world: World) -> World:
    return _with_bodies(
        world, lambda body: dataclasses.replace(body, joint=dataclasses.replace(body.joint, dry_friction=0.0))
    )


REMOVALS: dict[str, tuple[Callable[[World], bool], Callable[[World], World]]] = {
    "contact": (lambda world: any(s.collision for body in world.bodies for s in body.shapes), _untouched),
    "friction": (_has_friction, _smooth),
    "restitution": (lambda world: any(pair.restitution for pair in world.contact.pairs), _dead),
    "controllers": (lambda world: bool(world.controllers), _undriven),
    "forces on bodies": (lambda world: bool(world.forces), _left_alone),
    "joint limits": (_limited, _unlimited),
    "dry friction of joints": (lambda world: any(body.joint.dry_friction for body in world.bodies), _oiled),
}
"""Removable parts of a world: a test for presence, and a function that returns the world without it."""
