"""Elements of foreign files: their accounts are bounded, whatever the depth of the tree they are in."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.imports import elements
from simspec.imports.draft import plain
from simspec.imports.elements import DEEPEST, MOST_LABELS, parse


def deep(count: int, inside: str) -> bytes:
    opening = "".join(f'<a name="{"n" * 50}{depth:03}">' for depth in range(count))
    return f"<r>{opening}{inside}{'</a>' * count}</r>".encode()


def test_paths_of_deep_trees_are_short():
    root = parse(deep(DEEPEST - 2, '<b x="1"/>' * 50), "a.xml")
    for element in root.within():
        element.take()
        for name in element.attributes:
            element.word(name)
    accounts = list(root.accounts())
    assert len(accounts) == 1 + 2 * (DEEPEST - 2) + 2 * 50
    assert max(len(account.what) for account in accounts) < 80 * (sum(MOST_LABELS) + 2)
    last = accounts[-2].what.split("/")
    assert last[0].endswith("000]")
    assert last[MOST_LABELS[0]] == "..."
    assert last[-2].endswith(f"{DEEPEST - 3}]")
    assert last[-1] == "b"


def test_paths_of_shallow_trees_are_whole():
    count = sum(MOST_LABELS) - 1
    root = parse(deep(count, "<b/>"), "a.xml")
    *_, last = root.within()
    assert last.path.count("/") == count
    assert "..." not in last.path


def test_accounts_are_in_the_order_of_the_file_and_say_once_what_is_lost():
    root = parse(b"<r><a><b/><c><d/></c></a><e><f/></e><g/></r>", "a.xml")
    (a,) = root.children("a")
    a.children("b")
    root.children("g")
    assert [account.what for account in root.accounts()] == ["r", "a", "a/b", "a/c", "e", "g"]


def test_attributes_are_counted_before_they_are_read(monkeypatch):
    monkeypatch.setattr(elements, "MOST_ATTRIBUTES", 10)
    assert parse(b"<r " + b" ".join(b"a%d='1'" % number for number in range(10)) + b"/>", "a.xml")
    with pytest.raises(SpecError, match=r"a\.xml:1:1: .*too large"):
        parse(b"<r " + b" ".join(b"a%d='1'" % number for number in range(11)) + b"/>", "a.xml")


def test_excess_is_counted(monkeypatch):
    monkeypatch.setattr(elements, "MOST_TAGS", 10)
    with pytest.raises(SpecError, match=r"too large\n  found:   .*11 tags"):
        parse(b"<r>" + b"<a/>" * 9 + b"</r>", "a.xml")


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan")])
def test_values_that_are_not_finite_are_left_to_the_language(value):
    assert repr(plain(value)) == repr(value)


def test_deviations_that_readers_of_robots_accept_are_read():
    text = b"<a>\n<!-- one -- two --->\n<b c='1'd=\"2 '3'\"e='\"'/>\n<f g='x'/></a>"
    root = parse(text, "r.xml")
    (first, second) = root.look()
    assert first.attributes == {"c": "1", "d": "2 '3'", "e": '"'}
    assert (first.location.line, second.location.line) == (3, 4)
    with pytest.raises(SpecError, match="not XML"):
        parse(b"<a b='1' b='2'/>", "r.xml")
    with pytest.raises(SpecError, match="not XML"):
        parse(b"<a b=1/>", "r.xml")
    with pytest.raises(SpecError, match=r"r\.xml:3:\d+: not XML: mismatched tag in <b> of line 2"):
        parse(b"<a>\n<b>\n</a>", "r.xml")


def test_an_element_of_several_lines_is_placed_where_it_begins():
    (inner,) = parse(b"<a>\n<b\n c='1'\n/></a>", "r.xml").look()
    assert inner.location.line == 2
