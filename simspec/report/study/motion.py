"""Tables of motion: conservation, consistency, divergence, penetration, displacement, distributions."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.analysis.conservation import Conservation, Drift, OverlapDepths, conservation, displacement, penetration
from simspec.analysis.distributions import SUMMARY, permutation_test, run_summary, sign_flip_test, summary_scales
from simspec.analysis.horizons import Horizons, consistency, convergence, horizons
from simspec.comparison.floor import Floor
from simspec.errors import SpecError
from simspec.experiments.after_sweep import Overrides, amount_of, floors_of, moved_by_round_off, unmoved
from simspec.report.study.runs import (
    PLAIN,
    TIMESTEP,
    Done,
    Member,
    Record,
    Runs,
    StudyTable,
    Variant,
    finite,
    milliseconds,
    timesteps_of,
    unsupported_table,
    variants,
    worlds_of,
)
from simspec.report.table import BAD, DIM, TableCell, length, number, two_digits
from simspec.runner.run import Run

HEADS = ("energy while free", "of it by the integrator", "gained in contact", "linear momentum", "angular momentum")
SHARES = (0.1, 0.5, 1.0)
"""Shares of the time that both timesteps recorded at which their deviation is shown."""
DEEP = 1e-3
"""m: depth of overlaps whose share of the time is shown."""
DEEPEST = "deepest penetration"
"""The quantity of a run (m) that is compared in addition to its summary, where all runs have it."""
Numbers = NDArray[np.float64]


# Conservation: energy, and momentum of free bodies, where nothing may change them.


def conservation_tables(done: Done) -> list[StudyTable]:
    """``conservation``: of the runs whose initial state is not moved."""
    made = StudyTable(done, "conservation", "Conservation", "timestep", "engine", *HEADS, right=(0, *range(2, 7)))
    notes: dict[str, None] = {}
    for world, engine in itertools.product(worlds_of(done), done.engines):
        record: dict[str, Any] = world.about(engine)
        kept, why = _conserved(done, world.unmoved(engine))
        if kept is None:
            made.add(world.name, engine, why, record=record | {"reason": why})
            continue
        notes.update(dict.fromkeys(kept.notes))
        integrator = kept.integrator if kept.energy is not None else None
        for name in ("energy", "gained", "linear", "angular"):
            drift = getattr(kept, name)
            record[name] = None if drift is None else finite(drift.size)
            record[f"{name}_relative"] = None if drift is None else finite(drift.relative)
        record |= {"integrator": finite(integrator), "notes": list(kept.notes)}
        shares = [_share(drift) for drift in (kept.gained, kept.linear, kept.angular)]
        made.add(world.name, engine, _share(kept.energy), number(integrator, "J"), *shares, record=record)
    note = (
        "The largest change while nothing acts, and its share of the run's scale; gained: over a time of contact, "
        "which may take energy away and add none. –: something acts at all times"
    )
    made.note = "; ".join([note, *notes])
    return [made]


def _conserved(done: Done, member: Member | None) -> tuple[Conservation | None, str]:
    """The drifts of a run, or the reason why there are none."""
    if member is None or member[1].failed is not None:
        return None, "not run" if member is None else f"failed: {member[1].failed}"
    try:
        return conservation(done.store.load(member[1].key)), ""
    except SpecError as error:
        return None, error.problems[0].message


def _share(drift: Drift | None) -> str:
    return "–" if drift is None else f"{number(drift.size)} ({drift.relative:.1e})"


# Consistency: engines compared with themselves at other timesteps (after Erez, Tassa and Todorov 2015).


def consistency_tables(done: Done) -> list[StudyTable]:
    """``consistency``: each timestep against the next smaller one, of the runs whose initial state is not moved."""
    title = "Each engine against itself at the next smaller timestep"
    heads = ("engine", "timesteps", "time", "RMS", "largest", "½ g t Δdt", "order")
    made = StudyTable(done, "consistency", title, *heads, right=range(2, 7))
    by_values: dict[str, list[Runs]] = {}
    for world in worlds_of(done):
        by_values.setdefault(world.values, []).append(world)
    for (values, worlds), engine in itertools.product(by_values.items(), done.engines):
        whole = [(world.timestep, member[1]) for world in worlds if (member := world.unmoved(engine)) is not None]
        loaded = {step: done.store.load(row.key) for step, row in whole if row.failed is None}
        steps = sorted(loaded, reverse=True)
        about: dict[str, Any] = {"engine": engine, "values": values}
        if len(steps) < 2:
            why = "fewer than two timesteps"
            made.add(engine, values or "–", f"{why} with a whole run", record=about | {"reason": why})
        for coarse, fine in itertools.pairwise(steps):
            named = f"{milliseconds(coarse)}, {milliseconds(fine)}" + (f", {values}" if values else "")
            record = about | {"coarse": coarse, "fine": fine}
            try:
                deviation = consistency(loaded[coarse], loaded[fine])
            except SpecError as error:
                why = error.problems[0].message
                made.add(engine, named, why, record=record | {"reason": why})
                continue
            orders = _orders(loaded, steps, coarse, fine)
            for row in dict.fromkeys(deviation.row(share * float(deviation.time[-1])) for share in SHARES):
                time, order = float(deviation.time[row]), _at(orders, float(deviation.time[row]))
                figures = {name: float(getattr(deviation, name)[row]) for name in ("rms", "largest", "drift")}
                cells = (*map(length, figures.values()), "–" if order is None else f"{order:.2g}")
                record_at = record | {"time": time} | {name: finite(value) for name, value in figures.items()}
                made.add(engine, named, f"{time:.4g} s", *cells, record=record_at | {"order": finite(order)})
    made.note = (
        "Deviation of the moving bodies' positions. ½ g t Δdt: by how much two first-order motions in free fall differ. "
        "Order: of convergence, with the next smaller timestep of the same ratio; – without one, or without deviation"
    )
    return [made]


def _orders(
    loaded: dict[float, Run], steps: list[float], coarse: float, fine: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Times and observed orders of a timestep, the next smaller, and the one of the same ratio after it; None without one."""
    finest = next((step for step in steps if abs(step * coarse - fine**2) <= 1e-9 * fine**2), None)
    if finest is None:
        return None
    try:
        found = convergence([loaded[coarse], loaded[fine], loaded[finest]])
    except SpecError:  # no time that all three recorded
        return None
    return found.time, found.order


