"""Sentences and plots of a study, computed from the records of its tables in ``study.json``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from simspec.analysis.validity import measure_words, measured_name
from simspec.errors import Problem, SpecError, visible
from simspec.report.page.sentences import Sentence
from simspec.report.study.runs import Record, milliseconds
from simspec.report.study.speed import ranking
from simspec.report.table import BAD, GOOD, PLAIN, WARNING, listed, number
from simspec.stored import StoredTableShown, StudyTables

# Plots.

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
                raise SpecError([Problem(message, hint="simspec study STUDY writes them anew", code="R110")]) from None
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
    """Medians with the interval of the mean and the single values, with figures from elsewhere."""
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


def _validity_charts(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
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


def _over_time_charts(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
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


def _unequal_charts(sweep: str, shown: StoredTableShown, colours: Colours) -> Iterator[dict[str, Any]]:
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
    "validity": _validity_charts,
    "over_time": _over_time_charts,
    "unequal.equal": _unequal_charts,
    "unequal.models": _unequal_charts,
}
"""The function that makes the plots of a table, by the beginning of its name."""

# Sentences of tables.


def said_of(name: str, records: Iterable[Record]) -> tuple[str, ...]:
    """The sentences of a table of this name."""
    maker = next((entry for word, entry in _SAID.items() if f"{name}.".startswith(f"{word}.")), None)
    return tuple(maker(name, list(records))) if maker is not None else ()


def by_timestep(records: Iterable[Record], value: str) -> dict[float, dict[str, float]]:
    """A figure by timestep and engine."""
    found: dict[float, dict[str, float]] = {}
    for record in records:
        if record.get(value) is not None and record.get("timestep") is not None:
            found.setdefault(record["timestep"], {})[str(record["engine"])] = record[value]
    return found


def intervals_of(records: Iterable[Record]) -> dict[float, dict[str, tuple[float, float]]]:
    """The intervals of figures by timestep and engine, where there are any."""
    found: dict[float, dict[str, tuple[float, float]]] = {}
    for record in records:
        if record.get("lower") is not None and record.get("upper") is not None and record.get("timestep") is not None:
            found.setdefault(record["timestep"], {})[str(record["engine"])] = (record["lower"], record["upper"])
    return found


def _order(
    figures: Mapping[float, Mapping[str, float]],
    most: int = 2,
    intervals: Mapping[float, Mapping[str, tuple[float, float]]] | None = None,
) -> Iterator[tuple[float, str]]:
    """The order of the engines at the smallest and the largest timestep that has a figure of all of them."""
    engines = max((len(figure) for figure in figures.values()), default=0)
    whole = [timestep for timestep in sorted(figures) if len(figures[timestep]) == engines]
    for timestep in dict.fromkeys([whole[0], whole[-1]][:most] if whole else []):
        figure = figures[timestep]
        fastest = max(figure, key=lambda engine: figure[engine])
        text = ranking(figure, (intervals or {}).get(timestep))
        yield timestep, f"{text} (fastest: {number(figure[fastest])} × real time)"


def _speed(name: str, records: list[Record]) -> Iterator[str]:
    """The order of the engines, and that of figures from elsewhere at the same timesteps."""
    quantity = name.rpartition(".")[2]
    over = {"cpu_factor": "by processor time", "real_time_factor": "by wall time"}[quantity]
    known = [record for record in records if not record.get("elsewhere")]
    others = [record for record in records if record.get("elsewhere") and record.get("models") == AS_PUBLISHED]
    elsewhere = by_timestep(others, "value")
    for timestep, order in _order(by_timestep(known, "median"), intervals=intervals_of(known)):
        text = f"At {milliseconds(timestep)}, {over}: {order}."
        if len(elsewhere.get(timestep, ())) > 1:
            text += f" Elsewhere: {ranking(elsewhere[timestep])}."
        yield text


def _validity_sentences(name: str, records: list[Record]) -> Iterator[str]:
    for engines, text in limits(records):
        yield f"{engines}: {text}."


def limits(records: Iterable[Record]) -> list[tuple[str, str]]:
    """Up to which timestep engines hold, in words; those with the same limit stand together."""
    local = list(records)
    groups: dict[tuple[object, ...], list[Record]] = {}
    shares = {(entry["engine"], entry["timestep"]): entry for entry in local if "share" in entry}
    for item in local:
        if "limit" not in item:
            continue
        runs = [shares.get((item["engine"], item[name])) for name in ("limit", "first_invalid")]
        counts = tuple((share["share"], share["runs"]) if share is not None else None for share in runs)
        what = item["missed"] if item.get("missed") is not None else item["failure"]
        key = (item["limit"], item["first_invalid"], what, item.get("bound"), item.get("unit"), counts)
        groups.setdefault(key, []).append(item)
    return [(listed([str(entry["engine"]) for entry in same]), _limit(same, shares)) for same in groups.values()]


def _limit(same: Sequence[Record], shares: Mapping[tuple[object, object], Record]) -> str:
    """The limit of engines that have the same one."""
    first = same[0]
    each = " each" if len(same) > 1 else ""
    failure = _failure(same, shares.get((first["engine"], first["first_invalid"])), each)
    if first["limit"] is None:
        return f"not valid at any timestep; {failure}"
    runs = shares[first["engine"], first["limit"]]["runs"]
    at_least = "at least " if first["first_invalid"] is None else ""
    text = f"all that is expected holds up to {at_least}{milliseconds(first['limit'])} ({runs} of {runs} runs{each})"
    return f"{text}; {failure}" if failure else text


def _failure(same: Sequence[Record], share: Record | None, each: str) -> str:
    """The first missed expectation, with the smallest and the largest figure of the engines."""
    first = same[0]
    if first.get("missed") is None or share is None:
        return str(first["failure"])
    unit = str(first["unit"])
    figures = sorted(float(entry["measured"]) for entry in same)
    ends = list(dict.fromkeys(measure_words(value, unit) for value in (figures[0], figures[-1])))
    failed = round((1.0 - share["share"]) * share["runs"])
    name, bound = measured_name(first["missed"]), measure_words(first["bound"], unit)
    return (
        f"at {milliseconds(first['first_invalid'])} {failed} of {share['runs']} runs{each} are not valid: "
        f"{name} {' to '.join(ends)}, bound {bound}"
    )


def _over_time_sentences(name: str, records: list[Record]) -> Iterator[str]:
    engines: dict[str, list[Record]] = {}
    for record in records:
        if record.get("cpu_factor") is not None:
            engines.setdefault(str(record["engine"]), []).append(record)
    for engine, local in engines.items():
        ends = [min(local, key=lambda entry: entry["cpu_factor"]), max(local, key=lambda item: item["cpu_factor"])]
        given = [
            f"{number(end['cpu_factor'])} × real time at {end['begin']:g} to {end['end']:g} s"
            + (f", with {end['contacts']:.0f} points of contact" if end.get("contacts") is not None else "")
            for end in ends
        ]
        yield f"{engine}: slowest {given[0]}; fastest {given[1]}."


def _unequal_sentences(name: str, records: list[Record]) -> Iterator[str]:
    which = f"{name.removeprefix(UNEQUAL)}, models that are NOT EQUAL" if name != "unequal.equal" else "Equal models"
    for timestep, order in _order(by_timestep(records, "cpu_factor"), 1):
        yield f"{which}, at {milliseconds(timestep)} by processor time: {order}."


_SAID: Mapping[str, Callable[[str, list[Any]], Iterator[str]]] = {
    "speed": _speed,
    "validity": _validity_sentences,
    "over_time": _over_time_sentences,
    "unequal.equal": _unequal_sentences,
    "unequal.models": _unequal_sentences,
}
"""By the beginning of a table's name."""

