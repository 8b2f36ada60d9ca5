"""Tables of a study beyond speed: known answers of two falling balls, and tables that say where nothing was compared."""

from __future__ import annotations

import json
from importlib.util import find_spec

import pytest
from typer.testing import CliRunner

from simspec.cli import app

pytestmark = [
    pytest.mark.skipif(find_spec("pybullet") is None, reason="PyBullet has no wheel for this Python"),
    pytest.mark.usefixtures("warm_engines"),
]

SPEC = """\
simspec: 1
name: drop
physics: {timestep: 1 ms, duration: 200 ms}
contact:
  materials:
    rubber: {friction: 0}
bodies:
  floor: {fixed: true, shapes: [{plane: {}, material: rubber}]}
  low: {pose: {xyz: [0, 0, 0.1]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
  high: {pose: {xyz: [1, 0, 2]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
record: {every: 4 ms, channels: [pose, velocity, contacts, energy]}
"""
STUDY = """\
simspec_study: 1
name: drops
sweeps:
  whole:
    spec: drop.yaml
    sweep:
      engines: [mujoco, pybullet]
      over:
        physics.timestep: [1 ms, 2 ms, 4 ms]
      perturb: {amount: 0.001, seeds: 5}
    show: [distributions, consistency, conservation, penetration]
  chaos:
    spec: drop.yaml
    set: {bodies.high.pose.xyz: [0.001, 0, 0.302], physics.timestep: 1 ms, physics.duration: 400 ms}
    sweep:
      engines: [mujoco, pybullet]
      perturb: {amount: 1.0e-15, seeds: 1}
    gap_seeds: 2
    show: [divergence]
  bare:
    spec: drop.yaml
    set: {record.channels: [pose, velocity]}
    sweep:
      engines: [mujoco, pybullet]
    show: [distributions, consistency, conservation, penetration]
"""


@pytest.fixture(scope="module")
def sheets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "drop.yaml").write_text(SPEC)
    (folder / "study.yaml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        result = CliRunner().invoke(app, ["study", "study.yaml", "--no-verify", "--json"])
    assert result.exit_code == 0, result.output
    sweeps = json.loads(result.stdout)["sweeps"]
    return {sweep: {sheet["name"]: sheet for sheet in sheets} for sweep, sheets in sweeps.items()}


def texts(sheet):
    return [[cell["text"] for cell in row] for row in sheet["rows"]]


def test_consistency_is_the_drift_of_free_fall(sheets):
    """The high ball falls freely: two timesteps differ by ½ g t Δdt, first order, and by it divided by √2 in the mean of both
    balls, of which one stays where it is."""
    records = sheets["whole"]["consistency"]["records"]
    assert {(record["coarse"], record["fine"]) for record in records} == {(0.004, 0.002), (0.002, 0.001)}
    at_the_end = [record for record in records if record["time"] == pytest.approx(0.2)]
    assert len(at_the_end) == 4
    for entry in at_the_end:
        assert entry["drift"] == pytest.approx(0.5 * 9.81 * 0.2 * (entry["coarse"] - entry["fine"]), rel=1e-3)
        assert entry["largest"] == pytest.approx(entry["drift"], rel=1e-2)
        assert entry["rms"] == pytest.approx(entry["drift"] / 2**0.5, rel=2e-2)
    orders = [entry["order"] for entry in at_the_end if entry["coarse"] == 0.004]
    assert orders == [pytest.approx(1.0, abs=0.05)] * 2
    assert all(entry["order"] is None for entry in at_the_end if entry["coarse"] == 0.002)


def test_conservation_is_reported_for_bodies_without_external_forces(sheets):
    records = {(record["timestep"], record["engine"]): record for record in sheets["whole"]["conservation"]["records"]}
    assert len(records) == 6
    for (timestep, _), entry in records.items():
        assert entry["linear"] == pytest.approx(0.0, abs=1e-9)
        assert entry["angular"] == pytest.approx(0.0, abs=1e-9)
        assert any("not every step is recorded" in note for note in entry["notes"]) == (timestep < 0.004)


def test_penetration_is_that_of_the_ball_that_rests(sheets):
    records = sheets["whole"]["penetration"]["records"]
    assert [record["runs"] for record in records] == [6] * 6
    for entry in records:
        assert entry["pair"] == ["floor", "low"]
        assert 0.0 < entry["mean"] <= entry["deepest"] < 5e-3


def test_distributions_pair_runs_by_seed(sheets):
    tests = sheets["whole"]["distributions.tests"]["records"]
    assert [test["pairs"] for test in tests] == [6] * 3
    for test in tests:
        assert test["paired"]["smallest"] == pytest.approx(2 / 2**6)
        assert test["paired"]["can_reject"]
        assert test["seeds_in_one_only"] == test["left_out"] == []
    summary = sheets["whole"]["distributions.summary"]["records"][0]
    assert summary["seeds"] == [0, 1, 2, 3, 4, 5]
    # 2 − ½ g t² of the high one, and 0.1 of the low one that rests, moved by up to a thousandth
    assert summary["mean_height"][0] == pytest.approx((2.0 - 0.5 * 9.81 * 0.2**2 + 0.1) / 2, abs=2e-3)
    assert len(set(summary["mean_height"])) == 6


def test_a_second_pass_is_moved_by_the_first_gap(sheets):
    (record,) = sheets["chaos"]["divergence"]["records"]
    assert record["noise_measured"]
    assert record["second_measured"]
    assert record["gap"] > 1e-9
    assert record["gap_body"] in ("low", "high")
    assert not any("of another size" in note or "chaos may hide" in note for note in record["notes"])
    assert record["second_horizon"] is None or record["second_horizon"] > record["gap_time"] > 0.0


def test_single_runs_cannot_be_distinguished_and_the_table_says_so(sheets):
    (row,) = texts(sheets["bare"]["distributions.tests"])
    assert row[2] == "1"
    assert row[5].startswith("cannot reject: with so few runs p is at least 1")
    assert "not compared: deepest_penetration" in row[4]
    assert not sheets["bare"]["distributions.tests"]["records"][0]["paired"]["can_reject"]


def test_missing_records_are_reported(sheets):
    for name in ("conservation", "penetration"):
        rows = texts(sheets["bare"][name])
        assert len(rows) == 2
        assert all("did not record contacts" in " ".join(row) for row in rows)
    rows = texts(sheets["bare"]["consistency"])
    assert all("fewer than two timesteps" in row[2] for row in rows)
