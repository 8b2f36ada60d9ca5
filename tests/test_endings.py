"""A command that is ended at any moment and by any signal leaves nothing, or files that the next command removes."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError
from pathlib import Path

import pytest

from simspec import files, processes
from simspec.engines.kit import keeper, process
from simspec.errors import EngineError
from tests.caches import cache_home

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")

SPEC = """
simspec: 1
name: long
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 100000 s}
bodies:
  ball: {mass: 1 kg, joint: {type: free}, inertia: {principal: [1, 1, 1]}}
record: {every: 1 s}
"""
SIGNALS = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129, "SIGKILL": -9}


@pytest.fixture
def place(tmp_path):
    """A folder with a long-running spec, and the folder for temporary files."""
    (tmp_path / "tmp").mkdir()
    cache_home(tmp_path)
    (tmp_path / "long.yaml").write_text(SPEC)
    return tmp_path


@pytest.fixture
def begin(place):
    """A function that starts a command. The fixture ends all started processes, also after a failed test."""
    drivers: list[subprocess.Popen] = []

    def begin(*words: str) -> subprocess.Popen:
        drivers.append(
            subprocess.Popen(
                [sys.executable, "-m", "simspec", *words],
                cwd=place,
                env={**os.environ, "TMPDIR": str(place / "tmp"), "XDG_CACHE_HOME": str(place / "cache")},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return drivers[-1]

    yield begin
    for driver in drivers:
        driver.kill()  # of no effect on one that has ended
        driver.communicate()
    for process_id in marked(place):
        with contextlib.suppress(ProcessLookupError):
            os.kill(process_id, signal.SIGKILL)


def marked(place: Path) -> list[int]:
    """The processes that have this test's folder for temporary files."""
    found = []
    for name in os.listdir("/proc"):
        if name.isdigit() and int(name) != os.getpid():
            try:
                environment = Path("/proc", name, "environ").read_bytes()
                state = Path("/proc", name, "stat").read_bytes().rpartition(b")")[2].split()[0]
            except OSError:
                continue
            if f"TMPDIR={place / 'tmp'}\0".encode() in environment and state != b"Z":
                found.append(int(name))
    return found


