"""The driver: stored runs are not repeated, a failed run is a result, an engine that always dies is stopped, and an interrupt
loses nothing."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from simspec.commands.study import exit_code as study_code
from simspec.errors import EngineError, SpecError
from simspec.experiments import sweep as module
from simspec.experiments.executors import LocalExecutor
from simspec.experiments.plan import plan_sweep
from simspec.experiments.store import Store, place_of
from simspec.experiments.sweep import MOST_DEATHS, SweepOutcome, sweep
from simspec.language.load import Spec
from simspec.report.experiments import groups, outcome_data, results_table, short_names, show_outcome, sweep_csv
from simspec.runner.run import SCHEMA, Run
from simspec.world.canonical import sha256

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = ("mujoco", "pybullet")
VERSIONS = {name: {"simspec": "1", "engine_version": "2"} for name in ENGINES}


def spec(**words: object) -> Spec:
    return Spec.from_data(
        {
            "simspec": 1,
            "name": "fall",
            "physics": {"timestep": "1 ms", "duration": "0.1 s"},
            "bodies": {"ball": {"mass": 1, "inertia": {"principal": [0.01, 0.01, 0.01]}, "pose": {"xyz": [0, 0, 1]}}},
            "record": {"every": "10 ms", "channels": ["pose"]},
            "sweep": {"over": {"bodies.ball.mass": [1, 2, 3]}, **words},
        }
    )


class Engines:
    """Runs that are made up, each once: the ball falls by its mass. ``calls``: (engine, mass, repeat) of all."""

    def __init__(self, fail=lambda case, task: None):
        self.calls: list[tuple[str, float, int]] = []
        self._fail = fail

    def __call__(self, case, folder, task) -> Run:
        assert (folder / "sidecar.json").is_file()
        world = case.resolved
        mass = world.bodies[0].inertial.mass
        self.calls.append((case.engine, mass, task.repeat))
        self._fail(case, task)
        step = np.arange(0, world.physics.steps + 1, world.record.every_steps)
        pose = np.zeros((len(step), 1, 7))
        pose[:, 0, 2], pose[:, 0, 3] = mass * step, 1.0
        arrays = {
            "step": step,
            "time": step * world.physics.timestep,
            "pose": pose,
            "velocity": np.zeros((len(step), 1, 6)),
        }
        arrays |= {"q": pose[:, 0], "v": np.zeros((len(step), 6))}
        facts = {"schema": SCHEMA, "world_sha256": sha256(world), "engine_version": "2", "steps": world.physics.steps}
        facts |= {
            "seconds": {"step": 0.01 * mass, "cpu": 0.01, "process": 0.1},
            "started": "now",
            "perturb": task.perturb,
        }
        return Run(world, case.engine, arrays, facts)


def do(
    store: Store, engines: Engines, of: Spec | None = None, jobs: int = 1, names=ENGINES, **words: object
) -> SweepOutcome:
    plan = plan_sweep(of or spec(), engines=names, versions=VERSIONS)
    words = {"verify": False, "deadline": 60.0, **words}
    return sweep(plan, store, lambda supplies: LocalExecutor(supplies, jobs, do_run=engines), **words)


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path / "store", create=True)


@pytest.mark.parametrize("jobs", [1, 3])
def test_every_cell_is_run_once_and_not_again(store, jobs):
    engines = Engines()
    first = do(store, engines, jobs=jobs)
    assert sorted(engines.calls) == sorted((name, float(mass), 0) for mass in (1, 2, 3) for name in ENGINES)
    assert (first.ran, first.done) == (6, 0)
    assert all(row is not None for _, row in first.rows())
    second = do(store, engines, jobs=jobs)
    assert (second.ran, second.done, len(engines.calls)) == (0, 6, 6)
    assert second.notes == []
    assert [row.key for _, row in second.rows()] == [row.key for _, row in first.rows()]


def test_progress_is_reported_during_runs(store):
    given, during = [], []

    def look(case, task):
        during.append(given[-1])

    do(store, Engines(look), names=("mujoco",), verify=True, progress=lambda text, share=None: given.append(text))
    assert during == ["0 of 3 runs", "1 of 3 runs", "2 of 3 runs"]
    assert "verifying mujoco" in given


def test_runs_of_engines_alternate_with_a_single_worker(store):
    engines = Engines()
    do(store, engines)
    assert [name for name, _, _ in engines.calls] == list(ENGINES) * 3


def test_a_longer_sweep_adds_runs_and_equal_worlds_are_run_once(store):
    engines = Engines()
    do(store, engines)
    longer = do(
        store, engines, spec(over={"bodies.ball.mass": [2, 3, 4]}, cases={"same": {"bodies.ball.pose.xyz": [0, 0, 1]}})
    )
    assert longer.ran == 2
    assert len(engines.calls) == 8
    assert len(list(longer.rows())) == 12
    assert len({row.key for _, row in longer.rows()}) == 6
    renamed = spec()
    renamed = Spec.from_data({**renamed.source.document.data, "name": "other", "sweep": {"repeat": 2}})
    again = do(store, engines, renamed)
    assert (again.ran, again.done) == (2, 2), "mass 1 is there, its repetition is not"
    assert [call[2] for call in engines.calls[-2:]] == [1, 1]


def test_without_the_derived_files_nothing_is_repeated_either(store):
    engines = Engines()
    do(store, engines)
    for name in ("index.parquet", "cells.parquet"):
        (store.path / name).unlink()
    assert do(store, engines).ran == 0


def test_a_failed_run_is_a_result_and_is_repeated_only_on_request(store):
    def fail(case, task):
        if case.engine == "pybullet" and case.world.bodies[0].inertial.mass == 2:
            raise EngineError(case.engine, "the process was ended by signal 11")

    engines = Engines(fail)
    first = do(store, engines)
    assert (first.ran, first.stopped) == (6, {})
    failed = [row for _, row in first.rows() if row.failed is not None]
    assert [(row.engine, row.failed) for row in failed] == [("pybullet", "the process was ended by signal 11")]
    assert do(store, engines).ran == 0
    whole = Engines()
    assert do(store, whole, retry_failed=True).ran == 1
    assert whole.calls == [("pybullet", 2.0, 0)]
    assert store.facts(failed[0].key).result.failed is None


def test_an_engine_that_always_dies_is_stopped_and_the_others_go_on(store):
    def die(case, task):
        if case.engine == "mujoco":
            raise EngineError(case.engine, "the process was ended by signal 6")

    engines, many = Engines(die), spec(over={"bodies.ball.mass": list(range(1, 13))})
    outcome = do(store, engines, many)
    calls = [name for name, _, _ in engines.calls]
    assert (calls.count("mujoco"), calls.count("pybullet")) == (MOST_DEATHS, 12)
    assert list(outcome.stopped) == ["mujoco"]
    assert outcome.skipped == 12 - MOST_DEATHS
    assert outcome.exit_code(MOST_DEATHS, 0) == 3
    again = do(store, engines, many)
    assert (again.ran, list(again.stopped)) == (0, ["mujoco"]), "a known failure is not tried again"
    assert do(store, Engines(), many, retry_failed=True).ran == 12


def test_an_engine_that_dies_now_and_then_is_not_stopped(store):
    def die(case, task):
        if case.world.bodies[0].inertial.mass > 1:
            raise EngineError(case.engine, "killed")

    many = spec(over={"bodies.ball.mass": list(range(1, 13))})
    assert not do(store, Engines(die), many).stopped


def test_a_world_that_an_engine_does_not_support_is_a_failed_run(store, monkeypatch):
    ball = {"shapes": [{"sphere": {"radius": 0.1}, "material": "rough"}], "mass": 1, "pose": {"xyz": [0, 0, 3]}}
    floor = {"fixed": True, "shapes": [{"plane": {}, "material": "rough"}]}
    words = {"simspec": 1, "name": "rough", "physics": {"duration": 0.1}, "sweep": {"repeat": 1}}
    materials = {"materials": {"rough": {"friction": 0.5}}}
    rough = Spec.from_data({**words, "bodies": {"ball": ball, "floor": floor}, "contact": materials})
    engines = Engines()
    outcome = do(store, engines, rough, names=("mujoco",))
    assert not engines.calls
    ((_, row),) = outcome.rows()
    assert "does not support this world" in row.failed
    monkeypatch.setattr(module, "MOST_DEATHS", 1)
    again = do(store, engines, rough, names=("mujoco",))
    assert (again.ran, outcome.stopped, again.stopped) == (0, {}, {}), "it was not started, so it did not die"


def test_values_that_make_the_spec_invalid_are_reported_and_other_runs_are_done(store):
    outcome = do(store, Engines(), spec(over={"physics.timestep": ["1 ms", "3 ms", "2 ms"]}))
    assert (outcome.ran, outcome.invalid_count, outcome.exit_code(0, 0)) == (4, 2, 2)
    assert "whole number of timesteps" in str(outcome.invalid[0])


def test_engine_settings_are_checked_as_in_other_commands(store):
    wrong = spec(over={"engines.mujoco.settings": [{}, {"no_such_setting": 1}]})
    engines = Engines()
    outcome = do(store, engines, wrong)
    assert (outcome.ran, outcome.invalid_count, outcome.exit_code(0, 0)) == (2, 1, 2), (
        "the other engine does not receive the setting"
    )
    (problem,) = outcome.invalid
    assert problem.message == "mujoco has no setting 'no_such_setting'"
    assert problem.path == "engines.mujoco.settings.no_such_setting"


def test_rounded_times_are_reported_with_the_run_and_the_results(store, capsys):
    engines = Engines()
    of = spec(over={"physics.timestep": ["1 ms", "3 ms"]}, times="round_up")
    outcome = do(store, engines, of)
    assert (outcome.ran, outcome.invalid_count) == (4, 0)
    requested = {row.timestep: store.facts(row.key).request.cell for _, row in outcome.rows()}
    assert "rounded" not in requested[0.001]
    assert requested[0.003]["rounded"] == [["physics.duration", 0.1, 0.102], ["record.every", 0.01, 0.012]]
    made = groups(outcome.plan, outcome.rows())
    given = outcome_data(outcome, made)
    assert given["plan"]["times"] == "round_up"
    assert [run.get("rounded") for run in given["runs"]][1:3] == [None, requested[0.003]["rounded"]]
    show_outcome(outcome, made)
    assert (
        "note: times rounded up at physics.timestep=3 ms: physics.duration 0.1 s to 0.102 s" in capsys.readouterr().out
    )
    # a run without rounded times is the same run by either request; with rounded times it stays an error without `round`
    exact = do(store, engines, spec(over={"physics.timestep": ["1 ms", "3 ms"]}))
    assert (exact.ran, exact.done, exact.invalid_count) == (0, 2, 2)


FULL = "OSError: [Errno 28] No space left on device"


@pytest.mark.parametrize(
    "error",
    [KeyboardInterrupt, OSError(28, "No space left on device"), EngineError("mujoco", f"the worker failed: {FULL}")],
)
def test_an_interrupted_run_is_not_stored_and_the_next_call_does_the_remaining_runs(store, error):
    def end(case, task):
        if case.world.bodies[0].inertial.mass == 2:
            raise error

    engines = Engines(end)
    with pytest.raises((KeyboardInterrupt, OSError)):
        do(store, engines)
    done = len(list(store.keys()))
    assert done == 2
    rest = Engines()
    assert do(store, rest).ran == 4
    assert not {call[:2] for call in rest.calls} & {(name, 1.0) for name in ENGINES}


def test_engines_that_are_killed_because_the_sweep_ends_have_no_results(store):
    """One run meets a full disk while the other's engine is at work: that one is killed, which is no failure of it."""
    ended = threading.Event()

    def fail(case, task):
        if case.engine == "mujoco":
            raise OSError(28, "No space left on device")
        ended.wait(5.0)
        raise EngineError(case.engine, "killed")

    class Executor(LocalExecutor):
        def run(self, tasks, publish):
            self._ending = ended
            super().run(tasks, publish)

    plan = plan_sweep(spec(), engines=ENGINES, versions=VERSIONS)
    with pytest.raises(OSError, match="No space"):
        sweep(plan, store, lambda supplies: Executor(supplies, 2, do_run=Engines(fail)), verify=False, deadline=60.0)
    assert ended.is_set()
    assert list(store.keys()) == []


