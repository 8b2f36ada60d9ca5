"""The folder contract, with engines that are missing, crash, hang, lie or return NaN."""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import signal
import sys
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from simspec.contact import Rules
from simspec.dialects.kit.sidecar import SIDECAR, SIDECAR_SCHEMA
from simspec.engines.kit import process
from simspec.engines.kit import registry as base
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.recorder import record
from simspec.engines.kit.session import Session
from simspec.errors import EngineError
from simspec.runner.execution import run
from simspec.support.declarations import EXACT, never
from simspec.support.features import Feature
from tests import worlds

STUB_MODULE = "stub_engine_of_a_test"
STUB = """
import os, time
import numpy as np
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.support.declarations import EXACT, never
from simspec.support.features import Feature
from simspec.contact import Rules

class Stub(Engine):
    NAME, FORMAT, DISTRIBUTION, EXTRA = "stub", "none", "numpy", "stub"
    RULES, LAYERS = Rules("max", "max"), False
    SUPPORT, SETTINGS = dict.fromkeys(Feature, EXACT) | {Feature.CONTROL_NATIVE: never("a stub")}, {}
    LACKS = dict.fromkeys(Capability, "a stub")
    def load(self, folder, sidecar):
        self.what = sidecar["what"]
        if self.what == "crash":
            os.abort()
        if self.what == "leave":
            os._exit(7)
        if self.what == "hang":
            time.sleep(60)
        if self.what == "lost":
            while True:
                pass
        if self.what == "refuse":
            raise ValueError("I do not like it")
    def read_back(self):
        raise KeyError("no such thing")
"""


@pytest.fixture
def stub(monkeypatch, tmp_path):
    """A stub engine, known by name, in a module that this process and the engine's can import."""
    modules = tmp_path / "modules"
    modules.mkdir()
    (modules / f"{STUB_MODULE}.py").write_text(STUB)
    monkeypatch.syspath_prepend(modules)
    monkeypatch.setenv("PYTHONPATH", str(modules), prepend=os.pathsep)
    stub_engine = importlib.import_module(STUB_MODULE)
    monkeypatch.setattr(process, "find_engine", lambda name: stub_engine.Stub)

    def folder_of(what: str) -> Path:
        folder = tmp_path / what
        folder.mkdir()
        (folder / SIDECAR).write_text(f'{{"schema": {SIDECAR_SCHEMA}, "what": "{what.split()[-1]}"}}')
        return folder

    def at_work(what: str, *before: str, deadline: float = 30.0, **parameters):
        given = {"attempt": True, "cpu_seconds": 0.5}
        first = [
            Operation("read_back", {"artifacts": str(folder_of(f"{index} {name}")), **given})
            for index, name in enumerate(before)
        ]
        return call("stub", folder_of(what), [*first, Operation("read_back", parameters)], deadline=deadline)

    yield at_work
    del sys.modules[STUB_MODULE]  # the next test's is in another folder


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("crash", "signal 6"),
        ("leave", "ended with code 7 without a result"),
        ("refuse", "ValueError: I do not like it"),
        ("fine", "KeyError: 'no such thing'"),
    ],
)
def test_a_failing_engine_is_an_error_with_its_cause(stub, what, message):
    with pytest.raises(EngineError, match=message) as caught:
        stub(what)
    assert caught.value.engine == "stub"
    assert caught.value.exit_code == 3


def test_a_hanging_engine_is_killed_at_its_deadline(stub):
    with pytest.raises(EngineError, match="deadline of 2 s"):
        stub("hang", deadline=2.0)


def test_an_attempt_that_crashes_is_refused_and_the_others_go_on(stub):
    """Each is separate, with a limit of CPU time; an endless loop ends long before the deadline."""
    reply = stub("fine", "crash", "refuse", "lost", "leave", "fine", attempt=True, cpu_seconds=0.5)
    assert [answer.result["refused"] for answer in reply.answers] == [
        "the engine's process was ended by signal 6 (SIGABRT)",
        "ValueError: I do not like it",
        f"the engine's process was ended by signal {signal.SIGPROF.value} (SIGPROF)",
        "the engine's process ended with code 7",
        "KeyError: 'no such thing'",
        "KeyError: 'no such thing'",
    ]


@pytest.mark.parametrize("what", ["crash", "leave", "hang"])
def test_the_operation_at_work_is_named(stub, what):
    with pytest.raises(EngineError, match=r"at work on 'read_back' \(operation 3 of 3\)") as caught:
        stub(what, "fine", "refuse", deadline=8.0 if what == "hang" else 60.0)
    assert caught.value.operation == 2


def test_a_missing_engine_is_named_with_the_way_to_install_it(stub, monkeypatch, tmp_path):
    monkeypatch.setattr(process.find_engine("stub"), "version", classmethod(lambda cls: None))
    with pytest.raises(EngineError, match=r"stub: not installed: pip install 'simspec-physics\[stub\]'"):
        call("stub", tmp_path, [])


def test_artifacts_that_are_not_there_are_the_engine_s_failure(stub, tmp_path):
    with pytest.raises(EngineError, match=r"stub: its artifacts are missing: .*nowhere"):
        call("stub", tmp_path / "nowhere", [Operation("read_back")])


