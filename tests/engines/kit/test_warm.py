"""Warm processes: a forked process gives the results of a new process, in every way that it may end."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import SIDECAR, SIDECAR_SCHEMA
from simspec.engines.kit import process
from simspec.engines.kit.process import Operation, start
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError
from simspec.testing.bench import run_operation
from tests import worlds
from tests.installed import JOINTED

STUB = """
import os, time, threading
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
    loads = 0
    def load(self, folder, sidecar):
        Stub.loads += 1
        self.what = sidecar["what"]
        print("loads", Stub.loads, flush=True)
        if self.what == "crash":
            os.kill(os.getpid(), 11)
        if self.what == "leave":
            os._exit(7)
        if self.what == "hang":
            time.sleep(60)
        if self.what == "refuse":
            raise ValueError(f"load number {Stub.loads} in {os.getcwd()}")
    def read_back(self):
        raise KeyError("no such thing")

class Threaded(Stub):
    @classmethod
    def prepare(cls):
        threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
"""


@pytest.fixture
def stub(monkeypatch, tmp_path):
    """A stub engine in a module that an engine's process can import, and a folder of artifacts for what it shall do."""
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules" / "warm_stub.py").write_text(STUB)
    monkeypatch.syspath_prepend(tmp_path / "modules")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "modules"))
    monkeypatch.delitem(sys.modules, "warm_stub", raising=False)
    import warm_stub

    monkeypatch.setattr(process, "find_engine", lambda name: warm_stub.Stub)

    def folder_of(what: str):
        folder = tmp_path / what
        folder.mkdir(exist_ok=True)
        (folder / SIDECAR).write_text(f'{{"schema": {SIDECAR_SCHEMA}, "what": "{what}"}}')
        return folder

    return folder_of


def error_of(folder, warm, deadline=30.0) -> str:
    with start("stub", folder, [Operation("read_back")], deadline=deadline, warm=warm) as running:
        assert warm is None or type(running._process).__name__ == "Forked"
        with pytest.raises(EngineError) as raised:
            running.wait()
    return str(raised.value)


@pytest.mark.parametrize("name", JOINTED)
def test_a_forked_process_gives_the_bits_of_a_new_process_and_keeps_nothing(name, tmp_path):
    world = worlds.with_options(worlds.world(worlds.tree(["fixed", "hinge", "hinge"], 3)), name)
    folder = tmp_path / name
    write_folder(compile_world(world, [name])[name].files, folder)
    with WarmProcesses() as warm:
        replies = []
        for processes in (None, warm, warm):
            with start(name, folder, [run_operation(world, 100, 10)], warm=processes) as running:
                assert (type(running._process).__name__ == "Forked") == (processes is not None)
                replies.append(running.wait())
    new, *forked = replies
    for reply in forked:
        assert reply.versions == new.versions
        assert reply.answers[0].arrays.keys() == new.answers[0].arrays.keys()
        for key, value in new.answers[0].arrays.items():
            if key == "seconds":  # durations are no result
                continue
            assert reply.answers[0].arrays[key].tobytes() == value.tobytes()
        assert reply.usage["cpu_user"] < new.usage["cpu_user"]
        assert reply.usage["peak_memory"] > 1e6


@pytest.mark.parametrize("what", ["crash", "leave", "refuse"])
def test_failures_of_a_forked_process_are_reported_as_of_a_new_process(stub, what):
    folder = stub(what)
    with WarmProcesses() as warm:
        new, *forked = [error_of(folder, processes) for processes in (None, warm, warm)]
    place = new.partition(" in ")[0]
    assert [error.partition(" in ")[0] for error in forked] == [place, place]


def test_a_started_warm_process_is_awaited_only_on_its_first_request(stub):
    folder = stub("refuse")
    with WarmProcesses() as warm:
        process.begin("stub", None, None)  # without any, nothing happens
        process.begin("stub", None, warm)
        (server,) = warm._servers.values()
        assert server._ready is None
        with start("stub", folder, [Operation("read_back")], warm=warm) as running:
            assert type(running._process).__name__ == "Forked"
        assert [*warm._servers.values()] == [server]


def test_a_forked_process_has_a_deadline(stub):
    with WarmProcesses() as warm:
        assert "no result within its deadline of 0.3 s" in error_of(stub("hang"), warm, deadline=0.3)
        assert "load number 1" in error_of(stub("refuse"), warm)


def test_leaving_the_block_ends_a_forked_process(stub):
    with WarmProcesses() as warm:
        with start("stub", stub("hang"), [Operation("read_back")], warm=warm) as running:
            pid = running._process.pid
            os.kill(pid, 0)
        for _ in range(200):
            try:
                os.kill(pid, 0)
            except ProcessLookupError:
                break
            time.sleep(0.01)
        else:
            raise AssertionError("it is still there")


def test_a_terminated_warm_process_is_replaced(stub):
    folder = stub("refuse")
    with WarmProcesses() as warm:
        error_of(folder, warm)
        (server,) = warm._servers.values()
        os.kill(server._process.pid, signal.SIGKILL)
        server._process.wait()
        with start("stub", folder, [Operation("read_back")], warm=warm) as running:
            assert type(running._process).__name__ == "Popen"
            with pytest.raises(EngineError, match="load number 1"):
                running.wait()


def test_an_engine_that_starts_threads_is_not_forked(stub, monkeypatch):
    import warm_stub

    monkeypatch.setattr(process, "find_engine", lambda name: warm_stub.Threaded)
    with WarmProcesses() as warm, start("stub", stub("refuse"), [Operation("read_back")], warm=warm) as running:
        assert type(running._process).__name__ == "Popen"
        with pytest.raises(EngineError, match="load number 1"):
            running.wait()


def test_several_threads_may_request_forked_processes(stub):
    folder, errors = stub("refuse"), []
    with WarmProcesses() as warm:
        threads = [threading.Thread(target=lambda: errors.append(error_of(folder, warm))) for _ in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(errors) == 6
    assert all("load number 1" in error for error in errors)
