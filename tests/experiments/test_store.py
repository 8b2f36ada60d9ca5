"""The store of sweeps: runs come back to the bit, and what is damaged, edited, mixed or newer is named and never used."""

from __future__ import annotations

import dataclasses
import gzip
import json
import os
import shutil

import numpy as np
import pytest

from simspec.errors import SpecError
from simspec.experiments.index import CELLS_FILE, INDEX_FILE, refresh
from simspec.experiments.store import RUN_FILE, Store, place_of, result_of
from simspec.runner.run import Run
from simspec.world.canonical import sha256
from simspec.world.types import EngineOptions, Expectation
from tests.runner.synthetic import free_body, run, world

WORLD = world(free_body("ball"), expect=(Expectation("no_penetration_deeper_than", (("depth", 0.1),)),))
KEYS = [f"{index:x}" * 64 for index in range(1, 5)]


def made(engine: str = "first", of=WORLD, **facts: object) -> Run:
    seconds = {"step": 0.25, "cpu": 0.2, "process": 0.5}
    return run(
        of, lambda name, t: np.stack([t, t**2, 0 * t], axis=-1), engine=engine, seconds=seconds, steps=100, **facts
    )


@pytest.fixture
def store(tmp_path):
    made_store = Store.open(tmp_path / "store", create=True)
    with made_store.writing():
        for key, engine in zip(KEYS[:3], ("first", "second", "third"), strict=True):
            made_store.publish(result_of(made(engine), key, cell={"key": f"cell-{engine}"}), WORLD)
        refresh(made_store, repair=True).save(made_store)
    return made_store


def test_a_run_comes_back_to_the_bit(store):
    before, after = made(), store.load(KEYS[0])
    assert after.world == before.world
    assert (after.engine, after.failed) == ("first", None)
    assert after.arrays.keys() == before.arrays.keys()
    for name, values in before.arrays.items():
        assert after.arrays[name].tobytes() == np.ascontiguousarray(values).tobytes()
    assert after.seconds.tobytes() == before.seconds.tobytes()
    assert after.real_time_factor == before.real_time_factor == 4.0


def test_equal_worlds_of_different_names_are_stored_once_and_runs_name_their_engines(store):
    other = dataclasses.replace(WORLD, name="other", expectations=(), engines=(EngineOptions("first", (("x", 1),)),))
    with store.writing():
        store.publish(result_of(made(of=other), KEYS[3]), other)
    assert len(os.listdir(store.path / "worlds")) == 1
    assert store.load(KEYS[3]).world == other
    assert store.load(KEYS[0]).world == WORLD


def test_repeated_runs_of_a_case_differ_only_in_circumstances(store, tmp_path):
    again = Store.open(tmp_path / "again", create=True)
    given = {**made().provenance, "seconds": {"step": 9.0}, "started": "later"}
    slower = dataclasses.replace(made(), provenance=given, seconds=2.0 * made().seconds)
    with again.writing():
        again.publish(result_of(slower, KEYS[0], cell={"key": "another"}), WORLD)
    first, second = store.facts(KEYS[0]), again.facts(KEYS[0])
    assert first.result == second.result
    assert first.circumstance_tables["seconds"].sha256 != second.circumstance_tables["seconds"].sha256
    assert first.result_sha256 == second.result_sha256
    assert first.sha256 != second.sha256


def test_a_stored_run_is_not_written_again(store):
    with store.writing():
        assert not store.publish(result_of(made("another"), KEYS[0]), WORLD)
    assert store.load(KEYS[0]).engine == "first"


def test_a_failed_run_stores_the_reason_and_the_engine_output_separately(store):
    text = "the process was ended by signal 11; its last output: at /tmp/abc"
    failed = Run(WORLD, "first", {}, {"engine_version": "1"}, text)
    with store.writing():
        store.publish(result_of(failed, KEYS[3]), WORLD)
    assert store.facts(KEYS[3]).result.failed == "the process was ended by signal 11"
    assert store.load(KEYS[3]).failed == text


def edit_bytes(path):
    """Change a bit of the first values: the first 4 bytes say that it is Parquet."""
    content = bytearray(path.read_bytes())
    content[30] ^= 1
    path.write_bytes(content)


