"""Contacts and overlaps with known times, impulses and depths."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec import files
from simspec.analysis.conservation import penetration
from simspec.analysis.distributions import compare_contacts, total_jaccard, touches
from simspec.comparison.common import Common, common_sides, first_difference
from simspec.comparison.runs import diff
from simspec.errors import SpecError
from simspec.world.types import Shape
from tests.runner.synthetic import free_body, run, world

WORLD = world(free_body("floor"), free_body("ball"), free_body("cube"))
"""11 records, one each 0.1 s."""
FLOOR, BALL, CUBE = range(3)


def touching(*contacts, **facts):
    return run(WORLD, contacts=sorted(contacts), **facts)


@pytest.fixture(params=["whole", "in blocks"])
def blocks(request, monkeypatch):
    """Long recordings are gone through block by block: the same comes out."""
    if request.param == "in blocks":
        monkeypatch.setattr(files, "BLOCK_BYTES", 400)


@pytest.mark.usefixtures("blocks")
def test_the_impulse_is_the_integral_of_the_force():
    """10 N at three points over rows 2 … 4 (0.3 s): 9 N s; the order of a pair does not matter."""
    rows = [(row, *pair, -0.01, 10.0) for row in (2, 3, 4) for pair in ((FLOOR, BALL), (BALL, FLOOR), (FLOOR, BALL))]
    given = touches(touching(*rows, (9, CUBE, BALL, -0.01, 5.0)))
    assert set(given) == {("ball", "floor"), ("ball", "cube")}
    floor, cube = given["ball", "floor"], given["ball", "cube"]
    assert (floor.impulse, floor.seconds, floor.first) == pytest.approx((9.0, 0.3, 0.2))
    assert (cube.impulse, cube.seconds, cube.first) == pytest.approx((0.5, 0.1, 0.9))


def test_the_initial_state_lasts_no_time():
    given = touches(touching((0, FLOOR, BALL, -0.01, 10.0)))
    assert (given["ball", "floor"].impulse, given["ball", "floor"].seconds) == (0.0, 0.0)


@pytest.mark.usefixtures("blocks")
def test_contacts_are_matched_by_pair_and_time():
    """Rows 1 … 4 in one, 3 … 6 in the other: 0.2 s of 0.6 s. The second world lists its bodies in another order."""
    entry = touching(*((row, FLOOR, BALL, -0.01, 10.0) for row in range(1, 5)))
    turned = world(free_body("cube"), free_body("ball"), free_body("floor"))
    rows = [(row, 2, 1, -0.01, 20.0) for row in range(3, 7)]
    other = run(turned, contacts=[*rows, (8, 0, 1, -0.01, 30.0)], engine="second")
    first, second = compare_contacts(entry, other)
    assert first.pair == ("ball", "floor")
    assert (first.first_seconds, first.second_seconds, first.both_seconds) == pytest.approx((0.4, 0.4, 0.2))
    assert (first.first_impulse, first.second_impulse) == pytest.approx((4.0, 8.0))
    assert first.jaccard == pytest.approx(1 / 3)
    assert (second.pair, second.jaccard, second.second_impulse) == (("ball", "cube"), 0.0, pytest.approx(3.0))
    assert total_jaccard((first, second)) == pytest.approx(2 / 7)
    assert total_jaccard(()) is None


def test_equal_runs_touch_alike():
    entry = touching(*((row, FLOOR, BALL, -0.01, 10.0) for row in (2, 3, 3, 5)))
    (only,) = compare_contacts(entry, entry)
    assert only.jaccard == 1.0
    assert only.first_impulse == only.second_impulse == pytest.approx(4.0)


def test_contacts_must_be_recorded():
    bare = touching()
    bare = dataclasses.replace(bare, arrays={k: v for k, v in bare.arrays.items() if not k.startswith("contact.")})
    for call in (touches, penetration, lambda entry: compare_contacts(entry, touching())):
        with pytest.raises(SpecError, match="did not record contacts"):
            call(bare)


@pytest.mark.usefixtures("blocks")
def test_depths():
    """1 mm in rows 2 and 3, 4 mm in row 4, a gap of 1 mm in row 6."""
    entry = touching(
        (2, FLOOR, BALL, -0.001, 1.0),
        (3, FLOOR, BALL, -0.001, 1.0),
        (3, FLOOR, CUBE, -0.0005, 1.0),
        (4, FLOOR, CUBE, -0.004, 1.0),
        (6, FLOOR, BALL, 0.001, 0.0),
    )
    depths = penetration(entry)
    assert (depths.deepest.depth, depths.deepest.time) == pytest.approx((0.004, 0.4))
    assert depths.depth == pytest.approx(np.array([0, 0, 1, 1, 4, 0, 0, 0, 0, 0, 0]) * 1e-3)
    assert depths.pairs == pytest.approx({("ball", "floor"): 0.001, ("cube", "floor"): 0.004})
    assert depths.mean == pytest.approx(0.002)
    assert depths.share_deeper(0.0) == pytest.approx(0.3)
    assert depths.share_deeper(0.002) == pytest.approx(0.1)


def test_a_depth_that_is_not_finite_is_the_deepest():
    depths = penetration(touching((2, FLOOR, BALL, math.nan, 1.0), (3, FLOOR, BALL, -0.001, 1.0)))
    assert math.isnan(depths.deepest.depth)
    assert depths.depth.max() == math.inf


def test_nothing_overlaps():
    depths = penetration(touching())
    assert (depths.deepest.depth, depths.mean, depths.pairs, depths.share_deeper(0.0)) == (0.0, 0.0, {}, 0.0)


SHAPES = {"floor": ("left", "right"), "ball": ("ball_0",), "cube": ("top", "side", "foot")}
SHAPED = world(
    *(
        dataclasses.replace(free_body(name), shapes=tuple(Shape(shape, "box", (1.0, 1.0, 1.0)) for shape in shapes))
        for name, shapes in SHAPES.items()
    )
)
LEFT, RIGHT, ROUND, TOP, SIDE, FOOT, GROUP = range(7)
"""Sides of contacts: shapes in the order of the bodies, then a group."""
BODY = {LEFT: 0, RIGHT: 0, ROUND: 1, TOP: 2, SIDE: 2, FOOT: 2, GROUP: 2}


def of_shapes(*contacts, groups=(), engine="first"):
    """A run whose contacts are (row, side, side, force)."""
    rows = [(row, BODY[entry], BODY[other], -0.01, force) for row, entry, other, force in contacts]
    given = run(SHAPED, contacts=rows, engine=engine, contact_groups=[list(group) for group in groups])
    sides = np.array([pair[1:3] for pair in contacts], dtype=np.int64).reshape(-1, 2)
    return dataclasses.replace(given, arrays={**given.arrays, "contact.shape": sides})


def without_shapes(first):
    arrays = {name: values for name, values in first.arrays.items() if name != "contact.shape"}
    facts = {name: value for name, value in first.provenance.items() if name != "contact_groups"}
    return dataclasses.replace(first, arrays=arrays, provenance=facts)


def test_contacts_are_matched_by_shape():
    """The ball rests on the left in one run and on the right in the other: by bodies they would touch alike."""
    shapes = of_shapes((2, LEFT, ROUND, 10.0), (3, ROUND, LEFT, 10.0))
    other = of_shapes((2, ROUND, RIGHT, 10.0), (3, RIGHT, ROUND, 10.0), engine="second")
    given = {pair.pair: pair for pair in compare_contacts(shapes, other)}
    assert set(given) == {("ball", "floor (left)"), ("ball", "floor (right)")}
    assert all(pair.jaccard == 0.0 for pair in given.values())
    assert given["ball", "floor (left)"].first_impulse == pytest.approx(2.0)
    assert given["ball", "floor (left)"].second_impulse == 0.0
    (by_body,) = compare_contacts(shapes, other, by="body")
    assert (by_body.pair, by_body.jaccard) == (("ball", "floor"), 1.0)
    assert set(touches(shapes)) == {("ball", "floor (left)")}
    assert set(touches(shapes, by="body")) == {("ball", "floor")}
    assert penetration(shapes).pairs == {("ball", "floor (left)"): 0.01}
    with pytest.raises(ValueError, match="by shape or by body"):
        compare_contacts(shapes, other, by="material")


def test_shapes_that_a_run_does_not_distinguish_are_matched_together():
    """The second engine reports top and side as a group, the first distinguishes them; both report the foot."""
    shapes = of_shapes((2, TOP, ROUND, 10.0), (3, SIDE, ROUND, 10.0), (4, FOOT, ROUND, 10.0))
    rows = [(2, GROUP, ROUND, 10.0), (3, GROUP, ROUND, 10.0), (4, ROUND, FOOT, 10.0)]
    other = of_shapes(*rows, groups=[("top", "side")], engine="second")
    given = {pair.pair: pair for pair in compare_contacts(shapes, other)}
    assert set(given) == {("ball", "cube (top, side)"), ("ball", "cube (foot)")}
    assert all(pair.jaccard == 1.0 for pair in given.values())
    assert given["ball", "cube (top, side)"].first_impulse == pytest.approx(2.0)
    assert common_sides((shapes, other)).notes == (
        "second 1.0 does not distinguish some shapes of cube in contact: they are matched together",
    )


def test_groups_that_overlap_are_merged():
    shapes = of_shapes((2, GROUP, ROUND, 10.0), groups=[("top", "side")])
    other = of_shapes((2, GROUP, ROUND, 10.0), groups=[("side", "foot")], engine="second")
    (only,) = compare_contacts(shapes, other)
    assert (only.pair, only.jaccard) == (("ball", "cube"), 1.0)


def test_a_run_without_shapes_is_matched_by_bodies_and_that_is_said():
    shapes = of_shapes((2, LEFT, ROUND, 10.0))
    bare = without_shapes(of_shapes((2, RIGHT, ROUND, 10.0), engine="second"))
    (only,) = compare_contacts(shapes, bare)
    assert (only.pair, only.jaccard) == (("ball", "floor"), 1.0)
    assert common_sides((shapes, bare)).notes == (
        "second 1.0 does not tell the shapes of contacts: they are matched by bodies",
    )
    assert diff(shapes, bare).first_contact is None
    assert any("matched by bodies" in note for note in diff(shapes, bare).notes)


def test_the_first_contact_that_differs_names_shapes():
    shapes = of_shapes((2, LEFT, ROUND, 10.0), (5, TOP, ROUND, 1.0))
    other = of_shapes((2, LEFT, ROUND, 10.0), (5, FOOT, ROUND, 1.0), (5, RIGHT, SIDE, 1.0), engine="second")
    given = diff(shapes, other)
    assert given.contact_first_difference == pytest.approx(0.5)
    assert given.first_contact.first_only == (("ball", "cube (top)"),)
    assert given.first_contact.second_only == (("ball", "cube (foot)"), ("cube (side)", "floor (right)"))
    assert first_difference(*_common(shapes, other), by="body").second_only == (("cube", "floor"),)


def _common(first, other):
    return Common(first, other, ["ball"], []), first, other
