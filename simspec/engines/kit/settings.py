"""Solver settings of an engine: their declarations, those that a world writes, and the check of a spec's values."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar, Protocol

from simspec.errors import Problem
from simspec.language.vocabulary import FRICTION_CONES
from simspec.world.contact_pairs import heaviest, meeting_laws, only_free_spheres, thinnest
from simspec.world.kinematics import frictional_coordinates
from simspec.world.types import Pair, PairContact, World

# Largest and least values of solver settings that follow from a world: beyond them contact is no longer that of its shapes.


@dataclass(frozen=True, slots=True)
class SettingLimit:
    """A bound of a setting in a world, and what it follows from."""

    value: float
    why: str


Bound = Callable[[World], SettingLimit | None]
"""The bound in a world; None where it has none."""

SHARE = 0.1
"""Of the inner radius of the smallest shape: a length of contact beyond it is a different shape. A slop of that much lets a box
of 10 cm rest 5 mm deep; a margin of its whole inner radius throws a cylinder 25 mm (measured in one engine)."""
COARSE = 0.5
"""The same of an engine's margin around shapes, which it takes off their size: up to this a box of 10 cm and a cylinder of 3 cm
rest and slide as without (6 µm, measured in one engine)."""


def of_thinnest(share: float) -> Bound:
    """A length (m) of at most a share of the inner radius of the smallest shape."""

    def bound(world: World) -> SettingLimit | None:
        least = thinnest(world)
        if least is None:
            return None
        why = f"{share:.0%} of the inner radius of the smallest collision shape, of {least.body}"
        return SettingLimit(share * least.inner, why)

    return bound


def of_mobility(world: World) -> SettingLimit | None:
    """A compliance (m/(N s)) of at most dt / m of the heaviest body: beyond it a contact takes less than half of an approach
    away in a step. At that bound 1 kg at 1 ms rests 0.25 mm deep, at ten times as much 2.4 mm, at a thousand times it falls
    through (measured in one engine)."""
    most = heaviest(world)
    if most is None:
        return None
    return SettingLimit(world.physics.timestep / most[1], f"the timestep over the mass of the heaviest body, {most[0]}")


def under_weight(world: World) -> SettingLimit | None:
    """A stiffness (N/m) of at least that with which the heaviest body's weight presses it ``SHARE`` of the smallest shape's
    inner radius deep."""
    most, least, gravity = heaviest(world), thinnest(world), math.hypot(*world.physics.gravity)
    if most is None or least is None or not gravity:
        return None
    why = (
        f"the weight of {most[0]} over {SHARE:.0%} of the inner radius of the smallest collision shape, of {least.body}"
    )
    return SettingLimit(most[1] * gravity / (SHARE * least.inner), why)


ROUND_OFF = 1e-9
"""Share of a bound of a world by which a setting may be beyond it."""
COMMON_METHOD = "common"
"""The value of a setting of the method of integration that is semi-implicit Euler: it is not written to files."""
Value = bool | int | float | str
"""Types of the value of a setting."""

LARGEST_WHOLE = 2**31 - 1
"""The largest whole number that every engine's settings can hold."""


class SettingGroup(StrEnum):
    """The quantity that a setting acts on: the closed vocabulary by which differences of runs are reported
    (``docs/guide/explain.md``)."""

    SOLVER = "solver"
    ACCURACY = "solver accuracy"
    ERROR_REDUCTION = "contact error reduction"
    SOFTNESS = "contact softness"
    FRICTION = "friction model"
    GEOMETRY = "contact geometry"
    DETECTOR = "collision detector"
    RESTITUTION = "restitution"
    JOINTS = "joint limits and dry friction"
    ROTATION = "integration of rotations"
    INTEGRATION = "method of integration"
    SLEEPING = "sleeping"
    ORDER = "order of the equations"
    BOUNDS = "bounds of the computation"
    OTHER = "other settings"


@dataclass(frozen=True, slots=True)
class ByPair:
    """The contacts in which a setting of a pair of materials acts: of these kinds of hardness, under these friction cones, and
    with friction or without restitution where that is needed."""

    hardness: tuple[str, ...]
    cones: tuple[str, ...] = FRICTION_CONES
    friction: bool = False
    inelastic: bool = False

    def idle(self, law: PairContact, cone: str) -> str:
        """Why it has no effect in contacts of a law; empty where it has one."""
        if law.hardness.kind not in self.hardness:
            return f"hardness {law.hardness.kind}"
        if cone not in self.cones:
            return f"friction cone {cone}"
        if self.friction and not law.friction:
            return "no friction"
        return "restitution" if self.inelastic and law.restitution else ""


