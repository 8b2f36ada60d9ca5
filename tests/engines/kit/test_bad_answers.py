"""A bad answer of an engine's process is a failure of that engine alone.

The good answer of each engine is recorded once; impostors (a shell script in place of the interpreter) then give it back spoilt
in one way. The engine that runs after it, whose impostor gives its answer back as it was, comes out whole.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import json
import os
import random
import shutil
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from simspec.engines.kit import process, worker
from simspec.engines.kit.answers import BadAnswerError, Operation, _check_control, read_answers
from simspec.engines.kit.process import start
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.proof.verify import engine_checks, prepare
from simspec.runner import execution as runner
from simspec.runner.execution import run_all
from simspec.runner.run import Case
from simspec.world.actions import JointController
from tests import worlds
from tests.installed import JOINTED

ENGINES = tuple(JOINTED)
QUICK = 0.7
"""s that a hanging process is given."""


@functools.cache
def scene():
    """Two balls falling on a floor, energy and contacts recorded."""
    world = worlds.spheres(2)
    return dataclasses.replace(
        world,
        physics=dataclasses.replace(world.physics, steps=400),
        record=dataclasses.replace(world.record, every_steps=40),
        expectations=(),
    )


@pytest.fixture(autouse=True)
def _separate_temporary_folder(tmp_path, monkeypatch):
    """Files that hostile engines put in place of their folders are not left in the shared temporary folder."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """The folder of each engine's own answer to a run of :func:`scene`, and the artifacts."""
    place, keep = tmp_path_factory.mktemp("good"), process.Running.wait
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        for engine in ENGINES:

            def wait(running, progress=None, doing=None, engine=engine):
                reply = keep(running, progress, doing)
                shutil.copytree(running._folder, place / engine)
                return reply

            patch.setattr(process.Running, "wait", wait)
            artifacts = place / f"{engine}-artifacts"
            runner.compile_world(scene(), [engine])[engine].artifacts.write(artifacts)
            run = runner.run(scene(), engine, artifacts=artifacts)
            assert run.failed is None
            assert len(run.arrays["contact.row"])
            for name in ("request.json", ".simspec-scratch"):
                (place / engine / name).unlink()
            found[engine] = SimpleNamespace(answer=place / engine, artifacts=artifacts)
    return found


def program(place: Path, words: str) -> str:
    """A program in place of the interpreter: $3 is the keeper, $4 the folder."""
    place.write_text(f"#!/bin/sh\n{words}\n")
    place.chmod(0o755)
    return str(place)


def answering(place: Path, answer: Path, more: str = "") -> str:
    return program(place, f'cp -R {answer}/* "$4"/\n{more}')


def test_driven_joints_of_an_answer_are_those_of_the_world():
    bodies = worlds.tree(["hinge", "hinge", "hinge"], 1)
    first, second, free = (body.joint.name for body in bodies)
    controller = JointController("pair", (first, second), kp=(1.0, 1.0), kd=(1.0, 1.0), effort_limits=(None, None))
    world = dataclasses.replace(worlds.world(bodies), controllers=(controller,))
    arrays = {"control.target": np.zeros((1, 2)), "control.effort": np.zeros((1, 2))}

    def check(*joints: str) -> None:
        control = {"joints": list(joints), "error": [0.0, 0.0], "clipped": [0, 0]}
        _check_control(SimpleNamespace(world=world), {"control": control}, arrays, 1)

    check(first, second)
    for joints, wrong in (((first, "arm"), f"arm, {second}"), ((first, free), second)):
        with pytest.raises(BadAnswerError, match=f"or not the world's: {wrong}$"):
            check(*joints)


# --- ways to spoil an answer; each gets the folder with the good one ----------------------------------------------------


def spoiled_result(change):
    """Spoil result.json by a ``change`` of its content."""

    def spoil(answer: Path) -> None:
        path = answer / "result.json"
        content = json.loads(path.read_text())
        given = change(content)
        path.write_text(json.dumps(content if given is None else given))

    return spoil


