"""How deep bodies overlap, over the runs of each engine."""

from __future__ import annotations

from statistics import median

from simspec.analysis.penetration import Depths, penetration
from simspec.errors import SpecError
from simspec.report.kit import length, table
from simspec.report.study.done import Done, Record, Shown, finite
from simspec.report.study.worlds import run_of, worlds_of

DEEP = 1e-3
"""m: the share of the time deeper than this is told."""


def penetration_tables(done: Done) -> list[Shown]:
    """``penetration``: over all initial states; runs that failed have no part in it, and are counted."""
    heads = ("runs", "deepest", "of", "at", "mean", f"time deeper than {length(DEEP)}")
    made = table(f"{done.sweep.name}: Overlaps", "timestep", "engine", *heads, right=(0, 2, 3, 5, 6, 7))
    records: list[Record] = []
    for world in worlds_of(done):
        for engine in done.engines:
            own = world.of.get(engine, [])
            whole = [row for _, row in own if row.failed is None]
            record = {"timestep": world.timestep, "values": world.values, "engine": engine, "runs": len(whole)}
            failed = len(own) - len(whole)
            counted = f"{len(whole)}, {failed} failed" if failed else str(len(whole))
            try:
                depths = [penetration(run_of(done, row)) for row in whole]
            except SpecError as error:
                made.add_row(world.name, engine, counted, error.problems[0].message, *[""] * 4)
                records.append({**record, "failed": failed, "reason": error.problems[0].message})
                continue
            if not depths:
                made.add_row(world.name, engine, counted, "no whole run", *[""] * 4)
                records.append({**record, "failed": failed, "reason": "no whole run"})
                continue
            deepest = max(depths, key=_deepest)
            mean, share = median(one.mean for one in depths), median(one.share_deeper(DEEP) for one in depths)
            pair = max(deepest.pairs, key=lambda name: deepest.pairs[name]) if deepest.pairs else ()
            made.add_row(
                world.name,
                engine,
                counted,
                length(_deepest(deepest)),
                " and ".join(pair) or "–",
                f"{deepest.deepest.time:.4g} s" if pair else "–",
                length(mean),
                f"{share:.1%}",
            )
            records.append(
                {**record, "failed": failed, "deepest": finite(_deepest(deepest)), "pair": list(pair)}
                | {"time": finite(deepest.deepest.time), "mean": finite(mean), "share_deeper": finite(share)}
            )
    made.caption = "Deepest: of all runs; mean, over the time in which something overlaps, and time: medians over runs"
    return [Shown("penetration", made, records)]


def _deepest(depths: Depths) -> float:
    return max(0.0, float(depths.depth.max(initial=0.0)))
