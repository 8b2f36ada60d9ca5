"""The plots of a study, from the figures that its tables carry (``records``): nothing is read but ``study.json``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from simspec.errors import Problem, SpecError, visible
from simspec.stored import StoredTableShown, StudyTables

Record = Mapping[str, Any]
MILLI = 1e3
ENGINE_COLOURS = 8
"""Colours of the page's palette (``page/src/palette.ts``)."""
TIMESTEP = {"label": "timestep", "unit": "ms", "logarithmic": True}
TIME = {"label": "time", "unit": "s", "logarithmic": False}
QUANTITIES = {
    "real_time_factor": "Simulated time over the wall time of the steps",
    "cpu_factor": "Simulated time over the processor time of the steps",
    "process_load": "Load of the processor by the whole process",
}
"""Quantities over the timestep that have a plot, by their names in records."""
LOGARITHMIC = ("real_time_factor", "cpu_factor")
AS_PUBLISHED = "as-published"


@dataclass
class Colours:
    """Colours by name: an engine's figures from elsewhere have the colour of the engine of that name."""

    known: dict[str, int] = field(default_factory=dict)

    def of(self, name: str) -> int:
        """The number of a name's colour."""
        return self.known.setdefault(name.casefold(), len(self.known) % ENGINE_COLOURS)


def charts(tables: StudyTables) -> list[dict[str, Any]]:
    """The plots of all sweeps, as ``page/src/data.ts`` declares them (``Chart``)."""
    colours = Colours()
    for showns in tables.sweeps.values():  # engines of the study first, so that they have the colours of its playback
        for shown in showns:
            for record in shown.records:
                if not record.get("elsewhere") and isinstance(record.get("engine"), str):
                    colours.of(record["engine"])
    made = []
    for sweep, showns in tables.sweeps.items():
        for shown in showns:
            maker = next((chart for word, chart in _CHARTS.items() if f"{shown.name}.".startswith(f"{word}.")), None)
            try:
                made += (
                    [{**chart, "title": visible(chart["title"])} for chart in maker(sweep, shown, colours)]
                    if maker
                    else []
                )
            except (KeyError, TypeError, ValueError, IndexError) as error:
                message = (
                    f"the figures of {sweep}, {shown.name}, are not those of simspec: {type(error).__name__} {error}"
                )
                raise SpecError([Problem(message, hint="simspec study STUDY writes them anew")]) from None
    return [chart for chart in made if any(series["marks"] for series in chart["series"])]


def _chart(
    title: str, unit: str, x: Mapping[str, Any], series: Iterable[Mapping[str, Any]], **more: Any
) -> dict[str, Any]:
    chart = {"title": title, "unit": unit, "group": x["label"], "x": dict(x), "logarithmic": False, "limits": []}
    return chart | {"series": [dict(entry) for entry in series]} | more


def _series(
    label: str, colour: int, marks: Sequence[Mapping[str, Any]], kind: str = "measured", dash: int = 0
) -> dict[str, Any]:
    return {"label": visible(label), "colour": colour, "dash": dash, "kind": kind, "marks": list(marks)}


def _mark(x: float, value: float, low: Any = None, high: Any = None, values: Sequence[float] = ()) -> dict[str, Any]:
    whole = low is not None and high is not None
    given: dict[str, Any] = {"x": float(x), "value": float(value), "low": None, "high": None}
    if whole:
        given |= {"low": float(low), "high": float(high)}
    return {**given, "values": [float(value) for value in values]}


