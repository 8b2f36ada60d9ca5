"""Pages from published studies: filled, current or not, and never older than the code in silence."""

from __future__ import annotations

import gzip
import json
import shutil

import pytest
from typer.testing import CliRunner

from simspec.cli import app
from simspec.errors import SpecError
from simspec.report.study.pages import OLDER, filled, marks
from simspec.stored import StudyTables

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 20 ms}
bodies:
  ball: {pose: {xyz: [0, 0, 1]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, collision: false}]}
record: {every: 4 ms, channels: [pose, velocity]}
"""
STUDY = """\
simspec_study: 1
name: falls
sweeps:
  steps:
    spec: fall.yaml
    sweep:
      engines: [mujoco]
      over:
        physics.timestep: [1 ms, 4 ms]
      repeat: 2
    small: {}
    show: [determinism]
  other:
    spec: fall.yaml
    sweep:
      engines: [mujoco]
      repeat: 2
    show: [determinism]
"""
PAGE = """\
# Falls

<!-- study falls: measured -->
<!-- end of study -->

<!-- study falls: steps determinism --><!-- end of study -->

At 4 ms: <!-- study falls: steps determinism "4 ms | mujoco" result --><!-- end of study -->.

<!-- study falls: other determinism --><!-- end of study -->
"""


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """A folder with a study that was done and published."""
    folder = tmp_path_factory.mktemp("published")
    for name, text in (("fall.yaml", SPEC), ("study.yaml", STUDY)):
        (folder / name).write_text(text)
    (folder / "docs").mkdir()
    (folder / "docs" / "results.md").write_text(PAGE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        publish()
    return folder


@pytest.fixture
def folder(published, tmp_path, monkeypatch):
    """A copy of it."""
    shutil.copytree(published, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unpublished(folder):
    """The same without the published study."""
    shutil.rmtree(folder / "docs" / "studies")
    return folder


def run(*words, code=0):
    result = CliRunner().invoke(app, list(words))
    assert result.exit_code == code, result.output
    return result


def publish(*words, code=0):
    return run("study", "study.yaml", "--no-verify", "--publish", "docs/studies/falls", *words, code=code)


def test_a_page_is_filled_and_stays_current_until_a_model_changes(folder):
    page = folder / "docs" / "results.md"
    assert "results.md is not what" in run("pages", "docs/results.md", "--check", code=1).stderr
    run("pages", "docs/results.md")
    text = page.read_text()
    assert text.count("2 runs, bitwise equal") == 4  # a row of each timestep, the cell, and the other sweep's
    assert "result -->2 runs, bitwise equal<!-- end of study -->." in text
    assert "- command: simspec study study.yaml" in text
    run("pages", "docs/results.md", "--check")
    assert "already current" in run("pages", "docs/results.md").stdout

    page.write_text(text.replace("bitwise equal", "equal", 1))
    assert "simspec pages docs/results.md writes it" in run("pages", "docs/results.md", "--check", code=1).stderr
    page.write_text(text)

    # a comment changes nothing, the mass does, in every sweep of the scenario
    (folder / "fall.yaml").write_text(SPEC.replace("bodies:", "bodies:  # one"))
    run("pages", "docs/results.md", "--check")
    (folder / "fall.yaml").write_text(SPEC.replace("1 kg", "2 kg"))
    stderr = run("pages", "docs/results.md", "--check", code=1).stderr
    assert (
        "sweep steps, are older than the code: 2 of 2 models differ (world: 2), first mujoco, physics.timestep=1 ms"
        in stderr
    )
    assert page.read_text() == text
    run("pages", "docs/results.md", code=1)
    assert page.read_text() == text  # not silently
    run("pages", "docs/results.md", "--older")
    assert page.read_text().count(OLDER) == 2
    assert "equal (older than the code)<!-- end" in page.read_text()
    run("pages", "docs/results.md", "--check")

    (folder / "fall.yaml").write_text(SPEC)
    run("pages", "docs/results.md", "--check", code=1)  # it says too much
    run("pages", "docs/results.md")
    assert page.read_text() == text


@pytest.mark.parametrize(
    ("before", "after", "why"),
    [
        ("repeat: 2\n    small", "repeat: 3\n    small", "the study requests something else"),
        ("[1 ms, 4 ms]", "[1 ms, 2 ms]", "2 of 3 models differ (new: 1, no longer requested: 1)"),
        ("engines: [mujoco]", "engines: [pybullet]", "no longer requested"),
        (
            "repeat: 2\n    small",
            "repeat: 2\n      cases: {a: {engines.mujoco.settings: {iterations: 9}}}\n    small",
            "new: 2",
        ),
        ("  steps:", "  stairs:", "the study has no such sweep any more"),
    ],
)
def test_check_fails_after_a_change_of_the_study(folder, before, after, why):
    run("pages", "docs/results.md")
    (folder / "study.yaml").write_text(STUDY.replace(before, after, 1))
    assert why in run("pages", "docs/results.md", "--check", code=1).stderr


def test_settings_and_versions_are_listed(folder):
    run("pages", "docs/results.md")
    (folder / "fall.yaml").write_text(SPEC + "engines: {mujoco: {settings: {iterations: 7}}}\n")
    assert "(settings: 2)" in run("pages", "docs/results.md", "--check", code=1).stderr
    (folder / "fall.yaml").write_text(SPEC)
    path = folder / "docs" / "studies" / "falls" / "models.json"
    path.write_text(path.read_text().replace('"version": "', '"version": "0.'))
    assert "(version: 2)" in run("pages", "docs/results.md", "--check", code=1).stderr


def test_the_small_study_lacks_a_sweep_and_says_so(unpublished):
    publish("--small")
    run("pages", "docs/results.md")
    assert "Not part of the small study" in (unpublished / "docs" / "results.md").read_text()
    run("pages", "docs/results.md", "--check")


def test_edited_results_and_runs_of_earlier_models_are_refused(folder):
    path = folder / "docs" / "studies" / "falls" / "study.json.gz"
    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes()).replace(b"bitwise", b"hardly")))
    assert "was edited or is damaged" in run("pages", "docs/results.md", code=2).stderr

    # a store whose index leads to runs of another model, as that of changed code does
    from simspec.experiments import after_sweep as published

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(published, "stored_key", lambda *words: "0" * 64)
        assert "models that this code no longer makes" in publish(code=2).stderr


def test_an_absolute_path_of_a_study_is_not_published(folder):
    stderr = run("study", str(folder / "study.yaml"), "--publish", "docs/studies/falls", code=2).stderr
    assert "other machines" in stderr


def tables(text: str = "1 <b>|") -> StudyTables:
    cell = {"text": text, "classes": ""}
    shown = {
        "name": "speed",
        "title": "T",
        "said": ["It is *fast*."],
        "head": [cell],
        "rows": [[cell]],
        "note": "",
        "records": [],
    }
    plain = {"schema": 2, "study": "s", "description": "", "small": False, "figures": "", "said": [], "bad": []}
    plain |= {"sweeps": {"a b": [shown]}, "measured": [{"what": "day", "value": "today"}]}
    return StudyTables.model_validate_json(json.dumps(plain))


def test_text_in_tables_is_escaped():
    text = '<!-- study s: "a b" speed --><!-- end of study -->'
    made = filled(text, "p", lambda name: tables("<!-- end of study -->"), [])
    assert filled(made, "p", lambda name: tables("<!-- end of study -->"), []) == made
    assert filled('<!-- study s: "a b" speed said -->x<!-- end of study -->', "p", lambda name: tables(), []) == (
        '<!-- study s: "a b" speed said -->\n- It is \\*fast\\*.\n<!-- end of study -->'
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<!-- study s: measured -->", "has no end"),
        ("<!-- study s: measured --><!-- study s: measured --><!-- end of study -->", "has no end"),
        ("x <!-- end of study -->", "without a beginning"),
        ("<!-- study s: one -->\n<!-- end of study -->", "not a place of a study"),
        ("<!-- study s: one two three -->\n<!-- end of study -->", "not a place of a study"),
        ('<!-- study s: "one -->\n<!-- end of study -->', "No closing quotation"),
    ],
)
def test_marks_that_are_not_understood(text, message):
    with pytest.raises(SpecError, match=message):
        marks(text, "page.md")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("other speed", "has no sweep 'other'"),
        ('"a b" load', "has no table 'load'"),
        ('"a b" speed row column', "not one cell"),
    ],
)
def test_places_that_the_study_does_not_have(words, message):
    with pytest.raises(SpecError, match=message):
        filled(f"\n<!-- study s: {words} --><!-- end of study -->", "page.md", lambda name: tables(), [])


def test_a_page_may_say_that_its_study_was_not_measured_yet(unpublished):
    page = unpublished / "docs" / "results.md"
    run("pages", "docs/results.md", "--check", "--older", code=1)
    run("pages", "docs/results.md", "--older")
    assert page.read_text().count("Not measured yet.") == 4
    run("pages", "docs/results.md", "--check")
    publish()
    run("pages", "docs/results.md", "--check", code=1)
    run("pages", "docs/results.md")
    assert "Not measured yet." not in page.read_text()


def test_a_page_without_its_study(unpublished):
    assert "is not a published study" in run("pages", "docs/results.md", code=2).stderr
    assert "no such page" in run("pages", "docs/none.md", code=2).stderr