@dataclass(frozen=True, slots=True)
class Setting:
    """One solver setting of an engine: its default, what is allowed, what it does and why the default is what it is."""

    default: Value
    meaning: str
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    only_with: str = ""
    """The switch (a setting, or itself) without which it means nothing and is not written: files of worlds that do not ask for
    it stay as they are."""
    needs: tuple[str, tuple[bool | str, ...]] | None = None
    """Another setting, and its values with which this one acts; with others it does nothing, and to give it is an error."""
    group: SettingGroup = SettingGroup.OTHER
    """The quantity that it acts on."""
    finer: Value | None = None
    """Where a value nearer to the exact solution is known: a much finer one than the default, at whatever cost. ``simspec
    explain`` tests with it whether a difference comes from the accuracy."""
    frictionless: Value | None = None
    """The default in worlds of free balls without friction (``only_free_spheres``); None: the same."""
    frictionless_unless: tuple[str, Value] | None = None
    """Another setting and a value: where a spec states that, the default is the ordinary one in such worlds, too."""
    kinematic: Value | None = None
    """The default in worlds with kinematic bodies, which are 1e5 times as heavy as all else that moves; None: the same."""
    light: Value | None = None
    """The default in worlds with constraints or dry friction in joints, which may be of bodies much lighter than all else;
    None: the same."""
    usual: Value | None = None
    """The default where a spec selects the usual method of integration of each engine; None: the same."""
    at_most: Bound | None = None
    """The largest value that means something in a world, where that follows from its sizes and masses."""
    depth: bool = False
    """Whether it is a length (m) by which what touches is nearer, or further away, than its shapes say."""
    at_least: Bound | None = None
    """The same of the least."""
    by_pair: ByPair | None = None
    """Where each pair of materials may have a value of its own (``engines.NAME.pairs``): in which contacts it acts."""


class HasSettings(Protocol):
    """The attributes of an engine's class that its settings need."""

    NAME: ClassVar[str]
    SETTINGS: ClassVar[Mapping[str, Setting]]

    @classmethod
    def chosen_settings(cls, world: World, settings: Mapping[str, Value]) -> Mapping[str, Value]:
        """See :class:`simspec.engines.kit.contract.Engine`."""
        ...


def resolve_settings(engine: type[HasSettings], world: World) -> dict[str, Value]:
    """The engine's solver settings: its defaults for such a world, with those of the world's options over them.

    The options were checked by :func:`check_settings`.
    """
    stated = dict(world.options(engine.NAME).settings)
    defaults = default_settings(engine, stated, only_free_spheres(world))
    known = engine.SETTINGS.items()
    if world.constraints or len(frictional_coordinates(world)):
        defaults |= {name: setting.light for name, setting in known if setting.light is not None}
    if world.physics.integrator != COMMON_METHOD:
        defaults |= {name: setting.usual for name, setting in known if setting.usual is not None}
    if world.motions:
        defaults |= {name: setting.kinematic for name, setting in known if setting.kinematic is not None}
    return defaults | stated


def default_settings(engine: type[HasSettings], stated: Mapping[str, Value], frictionless: bool) -> dict[str, Value]:
    """The defaults of the settings that a spec does not state; ``frictionless``: those of worlds of free balls without
    friction.

    A default is not replaced by the frictionless one where a stated setting would then have no effect, or excludes it.
    """
    defaults = {name: setting.default for name, setting in engine.SETTINGS.items()}
    if not frictionless:
        return defaults
    known = (engine.SETTINGS.get(name) for name in stated)
    needed = [setting.needs for setting in known if setting is not None and setting.needs is not None]
    for name, setting in engine.SETTINGS.items():
        value = setting.frictionless
        if setting.frictionless_unless is not None and setting.frictionless_unless in stated.items():
            continue
        if value is not None and not any(other == name and value not in values for other, values in needed):
            defaults[name] = value
    return defaults


