"""Tables that spreadsheets and LaTeX read as what they are, whatever names they hold."""

from __future__ import annotations

import csv
import io
import math

import pytest

from simspec.analysis.tables import ResultTable, spread
from simspec.comparison.floor import measure_floor
from simspec.comparison.runs import diff
from simspec.comparison.study import Study
from simspec.errors import Location
from simspec.language.foreign import Account, Fate, LossSeverity, grouped
from simspec.report.differences import study_tables
from simspec.report.problems import losses_table
from simspec.report.table import csv_text, latex_text
from tests.runner.synthetic import column, free_body, run, world

WORLD = world(free_body("ball_<1>"), free_body("cube"))


def test_losses_with_the_same_reason_that_change_no_physics_share_a_row():
    def lost(line: int, what: str, severity: LossSeverity, reason: str) -> Account:
        return Account(Location("f", line, 1), what, Fate.LOST, severity, reason)

    accounts = [
        lost(9, "link[a]/mass/@value", LossSeverity.INFORMATION, "left out by a rule"),
        lost(8, "link[a]/inertia/@ixx", LossSeverity.INFORMATION, "left out by a rule"),
        lost(18, "link[b]/inertia/@ixx", LossSeverity.INFORMATION, "left out by a rule"),
        lost(3, "joint[c]/play/@size", LossSeverity.PHYSICS, "no engine has it"),
        lost(4, "joint[c]/slack/@size", LossSeverity.PHYSICS, "no engine has it"),
    ]
    rows = losses_table("f", grouped(accounts)).rows
    assert [row[-1] for row in rows] == ["1", "1", "3"]
    assert [row[0] for row in rows[:2]] == ["joint/play/@size", "joint/slack/@size"]
    assert rows[2][0] in ("link/inertia/@ixx and 1 more", "link/mass/@value and 1 more")


def study() -> Study:
    runs = {
        name: run(WORLD, lambda body, t, by=by: column(by * t, 0.0, 0.0), engine=name)
        for name, by in (("first", 0.0), ("second", 0.5))
    }
    floors = {name: measure_floor(run, [run]) for name, run in runs.items()}
    compared = diff(*runs.values(), floor=list(floors.values()))
    return Study(WORLD, None, runs, {}, floors, {}, (compared,))


def read(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text)))


def test_csv_gives_back_what_was_written():
    table = ResultTable({"name": ['a "b", c', "d\ne"], "value": [0.1, None], "count": [3, 4], "ok": [True, False]})
    assert read(csv_text(table)) == [
        ["name", "value", "count", "ok"],
        ['a "b", c', "0.1", "3", "true"],
        [r"d\ne", "", "4", "false"],
    ]


@pytest.mark.parametrize("name", ["=HYPERLINK(1)", "+1", "-1+2", "@SUM(A1)"])
def test_a_name_is_no_formula(name):
    (_, (cell, number)) = read(csv_text(ResultTable({name: [name], "x": [-1.5]})))
    assert cell == f"'{name}"
    assert number == "-1.5"


def test_latex():
    columns = {"engine": ["a_b & c", r"\input{x}"], "factor": [1234567.0, None], "loss": [-0.25, math.inf]}
    text = latex_text(ResultTable(columns), "50 % of $1", "tab:x}y", {"factor": "real-time factor"})
    assert r"\begin{tabular}{lrr}" in text
    assert r"\caption{50 \% of \$1}" in text
    assert r"\label{tab:xy}" in text
    assert r"engine & real-time factor & loss \\" in text
    assert r"a\_b \& c & $1.235 \cdot 10^{6}$ & $-0.25$ \\" in text
    assert r"\textbackslash{}input\{x\} & -- & $\infty$ \\" in text


def test_spreads_are_medians_with_their_interval():
    text = latex_text(ResultTable({"rtf": [spread([2.0, 2.0])]}))
    assert "2 [2, 2] (2 processes)" in text


@pytest.mark.parametrize("form", ["csv", "tex"])
def test_the_tables_of_a_study(form):
    tables = study_tables(study(), form)
    assert set(tables) == {f"runs.{form}", f"differences.{form}"}
    assert all(name in tables[f"runs.{form}"] for name in ("first", "second"))
    with pytest.raises(ValueError, match="form"):
        study_tables(study(), "docx")


def test_the_figures_in_them():
    rows = read(study_tables(study(), "csv")["differences.csv"])
    ball = dict(zip(rows[0], rows[1], strict=True))
    assert (ball["body"], ball["verdict"], float(ball["largest, m"])) == ("ball_<1>", "out", 0.5)
    rows = read(study_tables(study(), "csv")["runs.csv"])
    assert float(dict(zip(rows[0], rows[1], strict=True))["real_time_factor"]) == 2.0
