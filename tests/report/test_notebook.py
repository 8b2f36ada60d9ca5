"""Notebook output: tables in HTML in which names are escaped, and data frames."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

from simspec.comparison.runs import diff
from simspec.errors import SpecError
from simspec.proof.certificate import Certificate, EngineProof
from tests.runner.synthetic import column, free_body, run, world

NASTY = "<script>alert(1)</script>&"


def made(by: float = 0.5, engine: str = "first", **facts):
    of = dataclasses.replace(world(free_body(NASTY), free_body("cube")), name=NASTY)
    return run(of, lambda name, t: column(by * t, 0.0, 0.0), engine=engine, contacts=[(2, 0, 1, -0.01, 3.0)], **facts)


def test_no_name_is_markup():
    proof = EngineProof("1.0", "", (), approximations={NASTY: NASTY})
    shown = [
        made(),
        dataclasses.replace(made(), failed=NASTY),
        diff(made(), made(0.0, "second")),
        Certificate(NASTY, "", "oracle", {NASTY: proof}, "1"),
    ]
    for result in shown:
        text = result._repr_html_()
        assert text.startswith("<table>")
        assert "<script" not in text
        assert "&lt;script&gt;" in text


def test_notebook_tables_show_the_main_facts():
    assert "<td>2</td>" in made()._repr_html_()  # the real-time factor
    assert "it fell over" in dataclasses.replace(made(), failed="it fell over")._repr_html_()
    text = diff(made(), made(0.0, "second"))._repr_html_()
    assert "<td>out</td>" in text
    assert "500 mm" in text
    assert "not valid" in Certificate("w", "", "o", {"first": EngineProof("1.0", "", ())}, "1")._repr_html_()


@pytest.mark.parametrize("table", ["states", "bodies", "energy", "contacts"])
def test_data_frames_are_the_tables_of_the_files(table, tmp_path):
    pandas = pytest.importorskip("pandas")
    run = made()
    run.save(tmp_path / "run")
    stored = pandas.read_parquet(tmp_path / "run" / f"{table}.parquet")
    pandas.testing.assert_frame_equal(run.to_pandas(table), stored)


def test_a_data_frame_of_bodies():
    pytest.importorskip("pandas")
    frame = made().to_pandas("bodies")
    cube = frame[frame.body == "cube"]
    assert cube.x.to_numpy() == pytest.approx(0.5 * np.arange(11) * 0.1)


def test_unrecorded_tables_have_no_data_frame(monkeypatch):
    pytest.importorskip("pandas")
    with pytest.raises(SpecError, match="recorded no table 'control'") as refused:
        made().to_pandas("control")
    assert "bodies" in str(refused.value)
    with pytest.raises(SpecError, match="recorded nothing"):
        dataclasses.replace(made(), arrays={}).to_pandas()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(SpecError, match="needs pandas"):
        made().to_pandas()