def written_settings(engine: type[HasSettings], world: World) -> dict[str, Value]:
    """The settings that stand in files: those of :func:`resolve_settings` but for those whose switch is off.

    Settings that the engine does not have stay, for it to refuse.
    """
    found = dict(engine.chosen_settings(world, resolve_settings(engine, world)))
    switched_off = (False, 0, COMMON_METHOD)
    off = {
        name
        for name, setting in engine.SETTINGS.items()
        if setting.only_with and found[setting.only_with] in switched_off
    }
    return {name: value for name, value in found.items() if name not in off}


def pair_settings(engine: type[HasSettings], world: World) -> dict[Pair, dict[str, Value]]:
    """The settings of pairs of materials that replace the engine's, by the sorted names of the two."""
    return {(pair.first, pair.second): dict(pair.settings) for pair in world.options(engine.NAME).pairs}


def settings_of_pair(engine: type[HasSettings], world: World, pair: Pair) -> dict[str, Value]:
    """All settings that are in force between two materials (sorted names)."""
    return resolve_settings(engine, world) | pair_settings(engine, world).get(pair, {})


def finer_settings(engine: type[HasSettings], settings: Mapping[str, Value]) -> dict[str, Value]:
    """The values of the settings that have a finer one, where the present one is not as fine."""
    finer: dict[str, Value] = {}
    for name, setting in engine.SETTINGS.items():
        value, finest, default = settings[name], setting.finer, setting.default
        if not isinstance(finest, (int, float)) or isinstance(value, str) or isinstance(default, str):
            continue
        if value > finest if finest <= default else value < finest:
            finer[name] = finest
    return finer


def idle_settings(engine: type[HasSettings], settings: Mapping[str, Any]) -> dict[str, str]:
    """The settings that have no effect with the others, each with why (``"with friction: coulomb"``), of all of an engine's."""
    found = {}
    for name, setting in engine.SETTINGS.items():
        if setting.needs is not None and (value := settings[setting.needs[0]]) not in setting.needs[1]:
            found[name] = f"with {_written(setting.needs[0], value)}"
    return found


def _written(name: str, value: Value) -> str:
    """A setting as a spec writes it."""
    return f"{name}: {str(value).lower() if isinstance(value, bool) else value}"


def check_settings(engine: type[HasSettings], settings: Sequence[tuple[str, Any]]) -> list[Problem]:
    """The problems of solver settings given for ``engine``: unknown names, wrong types, values out of range, and, where all
    else is right, settings that have no effect with others."""
    place = f"engines.{engine.NAME}.settings"
    return _wrong_settings(engine, place, settings) or _idle(engine, place, dict(settings), {})


def check_bounds(engine: type[HasSettings], world: World) -> list[Problem]:
    """The problems of settings that a world states for ``engine``, or for pairs of materials, beyond what its sizes and masses
    allow. Names and types were checked."""
    options, place = world.options(engine.NAME), f"engines.{engine.NAME}"
    stated = [(f"{place}.settings", options.settings)]
    stated += [(f"{place}.pairs.{pair.first}.{pair.second}", pair.settings) for pair in options.pairs]
    problems = []
    for path, settings in stated:
        for name, value in settings:
            setting = engine.SETTINGS.get(name)
            if setting is None or isinstance(value, str):
                continue
            for bound, sign, words in ((setting.at_most, 1.0, "at most"), (setting.at_least, -1.0, "at least")):
                limit = bound(world) if bound is not None else None
                if limit is not None and sign * value > sign * limit.value * (1.0 + sign * ROUND_OFF):
                    allowed = f"{words} {limit.value:.3g} in this world: {limit.why}"
                    message = (
                        f"{engine.NAME}'s setting {name!r} is too {'large' if sign > 0.0 else 'small'} for this world"
                    )
                    problems.append(
                        Problem(message, f"{path}.{name}", found=_written(name, value), allowed=allowed, code="E105")
                    )
    return problems


def depth_settings(engine: type[HasSettings], world: World) -> dict[str, float]:
    """The lengths in force (m) by which contact of ``world`` differs from its shapes, by setting; the largest of all pairs of
    materials that can meet, and in whose contact it acts."""
    names = [name for name, setting in engine.SETTINGS.items() if setting.depth]
    found: dict[str, float] = {}
    for pair, law in meeting_laws(world).items() if names else ():
        settings = settings_of_pair(engine, world, pair)
        idle = idle_settings(engine, settings)
        for name in names:
            by_pair, value = engine.SETTINGS[name].by_pair, settings[name]
            acts = name not in idle and (by_pair is None or not by_pair.idle(law, world.contact.friction_cone))
            if acts and not isinstance(value, str) and value > 0.0:
                found[name] = max(found.get(name, 0.0), float(value))
    return found


