"""Confinement of a process by the Linux kernel: Landlock for files, a seccomp filter for system calls. Nothing undoes it.

A process that reads files of unknown origin calls :func:`confine` after it has imported what it needs, and before it reads
the first byte of them. The permissions of a process are data: :data:`PROFILES`. The table in
``docs/concepts/security.md`` lists who uses which.

The kernel's interfaces are used directly, by ctypes: of the packages that offer them, ``pyseccomp`` needs a C library and
``landlock`` is a development release; the filter here is a list of numbers, which a test runs call by call. The module needs
the standard library alone: engines' processes use it, in whatever interpreter they have.
"""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

WRITE_FLAGS: Final = os.O_RDWR | os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND | 0o20000000
"""Flags of open(2) that make or change a file; the last is O_TMPFILE."""
PROT_EXEC: Final = 4
MAP_ANONYMOUS: Final = 0x20
CLONE_THREAD: Final = 0x10000
RLIMIT_CPU: Final = 0
IOCTL: Final = (0x5401, 0x5450, 0x5451)
"""Of ioctl(2): whether a descriptor is a terminal, and whether programs inherit it."""
FCNTL: Final = (0, 1, 2, 3, 4, 5, 6, 7, 1030)
"""Of fcntl(2): copies of a descriptor, its flags, locks. Not: whom a signal is sent to."""
CONFINED_PID: Final = -1
"""In a condition: the number of the confined process."""


class Where(NamedTuple):
    """A condition on an argument of a system call: its bits of ``mask`` have one of the ``values``."""

    argument: int
    values: tuple[int, ...]
    mask: int = 0xFFFFFFFF


Conditions = tuple[Where, ...]
"""All hold."""


def _calls(text: str) -> dict[str, Conditions]:
    return dict.fromkeys(text.split(), ())


COMPUTING: Final[Mapping[str, Conditions]] = {
    **_calls("read write readv writev close lseek brk munmap mremap madvise futex sched_yield gettid getpid"),
    **_calls("clock_gettime clock_getres gettimeofday time getrandom exit exit_group rt_sigreturn rt_sigprocmask"),
    **_calls("restart_syscall getrusage"),
    "mmap": (Where(2, (0,), PROT_EXEC), Where(3, (MAP_ANONYMOUS,), MAP_ANONYMOUS)),
    "mprotect": (Where(2, (0,), PROT_EXEC),),
}
"""Descriptors that are open, memory that is not executable, clocks, the end."""
THREADS: Final[Mapping[str, Conditions]] = {
    **_calls("set_robust_list rseq sched_getaffinity getcpu sigaltstack futex_waitv membarrier sysinfo uname"),
    **_calls("poll ppoll nanosleep clock_nanosleep getuid geteuid getgid getegid times dup dup2 dup3 fstat"),
    "clone": (Where(0, (CLONE_THREAD,), CLONE_THREAD),),
    "tgkill": (Where(0, (CONFINED_PID,)),),
    "prlimit64": (Where(0, (0,)), Where(1, (RLIMIT_CPU,))),
    "fcntl": (Where(1, FCNTL),),
    "ioctl": (Where(1, IOCTL),),
}
"""Threads, copies of descriptors, signals to the process itself (abort), and its limit of processor time for the next file."""
READING: Final[Mapping[str, Conditions]] = {
    **_calls("stat lstat newfstatat statx access faccessat faccessat2 readlink readlinkat getdents64 getcwd"),
    **_calls("statfs fstatfs fadvise64 pread64 getppid"),
    "open": (Where(1, (0,), WRITE_FLAGS),),
    "openat": (Where(2, (0,), WRITE_FLAGS),),
    "mmap": (Where(2, (0,), PROT_EXEC),),
}
"""Files that Landlock allows are opened to be read."""
WRITING: Final[Mapping[str, Conditions]] = {
    **_calls("open openat mkdir mkdirat unlink unlinkat rmdir rename renameat renameat2 ftruncate pwrite64 fsync"),
    **_calls("fdatasync flock fallocate"),
}
"""Files and folders where Landlock allows them."""


class Profile(NamedTuple):
    """The permissions of a kind of process. ``loads``: whether it may map code from files; ``keeps``: capabilities that it
    keeps where it is the superuser's (1, 2: to open what another user owns)."""

    name: str
    calls: Mapping[str, Conditions]
    keeps: tuple[int, ...] = ()