# Verdict of a study: the order of the engines with equal models, the effect of unequal models, and the timestep up to
# which each scenario is valid and proven.

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
    sweeps = {
        name: {shown.name: [record for record in shown.records if not record.get("elsewhere")] for shown in sweep}
        for name, sweep in tables.sweeps.items()
    }
    for part in (_speed_verdict, _unequal_verdict, _limits):
        for name, local in sweeps.items():
            try:
                sentences += part(name, local)
            except (KeyError, TypeError, ValueError) as error:
                message = f"the figures of {visible(name)} are damaged: {type(error).__name__}: {error}"
                raise SpecError([Problem(message, code="R106")]) from None
    return [Sentence(sentence.tone, visible(sentence.text)) for sentence in sentences]


def _ends(figures: Mapping[float, Mapping[str, float]]) -> list[float]:
    """The smallest and the largest timestep that has figures of all engines."""
    engines = max((len(figure) for figure in figures.values()), default=0)
    whole = [timestep for timestep in sorted(figures) if len(figures[timestep]) == engines > 1]
    return list(dict.fromkeys((whole[0], whole[-1]))) if whole else []


def _order_verdict(factors: Mapping[str, float]) -> list[str]:
    return sorted(factors, key=lambda engine: -factors[engine])


def _speed_verdict(name: str, tables: Tables) -> Iterator[Sentence]:
    """The order of the engines. Where processor time gives the same as wall time, that is said once."""
    by_clock = {word: by_timestep(tables[table], "median") for word, table in CLOCKS.items() if table in tables}
    for word, figures in by_clock.items():
        others = [other for earlier, other in by_clock.items() if earlier != word]
        ends = _ends(figures)
        same = all(
            step in other and _order_verdict(figures[step]) == _order_verdict(other[step])
            for other in others
            for step in ends
        )
        if not ends or (same and word != next(iter(by_clock))):
            continue
        clock = "by wall time and by processor time" if others and same else word
        known = intervals_of(tables[CLOCKS[word]])
        orders = [(timestep, ranking(figures[timestep], known.get(timestep))) for timestep in ends]
        text = "; ".join(f"at {milliseconds(timestep)} {order}" for timestep, order in orders)
        yield Sentence(PLAIN, f"{name}, equal models, {clock}: {text}.")


