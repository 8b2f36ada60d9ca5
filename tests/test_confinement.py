"""The kernel's walls: each attempt succeeds without them, and fails behind them, where no other wall stands."""

from __future__ import annotations

import json
import platform
import struct
import subprocess
import sys

import pytest

from simspec import confinement
from simspec.confinement import MACHINES, NUMBERS, PROFILES, Walls, filter_program, walls
from tests import attempts
from tests.attempts import DONE

pytestmark = pytest.mark.skipif(not (walls().calls and walls().landlock), reason=f"this kernel: {walls().why}")

NOT_BY_ITSELF = {"ENOENT", "EFAULT", "EINVAL", "EBADF", "ENOSYS"}
"""How an attempt that is not confined may end: it reached the kernel's own code, which looked at its arguments."""
REFUSED = {"EPERM", "EACCES", "ValueError"}
"""By the filter of calls, by Landlock, and what Python's setrlimit makes of the first."""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Outcomes of all attempts, by profile: a process for each."""
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    found = {}
    try:
        for profile in ("none", *PROFILES):
            folder = tmp_path_factory.mktemp(profile)
            (folder / "read").mkdir()
            (folder / "write").mkdir()
            (folder / "write/old").touch()
            known = folder / "read/known"
            known.write_text("known")
            words = [sys.executable, attempts.__file__, profile, known.parent, folder / "write", str(child.pid)]
            with open(known, "rb") as stdin:
                done = subprocess.run(words, stdin=stdin, capture_output=True, text=True, cwd=folder, check=False)
            assert done.returncode == 0, done.stderr
            found[profile] = {name: came for some in json.loads(done.stdout).values() for name, came in some.items()}
            found[profile]["names"] = sorted(path.name for path in (folder / "write").iterdir())
            found[profile]["known"] = known.read_text() == "known"
    finally:
        child.communicate(b"\n")
    return found


def test_every_attempt_succeeds_without_a_wall(outcomes):
    """Otherwise the tests below would say nothing."""
    free = outcomes["none"]
    assert len(free) > 70
    for name, came in free.items():
        assert came in ("done", *NOT_BY_ITSELF) or name in ("names", "known"), (name, came)
    assert free["names"] == [
        "made-fifo",
        "made-file",
        "made-folder",
        "made-link",
        "made-node",
        "made-socket",
        "made-symlink",
    ]


@pytest.mark.parametrize("profile", PROFILES)
def test_the_kernel_alone_holds_them(profile, outcomes):
    came = dict(outcomes[profile])
    assert came.pop("known"), "the file is as it was"
    made = ["made-file", "made-folder"] if profile == "scratch" else ["old"]
    assert came.pop("names") == made
    assert {name for name, what in came.items() if what == "done"} == DONE[profile]
    assert {what for what in came.values() if what != "done"} <= REFUSED


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the interfaces of that machine")
@pytest.mark.parametrize("code", [b"\xb8\x14\x00\x00\x00\xcd\x80\xc3", b"\xb8\x27\x00\x00\x40\x0f\x05\xc3"])
def test_calls_by_other_interfaces_of_the_machine_end_the_process(code):
    """getpid by the interface of 32 bits and by x32: their numbers mean other calls."""
    program = f"""
import ctypes, mmap, sys
page = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
page.write({code!r})
other = ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(page)))
from simspec.confinement import PROFILES, confine
if sys.argv[1] == "confined":
    confine(PROFILES["scratch"])
print(other(), flush=True)
"""
    free, confined = (
        subprocess.run([sys.executable, "-c", program, word], capture_output=True, check=False)
        for word in ("free", "confined")
    )
    assert free.returncode in (0, -11), "a kernel without that interface ends it too"
    assert confined.returncode == -31
    assert confined.stdout == b""


def test_threads_that_were_there_before_are_confined_too():
    program = """
