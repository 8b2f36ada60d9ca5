"""The contact study of the library: every engine is in it, except where it lacks something."""

from __future__ import annotations

from pathlib import Path

from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from simspec.experiments.cases import world_of
from simspec.experiments.plan import plan_sweep
from simspec.language.load import load_study_file
from simspec.report.study.pages import marks

ROOT = Path(__file__).parents[2]
STUDY, PAGE = ROOT / "specs" / "studies" / "contact.yaml", ROOT / "docs" / "records" / "contact.md"


def test_every_approximation_is_accepted_since_the_study_measures_it():
    lacking: set[tuple[str, str, str | None]] = set()
    reasons: set[str] = set()
    for sweep in load_study_file(STUDY).sweeps():
        assert sweep.spec.data.sweep is not None
        engines = sweep.spec.data.sweep.engines
        plan = plan_sweep(sweep.spec, engines=engines, versions={engine: {} for engine in engines})
        for cell in plan:
            if dict(cell.overrides).get("physics.timestep") not in (None, "4 ms", "16 ms"):
                continue
            try:
                compile_world(world_of(plan, cell), [cell.engine])
            except UnsupportedError as error:
                lacking.add((sweep.name, cell.engine, cell.case))
                # an unsupported feature is reason enough
                messages = [problem.message for problem in error.problems]
                reasons.add(next((why for why in messages if "approximately" not in why), messages[0]))
    # PhysX had no cylinders when the study was measured
    reasons = {why for why in reasons if not why.startswith("PhysX supports shape.cylinder only approximately")}
    assert not [why for why in reasons if "approximately" in why]
    assert ("friction", "drake", "pyramid-inscribed") in lacking
    by_engine: dict[str, set[str]] = {}
    for name, engine, case in lacking:
        if case is None:
            by_engine.setdefault(engine, set()).add(name)
    soft, moments = {"compliance"}, {"rolling", "torsional"}
    assert by_engine == {
        "dart": soft | moments,
        "drake": soft | moments | {"restitution"},
        "gazebo": soft | moments,
        "ode": soft,
        "rapier": soft | moments,
        "physx": soft | moments | {"tower-cylinders"},
    }
    assert not [name for name, engine, case in lacking if engine == "mujoco" and case != "pyramid-circumscribed"]


def test_the_page_shows_every_sweep_of_the_study():
    shown = {mark.sweep for mark in marks(PAGE.read_text(encoding="utf-8"), "contact.md")}
    assert shown == {None, *(sweep.name for sweep in load_study_file(STUDY).sweeps())}
