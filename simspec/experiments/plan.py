"""The plan of a sweep: which runs it requests, in the order in which they are taken. Nothing is resolved for it, and cells are
made while one goes through them, so that a plan of a million runs takes seconds and little memory.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

from simspec.engines.kit.registry import engine_name, find_engine
from simspec.errors import EngineError, Problem, SpecError
from simspec.files import NotReadableError, read_bytes
from simspec.language.load import Spec
from simspec.language.overrides import Override
from simspec.language.sources import Source
from simspec.language.sweep import MOST_CELLS, ROUND_UP, Sweep, combinations
from simspec.language.sweep_values import DIGITS, Distribution, amount_of
from simspec.option_checks import check_at_timestep

if TYPE_CHECKING:
    from hashlib import _Hash as Hash


# The request of a cell of a sweep, hashed: a spec's data and the files that it uses, the values put in, the engine, versions.
#
# It is cheap, since nothing is resolved for it; so values that are written otherwise and mean the same (``1 ms``, 0.001) have
# different keys, and are recognised as one only by the key of the case (:meth:`simspec.runner.run.Case.key`). It is never equal
# for what could run differently. Left out is what no run depends on: the name, the description, what is expected, what a table
# shows, what the spec says to other engines, and the sweep.

KEY_SCHEMA = 1
"""Version of what a key is made of."""
LEFT_OUT = ("name", "description", "expect", "sweep")
"""Parts of a file that no run depends on."""
LARGEST_TABLE = 64_000_000
"""Bytes of a table of a trajectory that is hashed; larger ones are refused where they are read."""


class Requests:
    """The hashed parts of a spec, for engines of these ``names``. Files are read once, when they are first hashed."""

    def __init__(self, spec: Spec, names: Sequence[str]):
        self._spec, self._names = spec, tuple(names)
        self._files = _digest_of_files(spec.source, {})

    def base(self, label: str, name: str, versions: Mapping[str, str]) -> Hash:
        """The state of the hash with all that the cells of the engine of a label (of this name) have in common."""
        data = _without(self._spec.source.document.data, ("engines",))
        data["engines"] = self._spec.source.document.data.get("engines", {}).get(name, {})
        common = [KEY_SCHEMA, data, self._files.hex(), label, sorted(versions.items())]
        return hashlib.sha256(digest(common))

    def digests(self, overrides: Sequence[tuple[str, Any]]) -> dict[str, tuple[bytes, ...]]:
        """A digest of each value that is put in and that runs of an engine may depend on, by the engine's name."""
        digests = [(path.split("."), self._digest(path, value)) for path, value in overrides]
        return {name: tuple(entry for steps, entry in digests if _concerns(steps, name)) for name in self._names}

    def _digest(self, path: str, value: Any) -> bytes:
        steps = path.split(".")
        if steps[0] in ("models", "model", "trajectory") and (
            steps[-1] in ("use", "file") or isinstance(value, Mapping)
        ):
            source, problems = self._spec.sources_with([Override(path, value, None, None)])
            # a file that is not there is a problem of the runs that ask for it
            files = _digest_of_files(source, {}).hex() if not problems else list(map(str, problems))
            return digest([path, value, files])
        return digest([path, value])


def key_of(base: Hash, digests: Iterable[bytes]) -> Hash:
    """The state of the hash with values put in, in whatever order: no value is put in at a place inside another one."""
    hashed = base.copy()
    hashed.update(b"".join(sorted(digests)))
    hashed.update(b"|")
    return hashed


def _concerns(steps: Sequence[str], engine: str) -> bool:
    """Whether runs of an engine may depend on the value at a path."""
    if steps[0] in LEFT_OUT or steps[:2] == ["record", "show"]:
        return False
    return steps[0] != "engines" or len(steps) == 1 or steps[1] == engine


def _without(data: Mapping[str, Any], more: Sequence[str] = ()) -> dict[str, Any]:
    """A file's data without what no run depends on."""
    kept = {key: value for key, value in data.items() if key not in LEFT_OUT and key not in more}
    if isinstance(kept.get("record"), Mapping):
        kept["record"] = {key: value for key, value in kept["record"].items() if key != "show"}
    return kept


def _digest_of_files(source: Source, known: dict[int, bytes]) -> bytes:
    """A digest of the contents of all files that a file uses, and that they use."""
    parts: list[Any] = []
    for text, used in sorted(source.uses.items()):
        if id(used) not in known:
            known[id(used)] = digest([_without(used.document.data), _digest_of_files(used, known).hex()])
        parts.append([text, known[id(used)].hex()])
    if source.table is not None:
        parts.append(["table", _digest_of_table(source, source.table)])
    return digest(parts)


def _digest_of_table(source: Source, table: Path) -> str:
    try:
        return hashlib.sha256(read_bytes(table, LARGEST_TABLE, links=True)).hexdigest()
    except (NotReadableError, OSError) as error:
        place = ("trajectory", "file")
        raise SpecError(
            [source.document.problem(place, f"cannot be read: {error}", found=table.name, code="S708")]
        ) from None


