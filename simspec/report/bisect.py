"""What a search for the version that changed a figure came to, in lines and as data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from simspec.experiments.bisect import Bisection, Reading

MOST_SKIPPED: Final = 5
"""Versions that could not be measured which are listed one by one; the others are counted."""
PREFIXES: Final = ((0.1, 1.0, "m"), (1e-5, 1e-3, "mm"), (1e-8, 1e-6, "µm"))
"""Of lengths: from which value (m) on, the factor, and the unit."""
ASSUMES: Final = "the search assumes one change between the ends: others would not be seen"


def bisect_lines(engine: str, done: Bisection, models: Sequence[str], more: str) -> Iterator[str]:
    """The answer first. ``models``: what is proven of the two versions; ``more``: the command that looks further."""
    first, last = (done.readings[done.versions[end]] for end in (0, -1))
    if done.before is None or done.after is None:
        yield f"{done.figure} does not change from {engine} {first.version} to {last.version}"
        yield from _values(first, last)
        yield f"  difference {_shown(abs(last.value - first.value), first.unit)}, within noise"
    else:
        span = f" ({', '.join(done.between)} or {done.after.version})" if done.between else ""
        yield f"{engine} {done.after.version} changed {done.figure}{span}"
        yield from _values(done.before, done.after)
        yield f"  change {_shown(done.after.value - done.before.value, done.after.unit)}{_share(done.before, done.after)}"
    yield from (f"  {line}" for line in models)
    kept = sum(one.stored for one in done.readings.values())
    stored = f", {kept} of them from stored runs" if kept else ""
    counted = f"{len(done.readings)} of {len(done.versions)} versions from {first.version} to {last.version}"
    yield f"measured {counted}, each once{stored}"
    skipped = list(done.not_measured.items())
    yield from (f"not measured: {version}: {why}" for version, why in skipped[:MOST_SKIPPED])
    if len(skipped) > MOST_SKIPPED:
        yield f"not measured: {len(skipped) - MOST_SKIPPED} more versions"
    yield from (f"note: {note}" for note in done.notes)
    if done.found:
        if len(done.versions) > len(done.readings) + len(skipped) and not done.notes:
            yield f"note: {ASSUMES}"
        yield f"look further: {more}"


def _values(*readings: Reading) -> Iterator[str]:
    width = max(len(one.version) for one in readings)
    for one in readings:
        yield f"  {one.version:<{width}}  {_shown(one.value, one.unit)}, noise {_shown(one.noise, one.unit, 2)}"


def _share(before: Reading, after: Reading) -> str:
    return f" ({(after.value - before.value) / abs(before.value):+.1%})" if before.value else ""


def _shown(value: float, unit: str, digits: int = 4) -> str:
    """A number to some digits, a length with the prefix that suits it."""
    if unit != "m" or not value:
        return f"{value:.{digits}g} {unit}".rstrip()
    for least, factor, prefix in PREFIXES:
        if abs(value) >= least:
            return f"{value / factor:.{digits}g} {prefix}"
    return f"{value:.1e} m"


def bisect_data(engine: str, done: Bisection, models: Sequence[str], more: str) -> dict[str, Any]:
    """For ``--json``: everything."""
    return {
        "engine": engine,
        "figure": done.figure,
        "found": done.found,
        "changed_in": None if done.after is None else done.after.version,
        "between": list(done.between),
        "before": _plain(done.before),
        "after": _plain(done.after),
        "versions": list(done.versions),
        "measured": {version: _plain(done.readings[version]) for version in done.versions if version in done.readings},
        "not_measured": dict(done.not_measured),
        "notes": list(done.notes),
        "models": list(models),
        "explain": more if done.found else None,
    }


def _plain(one: Reading | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "version": one.version,
        "value": one.value,
        "unit": one.unit,
        "noise": one.noise,
        "half_width": one.half,
        "stored": one.stored,
    }
