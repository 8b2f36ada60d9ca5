"""A test report in the XML form that CI systems read ("JUnit"): one ``testsuite`` for each spec and engine.

``error``: it could not be done (an engine failed); ``failure``: a proof, an expectation or a comparison failed; ``skipped``:
with the reason. ``file`` and ``line`` of a ``testcase`` are read by several systems, and are in no standard.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from simspec.errors import visible
from simspec.report.tested import Entry, Status, Suite, counts, file_of

BEGINNING = '<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="simspec"'
"""How each of these files begins: what simspec may replace."""
ELEMENTS = {Status.FAILED: "failure", Status.ERROR: "error", Status.SKIPPED: "skipped"}
LONGEST_DETAIL = 20_000
"""Characters of the text of one entry."""


def own_junit(content: bytes) -> bool:
    """Whether simspec wrote a file."""
    return content.startswith(BEGINNING.encode())


def junit(suites: Sequence[Suite]) -> str:
    """The report as XML text. Whatever names and messages contain is text in it; control characters are
    escaped as in Python."""
    total = counts(suites)
    root = ElementTree.Element("testsuites", {"name": "simspec", **_numbers(total), "time": _seconds(suites)})
    for suite in suites:
        numbers = _numbers({status: suite.count(status) for status in Status})
        element = ElementTree.SubElement(
            root, "testsuite", {"name": visible(suite.name), **numbers, "time": _seconds([suite])}
        )
        for entry in suite.entries:
            _add(element, suite, entry)
    ElementTree.indent(root, " ")
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


def _numbers(by_status: dict[Status, int]) -> dict[str, str]:
    names = {"failures": Status.FAILED, "errors": Status.ERROR, "skipped": Status.SKIPPED}
    return {"tests": str(sum(by_status.values())), **{name: str(by_status[status]) for name, status in names.items()}}


def _seconds(suites: Sequence[Suite]) -> str:
    return f"{sum(entry.seconds for suite in suites for entry in suite.entries):.3f}"


def _add(parent: ElementTree.Element, suite: Suite, entry: Entry) -> None:
    attributes = {"name": visible(entry.name), "classname": visible(f"{suite.spec}.{suite.engine}")}
    attributes["time"] = f"{entry.seconds:.3f}"
    if entry.location is not None:
        attributes |= {"file": visible(file_of(entry.location)), "line": str(entry.location.line)}
    element = ElementTree.SubElement(parent, "testcase", attributes)
    if entry.status in ELEMENTS:
        told = {"message": visible(entry.message)}
        if entry.status is not Status.SKIPPED:
            told["type"] = entry.status.value
        child = ElementTree.SubElement(element, ELEMENTS[entry.status], told)
        if entry.detail:
            child.text = visible(entry.detail[:LONGEST_DETAIL], lines=True)