def digest(value: Any) -> bytes:
    """SHA-256 of plain data, in the order that they are written in: that of bodies is the world's."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"), default=_plain)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest()


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy, in specs that are made in Python. Raises TypeError for what is no data."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not plain data")


OverrideList = tuple[tuple[str, Any], ...]
"""Dotted paths and the plain values that are put at them, in the order in which they are."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A run that a sweep requests; nothing is resolved yet.

    index      its place in the plan
    engine     label of the engine
    case       named case of the sweep, None for the scenario without one
    overrides  (dotted path, plain value), in the order in which they are put in: case, over, together, samples
    sample     number of its sample from 0, None where the sweep has no samples
    repeat     number of the repetition from 0
    perturb    largest relative change of the initial state, 0.0 for none (:class:`simspec.runner.run.Case`)
    seed       seed of the perturbation, None for none
    key        SHA-256 of the request: see :mod:`simspec.experiments.plan`
    """

    index: int
    engine: str
    case: str | None
    overrides: OverrideList
    sample: int | None
    repeat: int
    perturb: float
    seed: int | None
    key: str


@dataclass(frozen=True, slots=True)
class _Choice:
    """One value of an axis: a case's name, its values, and their digests by the engine's name; values for another engine alone
    have none."""

    case: str | None
    overrides: OverrideList
    digests: Mapping[str, tuple[bytes, ...]]


class Plan:
    """Every run of a sweep, with a length that is known without going through them.

    ``spec``: the scenario with its sweep; one without ``sweep`` is run once in each engine. ``engines``: labels, in the order
    in which they take turns. ``versions``: by label, what is at work, as :meth:`simspec.runner.run.Case.key` takes it.
    ``sweep``: in place of the spec's own.

    The order: samples, cases, the grid of ``over``, ``together``, perturbations, repetitions, and engines innermost
    (A B C A B C), so that what disturbs a machine for a while disturbs all engines alike.
    """

    def __init__(
        self,
        spec: Spec,
        engines: Sequence[str],
        versions: Mapping[str, Mapping[str, str]],
        sweep: Sweep | None = None,
    ):
        self.spec, self.engines, self.versions = spec, tuple(engines), versions
        self.sweep = sweep or spec.data.sweep or Sweep()
        self._names = tuple(dict.fromkeys(map(engine_name, self.engines)))
        self._requests = Requests(spec, self._names)

    def __repr__(self) -> str:
        return f"<Plan of {self.spec.name!r}: {len(self):,} runs in {', '.join(self.engines)}>"

    def __len__(self) -> int:
        return self.worlds * self.members * self.sweep.repeat * len(self.engines)

    @property
    def samples(self) -> int:
        """How many samples are drawn; 0 where the sweep has none."""
        return 0 if self.sweep.samples is None else self.sweep.samples.count

    @property
    def members(self) -> int:
        """How many initial states each world is run from: its own and the perturbed ones."""
        return 1 if self.sweep.perturb is None else 1 + self.sweep.perturb.seeds

    @property
    def worlds(self) -> int:
        """How many different sets of values are put in; some may make equal worlds."""
        return combinations(self.sweep) * (self.samples or 1)

    @property
    def measure(self) -> str:
        """``physics`` or ``speed``."""
        return self.sweep.measure

    def describe(self) -> dict[str, Any]:
        """Contents of the plan, as plain data: counts, engines, axes."""
        sweep = self.sweep
        return {
            "spec": self.spec.name,
            "runs": len(self),
            "worlds": self.worlds,
            "engines": list(self.engines),
            "cases": [*([] if sweep.only_cases else [None]), *sweep.cases],
            "over": {path: len(values) for path, values in sweep.over.items()},
            "together": [{path: len(values) for path, values in entry.items()} for entry in sweep.together],
            "samples": self.samples,
            "perturbed": self.members - 1,
            "repeat": sweep.repeat,
            "measure": sweep.measure,
            "times": sweep.times,
        }

    def __iter__(self) -> Iterator[Cell]:
        index = 0
        names = [(label, engine_name(label)) for label in self.engines]
        bases = [(label, name, self._requests.base(label, name, self.versions[label])) for label, name in names]
        axes = self._axes()
        for sample, drawn in self._samples():
            for choices in itertools.product(*axes):
                case = choices[0].case
                overrides = tuple(itertools.chain.from_iterable(choice.overrides for choice in (*choices, drawn)))
                begun = [
                    (label, key_of(base, (part for choice in (*choices, drawn) for part in choice.digests[name])))
                    for label, name, base in bases
                ]
                for perturb, seed, repeat, tail in self._tails():
                    for label, hashed in begun:
                        whole = hashed.copy()
                        whole.update(tail)
                        yield Cell(index, label, case, overrides, sample, repeat, perturb, seed, whole.hexdigest())
                        index += 1

    def _tails(self) -> Iterator[tuple[float, int | None, int, bytes]]:
        """Perturbation, seed, repetition, and what of them is hashed; and that the run is timed, where it is: a run that was
        done while others ran is no answer to what it costs. So is that times are rounded: without, some cells are errors."""
        words = (" speed" if self.measure == "speed" else "") + (" round_up" if self.sweep.times == ROUND_UP else "")
        perturb = self.sweep.perturb
        seeds: Iterable[int] = () if perturb is None else range(1, perturb.seeds + 1)
        moved = ((perturb.amount, seed) for seed in seeds) if perturb is not None else ()
        for amount, seed in itertools.chain(((0.0, None),), moved):
            for repeat in range(self.sweep.repeat):
                yield amount, seed, repeat, f"{amount!r} {seed} {repeat}{words}".encode()

    def _choice(self, case: str | None, overrides: OverrideList) -> _Choice:
        return _Choice(case, overrides, self._requests.digests(overrides))

    def _axes(self) -> list[list[_Choice]]:
        """Cases, then each path of the grid, then each entry of ``together``: all their values."""
        sweep = self.sweep
        cases = [] if sweep.only_cases else [self._choice(None, ())]
        cases += [self._choice(name, tuple(values.items())) for name, values in sweep.cases.items()]
        grid = [[self._choice(None, ((path, value),)) for value in values] for path, values in sweep.over.items()]
        rows = [
            [self._choice(None, tuple(zip(entry, row, strict=True))) for row in zip(*entry.values(), strict=True)]
            for entry in sweep.together
        ]
        return [cases, *grid, *rows]

    def _samples(self) -> Iterator[tuple[int | None, _Choice]]:
        """The number of each sample, with what is drawn for it; once, with nothing, where there are no samples."""
        given = self.sweep.samples
        if given is None:
            yield None, self._choice(None, ())
            return
        streams = {
            path: _stream(distribution, random.Random(f"simspec sweep {given.seed} {path}"))
            for path, distribution in given.values.items()
        }
        for index in range(given.count):
            yield index, self._choice(None, tuple((path, next(stream)) for path, stream in streams.items()))


def plan_sweep(spec: Spec, *, engines: Sequence[str] | None = None, versions: Mapping[str, Mapping[str, str]]) -> Plan:
    """The plan of a spec's sweep.

    ``engines``: labels, instead of those of the sweep; needed where it names none. ``versions``: by label, what is at work
    (simspec, the engine, numpy, …), by name. Raises SpecError for engines that are not known (at the place where the sweep
    names them), for none, and for too many runs; ValueError for an engine whose versions are not given.
    """
    named = spec.data.sweep.engines if spec.data.sweep is not None else None
    labels = list(dict.fromkeys(engines if engines is not None else named or ()))
    problems = []
    for index, label in enumerate(labels):
        try:
            find_engine(label)
        except EngineError as error:
            path = f"sweep.engines.{index}" if engines is None else ""
            problems.append(Problem(str(error), path, spec.locate(path) if path else None, found=label, code="S804"))
    if not labels:
        hint = "sweep: {engines: [...]}, or --engine NAME"
        problems.append(Problem("the sweep names no engine", "sweep", spec.locate("sweep"), hint=hint, code="S804"))
    if problems := [*problems, *check_at_timestep(spec)]:
        raise SpecError(problems)
    if missing := [label for label in labels if label not in versions]:
        raise ValueError(f"no versions given of {', '.join(missing)}")
    plan = Plan(spec, labels, {label: dict(versions[label]) for label in labels})
    if len(plan) > MOST_CELLS:
        message, found = "too many runs in one sweep", f"{len(plan):,}, {len(plan) // len(labels):,} in each engine"
        raise SpecError([Problem(message, "sweep", spec.locate("sweep"), found, f"up to {MOST_CELLS:,}", code="S805")])
    return plan


SMALLEST_SHARE = 2.0**-54
"""Stands for a random number of exactly 0, of which the normal distribution has no value."""


def _stream(distribution: Distribution, generator: random.Random) -> Iterator[Any]:
    """The values that a distribution draws; one number of the generator for each."""
    if distribution.choice is not None:
        choices = distribution.choice
        while True:
            yield choices[int(generator.random() * len(choices))]
    worked_out = _quantile(distribution)
    while True:
        yield worked_out(max(generator.random(), SMALLEST_SHARE))


def _quantile(distribution: Distribution) -> Any:
    """From a share of (0, 1) to the value below which that share of a distribution lies."""
    kind = next(name for name in ("uniform", "normal", "log_uniform") if getattr(distribution, name) is not None)
    first, second = map(amount_of, getattr(distribution, kind))
    unit = f" {first.unit}" if first.unit else None
    low, high = float(first.number), float(second.number)
    if kind == "normal":
        inverse = NormalDist(low, high).inv_cdf
        return lambda share: _said(inverse(share), unit)
    if kind == "uniform":
        return lambda share: _said(low + (high - low) * share, unit)
    ratio = math.log(high) - math.log(low)
    return lambda share: _said(low * math.exp(ratio * share), unit)


def _said(value: float, unit: str | None) -> float | str:
    """A number that was worked out, as a spec would say it, with as many digits as all machines agree on."""
    number = float(f"{value:.{DIGITS}g}")
    return number if unit is None else f"{number!r}{unit}"