def test_two_sweeps_on_the_same_store(store):
    with store.writing(), pytest.raises(SpecError, match="another process is writing here"):
        do(store, Engines())


def test_damaged_runs_and_worlds_are_reported_and_redone(store):
    engines = Engines()
    rows = [row for _, row in do(store, engines).rows()]
    (store.path / place_of(rows[0].key) / "states.parquet").write_bytes(b"PAR1")
    (store.path / "worlds" / f"{rows[2].world}.json.gz").unlink()
    outcome = do(store, engines)
    assert (outcome.ran, outcome.done) == (1, 5)
    assert any("states.parquet" in note and "to be run again" in note for note in outcome.notes)
    assert any("is missing, it will be stored again" in note for note in outcome.notes)
    assert (do(store, engines).ran, len(engines.calls)) == (0, 7)
    assert store.load(rows[2].key).world.name == "fall"


def test_an_engine_in_another_version_than_planned_is_an_error(store):
    plan = plan_sweep(spec(), engines=["mujoco"], versions={"mujoco": {"engine_version": "3"}})
    with pytest.raises(EngineError, match="engine_version is 2, and was 3"):
        sweep(plan, store, lambda supplies: LocalExecutor(supplies, 1, do_run=Engines()), verify=False, deadline=60.0)
    assert list(store.keys()) == []