def _at(orders: tuple[np.ndarray, np.ndarray] | None, time: float) -> float | None:
    if orders is None or not len(orders[0]):
        return None
    row = int(np.abs(orders[0] - time).argmin())
    near = abs(float(orders[0][row]) - time) <= 1e-6 * max(1.0, time)
    return finite(float(orders[1][row])) if near else None


# Divergence: engines' noise, their first gap, and the growth of a gap of that size in one engine.


def divergence_tables(done: Done) -> list[StudyTable]:
    """``divergence``: each two engines at each timestep, from the runs whose initial state is not moved."""
    heads = ("noise at the end", "noise horizon", "first gap", "of", "at", "second horizon", "comparable until")
    title, right = "How long positions can be compared", (0, 2, 3, 4, 6, 7, 8)
    made = StudyTable(done, "divergence", title, "timestep", "engines", *heads, right=right)
    notes: dict[str, None] = {}
    noisy = moved_by_round_off(done.outcome)
    for overrides, members in sorted(unmoved(done.outcome).items(), key=lambda item: _timestep(item[1])):
        timestep = _timestep(members)
        values = ", ".join(f"{path}: {value}" for path, value in overrides if path != TIMESTEP)
        name = f"{milliseconds(timestep)}, {values}" if values else milliseconds(timestep)
        runs = {engine: done.store.load(row.key) for engine, (_, row) in members.items()}
        for first, second in itertools.combinations(done.engines, 2):
            record: dict[str, Any] = {"timestep": timestep, "values": values, "engines": [first, second]}
            missing = [engine for engine in (first, second) if engine not in runs]
            why = f"no whole run of {', '.join(missing)}" if missing else ""
            try:
                if not missing:
                    pair = (runs[first], runs[second])
                    floors = floors_of(pair, overrides, noisy, done.store)
                    found = horizons(*pair, floors, _moved(done, overrides, pair, floors))
            except SpecError as error:
                why = error.problems[0].message
            if why:
                made.add(name, f"{first}, {second}", why, record=record | {"reason": why})
                continue
            noise = max((floor.largest for floor in floors), default=None)
            notes.update(dict.fromkeys(f"{name}, {first} and {second}: {note}" for note in found.notes))
            record |= _data(found, noise, bool(floors))
            made.add(name, f"{first}, {second}", length(noise), *_cells(found, bool(floors)), record=record)
    if not made.records:
        made.add("–", "–", "no two engines to compare")
    note = (
        "Noise: of runs moved in the last bits; from its horizon on it hides 1 mm. First gap: more than 1 nm and 3 × noise. "
        "Second horizon: when an engine alone, moved by the size of that gap, is off by 1 mm. –: never"
    )
    made.note = "; ".join([note, *notes])
    return [made]


