"""Description of a machine, its load, and timed runs: alone, on one processor, the engines in turn."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import pytest

from simspec.compiler import compile_world
from simspec.engines.kit import process
from simspec.experiments import timing
from simspec.experiments import timing as machine
from simspec.experiments.store import result_of
from simspec.experiments.timing import (
    TIMED,
    Clocks,
    Machine,
    Others,
    TimedCase,
    bound_to,
    core_for_timing,
    disturbed,
    this_machine,
    timed_runs,
)
from simspec.runner.run import Case
from tests.experiments.swept import spec

MACHINE = Machine("A processor", "x86_64", 4, 8, "performance", 16 * 2**30, "Linux 6.1", "CPython 3.11.9")


def test_this_machine_is_described_whole():
    here = this_machine()
    assert here.cpu
    assert 1 <= here.cores <= here.threads
    assert here.memory > 2**28
    assert here.python.endswith(".".join(map(str, sys.version_info[:3])))
    assert not here.differences(this_machine())
    assert Machine(**here.plain()) == here


@pytest.mark.parametrize(
    ("other", "given"),
    [
        ({"cpu": "Another"}, "cpu: A processor and Another"),
        ({"threads": 4}, "threads: 8 and 4"),
        ({"governor": "powersave"}, "governor: performance and powersave"),
        ({"memory": 8 * 2**30}, "memory: 16.0 GiB and 8.0 GiB"),
        ({"memory": 16 * 2**30 - 2**28}, None),
        ({"kernel": "Linux 6.2", "python": "CPython 3.12.0"}, None),
    ],
)
def test_machines_are_distinguished_by_their_hardware(other, given):
    assert MACHINE.differences(dataclasses.replace(MACHINE, **other)) == ([] if given is None else [given])


def test_other_work_is_measured_without_the_time_of_this_process():
    before = Clocks(10.0, 100.0, 5.0, 1.0)
    assert Clocks(12.0, 103.0, 6.0, 1.0).others_since(before) == Others(1.0, 0.0)
    assert Clocks(12.0, 101.0, 6.0, 1.5).others_since(before) == Others(0.0, 0.25)
    assert Others(0.0, 0.0).words() == []
    assert "1.3 cores" in Others(1.3, 0.0).words()[0]
    assert "host" in Others(0.0, 0.25).words()[0]


def test_child_processes_do_not_count_as_other_work():
    before = Clocks.read()
    subprocess.run([sys.executable, "-c", "sum(range(5_000_000))"], check=True)
    after = Clocks.read()
    assert after.process > before.process
    assert after.busy > before.busy


def test_a_busy_machine_is_said_to_be_busy(monkeypatch):
    readings = iter([Clocks(0.0, 0.0, 0.0, 0.0), Clocks(1.0, 1.6, 0.1, 0.0)])
    monkeypatch.setattr(Clocks, "read", classmethod(lambda cls: next(readings)))
    used = iter([{(7, 1.0): ("make", 3.0)}, {(7, 1.0): ("make", 3.5), (8, 2.0): ("new", 0.1)}])
    monkeypatch.setattr(machine, "_by_process", lambda: next(used))
    monkeypatch.setattr(machine, "_load", lambda: 0.0)
    monkeypatch.setattr(machine, "scaling", list)
    assert machine.disturbances(0.0001 * 10000) == ["other processes use 1.5 cores (most of it make, 0.5)"]


def test_load_counts_what_is_beyond_this_process():
    assert machine.load_words(1.0, 2) == machine.load_words(2.0, 2) == []
    assert "2.5 on 2 processors" in machine.load_words(2.5, 2)[0]


def test_frequency_scaling_is_read_where_the_system_tells_it(tmp_path):
    assert machine.scaling(tmp_path) == []
    for number, governor in enumerate(("performance", "powersave", "powersave")):
        place = tmp_path / f"cpu{number}" / "cpufreq"
        place.mkdir(parents=True)
        (place / "scaling_governor").write_text(f"{governor}\n")
    assert machine.governors(tmp_path) == {"performance", "powersave"}
    assert machine.scaling(tmp_path) == ["the frequency governor is 'powersave', not 'performance'"]
    (tmp_path / "intel_pstate").mkdir()
    (tmp_path / "intel_pstate" / "no_turbo").write_text("1\n")
    assert len(machine.scaling(tmp_path)) == 1
    (tmp_path / "intel_pstate" / "no_turbo").write_text("0\n")
    assert len(machine.scaling(tmp_path)) == 2


def test_only_processes_started_in_the_block_are_pinned():
    before, core = os.sched_getaffinity(0), core_for_timing()
    assert core == max(before)
    words = [sys.executable, "-c", "import os; print(sorted(os.sched_getaffinity(0)))"]
    with bound_to(core):
        inside = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert inside.strip() == f"[{core}]"
    assert os.sched_getaffinity(0) == before
    with pytest.raises(KeyError), bound_to(core):
        raise KeyError
    assert os.sched_getaffinity(0) == before
    with bound_to(None):
        assert os.sched_getaffinity(0) == before


def test_engines_take_turns_each_bound_and_alone(tmp_path, monkeypatch):
    world = spec().resolve()
    engines = ["mujoco", "dart"]
    for name, compiled in compile_world(world, engines).items():
        compiled.artifacts.write(tmp_path / name)
    seen = []

    class Seen(process.Running):
        def __init__(self, *words, **more):
            super().__init__(*words, **more)
            seen.append(os.sched_getaffinity(self._process.pid))

    monkeypatch.setattr(process, "Running", Seen)
    cases = [TimedCase(Case(world, name), tmp_path / name) for name in engines]
    given = []
    runs = list(timed_runs(cases, 2, progress=lambda text, share: given.append((text, share))))
    assert [run.engine for run in runs] == ["mujoco", "dart", "mujoco", "dart"]
    assert given[1:3] == [("timing dart", 0.25), ("timing mujoco", 0.5)]
    assert seen == [{core_for_timing()}] * 4
    for run in runs:
        assert run.failed is None
        assert run.provenance[TIMED]["core"] == core_for_timing()
        assert run.provenance[TIMED]["machine"] == this_machine().plain()
        assert TIMED in result_of(run, "0" * 64).circumstances
        assert disturbed(run) == Others(run.provenance[TIMED]["others"], run.provenance[TIMED]["stolen"]).words()


def test_an_engine_that_fails_gives_a_failed_run_and_the_others_go_on(tmp_path):
    world = spec().resolve()
    compile_world(world, ["dart"])["dart"].artifacts.write(tmp_path / "dart")
    cases = [TimedCase(Case(world, "mujoco"), tmp_path / "none"), TimedCase(Case(world, "dart"), tmp_path / "dart")]
    first, second = timed_runs(cases, 1)
    assert "artifacts are missing" in first.failed
    assert second.failed is None
    assert disturbed(first) == []


def test_a_sweep_that_measures_speed_times_its_runs(tmp_path, monkeypatch):
    world = spec().resolve()
    compile_world(world, ["dart"])["dart"].artifacts.write(tmp_path / "dart")
    task = type("Task", (), {"engine": "dart", "deadline": 60.0, "source": {}})()
    run = timing.timed_tasks({})(Case(world, "dart"), tmp_path / "dart", task)
    assert run.provenance[TIMED]["core"] == core_for_timing()
