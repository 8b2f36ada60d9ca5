"""Hard defects of SDF files, and what the page says of proofs that fail: parts of the tool that share nothing with simspec."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools" / "corpora"
LINK = """<sdf version="1.6"><model name="m">{static}<link name="l"><inertial><mass>{mass}</mass>
<inertia><ixx>1</ixx><iyy>1</iyy><izz>{izz}</izz></inertia></inertial>
<collision name="c"><geometry><mesh><uri>{uri}</uri></mesh></geometry></collision></link>{joint}</model></sdf>"""
SOUND = {"static": "", "mass": "2", "izz": "1.5", "uri": "link.stl", "joint": ""}
TO_WORLD = '<joint name="j" type="fixed"><parent>world</parent><child>l</child></joint>'


@pytest.fixture
def tools(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    import defects
    import findings

    yield defects, findings
    for name in ("defects", "findings"):
        del sys.modules[name]


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({}, []),
        ({"mass": "0"}, ["a moving link has no mass"]),
        ({"mass": "0", "static": "<static>true</static>"}, []),
        ({"mass": "0", "joint": TO_WORLD}, []),
        ({"mass": "0", "joint": TO_WORLD.replace("fixed", "revolute")}, ["a moving link has no mass"]),
        ({"mass": "heavy"}, ["no number"]),
        ({"izz": "2.1"}, ["the triangle inequality"]),
        ({"izz": "2.000001"}, []),
        ({"izz": "-1"}, ["a moment that is not above 0"]),
        ({"uri": "other.stl"}, ["a file that is not there"]),
        ({"uri": "model://m/link.stl"}, []),
        ({"uri": "model://m/other.stl"}, ["a file that is not there"]),
        ({"joint": "<joint>"}, ["not well-formed"]),
    ],
)
def test_hard_defects_of_sdf(tools, tmp_path, change, found):
    defects, _ = tools
    (tmp_path / "link.stl").write_bytes(b"solid")
    path = tmp_path / "model.sdf"
    path.write_text(LINK.format(**{**SOUND, **change}), encoding="utf-8")
    assert defects.sdf_defects(path, tmp_path) == found


def test_remarks_on_a_proof_that_fails(tools):
    _, findings = tools
    assert findings.remark("one", "arm.urdf", "L3 mass matrix", False) == ""
    late = "L1 engine one: no result within its deadline of 60 s, at work on 'motion'"
    assert "verdict of time" in findings.remark("one", "arm.urdf", late, False)
    assert "not repeated since" in findings.remark("one", "arm.urdf", "L3 mass matrix", True)
    for engine, name in findings.FINDINGS:
        assert findings.FINDINGS[engine, name] in findings.remark(engine, f"folder/{name}", "", False)
        assert findings.remark("none", name, "", False) == ""