PROFILES: Final = {
    entry.name: entry
    for entry in (
        Profile("expressions", COMPUTING),
        Profile("data", {**COMPUTING, **THREADS}),
        Profile("files", {**COMPUTING, **THREADS, **READING}, (1, 2)),
        Profile("scratch", {**COMPUTING, **THREADS, **READING, **WRITING}, (1, 2)),
    )
}
"""By name: ``expressions`` computes from what it is sent; ``data`` has threads too; ``files`` opens files to read them;
``scratch`` writes into a folder as well. None has a network, programs, other processes, devices, or executable memory."""

NUMBERS: Final[Mapping[str, tuple[int | None, int | None]]] = {
    "read": (0, 63), "write": (1, 64), "open": (2, None), "close": (3, 57), "stat": (4, None), "fstat": (5, 80),
    "lstat": (6, None), "poll": (7, None), "lseek": (8, 62), "mmap": (9, 222), "mprotect": (10, 226),
    "munmap": (11, 215), "brk": (12, 214), "rt_sigprocmask": (14, 135),
    "rt_sigreturn": (15, 139), "ioctl": (16, 29), "pread64": (17, 67), "pwrite64": (18, 68), "readv": (19, 65),
    "writev": (20, 66), "access": (21, None), "sched_yield": (24, 124), "mremap": (25, 216), "madvise": (28, 233),
    "dup": (32, 23), "dup2": (33, None), "nanosleep": (35, 101), "getpid": (39, 172), "clone": (56, 220),
    "exit": (60, 93), "uname": (63, 160), "fcntl": (72, 25), "flock": (73, 32), "fsync": (74, 82),
    "fdatasync": (75, 83), "ftruncate": (77, 46), "getcwd": (79, 17), "rename": (82, None), "mkdir": (83, None),
    "rmdir": (84, None), "unlink": (87, None), "readlink": (89, None), "umask": (95, 166), "gettimeofday": (96, 169),
    "getrusage": (98, 165), "sysinfo": (99, 179), "times": (100, 153), "getuid": (102, 174), "getgid": (104, 176),
    "geteuid": (107, 175), "getegid": (108, 177), "getppid": (110, 173), "capget": (125, 90), "capset": (126, 91),
    "sigaltstack": (131, 132), "statfs": (137, 43), "fstatfs": (138, 44), "gettid": (186, 178), "time": (201, None),
    "futex": (202, 98), "sched_getaffinity": (204, 123), "getdents64": (217, 61), "restart_syscall": (219, 128),
    "fadvise64": (221, 223), "clock_gettime": (228, 113), "clock_getres": (229, 114), "clock_nanosleep": (230, 115),
    "exit_group": (231, 94), "tgkill": (234, 131), "openat": (257, 56), "mkdirat": (258, 34),
    "newfstatat": (262, 79), "unlinkat": (263, 35), "renameat": (264, 38), "readlinkat": (267, 78),
    "faccessat": (269, 48), "ppoll": (271, 73), "set_robust_list": (273, 99), "fallocate": (285, 47),
    "dup3": (292, 24), "prlimit64": (302, 261), "getcpu": (309, 168), "renameat2": (316, 276),
    "seccomp": (317, 277), "getrandom": (318, 278), "membarrier": (324, 283), "statx": (332, 291),
    "rseq": (334, 293), "clone3": (435, 435), "faccessat2": (439, 439), "landlock_create_ruleset": (444, 444),
    "landlock_add_rule": (445, 445), "landlock_restrict_self": (446, 446), "futex_waitv": (449, 449),
}  # fmt: skip
"""Numbers of system calls on x86_64 and aarch64, from the kernel's headers; None: that machine has no such call."""
MACHINES: Final = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}
"""The column of :data:`NUMBERS`, and AUDIT_ARCH."""

# --- offers of the kernel -------------------------------------------------------------------------------------


class Walls(NamedTuple):
    """The confinement that the kernel offers, or that a process has: the version of Landlock (0: none), and whether system
    calls are filtered. ``why``: the reason where either is missing."""

    landlock: int = 0
    calls: bool = False
    why: str = ""


class ConfinementError(RuntimeError):
    """The kernel reported a confinement that does not hold."""


@functools.cache
def walls() -> Walls:
    """The confinement that the kernel offers to this process. Nothing is confined."""
    if not sys.platform.startswith("linux"):
        return Walls(why=f"{sys.platform} has neither Landlock nor seccomp")
    if machine() not in MACHINES or struct.calcsize("P") != 8:
        return Walls(why=f"no system calls are known of the machine {machine()}")
    try:
        version = max(0, _call("landlock_create_ruleset", 0, 0, 1))
        action = ctypes.c_uint32(_ERRNO)
        filters = _call("seccomp", 2, 0, ctypes.byref(action)) == 0
    except (AttributeError, OSError) as error:  # a C library without syscall(2)
        return Walls(why=f"no system calls can be made: {error}")
    missing = [name for name, there in (("Landlock", version), ("seccomp", filters)) if not there]
    return Walls(version, filters, f"this system offers no {' and no '.join(missing)}" if missing else "")


