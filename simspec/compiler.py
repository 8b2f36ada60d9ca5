"""World to artifacts: negotiate with an engine and its format, emit the files, write them whole or not at all."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from simspec.contact import (
    MOST_SPLIT_MATERIALS,
    ContactPlan,
    contact_plan,
    coupled_needs,
    impact_needs,
    pair_needs,
    unreachable,
)
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.sidecar import Target
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engine_name, engine_version, find_engine, format_of, version_in
from simspec.engines.kit.settings import (
    pair_settings,
    written_settings,
)
from simspec.errors import EngineRefusal, Location, Problem, UnsupportedError
from simspec.option_checks import check_control, check_options, nowhere
from simspec.outputs.writing import Artifacts
from simspec.support.declarations import Level, combine
from simspec.support.features import Feature
from simspec.support.negotiation import Decision, Need, needs, negotiate
from simspec.world.armature import weightless
from simspec.world.canonical import canonical_json
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import EngineOptions, World

WORLD_FILE = "world.json"


@dataclass(frozen=True)
class Compiled:
    """The artifacts of one world for one engine, and how each needed feature is realised."""

    engine: str
    dialect: str
    format: str
    artifacts: Artifacts
    decisions: tuple[Decision, ...]

    def __repr__(self) -> str:
        return f"<Compiled for {self.engine}: {len(self.artifacts)} files, {self.format}>"

    @property
    def files(self) -> Mapping[str, str]:
        """The artifacts as {relative path: text}."""
        return self.artifacts.texts

    @property
    def sha256(self) -> str:
        """One hash over all files, their names included."""
        return self.artifacts.sha256


def compile_world(
    world: World,
    targets: Iterable[str],
    locate: Callable[[str], Location | None] = nowhere,
    plans: Mapping[str, ContactPlan] | None = None,
    pythons: Mapping[str, str] | None = None,
) -> dict[str, Compiled]:
    """Compile ``world`` for each target, in order; the result is keyed by engine.

    A target is an engine's name or label. ``locate`` gives the place in the spec of a dotted path, for errors. ``plans``
    gives, by engine, numbers of materials to use instead of those that
    the world defines: contact probes have the numbers of the scenario that they stand for. ``pythons``: interpreters by
    target, whose versions of the engines count for support (see :func:`version_at_work`).
    Raises UnsupportedError with every problem of every target together, EngineError when an interpreter gives no version.
    """
    compiled: dict[str, Compiled] = {}
    problems: list[Problem] = [*check_options(world, locate), *check_control(world, locate)]
    names = list(dict.fromkeys(targets))
    for name in names:
        find_engine(name)
    decisions: dict[str, tuple[Decision, ...]] = {}
    for name in names:
        try:
            decisions[name] = _negotiate(world, name, locate, (plans or {}).get(name), pythons)
        except UnsupportedError as error:
            problems.extend(_located(error, name, locate))
    for name in names:
        # files are written from the options: from wrong ones, anything could come
        if name in decisions and not any(_of_options(problem, name) for problem in problems):
            try:
                compiled[name] = _emit(world, name, (plans or {}).get(name), decisions[name])
            except UnsupportedError as error:
                problems.extend(_located(error, name, locate))
    if problems:
        raise UnsupportedError(problems)
    return compiled


def _of_options(problem: Problem, engine: str) -> bool:
    return f"{problem.path}.".startswith((f"engines.{engine_name(engine)}.", "control."))


def _located(error: UnsupportedError, label: str, locate: Callable[[str], Location | None]) -> list[Problem]:
    """Formats know neither the spec nor the engine: their refusals get the place and the engine here."""
    located = [
        problem if problem.location else dataclasses.replace(problem, location=locate(problem.path))
        for problem in error.problems
    ]
    return [
        problem
        if isinstance(problem, EngineRefusal)
        else EngineRefusal(
            problem.message,
            problem.path,
            problem.location,
            problem.found,
            problem.allowed,
            problem.hint,
            engine_name(label),
            code=problem.code,
        )
        for problem in located
    ]


def _negotiate(
    world: World,
    label: str,
    locate: Callable[[str], Location | None],
    plan: ContactPlan | None,
    pythons: Mapping[str, str] | None,
) -> tuple[Decision, ...]:
    engine = find_engine(label)
    decisions = needed_decisions(world, label, locate, plan, pythons)
    if plan is None and engine.LAYERS:
        _refuse_unreachable(world, engine)
    return tuple(decisions)


def _emit(world: World, label: str, plan: ContactPlan | None, decisions: tuple[Decision, ...]) -> Compiled:
    engine = find_engine(label)
    files = dialects()[engine.DIALECT].emit(world, target_of(world, engine, plan))
    return Compiled(label, engine.DIALECT, format_of(engine), Artifacts(files), decisions)


def needed_decisions(
    world: World,
    label: str,
    locate: Callable[[str], Location | None] = nowhere,
    plan: ContactPlan | None = None,
    pythons: Mapping[str, str] | None = None,
) -> list[Decision]:
    """How each feature that ``world`` needs is realised in the engine of a ``label``, at the version that is at work; nothing
    is emitted. Raises UnsupportedError, and EngineError as :func:`version_at_work`."""
    engine = find_engine(label)
    table = combine(dialects()[engine.DIALECT].SUPPORT, engine.SUPPORT)
    version = version_at_work(label, pythons) if bounded(world, label) else None
    received = dialects()[engine.DIALECT].received(world)
    extra = [*_weights(world, received), *(() if plan is not None else _engine_needs(received, engine))]
    return negotiate(world, engine.NAME, table, locate, extra, engine.TITLE, version, received)


def _weights(world: World, received: World) -> Iterator[Need]:
    """The need of other weights than mass × gravity of a world that has armature as mass."""
    added = weightless(world, received)
    if added and all(body.gravity_scale == 1.0 for body in world.bodies):
        yield Need(Feature.GRAVITY_SCALE, tuple(f"bodies.{name}.joint.armature" for name in added))


def _engine_needs(world: World, engine: type[Engine]) -> tuple[Need, ...]:
    """The needs of a world, as the engine has it, in addition to those of its spec, since the engine combines numbers by other
    rules."""
    return (*pair_needs(world, engine.RULES), *impact_needs(world), *coupled_needs(world))


def bounded(world: World, label: str) -> bool:
    """Whether something that ``world`` needs is supported by some releases of an engine only: otherwise its version is not
    needed."""
    engine = find_engine(label)
    tables = (dialects()[engine.DIALECT].SUPPORT, engine.SUPPORT)
    some = {feature for table in tables for feature, support in table.items() if support.since or support.until}
    return bool(some) and any(need.feature in some for need in (*needs(world), *_engine_needs(world, engine)))


def version_at_work(label: str, pythons: Mapping[str, str] | None = None) -> str | None:
    """The release of an engine that bounds of support are held against: that of the interpreter that ``pythons`` has for the
    label, else the one that the label names, else the installed one; None: not known.

    Raises EngineError where an interpreter gives no version.
    """
    engine = find_engine(label)
    python = (pythons or {}).get(label)
    if python is not None:
        return version_in(python, label)
    return engine_version(label) or engine.version()


OPTION_OF: Mapping[Level, str] = {Level.APPROXIMATE: "accept", Level.OUTSIDE: "outside"}
"""Where a feature is named that an engine has approximately, or not of its own."""


def missing_options(world: World, engine: str, pythons: Mapping[str, str] | None = None) -> dict[str, dict[str, str]]:
    """The features that ``engine``, a name or a label, needs to be accepted or requested and that are not yet, by ``accept``
    and ``outside``, each with its short reason. Raises UnsupportedError for what it does not support at all."""
    known, options = find_engine(engine), world.options(engine_name(engine))
    every = tuple(feature.value for feature in Feature)
    allowed = dataclasses.replace(options, accept=every, outside=every)
    needed: dict[str, dict[str, str]] = {}
    for decision in needed_decisions(_with_options(world, allowed), engine, pythons=pythons):
        key, name = OPTION_OF.get(decision.level), decision.feature.value
        if key is None or name in getattr(options, key):
            continue
        others = tuple(word for word in getattr(allowed, key) if word != name)
        without = (
            dataclasses.replace(allowed, accept=others)
            if key == "accept"
            else dataclasses.replace(allowed, outside=others)
        )
        try:
            tried = _with_options(world, without)
            needed_decisions(tried, engine, pythons=pythons)
            dialects()[known.DIALECT].emit(tried, target_of(tried, known))  # which may refuse by itself
        except UnsupportedError:
            needed.setdefault(key, {})[name] = decision.short
        else:
            allowed = without
    return needed


def _with_options(world: World, options: EngineOptions) -> World:
    others = tuple(engine for engine in world.engines if engine.engine != options.engine)
    return dataclasses.replace(world, engines=(*others, options))


def _refuse_unreachable(world: World, engine: type[Engine]) -> None:
    """Raise UnsupportedError for laws that neither numbers nor copies of shapes give, one problem for each quantity."""
    laws = meeting_laws(world)
    problems = []
    for quantity, pairs in unreachable(world, engine.RULES, contact_plan(world, engine.RULES, engine.LAYERS)).items():
        (first, second), combined_value = next(iter(pairs.items()))
        law, word, rule = laws[first, second], quantity.replace("_", " "), getattr(engine.RULES, quantity)
        if rule == "cross" and not law.friction:
            why = "it has an effect only with sliding friction, which they do not have"
            hint = f"give them sliding friction, leave their {word} out, or run without --engine {engine.NAME}"
        else:
            why = (
                f"not representable by material parameters (rule: {rule}), nor by copies of shapes, which are searched "
            )
            why += f"for up to {MOST_SPLIT_MATERIALS} materials"
            hint = f"use fewer materials, or values that the rule produces, or run without --engine {engine.NAME}"
        more = f" (and {len(pairs) - 1} more pairs)" if len(pairs) > 1 else ""
        kind = (
            law.hardness.kind
            if quantity == "hardness"
            else f"{getattr(law, quantity):.6g}, would be {combined_value:.6g}"
        )
        problems.append(
            Problem(
                f"{engine.NAME} does not support this {word} of {first} and {second}: {why}{more}",
                f"contact.pairs.{first}.{second}.{quantity}",
                found=f"{word} {kind}",
                hint=hint,
                code="E104",
            )
        )
    if problems:
        raise UnsupportedError(problems)


def target_of(world: World, engine: type[Engine], plan: ContactPlan | None = None) -> Target:
    """The target with which a format writes ``world`` for ``engine``; ``plan``: in place of the world's plan."""
    plan = plan or contact_plan(world, engine.RULES, engine.LAYERS)
    return Target(engine.NAME, engine.RULES, plan, written_settings(engine, world), pair_settings(engine, world))


def write_folder(files: Mapping[str, str | bytes], folder: Path) -> None:
    """Write ``files`` into a folder of the caller's own, in a temporary place: it must not exist yet, or be empty.

    Folders that a user names are written by :mod:`simspec.outputs`. Raises SpecError when a path would leave the folder.
    """
    Artifacts(files).write(folder)


def output_files(world: World, compiled: Mapping[str, Compiled]) -> Artifacts:
    """All files of ``generated/<name>/``: world.json, and one folder for each engine."""
    files: dict[str, str | bytes] = {WORLD_FILE: canonical_json(world) + "\n"}
    for name, compilation in compiled.items():
        files.update({f"{name}/{path}": content for path, content in compilation.artifacts.items()})
    return Artifacts(files)
