"""``simspec report`` and ``simspec run --report``: written files and refusals."""

from __future__ import annotations

import dataclasses
import html
import json
import re
import shutil

import pytest

from simspec import cli
from simspec.commands import run as run_command
from simspec.commands.scenario_options import RunOptions
from simspec.errors import EXIT_OK, EXIT_WRONG, Location
from simspec.outputs.targets import read_marker
from simspec.report.page.document import is_page
from simspec.report.screen import PAGE_FILE
from simspec.selection import NotTaken, named
from tests.report.page import samples


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return samples.stored(samples.a_study(), tmp_path_factory.mktemp("kept") / "sample")


@pytest.fixture
def folder(kept, tmp_path):
    return shutil.copytree(kept, tmp_path / "sample")


def call(*words: object) -> int:
    return cli.main([str(word) for word in words])


@pytest.mark.parametrize("below", [".", "first"], ids=["study", "run"])
def test_the_page_is_in_the_folder_and_known_as_simspecs(folder, capsys, below):
    place = folder / below
    assert call("report", place) == EXIT_OK
    assert is_page((place / PAGE_FILE).read_bytes())
    assert PAGE_FILE in read_marker(place).files
    assert capsys.readouterr().out == f"written: {place / PAGE_FILE}\n"


def test_several_studies_share_a_page(folder, tmp_path, capsys):
    other = samples.stored(samples.a_study(samples.a_world(title="other")), tmp_path / "other")
    assert call("report", folder, other) == EXIT_WRONG
    assert "use -o FILE" in capsys.readouterr().err
    assert call("report", folder, other, "-o", tmp_path / "both.html", "--json") == EXIT_OK
    said = json.loads(capsys.readouterr().out)
    text = (tmp_path / "both.html").read_text(encoding="utf-8")
    assert said["bytes"] == len(text.encode())
    assert "<h2>sample</h2>" in text
    assert "<h2>other</h2>" in text


def test_a_page_replaces_a_page_and_nothing_else(folder, tmp_path, capsys):
    target = tmp_path / "page.html"
    assert call("report", folder, "-o", target) == EXIT_OK
    assert call("report", folder / "first", "-o", target) == EXIT_OK
    target.write_text("<!doctype html><p>mine</p>")
    assert call("report", folder, "-o", target) == EXIT_WRONG
    assert target.read_text() == "<!doctype html><p>mine</p>"
    (folder / PAGE_FILE).write_text("mine")
    assert call("report", folder) == EXIT_WRONG
    assert (folder / PAGE_FILE).read_text() == "mine"


