"""What matters of a study, in a few sentences: the order of the engines with equal models, what unequal models change, and up
to which timestep each scenario holds and is proven. Everything else that its tables say stands under them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from simspec.errors import Problem, SpecError, visible
from simspec.report.page.words import BAD, GOOD, PLAIN, WARNING, Sentence, listed
from simspec.report.study.done import Record, milliseconds
from simspec.report.study.sentences import by_timestep, intervals_of, limits
from simspec.report.study.unequal import ranking
from simspec.stored import StoredTableShown, StudyTables

CLOCKS = {"by wall time": "speed.real_time_factor", "by processor time": "speed.cpu_factor"}
UNEQUAL = "unequal.models."
Tables = Mapping[str, Sequence[Record]]
"""Of one sweep: the records of its tables, by name."""


def verdict(tables: StudyTables) -> list[Sentence]:
    """How it was done in one sentence, what is wrong, and what matters. Raises SpecError where figures are damaged."""
    bad = [line for number, line in enumerate(tables.said) if number in tables.bad]
    count = f"{len(tables.sweeps)} sweep{'' if len(tables.sweeps) == 1 else 's'}"
    sentences = [Sentence(BAD if bad else GOOD, f"{count}, and something is wrong." if bad else f"{count}, all done.")]
    sentences += [Sentence(BAD, line) for line in bad]
    sweeps = {name: _records(own) for name, own in tables.sweeps.items()}
    for part in (_speed, _unequal, _limits):
        for name, own in sweeps.items():
            try:
                sentences += part(name, own)
            except (KeyError, TypeError, ValueError) as error:
                raise SpecError(
                    [Problem(f"the figures of {visible(name)} are damaged: {type(error).__name__}: {error}")]
                ) from None
    return [Sentence(one.tone, visible(one.text)) for one in sentences]


def _records(own: Sequence[StoredTableShown]) -> Tables:
    return {shown.name: [one for one in shown.records if not one.get("elsewhere")] for shown in own}


def _ends(figures: Mapping[float, Mapping[str, float]]) -> list[float]:
    """The smallest and the largest timestep that has figures of all engines."""
    engines = max((len(own) for own in figures.values()), default=0)
    whole = [timestep for timestep in sorted(figures) if len(figures[timestep]) == engines > 1]
    return list(dict.fromkeys((whole[0], whole[-1]))) if whole else []


def _order(factors: Mapping[str, float]) -> list[str]:
    return sorted(factors, key=lambda engine: -factors[engine])


def _speed(name: str, own: Tables) -> Iterator[Sentence]:
    """The order of the engines. Where processor time gives the same as wall time, that is said once."""
    by_clock = {word: by_timestep(own[table], "median") for word, table in CLOCKS.items() if table in own}
    for word, figures in by_clock.items():
        others = [other for earlier, other in by_clock.items() if earlier != word]
        ends = _ends(figures)
        same = all(_same_order(figures, other, ends) for other in others)
        if not ends or (same and word != next(iter(by_clock))):
            continue
        clock = "by wall time and by processor time" if others and same else word
        known = intervals_of(own[CLOCKS[word]])
        orders = [(timestep, ranking(figures[timestep], known.get(timestep))) for timestep in ends]
        told = "; ".join(f"at {milliseconds(timestep)} {order}" for timestep, order in orders)
        yield Sentence(PLAIN, f"{name}, equal models, {clock}: {told}.")


def _same_order(
    first: Mapping[float, Mapping[str, float]], second: Mapping[float, Mapping[str, float]], steps: Sequence[float]
) -> bool:
    return all(timestep in second and _order(first[timestep]) == _order(second[timestep]) for timestep in steps)


def _unequal(name: str, own: Tables) -> Iterator[Sentence]:
    """What models that are not equal change: which comparisons change the order, and which leave it as it is."""
    equal = by_timestep(own.get("unequal.equal", ()), "cpu_factor")
    ends = _ends(equal)
    if not ends:
        return
    timestep = ends[0]
    turned: list[str] = []
    kept: list[str] = []
    for table, records in own.items():
        factors = by_timestep(records, "cpu_factor").get(timestep, {}) if table.startswith(UNEQUAL) else {}
        if len(factors) == len(equal[timestep]):
            told = f"{table.removeprefix(UNEQUAL)} ({ranking(factors)})"
            (kept if _order(factors) == _order(equal[timestep]) else turned).append(told)
    beside = f"{name}, at {milliseconds(timestep)}: with equal models {ranking(equal[timestep])}"
    if turned:
        more = f" The order stays with {listed(kept)}." if kept else ""
        text = f"{beside}. Models that are NOT EQUAL change the order: {listed(turned)}.{more}"
        yield Sentence(WARNING, text)
    elif kept:
        yield Sentence(WARNING, f"{beside}. Models that are NOT EQUAL leave the order as it is: {listed(kept)}.")


def _limits(name: str, own: Tables) -> Iterator[Sentence]:
    """Up to which timestep a scenario holds and its models are proven."""
    held = [f"{engines}: {told}" for engines, told in limits(own.get("validity", ()))]
    if not held:
        return
    limit_of: dict[str, list[str]] = {}
    for one in own.get("certified", ()):
        limit_of.setdefault(_certified(one, own.get("certified.checks", ())), []).append(str(one["engine"]))
    certified = "; ".join(f"{listed(engines)} {limit}" for limit, engines in limit_of.items())
    yield Sentence(PLAIN, f"{name}: {'; '.join(held)}." + (f" Certified: {certified}." if certified else ""))


def _certified(one: Record, checks: Sequence[Record]) -> str:
    """Up to which timestep an engine's models are proven."""
    if one["limit"] is not None:
        return f"up to {'at least ' if one['first_invalid'] is None else ''}{milliseconds(one['limit'])}"
    verified = any(check["proven"] is not None for check in checks if check["engine"] == one["engine"])
    return "at no timestep" if verified else "not verified"