def edit_facts(path):
    plain = json.loads(path.read_text())
    plain["result"]["summary"]["energy at the end"] = 1.0
    path.write_text(json.dumps(plain))


DAMAGE = {
    "a table, one bit": lambda folder: edit_bytes(folder / "bodies.parquet"),
    "a table of circumstances, one bit": lambda folder: edit_bytes(folder / "seconds.parquet"),
    "a table of circumstances is missing": lambda folder: (folder / "seconds.parquet").unlink(),
    "a table is missing": lambda folder: (folder / "states.parquet").unlink(),
    "a table is empty": lambda folder: (folder / "states.parquet").write_bytes(b""),
    "a table of another run": lambda folder: shutil.copy(folder / "energy.parquet", folder / "states.parquet"),
    "a table is a link": lambda folder: (
        (folder / "states.parquet").rename(folder.parent / "s"),
        (folder / "states.parquet").symlink_to(folder.parent / "s"),
    ),
    "facts are edited": lambda folder: edit_facts(folder / RUN_FILE),
    "facts are cut": lambda folder: (folder / RUN_FILE).write_text((folder / RUN_FILE).read_text()[:99]),
    "facts are missing": lambda folder: (folder / RUN_FILE).unlink(),
    "facts are of another form": lambda folder: (folder / RUN_FILE).write_text('{"schema": 99}'),
    "nothing is there": lambda folder: [(folder / name).unlink() for name in os.listdir(folder)],
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_run_is_named_moved_aside_and_to_be_done_again(store, damage):
    damage(store.path / place_of(KEYS[0]))
    with pytest.raises(SpecError, match=str(store.path)):
        store.load(KEYS[0])
    assert KEYS[0] not in refresh(store, repair=False).rows
    assert store.has(KEYS[0]), "reading moves nothing"
    with store.writing():
        index = refresh(store, repair=True)
    assert set(index.rows) == set(KEYS[1:3])
    assert [note for note in index.notes if f"moved to {store.shown}/damaged/{KEYS[0]}" in note]
    assert not store.has(KEYS[0])
    assert os.path.isdir(store.path / "damaged" / KEYS[0])
    with store.writing():
        assert store.publish(result_of(made(), KEYS[0]), WORLD)
        assert set(refresh(store, repair=True).rows) == set(KEYS[:3])


UNEXPECTED = {
    "seconds": lambda plain: plain["circumstances"].update(seconds={"step": "long"}),
    "no seconds": lambda plain: plain["circumstances"].update(seconds=[]),
    "steps": lambda plain: plain["result"]["provenance"].update(steps="many"),
    "seed": lambda plain: plain["result"]["provenance"].update(seed=[1]),
    "quantities": lambda plain: plain["result"]["summary"].update(height="high"),
    "engine": lambda plain: plain["result"].update(engine=""),
    "expectations": lambda plain: plain["asked"].update(expectations=3),
}


@pytest.mark.parametrize("change", UNEXPECTED.values(), ids=UNEXPECTED)
def test_facts_that_were_made_up_with_hashes_that_fit_are_no_run(store, change):
    path = store.path / place_of(KEYS[0]) / RUN_FILE
    plain = json.loads(path.read_text())
    change(plain)
    plain["result_sha256"] = sha256(plain["result"])
    plain["sha256"] = sha256({name: value for name, value in plain.items() if name != "sha256"})
    path.write_text(json.dumps(plain))
    with store.writing():
        index = refresh(store, repair=True)
        index.save(store)
    assert set(index.rows) == set(KEYS[1:3])
    assert any(RUN_FILE in note and "to be run again" in note for note in index.notes)


def test_a_run_under_another_s_key_is_not_it(store):
    shutil.copytree(store.path / place_of(KEYS[0]), store.path / place_of(KEYS[3]))
    index = refresh(store, repair=False)
    assert KEYS[3] not in index.rows
    assert "is the run of another key" in "".join(index.notes)


EDITED = gzip.compress(b'{"name": "edited"}')
DAMAGED_WORLDS = {
    "edited": EDITED,
    "empty": b"",
    "cut": EDITED[:-12],
    "no deflate": EDITED[:10] + b"\xff" * 12 + EDITED[22:],
    "checksum": EDITED[:-8] + bytes(8),
    "no gzip": b"world",
}


@pytest.mark.parametrize("damage", DAMAGED_WORLDS.values(), ids=DAMAGED_WORLDS)
def test_a_damaged_world_is_named_and_stored_again_while_its_runs_stay(store, damage):
    (name,) = os.listdir(store.path / "worlds")
    (store.path / "worlds" / name).write_bytes(damage)
    with pytest.raises(SpecError, match=name):
        store.load(KEYS[0])
    with store.writing():
        index = refresh(store, repair=True)
        assert not index.rows
        assert index.lost_worlds == {name.partition(".")[0]}
        assert all(store.has(key) for key in KEYS[:3])
        store.put_world(WORLD)
        assert set(refresh(store, repair=True).rows) == set(KEYS[:3])
    assert store.load(KEYS[0]).world == WORLD


def test_the_index_follows_from_the_runs(store):
    rows = refresh(store, repair=False)
    assert rows.notes == []
    assert not rows.changed
    row = rows.done("cell-second")
    assert row is not None
    assert (row.engine, row.step_seconds, row.steps, row.expected) == ("second", 0.25, 100, 1)
    for name in (INDEX_FILE, CELLS_FILE):
        (store.path / name).unlink()
    anew = refresh(store, repair=False)
    assert anew.rows == rows.rows
    assert anew.cells == rows.cells


def test_known_unchanged_runs_are_not_read_again(store, monkeypatch):
    monkeypatch.setattr(Store, "check", lambda self, key: pytest.fail("read again"))
    assert set(refresh(store, repair=False).rows) == set(KEYS[:3])


@pytest.mark.parametrize("name", [INDEX_FILE, CELLS_FILE])
@pytest.mark.parametrize("damage", ["cut", "bit", "text", "edited", "older"])
def test_a_damaged_index_is_reported_and_made_anew(store, name, damage):
    import pyarrow as pa
    from pyarrow import parquet

    path, good = store.path / name, refresh(store, repair=False)
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:100])
    elif damage == "bit":
        edit_bytes(path)
    elif damage == "text":
        path.write_text("not a table")
    else:
        table = parquet.read_table(path)
        kept = table.schema.metadata
        if damage == "edited":
            table = table.set_column(0, table.schema.names[0], pa.array(["0" * 64] * len(table)))
            parquet.write_table(table.replace_schema_metadata(kept), path)
        else:
            parquet.write_table(table.drop_columns([table.schema.names[1]]).replace_schema_metadata(kept), path)
    with store.writing():
        index = refresh(store, repair=True)
        assert f"{name} is damaged" in "".join(index.notes)
        assert (index.rows, index.cells) == (good.rows, good.cells)
        index.save(store)
    again = refresh(store, repair=False)
    assert (again.notes, again.rows) == ([], good.rows)


