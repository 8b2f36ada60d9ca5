"""``simspec sweep``: its exit codes, what it prints and writes, and what it refuses; and that killing it costs nothing."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.experiments.store import Store

pytestmark = pytest.mark.usefixtures("warm_engines")

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tools"))

import kill_sweeps  # noqa: E402 - a script outside the package

SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 0.1 s}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
record: {every: 10 ms}
sweep:
  engines: [mujoco]
  over: {physics.timestep: [1 ms, 2 ms]}
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    (tmp_path / "fall.yaml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*words: str, code: int = 0) -> str:
    done = CliRunner().invoke(cli.app, ["sweep", "fall.yaml", *words])
    assert done.exit_code == code, done.output
    return done.output


def test_a_plan_a_sweep_and_nothing_left_to_do(place):
    said = call("--dry-run")
    assert "2 runs of 2 sets of values in mujoco" in said
    assert "done: 0; to do: 2" in said
    assert "not measured yet" in said
    assert "proofs: 2 at most, time not known" in said
    assert os.listdir(place) == ["fall.yaml"], "a plan writes nothing"
    said = call("--csv", "fall.csv")
    assert "2 runs now, 0 before" in said
    assert "proof: valid for all models (2 verified now)" in said
    assert len((place / "fall.csv").read_text().splitlines()) == 3
    assert len(list(Store.open(place / "runs/fall/sweep").keys())) == 2
    said = call("--dry-run", "--set", "sweep.repeat=2")
    assert "done: 2; to do: 2" in said
    assert "from what such runs took in this store" in said
    assert "proofs: all are there" in said, "a repetition is of the same model"
    said = call("--dry-run", "--set", "bodies.ball.mass=2")
    assert "proofs: 2 at most, about" in said
    assert "without proof" in call("--dry-run", "--no-verify")
    proofs = json.loads(call("--dry-run", "--json", "--set", "bodies.ball.mass=2"))["proofs"]
    assert proofs["models"] == {"mujoco": 2}
    assert 0.0 < proofs["seconds"] < 600.0
    content = json.loads(call("--json", "--csv", "fall.csv", "--no-verify"))
    assert (content["ran"], content["done_before"], content["proof"]["asked"], content["exit_code"]) == (0, 2, False, 0)
    assert [run["values"] for run in content["runs"]] == [{"physics.timestep": "1 ms"}, {"physics.timestep": "2 ms"}]


def test_a_run_that_was_not_timed_is_no_answer_to_what_it_costs(place):
    call("--no-verify", "--jobs", "2")
    speed = ("--no-verify", "--set", "sweep.measure=speed")
    assert "done: 0; to do: 2" in call("--dry-run", *speed)
    assert "2 runs now, 0 before" in call(*speed)
    store = Store.open(place / "runs/fall/sweep")
    timed = ["timed" in store.load(key).provenance for key in store.keys()]  # noqa: SIM118 - no mapping
    assert sorted(timed) == [False, False, True, True]
    assert "0 runs now, 2 before" in call(*speed)
    assert "0 runs now, 2 before" in call("--no-verify")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--set", "sweep.over={}"), "over is empty"),
        (("--set", "sweep.over={physics.timestp: [1 ms]}"), "timestep"),
        (("--set", "sweep.over={physics.timestep: []}"), "sweep.over"),
        (("--set", "sweep.measure=speed", "--jobs", "2"), "one run at a time"),
        (("--store", "."), "is the working folder"),
        (("--store", "mine"), "simspec did not make it"),
        (("--store", "mine/notes.txt"), "is a file"),
        (("--csv", "mine/notes.txt"), "simspec did not write it"),
        (("--jobs", "0"), "--jobs"),
    ],
)
def test_wrong_options_are_refused_before_any_work(place, words, message):
    (place / "mine").mkdir()
    (place / "mine" / "notes.txt").write_text("mine")
    assert message in call(*words, code=2)
    assert sorted(os.listdir(place)) == ["fall.yaml", "mine"]
    assert (place / "mine" / "notes.txt").read_text() == "mine"


def test_an_engine_that_is_not_known_or_not_there(place):
    assert "nobody" in call("--engine", "nobody", code=3)
    assert "is version" in call("--engine", "mujoco@1.2", code=3)
    assert not (place / "runs").exists()


def test_a_store_of_a_newer_simspec_and_a_store_in_use_are_refused(place):
    store = Store.open(place / "shared", create=True)
    with store.writing():
        assert "another process is writing here" in call("--store", "shared", code=2)
    (place / "shared" / "store.json").write_text('{"simspec_store": 99, "made_by": "9"}')
    assert "a newer simspec wrote it" in call("--store", "shared", code=2)
    assert "a newer simspec wrote it" in call("--store", "shared", "--dry-run", code=2)


def test_a_signal_ends_a_sweep_in_order_and_the_next_call_continues(place):
    number = signal.SIGINT
    line = [
        sys.executable,
        "-m",
        "simspec",
        "sweep",
        "fall.yaml",
        "--no-verify",
        "--set",
        "sweep.repeat=10",
        "--jobs",
        "2",
    ]
    process = subprocess.Popen(line, cwd=place, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    runs = place / "runs/fall/sweep/runs"
    while process.poll() is None and not len(list(runs.glob("*/*"))) > 3:
        time.sleep(0.02)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode in (128 + number, 0), errors
    done = len(list(runs.glob("*/*")))
    assert not list((place / "runs/fall/sweep/tmp").iterdir())
    assert (place / "runs/fall/sweep/index.parquet").is_file(), "known runs are written"
    content = json.loads(call("--no-verify", "--set", "sweep.repeat=10", "--json"))
    assert (content["ran"], content["done_before"], content["notes"]) == (20 - done, done, [])
    assert not any(run["failed"] for run in content["runs"]), "a run that ended with the sweep has not failed"


def test_killed_at_random_moments_it_loses_and_repeats_nothing(tmp_path):
    """Three kills; ``make kills`` has twenty."""
    sweeps = kill_sweeps.Sweeps(tmp_path, ["mujoco"], ["--jobs", "2", "--no-verify"])
    assert kill_sweeps.kill_often(sweeps, 3, random.Random(7)) == []


def test_runs_that_differ_are_reported(tmp_path):
    for name, content in (("a", '{"key": "k", "result": 1}'), ("b", '{"key": "k", "result": 2}')):
        (tmp_path / name / "runs").mkdir(parents=True)
        facts = {**json.loads(content), "asked": {}, "result_sha256": "", "circumstances": name}
        facts["circumstance_tables"] = {"seconds": name}
        (tmp_path / name / "runs" / "run.json").write_text(json.dumps(facts))
        (tmp_path / name / "t.parquet").write_text("same")
        (tmp_path / name / "runs" / "seconds.parquet").write_text(name)
    assert kill_sweeps.compare(tmp_path / "a", tmp_path / "b") == ["runs/run.json: differs"]
    (tmp_path / "b" / "t.parquet").unlink()
    assert "t.parquet: in one store only" in kill_sweeps.compare(tmp_path / "a", tmp_path / "b")
