"""Chaotic scenes: engines compared by what runs come to at the end, with the run as the unit and seeds in pairs."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from simspec.analysis.distributions import SUMMARY, Test, permutation_test, run_summary, sign_flip_test, summary_scales
from simspec.errors import SpecError
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, finite
from simspec.report.study.worlds import Runs, run_of, worlds_of

DEEPEST = "deepest penetration"
"""The quantity of a run (m) that is compared beside its summary, where all runs have it."""
Numbers = NDArray[np.float64]


def distributions_tables(done: Done) -> list[Shown]:
    """``distributions.summary``, the mean of each engine's runs with its spread, and ``distributions.tests``, each two
    engines."""
    units = {**SUMMARY, "deepest_penetration": "m"}
    shown = [f"{name.replace('_', ' ')}, {unit}" for name, unit in units.items()]
    means = table(
        f"{done.sweep.name}: What runs come to at the end", "timestep", "engine", "runs", *shown, right=range(2, 9)
    )
    heads = ("pairs", "largest difference", "of", "paired test", "test without pairs")
    tests = table(
        f"{done.sweep.name}: Engines told apart by distributions", "timestep", "engines", *heads, right=(0, 2, 3)
    )
    mean_records: list[Record] = []
    test_records: list[Record] = []
    for world in worlds_of(done):
        summaries = {engine: _summaries(done, world, engine) for engine in done.engines}
        for engine, own in summaries.items():
            values = np.array(list(own.values())).reshape(len(own), len(units))
            spread = values.std(axis=0, ddof=1) if len(own) > 1 else np.full(len(units), np.nan)
            cells = [_mean(values[:, k], float(spread[k])) for k in range(len(units))] if own else ["–"] * len(units)
            failed = sum(row.failed is not None for _, row in world.of.get(engine, []))
            means.add_row(world.name, engine, f"{len(own)}, {failed} failed" if failed else str(len(own)), *cells)
            record = {"timestep": world.timestep, "values": world.values, "engine": engine, "runs": len(own)}
            figures = {name: [finite(float(value)) for value in values[:, k]] for k, name in enumerate(units)}
            mean_records.append({**record, "failed": failed, "seeds": list(own), **figures})
        for first, second in itertools.combinations(done.engines, 2):
            record, cells = _tested(done, world, (first, second), (summaries[first], summaries[second]), list(units))
            tests.add_row(world.name, f"{first}, {second}", *cells)
            test_records.append({"timestep": world.timestep, "values": world.values, **record})
    means.caption = "Mean over runs ± standard deviation. The run is the unit: bodies of one run are not independent"
    tests.caption = (
        "Largest difference: of the means of pairs, in body sizes d, √(g d) and Σ m g d. Paired: by seed, signs flipped. "
        "Without pairs: energy distance, permuted. At p ≤ 0.05 they differ"
    )
    return [
        Shown("distributions.summary", means, mean_records),
        Shown("distributions.tests", tests, test_records),
    ]


def _summaries(done: Done, world: Runs, engine: str) -> dict[int, Numbers]:
    """Of each whole run by its seed: its summary at the end and its deepest overlap (NaN where contacts were not recorded)."""
    return {
        seed: np.append(run_summary(run_of(done, row)), row.quantities.get(DEEPEST, np.nan))
        for seed, row in sorted(world.moved(engine).items())
    }


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
) -> tuple[dict[str, object], list[str]]:
    """Two engines: the record and the cells."""
    seeds = sorted(summaries[0].keys() & summaries[1].keys())
    alone = sorted(summaries[0].keys() ^ summaries[1].keys())
    record: dict[str, object] = {"engines": list(engines), "pairs": len(seeds), "seeds_in_one_only": alone}
    if not seeds:
        return {**record, "reason": "no seed with whole runs in both"}, ["0", "nothing to compare", "", "", ""]
    one, other = (np.array([own[seed] for seed in seeds]) for own in summaries)
    row = world.moved(engines[0])[seeds[0]]
    try:
        scales = summary_scales(run_of(done, row))
    except SpecError as error:
        why = error.problems[0].message
        return {**record, "reason": why}, [str(len(seeds)), why, "", "", ""]
    scales = np.append(scales, scales[0])
    told = np.isfinite(one).all(axis=0) & np.isfinite(other).all(axis=0)
    if not told.any():
        return {**record, "reason": "no figure is finite in all runs"}, [
            str(len(seeds)),
            "nothing to compare",
            "",
            "",
            "",
        ]
    left_out = [name for name, known in zip(names, told, strict=True) if not known]
    one, other = one[:, told] / scales[told], other[:, told] / scales[told]
    difference = (one - other).mean(axis=0)
    largest = int(np.abs(difference).argmax())
    which = [name for name, known in zip(names, told, strict=True) if known][largest]
    flipped, permuted = sign_flip_test(one - other), permutation_test(one, other)
    record |= {"largest": float(difference[largest]), "quantity": which, "left_out": left_out}
    record |= {"paired": _data(flipped), "unpaired": _data(permuted)}
    pairs = f"{len(seeds)}" + (f", {len(alone)} seeds in one only" if alone else "")
    of = which.replace("_", " ") + (f" (not compared: {', '.join(left_out)})" if left_out else "")
    return record, [pairs, f"{difference[largest]:.3g}", of, str(flipped), str(permuted)]


def _data(test: Test) -> dict[str, object]:
    return {
        "p": test.p,
        "smallest": test.smallest,
        "can_reject": test.can_reject,
        "rejects": test.rejects,
        "exact": test.exact,
    }
