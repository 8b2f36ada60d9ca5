"""A saved run comes back bit for bit, and what is not a complete run is refused with the reason."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, SpecError
from simspec.runner import execution, store, tables
from simspec.runner.execution import failed_run, run_all
from simspec.runner.labels import Labels
from simspec.runner.store import is_run, load_run
from simspec.world.kinematics import coordinates
from simspec.world.types import Joint
from tests import worlds
from tests.runner.synthetic import free_body, run, world


def noisy(contacts=((1, 0, 1, -0.002, 3.0), (4, 1, 0, 0.1, 0.0))):
    """A run whose every number is another one."""
    generator = np.random.default_rng(5)
    entry = run(world(free_body("a"), free_body("b")), contacts=list(contacts))
    for name, array in entry.arrays.items():
        if name not in ("step", "time", "contact.row", "contact.body"):
            array[...] = generator.normal(size=array.shape)
    return entry


@pytest.mark.parametrize("contacts", [((1, 0, 1, -0.002, 3.0), (4, 1, 0, 0.1, 0.0)), ()])
def test_every_array_comes_back_bit_for_bit(tmp_path, contacts):
    entry = noisy(contacts)
    entry.save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    assert set(again.arrays) == set(entry.arrays)
    for name, array in entry.arrays.items():
        assert np.array_equal(again.arrays[name], array), name
        assert again.arrays[name].shape == array.shape, name
    assert again.seconds.tobytes() == entry.seconds.tobytes()
    assert again.world == entry.world
    assert again.provenance == entry.provenance
    assert (again.engine, again.failed) == (entry.engine, entry.failed)


def test_a_run_whose_engine_does_not_tell_seconds_has_none(tmp_path):
    dataclasses.replace(noisy(), seconds=None).save(tmp_path / "run")
    assert not (tmp_path / "run" / "seconds.parquet").exists()
    assert load_run(tmp_path / "run").seconds is None


def test_the_tables_are_made_for_people(tmp_path):
    import pyarrow.parquet

    entry = noisy()
    entry.save(tmp_path / "run")
    bodies = pyarrow.parquet.read_table(tmp_path / "run" / "bodies.parquet").to_pylist()
    assert [row["body"] for row in bodies[:3]] == ["a", "b", "a"]
    assert bodies[3]["time"] == entry.time[1]
    assert bodies[3]["qw"] == entry.arrays["pose"][1, 1, 3]
    assert bodies[3]["wz"] == entry.arrays["velocity"][1, 1, 5]
    contacts = pyarrow.parquet.read_table(tmp_path / "run" / "contacts.parquet").to_pylist()
    assert (contacts[1]["first"], contacts[1]["second"], contacts[1]["step"]) == ("b", "a", 40)


def test_not_a_number_survives(tmp_path):
    entry = noisy()
    entry.arrays["pose"][-1] = np.nan
    dataclasses.replace(entry, failed="the state is not finite").save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    assert np.isnan(again.arrays["pose"][-1]).all()
    assert again.failed == "the state is not finite"


def test_a_run_that_gave_nothing_is_kept(tmp_path):
    engine = "mujoco"
    entry = failed_run(worlds.spheres(2), engine, EngineError(engine, "the process was ended by signal 11"))
    entry.save(tmp_path / "run")
    again = load_run(tmp_path / "run")
    assert again.failed == "the process was ended by signal 11"
    assert not again.recorded


def test_a_failed_run_in_another_interpreter_has_its_version(monkeypatch):
    """Not that of the engine which is installed here."""
    requested = []

    def version_in(python, label):
        requested.append((python, label))
        if python == "/broken":
            raise EngineError(label, "gave no version")
        return "9.9"

    monkeypatch.setattr(execution, "version_in", version_in)
    error = EngineError("mujoco", "the process was ended by signal 11")
    versions = [
        failed_run(worlds.spheres(2), "mujoco@9.9", error, python).provenance["engine_version"]
        for python in ("/other", "/broken", None)
    ]
    assert versions == ["9.9", "unknown", find_engine("mujoco").version()]
    assert requested == [("/other", "mujoco@9.9"), ("/broken", "mujoco@9.9")]


def test_failures_in_another_interpreter_name_the_interpreter(monkeypatch):
    requested = []
    monkeypatch.setattr(execution, "version_in", lambda python, label: requested.append(python) or "9.9")
    runs = run_all(worlds.spheres(2), ["mujoco"], pythons={"mujoco": "/no/such/python"})
    assert runs["mujoco"].failed is not None
    assert runs["mujoco"].provenance["engine_version"] == "9.9"
    assert requested == ["/no/such/python"]


def test_saving_replaces_only_files_of_simspec(tmp_path):
    folder = tmp_path / "run"
    noisy().save(folder)
    (folder / "mine.txt").write_text("mine")
    failed_run(worlds.spheres(2), "mujoco", EngineError("mujoco", "nothing came")).save(folder)
    names = {path.name for path in folder.iterdir()}
    assert names == {"simspec-folder.json", "mine.txt", "provenance.json", "world.json"}
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_worlds_without_coordinates(tmp_path):
    wall = dataclasses.replace(free_body("wall"), joint=Joint("w", "fixed"))
    entry = run(world(wall))
    entry.save(tmp_path / "run")
    assert load_run(tmp_path / "run").arrays["q"].shape == entry.arrays["q"].shape


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
        (lambda folder: (folder / "bodies.parquet").write_bytes(b"PAR1"), "bodies.parquet: was edited, damaged"),
        (lambda folder: (folder / "bodies.parquet").unlink(), "bodies.parquet is missing"),
        (damage("provenance.json", lambda facts: {**facts, "schema": 99}), "schema 99"),
        (damage("world.json", lambda plain: {**plain, "name": "other"}), "not the world that was run"),
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
    with pytest.raises(SpecError, match="not a saved run"):
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
    entry = run(world(base, elbow, wrist), control={"joints": ["elbow"]})
    generator = np.random.default_rng(5)
    for name in ("q", "v"):
        entry.arrays[name][...] = generator.normal(size=entry.arrays[name].shape)
    for name in ("target", "effort"):
        entry.arrays[f"control.{name}"] = generator.normal(size=(len(entry.time), 1))
    entry.save(tmp_path / "run")
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
    assert states["v.base.wx"].to_numpy().tolist() == entry.arrays["v"][:, 3].tolist()
    assert states["q.elbow"].to_numpy().tolist() == entry.arrays["q"][:, 7].tolist()
    control = pyarrow.parquet.read_table(tmp_path / "run" / "control.parquet")
    assert control.column_names == ["step", "time", "target.elbow", "effort.elbow"]
    again = load_run(tmp_path / "run")
    for name, array in entry.arrays.items():
        assert np.array_equal(again.arrays[name], array), name
    # by name from Python, too
    assert np.array_equal(again.q("elbow"), entry.arrays["q"][:, 7])
    assert np.array_equal(again.q("base"), entry.arrays["q"][:, :7])
    assert np.array_equal(again.q("wrist"), entry.arrays["q"][:, 8:])
    assert np.array_equal(again.v("base.wx"), entry.arrays["v"][:, 3])
    assert np.array_equal(again.effort("elbow"), entry.arrays["control.effort"][:, 0])
    assert np.array_equal(again.target("elbow"), entry.arrays["control.target"][:, 0])
    with pytest.raises(SpecError, match="did you mean 'elbow'"):
        again.q("elbw")
    with pytest.raises(SpecError, match="no controller drives 'wrist'"):
        again.effort("wrist")


def test_a_free_body_and_a_ball_joint_of_equal_name_keep_separate_columns():
    ball = dataclasses.replace(
        free_body("hand"), joint=Joint("base", "ball", "base", position=(1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 3)
    )
    names = coordinates(world(free_body("base"), ball))
    assert len(set(names.q)) == len(names.q) == 11
    assert len(set(names.v)) == len(names.v) == 9


def test_more_coordinates_than_a_table_has_columns_for_are_lists(tmp_path, monkeypatch):
    import pyarrow.parquet

    monkeypatch.setattr(tables, "MOST_COLUMNS", 20)
    entry = noisy()
    entry.save(tmp_path / "run")
    states = pyarrow.parquet.read_table(tmp_path / "run" / "states.parquet")
    assert states.column_names == ["step", "time", "q", "v"]
    content = json.loads(states.schema.metadata[b"simspec.coordinates"])
    assert content == {"q": list(entry.coordinates.q), "v": list(entry.coordinates.v)}
    again = load_run(tmp_path / "run")
    assert np.array_equal(again.arrays["q"], entry.arrays["q"])
    monkeypatch.setattr(tables, "MOST_COLUMNS", 200)
    entry.save(tmp_path / "named")
    assert len(pyarrow.parquet.read_table(tmp_path / "named" / "states.parquet").column_names) > 4
    monkeypatch.setattr(tables, "MOST_COLUMNS", 20)
    for name in ("q", "v"):  # as simspec wrote it when tables had more columns
        assert load_run(tmp_path / "named").arrays[name].tobytes() == entry.arrays[name].tobytes()
    bare = states.replace_schema_metadata({})
    pyarrow.parquet.write_table(bare, tmp_path / "run" / "states.parquet")
    forge(tmp_path / "run")
    with pytest.raises(SpecError, match="other coordinates than the world"):
        load_run(tmp_path / "run")


def test_a_run_of_the_older_layout_says_so(tmp_path):
    folder = tmp_path / "run"
    noisy().save(folder)
    damage("provenance.json", lambda facts: {**facts, "schema": 1})(folder)
    with pytest.raises(SpecError, match="schema 1, this simspec reads 3"):
        load_run(folder)


# --- what others have made of a run -----------------------------------------------------------------------------------------


def forge(folder: Path, **more: object) -> None:
    """Make the hashes those of what is there, so that what lies behind them is looked at."""
    facts = json.loads((folder / "provenance.json").read_text()) | more
    for name, table in facts["tables"].items():
        path = folder / f"{name}.parquet"
        if path.exists():
            table["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    facts["sha256"] = store.content_hash(facts)
    (folder / "provenance.json").write_text(json.dumps(facts))


def retabled(name: str, change) -> object:
    """Another table in the place of one, with its hash."""

    def work(folder: Path) -> None:
        path = folder / f"{name}.parquet"
        pq.write_table(change(pq.read_table(path)), path)
        forge(folder)

    return work


def with_column(name: str, values) -> object:
    def change(table):
        made = values(table) if callable(values) else pa.array([values] * len(table))
        return table.set_column(table.column_names.index(name), name, made)

    return change


BODIES = "bodies.parquet"


def bomb(table):
    return pa.table({column: pa.array(np.zeros(3_000_000)) for column in ("step", "time", "x")})


DAMAGE = {
    "a value edited": (
        lambda folder: pq.write_table(with_column("x", 9.0)(pq.read_table(folder / BODIES)), folder / BODIES),
        BODIES,
    ),
    "a flipped bit": (lambda folder: flip(folder / BODIES), BODIES),
    "truncated": (lambda folder: (folder / BODIES).write_bytes((folder / BODIES).read_bytes()[:-9]), BODIES),
    "a table of another run": (lambda folder: other_table(folder, "states.parquet"), "states.parquet"),
    "seconds edited": (
        damage("provenance.json", lambda facts: facts | {"seconds": {"step": 1e-9}}),
        "provenance.json: was edited",
    ),
    "the engine relabelled": (damage("provenance.json", lambda facts: facts | {"engine": "second"}), "was edited"),
    "failure taken out": (damage("provenance.json", lambda facts: facts | {"failed": "no"}), "was edited"),
    "provenance a list": (lambda folder: (folder / "provenance.json").write_text("[]"), "provenance.json"),
    "provenance deep": (lambda folder: (folder / "provenance.json").write_text("[" * 100_000), "provenance.json"),
    "provenance not JSON": (lambda folder: (folder / "provenance.json").write_bytes(b"\xff"), "provenance.json"),
    "provenance NaN": (lambda folder: (folder / "provenance.json").write_text('{"schema": NaN}'), "NaN"),
    "seconds as text": (lambda folder: forge(folder, seconds={"step": "x"}), r"provenance.json.*seconds.step"),
    "steps as text": (lambda folder: forge(folder, steps="many"), r"provenance.json.*steps"),
    "tables as a list": (damage("provenance.json", lambda facts: facts | {"tables": []}), r"provenance.json.*tables"),
    "a table with a path": (lambda folder: forge(folder, tables={"../x": {"sha256": "", "rows": 1}}), "tables"),
    "world a list": (lambda folder: (folder / "world.json").write_text("[]"), "world.json"),
    "world deep": (lambda folder: (folder / "world.json").write_text("[" * 100_000), "world.json"),
    "world's bodies text": (damage("world.json", lambda plain: plain | {"bodies": "none"}), "world.json"),
    "a FIFO": (lambda folder: replaced(folder / BODIES, os.mkfifo), r"bodies.parquet: a FIFO"),
    "a link": (
        lambda folder: replaced(folder / BODIES, lambda path: path.symlink_to("states.parquet")),
        r"bodies.parquet: a sym",
    ),
    "provenance a FIFO": (lambda folder: replaced(folder / "provenance.json", os.mkfifo), "provenance.json: a FIFO"),
    "provenance a device": (
        lambda folder: replaced(folder / "provenance.json", lambda path: path.symlink_to("/dev/zero")),
        "sym",
    ),
    "a folder": (lambda folder: replaced(folder / BODIES, os.mkdir), r"bodies.parquet: a folder"),
    # behind right hashes
    "times as text": (retabled("states", with_column("time", "soon")), r"states.parquet.*'time' holds string"),
    "steps as numbers": (retabled("states", with_column("step", 0.5)), r"states.parquet.*'step' holds double"),
    "a column missing": (
        retabled("bodies", lambda table: table.drop_columns(["qw"])),
        r"bodies.parquet.*'qw' is missing",
    ),
    "a column more": (
        retabled("bodies", lambda table: table.append_column("more", table["x"])),
        r"bodies.parquet.*'more'",
    ),
    "columns in another order": (
        retabled("energy", lambda table: table.select(["step", "time", "potential", "kinetic"])),
        "order",
    ),
    "rows missing": (retabled("bodies", lambda table: table.slice(2)), r"bodies.parquet.*20 rows, should be 22"),
    "a body relabelled": (
        retabled("bodies", with_column("body", lambda table: names(table, "a", "z"))),
        r"names \['z'\]",
    ),
    "bodies swapped": (
        retabled("bodies", with_column("body", lambda table: names(table, "b", "a"))),
        "not the world's",
    ),
    "times of another run": (retabled("energy", with_column("time", 0.25)), r"energy.parquet: its times"),
    "steps that fall": (retabled("states", with_column("step", 3)), "do not rise"),
    "gaps": (
        retabled("energy", with_column("kinetic", lambda table: pa.nulls(len(table), pa.float64()))),
        "missing values",
    ),
    "contacts of no row": (retabled("contacts", with_column("row", 99)), "contacts.parquet: its rows"),
    "contacts of another step": (retabled("contacts", with_column("step", 7)), "contacts.parquet: its steps"),
    "a bomb": (retabled("bodies", bomb), r"bodies.parquet.*3,000,000 rows, should be 22"),
    "rows by the million": (
        lambda folder: forge(folder, tables={**tables_of(folder), "states": {"sha256": "", "rows": 10**9}}),
        "steps",
    ),
    "no Parquet": (lambda folder: other_bytes(folder, b"PAR1" + b"x" * 100 + b"PAR1"), "bodies.parquet"),
    "a footer beyond the file": (lambda folder: other_bytes(folder, b"PAR1" + b"\xff" * 8 + b"PAR1"), "metadata"),
}


def names(table, *words):
    order = pa.array(np.arange(len(table), dtype=np.int32) % len(words))
    return pa.DictionaryArray.from_arrays(order, pa.array(words))


def tables_of(folder: Path) -> dict:
    return json.loads((folder / "provenance.json").read_text())["tables"]


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)


def replaced(path: Path, make) -> None:
    path.unlink()
    make(path)


def other_table(folder: Path, name: str) -> None:
    run(world(free_body("a"), free_body("b"))).save(folder.parent / "other")
    (folder / name).write_bytes((folder.parent / "other" / name).read_bytes())


def other_bytes(folder: Path, content: bytes) -> None:
    (folder / BODIES).write_bytes(content)
    forge(folder)


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_run_is_believed_only_as_it_was_saved(tmp_path, kind):
    folder = tmp_path / "run"
    noisy().save(folder)
    spoil, words = DAMAGE[kind]
    spoil(folder)
    with pytest.raises(SpecError, match=words) as caught:
        load_run(folder)
    assert str(folder) in str(caught.value)


def test_right_hashes_are_believed(tmp_path):
    noisy().save(tmp_path / "run")
    forge(tmp_path / "run")
    assert load_run(tmp_path / "run").recorded


def test_a_table_that_would_fill_memory_is_not_unpacked(tmp_path, monkeypatch):
    entry = noisy()
    entry.save(tmp_path / "run")
    path = tmp_path / "run" / BODIES
    monkeypatch.setattr(tables, "LARGEST_TABLE", 2_000)
    schema = tables.schemas(entry.world, [], Labels())["bodies"]
    with open(path, "rb") as file, pytest.raises(ValueError, match="GB unpacked, more than the"):
        list(tables.read_blocks(tables.open_parquet(file, path.stat().st_size), schema, 2 * len(entry.time)))


def test_tables_are_written_block_by_block(tmp_path, monkeypatch):
    entry = noisy()
    entry.save(tmp_path / "whole")
    monkeypatch.setattr("simspec.files.BLOCK_BYTES", 500)
    entry.save(tmp_path / "blocks")
    assert pq.ParquetFile(tmp_path / "blocks" / BODIES).num_row_groups > 3
    for name in ("states", "bodies", "energy", "contacts"):
        assert pq.read_table(tmp_path / "blocks" / f"{name}.parquet").equals(
            pq.read_table(tmp_path / "whole" / f"{name}.parquet")
        )
    again = load_run(tmp_path / "blocks")
    assert all(np.array_equal(again.arrays[name], array) for name, array in entry.arrays.items())


def test_lists_of_coordinates_are_packed_by_bytes_too(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_COLUMNS", 1)
    noisy().save(tmp_path / "run")
    group = pq.ParquetFile(tmp_path / "run" / "states.parquet").metadata.row_group(0)
    packed = [group.column(index) for index in range(group.num_columns)]
    assert {entry.path_in_schema[0] for entry in packed} >= {"q", "v"}
    assert all("BYTE_STREAM_SPLIT" in entry.encodings for entry in packed if entry.path_in_schema[0] in "qv")
