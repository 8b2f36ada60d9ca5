"""Does the proof catch anything? One defect at a time is planted into compiled files, in each engine."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from simspec.compiler import Compiled, compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.defects import NAMES, Plant
from simspec.engines.kit.process import side_by_side
from simspec.engines.kit.registry import find_engine
from simspec.errors import UnsupportedError
from simspec.proof.checks import NOTHING
from simspec.proof.selftest_worlds import SMALLER, WORLDS
from simspec.proof.verify import LEVELS, Probes, prepare, verify
from simspec.scratch import scratch_folder
from simspec.world.types import World

DEADLINE = 400.0
"""Seconds for one defective load, contact probes included: several times what the slowest engine takes for a sound one."""
WORKERS = 2
READ_BACK = LEVELS[:5]
"""Levels at which an engine is asked what it holds, and nothing moves."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one defect in one engine.

    ``caught``: True, False, or None where the engine cannot hold it (``reason`` says why). ``by``: the levels that noticed;
    only those above L0 count as catching, since the text alone says nothing of the engine. ``first``: what was found.
    """

    engine: str
    defect: str
    caught: bool | None
    by: tuple[str, ...] = ()
    first: str = ""
    reason: str = ""


@dataclass(frozen=True)
class SelfTest:
    """All outcomes, in the order of engines and defects."""

    outcomes: tuple[Outcome, ...]

    @property
    def planted(self) -> int:
        """How many defects were planted (those that the engines can hold)."""
        return sum(outcome.caught is not None for outcome in self.outcomes)

    @property
    def caught(self) -> int:
        """How many of them the proof noticed."""
        return sum(outcome.caught is True for outcome in self.outcomes)

    @property
    def passed(self) -> bool:
        """Whether something was planted and all of it was caught."""
        return self.planted > 0 and self.caught == self.planted


def defects_of(dialect: str) -> Mapping[str, Plant | str]:
    """The table of defects of a dialect: ``DEFECTS`` of the module ``defects`` beside its own.

    Raises LookupError when the table leaves out a defect.
    """
    module = importlib.import_module(f"{type(dialects()[dialect]).__module__.rpartition('.')[0]}.defects")
    missing = [name for name in NAMES if name not in module.DEFECTS]
    if missing:
        raise LookupError(f"{module.__name__} does not cover {missing}")
    table: Mapping[str, Plant | str] = module.DEFECTS
    return table


def self_test(
    engines: Sequence[str],
    *,
    defects: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
    pythons: Mapping[str, str] | None = None,
    every_level: bool = True,
) -> SelfTest:
    """Plant every defect (or those named) into every engine's files, one at a time, and verify each.

    ``every_level``: False asks first for what engines hold, and moves (L5 to L7, most of the time it takes) only what that does
    not notice.

    Before the first defect of a world, the world itself must verify: a proof that refuses a sound world catches nothing.
    Raises AssertionError when it does not.
    """
    say = progress or (lambda text: None)
    outcomes: list[Outcome] = []
    for engine in engines:
        bench = _Bench(engine, pythons or {}, every_level)
        names = [name for name in NAMES if defects is None or name in defects]
        for world in dict.fromkeys(NAMES[name] for name in names):
            say(f"{engine}: the sound world “{world}”")
            bench.open(world)
        say(f"{engine}: {len(names)} defects")
        with side_by_side(WORKERS) as pool:
            outcomes.extend(pool.map(bench.plant, names))
    return SelfTest(tuple(outcomes))


class _Bench:
    """One engine's sound worlds, compiled and with their probes."""

    def __init__(self, engine: str, pythons: Mapping[str, str], every_level: bool):
        self.engine = engine
        self._tries = (LEVELS,) if every_level else (READ_BACK, LEVELS)
        self._pythons = pythons
        self._sound: dict[str, tuple[World, Compiled, list[Probes]] | str] = {}

    def open(self, name: str) -> None:
        world = WORLDS[name](self.engine)
        try:
            compiled = compile_world(world, [self.engine])[self.engine]
        except UnsupportedError as error:
            self._sound[name] = error.problems[0].message
            if name in SMALLER:
                self.open(SMALLER[name][0])
            return
        numbers = find_engine(self.engine).PRECISION
        probes = prepare(world, precision=numbers)
        certificate = verify(world, [self.engine], probes=probes, pythons=self._pythons, deadline=DEADLINE)
        if not certificate.valid:
            _, check = certificate.failures()[0]
            raise AssertionError(
                f"{self.engine}: the sound world {name!r} fails {check.level} {check.name}: {check.detail}"
            )
        others = [prepare(world, levels, numbers) for levels in self._tries if levels != LEVELS]
        self._sound[name] = (world, compiled, [*others, probes])

    def plant(self, defect: str) -> Outcome:
        sound = self._sound[NAMES[defect]]
        if isinstance(sound, str) and NAMES[defect] in SMALLER:
            smaller, fitting = SMALLER[NAMES[defect]]
            sound = self._sound[smaller] if defect in fitting else sound
        if isinstance(sound, str):
            return Outcome(self.engine, defect, None, reason=sound)
        world, compiled, probes = sound
        plant = defects_of(compiled.dialect)[defect]
        if isinstance(plant, str):
            return Outcome(self.engine, defect, None, reason=plant)
        with scratch_folder("defect") as place:
            folder = place / self.engine
            write_folder(plant(compiled.files), folder)
            for levels, chosen in zip(self._tries, probes, strict=True):
                certificate = verify(
                    world,
                    [self.engine],
                    compiled={self.engine: compiled},
                    artifacts={self.engine: folder},
                    levels=levels,
                    probes=chosen,
                    pythons=self._pythons,
                    deadline=DEADLINE,
                )
                failures = [check for _, check in certificate.failures()]
                # what could not be compared because the text was refused says nothing of the engine
                beyond_text = [check for check in failures if check.level != "L0" and check.name != NOTHING]
                if beyond_text:
                    break
        levels_that_noticed = tuple(sorted({check.level for check in failures}))
        first = beyond_text[0] if beyond_text else None
        said = f"{first.level} {first.name}: {first.detail or first.worst}" if first else ""
        return Outcome(self.engine, defect, bool(beyond_text), levels_that_noticed, said)
