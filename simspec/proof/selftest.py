"""Does the proof catch anything? One defect at a time is planted into compiled files, in each engine."""

from __future__ import annotations

import functools
import importlib
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from simspec.compiler import Compiled, compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.defects import NAMES, Plant
from simspec.engines.kit.process import side_by_side
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import UnsupportedError
from simspec.files import scratch_folder
from simspec.proof.certificate import Certificate
from simspec.proof.checks import NOTHING
from simspec.proof.selftest_worlds import EVERY, SMALLER
from simspec.proof.verify import LEVELS, Probes, prepare, verify
from simspec.world.types import World

DEADLINE = 400.0
"""Seconds for one defective load, contact probes included: several times what the slowest engine takes for a sound one."""
WORKERS = 2
READ_BACK = LEVELS[:5]
"""Levels at which an engine is asked what it holds, and nothing moves."""
BUT_CONTACT = tuple(level for level in LEVELS if level != "L5")


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
    """The table of defects of a dialect: ``DEFECTS`` of its module, or of the module ``defects`` next to it.

    Raises LookupError when the table leaves out a defect.
    """
    module = importlib.import_module(type(dialects()[dialect]).__module__)
    if not hasattr(module, "DEFECTS"):
        module = importlib.import_module(f"{module.__package__}.defects")
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
    Contact (L5) is measured in it before the first defect that is looked for there. Raises AssertionError where it does not
    verify.
    """
    say = progress or (lambda text: None)
    outcomes: list[Outcome] = []
    with WarmProcesses() as warm:
        for engine in engines:
            bench = _Bench(engine, pythons or {}, every_level, warm)
            names = [name for name in NAMES if defects is None or name in defects]
            for world in dict.fromkeys(NAMES[name] for name in names):
                say(f"{engine}: the sound world “{world}”")
                bench.open(world)
            say(f"{engine}: {len(names)} defects")
            with side_by_side(WORKERS) as pool:
                outcomes.extend(pool.map(bench.plant, names))
    return SelfTest(tuple(outcomes))


class _Sound:
    """A sound world of one engine: compiled, with its probes, and proven to be sound at the levels that it was asked about."""

    def __init__(self, name: str, world: World, compiled: Compiled, prove: Callable[..., Certificate]):
        self.name, self.world, self.compiled = name, world, compiled
        self._prove = prove
        self._precision = find_engine(compiled.engine).PRECISION
        self._probes: dict[tuple[str, ...], Probes] = {}
        self._proven: set[str] = set()
        self._lock = threading.Lock()

    def probes(self, levels: tuple[str, ...]) -> Probes:
        """Those of some levels, at which the world itself verifies. Raises AssertionError where it does not."""
        with self._lock:
            if levels not in self._probes:
                self._probes[levels] = prepare(self.world, levels, self._precision)
            new = tuple(level for level in levels if level not in self._proven)
            if new:
                self._demand(new)
                self._proven.update(levels)
            return self._probes[levels]

    def _demand(self, levels: tuple[str, ...]) -> None:
        engine = self.compiled.engine
        certificate = self._prove(self.world, [engine], compiled={engine: self.compiled}, levels=levels)
        if not certificate.valid:
            _, check = certificate.failures()[0]
            raise AssertionError(
                f"{engine}: the sound world {self.name!r} fails {check.level} {check.name}: {check.detail}"
            )


class _Bench:
    """One engine's sound worlds."""

    def __init__(self, engine: str, pythons: Mapping[str, str], every_level: bool, warm: WarmProcesses):
        self.engine = engine
        self._tries = (LEVELS,) if every_level else (READ_BACK, LEVELS)
        self._sound_at = LEVELS if every_level else BUT_CONTACT
        self._prove = functools.partial(verify, pythons=pythons, deadline=DEADLINE, warm=warm)
        self._sound: dict[str, _Sound | str] = {}

    def open(self, name: str) -> None:
        world = EVERY[name](self.engine)
        try:
            compiled = compile_world(world, [self.engine])[self.engine]
        except UnsupportedError as error:
            self._sound[name] = error.problems[0].message
            if name in SMALLER:
                self.open(SMALLER[name][0])
            return
        sound = self._sound[name] = _Sound(name, world, compiled, self._prove)
        sound.probes(self._sound_at)

    def plant(self, defect: str) -> Outcome:
        name = NAMES[defect]
        sound = self._sound[name]
        while isinstance(self._sound[name], str) and name in SMALLER:
            name, fitting = SMALLER[name]
            if defect in fitting and not isinstance(self._sound[name], str):
                sound = self._sound[name]
        if isinstance(sound, str):
            return Outcome(self.engine, defect, None, reason=sound)
        plant = defects_of(sound.compiled.dialect)[defect]
        if isinstance(plant, str):
            return Outcome(self.engine, defect, None, reason=plant)
        with scratch_folder("defect") as place:
            folder = place / self.engine
            write_folder(plant(sound.compiled.files), folder)
            for levels in self._tries:
                certificate = self._prove(
                    sound.world,
                    [self.engine],
                    compiled={self.engine: sound.compiled},
                    artifacts={self.engine: folder},
                    levels=levels,
                    probes=sound.probes(levels),
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