def check_pair_settings(
    engine: type[HasSettings],
    settings: Sequence[tuple[str, Any]],
    pairs: Mapping[Pair, Sequence[tuple[str, Any]]],
) -> list[Problem]:
    """The problems of solver settings given for pairs of materials in addition to the engine's ``settings``: as of
    :func:`check_settings`, and settings that no pair can have a value of its own of. Their paths are
    ``engines.NAME.pairs.FIRST.SECOND.SETTING``."""
    problems: list[Problem] = []
    by_pair = [name for name, setting in engine.SETTINGS.items() if setting.by_pair]
    for (first, second), pair in pairs.items():
        place = f"engines.{engine.NAME}.pairs.{first}.{second}"
        shared = [name for name, _ in pair if name in engine.SETTINGS and name not in by_pair]
        wrong = [
            Problem(
                f"{engine.NAME}'s setting {name!r} has one value for all contacts, none for each pair of materials",
                f"{place}.{name}",
                found=name,
                allowed=", ".join(by_pair) or f"no settings: {engine.NAME} has none for each pair",
                hint=f"engines.{engine.NAME}.settings.{name}",
                code="E105",
            )
            for name in shared
        ]
        wrong += _wrong_settings(engine, place, [(name, value) for name, value in pair if name not in shared], by_pair)
        problems += wrong or _idle(engine, place, dict(pair), dict(settings))
    return problems


def _wrong_settings(
    engine: type[HasSettings], place: str, settings: Sequence[tuple[str, Any]], allowed: Sequence[str] | None = None
) -> list[Problem]:
    problems: list[Problem] = []
    names = list(engine.SETTINGS) if allowed is None else allowed
    for name, value in settings:
        path = f"{place}.{name}"
        setting = engine.SETTINGS.get(name)
        if setting is None:
            near = difflib.get_close_matches(name, names, 1)
            problems.append(
                Problem(
                    f"{engine.NAME} has no setting {name!r}",
                    path,
                    found=name,
                    allowed=", ".join(names) or f"no settings: {engine.NAME} has none for each pair",
                    hint=f"did you mean {near[0]!r}?" if near else None,
                    code="E105",
                )
            )
        elif wrong := _wrong_value(setting, value):
            problems.append(Problem(f"wrong value for {name!r}", path, found=repr(value), allowed=wrong, code="E105"))
    return problems


def _idle(
    engine: type[HasSettings], place: str, given: Mapping[str, Any], alongside: Mapping[str, Any]
) -> list[Problem]:
    """The settings of those given at a place that do nothing with each other and those ``beside`` them."""
    defaults = {name: setting.default for name, setting in engine.SETTINGS.items()}
    why = idle_settings(engine, {**defaults, **alongside, **given})
    problems = []
    for name, value in given.items():
        if name not in why or (needs := engine.SETTINGS[name].needs) is None:
            continue
        acts = " or ".join(_written(needs[0], entry) for entry in needs[1])
        problems.append(
            Problem(
                f"{engine.NAME}'s setting {name!r} has no effect {why[name]}",
                f"{place}.{name}",
                found=_written(name, value),
                hint=f"remove it; it has an effect with {acts}",
                code="E106",
            )
        )
    return problems


def _wrong_value(setting: Setting, value: Any) -> str | None:
    kind = type(setting.default)
    if kind is float and type(value) is int and abs(value) <= LARGEST_WHOLE:
        value = float(value)
    if not isinstance(value, kind) or type(value) is not kind:  # True is an int, too
        return {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}[kind]
    if setting.choices and value not in setting.choices:
        return ", ".join(setting.choices)
    if isinstance(value, str):
        return None
    if kind is float and not math.isfinite(value):
        return "a finite number"
    if kind is int and abs(value) > LARGEST_WHOLE:
        return f"a whole number of at most {LARGEST_WHOLE}"
    if setting.minimum is not None and value < setting.minimum:
        return f"at least {setting.minimum}"
    if setting.maximum is not None and value > setting.maximum:
        return f"at most {setting.maximum}"
    return None