def until(condition, seconds: float = 60.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return bool(condition())


def left(place: Path) -> list[str]:
    return [path.name for path in (place / "tmp").iterdir()]


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_at_work_leaves_no_process_and_no_folder(begin, place, name):
    """When the engine is at work: the keeper, the worker and the driver are three processes."""
    driver = begin("run", "long.yaml", "--engine", "mujoco", "--no-verify", "--no-repeats")
    assert until(lambda: len(marked(place)) == 3)
    driver.send_signal(getattr(signal, name))
    _, error = driver.communicate(timeout=60)
    assert driver.returncode == SIGNALS[name]
    assert "Traceback" not in error
    assert until(lambda: not marked(place))
    if name != "SIGKILL":
        assert error == f"simspec: ended by {name}\n"
        assert left(place) == []
    ended = begin("run", "long.yaml", "--engine", "mujoco", "--no-verify", "--no-repeats", "--deadline", "0.1")
    assert ended.wait(60) == 3
    ended.communicate()
    assert left(place) == []


def test_finished_engines_are_kept_and_named_when_the_user_interrupts(begin, place):
    (place / "short.yaml").write_text(SPEC.replace("100000 s", "2 s"))
    waits = place / "waits"
    waits.write_text("#!/bin/sh\nexec sleep 1000\n")
    waits.chmod(0o755)
    engines = ("--engine", "mujoco", "--engine", f"dart={waits}")
    driver = begin("run", "short.yaml", *engines, "--no-verify", "--no-repeats")
    kept = place / "runs" / "long" / "mujoco"
    assert until((kept / "provenance.json").exists)
    driver.send_signal(signal.SIGINT)
    _, error = driver.communicate(timeout=60)
    assert driver.returncode == 130
    assert error.splitlines()[-2:] == [
        "kept in runs/long: mujoco; to compare them: simspec view runs/long",
        "simspec: ended by SIGINT",
    ]
    shown = begin("report", "runs/long")
    shown.communicate(timeout=60)
    assert shown.returncode == 0
    assert (place / "runs" / "long" / "report.html").is_file()


def test_a_folder_into_which_a_dying_process_writes_is_removed():
    ended = threading.Event()

    def write(folder: Path) -> None:
        until = time.monotonic() + 0.2
        while time.monotonic() < until:
            with contextlib.suppress(OSError):  # the folder is gone
                (folder / "progress.new").write_text("0.5")
                (folder / "progress.new").rename(folder / "progress")
        ended.set()

    with files.scratch_folder("work") as folder:
        threading.Thread(target=write, args=(folder,), daemon=True).start()
    assert not folder.exists()
    assert ended.wait(10)
    assert not folder.exists()


@pytest.mark.parametrize("command", ["compile", "verify", "run"])
def test_kills_at_random_moments_leave_nothing_that_the_next_call_does_not_remove(begin, place, command):
    generator = random.Random(command)
    words = [command, "long.yaml"] + (["--engine", "mujoco", "--no-verify"] if command == "run" else [])
    for name in ("SIGKILL", "SIGTERM", "SIGINT"):
        driver = begin(*words)
        time.sleep(generator.uniform(0.05, 1.5))
        driver.send_signal(getattr(signal, name))
        _, error = driver.communicate(timeout=60)
        assert "Traceback" not in error
        assert driver.returncode in (SIGNALS[name], 0)
        assert until(lambda: not marked(place))
    done = begin("run", "long.yaml", "--engine", "mujoco", "--no-verify", "--no-repeats", "--deadline", "0.1")
    done.communicate(timeout=60)
    assert left(place) == []


def test_the_engine_of_a_stopped_driver_keeps_its_deadline(begin, place):
    driver = begin("run", "long.yaml", "--engine", "mujoco", "--no-verify", "--deadline", "1")
    assert until(lambda: len(marked(place)) == 3)
    driver.send_signal(signal.SIGSTOP)
    try:
        assert until(lambda: len(marked(place)) == 1)
    finally:
        driver.send_signal(signal.SIGCONT)
    driver.communicate(timeout=60)
    assert driver.returncode == 3


HELPERS = """
import os, subprocess, sys, time
from pathlib import Path
code = "import time, os; time.sleep(60)"
for new in (False, True):
    subprocess.Popen([sys.executable, "-c", code], start_new_session=new, stdin=subprocess.DEVNULL)
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        time.sleep(60)
    os._exit(0)
time.sleep(60)
"""


@pytest.mark.parametrize("how", ["deadline", "ends", "crashes"])
def test_processes_that_an_engine_started_end_with_it(place, monkeypatch, how):
    """Children, children in sessions of their own, and orphans: when it is killed, when it ends, and when it crashes."""
    ends = {"deadline": "time.sleep(60)", "ends": "os._exit(0)", "crashes": "os.abort()"}[how]
    (place / "worker.py").write_text(
        "def main(folder):\n"
        + "".join(f"    {line}\n" for line in HELPERS.replace("\ntime.sleep(60)\n", f"\n{ends}\n").strip().split("\n"))
    )
    (place / "keeper.py").write_text(Path(keeper.__file__).read_text())
    monkeypatch.setattr(keeper, "__file__", str(place / "keeper.py"))
    monkeypatch.setenv("TMPDIR", str(place / "tmp"))
    with pytest.raises(EngineError):
        process.call("mujoco", place, [], deadline=2.0)
    assert until(lambda: not marked(place))


def test_side_by_side_ends_what_the_others_wait_for(place, monkeypatch):
    """An end in the block: engines at work in other threads are killed, and no other is started."""
    (place / "worker.py").write_text("import time\ndef main(folder):\n    time.sleep(60)\n")
    (place / "keeper.py").write_text(Path(keeper.__file__).read_text())
    monkeypatch.setattr(keeper, "__file__", str(place / "keeper.py"))
    monkeypatch.setenv("TMPDIR", str(place / "tmp"))
    said = []

    def twice(number: int) -> None:
        for _ in range(2):
            try:
                process.call("mujoco", place, [], deadline=60.0)
            except (EngineError, CancelledError) as error:
                said.append(type(error))

    waiting = []

    def three() -> None:
        with process.side_by_side(2) as pool:
            waiting.extend(pool.submit(twice, number) for number in range(3))
            assert until(lambda: len(marked(place)) == 4)
            raise processes.Ended(signal.SIGTERM)

    with pytest.raises(processes.Ended):
        three()
    assert said.count(EngineError) == said.count(CancelledError) == 2
    assert waiting[2].cancelled()
    assert not marked(place)
    with pytest.raises(EngineError, match="deadline"):  # and after it engines start again
        process.call("mujoco", place, [], deadline=0.1)


def test_only_abandoned_folders_of_this_user_are_removed(place, monkeypatch):
    monkeypatch.setattr(files.tempfile, "tempdir", str(place / "tmp"))
    with files.scratch_folder("alive") as alive:
        others = [place / "tmp" / name for name in ("simspec-mine", "simspec-link", "simspec-file", "simspec-odd")]
        others[0].mkdir()
        (others[0] / "kept").write_text("kept")
        others[1].symlink_to(others[0])
        others[2].write_text("kept")
        others[3].mkdir()
        (others[3] / files.MARKER).write_text("of another program\n")
        dead = place / "tmp" / "simspec-dead"
        dead.mkdir()
        (dead / files.MARKER).write_bytes(files.CONTENT)
        (dead / "there").symlink_to(others[0])
        (dead / "below").mkdir()
        (dead / "below" / "file").write_text("x")
        files.clean_up.__wrapped__()
        assert not dead.exists()
        assert all(path.exists() for path in (alive, *others))
        assert (others[0] / "kept").read_text() == "kept"
    assert not alive.exists()


def test_a_folder_of_a_process_that_ended_before_it_marked_it_is_removed(place, monkeypatch):
    monkeypatch.setattr(files.tempfile, "tempdir", str(place / "tmp"))
    names = ("empty", "begun", "half", "full", "mode", "locked")
    folders = {name: place / "tmp" / f"simspec-{name}" for name in names}
    for name, folder in folders.items():
        folder.mkdir(0o700 if name == "mode" else files.UNMARKED)
    (folders["begun"] / files.NEW).touch()
    (folders["half"] / files.NEW).write_bytes(files.CONTENT[:10])
    (folders["full"] / "mine").touch()
    with open(folders["locked"] / files.NEW, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        files.clean_up.__wrapped__()
    assert {name for name in names if folders[name].exists()} == {"full", "mode", "locked"}


@pytest.mark.parametrize("call", ["open", "flock", "write", "rename"])
def test_a_folder_that_cannot_be_marked_does_not_stay(place, monkeypatch, call):
    """An interrupt between the making of a folder and its marker; and a folder that another process removed meanwhile."""
    monkeypatch.setattr(files.tempfile, "tempdir", str(place / "tmp"))
    owner = files.fcntl if call == "flock" else files.os
    whole, raised = getattr(owner, call), []

    def once(*arguments, **keywords):
        if not raised:
            raised.append(call)
            raise KeyboardInterrupt
        return whole(*arguments, **keywords)

    files.clean_up()
    monkeypatch.setattr(owner, call, once)
    with pytest.raises(KeyboardInterrupt), files.scratch_folder("work"):
        pass
    assert left(place) == []
    make, gone = files._make, []
    monkeypatch.setattr(files, "_make", lambda folder: make(folder) if gone else gone.append(folder))
    with files.scratch_folder("work") as folder:
        assert folder.is_dir()
    assert left(place) == []


SIGNALLED = """
import os, signal, sys
from simspec.processes import Ended, in_order, run_until_signalled
from simspec.errors import Problem, SpecError
from simspec.cli import guarded as command

def signal_self():
    os.kill(os.getpid(), signal.{name})

class Loses:
    def __del__(self):
        signal_self()

@command
def guarded():
    try:
        signal_self()
    except Ended:
        raise SpecError([Problem("something else")])

def run():
    if {how!r} == "guarded":
        guarded()
    if {how!r} == "destructor":
        lost = Loses()
        del lost
        while True:
            signal.pause()
    try:
        signal_self()
    except Ended as error:
        {then}
    return 0

sys.exit(run_until_signalled(lambda: in_order(run)))
"""


@pytest.mark.parametrize(
    ("how", "then"),
    [
        *(
            (then, f"raise {then}")
            for then in ("ImportError('numpy')", "SystemError", "OSError(4, 'EINTR')", "KeyboardInterrupt")
        ),
        ("goes on", "pass"),
        ("ends", "raise SystemExit(3)"),
        ("guarded", "pass"),
        ("destructor", "pass"),
    ],
)
@pytest.mark.parametrize("name", ["SIGINT", "SIGHUP"])
def test_a_signal_decides_the_exit_code_after_any_other_error(place, how, then, name):
    """Imported or called code may turn an end into another exception, or hide it."""
    script = SIGNALLED.format(name=name, how=how, then=then)
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "TMPDIR": str(place / "tmp")},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stderr, done.stdout) == (SIGNALS[name], f"simspec: ended by {name}\n", "")
    assert left(place) == []