@functools.cache
def machine() -> str:
    """The machine's name, as the kernel calls it; a confined process may not ask for it."""
    return os.uname().machine


@functools.cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _call(name: str, *arguments: object) -> int:
    """A system call; -1 where it fails, as ctypes.get_errno() says."""
    column, _ = MACHINES[machine()]
    number = NUMBERS[name][column]
    words = [ctypes.c_long(argument) if isinstance(argument, int) else argument for argument in arguments]
    return int(_library().syscall(ctypes.c_long(number or 0), *words))


def _demand(result: int, what: str) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
    return result


# --- confinement ----------------------------------------------------------------------------------------------


def confine(profile: Profile, read: Iterable[str] = (), write: Iterable[str] = ()) -> Walls:
    """Confine this process, all its threads and what follows from it, for ever, as far as the kernel offers it: see
    :func:`confine_files` and :func:`confine_calls`. Raises ConfinementError where the kernel says yes and nothing holds."""
    files = confine_files(read, write)
    calls = confine_calls(profile)
    return Walls(files.landlock, calls.calls, files.why or calls.why)


_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_FOLDER, _TRUNCATE, _DEVICE = (1 << bit for bit in (0, 1, 2, 3, 14, 15))
_NAMES = sum(1 << bit for bit in (4, 5, 7, 8, 13))
"""Remove folders and files, make folders and files, rename between folders. Not: devices, sockets, pipes, links."""
_OF_A_FILE = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _DEVICE
_FROM_VERSION = ((1, (1 << 13) - 1), (2, 1 << 13), (3, _TRUNCATE), (5, _DEVICE))
"""Rights of files, by the version of Landlock that has them first."""


def confine_files(read: Iterable[str] = (), write: Iterable[str] = ()) -> Walls:
    """Let the calling thread, and those that it starts, open files to read them below ``read`` and ``write`` alone, and make,
    change and remove files below ``write`` alone; no TCP, no abstract sockets and no signals to others, from the versions of
    Landlock on that know them. Paths that do not exist are left out."""
    offered = walls()
    if not offered.landlock:
        return offered
    version = offered.landlock
    rights = sum(bits for first, bits in _FROM_VERSION if version >= first)
    network = 0b11 if version >= 4 else 0
    scopes = 0b11 if version >= 6 else 0
    words = [rights, network, scopes][: 1 + (version >= 4) + (version >= 6)]
    attributes = struct.pack(f"={len(words)}Q", *words)
    try:
        _demand(_library().prctl(38, 1, 0, 0, 0), "no new privileges")  # PR_SET_NO_NEW_PRIVS
        rules = _demand(_call("landlock_create_ruleset", attributes, len(attributes), 0), "rules of Landlock")
    except OSError as error:
        return Walls(why=str(error))
    try:
        for paths, allowed in (
            (read, _READ_FILE | _READ_FOLDER),
            (write, _READ_FOLDER | _READ_FILE | _WRITE_FILE | _NAMES | _TRUNCATE),
        ):
            for path in paths:
                _allow(rules, path, allowed & rights)
        _demand(_call("landlock_restrict_self", rules, 0), "Landlock")
    finally:
        os.close(rules)
    return Walls(version)


def _allow(rules: int, path: str, rights: int) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return  # a path that does not exist, or cannot be reached, stays closed
    try:
        if not os.path.isdir(path):
            rights &= _OF_A_FILE
        rule = struct.pack("=Qi", rights, place)
        _demand(_call("landlock_add_rule", rules, 1, rule, 0), f"a rule of Landlock for {path}")
    finally:
        os.close(place)


