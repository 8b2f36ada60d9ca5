"""docs/records/corpora.json.gz: answers about robot files of other packages, kept for the next machine."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools" / "corpora"


@pytest.fixture
def tools(monkeypatch, tmp_path):
    """The modules of the tool, with a file of kept answers of its own."""
    monkeypatch.syspath_prepend(str(TOOLS))
    import kept
    import models
    import run

    monkeypatch.setattr(kept, "KEPT", tmp_path / "corpora.json.gz")
    yield kept, models, run
    for name in ("kept", "models", "run", "stages"):
        sys.modules.pop(name, None)


def test_answers_are_restored_where_the_content_is_the_same(tools, tmp_path):
    kept, models, run = tools
    root = tmp_path / "package"
    arm = models.Model("package", root, root / "arm.urdf", "urdf", "1f")
    leg = models.Model("package", root, root / "leg.urdf", "urdf", "2f")
    first, second = tmp_path / "first", tmp_path / "second"
    answers = {"import": {"imported": True, "bodies": 7}, "certify": {"proven": [{"engine": "one", "valid": True}]}}
    for stage, answer in answers.items():
        run.place(first, stage, arm).parent.mkdir(parents=True)
        run.place(first, stage, arm).write_text(json.dumps(answer))
    assert kept.restore([arm, leg], second) == 0
    kept.keep([arm, leg], first)
    assert kept.restore([dataclasses.replace(arm, key="changed"), leg], second) == 0
    assert kept.restore([arm, leg], second) == 2
    assert {stage: run.stored(second, stage, arm) for stage in answers} == answers
    assert run.stored(second, "import", leg) is None


def test_existing_files_are_not_replaced(tools, tmp_path):
    kept, models, run = tools
    root = tmp_path / "package"
    arm = models.Model("package", root, root / "arm.urdf", "urdf", "1f")
    target = run.place(tmp_path / "results", "import", arm)
    target.parent.mkdir(parents=True)
    target.write_text('{"imported": false}')
    kept.keep([arm], tmp_path / "results")
    target.write_text('{"imported": true}')
    assert kept.restore([arm], tmp_path / "results") == 0
    assert run.stored(tmp_path / "results", "import", arm) == {"imported": True}


@pytest.mark.parametrize(
    ("again", "among", "requested"),
    [
        ("", (), []),
        ("failed", (), ["fails"]),
        ("open", (), ["refuses", "fails", "lacks"]),
        ("open", ("two",), ["refuses", "lacks"]),
        ("open", ("one",), ["fails"]),
        ("anew", (), ["proven", "refuses", "fails", "lacks"]),
    ],
)
def test_stale_answers_are_requested_again(tools, tmp_path, monkeypatch, again, among, requested):
    """Answers of other code: two engines, of which a single one or none has proven a file, refused it, failed, or was never
    started."""
    _, models, run = tools
    monkeypatch.setattr(run, "installed", lambda: ("one", "two"))
    monkeypatch.setattr(run, "code", lambda: "today")
    answers = {"proven": [True, True], "refuses": [True, None], "fails": [False, True], "lacks": [True]}
    files = [models.Model("package", tmp_path, tmp_path / f"{name}.urdf", "urdf", name) for name in answers]
    for stage in ("import", "certify"):
        (tmp_path / stage).mkdir()
    for file in files:
        proven = [
            {"engine": name, "valid": valid} for name, valid in zip(("one", "two"), answers[file.key], strict=False)
        ]
        for stage, answer in (("import", {"imported": True}), ("certify", {"proven": proven, "code": "older"})):
            run.place(tmp_path, stage, file).write_text(json.dumps(answer))
    assert [file.key for file in files if run.needed(tmp_path, "certify", file, again, among)] == requested
    known = {file.key: run.stored(tmp_path, "certify", file) for file in files}
    assert {key: run.undecided(tmp_path, "certify", files[0], entry) for key, entry in known.items()} == {
        "proven": [],
        "refuses": ["two"],
        "fails": ["one"],
        "lacks": ["two"],
    }


@pytest.mark.parametrize(("end", "repaired"), [("</robot>", True), ("</robot", False)])
def test_a_refused_file_is_tried_with_all_rules_of_repair(tools, tmp_path, end, repaired):
    """Its moments break the triangle inequality, which a rule repairs; a file that is not XML has no repair."""
    import stages

    file = tmp_path / "robot.urdf"
    inertia = '<inertia ixx="1" iyy="1" izz="3" ixy="0" ixz="0" iyz="0"/>'
    file.write_text(f'<robot name="r"><link name="a"><inertial><mass value="1"/>{inertia}</inertial></link>{end}')
    assert stages._repaired(file, stages.ImportOptions()) is repaired
