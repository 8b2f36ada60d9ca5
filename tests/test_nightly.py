"""The lists of what ``make slow`` runs name tests that there are, and leave a part of each to every commit."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import pytest

from tests import nightly


@pytest.mark.parametrize(
    "listed",
    [tuple(nightly.ENGINES), tuple(nightly.CASES), tuple(nightly.NAMED), tuple(nightly.DIAGONALS), nightly.WHOLE],
    ids=["engines", "cases", "named", "diagonals", "whole"],
)
def test_listed_tests_exist(listed):
    suites = "".join(
        path.read_text(encoding="utf-8") for path in (nightly.ROOT.parent / "simspec/testing").glob("*.py")
    )
    assert len(set(listed)) == len(listed)
    for name in listed:
        file, function = name.split("::")
        text = (nightly.ROOT / file).read_text(encoding="utf-8") + (suites if "suite" in file else "")
        assert f"def {function}(" in text, name


def case(name, *parameters, engine=None):
    file, function = name.split("::")
    callspec = SimpleNamespace(params=dict(enumerate(parameters)), id="-".join(map(str, parameters)))
    cls = engine and SimpleNamespace(engine=engine)
    return SimpleNamespace(path=nightly.ROOT / file, originalname=function, name=function, callspec=callspec, cls=cls)


def test_each_commit_runs_quick_engines_the_first_case_and_what_is_not_listed():
    by_engine, some, whole = next(iter(nightly.ENGINES)), next(iter(nightly.CASES)), nightly.WHOLE[0]
    known = ("mujoco", "ode", "dart")
    items = [case(by_engine, name) for name in ("mujoco", "ode", "dart", "mujoco-dart", "no engine")]
    items += [case(by_engine, "none", engine=name) for name in ("ode", "dart")]
    items += [case(some, number) for number in range(nightly.CASES[some] + 1)]
    items += [case(whole, "mujoco"), case("test_nightly.py::test_other", "dart")]
    left = list(nightly.left_out(items, known))
    assert left == [items[2], items[6], *items[8 : 7 + nightly.CASES[some]], items[-2]]


@pytest.mark.parametrize(("rows", "columns"), [(2, 3), (4, 4), (5, 2), (1, 3)])
def test_diagonals_have_every_value_of_either_parameter(rows, columns):
    name, parameters = next(iter(nightly.DIAGONALS.items()))
    items = {pair: case(name, *pair) for pair in itertools.product(range(rows), range(columns))}
    for pair, item in items.items():
        item.callspec.indices = dict(zip(parameters, pair, strict=True))
    left = list(nightly.left_out(items.values(), ()))
    kept = [pair for pair, item in items.items() if item not in left]
    assert len(kept) == max(rows, columns)
    assert [set(values) for values in zip(*kept, strict=True)] == [set(range(rows)), set(range(columns))]


def test_each_world_of_the_suite_is_run_in_every_second_engine_and_the_first_in_all():
    known = [f"engine{place}" for place in range(6)]
    items = {}
    for engine, row in itertools.product(known, range(15)):
        items[engine, row] = case("engines/test_engine_suite.py::test_its_bias_force", row, engine=engine)
        items[engine, row].callspec.indices = {nightly.WORLDS: row}
    left = list(nightly.left_out(items.values(), known))
    of_row = [[engine for engine in known if items[engine, row] not in left] for row in range(15)]
    assert of_row == [known] + [known[1::2], known[0::2]] * 7


def test_cases_are_counted_among_those_that_are_left():
    name = "engines/test_engine_suite.py::test_the_engine_holds_the_world"
    items = []
    for row in range(15):
        items.append(case(name, row, engine="engine0"))
        items[-1].callspec.indices = {nightly.WORLDS: row}
    left = list(nightly.left_out(items, ["engine0", "engine1"]))
    assert [row for row, item in enumerate(items) if item not in left] == [0, 6, 12]


def test_cases_are_left_out_by_words():
    name, (words, *_) = next(iter(nightly.NAMED.items()))
    items = [case(name, text) for text in (f"simspec {words} --engine mujoco", "simspec engines")]
    assert list(nightly.left_out(items, ())) == items[:1]