DAMAGE = {
    "a table cut short": ("second/bodies.parquet", lambda content: content[: len(content) // 2], "bodies.parquet"),
    "a table of other bits": ("second/states.parquet", lambda content: content[:-1] + b"x", "states.parquet"),
    "provenance that is no JSON": ("second/provenance.json", lambda content: content[1:], "provenance.json"),
    "an edited provenance": (
        "second/provenance.json",
        lambda content: content.replace(b'"engine_version": "1.0"', b'"engine_version": "2.0"'),
        "provenance.json",
    ),
    "another world": ("second/world.json", lambda content: content.replace(b"mover", b"mowed"), "world.json"),
    "a floor of other bits": ("first/floor.parquet", lambda content: content[:100], "floor.parquet"),
    "an edited certificate": (
        "certificate.json",
        lambda content: content.replace(b"1e-16", b"2e-16"),
        "certificate.json",
    ),
    "a report that is none": ("report.json", lambda content: b"[]", "report.json"),
    "a report with no tolerance": (
        "report.json",
        lambda content: content.replace(b'"tolerance": 0.001', b'"tolerance": "much"'),
        "report.json",
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_is_named_and_nothing_is_written(folder, capsys, kind):
    name, change, said = DAMAGE[kind]
    content = (folder / name).read_bytes()
    assert change(content) != content
    (folder / name).write_bytes(change(content))
    assert call("report", folder) == EXIT_WRONG
    assert said in capsys.readouterr().err
    assert not (folder / PAGE_FILE).exists()


def test_a_folder_without_a_study_is_refused(tmp_path, capsys):
    for place, said in ((tmp_path / "nowhere", "no such folder"), (tmp_path, "neither a saved run nor a study")):
        assert call("report", place) == EXIT_WRONG
        assert said in capsys.readouterr().err


def test_runs_of_another_world_are_left_out_and_named(folder, capsys):
    samples.a_run(samples.a_world(title="earlier"), "fourth", 0.0).save(folder / "fourth")
    assert call("report", folder) == EXIT_OK
    text = (folder / PAGE_FILE).read_text(encoding="utf-8")
    assert "fourth is of another world" in text
    assert text.count("<th") == (text.replace("fourth", "")).count("<th")


def test_a_study_that_was_ended_before_its_report(folder, capsys):
    (folder / "report.json").unlink()
    assert call("report", folder) == EXIT_OK
    samples.a_run(samples.a_world(title="earlier"), "fourth", 0.0).save(folder / "fourth")
    assert call("report", folder) == EXIT_WRONG
    assert "runs of 2 worlds" in capsys.readouterr().err


def keeping(made):
    """A stand-in for a study of engines: it delivers made-up results part by part."""

    def study(world, engines, *, arrivals, **_):
        arrivals.certificate(made.certificate)
        for run in made.runs.values():
            arrivals.run(run)
        for floor in made.floors.values():
            arrivals.floor(floor)
        return made

    return study


def run_sample(made, folder, monkeypatch, page: bool = True, not_taken=None) -> None:
    """``simspec run`` of the sample; ``not_taken``: the engines that the command leaves out."""
    monkeypatch.setattr(run_command, "study", keeping(made))
    run_command.run_world(
        RunOptions(spec="", report=page),
        made.world,
        dataclasses.replace(named(list(made.runs)), not_taken=not_taken or {}),
        folder,
    )


def test_run_report_writes_the_page_and_a_later_run_without_it_removes_it(tmp_path, monkeypatch, capsys):
    made = samples.a_study()
    folder = tmp_path / "sample"

    def run(page: bool) -> None:
        run_sample(made, folder, monkeypatch, page)

    for _ in range(2):
        run(page=True)
        assert f"report: {folder / PAGE_FILE}" in capsys.readouterr().out
        assert is_page((folder / PAGE_FILE).read_bytes())
    run(page=False)
    assert "was of earlier runs and was removed" in " ".join(capsys.readouterr().out.split())
    assert not (folder / PAGE_FILE).exists()


def not_run(folder) -> dict[str, str]:
    """The table of engines that did not run, as the page has it."""
    page = (folder / PAGE_FILE).read_text()
    table = re.search(r"<caption>Not run</caption>(.*?)</table>", page, re.DOTALL)
    cells = re.findall(r"<td[^>]*>(.*?)</td>", table.group(1), re.DOTALL) if table else []
    return dict(zip(cells[::2], cells[1::2], strict=True))


def test_engines_that_did_not_run_are_on_the_page_with_the_reason(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "sample"
    refused = NotTaken("Rapier has no <b>joints</b>", Location("some.yaml", 7, 3))
    absent = NotTaken("not installed: pip install 'simspec-physics[physx]'")
    run_sample(samples.a_study(), folder, monkeypatch, not_taken={"rapier": refused, "physx": absent})
    assert html.unescape(not_run(folder)["rapier"]) == "Rapier has no <b>joints</b> (some.yaml:7:3)"
    assert "<b>joints" not in not_run(folder)["rapier"]
    assert html.unescape(not_run(folder)["physx"]) == "not installed: pip install 'simspec-physics[physx]'"
    assert "not run" in capsys.readouterr().out
    # a page that is made later of the folder says the same, as does one after a run of one engine more
    (folder / PAGE_FILE).unlink()
    assert call("report", folder) == EXIT_OK
    assert "rapier" in not_run(folder)
    run_sample(samples.a_study(engines=("first", "second")), folder, monkeypatch)
    assert set(not_run(folder)) == {"rapier", "physx"}
    # an engine that runs after all is no longer one that did not
    run_sample(samples.a_study(engines=("first", "rapier")), folder, monkeypatch)
    assert set(not_run(folder)) == {"physx"}
