"""Final state stands in the tables: bodies and joints by name, engines side by side."""

from __future__ import annotations

import dataclasses
import io
import math

import pytest

from simspec.errors import SpecError
from simspec.language.load import Spec
from simspec.report.console import Screen
from simspec.report.studies import MOST_ROWS, ends, final_table, shown_of
from simspec.world import frames
from simspec.world.types import Joint
from tests.runner.synthetic import column, free_body, run, world

ARM = dataclasses.replace(
    free_body("arm"), joint=Joint("elbow", "hinge", "base", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
)
WALL = dataclasses.replace(free_body("wall"), joint=Joint("w", "fixed"))
SCENE = world(WALL, free_body("base"), ARM)


def moved(name, t):
    turn = frames.from_axis_angle((0.0, 0.0, 1.0), math.pi / 2)
    return column(0.25 * t, 0, 0) if name == "wall" else column(1.5 * t, -0.25 * t, 0.00004 * t, *turn)


def two():
    first, second = run(SCENE, moved, engine="first"), run(SCENE, engine="second")
    first.arrays["q"][-1, 7] = 0.75
    return {"first": first, "second": second}


def text(found) -> str:
    screen = Screen(file=io.StringIO(), width=120)
    screen.print(found)
    return screen.file.getvalue()


def test_roots_that_move_and_all_joints_are_shown():
    shown = text(final_table(two(), ()))
    assert "at 1 s" in shown
    line = next(line for line in shown.splitlines() if "base" in line)
    assert "1.5000 -0.2500 0.0000" in line
    assert "0.0000 0.0000 0.0000" in line
    assert "0.0 0.0 90.0°" in shown
    assert "0.7500 rad" in next(line for line in shown.splitlines() if "elbow" in line)
    assert "wall" not in shown
    assert "arm" not in shown


def test_record_show_chooses():
    shown = text(final_table(two(), ["arm", "wall"]))
    assert "arm" in shown
    assert "wall" in shown
    assert "base" not in shown
    assert "elbow" not in shown
    found = ends(two()["first"], ["elbow", "arm"])
    assert found["joints"] == {"elbow": 0.75}
    assert found["bodies"]["arm"]["xyz"] == [1.5, -0.25, 0.00004]
    assert list(found["bodies"]) == ["arm"]


def test_rows_are_bounded_and_the_rest_is_counted():
    many = world(*(free_body(f"ball_{k:03d}") for k in range(MOST_ROWS + 7)))
    shown = text(final_table({"first": run(many)}, ()))
    assert "and 7 more bodies" in shown
    assert f"ball_{MOST_ROWS - 1:03d}" in shown
    assert f"ball_{MOST_ROWS:03d}" not in shown


def test_runs_without_records_and_values_that_are_not_finite_are_marked():
    nothing = dataclasses.replace(two()["first"], arrays={}, failed="crashed")
    assert final_table({"first": nothing}, ()) is None
    assert ends(nothing, ()) == {}
    runs = two()
    runs["second"].arrays["pose"][-1, 1, 0] = math.nan
    assert "not finite" in text(final_table(runs, ()))


def test_names_of_record_show_must_be_there():
    solid = {"mass": 1, "inertia": {"principal": [1, 1, 1]}, "joint": {"type": "hinge", "axis": [0, 0, 1]}}
    data = {"name": "x", "bodies": {"arm": solid}, "record": {"show": ["arm", "arm_joint"]}}
    plain = Spec.from_data({**data, "record": {}}).resolve()
    assert Spec.from_data(data).resolve() == plain  # `show` is no part of the world, nor of its hash
    with pytest.raises(SpecError, match="there is no body, hinge or slide 'amr'") as error:
        Spec.from_data({**data, "record": {"show": ["arm", "amr"]}}).resolve()
    assert error.value.problems[0].path == "record.show.1"
    assert "arm" in error.value.problems[0].hint


def test_a_stored_run_knows_what_was_to_be_shown():
    first = two()["first"]
    assert shown_of(first) == ()
    kept = dataclasses.replace(first, provenance={**first.provenance, "spec": {"show": ["arm", "wall"]}})
    assert shown_of(kept) == ("arm", "wall")
    for edited in ({"show": "arm"}, {"show": [1, None]}, [], None):
        assert shown_of(dataclasses.replace(first, provenance={**first.provenance, "spec": edited})) == ()