def text(content: str | bytes):
    """Another result.json altogether."""

    def spoil(answer: Path) -> None:
        (answer / "result.json").write_bytes(content if isinstance(content, bytes) else content.encode())

    return spoil


def entry(change):
    """Spoil what is said of the run."""
    return spoiled_result(lambda content: change(content["operations"][0]))


def result(**values):
    return entry(lambda item: item["result"].update(values))


def array(name: str, change):
    """Spoil the numbers of an array."""

    def spoil(answer: Path) -> None:
        path = answer / f"0.{name}.bin"
        described = json.loads((answer / "result.json").read_text())["operations"][0]["arrays"][name]
        kind = "<i8" if described["kind"] == "i8" else "<f8"
        change(np.memmap(path, kind, "r+", shape=tuple(described["shape"])))

    return spoil


def put(place, value):
    def change(numbers):
        numbers[place] = value

    return change


def replaced(name: str, make):
    def spoil(answer: Path) -> None:
        (answer / name).unlink()
        make(answer / name)

    return spoil


def resized(name: str, change):
    def spoil(answer: Path) -> None:
        content = (answer / name).read_bytes()
        (answer / name).write_bytes(change(content))

    return spoil


BAD = {
    "garbage": text(b"\x00\xff\xfe garbage"),
    "empty": text(""),
    "truncated": resized("result.json", lambda content: content[: len(content) // 2]),
    "a list": text("[1, 2, 3]"),
    "a number": text("17"),
    "null": text("null"),
    "deep": text("[" * 200_000),
    "not UTF-8": text(b'{"schema": "\xff"}'),
    "another schema": spoiled_result(lambda content: content.update(schema=1)),
    "no schema": spoiled_result(lambda content: content.pop("schema") and None),
    "schema of a list": spoiled_result(lambda content: content.update(schema=[2])),
    "status unknown": spoiled_result(lambda content: content.update(status="perhaps")),
    "error of a number": text('{"status": "error", "error": 7, "traceback": "", "schema": 3}'),
    "error without end": text('{"status": "error", "error": "%s", "traceback": "", "schema": 3}' % ("x" * 10_000_000)),
    "no operations": spoiled_result(lambda content: content.update(operations=[])),
    "operations of a word": spoiled_result(lambda content: content.update(operations="none")),
    "twice the operations": spoiled_result(lambda content: content.update(operations=content["operations"] * 2)),
    "another operation": entry(lambda item: item.update(op="motion")),
    "a list for an entry": spoiled_result(lambda content: content.update(operations=[[]])),
    "unknown key": spoiled_result(lambda content: content.update(more=1)),
    "version of a list": spoiled_result(lambda content: content.update(engine_version=[4, 0])),
    "long version": spoiled_result(lambda content: content.update(engine_version="9" * 1_000_000)),
    "version of words": spoiled_result(lambda content: content.update(engine_version="any text")),
    "version that is not seen": spoiled_result(lambda content: content.update(engine_version="1.0\u202e")),
    "log of a word": entry(lambda item: item.update(log="words")),
    "log without end": entry(lambda item: item.update(log=["x"] * 100_000)),
    "NaN seconds": entry(lambda item: item.update(seconds=float("nan"))),
    "negative seconds": entry(lambda item: item.update(load_seconds=-1.0)),
    "infinite seconds": result(step_seconds=float("inf")),
    "seconds of a word": result(cpu_seconds="1.0"),
    "no steps": entry(lambda item: item["result"].pop("steps") and None),
    "too few steps": result(steps=3),
    "negative steps": result(steps=-400),
    "steps of true": result(steps=True),
    "failed of a word": result(failed="everything"),
    "failed elsewhere": result(failed={"step": 3, "channel": "pose", "place": [0, 0]}),
    "failed in nothing": result(failed={"step": 400, "channel": "colour", "place": []}),
    "control unasked": result(control={"joints": ["a"], "error": [0.0], "clipped": [0]}),
    "an array more": entry(
        lambda item: item["arrays"].update(more={"kind": "f8", "shape": [1], "stored": False}),
    ),
    "a name of 10 MB": entry(
        lambda item: item["arrays"].update({"n" * 10_000_000: {"kind": "f8", "shape": [1], "stored": False}}),
    ),
    "a name that climbs": entry(
        lambda item: item["arrays"].update({"../../../etc/passwd": {"kind": "f8", "shape": [1], "stored": False}}),
    ),
    "an array less": entry(lambda item: item["arrays"].pop("pose") and None),
    "objects": entry(lambda item: item["arrays"]["pose"].update(kind="O")),
    "another kind": entry(lambda item: item["arrays"]["pose"].update(kind="i8")),
    "another shape": entry(lambda item: item["arrays"]["pose"].update(shape=[11, 3, 6])),
    "shape of words": entry(lambda item: item["arrays"]["pose"].update(shape=["11", "3", "7"])),
    "negative shape": entry(lambda item: item["arrays"]["pose"].update(shape=[-1, 3, 7])),
    "a bomb": entry(lambda item: item["arrays"]["pose"].update(shape=[2**50, 3, 7])),
    "many bodies": entry(lambda item: [found.update(shape=[11, 5, *found["shape"][2:]])
                                      for name, found in item["arrays"].items() if name in ("pose", "velocity")] and None),
    "stored where it is not": entry(lambda item: item["arrays"]["pose"].update(stored=True)),
    "missing array": lambda answer: (answer / "0.pose.bin").unlink(),
    "short array": resized("0.pose.bin", lambda content: content[:-8]),
    "long array": resized("0.pose.bin", lambda content: content + b"\0" * 8),
    "truncated array": resized("0.q.bin", lambda content: content[:-3]),
    "NaN in a pose": array("pose", put((5, 0, 2), np.nan)),
    "infinite energy": array("energy", put((10, 1), np.inf)),
    "steps that go back": array("step", put(3, 10.0)),
    "steps of NaN": array("step", put(3, np.nan)),
    "contact of an unknown body": array("contact.body", put((0, 1), 17)),
    "contact of a negative body": array("contact.body", put((0, 1), -1)),
    "contact in no row": array("contact.row", put(-1, 11)),
    "contact rows that go back": array("contact.row", put(-1, 0)),
    "contact of no unit": array("contact.unit", put((0, 1), 99)),
    "contact of less than a unit": array("contact.unit", put((0, 1), -1)),
    "contact of another body's unit": array("contact.unit", lambda numbers: numbers.__setitem__(0, numbers[0, ::-1])),
    "units without contacts of them": entry(lambda item: item["arrays"].pop("contact.unit") and None),
    "contacts of unknown units": result(contact_units=None),
    "units of other shapes": entry(lambda item: item["result"].update(
        contact_units=[{**unit, "shapes": ["nothing"]} for unit in item["result"]["contact_units"]])),
    "units of no shapes": entry(lambda item: item["result"].update(
        contact_units=[{**unit, "shapes": []} for unit in item["result"]["contact_units"]])),
    "NaN in a force": array("contact.normal_force", put(0, np.nan)),
    "seconds that fall": array("seconds", put((3, 0), 0.0)),
    "seconds before the begin": array("seconds", put((0, 4), -1e-9)),
    "NaN seconds in a row": array("seconds", put((2, 5), np.nan)),
    "infinite seconds in a row": array("seconds", put((-1, 3), np.inf)),
    "more seconds than in all": array("seconds", put((-1, 1), 1e6)),
    "five kinds of seconds": entry(lambda item: item["arrays"]["seconds"].update(shape=[11, 5])),
    "seconds of fewer rows": entry(lambda item: item["arrays"]["seconds"].update(shape=[10, 6])),
    "result.json a folder": replaced("result.json", lambda path: path.mkdir()),
    "array a folder": replaced("0.pose.bin", lambda path: path.mkdir()),
}  # fmt: skip

BY_SCRIPT = {
    "nothing": ("true", "ended with code 0 without a result"),
    "code 7": ("exit 7", "ended with code 7 without a result"),
    "killed": ("kill -9 $$", "signal 9"),
    "aborted": ("kill -6 $$", "signal 6"),
    "result.json a FIFO": ('rm "$4"/result.json; mkfifo "$4"/result.json', "FIFO"),
    "array a FIFO": ('rm "$4"/0.pose.bin; mkfifo "$4"/0.pose.bin', "FIFO"),
    "result.json a link": ('mv "$4"/result.json "$4"/r; ln -s r "$4"/result.json', "symbolic link"),
    "array a link": ('mv "$4"/0.pose.bin "$4"/r; ln -s r "$4"/0.pose.bin', "symbolic link"),
    "array a device": ('rm "$4"/0.pose.bin; ln -s /dev/zero "$4"/0.pose.bin', "symbolic link"),
    "the folder gone": ('rm -r "$4"', "without a result"),
    "the folder a link": ('rm -r "$4"; ln -s / "$4"', "without a result"),
    "unreadable": ('rm "$4"/result.json; mkdir "$4"/result.json', "folder"),
    "hangs": ("exec sleep 20", "deadline"),
    "hangs below": ("sleep 20 & sleep 20", "deadline"),
    "hangs and will not end": ("trap '' TERM INT HUP; while :; do sleep 20; done", "deadline"),
    "progress a FIFO": ('mkfifo "$4"/progress.txt; exec sleep 20', "deadline"),
    "progress of words": ('echo much > "$4"/progress.txt; exec sleep 20', "deadline"),
    "progress NaN": ('echo nan > "$4"/progress.txt; exec sleep 20', "deadline"),
    "doing a FIFO": ('mkfifo "$4"/doing.txt; exec sleep 20', "deadline"),
    "doing without end": ('yes 1 | head -c 3000 > "$4"/doing.txt; exec sleep 20', "deadline"),
    "progress without end": ('yes 1 | head -c 3000000 > "$4"/progress.txt; exec sleep 20', "deadline"),
    "prints without end": ("head -c 60000000 /dev/zero; exit 3", "ended with code 3"),
}


def after(engine: str) -> str:
    """The engine that runs after the spoilt ``engine``: each engine is spoilt for another."""
    return ENGINES[(ENGINES.index(engine) + 1) % len(ENGINES)]


def runs_with_others(bad: str, engine: str, good, tmp_path, others: tuple[str, ...]):
    """The runs of an engine that is spoilt, and of others after it that are not."""
    pythons = {other: answering(tmp_path / other, good[other].answer) for other in others} | {engine: bad}
    artifacts = {engine: good[engine].artifacts for engine in ENGINES}
    return run_all(scene(), (engine, *others), artifacts=artifacts, pythons=pythons, deadline=30.0)


@pytest.mark.parametrize("kind", [None, "garbage", "NaN in a pose"])
def test_all_engines_except_the_spoilt_engine_have_complete_runs(kind, good, tmp_path):
    spoilt = tmp_path / "answer"
    shutil.copytree(good["dart"].answer, spoilt)
    if kind is not None:
        BAD[kind](spoilt)
    others = tuple(engine for engine in ENGINES if engine != "dart")
    runs = runs_with_others(answering(tmp_path / "bad", spoilt), "dart", good, tmp_path, others)
    assert {engine for engine in ENGINES if runs[engine].failed is None} == {
        *others,
        *(["dart"] if kind is None else []),
    }


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("engine", ENGINES)
def test_a_bad_answer_is_that_engine_s_failure(engine, kind, good, tmp_path):
    spoilt = tmp_path / "answer"
    shutil.copytree(good[engine].answer, spoilt)
    BAD[kind](spoilt)
    runs = runs_with_others(answering(tmp_path / "bad", spoilt), engine, good, tmp_path, (after(engine),))
    assert runs[engine].failed
    assert len(runs[engine].failed) < 3000
    assert runs[after(engine)].failed is None


@pytest.mark.parametrize("kind", BY_SCRIPT)
def test_a_process_that_misbehaves_is_that_engine_s_failure(kind, good, tmp_path, monkeypatch):
    words, message = BY_SCRIPT[kind]
    monkeypatch.setattr(process, "LOOK_EVERY", 0.05)
    monkeypatch.setattr(process.keeper, "PATIENCE", 0.1)
    bad = answering(tmp_path / "bad", good["dart"].answer, words)
    if "without a result" in message or "signal" in message or "code" in message:
        bad = program(tmp_path / "bad", words)
    progress = [] if "progress" in kind else None
    doing = [] if "doing" in kind else None
    with (
        pytest.raises(EngineError) as caught,
        runner.start_case(Case(scene(), "dart"), good["dart"].artifacts, python=bad, deadline=QUICK) as pending,
    ):
        pending.wait(None if progress is None else progress.append, None if doing is None else doing.append)
    assert caught.value.exit_code == 3
    assert message in str(caught.value)
    assert len(str(caught.value)) < 4000
    assert not progress
    assert not doing


def test_a_long_operation_is_reported_on_a_single_line(good, tmp_path, monkeypatch):
    """And that it is done."""
    monkeypatch.setattr(process, "LOOK_EVERY", 0.02)
    monkeypatch.setattr(process.keeper, "PATIENCE", 0.1)
    words = 'printf "compiling\\nits   step" > "$4"/doing.txt; sleep 0.3; rm "$4"/doing.txt; exec sleep 20'
    busy = answering(tmp_path / "busy", good["dart"].answer, words)
    said = []
    with (
        pytest.raises(EngineError, match="deadline"),
        runner.start_case(Case(scene(), "dart"), good["dart"].artifacts, python=busy, deadline=QUICK) as pending,
    ):
        pending.wait(doing=said.append)
    assert said == ["compiling its step", ""]


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("nowhere/python", lambda path: None, "No such file"),
        ("folder", lambda path: path.mkdir(), "Permission denied"),
        ("text", lambda path: path.write_text("words"), "Permission denied"),
        ("format", lambda path: (path.write_bytes(b"\x7fELF"), path.chmod(0o755)), "Exec format error"),
        ("with\0zero", lambda path: None, "null byte"),
    ],
)
@pytest.mark.parametrize("engine", ENGINES)
def test_an_invalid_interpreter_is_a_failure_of_that_engine(engine, name, make, message, good, tmp_path):
    make(tmp_path / name)
    runs = runs_with_others(str(tmp_path / name), engine, good, tmp_path, (after(engine),))
    assert message in runs[engine].failed
    assert runs[after(engine)].failed is None