def test_a_run_that_was_added_or_removed_since_is_seen(store):
    with store.writing():
        store.publish(result_of(made("fourth"), KEYS[3]), WORLD)
        shutil.rmtree(store.path / place_of(KEYS[1]))
        index = refresh(store, repair=True)
    assert set(index.rows) == {KEYS[0], KEYS[2], KEYS[3]}
    assert len(index.notes) == 2


@pytest.mark.parametrize(
    ("content", "given"),
    [
        ('{"simspec_store": 2, "made_by": "9"}', "a newer simspec wrote it"),
        ("{}", "schema None"),
        ("x", "cannot be read"),
    ],
)
def test_a_store_of_another_form_is_refused(store, content, given):
    (store.path / "store.json").write_text(content)
    for create in (False, True):
        with pytest.raises(SpecError, match=given):
            Store.open(store.shown, create=create)
    assert store.has(KEYS[0])


def test_a_folder_that_is_no_store_is_refused(tmp_path):
    made().save(tmp_path / "run")
    for folder in (tmp_path, tmp_path / "run", tmp_path / "missing"):
        with pytest.raises(SpecError, match="is not a store"):
            Store.open(folder)
    with pytest.raises(SpecError, match="a folder of kind 'run'"):
        Store.open(tmp_path / "run", create=True)
