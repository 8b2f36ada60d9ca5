"""Limits in a study: largest deviations, the first failure, controls that must fail, costs of a step, and the largest timestep
at which models are proven."""

from __future__ import annotations

import json
import os
from importlib.util import find_spec
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from simspec.analysis.validity import KINDS
from simspec.cli import app
from simspec.errors import SpecError
from simspec.language.load import load_study_file
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check, failed
from simspec.report.study.validity import certified_tables, words

pytestmark = [
    pytest.mark.skipif(find_spec("pybullet") is None, reason="PyBullet has no wheel for this Python"),
    pytest.mark.usefixtures("warm_engines"),
]

SPEC = """\
simspec: 1
name: bounce
physics: {timestep: 1 ms, duration: 60 ms}
contact:
  materials:
    rubber: {friction: 0}
bodies:
  floor: {fixed: true, shapes: [{plane: {}, material: rubber}]}
  ball: {pose: {xyz: [0, 0, 0.105]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
record: {every: 20 ms, channels: [pose, velocity, contacts]}
expect:
  - at_target: {targets: {ball: [0, 0, 0.1]}, tolerance: 2.5 mm, at: 60 ms}
  - no_penetration_deeper_than: {depth: 5 mm}
"""
STUDY = """\
simspec_study: 1
name: limits
sweeps:
  drop:
    spec: bounce.yaml
    sweep:
      engines: [mujoco, pybullet]
      over:
        physics.timestep: [1 ms, 7 ms]
      cases:
        weak: {physics.gravity: [0, 0, -1]}
        thrown: {bodies.ball.velocity.linear: [1, 0, 0]}
        heavy: {physics.gravity: [0, 0, -11]}
      repeat: 2
      times: round_up
    fails: [weak, heavy]
    show: [validity, failures, cases, cost, certified]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("limits")
    (folder / "bounce.yaml").write_text(SPEC)
    (folder / "study.yaml").write_text(STUDY)
    before = os.getcwd()
    os.chdir(folder)
    try:
        result = CliRunner().invoke(app, ["study", "study.yaml", "--no-verify", "--json"])
    finally:
        os.chdir(before)
    assert result.exit_code == 1, result.output
    return json.loads(result.stdout)


def texts(study, name):
    (table,) = [table for table in study["sweeps"]["drop"] if table["name"] == name]
    return [[cell["text"] for cell in row] for row in table["rows"]], table


def test_the_largest_deviation_by_timestep(made):
    rows, shown = texts(made, "validity.deviations")
    assert [row[0] for row in rows] == ["1 ms", "7 ms"]
    assert all("fails" not in cell for row in rows for cell in row)
    assert [(record["engine"], record["runs"], record["valid"]) for record in shown["records"][:2]] == [
        ("mujoco", 1, 1),
        ("pybullet", 1, 1),
    ]
    assert all(0.0 <= record["deviation"] <= 0.0025 for record in shown["records"])
    assert "tolerance 2.5 mm" in shown["note"]


def test_nothing_failed_is_said(made):
    rows, shown = texts(made, "failures")
    assert rows == [["–", "–", "0 of 4", "no run failed", "–"]]
    assert shown["records"] == []


def test_controls_must_fail_and_a_passing_control_is_reported(made):
    rows, shown = texts(made, "cases")
    assert [row[2] for row in rows[:4]] == ["–", "weak (expected to fail)", "thrown", "heavy (expected to fail)"]
    by_case = {(row[0], row[1], row[2].split()[0]): row for row in rows}
    assert len(by_case) == 16
    for timestep in ("1 ms", "7 ms"):
        for engine in ("mujoco", "pybullet"):
            assert by_case[timestep, engine, "–"][3] == "1 of 1"
            assert by_case[timestep, engine, "weak"][3] == "0 of 1"
            assert KINDS["not-moved"] in by_case[timestep, engine, "weak"][6]
            assert KINDS["missed"] in by_case[timestep, engine, "thrown"][6]
            assert "ball 6" in by_case[timestep, engine, "thrown"][6], "60 mm off, or 63"
            assert by_case[timestep, engine, "heavy"][6] == "does NOT fail, as is expected of it"
    lines = [made["said"][index] for index in made["bad"]]
    assert lines == [
        f"drop: heavy was expected to fail, and 1 of 1 runs hold in {engine} at {timestep}"
        for timestep in ("1 ms", "7 ms")
        for engine in ("mujoco", "pybullet")
    ]
    assert {record["fails"] for record in shown["records"] if record["case"] in ("weak", "heavy")} == {True}


def test_the_cost_of_a_step_is_measured(made):
    rows, shown = texts(made, "cost")
    assert [row[:2] for row in rows] == [[step, name] for step in ("1 ms", "7 ms") for name in ("mujoco", "pybullet")]
    assert all(row[-1] == "2" for row in rows)
    for record in shown["records"]:
        assert 0.0 <= record["quiet"] <= record["median"] * (1 + 1e-9)
    factor = next(record for record in shown["records"] if record["part"] == "step" and record["timestep"] == 0.001)
    assert float(rows[0][2].replace(",", "")) == pytest.approx(0.001 / factor["quiet"], rel=1e-3)


def test_rounded_times_are_reported(made):
    assert any(
        "times rounded up at physics.timestep=7 ms: physics.duration 0.06 s to 0.063 s" in text for text in made["said"]
    )


def test_without_proofs_nothing_is_certified(made):
    rows, _ = texts(made, "certified")
    assert [row[1] for row in rows] == ["nothing was verified"] * 2
    assert texts(made, "certified.checks")[0][0] == ["1 ms", "mujoco", "not verified"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("fails: [none]", "no case of this name"),
        ("fails: [weak, weak]", "duplicated"),
    ],
)
def test_controls_must_be_cases(tmp_path, words, message):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY.replace("fails: [weak, heavy]", words))
    with pytest.raises(SpecError, match=message):
        load_study_file(path)


def test_controls_are_shown(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY.replace("failures, cases,", "failures,"))
    with pytest.raises(SpecError, match="the cases are not shown"):
        load_study_file(path)


# --- certificates ---------------------------------------------------------------------------------------------------------

GOOD = Check("L1", "mass", 3, 1e-9, 1e-12, "cup")


def certificate(*checks):
    return Certificate("cup", "0" * 64, "oracle 1", {"one": EngineProof("1.0", "0" * 64, checks)}, "1").to_json()


def certified(proofs, refused=()):
    """The tables for certificates by engine and timestep (ms)."""
    runs = []
    for (engine, step), text in proofs.items():
        cell = SimpleNamespace(engine=engine, key=f"{engine} {step}")
        why = "does not support this world: no cups" if (engine, step) in refused else None
        runs.append((cell, SimpleNamespace(timestep=step * 1e-3, failed=why), text))
    kept = {cell.key: text for cell, _, text in runs if text is not None}
    done = SimpleNamespace(
        sweep=SimpleNamespace(name="cups"),
        engines=tuple(dict.fromkeys(engine for engine, _ in proofs)),
        runs=lambda: [(cell, row) for cell, row, _ in runs],
        outcome=SimpleNamespace(index=SimpleNamespace(certificates={key: key for key in kept})),
        store=SimpleNamespace(certificate_text=kept.get),
    )
    return certified_tables(done)


def test_certified_up_to_the_first_timestep_whose_proof_fails():
    bad = certificate(
        GOOD, Check("L5", "slip", 9, 1e-3, 2.5e-3, "cup on saucer"), Check("L5", "rest", 9, 1e-3, 5e-3, "cup")
    )
    good = certificate(GOOD)
    limits, checks = certified({("a", 8): bad, ("a", 1): good, ("a", 2): good, ("a", 16): good, ("b", 1): bad})
    first, second = limits.records
    assert (first["limit"], first["first_invalid"], first["later_valid"]) == (0.002, 0.008, [0.016])
    assert (second["limit"], second["first_invalid"]) == (None, 0.001)
    assert limits.column(1) == ["2 ms", "no timestep"]
    column = checks.column(2)
    assert column[0] == "L5 rest: 0.005, tolerance 0.001 (cup); L5 slip: 0.0025, tolerance 0.001 (cup on saucer)"
    assert {(record["timestep"], record.get("check")) for record in checks.records if record["engine"] == "a"} == {
        (0.001, None), (0.002, None), (0.008, "slip"), (0.008, "rest"), (0.016, None),
    }  # fmt: skip


def test_a_certificate_that_compares_nothing_is_none():
    limits, checks = certified({("a", 1): certificate()})
    assert limits.records[0]["limit"] is None
    assert checks.column(2)[0] == "nothing was compared"


def test_an_unverified_timestep_ends_the_limit():
    limits, checks = certified({("a", 1): certificate(GOOD), ("a", 2): None, ("a", 4): certificate(GOOD)}, [])
    assert (limits.records[0]["limit"], limits.records[0]["first_invalid"]) == (0.001, 0.002)
    assert checks.column(2)[0] == "not verified"
    refused = certified({("a", 1): None}, [("a", 1)])[1]
    assert "no cups" in refused.column(2)[0]


def test_a_damaged_certificate_is_an_error():
    with pytest.raises(SpecError, match="damaged"):
        certified({("a", 1): certificate(GOOD).replace("cup", "mug")})


def test_the_worst_checks_come_first_and_the_rest_is_counted():
    checks = [Check("L5", f"probe {k}", 1, 1e-3, k * 1e-2, "") for k in range(1, 5)]
    assert words(checks) == (
        "L5 probe 4: 0.04, tolerance 0.001; L5 probe 3: 0.03, tolerance 0.001; L5 probe 2: 0.02, tolerance 0.001; and 1 more"
    )
    assert words([*checks[:1], failed("L6", "energy", "the engine died")]).startswith("L6 energy: the engine died; L5")