def test_a_relative_interpreter_is_the_caller_s(good, tmp_path, monkeypatch):
    answering(tmp_path / "here", good["dart"].answer)
    monkeypatch.chdir(tmp_path)
    run = runner.run(scene(), "dart", artifacts=good["dart"].artifacts, python="./here")
    assert run.failed is None


def test_links_that_an_answer_leaves_are_not_followed_when_it_is_removed(good, tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "kept").write_text("kept")
    for words in (
        f'ln -s {mine} "$4"/there',
        f'rm -r "$4"; ln -s {mine} "$4"',
        f'rm -r "$4"; mkdir "$4"; ln -s {mine} "$4"',
    ):
        bad = program(tmp_path / "bad", words)
        with pytest.raises(EngineError):
            runner.run(scene(), "dart", artifacts=good["dart"].artifacts, python=bad)
    assert (mine / "kept").read_text() == "kept"


# --- the operations of the proof ----------------------------------------------------------------------------------------

HOSTILE: list[Any] = [
    None,
    True,
    -1,
    2**70,
    1e308,
    float("nan"),
    "",
    "x" * 1000,
    "\x1b[31m",
    [],
    [[]],
    {},
    {"a": 1},
    [None],
    -0.5,
]


def nodes(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    found = [path]
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        found += nodes(item, (*path, key))
    return found


def changed(content: Any, path: tuple[Any, ...], change) -> Any:
    content = copy.deepcopy(content)
    holder = content
    for key in path[:-1]:
        holder = holder[key]
    change(holder, path[-1])
    return content


@pytest.mark.parametrize("engine", ENGINES)
def test_the_proof_survives_any_read_back(engine, tmp_path):
    """One place of the answer at a time is changed, removed or doubled: it is refused, or it is judged."""
    world = worlds.shapes_world()
    artifacts, folder = tmp_path / "artifacts", tmp_path / "answer"
    runner.compile_world(world, [engine])[engine].artifacts.write(artifacts)
    probes = prepare(world, ["L1", "L2", "L3", "L4", "L6"])
    operations = probes.operations(find_engine(engine))
    with start(engine, artifacts, operations) as running:
        running.wait()
        shutil.copytree(running._folder, folder)
    content = json.loads((folder / "result.json").read_text())
    generator = random.Random(11)
    places = nodes(content)[1:]
    judged, said = 0, []
    for path in generator.choices(places, k=100):
        value = generator.choice(HOSTILE)
        change = generator.choice(
            [lambda holder, key, value=value: holder.__setitem__(key, value)] * 3
            + [lambda holder, key: holder.__delitem__(key)]
        )
        (folder / "result.json").write_text(json.dumps(changed(content, path, change)))
        try:
            answers, _, error = read_answers(folder, operations)
        except BadAnswerError as refusal:
            said.append(str(refusal))
            continue
        assert error is None
        engine_checks(world, find_engine(engine), answers, probes)
        judged += 1
    assert len(said) > 10
    assert max(map(len, said)) < 2000
    assert judged > 5


def test_operations_without_a_world_take_their_sizes_from_each_other(tmp_path):
    """Without a given number of bodies, all arrays must agree on it."""
    described = {
        name: {"kind": "f8", "shape": shape, "stored": True}
        for name, shape in {"time": [3], "pose": [3, 2, 7], "velocity": [3, 1, 6]}.items()
    }
    item = {"op": "drive", "load_seconds": 0.0, "seconds": 0.0, "log": [], "result": {}, "arrays": described}
    names = dict.fromkeys(("engine", "engine_version", "numpy_version", "python_version", "platform", "machine"), "x1")
    (tmp_path / "result.json").write_text(
        json.dumps({"schema": worker.SCHEMA, "status": "ok", **names, "operations": [item]})
    )
    (tmp_path / "result.bin").write_bytes(b"\0" * 8 * (3 + 42 + 18))
    operation = Operation("drive", {"timestep": 1e-3, "phases": [[2, 1]]}, {"effort": np.zeros((1, 1))})
    with pytest.raises(BadAnswerError, match=r"velocity has shape \(3, 1, 6\), should be \(3, 2, 6\)"):
        read_answers(tmp_path, [operation])


def test_every_operation_declares_its_answer():
    from simspec.engines.kit import answers
    from simspec.engines.kit.operations import OPERATIONS

    assert set(answers.FORMS) == set(OPERATIONS)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts open files in /proc")
def test_bad_answers_leave_no_file_open(good, tmp_path):
    bad = program(tmp_path / "bad", 'mkfifo "$4"/result.json')
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        with pytest.raises(EngineError):
            runner.run(scene(), "dart", artifacts=good["dart"].artifacts, python=bad)
    assert len(os.listdir("/proc/self/fd")) <= before + 1
    assert sys.executable
