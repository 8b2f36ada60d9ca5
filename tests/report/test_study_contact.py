"""Contact figures of proofs in a study: each law, engine and timestep, and only measured figures."""

from __future__ import annotations

import dataclasses
import json
import math
import os

import pytest
from typer.testing import CliRunner

from simspec.cli import app
from simspec.proof.contact.probe import ProbeFigure
from simspec.proof.contact.run import PROBES
from simspec.report.study.tables import FORMS, FigureForm, _cell, law_words
from simspec.report.table import Table, html_data, markdown, two_digits
from simspec.world.types import Hardness, PairContact

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """\
simspec: 1
name: lies
physics: {timestep: 2 ms, duration: 16 ms}
contact:
  materials:
    slick: {friction: 0}
bodies:
  floor: {fixed: true, shapes: [{box: {size: [4, 4, 1]}, pose: {xyz: [0, 0, -0.5]}, material: slick}]}
  cube: {pose: {xyz: [0, 0, 0.05]}, mass: 1 kg, shapes: [{box: {size: [0.1, 0.1, 0.1]}, material: slick}]}
"""
STUDY = """\
simspec_study: 1
name: laws
sweeps:
  slick:
    spec: lies.yaml
    sweep:
      engines: [mujoco, dart]
      over:
        physics.timestep: [2 ms, 4 ms]
      cases:
        of-dart: {engines.dart.settings: {contact_solver: nsgs}}
        compliant: {contact.hardness: {time_constant: 40 ms, damping_ratio: 1}}
        accepted:
          contact.hardness: {time_constant: 40 ms, damping_ratio: 1}
          engines.mujoco: {accept: [contact.hardness.time-constant]}
    show: [contact]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "lies.yaml").write_text(SPEC)
    (folder / "study.yaml").write_text(STUDY)
    before = os.getcwd()
    os.chdir(folder)
    try:
        made = CliRunner().invoke(app, ["study", "study.yaml", "--json"])
        assert made.exit_code in (0, 1), made.output
    finally:
        os.chdir(before)
    return folder


@pytest.fixture(scope="module")
def tables(folder):
    data = json.loads((folder / "runs" / "laws" / "study.json").read_text())
    return {table["name"]: table for table in data["sweeps"]["slick"]}


def cells(shown):
    return [[cell["text"] for cell in row] for row in shown["rows"]]


def test_each_probe_has_a_table_over_the_timesteps(tables):
    rest = tables["contact.rest"]
    assert [cell["text"] for cell in rest["head"]] == ["law", "probed", "settings", "engine", "2 ms", "4 ms"]
    put_down = [row for row in cells(rest) if row[1] == "cube put down"]
    assert [row[:4] for row in put_down] == [
        ["μ 0", "cube put down", "–", "mujoco"],
        ["μ 0", "cube put down", "–", "dart"],
        ["μ 0", "cube put down", "of-dart", "dart"],
    ]
    assert all(float(value) >= 0.0 for row in put_down for value in row[4:])


def test_figures_are_those_of_the_stored_certificates(folder, tables):
    depths = set()
    for path in (folder / "runs" / "laws" / "sweep" / "certificates").iterdir():
        certificate = json.loads(path.read_text())
        for proof in certificate["engines"].values():
            depths |= {
                two_digits(1e6 * abs(figure["measured"]))
                for figure in proof["contact"]
                if figure["probe"] == "rest" and figure["case"] == "ball dropped"
            }
    shown = {value for row in cells(tables["contact.rest"]) if row[1] == "ball dropped" for value in row[4:]}
    assert shown == depths


def test_a_case_without_effect_in_an_engine_is_not_shown_again(tables):
    shown = [row[1:3] for row in cells(tables["contact.push"]) if row[0] == "μ 0"]
    assert shown == [["–", "mujoco"], ["–", "dart"], ["of-dart", "dart"]]


def test_an_unsupported_law_is_reported_once_with_its_reason(tables):
    rows = cells(tables["contact.unsupported"])
    assert [row[0] for row in rows] == ["mujoco", "dart"]
    assert rows[0][1] == "compliant"
    assert "approximately" in rows[0][2]
    assert rows[1][1] == "compliant"  # the other one is no other world for it
    assert "contact.hardness.time-constant" in rows[1][2]


def test_a_law_that_a_single_engine_supports_has_rows_of_that_engine(tables):
    rows = cells(tables["contact.compliance"])
    assert {row[3] for row in rows} == {"mujoco"}
    assert {row[0] for row in rows} == {"μ 0, T 40 ms, ζ 1"}
    assert len({row[1] for row in rows}) == len(rows) == 2


def test_every_probe_has_a_form():
    assert set(PROBES) <= set(FORMS)


def test_without_proofs_nothing_is_shown_as_measured(folder, tmp_path):
    (tmp_path / "lies.yaml").write_text(SPEC)
    (tmp_path / "study.yaml").write_text(STUDY.split("      cases:")[0] + "    show: [contact]\n")
    before = os.getcwd()
    os.chdir(tmp_path)
    try:
        made = CliRunner().invoke(app, ["study", "study.yaml", "--no-verify"])
    finally:
        os.chdir(before)
    assert made.exit_code == 0, made.output
    data = json.loads((tmp_path / "runs" / "laws" / "study.json").read_text())
    shown, unsupported = data["sweeps"]["slick"]
    assert cells(unsupported) == [["none", "–", "every engine supports everything that was requested"]]
    assert "not verified: mujoco at 2 ms" in shown["title"]
    assert shown["rows"] == []


FIGURE = ProbeFigure("push", "a, b", "24 directions", "friction", "", 1.0, 1.05, 0.1)


@pytest.mark.parametrize(
    ("changes", "text", "tone"),
    [
        ({}, "5.0", ""),
        ({"tolerance": 0.01}, "5.0", "bad"),
        ({"deviation": "it slips"}, "5.0", "warning"),
        ({"deviation": "it slips", "tolerance": 0.01}, "5.0", "bad"),
        ({"measured": None}, "no value", "bad"),
        ({"measured": math.nan}, "no value", "bad"),
        ({"expected": 2.0, "measured": 2.0}, "0", ""),
        ({"expected": 0.0, "measured": 0.5}, "no value", "bad"),
    ],
)
def test_the_worst_figure_is_shown_and_marked(changes, text, tone):
    good = dataclasses.replace(FIGURE, measured=1.0)
    cell = _cell(FigureForm(share=True), [good, dataclasses.replace(FIGURE, **changes)])
    assert (cell.text, cell.tone) == (text, tone)


def test_no_figure_is_no_number():
    assert _cell(FigureForm(), None).text == "–"
    assert _cell(FigureForm(), []).text == "–"


def test_numbers_have_two_digits():
    assert [two_digits(value) for value in (0.0, 9e-4, 0.00123, 0.0501, 1.26, 12.6, 1260.0)] == [
        "0", "0", "0.001", "0.050", "1.3", "13", "1260"
    ]  # fmt: skip


def test_laws_in_words():
    law = PairContact("a", "b", 0.5, 0.3, 0.005, 0.02, 0.1, Hardness("time-constant", 0.02, 1.0))
    assert law_words(law) == "μ 0.5, e 0.3, torsional 5 mm, rolling 20 mm, threshold 0.1 m/s, T 20 ms, ζ 1"
    assert law_words(PairContact("a", "b", 0.0, 0.0, hardness=Hardness("native"))) == "μ 0, native hardness"


def test_marks_reach_pages_also_without_colours():
    shown = Table("t", "failed", "declared", "within")
    figures = [{"tolerance": 0.01}, {"deviation": "it slips"}, {}]
    shown.add(*(_cell(FigureForm(share=True), [dataclasses.replace(FIGURE, **figure)]) for figure in figures))
    assert [cell["classes"] for cell in html_data(shown)["rows"][0]] == ["bad", "warning", ""]
    assert markdown(shown).splitlines()[4] == "| **5.0** | *5.0* | 5.0 |"
