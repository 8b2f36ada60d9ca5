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
                made += list(maker(sweep, shown, colours)) if maker else []
            except (KeyError, TypeError, ValueError, IndexError) as error:
                why = f"{type(error).__name__} {error}"
                message = f"the figures of {sweep}, {shown.name}, are not those of simspec: {why}"
                raise SpecError([Problem(message, hint="simspec study STUDY writes them anew")]) from None
    return [chart for chart in made if any(series["marks"] for series in chart["series"])]


def _chart(title: str, x: Mapping[str, Any], series: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    chart = {"title": visible(title), "unit": "", "group": x["label"], "x": dict(x), "logarithmic": False, "limits": []}
    return chart | {"series": series} | more


def _mark(x: float, value: float, low: Any = None, high: Any = None, values: Sequence[float] = ()) -> dict[str, Any]:
    ends = (None, None) if low is None or high is None else (float(low), float(high))
    return {"x": float(x), "value": float(value), "low": ends[0], "high": ends[1], "values": list(map(float, values))}


def _of_engines(
    shown: StoredTableShown,
    colours: Colours,
    marks: Callable[[list[Record]], list[dict[str, Any]]],
    kind: str = "measured",
) -> list[dict[str, Any]]:
    """A series for each engine of the study; ``marks``: those of its records."""
    found: dict[str, list[Record]] = {}
    for record in shown.records:
        if not record.get("elsewhere"):
            found.setdefault(str(record["engine"]), []).append(record)
    return [
        {"label": visible(name), "colour": colours.of(name), "dash": dash, "kind": kind, "marks": marks(records)}
        for dash, (name, records) in enumerate(found.items())
    ]


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

        def marks(records: list[Record], quantity: str = quantity) -> list[dict[str, Any]]:
            return [
                _mark(MILLI * entry["timestep"], entry["median"], entry["lower"], entry["upper"], entry["values"])
                for entry in records
                if entry["quantity"] == quantity
            ]

        series = _of_engines(shown, colours, marks)
        measured = any(entry["marks"] for entry in series)
        for label, local in _elsewhere(shown.records, quantity).items():
            points = [_mark(MILLI * item["timestep"], item["value"]) for item in local if item["timestep"] is not None]
            colour = colours.of(str(local[0]["engine"]))
            series.append({"label": visible(label), "colour": colour, "dash": 0, "kind": "elsewhere", "marks": points})
        if measured:
            yield _chart(f"{sweep}: {title}", TIMESTEP, series, logarithmic=quantity in LOGARITHMIC)


def _validity(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
    """The share of valid runs with its interval; the limits of figures from elsewhere as vertical lines."""
    series = _of_engines(
        shown,
        colours,
        lambda records: [
            _mark(MILLI * entry["timestep"], entry["share"], entry["lower"], entry["upper"])
            for entry in records
            if "share" in entry
        ],
    )
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
    yield _chart(f"{sweep}: Share of runs that do all that is expected", TIMESTEP, series, limits=limits)


def _over_time(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
    """Speed and contacts of each interval of simulated time, as steps."""
    timesteps = sorted({record["timestep"] for record in shown.records})
    about = f", timestep {MILLI * timesteps[0]:g} ms" if len(timesteps) == 1 else ""
    for quantity, title, logarithmic in (
        ("cpu_factor", "Simulated time over processor time of the steps", True),
        ("contacts", "Points of contact, mean", False),
    ):

        def marks(records: list[Record], name: str = quantity, positive: bool = logarithmic) -> list[dict[str, Any]]:
            known = [item for item in records if item[name] is not None and (item[name] > 0.0 or not positive)]
            ends = [_mark(item["end"], item[name]) for item in known[-1:]]
            return [*(_mark(item["begin"], item[name]) for item in known), *ends]

        series = _of_engines(shown, colours, marks, "steps")
        yield _chart(f"{sweep}: {title}{about}", TIME, series, logarithmic=logarithmic)


def _unequal(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
    """Speed of engines whose models are equal, or are not."""
    name = shown.name.removeprefix("unequal.models.")
    which = "equal models" if name == "unequal.equal" else f"NOT EQUAL: {name}"
    series = _of_engines(
        shown,
        colours,
        lambda records: [
            _mark(MILLI * entry["timestep"], entry["cpu_factor"])
            for entry in records
            if entry.get("cpu_factor") is not None
        ],
    )
    yield _chart(
        f"{sweep}: Simulated time over processor time of the steps, {which}", TIMESTEP, series, logarithmic=True
    )


_CHARTS: Mapping[str, Callable[[str, StoredTableShown, Colours], Iterator[dict[str, Any]]]] = {
    "speed": _over_timestep,
    "load": _over_timestep,
    "validity": _validity,
    "over_time": _over_time,
    "unequal.equal": _unequal,
    "unequal.models": _unequal,
}
"""What makes the plots of a table, by the beginning of its name."""
