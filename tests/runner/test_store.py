"""A saved run comes back bit for bit, and what is no whole run is refused with the reason."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from simspec.errors import EngineError, SpecError
from simspec.runner.run import failed_run
from simspec.runner.store import is_run, load_run
from simspec.world.coordinates import coordinates
from simspec.world.types import Joint
from tests import worlds
from tests.runner.synthetic import free_body, run, world


def noisy(contacts=((1, 0, 1, -0.002, 3.0), (4, 1, 0, 0.1, 0.0))):
    """A run whose every number is another one."""
    generator = np.random.default_rng(5)
    one = run(world(free_body("a"), free_body("b")), contacts=list(contacts))
    for name, array in one.arrays.items():
        if name not in ("step", "time", "contact.row", "contact.body"):
            array[...] = generator.normal(size=array.shape)
    return one


@pytest.mark.parametrize("contacts", [((1, 0, 1, -0.002, 3.0), (4, 1, 0, 0.1, 0.0)), ()])
def test_every_array_comes_back_bit_for_bit(tmp_path, contacts):
    one = noisy(contacts)
    one.save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    assert set(again.arrays) == set(one.arrays)
    for name, array in one.arrays.items():
        assert np.array_equal(again.arrays[name], array), name
        assert again.arrays[name].shape == array.shape, name
    assert again.world == one.world
    assert again.provenance == one.provenance
    assert (again.engine, again.failed) == (one.engine, one.failed)


def test_the_tables_are_made_for_people(tmp_path):
    import pyarrow.parquet

    one = noisy()
    one.save(tmp_path / "run")
    bodies = pyarrow.parquet.read_table(tmp_path / "run" / "bodies.parquet").to_pylist()
    assert [row["body"] for row in bodies[:3]] == ["a", "b", "a"]
    assert bodies[3]["time"] == one.time[1]
    assert bodies[3]["qw"] == one.arrays["pose"][1, 1, 3]
    assert bodies[3]["wz"] == one.arrays["velocity"][1, 1, 5]
    contacts = pyarrow.parquet.read_table(tmp_path / "run" / "contacts.parquet").to_pylist()
    assert (contacts[1]["first"], contacts[1]["second"], contacts[1]["step"]) == ("b", "a", 40)


def test_not_a_number_survives(tmp_path):
    one = noisy()
    one.arrays["pose"][-1] = np.nan
    dataclasses.replace(one, failed="the state is not finite").save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    assert np.isnan(again.arrays["pose"][-1]).all()
    assert again.failed == "the state is not finite"


def test_a_run_that_gave_nothing_is_kept(tmp_path):
    engine = "mujoco"
    one = failed_run(worlds.spheres(2), engine, EngineError(engine, "the process was ended by signal 11"))
    one.save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    assert again.failed == "the process was ended by signal 11"
    assert not again.recorded


def test_saving_replaces_what_simspec_wrote_and_no_more(tmp_path):
    folder = tmp_path / "run"
    noisy().save(folder)
    (folder / "mine.txt").write_text("mine")
    failed_run(worlds.spheres(2), "mujoco", EngineError("mujoco", "nothing came")).save(folder)
    names = {path.name for path in folder.iterdir()}
    assert names == {"simspec-folder.json", "mine.txt", "provenance.json", "world.json"}
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_worlds_without_coordinates(tmp_path):
    wall = dataclasses.replace(free_body("wall"), joint=Joint("w", "fixed"))
    one = run(world(wall))
    one.save(tmp_path / "run")
    assert load_run(tmp_path / "run").arrays["q"].shape == one.arrays["q"].shape


def damage(name: str, change) -> object:
    def work(folder: Path) -> None:
        path = folder / name
        text = change(json.loads(path.read_text()))
        path.write_text(json.dumps(text))

    return work


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: (folder / "provenance.json").unlink(), "provenance.json is missing"),
        (lambda folder: (folder / "world.json").unlink(), "world.json is missing"),
        (lambda folder: (folder / "world.json").write_text("{"), "cannot be read"),
        (lambda folder: (folder / "bodies.parquet").write_bytes(b"PAR1"), "cannot be read"),
        (lambda folder: (folder / "bodies.parquet").unlink(), "bodies.parquet is missing"),
        (damage("provenance.json", lambda facts: {**facts, "schema": 99}), "schema 99"),
        (damage("world.json", lambda plain: {**plain, "name": "other"}), "not the one that was run"),
        (damage("world.json", lambda plain: {**plain, "more": 1}), "cannot be read"),
    ],
)
def test_damage_is_refused_with_the_reason(tmp_path, spoil, words):
    folder = tmp_path / "run"
    noisy().save(folder)
    spoil(folder)
    with pytest.raises(SpecError, match=words):
        load_run(folder)


def test_a_folder_of_something_else_is_no_run(tmp_path):
    assert not is_run(tmp_path)
    with pytest.raises(SpecError, match="no saved run"):
        load_run(tmp_path)


def test_the_columns_of_states_and_control_have_names(tmp_path):
    import pyarrow.parquet

    base = free_body("base")
    elbow = dataclasses.replace(
        free_body("arm"), joint=Joint("elbow", "hinge", "base", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    )
    wrist = dataclasses.replace(
        free_body("hand"), joint=Joint("wrist", "ball", "arm", position=(1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 3)
    )
    one = run(world(base, elbow, wrist), control={"joints": ["elbow"]})
    generator = np.random.default_rng(5)
    for name in ("q", "v"):
        one.arrays[name][...] = generator.normal(size=one.arrays[name].shape)
    for name in ("target", "effort"):
        one.arrays[f"control.{name}"] = generator.normal(size=(len(one.time), 1))
    one.save(tmp_path / "run")
    states = pyarrow.parquet.read_table(tmp_path / "run" / "states.parquet")
    free = ["base.x", "base.y", "base.z", "base.qw", "base.qx", "base.qy", "base.qz"]
    ball = ["wrist.qw", "wrist.qx", "wrist.qy", "wrist.qz"]
    rates = [f"base.{name}" for name in ("vx", "vy", "vz", "wx", "wy", "wz")]
    rates += ["elbow", *(f"wrist.{name}" for name in ("wx", "wy", "wz"))]
    assert states.column_names == [
        *("step", "time"),
        *(f"q.{name}" for name in (*free, "elbow", *ball)),
        *(f"v.{name}" for name in rates),
    ]
    assert states["v.base.wx"].to_numpy().tolist() == one.arrays["v"][:, 3].tolist()
    assert states["q.elbow"].to_numpy().tolist() == one.arrays["q"][:, 7].tolist()
    control = pyarrow.parquet.read_table(tmp_path / "run" / "control.parquet")
    assert control.column_names == ["step", "time", "target.elbow", "effort.elbow"]
    again = load_run(tmp_path / "run")
    for name, array in one.arrays.items():
        assert np.array_equal(again.arrays[name], array), name
    # by name from Python, too
    assert np.array_equal(again.q("elbow"), one.arrays["q"][:, 7])
    assert np.array_equal(again.q("base"), one.arrays["q"][:, :7])
    assert np.array_equal(again.q("wrist"), one.arrays["q"][:, 8:])
    assert np.array_equal(again.v("base.wx"), one.arrays["v"][:, 3])
    assert np.array_equal(again.effort("elbow"), one.arrays["control.effort"][:, 0])
    assert np.array_equal(again.target("elbow"), one.arrays["control.target"][:, 0])
    with pytest.raises(SpecError, match="did you mean 'elbow'"):
        again.q("elbw")
    with pytest.raises(SpecError, match="no controller drives 'wrist'"):
        again.effort("wrist")


def test_a_free_body_and_a_ball_joint_of_one_name_keep_columns_of_their_own():
    ball = dataclasses.replace(
        free_body("hand"), joint=Joint("base", "ball", "base", position=(1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 3)
    )
    names = coordinates(world(free_body("base"), ball))
    assert len(set(names.q)) == len(names.q) == 11
    assert len(set(names.v)) == len(names.v) == 9


def test_more_coordinates_than_a_table_has_columns_for_are_lists(tmp_path, monkeypatch):
    import pyarrow.parquet

    from simspec.runner import store

    monkeypatch.setattr(store, "MOST_COLUMNS", 20)
    one = noisy()
    one.save(tmp_path / "run")
    states = pyarrow.parquet.read_table(tmp_path / "run" / "states.parquet")
    assert states.column_names == ["step", "time", "q", "v"]
    told = json.loads(states.schema.metadata[b"simspec.coordinates"])
    assert told == {"q": list(one.coordinates.q), "v": list(one.coordinates.v)}
    again = load_run(tmp_path / "run")
    assert np.array_equal(again.arrays["q"], one.arrays["q"])
    bare = states.replace_schema_metadata({})
    pyarrow.parquet.write_table(bare, tmp_path / "run" / "states.parquet")
    with pytest.raises(SpecError, match="other coordinates than the world"):
        load_run(tmp_path / "run")


def test_a_run_of_the_older_layout_says_so(tmp_path):
    folder = tmp_path / "run"
    noisy().save(folder)
    damage("provenance.json", lambda facts: {**facts, "schema": 1})(folder)
    with pytest.raises(SpecError, match="has schema 1, this simspec reads 2"):
        load_run(folder)