def test_a_full_device_is_a_single_line(place):
    for words in (("--help",), ("--version",), ("check", "bouncing-ball", "--json"), ("check", "--help")):
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                [sys.executable, "-m", "simspec", *words], stdout=full, stderr=subprocess.PIPE, text=True, check=False
            )
        assert done.returncode == 2
        assert done.stderr == "simspec: No space left on device\n" or "standard output: No space" in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_bug_is_a_single_line_and_its_traceback_is_kept(place, monkeypatch, capsys):
    from simspec import cli

    def broken(arguments):
        raise ZeroDivisionError("division\nby \x1b[31mzero")

    monkeypatch.setattr(cli, "_main", broken)
    monkeypatch.setattr(files.tempfile, "tempdir", str(place / "tmp"))
    assert cli.main([]) == 70
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "\x1b" not in said
    assert "this is a bug in simspec" in said
    (kept,) = (place / "tmp").iterdir()
    assert str(kept) in said
    assert "in broken" in kept.read_text()
    monkeypatch.setenv("SIMSPEC_DEBUG", "1")
    assert cli.main([]) == 70
    assert "in broken" in capsys.readouterr().err


def test_no_home_and_no_name(monkeypatch):
    """A user without a home folder and without an entry in the system's list: nothing is kept, and nothing else happens."""
    import pwd

    from simspec.proof.contact import scope as cache

    def no_user(uid):
        raise KeyError(uid)

    monkeypatch.setattr(pwd, "getpwuid", no_user)
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert cache.read("0" * 64) is None
    assert cache.write("0" * 64, []) is False