def test_each_model_is_proven_once_for_all_recordings_and_durations(store, monkeypatch):
    of = spec(over={"physics.duration": ["0.1 s", "0.2 s"], "physics.timestep": ["1 ms", "2 ms"]}, repeat=2)
    outcome = do(store, Engines(), of, names=("mujoco",), verify=True)
    assert (outcome.ran, outcome.proofs, outcome.unproven) == (8, 2, {})
    monkeypatch.setattr("simspec.proof.verify.verify", lambda *a, **k: pytest.fail("proven again"))
    assert do(store, Engines(), of, names=("mujoco",), verify=True).proofs == 0
    for path in (store.path / "certificates").iterdir():
        path.write_text(path.read_text().replace('"L1"', '"L2"', 1))
    monkeypatch.undo()
    again = do(store, Engines(), of, names=("mujoco",), verify=True)
    assert (again.ran, again.proofs) == (0, 2)
    assert all("was edited or is damaged" in note for note in again.notes)


def test_an_unproven_model_is_reported(store, monkeypatch):
    from simspec.proof.checks import failed

    monkeypatch.setattr("simspec.proof.verify.compare", lambda *a, **k: [failed("L0", "text", "wrong")])
    for _ in range(2):
        outcome = do(store, Engines(), names=("mujoco",), verify=True)
        assert len(outcome.unproven) == 3
        assert outcome.exit_code(0, 0) == 1


