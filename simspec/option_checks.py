"""Checks of what a spec says to engines, for every command that reads a spec: options, settings at a timestep, settings without
effect, deep contact, and native controllers. They import engines only where the spec names them."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from simspec.control.reference import fed_forward
from simspec.engines.kit.registry import engines, find_engine
from simspec.engines.kit.settings import (
    Value,
    check_bounds,
    check_pair_settings,
    check_settings,
    depth_settings,
)
from simspec.errors import Location, Problem
from simspec.language.contact import EngineOptions as SpecOptions
from simspec.language.contact import SettingsAtTimestep, merged_pairs
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws, thinnest
from simspec.world.types import Pair, World

if TYPE_CHECKING:
    from simspec.engines.kit.contract import Engine
    from simspec.language.load import Spec


def nowhere(path: str) -> Location | None:
    """No place in a spec, for worlds without a spec."""
    return None


def check_at_timestep(spec: Spec) -> list[Problem]:
    """The problems of settings that follow from the timestep, at whatever timestep they hold. Of unknown engines:
    :func:`check_options`."""
    problems: dict[Problem, None] = {}
    for name, options in spec.data.engines.items():
        engine = engines().get(name)
        for last in range(len(options.at_timestep) if engine is not None else 0):
            entries = options.at_timestep[: last + 1]
            settings = {
                **options.settings,
                **{key: value for entry in entries for key, value in entry.settings.items()},
            }
            pairs = merged_pairs([options.pairs, *(entry.pairs for entry in entries)])
            for problem in _wrong_options(find_engine(name), settings, pairs):
                path = _stated_at(options, last, problem.path)
                problems[dataclasses.replace(problem, path=path, location=spec.locate(path))] = None
    return list(problems)


def pairs_without_effect(spec: Spec, world: World) -> list[Problem]:
    """Warnings of settings of pairs of materials that do nothing, at whatever timestep: no two shapes of them can touch, or
    their contact has not what the setting acts on."""
    laws, cone = meeting_laws(world), world.contact.friction_cone
    problems = []
    for name, options in spec.data.engines.items():
        table = find_engine(name).SETTINGS if name in engines() else {}
        base = f"engines.{name}"
        entries = [(f"{base}.at_timestep.{index}", entry.pairs) for index, entry in enumerate(options.at_timestep)]
        for place, pairs in ((base, options.pairs), *entries):
            for index, pair in enumerate(pairs):
                path = f"{place}.pairs.{index}"
                law, names = laws.get(pair.materials), " and ".join(pair.materials)
                if law is None:
                    message = f"no shapes of {names} can touch: these settings have no effect"
                    problems.append(
                        Problem(message, path, spec.locate(path), found=", ".join(pair.settings), code="E106")
                    )
                    continue
                for setting in pair.settings:
                    by_pair = table[setting].by_pair if setting in table else None
                    if by_pair is not None and (why := by_pair.idle(law, cone)):
                        message = f"{setting} has no effect in contacts of {names}"
                        where = f"{path}.settings.{setting}"
                        problems.append(Problem(message, where, spec.locate(where), found=why, code="E106"))
    return problems


DEEP = 0.1
"""Share of the inner radius of the smallest shape from which a depth of contact is warned of: a cube of 1 mm rests 6 % of its
edge deep on a cushion of 0.1 mm."""


def deep_contact(spec: Spec, world: World, names: Iterable[str] | None = None) -> list[Problem]:
    """Warnings of cushions and margins of engines that are large compared with the smallest shape, one for each setting and
    value, with the engines that have it. ``names``: the engines that matter (default: all)."""
    least = thinnest(world)
    if least is None:
        return []
    depths: dict[tuple[str, float], list[str]] = {}
    for name in engines() if names is None else names:
        if _shallow(name, world, DEEP * least.inner):
            continue
        for setting, depth in depth_settings(engines()[name], world).items():
            if depth > DEEP * least.inner:
                depths.setdefault((setting, depth), []).append(name)
    path = f"bodies.{least.body}.shapes.{least.index}"
    problems = []
    for (setting, depth), deep in depths.items():
        message = (
            f"the contact of this shape is up to {depth:.3g} m deep in {', '.join(deep)}, by the setting {setting}"
        )
        allowed = f"up to {DEEP:.0%} of the inner radius of the shape, {least.inner:.3g} m"
        where = ", ".join(f"engines.{name}.settings" for name in deep)
        hint = f"{setting}: {DEEP * least.inner:.2g} in {where}"
        problems.append(
            Problem(message, path, spec.locate(path), f"{depth / least.inner:.0%}", allowed, hint, code="W118")
        )
    return problems


def _shallow(name: str, world: World, most: float) -> bool:
    """Whether contact in an engine is at most ``most`` (m) deep by the defaults that its package states, where the spec sets
    none of these settings: known without importing the engine."""
    defaults = engines().stated(name, "DEPTHS")
    options = world.options(name)
    given = {setting for setting, _ in options.settings}
    return (
        defaults is not None
        and not options.pairs
        and not given & defaults.keys()
        and all(depth <= most for depth in defaults.values())
    )


def _wrong_options(
    engine: type[Engine], settings: Mapping[str, Value], pairs: Mapping[Pair, Mapping[str, Value]]
) -> list[Problem]:
    local = tuple(settings.items())
    return [
        *check_settings(engine, local),
        *check_pair_settings(engine, local, {pair: tuple(values.items()) for pair, values in pairs.items()}),
    ]


def _stated_at(options: SpecOptions, last: int, path: str) -> str:
    """The path in the spec that says the setting of a path of the world, where the entries up to ``last`` hold."""
    steps = path.split(".")
    base, setting = ".".join(steps[:2]), steps[-1]
    entries: list[tuple[str, SpecOptions | SettingsAtTimestep]]
    entries = [(f"{base}.at_timestep.{index}", options.at_timestep[index]) for index in range(last, -1, -1)]
    for place, holder in (*entries, (base, options)):
        if steps[2] == "settings" and setting in holder.settings:
            return f"{place}.settings.{setting}"
        for index, pair in enumerate(holder.pairs if steps[2] == "pairs" else ()):
            if pair.materials == tuple(steps[3:5]) and setting in pair.settings:
                return f"{place}.pairs.{index}.settings.{setting}"
    return path


def check_options(world: World, locate: Callable[[str], Location | None] = nowhere) -> list[Problem]:
    """The problems of what the spec says to engines: unknown engines, settings, and feature names."""
    problems: list[Problem] = []
    words = [feature.value for feature in Feature]
    for options in world.engines:
        path = f"engines.{options.engine}"
        engine = engines().get(options.engine)
        if engine is None:
            near = difflib.get_close_matches(options.engine, engines(), 1)
            problems.append(
                Problem(
                    f"no engine is called {options.engine!r}",
                    path,
                    allowed=", ".join(engines()),
                    hint=f"did you mean {near[0]!r}?" if near else None,
                    code="E107",
                )
            )
            continue
        pairs = {(pair.first, pair.second): dict(pair.settings) for pair in options.pairs}
        problems.extend(_wrong_options(engine, dict(options.settings), pairs) or check_bounds(engine, world))
        for key, names in (("accept", options.accept), ("outside", options.outside)):
            for name in names:
                if name not in words:
                    near = difflib.get_close_matches(name, words, 1)
                    problems.append(
                        Problem(
                            f"no feature is called {name!r}",
                            f"{path}.{key}",
                            allowed="the names of simspec's support matrix (simspec engines)",
                            hint=f"did you mean {near[0]!r}?" if near else None,
                            code="E108",
                        )
                    )
    return [dataclasses.replace(problem, location=locate(problem.path)) for problem in problems]


def check_control(world: World, locate: Callable[[str], Location | None] = nowhere) -> list[Problem]:
    """The problems of engines' own controllers that no engine can solve: one for each controller."""
    fed: dict[str, list[str]] = {}
    for controller, joint in fed_forward(world):
        fed.setdefault(controller, []).append(joint)
    return [
        Problem(
            "law native does not support feed-forward efforts, and the trajectory has some for its joints",
            f"control.{name}",
            locate(f"control.{name}"),
            found=", ".join(joints),
            hint="use law: pd, or remove efforts (and a grasp's squeeze) from the trajectory",
            code="S715",
        )
        for name, joints in fed.items()
    ]