def test_an_unknown_engine_is_named():
    with pytest.raises(EngineError, match=f"no such engine; known: {', '.join(base.engines())}"):
        call("bullet9", Path(), [])


class Growing(Engine):
    """An engine whose only body doubles its height each step until it overflows."""

    NAME, FORMAT, DISTRIBUTION, EXTRA = "growing", "none", "numpy", "none"
    RULES, LAYERS = Rules("max", "max"), False
    SUPPORT: ClassVar = dict.fromkeys(Feature, EXACT) | {Feature.CONTROL_NATIVE: never("a stub")}
    SETTINGS: ClassVar = {}
    LACKS: ClassVar = dict.fromkeys(Capability, "a stub")

    def __init__(self):
        self.height = 1e300

    def load(self, folder, sidecar):
        pass

    def body_states(self):
        return np.array([[0.0, 0.0, self.height, 1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6))

    def get_state(self):
        return np.array([self.height]), np.zeros(1)

    def step(self, count, effort=None):
        self.height *= 1e3**count


def session_of(engine, folder) -> Session:
    (folder / SIDECAR).write_text(f'{{"schema": {SIDECAR_SCHEMA}}}')
    return Session(lambda: engine, folder)


def test_a_state_that_is_not_finite_ends_the_run_and_is_recorded(tmp_path):
    operation = {"op": "run", "steps": 100, "every": 1, "channels": ["pose"]}
    result, arrays = record(session_of(Growing(), tmp_path), {}, operation, tmp_path / "0.")
    assert result["failed"] == {"step": 3, "channel": "q", "place": [0]}
    assert result["steps"] == 3
    assert arrays["step"] == {"kind": "f8", "shape": [4]}
    assert np.fromfile(tmp_path / "0.step.bin").tolist() == [0, 1, 2, 3]
    assert np.fromfile(tmp_path / "0.pose.bin").reshape(arrays["pose"]["shape"])[2, 0, 2] == 1e306


CHANNELS = {"pose": (1, 7), "velocity": (1, 6), "q": (2,), "v": (2,), "energy": (2,)}


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("what", CHANNELS)
def test_every_channel_is_looked_at(what, value, tmp_path):
    """A run whose positions are numbers and whose velocities are none is not finite either, and so on for each channel."""

    class unexpected(Growing):
        LACKS: ClassVar = {key: why for key, why in Growing.LACKS.items() if key is not Capability.ENERGY}

        def found(self, name):
            numbers = np.zeros(CHANNELS[name])
            if name == what and self.height > 1.0:
                numbers.flat[-1] = value
            return numbers

        def body_states(self):
            return self.found("pose"), self.found("velocity")

        def get_state(self):
            return self.found("q"), self.found("v")

        def energy(self):
            return tuple(self.found("energy"))

        def step(self, count, effort=None):
            self.height += count

    diverging = unexpected()
    diverging.height = -1.0
    operation = {"op": "run", "steps": 100, "every": 1, "channels": ["pose", "energy"]}
    result, arrays = record(session_of(diverging, tmp_path), {}, operation, tmp_path / "0.")
    place = [k - 1 for k in CHANNELS[what]]
    assert result["failed"] == {"step": 3, "channel": what, "place": place}
    assert arrays["step"]["shape"] == [4]


class HeardError(Exception):
    """Raised by the receiver of progress after enough reports."""


def test_a_long_run_says_how_far_it_is(monkeypatch):
    """The completed share is reported during the run and grows: the run is so long that only a report ends the test."""
    monkeypatch.setattr(process, "LOOK_EVERY", 0.01)
    world = worlds.damped_springs()
    world = dataclasses.replace(
        world,
        physics=dataclasses.replace(world.physics, steps=1_000_000_000),
        record=dataclasses.replace(world.record, every_steps=10_000, channels=()),
    )
    said: list[float] = []

    def listen(share: float) -> None:
        said.append(share)
        if len(set(said)) == 3:
            raise HeardError

    with pytest.raises(HeardError):
        run(world, "mujoco", progress=listen, deadline=120.0)
    assert said == sorted(said)
    assert all(0.0 <= share < 1.0 for share in said)


@pytest.mark.parametrize("threads", [None, "3"])
def test_an_engine_has_a_single_thread_by_default(monkeypatch, tmp_path, threads):
    """A threaded BLAS sums in a different order in each run: the environment is read in the engine's process."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    for name in names:
        monkeypatch.delenv(name, raising=False)
        if threads is not None:
            monkeypatch.setenv(name, threads)
    seen = tmp_path / "seen.json"
    python = tmp_path / "python"
    script = (
        f"import json, os; json.dump({{name: os.environ.get(name) for name in {names!r}}}, open({str(seen)!r}, 'w'))"
    )
    python.write_text(f"#!{sys.executable}\n{script}\n")
    python.chmod(0o755)
    with pytest.raises(EngineError):  # it gives no result: only its environment is wanted
        run(worlds.damped_springs(), "mujoco", python=str(python))
    assert json.loads(seen.read_text()) == dict.fromkeys(names, threads or "1")
