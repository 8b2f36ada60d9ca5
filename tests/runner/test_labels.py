"""Shapes that touch: by number in every engine, groups where an engine reports no more, and runs without them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.errors import SpecError
from simspec.runner.execution import run
from simspec.runner.labels import Labels, contact_sides, labels_of, side_names
from simspec.runner.store import load_run
from simspec.testing.bench import Bench
from simspec.testing.contact_suite import two_materials_on_a_body
from simspec.world.types import RecordOptions, Shape
from tests.installed import JOINTED
from tests.runner import synthetic

pytestmark = pytest.mark.usefixtures("warm_engines")

BALL = tuple(Shape(f"ball_{number}", "sphere", (0.1,)) for number in range(3))
WORLD = synthetic.world(
    dataclasses.replace(synthetic.free_body("floor"), shapes=(Shape("floor_0", "plane", ()),)),
    dataclasses.replace(synthetic.free_body("ball"), shapes=BALL),
)
UNITS = [
    {"body": 1, "shapes": ["ball_2", "ball_0"]},
    {"body": 0, "shapes": ["floor_0"]},
    {"body": 1, "shapes": ["ball_1"]},
    {"body": 1, "shapes": ["ball_0", "ball_2"]},
    {"body": 1, "shapes": []},
]
"""Units 0 and 3 are copies of the same shapes; nothing touches unit 4."""


def shaped(groups=(("ball_0", "ball_2"),), contacts=((1, 0, 1, -0.002, 3.0), (4, 1, 0, 0.1, 0.0))):
    entry = synthetic.run(WORLD, contacts=list(contacts), contact_groups=[list(group) for group in groups])
    sides = np.array([(0, 4), (2, 0)][: len(contacts)], dtype=np.int64).reshape(-1, 2)
    return dataclasses.replace(entry, arrays={**entry.arrays, "contact.shape": sides})


def test_units_of_the_same_shapes_are_merged_into_a_side():
    values = np.array([(1, 0), (3, 1), (2, 1)], dtype=np.int64)
    sides, groups = contact_sides(WORLD, UNITS, values)
    assert groups == [["ball_0", "ball_2"]]
    assert sides.tolist() == [[0, 4], [4, 0], [2, 0]]
    names = side_names(WORLD, labels_of({"contact_groups": groups}))
    assert names == ["floor_0", "ball_0", "ball_1", "ball_2", "ball_0|ball_2"]


def test_units_that_nothing_touches_make_no_groups():
    assert contact_sides(WORLD, UNITS, np.zeros((0, 2), np.int64))[1] == []


@pytest.mark.parametrize(
    "groups",
    [
        [["ball_0"]],
        [[]],
        [["ball_0", "floor_0"]],
        [["ball_0", "nothing"]],
        [["nothing", "more"]],
        [["ball_0", "ball_1"], ["ball_0", "ball_1"]],
    ],
)
def test_groups_that_cannot_be_are_refused(groups):
    with pytest.raises(ValueError, match="contact_groups"):
        side_names(WORLD, Labels(groups=tuple(map(tuple, groups))))


@pytest.mark.parametrize("given", ["ball", ["ball_0"], 3, [3]])
def test_groups_of_another_form_are_refused(given):
    with pytest.raises((ValueError, TypeError)):
        labels_of({"contact_groups": given})


@pytest.mark.parametrize("contacts", [((1, 0, 1, -0.002, 3.0), (4, 1, 0, 0.1, 0.0)), ()])
def test_shapes_come_back_from_disk(tmp_path, contacts):
    entry = shaped(contacts=contacts)
    entry.save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    assert again.arrays["contact.shape"].shape == (len(contacts), 2)
    np.testing.assert_array_equal(again.arrays["contact.shape"], entry.arrays["contact.shape"])
    assert again.provenance["contact_groups"] == [["ball_0", "ball_2"]]


def test_the_table_names_the_shapes():
    table = shaped().to_pandas("contacts")
    assert table["first_shape"].tolist() == ["floor_0", "ball_1"]
    assert table["second_shape"].tolist() == ["ball_0|ball_2", "floor_0"]


def test_a_run_without_shapes_is_stored_as_before(tmp_path):
    bare = synthetic.run(WORLD, contacts=[(1, 0, 1, -0.002, 3.0)])
    bare.save(tmp_path / "run")
    assert "contact.shape" not in load_run(tmp_path / "run").arrays
    assert "first_shape" not in bare.to_pandas("contacts")


def test_groups_that_are_not_those_of_the_table_are_refused(tmp_path):
    entry = shaped()
    other = dataclasses.replace(entry, provenance={**entry.provenance, "contact_groups": [["ball_0", "ball_1"]]})
    for name, which in (("run", entry), ("other", other)):
        which.save(tmp_path / name)
    # the tables of one with the provenance of the other: the hash of the file gives it away
    (tmp_path / "other" / "contacts.parquet").write_bytes((tmp_path / "run" / "contacts.parquet").read_bytes())
    with pytest.raises(SpecError, match="hash differs"):
        load_run(tmp_path / "other")


@pytest.mark.parametrize("engine", JOINTED)
def test_every_engine_that_is_shipped_tells_the_shapes(engine, tmp_path):
    """A box of two shapes of one material, on two tiles: an engine may tell them as a group."""
    world = Bench(engine, None, tmp_path).allowed(two_materials_on_a_body("a", "a"))
    assert world is not None
    record = RecordOptions(20, ("pose", "velocity", "contacts"))
    entry = run(
        dataclasses.replace(world, record=record, physics=dataclasses.replace(world.physics, steps=100)), engine
    )
    names = np.array(side_names(world, labels_of(entry.provenance)))
    pairs = {tuple(sorted(pair)) for pair in names[entry.arrays["contact.shape"]].tolist()}
    tiles = {shape.name for body in world.bodies[:-1] for shape in body.shapes}
    assert {side for pair in pairs for side in pair} - tiles in ({"near", "far"}, {"near|far"})
    assert len(pairs) == 2