def _timestep(members: Mapping[str, Member]) -> float:
    return float(next(row.timestep for _, row in members.values()))


def _moved(done: Done, overrides: Overrides, pair: tuple[Run, Run], floors: Sequence[Floor]) -> list[Floor]:
    """The floors of runs moved by the size of the first gap; none where there were none."""
    amount = amount_of(*pair, floors)
    repeats = [
        (cell, row)
        for second, outcome in done.moved
        if second.amount == amount
        for cell, row in outcome.rows()
        if row is not None and cell.seed is not None
    ]
    return floors_of(pair, overrides, repeats, done.store)


def _cells(found: Horizons, noisy: bool) -> list[str]:
    gap = found.gap
    return [
        _time(found.noise) if noisy else "not measured",
        *(("–", "–", "–") if gap is None else (length(gap.size), gap.body, _time(gap.time))),
        _time(found.second) if found.measured else "not measured",
        _time(found.comparable_until) if found.comparable_until is not None else "the end",
    ]


def _time(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g} s"


def _data(found: Horizons, noise: float | None, noisy: bool) -> dict[str, Any]:
    gap = found.gap
    return {
        **{"noise": finite(noise), "noise_measured": noisy, "noise_horizon": found.noise},
        **{"gap": gap and finite(gap.size), "gap_time": gap and gap.time, "gap_body": gap and gap.body},
        **{"second_horizon": found.second, "second_measured": found.measured},
        **{"comparable_until": found.comparable_until, "notes": list(found.notes)},
    }


# Penetration: the depth of overlaps, over the runs of each engine.


def penetration_tables(done: Done) -> list[StudyTable]:
    """``penetration``: over all initial states; runs that failed are counted and left out."""
    heads = ("timestep", "engine", "runs", "deepest", "of", "at", "mean", f"time deeper than {length(DEEP)}")
    made = StudyTable(done, "penetration", "Overlaps", *heads, right=(0, 2, 3, 5, 6, 7))
    for world, engine in itertools.product(worlds_of(done), done.engines):
        whole = [row for _, row in world.of.get(engine, []) if row.failed is None]
        failed = len(world.of.get(engine, [])) - len(whole)
        record: dict[str, Any] = {**world.about(engine), "runs": len(whole), "failed": failed}
        counted = f"{len(whole)}, {failed} failed" if failed else str(len(whole))
        try:
            depths = [penetration(done.store.load(row.key)) for row in whole]
            why = "" if depths else "no whole run"
        except SpecError as error:
            why = error.problems[0].message
        if why:
            made.add(world.name, engine, counted, why, record=record | {"reason": why})
            continue
        deepest = max(depths, key=_deepest)
        mean, share = median(depth.mean for depth in depths), median(depth.share_deeper(DEEP) for depth in depths)
        pair = max(deepest.pairs, key=lambda name: deepest.pairs[name]) if deepest.pairs else ()
        at = f"{deepest.deepest.time:.4g} s" if pair else "–"
        cells = (length(_deepest(deepest)), " and ".join(pair) or "–", at, length(mean), f"{share:.1%}")
        record |= {"deepest": finite(_deepest(deepest)), "pair": list(pair), "time": finite(deepest.deepest.time)}
        record |= {"mean": finite(mean), "share_deeper": finite(share)}
        made.add(world.name, engine, counted, *cells, record=record)
    made.note = "Deepest: of all runs; mean, over the time in which something overlaps, and time: medians over runs"
    return [made]


