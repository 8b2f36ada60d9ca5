"""Attempts to reach outside of a process, as Python: each returns where it succeeds, and raises OSError where it is refused.

``python attempts.py PROFILE READ WRITE HELD`` confines itself (PROFILE "none": not), tries all of them in the folder WRITE, and
prints what came of each. In READ is a file ``known``; HELD is a process that does nothing, which is attempted upon.
"""

from __future__ import annotations

import ctypes
import errno
import json
import mmap
import os
import platform
import resource
import select
import signal
import socket
import sys
import threading
import time

LIBRARY = ctypes.CDLL(None, use_errno=True)
NUMBERS = {
    "x86_64": {
        "shmget": 29, "personality": 135, "pivot_root": 155, "mount": 165, "reboot": 169, "add_key": 248, "keyctl": 250,
        "inotify_init1": 294, "perf_event_open": 298, "fanotify_init": 300, "setns": 308, "process_vm_readv": 310,
        "memfd_create": 319, "bpf": 321, "userfaultfd": 323, "io_uring_setup": 425, "pidfd_open": 434, "ptrace": 101,
        "kexec_load": 246, "unshare": 272, "init_module": 175, "timer_create": 222, "mq_open": 240, "clone3": 435,
        "open_by_handle_at": 304, "process_madvise": 440, "landlock_create_ruleset": 444, "seccomp": 317,
    },
    "aarch64": {
        "shmget": 194, "personality": 92, "pivot_root": 41, "mount": 40, "reboot": 142, "add_key": 217, "keyctl": 219,
        "inotify_init1": 26, "perf_event_open": 241, "fanotify_init": 262, "setns": 268, "process_vm_readv": 270,
        "memfd_create": 279, "bpf": 280, "userfaultfd": 282, "io_uring_setup": 425, "pidfd_open": 434, "ptrace": 117,
        "kexec_load": 104, "unshare": 97, "init_module": 105, "timer_create": 107, "mq_open": 180, "clone3": 435,
        "open_by_handle_at": 265, "process_madvise": 440, "landlock_create_ruleset": 444, "seccomp": 277,
    },
}[platform.machine()]  # fmt: skip

DONE = {
    "expressions": set(),
    "data": {"sleep", "thread"},
    "files": {"sleep", "thread", "open", "stat", "lstat", "access", "readlink", "statvfs", "mapped file"},
}
DONE["scratch"] = DONE["files"] | {"create", "create without a name", "folder", "unlink"}
"""Attempts that a profile allows; all others fail."""


def call(name, *arguments):
    """A system call, as OSError says what became of it."""
    words = [ctypes.c_long(argument) if isinstance(argument, int) else argument for argument in arguments]
    result = LIBRARY.syscall(ctypes.c_long(NUMBERS[name]), *words)
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result


def of_library(name, *arguments):
    result = getattr(LIBRARY, name)(*arguments)
    if result != 0:
        raise OSError(ctypes.get_errno(), name)
    return result


def mapped(protection, descriptor=-1, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS):
    LIBRARY.mmap.restype = ctypes.c_void_p
    place = LIBRARY.mmap(None, ctypes.c_size_t(4096), protection, flags, descriptor, ctypes.c_long(0))
    if place in (None, ctypes.c_void_p(-1).value):
        raise OSError(ctypes.get_errno(), "mmap")
    return place


def forked():
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)


def bound(family, kind, address):
    with socket.socket(family, kind) as made:
        made.bind(address)