import os, threading
from simspec.confinement import PROFILES, confine
go, came = threading.Event(), []
def work():
    go.wait()
    try:
        came.append(os.stat("/"))
    except PermissionError:
        came.append("refused")
thread = threading.Thread(target=work)
thread.start()
confine(PROFILES["data"])
go.set()
thread.join()
os.write(1, str(came[0]).encode())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stdout == b"refused"


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: profile.name)
def test_a_filter_lets_pass_what_its_profile_has_and_nothing_else(profile, machine):
    """By a machine for BPF that is written here: every number of a call, and conditions at their edges."""
    program = filter_program(profile, machine, 77)
    column, architecture = MACHINES[machine]
    names = {numbers[column]: name for name, numbers in NUMBERS.items() if numbers[column] is not None}
    assert len(names) == sum(numbers[column] is not None for numbers in NUMBERS.values()), "no number twice"
    allowed, refused, absent = 0x7FFF0000, 0x00050001, 0x00050026
    for number in range(600):
        name = names.get(number, "")
        conditions = profile.calls.get(name, ())
        good = [0] * 6
        for condition in conditions:
            value = condition.values[-1]
            good[condition.argument] |= 77 if value == confinement.CONFINED_PID else value
        expected = allowed if name in profile.calls else absent if name == "clone3" else refused
        assert answered(program, number, architecture, good) == expected, name
        for condition in conditions:
            bad = list(good)
            bad[condition.argument] ^= condition.mask & -condition.mask if condition.mask != 0xFFFFFFFF else 1 << 20
            assert answered(program, number, architecture, bad) == refused, (name, condition)
    assert answered(program, 0, 0x40000003, [0] * 6) == 0x80000000
    assert answered(program, 0x40000000, architecture, [0] * 6) == 0x80000000


def answered(program, number, architecture, arguments):
    data = struct.pack("<IIQ6Q", number, architecture, 0, *arguments)
    place, value = 0, 0
    while True:
        code, true, false, constant = program[place]
        place += 1
        match code:
            case 0x20:
                (value,) = struct.unpack_from("<I", data, constant)
            case 0x54:
                value &= constant
            case 0x15:
                place += true if value == constant else false
            case 0x45:
                place += true if value & constant else false
            case 0x06:
                return constant


def test_this_kernel_supports_confinement():
    assert walls().landlock >= 1
    assert walls() == Walls(walls().landlock, True)


@pytest.mark.parametrize(
    ("what", "value", "said"),
    [("platform", "darwin", "neither Landlock nor seccomp"), ("machine", "riscv64", "riscv64")],
)
def test_other_systems_have_none_and_say_so(what, value, said, monkeypatch):
    if what == "platform":
        monkeypatch.setattr(sys, "platform", value)
    else:
        monkeypatch.setattr(confinement, "machine", lambda: value)
    offered = walls.__wrapped__()
    assert (offered.landlock, offered.calls) == (0, False)
    assert said in offered.why


def test_a_container_that_forbids_them_is_a_system_without(monkeypatch):
    monkeypatch.setattr(confinement, "_call", lambda *_: -1)
    offered = walls.__wrapped__()
    assert offered == Walls(0, False, "this system offers no Landlock and no seccomp")
    monkeypatch.setattr(confinement, "walls", lambda: offered)
    assert confinement.confine(PROFILES["expressions"]) == offered
    assert subprocess.run(["true"], check=False).returncode == 0, "this process is as free as before"


def test_a_filter_that_does_not_hold_is_an_error(monkeypatch):
    """A kernel, or what takes its place, that says yes to everything."""
    monkeypatch.setattr(confinement, "walls", lambda: Walls(0, True))
    monkeypatch.setattr(confinement, "_call", lambda *_: 0)
    monkeypatch.setattr(confinement, "_library", lambda: type("Library", (), {"prctl": lambda *_: 0}))
    with pytest.raises(confinement.ConfinementError, match="does not apply"):
        confinement.confine_calls(PROFILES["data"])