def _deepest(depths: OverlapDepths) -> float:
    return max(0.0, float(depths.depth.max(initial=0.0)))


# Displacement: towers that stand, creep or fall.


def displacement_tables(done: Done) -> list[StudyTable]:
    """``displacement``."""
    made = variants(done)
    steps = timesteps_of(made)
    title = "How far free bodies are moved: sideways at most / down at the end (mm)"
    shown = StudyTable(done, "displacement", title, "settings", "engine", *map(milliseconds, steps))
    for variant in made:
        if variant.supported:
            cells = [_moved_cell(done, variant, step) for step in steps]
            shown.add(variant.label, variant.engine, *(cell for cell, _ in cells))
            shown.records += [record for _, record in cells if record is not None]
    shown.note = (
        "the furthest of all bodies and runs; a body has left its place when it is moved sideways by more than its size (the "
        "radius of the largest sphere in it)"
    )
    return [shown, unsupported_table(done, "displacement", made)]


def _moved_cell(done: Done, variant: Variant, step: float) -> tuple[TableCell, Record | None]:
    """The worst of the runs of a timestep, as a cell and as data."""
    runs = variant.runs.get(step, [])
    if not runs or any(variant.refused(row) for _, row in runs):
        return TableCell(PLAIN, DIM), None
    record: dict[str, Any] = {"settings": variant.label, "engine": variant.engine, "timestep": step, "runs": len(runs)}
    failed = next((row.failed for _, row in runs if row.failed is not None), None)
    if failed is not None:
        return TableCell("failed", BAD), record | {"failed": failed}
    moved = [displacement(done.store.load(row.key)) for _, row in runs]
    fallen = [entry.left for entry in moved if entry.left is not None]
    sideways, down = max(entry.sideways for entry in moved), max(entry.down for entry in moved)
    record |= {"sideways": finite(sideways), "down": finite(down), "left_at": min(fallen, default=None)}
    if not fallen:
        return TableCell(f"{two_digits(1e3 * sideways)} / {two_digits(1e3 * down)}"), record
    share = f" ({len(fallen)} of {len(moved)} runs)" if len(moved) > 1 else ""
    return TableCell(f"left its place at {min(fallen):.1f} s{share}", BAD), record


# Distributions: chaotic scenes, with the run as the unit and seeds in pairs.


