"""``simspec explain``: arguments, output and refusals."""

from __future__ import annotations

import dataclasses
import json

import pytest

import simspec
from simspec import cli
from simspec.attribution.configuration import proof_of
from simspec.attribution.sentences import verdict
from simspec.attribution.sides import side_of_run
from simspec.errors import EXIT_OK, EXIT_WRONG, EngineError, SpecError
from simspec.runner.execution import failed_run, run
from tests.attribution.planted import FALL, world

pytestmark = pytest.mark.usefixtures("warm_engines")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Three saved runs: of a fall, of a fall under another gravity, and of another scene."""
    folder = tmp_path_factory.mktemp("runs")
    run(world(FALL), "mujoco").save(folder / "fall")
    run(world(FALL, "physics.gravity=[0,0,-9]"), "mujoco").save(folder / "slow")
    run(world(FALL.replace("  box:", "  brick:")), "mujoco").save(folder / "brick")
    return folder


def joined(text):
    """A printed text without the ends of its lines."""
    return " ".join(text.split())


def explain(capsys, *words):
    code = cli.main(["explain", *map(str, words)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_the_verdict_is_the_first_line(runs, capsys):
    code, out, _ = explain(capsys, runs / "fall", runs / "slow")
    assert code == EXIT_OK
    first = out.splitlines()[0]
    assert first.startswith("Gravity ([0, 0, -9.81] in A, [0, 0, -9] in B) accounts for 100 % of the difference")
    assert "free motion (5): mean gap" in out
    assert len(out.splitlines()) < 40


def test_the_same_as_data(runs, capsys):
    code, out, _ = explain(capsys, runs / "fall", runs / "slow", "--json")
    content = json.loads(out)
    assert code == EXIT_OK
    assert content["causes"][0]["name"] == "gravity"
    assert content["causes"][0]["share"]["free"] == 1.0
    assert content["unexplained"]["all"] == 0.0


def test_the_second_side_may_be_given_by_its_values(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(FALL, encoding="utf-8")
    code, out, _ = explain(capsys, "fall.yaml", "--engine", "mujoco", "--with", "bodies.box.mass=2 kg")
    assert code == EXIT_OK
    assert out.startswith("There is nothing to explain")  # bodies of every mass fall alike
    assert "mass and inertia of box" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("fall", "brick"), "the two are of different scenes"),
        (("fall",), "cannot explain this difference"),
        (("fall", "nothing-there"), "cannot explain this difference"),
        (("fall", "slow", "--engine", "mujoco"), "runs have their own"),
        (("fall", "slow", "--with", "name=x"), "runs have their own"),
    ],
)
def test_an_impossible_explanation_is_a_located_error(runs, monkeypatch, capsys, words, message):
    monkeypatch.chdir(runs)
    code, out, err = explain(capsys, *words)
    assert (code, out) == (EXIT_WRONG, "")
    assert message in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "one engine or two"),
        (("--engine", "mujoco"), "there is only one side"),
        (("--engine", "mujoco", "--engine", "dart", "--engine", "pybullet"), "one engine or two"),
        (("--engine", "mujoco", "--with", "bodies.bax.mass=2"), "bax"),
        (("--engine", "mujoco", "--with", "physics.duration=0 s"), "duration"),
    ],
)
def test_sides_that_are_not_two_are_errors(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(FALL, encoding="utf-8")
    code, out, err = explain(capsys, "fall.yaml", *words)
    assert (code, out) == (EXIT_WRONG, "")
    assert message in err


def test_damaged_runs_and_runs_without_rows_are_errors(runs, tmp_path, capsys):
    whole = run(world(FALL), "mujoco")
    place = whole.save(tmp_path / "damaged")
    (place / "states.parquet").write_bytes(b"PAR1")
    code, _, err = explain(capsys, place, runs / "fall")
    assert code == EXIT_WRONG
    assert "states.parquet" in err
    with pytest.raises(SpecError, match="has no rows: it crashed"):
        side_of_run(failed_run(world(FALL), "mujoco", EngineError("mujoco", "it crashed")))


def test_round_off_of_a_recorded_initial_state_is_no_difference(runs):
    plain = run(world(FALL), "mujoco")
    plain.arrays["q"][0] *= 1.0 + 3e-16
    assert side_of_run(plain).start is None
    barely = run(world(FALL), "mujoco", perturb=1e-15)
    assert side_of_run(barely).start is not None


def test_the_models_of_stored_runs_are_those_of_their_certificate(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(FALL, encoding="utf-8")
    assert cli.main(["run", "fall.yaml", "--engine", "mujoco", "--engine", "dart"]) == EXIT_OK
    capsys.readouterr()
    _, out, _ = explain(capsys, "runs/fall/mujoco", "runs/fall/dart")
    assert "models: equal: L0 to L4" in out
    assert "(runs/fall/certificate.json)" in out
    assert "motion without contact: as the oracle's" in out
    _, out, _ = explain(capsys, "runs/fall/mujoco", "runs/fall/dart", "--json")
    assert [proof["faults"] for proof in json.loads(out)["models"]] == [[], []]
    certificate = tmp_path / "runs/fall/certificate.json"
    certificate.write_text(certificate.read_text(encoding="utf-8").replace('"L1"', '"L2"', 1), encoding="utf-8")
    code, out, _ = explain(capsys, "runs/fall/mujoco", "runs/fall/dart")
    assert code == EXIT_OK
    assert "models: not proven to be equal" in out
    assert "does not match its hash" in joined(out)


def test_a_proof_that_fails_comes_first(capsys):
    worlds = world(FALL), world(FALL, "physics.gravity=[0,0,-9]")
    sides = [simspec.Configuration(each, "mujoco") for each in worlds]
    certificate = simspec.verify(sides[0].world, ["mujoco"])
    proof = certificate.engines["mujoco"]
    wrong = dataclasses.replace(proof.checks[0], worst=1.0)
    damaged = dataclasses.replace(
        certificate, engines={"mujoco": dataclasses.replace(proof, checks=(wrong, *proof.checks[1:]))}
    )
    proofs = [proof_of(sides[0], damaged, "there", None), proof_of(sides[1], certificate, "there", None)]
    assert [bool(each.faults) for each in proofs] == [True, False]
    assert "another world" in proofs[1].missing
    lines = verdict(simspec.explain(*sides, proofs=proofs, windows=5))
    assert lines[0].startswith("The models are not proven to be equal: mujoco: ")
    assert lines[1].startswith("Gravity")


def test_a_proof_is_made_on_request(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(FALL, encoding="utf-8")
    words = ("fall.yaml", "--engine", "mujoco", "--with", "bodies.box.velocity.linear=[2,0,0]")
    _, out, _ = explain(capsys, *words)
    assert "not proven to be equal (there is no generated/fall/certificate.json); --verify proves it" in joined(out)
    _, out, _ = explain(capsys, *words, "--verify")
    assert "models: each engine holds the values that it was given: L0 to L4" in joined(out)
    assert "(proven here)" in joined(out)


def test_the_initial_state_is_that_of_the_run(runs):
    moved = run(world(FALL), "mujoco", perturb=1e-3)
    assert side_of_run(moved).start is not None
    assert side_of_run(run(world(FALL), "mujoco")).start is None