@pytest.mark.parametrize(("levels", "alone"), [(("L5",), True), (("L5", "L3"), False), (("L0",), False)])
def test_a_model_that_fails_in_contact_only_is_distinguished(store, monkeypatch, levels, alone):
    from simspec.proof import verify
    from simspec.proof.checks import failed

    whole = verify.compare
    planted = [failed(level, "planted", "wrong") for level in levels]
    monkeypatch.setattr(verify, "compare", lambda *a, **k: [*whole(*a, **k), *planted])
    for _ in range(2):  # the second time from the store
        outcome = do(store, Engines(), names=("mujoco",), verify=True)
        assert outcome.by_contact == (set(outcome.unproven) if alone else set())
        assert outcome.exit_code(0, 0) == 1
        codes = {show: study_code(outcome, show) for show in (("speed",), ("certified",), ("contact", "speed"))}
        assert codes == {("speed",): 1, ("certified",): 1 - alone, ("contact", "speed"): 1 - alone}


def test_the_index_is_written_now_and_then(store, monkeypatch):
    monkeypatch.setattr(module, "SAVE_EVERY", 2)
    seen = []

    def look(case, task):
        seen.append((store.path / "cells.parquet").is_file())

    do(store, Engines(look))
    assert seen == [False, False, True, True, True, True]


# --- tables -----------------------------------------------------------------------------------------------------------------


def test_groups_take_samples_and_repetitions_together(store):
    of = spec(
        samples={"count": 3, "seed": 1, "values": {"bodies.ball.pose.xyz": {"choice": [[0, 0, 1], [0, 0, 2]]}}},
        repeat=2,
    )
    outcome = do(store, Engines(), of, names=("mujoco",))
    found = groups(outcome.plan, outcome.rows())
    assert [(dict(group.values), group.requested, len(group.rows)) for group in found] == [
        ({"bodies.ball.mass": mass}, 6, 6) for mass in (1, 2, 3)
    ]
    assert found[1].real_time_factor() == pytest.approx(0.1 / 0.02)
    table = results_table(found)
    assert len(table.rows) == 3
    assert [column.name for column in table.columns][:4] == ["mass", "engine", "runs", "real time"]
    data = outcome_data(outcome, found)
    assert len(data["runs"]) == 18
    assert data["groups"][0]["runs"] == 6


def test_lines_of_csv_are_the_cells(store):
    outcome = do(store, Engines(), spec())
    lines = sweep_csv(outcome.plan, outcome.rows()).splitlines()
    head = lines[0].split(",")
    assert len(lines) == 7
    assert head[:5] == ["index", "engine", "engine_version", "case", "bodies.ball.mass"]
    cells = dict(zip(head, lines[3].split(","), strict=True))
    assert (cells["engine"], cells["bodies.ball.mass"], cells["step_seconds"]) == ("mujoco", "2", "0.02")


def test_paths_are_shortened_to_the_fewest_distinct_words():
    assert short_names(["physics.timestep", "bodies.a.mass", "bodies.b.mass"]) == {
        "physics.timestep": "timestep",
        "bodies.a.mass": "a.mass",
        "bodies.b.mass": "b.mass",
    }