def distributions_tables(done: Done) -> list[StudyTable]:
    """``distributions.summary``, the mean of each engine's runs with its spread, and ``distributions.tests``, each two
    engines."""
    units = {**SUMMARY, "deepest_penetration": "m"}
    heads = ("timestep", "engine", "runs", *(f"{name.replace('_', ' ')}, {unit}" for name, unit in units.items()))
    means = StudyTable(done, "distributions.summary", "Results at the end of runs", *heads, right=range(2, 9))
    heads = ("timestep", "engines", "pairs", "largest difference", "of", "paired test", "test without pairs")
    tests = StudyTable(done, "distributions.tests", "Engines compared by distributions", *heads, right=(0, 2, 3))
    for world in worlds_of(done):
        # of each whole run by its seed: its summary at the end and its deepest overlap (NaN without recorded contacts)
        summaries: dict[str, dict[int, Numbers]] = {
            engine: {
                seed: np.append(run_summary(done.store.load(row.key)), row.quantities.get(DEEPEST, np.nan))
                for seed, row in sorted(world.moved(engine).items())
            }
            for engine in done.engines
        }
        for engine, by_seed in summaries.items():
            values = np.array(list(by_seed.values())).reshape(len(by_seed), len(units))
            spread = values.std(axis=0, ddof=1) if len(by_seed) > 1 else np.full(len(units), np.nan)
            cells = [_mean(values[:, k], float(spread[k])) if by_seed else "–" for k in range(len(units))]
            failed = sum(row.failed is not None for _, row in world.of.get(engine, []))
            record: dict[str, Any] = world.about(engine) | {"runs": len(by_seed), "failed": failed}
            record |= {"seeds": list(by_seed)}
            record |= {name: [finite(float(value)) for value in values[:, k]] for k, name in enumerate(units)}
            count = f"{len(by_seed)}, {failed} failed" if failed else str(len(by_seed))
            means.add(world.name, engine, count, *cells, record=record)
        for first, second in itertools.combinations(done.engines, 2):
            record, cells = _tested(done, world, (first, second), (summaries[first], summaries[second]), list(units))
            record = {"timestep": world.timestep, "values": world.values, **record}
            tests.add(world.name, f"{first}, {second}", *cells, record=record)
    means.note = "Mean over runs ± standard deviation. The run is the unit: bodies of one run are not independent"
    tests.note = (
        "Largest difference: of the means of pairs, in body sizes d, √(g d) and Σ m g d. Paired: by seed, signs flipped. "
        "Without pairs: energy distance, permuted. At p ≤ 0.05 they differ"
    )
    return [means, tests]


def _mean(values: Numbers, spread: float) -> str:
    if np.isnan(values).any():
        return "–"
    text = number(float(values.mean()))
    return text if np.isnan(spread) else f"{text} ± {spread:.2g}"


def _tested(
    done: Done,
    world: Runs,
    engines: tuple[str, str],
    summaries: tuple[dict[int, Numbers], dict[int, Numbers]],
    names: list[str],
) -> tuple[dict[str, Any], list[str]]:
    """Two engines: the record and the cells."""
    seeds = sorted(summaries[0].keys() & summaries[1].keys())
    alone = sorted(summaries[0].keys() ^ summaries[1].keys())
    record: dict[str, Any] = {"engines": list(engines), "pairs": len(seeds), "seeds_in_one_only": alone}
    if not seeds:
        return {**record, "reason": "no seed with whole runs in both"}, ["0", "nothing to compare"]
    values, other = (np.array([by_seed[seed] for seed in seeds]) for by_seed in summaries)
    try:
        scales = summary_scales(done.store.load(world.moved(engines[0])[seeds[0]].key))
    except SpecError as error:
        why = error.problems[0].message
        return {**record, "reason": why}, [str(len(seeds)), why]
    scales = np.append(scales, scales[0])
    known = np.isfinite(values).all(axis=0) & np.isfinite(other).all(axis=0)
    if not known.any():
        return {**record, "reason": "no figure is finite in all runs"}, [str(len(seeds)), "nothing to compare"]
    left_out = [name for name, finite in zip(names, known, strict=True) if not finite]
    values, other = values[:, known] / scales[known], other[:, known] / scales[known]
    difference = (values - other).mean(axis=0)
    largest = int(np.abs(difference).argmax())
    quantity = [name for name in names if name not in left_out][largest]
    flipped, permuted = sign_flip_test(values - other), permutation_test(values, other)
    record |= {"largest": float(difference[largest]), "quantity": quantity, "left_out": left_out}
    for kind, test in (("paired", flipped), ("unpaired", permuted)):
        record[kind] = {name: getattr(test, name) for name in ("p", "smallest", "can_reject", "rejects", "exact")}
    pairs = f"{len(seeds)}" + (f", {len(alone)} seeds in one only" if alone else "")
    of = quantity.replace("_", " ") + (f" (not compared: {', '.join(left_out)})" if left_out else "")
    return record, [pairs, f"{difference[largest]:.3g}", of, str(flipped), str(permuted)]