def confine_calls(profile: Profile) -> Walls:
    """Let all threads of this process make the system calls of a profile alone; others fail with EPERM. Capabilities are given
    up first. Raises ConfinementError where the kernel installed the filter and does not apply it."""
    offered = walls()
    if not offered.calls:
        return offered
    _drop_capabilities(profile.keeps)
    code = b"".join(struct.pack("=HBBI", *line) for line in filter_program(profile, machine(), os.getpid()))
    lines = ctypes.create_string_buffer(code, len(code))
    program = struct.pack("@HxxxxxxP", len(code) // 8, ctypes.addressof(lines))
    try:
        _demand(_library().prctl(38, 1, 0, 0, 0), "no new privileges")
        _demand(_call("seccomp", 1, 1, program), "seccomp")  # SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC
    except OSError as error:
        return Walls(why=str(error))
    before = _call("umask", 0o77)  # in no profile
    if before != -1:
        _call("umask", before)
        raise ConfinementError("the kernel took a filter of system calls and does not apply it")
    return Walls(calls=True)


def _drop_capabilities(keeps: Sequence[int]) -> None:
    """Give up capabilities of the superuser: less is left to a mistake of the rules. A process without capabilities is
    unchanged."""
    head = struct.pack("=II", 0x20080522, 0)  # the third version; 0: this process
    has = ctypes.create_string_buffer(24)
    if _call("capget", head, has) < 0:
        return
    kept = [
        sum(1 << number for number in keeps if number < 32),
        sum(1 << number - 32 for number in keeps if number > 31),
    ]
    low, high = (permitted & mask for permitted, mask in zip(struct.unpack("=6I", has.raw)[1::3], kept, strict=True))
    _call("capset", head, struct.pack("=6I", low, low, 0, high, high, 0))


# --- the filter -----------------------------------------------------------------------------------------------

_LOAD, _AND, _IF_EQUAL, _RETURN = 0x20, 0x54, 0x15, 0x06
_IF_ANY_BIT = 0x45
_ALLOW, _ERRNO, _KILL = 0x7FFF0000, 0x00050000, 0x80000000
_X32 = 0x40000000
"""The bit of calls of x86_64's other interface, whose numbers mean other calls."""
_NUMBER, _MACHINE, _ARGUMENTS = 0, 4, 16
"""Places in seccomp_data; arguments are eight bytes long, little-endian."""
Line = tuple[int, int, int, int]
"""Code, lines to skip where it is true and where it is false, and a number."""


def filter_program(profile: Profile, kind: str, pid: int) -> list[Line]:
    """The filter of a profile on a machine, in the kernel's form of BPF. Calls of another interface end the process."""
    column, architecture = MACHINES[kind]
    lines: list[Line] = [
        (_LOAD, 0, 0, _MACHINE),
        (_IF_EQUAL, 1, 0, architecture),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, _NUMBER),
        (_IF_ANY_BIT, 0, 1, _X32),
        (_RETURN, 0, 0, _KILL),
    ]
    for name, conditions in profile.calls.items():
        number = NUMBERS[name][column]
        if number is not None:
            rule = [line for condition in conditions for line in _test(condition, pid)] + [(_RETURN, 0, 0, _ALLOW)]
            lines += [(_IF_EQUAL, 0, len(rule), number), *rule]
    # glibc starts threads by clone3, whose flags no filter sees, and by clone where there is none
    threads = NUMBERS["clone3"][column]
    lines += [(_IF_EQUAL, 0, 1, threads or 0), (_RETURN, 0, 0, _ERRNO | errno.ENOSYS)]
    return [*lines, (_RETURN, 0, 0, _ERRNO | errno.EPERM)]


def _test(condition: Where, pid: int) -> list[Line]:
    """Refuse unless a condition holds. The lower half of an argument is all that the kernel takes of those that are tested."""
    values = [pid if value == CONFINED_PID else value for value in condition.values]
    found = [(_IF_EQUAL, len(values) - place, 0, value) for place, value in enumerate(values)]
    return [
        (_LOAD, 0, 0, _ARGUMENTS + 8 * condition.argument),
        (_AND, 0, 0, condition.mask),
        *found,
        (_RETURN, 0, 0, _ERRNO | errno.EPERM),
    ]


ANY_LOCALE: Final = {"LC_ALL": "C.UTF-8", "PYTHONUTF8": "1"}
"""Environment of a process that reads files: texts and numbers mean the same whatever the user's language, and packages whose
sources are not ASCII can be imported."""

# --- files of the interpreter -----------------------------------------------------------------------------------

SYSTEM: Final = (
    *("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache", "/dev/null", "/dev/urandom"),
    *("/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system/cpu"),
)
"""Shared libraries, and the files in which numerical libraries look up processors and memory."""


def of_python() -> list[str]:
    """Folders and files that this interpreter and its packages are in, and the system's libraries."""
    simspec = os.path.dirname(os.path.abspath(__file__))  # an engine's interpreter need not have it
    finders = [sys.modules.get(getattr(protocol, "__module__", "")) for protocol in sys.meta_path]
    linked = [
        place for finder in finders for place in getattr(finder, "MAPPING", {}).values()
    ]  # packages in development
    libraries = os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    folders = [sys.prefix, sys.base_prefix, simspec, *linked, *sys.path, *libraries]
    return [*dict.fromkeys(os.path.realpath(folder) for folder in folders if folder), *SYSTEM]
