"""What runs conserve where nothing may change it: energy, and momentum of free bodies."""

from __future__ import annotations

from simspec.analysis.conservation import Drift, conservation
from simspec.errors import SpecError
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, finite
from simspec.report.study.worlds import run_of, worlds_of

HEADS = ("energy while free", "of it by the integrator", "gained in contact", "linear momentum", "angular momentum")


def conservation_tables(done: Done) -> list[Shown]:
    """``conservation``: of the runs whose initial state is not moved."""
    made = table(f"{done.sweep.name}: What is conserved", "timestep", "engine", *HEADS, right=(0, *range(2, 7)))
    records: list[Record] = []
    notes: dict[str, None] = {}
    for world in worlds_of(done):
        for engine in done.engines:
            member = world.unmoved(engine)
            if member is None or member[1].failed is not None:
                why = "not run" if member is None else f"failed: {member[1].failed}"
                made.add_row(world.name, engine, why, *[""] * 4)
                records.append({"timestep": world.timestep, "values": world.values, "engine": engine, "reason": why})
                continue
            try:
                told = conservation(run_of(done, member[1]))
            except SpecError as error:
                why = error.problems[0].message
                made.add_row(world.name, engine, why, *[""] * 4)
                records.append({"timestep": world.timestep, "values": world.values, "engine": engine, "reason": why})
                continue
            notes.update(dict.fromkeys(told.notes))
            integrator = told.integrator if told.energy is not None else None
            drifts = {"energy": told.energy, "gained": told.gained, "linear": told.linear, "angular": told.angular}
            made.add_row(
                world.name,
                engine,
                _share(told.energy),
                number(integrator, "J"),
                _share(told.gained),
                _share(told.linear),
                _share(told.angular),
            )
            record: dict[str, object] = {"timestep": world.timestep, "values": world.values, "engine": engine}
            for name, drift in drifts.items():
                record[name] = None if drift is None else finite(drift.size)
                record[f"{name}_relative"] = None if drift is None else finite(drift.relative)
            records.append({**record, "integrator": finite(integrator), "notes": list(told.notes)})
    made.caption = "; ".join(
        [
            "The largest change while nothing acts, and its share of the run's scale; gained: over a time of contact, "
            "which may take energy away and add none. –: something acts at all times",
            *notes,
        ]
    )
    return [Shown("conservation", made, records)]


def _share(drift: Drift | None) -> str:
    return "–" if drift is None else f"{number(drift.size)} ({drift.relative:.1e})"
