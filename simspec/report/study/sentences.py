"""What the tables of a study say, in sentences that are computed from their figures (``records``)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from simspec.report.kit import number
from simspec.report.study.done import Record, Shown, milliseconds
from simspec.report.study.unequal import ranking

AS_PUBLISHED = "as-published"


def said_of(name: str, records: Iterable[Record]) -> tuple[str, ...]:
    """The sentences of a table of this name."""
    maker = next((one for word, one in _SAID.items() if f"{name}.".startswith(f"{word}.")), None)
    return tuple(maker(name, list(records))) if maker is not None else ()


def with_sentences(shown: Shown) -> Shown:
    """The same with its sentences, where it has none of its own."""
    return shown if shown.said else Shown(shown.name, shown.table, shown.records, said_of(shown.name, shown.records))


def _by_timestep(records: Iterable[Record], value: str) -> dict[float, dict[str, float]]:
    """A figure by timestep and engine."""
    found: dict[float, dict[str, float]] = {}
    for one in records:
        if one.get(value) is not None and one.get("timestep") is not None:
            found.setdefault(one["timestep"], {})[str(one["engine"])] = one[value]
    return found


def _order(figures: Mapping[float, Mapping[str, float]], most: int = 2) -> Iterator[tuple[float, str]]:
    """The order of the engines at the smallest and the largest timestep that has a figure of all of them."""
    engines = max((len(own) for own in figures.values()), default=0)
    whole = [timestep for timestep in sorted(figures) if len(figures[timestep]) == engines]
    for timestep in dict.fromkeys([whole[0], whole[-1]][:most] if whole else []):
        own = figures[timestep]
        fastest = max(own, key=lambda engine: own[engine])
        yield timestep, f"{ranking(own)} (fastest: {number(own[fastest])} × real time)"


def _speed(name: str, records: list[Record]) -> Iterator[str]:
    """The order of the engines, and that of figures from elsewhere at the same timesteps."""
    quantity = name.rpartition(".")[2]
    over = {"cpu_factor": "by processor time", "real_time_factor": "by wall time"}[quantity]
    known = [one for one in records if not one.get("elsewhere")]
    others = [one for one in records if one.get("elsewhere") and one.get("models") == AS_PUBLISHED]
    elsewhere = _by_timestep(others, "value")
    for timestep, order in _order(_by_timestep(known, "median")):
        text = f"At {milliseconds(timestep)}, {over}: {order}."
        if len(elsewhere.get(timestep, ())) > 1:
            text += f" Elsewhere: {ranking(elsewhere[timestep])}."
        yield text


def _validity(name: str, records: list[Record]) -> Iterator[str]:
    for one in records:
        if "limit" not in one:
            continue
        if one["limit"] is None:
            yield f"{one['engine']}: not valid at any timestep; {one['failure']}."
            continue
        shares = {
            other["timestep"]: other for other in records if other.get("engine") == one["engine"] and "share" in other
        }
        share = shares[one["limit"]]
        at_least = "at least " if one["first_invalid"] is None else ""
        runs = f"{share['runs']} of {share['runs']} runs, a share of at least {share['lower']:.2f}"
        end = f"; {one['failure']}" if one["failure"] else ""
        yield f"{one['engine']}: all that is expected holds up to {at_least}{milliseconds(one['limit'])} ({runs}){end}."


def _over_time(name: str, records: list[Record]) -> Iterator[str]:
    engines: dict[str, list[Record]] = {}
    for one in records:
        if one.get("cpu_factor") is not None:
            engines.setdefault(str(one["engine"]), []).append(one)
    for engine, own in engines.items():
        ends = [min(own, key=lambda one: one["cpu_factor"]), max(own, key=lambda one: one["cpu_factor"])]
        told = [
            f"{number(one['cpu_factor'])} × real time at {one['begin']:g} to {one['end']:g} s"
            + (f", with {one['contacts']:.0f} points of contact" if one.get("contacts") is not None else "")
            for one in ends
        ]
        yield f"{engine}: slowest {told[0]}; fastest {told[1]}."


def _unequal(name: str, records: list[Record]) -> Iterator[str]:
    which = (
        "Equal models"
        if name == "unequal.equal"
        else f"{name.removeprefix('unequal.models.')}, models that are NOT EQUAL"
    )
    for timestep, order in _order(_by_timestep(records, "cpu_factor"), 1):
        yield f"{which}, at {milliseconds(timestep)} by processor time: {order}."


_SAID: Mapping[str, Callable[[str, list[Any]], Iterator[str]]] = {
    "speed": _speed,
    "validity": _validity,
    "over_time": _over_time,
    "unequal.equal": _unequal,
    "unequal.models": _unequal,
}
"""By the beginning of a table's name."""