def _engines(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Records of runs by engine."""
    found: dict[str, list[Record]] = {}
    for record in records:
        if not record.get("elsewhere"):
            found.setdefault(str(record["engine"]), []).append(record)
    return found


def _elsewhere(records: Iterable[Record], quantity: str) -> dict[str, list[Record]]:
    """Figures from elsewhere of one quantity, by what they are called."""
    found: dict[str, list[Record]] = {}
    for record in records:
        if record.get("elsewhere") and record.get("quantity") == quantity:
            models = "" if record["models"] == AS_PUBLISHED else f", {record['models']}"
            found.setdefault(f"{record['engine']} (elsewhere{models})", []).append(record)
    return found


def _over_timestep(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
    """Medians with the interval of the mean and the single values, beside figures from elsewhere."""
    for quantity, title in QUANTITIES.items():
        series = []
        for index, (engine, local) in enumerate(_engines(shown.records).items()):
            marks = [
                _mark(MILLI * entry["timestep"], entry["median"], entry["lower"], entry["upper"], entry["values"])
                for entry in local
                if entry["quantity"] == quantity
            ]
            series.append(_series(engine, colours.of(engine), marks, dash=index))
        for label, local in _elsewhere(shown.records, quantity).items():
            marks = [
                _mark(MILLI * entry["timestep"], entry["value"]) for entry in local if entry["timestep"] is not None
            ]
            series.append(_series(label, colours.of(str(local[0]["engine"])), marks, "elsewhere"))
        if any(entry["marks"] for entry in series if entry["kind"] == "measured"):
            yield _chart(f"{sweep}: {title}", "", TIMESTEP, series, logarithmic=quantity in LOGARITHMIC)


def _validity(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
    """The share of valid runs with its interval; the limits of figures from elsewhere as vertical lines."""
    series = []
    for index, (engine, values) in enumerate(_engines(shown.records).items()):
        shares = [entry for entry in values if "share" in entry]
        marks = [_mark(MILLI * share["timestep"], share["share"], share["lower"], share["upper"]) for share in shares]
        series.append(_series(engine, colours.of(engine), marks, dash=index))
    limits = [
        {
            "label": visible(f"{label}: {MILLI * entry['value']:g} ms"),
            "x": MILLI * entry["value"],
            "colour": colours.of(str(entry["engine"])),
            "elsewhere": True,
        }
        for label, local in _elsewhere(shown.records, "largest_valid_timestep").items()
        for entry in local
    ]
    yield _chart(f"{sweep}: Share of runs that do all that is expected", "", TIMESTEP, series, limits=limits)


def _over_time(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
    """Speed and contacts of each interval of simulated time, as steps."""
    timesteps = sorted({record["timestep"] for record in shown.records})
    about = f", timestep {MILLI * timesteps[0]:g} ms" if len(timesteps) == 1 else ""
    for quantity, title, logarithmic in (
        ("cpu_factor", "Simulated time over processor time of the steps", True),
        ("contacts", "Points of contact, mean", False),
    ):
        series = []
        for index, (engine, local) in enumerate(_engines(shown.records).items()):
            known = [
                entry for entry in local if entry[quantity] is not None and (entry[quantity] > 0.0 or not logarithmic)
            ]
            marks = [_mark(entry["begin"], entry[quantity]) for entry in known]
            marks += [_mark(known[-1]["end"], known[-1][quantity])] if known else []
            series.append(_series(engine, colours.of(engine), marks, "steps", index))
        yield _chart(f"{sweep}: {title}{about}", "", TIME, series, logarithmic=logarithmic)


def _unequal(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
    """Speed of engines whose models are equal, or are not."""
    which = (
        "equal models" if shown.name == "unequal.equal" else f"NOT EQUAL: {shown.name.removeprefix('unequal.models.')}"
    )
    series = []
    for index, (engine, local) in enumerate(_engines(shown.records).items()):
        marks = [
            _mark(MILLI * entry["timestep"], entry["cpu_factor"])
            for entry in local
            if entry.get("cpu_factor") is not None
        ]
        series.append(_series(engine, colours.of(engine), marks, dash=index))
    title = f"{sweep}: Simulated time over processor time of the steps, {which}"
    yield _chart(title, "", TIMESTEP, series, logarithmic=True)


_CHARTS: Mapping[str, Callable[[str, StoredTableShown, Colours], Iterator[dict[str, Any]]]] = {
    "speed": _over_timestep,
    "load": _over_timestep,
    "validity": _validity,
    "over_time": _over_time,
    "unequal.equal": _unequal,
    "unequal.models": _unequal,
}
"""What makes the plots of a table, by the beginning of its name."""
