"""Test reports, annotations and summaries: their content and order; foreign text is escaped in all of them."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import pytest
from lxml import etree

from simspec.errors import EngineError, Location, Problem, SpecError
from simspec.proof.certificate import EngineProof
from simspec.proof.checks import Check
from simspec.report.tested import (
    Status,
    TestedEntry,
    TestedSuite,
    annotation_lines,
    certificate_suites,
    error_suites,
    file_of,
    is_junit,
    is_summary,
    junit,
    skipped_suites,
    study_suites,
    summary,
    wrong,
)
from simspec.selection import NotTaken
from tests.report.page import samples

SCHEMA = etree.XMLSchema(etree.parse(Path(__file__).with_name("junit.xsd")))
HOSTILE = (*samples.HOSTILE, "50%\r\n::error::owned", "]]>", "a|b `c` [d](javascript:e) @f $g$", "\ud800\u202e")


def locate(path: str) -> Location:
    """Each path has a line of its own."""
    return Location("a spec.yaml", len(path), 3)


def read(text: str) -> etree._Element:
    root = etree.fromstring(text.encode())
    SCHEMA.assertValid(root)
    assert is_junit(text.encode())
    return root


def test_a_study_is_a_suite_for_each_engine_and_each_pair():
    study = samples.a_study()
    suites = study_suites(study, locate, demand_diff=True)
    root = read(junit(suites))
    assert [suite.get("name") for suite in root] == [suite.name for suite in suites]
    assert [suite.get("name") for suite in root][:3] == ["sample / first", "sample / second", "sample / third"]
    assert len(root) == 3 + 3
    names = [case.get("name") for case in root[0]]
    assert names == ["proof L1 mass", "run", "expectation 1 position"]
    failed = root[2].find("testcase/failure")
    assert failed.get("message").startswith("measured ")
    case = failed.getparent()
    assert (case.get("file"), case.get("line")) == ("a spec.yaml", str(len("expect.0")))
    total = [int(root.get(name)) for name in ("tests", "failures", "errors", "skipped")]
    assert total == [sum(int(suite.get(name)) for suite in root) for name in ("tests", "failures", "errors", "skipped")]
    assert total[0] == len(root.findall(".//testcase"))
    assert total[1] == len(root.findall(".//failure")) > 0


def test_differences_without_a_demanded_tolerance_are_reported_as_skipped():
    demanded, suites = (study_suites(samples.a_study(), locate, demand_diff=demand)[3:] for demand in (True, False))
    assert [e.status for suite in suites for e in suite.entries if "not demanded" in e.message] == [Status.SKIPPED] * 2
    assert sum(suite.count(Status.FAILED) for suite in demanded) == 2
    assert sum(suite.count(Status.FAILED) for suite in suites) == 0


def test_a_failed_level_names_its_worst_check_and_a_level_that_was_not_compared_its_reason():
    world = samples.a_world()
    checks = (
        Check("L1", "mass", 4, 1e-9, 1e-3, "bodies.mover.mass", "2.0, should be 1.0"),
        Check("L1", "centre of mass", 4, 1e-9, 1e-1, "mover", ""),
        Check("L2", "poses", 4, 1e-9, 0.0, "", ""),
        Check("L3", "forces", 0, 1e-9, None, "", "crashed"),
    )
    proof = EngineProof("1.0", "0" * 64, checks, not_compared={"L7": "nothing is driven", "L4 pairs": "few"})
    certificate = samples.a_study().certificate
    certificate = dataclasses.replace(certificate, engines={"first": proof})
    (suite,) = certificate_suites(certificate, world, locate)
    entry, two, three, seven = suite.entries
    assert (entry.status, entry.excess) == (Status.FAILED, 1e8)
    assert entry.message == "centre of mass: deviation 0.1, tolerance 1e-09 at mover; 2 of 2 checks failed"
    assert entry.location == locate("bodies.mover")
    assert "2.0, should be 1.0" in entry.detail
    assert two.status is Status.PASSED
    assert (three.status, three.excess) == (Status.FAILED, math.inf)
    assert (seven.status, seven.message) == (Status.SKIPPED, "nothing is driven")
    read(junit([suite]))


def test_an_engine_that_failed_is_an_error_and_its_expectations_are_skipped():
    study = samples.a_study()
    run = dataclasses.replace(study.runs["first"], failed="the process ended\nsegmentation fault")
    outcomes = {**study.outcomes, "first": tuple(dataclasses.replace(o, passed=False) for o in study.outcomes["first"])}
    study = dataclasses.replace(study, runs={**study.runs, "first": run}, outcomes=outcomes)
    root = read(junit(study_suites(study, locate, demand_diff=False)))
    error = root[0].find("testcase/error")
    assert error.get("message") == "the process ended"
    assert "segmentation fault" in error.text
    assert root[0].find("testcase[@name='expectation 1 position']/skipped").get("message") == "the run failed"


def test_unsupported_engines_are_skipped_and_errors_of_a_command_are_errors():
    suites = skipped_suites("arm", {"first": NotTaken("no ball joints", Location("arm.yaml", 3, 1))})
    skipped = read(junit(suites)).find(".//skipped")
    assert skipped.get("message") == "no ball joints"
    assert skipped.getparent().get("line") == "3"
    assert annotation_lines(suites) == []
    problems = [Problem("no mass", f"bodies.b{n}", Location("arm.yaml", n + 1, 1)) for n in range(60)]
    (suite,) = error_suites("arm.yaml", SpecError(problems))
    assert suite.count(Status.ERROR) == 51
    assert suite.entries[-1].message == "10 more problems"
    (suite,) = error_suites("arm.yaml", EngineError("first", "crashed\nwith this"))
    assert (suite.engine, suite.entries[0].message) == ("first", "first: crashed")


@pytest.mark.parametrize("text", HOSTILE)
def test_foreign_text_is_text(text):
    place = Location(f"{text}.yaml", 2, 1)
    entries = [TestedEntry(text, status, text, text, place) for status in Status]
    suites = [TestedSuite(text, text, tuple(entries))]
    root = read(junit(suites))
    assert [len(case) for case in root[0]] == [0, 1, 1, 1]
    assert {element.tag for element in root.iter()} == {
        "testsuites",
        "testsuite",
        "testcase",
        "failure",
        "error",
        "skipped",
    }
    lines = annotation_lines(suites, [Problem(text, text, place)])
    assert len(lines) == 3
    form = re.compile(r"::(error|warning) file=[^,:\r\n]+,line=2,col=1,title=[^,:\r\n]+::[^\r\n]*")
    assert all(form.fullmatch(line) for line in lines)
    shown = summary(suites)
    assert "<script" not in shown
    assert "<img" not in shown
    assert is_summary(shown.encode())
    cells = [re.split(r"(?<!\\)\|", line) for line in shown.splitlines() if line.startswith("|")]
    assert {len(row) for row in cells} == {5, 7}  # a cell's text ends no cell and no line
    assert "](" not in re.sub(r"\\.", "", shown)


def test_escaped_annotations_are_read_back_unchanged():
    text = "100%25 of a:b,c"
    (line,) = annotation_lines([TestedSuite("s", "e", (TestedEntry(text, Status.FAILED, "1\n2%"),))])
    assert line == "::error title=e%3A 100%2525 of a%3Ab%2Cc::s / e: 100%2525 of a:b,c: 1%0A2%25"


def test_the_worst_ten_are_annotated_and_the_rest_is_counted():
    entries = [TestedEntry(f"e{n}", Status.FAILED, "far", excess=float(n)) for n in range(14)]
    entries.append(TestedEntry("broken", Status.ERROR, "crashed"))
    suites = [TestedSuite("arm", "first", tuple(entries))]
    lines = annotation_lines(suites)
    assert len(lines) == 10
    titles = [re.search(r"title=([^:,]*)", line)[1] for line in lines]
    assert titles == [f"first%3A {name}" for name in ("broken", *(f"e{n}" for n in range(13, 5, -1)))] + ["simspec"]
    assert lines[-1].endswith("::6 more: see the test report or the output")
    assert len(annotation_lines([TestedSuite("arm", "first", tuple(entries[:10]))])) == 10
    assert "more" not in annotation_lines([TestedSuite("arm", "first", tuple(entries[:10]))])[-1]
    assert [entry.name for _, entry in wrong(suites)][:2] == ["broken", "e13"]


@pytest.mark.parametrize(
    ("file", "environment", "expected"),
    [
        ("specs/arm.yaml", {}, "specs/arm.yaml"),
        ("{here}/specs/arm.yaml", {}, "specs/arm.yaml"),
        ("arm.yaml", {"GITHUB_WORKSPACE": "{above}"}, "{name}/arm.yaml"),
        ("/elsewhere/arm.yaml", {"GITHUB_WORKSPACE": "{above}"}, "/elsewhere/arm.yaml"),
    ],
)
def test_files_are_named_from_the_root_of_the_repository(tmp_path, monkeypatch, file, environment, expected):
    monkeypatch.chdir(tmp_path)
    words = {"here": tmp_path, "above": tmp_path.parent, "name": tmp_path.name}
    environment = {name: value.format(**words) for name, value in environment.items()}
    assert file_of(Location(file.format(**words), 1, 1), environment) == expected.format(**words)


def test_a_summary_says_the_verdict_first_and_has_a_largest_size():
    study = samples.a_study()
    text = summary(study_suites(study, locate, demand_diff=True), study)
    assert text.splitlines()[1] == "## simspec: sample: failed"
    assert "| second" in text
    entries = [TestedEntry(f"e{n}", Status.FAILED, "far " * 60, excess=n) for n in range(9000)]
    large = summary([TestedSuite("arm", "first", tuple(entries))])
    assert 2**20 - 2000 < len(large.encode()) <= 2**20
    assert re.search(r"\n\d,\d{3} more lines are left out", large)
    assert "| e8999 |" in large
    assert summary([TestedSuite("arm", "first", tuple(entries))], room=100) == ""
    assert summary([TestedSuite("arm", "first", ())]).splitlines()[1] == "## simspec: arm: nothing was tested"