def attempts(read, write, pid):
    """By name."""
    known, made = os.path.join(read, "known"), os.path.join(write, "made-{}")

    def new(name):
        return made.format(name)

    return {
        "files": {
            "open": lambda: open(known, "rb").close(),
            "open a file of the system": lambda: os.close(os.open("/etc/passwd", os.O_RDONLY)),
            "create": lambda: os.close(os.open(new("file"), os.O_CREAT | os.O_WRONLY)),
            "create without a name": lambda: os.close(os.open(write, os.O_TMPFILE | os.O_RDWR)),
            "write": lambda: open(known, "r+b").close(),
            "append": lambda: open(known, "ab").close(),
            "truncate": lambda: os.truncate(known, 1),
            "stat": lambda: os.stat("/etc/passwd"),
            "lstat": lambda: os.lstat("/etc/passwd"),
            "access": lambda: os.access(known, os.R_OK) or refuse(),
            "readlink": lambda: os.readlink("/proc/self/exe"),
            "listdir": lambda: os.listdir("/etc"),
            "folder": lambda: os.mkdir(new("folder")),
            "fifo": lambda: os.mkfifo(new("fifo")),
            "node": lambda: os.mknod(new("node")),
            "rename": lambda: os.rename(known, known),
            "link": lambda: os.link(known, new("link")),
            "symlink": lambda: os.symlink(known, new("symlink")),
            "unlink": lambda: os.unlink(os.path.join(write, "old")),
            "chmod": lambda: os.chmod(known, 0o600),
            "chown": lambda: os.chown(known, os.getuid(), -1),
            "times": lambda: os.utime(known),
            "attributes": lambda: os.setxattr(known, "user.a", b"1"),
            "chdir": lambda: os.chdir(write),
            "umask": lambda: os.umask(0o22),
            "statvfs": lambda: os.statvfs("/"),
            "inotify": lambda: os.close(call("inotify_init1", 0)),
        },
        "processes": {
            "fork": forked,
            "exec": lambda: os.execv("/nowhere", ["nowhere"]),
            "spawn": lambda: os.posix_spawn("/nowhere", ["nowhere"], {}),
            "kill": lambda: os.kill(pid, 0),
            "kill all": lambda: os.killpg(os.getpgid(pid), 0),
            "ptrace": lambda: call("ptrace", 0x4206, pid, 0, 0),
            "memory of another": lambda: call("process_vm_readv", pid, 0, 0, 0, 0, 0),
            "pidfd": lambda: os.close(call("pidfd_open", pid, 0)),
            "environment": lambda: open(f"/proc/{pid}/environ", "rb").close(),
            "own environment": lambda: open("/proc/self/environ", "rb").close(),
            "priority": lambda: os.setpriority(os.PRIO_PROCESS, 0, 5),
            "processors": lambda: os.sched_setaffinity(0, os.sched_getaffinity(0)),
            "session": lambda: os.setsid(),
            "limit": lambda: resource.setrlimit(resource.RLIMIT_CORE, (0, 0)),
            "limit of another": lambda: resource.prlimit(pid, resource.RLIMIT_CORE, (0, 0)),
            "user": lambda: os.setuid(os.getuid()),
            "prctl": lambda: of_library("prctl", 4, 1, 0, 0, 0),
            "personality": lambda: call("personality", 0xFFFFFFFF),
            "handler": lambda: signal.signal(signal.SIGXCPU, signal.SIG_IGN),
        },
        "network": {
            "TCP": lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM).close(),
            "UDP": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).close(),
            "unix": lambda: bound(socket.AF_UNIX, socket.SOCK_STREAM, new("socket")),
            "abstract": lambda: bound(socket.AF_UNIX, socket.SOCK_STREAM, f"\0simspec-{os.getpid()}"),
            "netlink": lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0).close(),
            "pair": lambda: [end.close() for end in socket.socketpair()],
            "pipe": lambda: [os.close(descriptor) for descriptor in os.pipe()],
        },
        "time": {
            "sleep": lambda: time.sleep(0.001),
            "select": lambda: select.select([], [], [], 0.001),
            "alarm": lambda: of_library("alarm", 0) if not setitimer_alone() else None,
            "itimer": lambda: signal.setitimer(signal.ITIMER_REAL, 0),
            "timer": lambda: call("timer_create", 1, 0, ctypes.byref(ctypes.c_int())),
            "clock": lambda: time.clock_settime(time.CLOCK_REALTIME, time.time()),
        },
        "kernel": {
            "memfd": lambda: os.close(os.memfd_create("a")),
            "io_uring": lambda: call("io_uring_setup", 0, 0),
            "userfaultfd": lambda: call("userfaultfd", 1),
            "bpf": lambda: call("bpf", 0, 0, 0),
            "perf": lambda: call("perf_event_open", 0, 0, -1, -1, 0),
            "keyring": lambda: call("keyctl", 0, -3, 0),
            "shared memory": lambda: call("shmget", 0, 0, 0),
            "mount": lambda: call("mount", 0, 0, 0, 0, 0),
            "unshare": lambda: call("unshare", 0),
            "namespace": lambda: call("setns", -1, 0),
            "module": lambda: call("init_module", 0, 0, 0),
            "executable memory": lambda: mapped(mmap.PROT_EXEC | mmap.PROT_READ),
            "memory made executable": made_executable,
            "mapped file": lambda: mapped(mmap.PROT_READ, 0, mmap.MAP_PRIVATE),
            "thread": lambda: started(),
        },
    }


def refuse():
    raise OSError(errno.EPERM, "access")


def setitimer_alone():
    """Whether alarm(2) is no system call here."""
    return platform.machine() == "aarch64"


PAGE = mmap.mmap(-1, 4096)


def made_executable():
    place = ctypes.addressof(ctypes.c_char.from_buffer(PAGE))
    of_library("mprotect", ctypes.c_void_p(place), ctypes.c_size_t(4096), mmap.PROT_READ | mmap.PROT_EXEC)


def started():
    try:
        thread = threading.Thread(target=int)
        thread.start()
    except RuntimeError as error:
        raise OSError(errno.EPERM, str(error)) from None
    thread.join()


def tried(function):
    """The outcome of an attempt: "done", or the name of the error."""
    try:
        function()
    except OSError as error:
        return errno.errorcode.get(error.errno, str(error.errno))
    except BaseException as error:
        return type(error).__name__
    return "done"


def all_tried(read, write, pid):
    return {
        kind: {name: tried(attempt) for name, attempt in some.items()}
        for kind, some in attempts(read, write, pid).items()
    }


if __name__ == "__main__":
    from simspec.confinement import PROFILES, confine, of_python

    profile, read, write, pid = sys.argv[1:]
    if profile != "none":
        opens = of_python() if "openat" in PROFILES[profile].calls else []
        confine(PROFILES[profile], [*opens, read] if opens else (), [write] if profile == "scratch" else ())
    sys.stdout.write(json.dumps(all_tried(read, write, int(pid))))
