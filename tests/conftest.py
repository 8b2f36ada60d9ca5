"""Settings of every test: hypothesis measures no time, which on a busy machine says nothing about the code; and no test
leaves anything to the tests that follow it in its process, which are others in every run."""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

from simspec.engines.kit import process
from simspec.engines.kit.registry import engines
from simspec.engines.kit.simulated import SimulatedEngine
from simspec.engines.kit.warm import WarmProcesses
from tests import nightly
from tests.installed import LEFT_OUT
from tests.readers import WarmReaders, patched

settings.register_profile("simspec", deadline=None)
settings.load_profile("simspec")

ROOT = Path(__file__).resolve().parent
os.environ["XDG_DATA_HOME"] = os.devnull  # versions of engines that the user has made are none of a test's business
for variable in ("COLUMNS", "LINES"):  # readline sets them, for this process and those that it starts
    os.environ.pop(variable, None)
    os.unsetenv(variable)
# commands that tests start inherit ignored signals (of nohup, or of a shell in the background), and would not end by them
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_report_header() -> list[str]:
    """Nothing is left out in silence: neither here nor in the list of skipped tests at the end."""
    return [f"engine left out: {name}: {why}" for name, why in LEFT_OUT.items()]


LONGEST = (
    *("engines/test_fake.py", "proof/test_verify.py", "test_endings.py", "test_readme.py", "test_stacking.py"),
    *("test_packaging.py", "engines/test_engine_suite.py", "proof/test_contact_scenes.py", "commands/test_sweep.py"),
    *("engines/test_alone.py", "engines/gazebo/test_contact.py", "proof/test_contact_run.py", "test_ci_example.py"),
    *("attribution/test_planted.py", "experiments/test_dask.py", "proof/test_motionless.py", "test_bad_input.py"),
    *("engines/kit/test_process.py", "comparison/test_long.py", "engines/test_motion_scenarios.py"),
    *("engines/drake/test_hydroelastic.py", "report/test_study_analysis.py", "report/test_study_contact.py"),
)
"""Files that take long, or that wait: first, so that no process is left with one of them when the others have ended."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    order = {ROOT / file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path, len(order)))
    for item in nightly.left_out(items, engines()):
        for mark in nightly.NIGHTLY:
            item.add_marker(mark)


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Where all tests are collected, each process imports other files first: pytest compiles the assertions of a file for some
    50 ms, which it keeps for the processes that import the file later."""
    config = session.config
    if not hasattr(config, "workerinput") or config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    first, step = int(config.workerinput["workerid"].removeprefix("gw")), config.workerinput["workercount"]
    for path in sorted(ROOT.rglob("test_*.py"))[first::step]:
        # a module that cannot be imported, or that skips itself, is imported again, and reported, by the collection
        with contextlib.suppress(Exception, pytest.skip.Exception):
            importlib.import_module(".".join((ROOT.name, *path.relative_to(ROOT).with_suffix("").parts)))


gc.disable()  # until the tests begin: of what is collected, all stays


def pytest_collection_finish() -> None:
    """Collected and imported objects live as long as the process: garbage collection in tests skips them. None is made before,
    since it examines all of them for the little that is not in use."""
    gc.freeze()
    gc.enable()


ALONE = "SIMSPEC_TESTS_ALONE"
"""Names the engine that the tests of this process load, and no other that clashes with it."""
OF_PYTEST = {"PYTEST_CURRENT_TEST"}
"""Variables that pytest itself changes from test to test."""


def surroundings() -> dict[str, object]:
    """State that all tests of a process share: the working folder, the environment, handlers of signals."""
    return {
        "folder": os.getcwd(),
        "environment": {name: value for name, value in os.environ.items() if name not in OF_PYTEST},
        "signals": {
            name: signal.getsignal(name) for name in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM, signal.SIGPIPE)
        },
    }


@pytest.fixture(autouse=True)
def leaves_nothing_behind():
    before = surroundings()
    yield
    after = surroundings()
    if after != before:
        os.chdir(before["folder"])  # the tests that follow are not to fail for this one
    assert after == before


@pytest.fixture(autouse=True, scope="session")
def engines_that_clash_are_alone():
    """An engine that may not be in one process with others is loaded where a test of its own begins that process."""
    load = SimulatedEngine.load

    def guarded(engine, folder, sidecar):
        if engine.CLASHES and os.environ.get(ALONE) != engine.NAME:
            pytest.skip(f"{engine.NAME}: run in a process of its own by tests/engines/test_alone.py")
        load(engine, folder, sidecar)

    SimulatedEngine.load = guarded
    yield
    SimulatedEngine.load = load


def processors() -> set[int]:
    """On which processors this thread may run, where the system says."""
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


@pytest.fixture(scope="session")
def warm_processes():
    """Processes that have imported their engine, for all tests of this pytest process."""
    with WarmProcesses() as warm:
        yield warm


@pytest.fixture(scope="module")
def warm_engines(warm_processes):
    """Forks every engine process of the module's tests from a warm process of all tests, as in a sweep: a small run spends most
    of its time on starting Python and importing the engine. For modules that test answers of engines; ``tests/engines/kit``
    tests starts, ends and failures of processes without it."""
    new, everywhere = process.Running, processors()

    def forked(engine, folder, operations, python, deadline, command=None, warm=None):
        bound = processors() != everywhere  # runs that are timed: a forked process is where the warm one is
        return new(engine, folder, operations, python, deadline, command, None if bound else warm_processes)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "Running", forked)
        patch.setattr(process, "begin", lambda engine, python, warm: None)
        yield


@pytest.fixture(scope="session")
def warm_reader_processes():
    """Processes that have imported a reader of files, for all tests of this pytest process."""
    with WarmReaders() as warm:
        yield warm


@pytest.fixture(scope="module")
def warm_readers(warm_reader_processes):
    """Forks every reader of files of unknown origin of the module's tests from a warm process of all tests. For modules that
    test the content of files; tests of limits and of confinement start new processes."""
    with pytest.MonkeyPatch.context() as patch:
        patched(patch, warm_reader_processes)
        yield