def _unequal_verdict(name: str, tables: Tables) -> Iterator[Sentence]:
    """The effect of unequal models: the comparisons that change the order, and those that leave it as it is."""
    equal = by_timestep(tables.get("unequal.equal", ()), "cpu_factor")
    ends = _ends(equal)
    if not ends:
        return
    timestep = ends[0]
    turned: list[str] = []
    kept: list[str] = []
    for table, records in tables.items():
        factors = by_timestep(records, "cpu_factor").get(timestep, {}) if table.startswith(UNEQUAL) else {}
        if len(factors) == len(equal[timestep]):
            given = f"{table.removeprefix(UNEQUAL)} ({ranking(factors)})"
            (kept if _order_verdict(factors) == _order_verdict(equal[timestep]) else turned).append(given)
    alongside = f"{name}, at {milliseconds(timestep)}: with equal models {ranking(equal[timestep])}"
    if turned:
        more = f" The order stays with {listed(kept)}." if kept else ""
        text = f"{alongside}. Models that are NOT EQUAL change the order: {listed(turned)}.{more}"
        yield Sentence(WARNING, text)
    elif kept:
        yield Sentence(WARNING, f"{alongside}. Models that are NOT EQUAL leave the order as it is: {listed(kept)}.")


def _limits(name: str, tables: Tables) -> Iterator[Sentence]:
    """Up to which timestep a scenario holds and its models are proven."""
    texts = [f"{engines}: {text}" for engines, text in limits(tables.get("validity", ()))]
    if not texts:
        return
    limit_of: dict[str, list[str]] = {}
    for entry in tables.get("certified", ()):
        limit_of.setdefault(_certified(entry, tables.get("certified.checks", ())), []).append(str(entry["engine"]))
    certified = "; ".join(f"{listed(engines)} {limit}" for limit, engines in limit_of.items())
    yield Sentence(PLAIN, f"{name}: {'; '.join(texts)}." + (f" Certified: {certified}." if certified else ""))


def _certified(record: Record, checks: Sequence[Record]) -> str:
    """Up to which timestep an engine's models are proven."""
    if record["limit"] is not None:
        return f"up to {'at least ' if record['first_invalid'] is None else ''}{milliseconds(record['limit'])}"
    verified = any(check["proven"] is not None for check in checks if check["engine"] == record["engine"])
    return "at no timestep" if verified else "not verified"
