"""An installed Webots: where it is, which version, and how it is started without a window.

As its guide says, WEBOTS_HOME is the folder of an installation, whose version stands in
``resources/version.txt``; controllers that Webots does not start itself load ``lib/controller/libController.so``.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import re
import selectors
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from simspec.errors import EngineError, clipped, visible
from simspec.files import scratch_folder
from simspec.processes import counted, isolated

NAME: Final = "webots"
HOME: Final = "WEBOTS_HOME"
"""The environment variable that names the folder of an installation."""
PLACES: Final = (Path("/usr/local/webots"), Path("/snap/webots/current/usr/share/webots"))
"""Where its packages put it."""
PROGRAM, LIBRARY, VERSION_FILE = "webots", "lib/controller/libController.so", "resources/version.txt"
LEAST: Final = "R2023b"
"""The oldest version: the one of which the files are."""
VERSION: Final = re.compile(r"R(\d{4})([a-z])(?:[-. ]?rev(?:ision)? ?\d+)?", re.ASCII | re.IGNORECASE)
MOST_READ: Final = 200
"""Bytes of the file that holds the version."""
OPTIONS: Final = ("--batch", "--mode=fast", "--minimize", "--no-rendering", "--stdout", "--stderr", "--extern-urls")
"""No questions to a user, no waiting for real time, no pictures; the messages of it and its controllers, and the address of the
controller that it waits for, on the standard output."""
SCREEN: Final = ("xvfb-run", "-a")
"""Starts a program with a screen in memory."""


class WebotsInstallation:
    """The Webots of this machine."""

    def version(self) -> str | None:
        """Its version, as ``R2025a``; None where there is none, or where it cannot be used."""
        try:
            return _version(_home())
        except EngineError:
            return None

    def lacking(self) -> EngineError | None:
        """Why it cannot be used; None where it can."""
        try:
            home = _home()
            _version(home)
            _screen()
        except EngineError as error:
            return error
        return None

    def command(self, world: Path, port: int) -> list[str]:
        """The command that starts it on a world. Raises EngineError where it cannot be used."""
        home = _home()
        _version(home)
        return [*_screen(), str(home / PROGRAM), *OPTIONS, f"--port={port}", str(world)]

    def library(self) -> Path:
        """The library of controllers. Raises EngineError where it cannot be used."""
        return _home() / LIBRARY

    def environment(self) -> dict[str, str]:
        """The environment of Webots and of its controller. Raises EngineError where it cannot be used."""
        # Webots makes a folder for its controllers below TMPDIR, and controllers look for it in /tmp
        environment = {name: value for name, value in os.environ.items() if name != "TMPDIR"}
        environment[HOME] = str(_home())
        environment.setdefault("USER", environment.get("LOGNAME", "simspec"))  # a part of that folder's name
        return environment


INSTALLED: Final = WebotsInstallation()


def _home() -> Path:
    """The folder of the installation: that of the environment variable, of the program on the path, or a usual one."""
    if not sys.platform.startswith("linux"):
        raise EngineError(NAME, "simspec starts Webots on Linux alone")
    named = os.environ.get(HOME)
    if named:
        return _whole(Path(named), f"{HOME} names {named}, which")
    found = shutil.which(PROGRAM)
    if found is not None and _is_home(home := Path(found).resolve().parent):
        return _whole(home, f"{home}, whose webots is on the path,")
    for place in PLACES:
        if _is_home(place):
            return _whole(place, str(place))
    raise EngineError(NAME, f"there is none: no webots on the path, and {HOME} is not set")


def _is_home(place: Path) -> bool:
    return (place / VERSION_FILE).is_file()


def _whole(home: Path, what: str) -> Path:
    for part in (VERSION_FILE, PROGRAM, LIBRARY):
        if not (home / part).is_file():
            raise EngineError(NAME, f"{what} has no {part}")
    if not os.access(home / PROGRAM, os.X_OK):
        raise EngineError(NAME, f"{what} has a {PROGRAM} that cannot be executed")
    return home.resolve()


def _version(home: Path) -> str:
    file = home / VERSION_FILE
    try:
        with open(file, "rb") as opened:
            text = opened.read(MOST_READ).decode("ascii", errors="replace").strip()
    except OSError as error:
        raise EngineError(NAME, f"{file}: {error.strerror}") from None
    found = VERSION.fullmatch(text)
    if found is None:
        raise EngineError(NAME, f"{file} should have a version like {LEAST}, and has {text[:40]!r}")
    version = f"R{found[1]}{found[2].lower()}"
    if version < LEAST:
        raise EngineError(NAME, f"{home} is {version}: simspec writes worlds of {LEAST}, which it does not read")
    return version


def _screen() -> tuple[str, ...]:
    """The prefix of the command that gives Webots the screen that it needs, though nothing is drawn."""
    if os.environ.get("DISPLAY"):
        return ()
    if shutil.which(SCREEN[0]) is None:
        why = f"there is no screen (DISPLAY is not set), and no {SCREEN[0]}, which makes one in memory"
        raise EngineError(NAME, f"{why}: apt-get install xvfb")
    return SCREEN


# A running Webots with its controller: two programs that end with this object.

CONTROLLER = Path(__file__).with_name("controller.py")
ADDRESS = re.compile(r"ipc://\d+/\S+")
"""Printed by Webots for each controller that it waits for (``--extern-urls``)."""
READY = 180.0
"""s until Webots has to wait for its controller: ten times what a cold start takes on a slow machine."""
ANSWER = 600.0
"""s for one answer, of many steps too; the deadline of the engine's process is for all of them."""
ENDING = 5.0
"""s for Webots to end on request."""
MOST_LINES, MOST_LINE = 200, 500
"""Of what it says, what is kept."""
LARGEST = 2**28
"""Bytes of an answer in JSON: a world of 2,000 bodies has 20 MB."""
COMPLAINT = re.compile(r"\b(ERROR|WARNING)\b")
"""Of the lines that Webots prints, those that are passed on."""
FAILED = re.compile(r"error|cannot", re.IGNORECASE)
"""Of the lines of its library, those that say why it failed: others come later, out of a buffer."""


class Live:
    """Webots in the state in which a file begins. ``bodies``: names of its nodes; ``tops``: numbers of those that move by
    themselves. Raises EngineError where Webots, or the connection to it, does not come to be."""

    def __init__(self, text: str, timestep: float, bodies: Sequence[str], tops: Sequence[int]):
        self._lines: list[str] = []
        self._count, self._tops = len(bodies), len(tops)
        self._programs: list[subprocess.Popen[bytes]] = []
        self._resources = contextlib.ExitStack()
        try:
            self._start(text, timestep, bodies, tops)
        except BaseException:
            self.close()
            raise

    def _start(self, text: str, timestep: float, bodies: Sequence[str], tops: Sequence[int]) -> None:
        folder = self._resources.enter_context(scratch_folder("webots"))
        world = folder / "world.wbt"
        world.write_text(text, encoding="utf-8")
        environment = INSTALLED.environment()
        webots = self._program(INSTALLED.command(world, _free_port()), folder, environment, subprocess.PIPE)
        address = self._address(webots)
        ours, theirs = socket.socketpair()
        self._channel = self._resources.enter_context(ours)
        with theirs, open(folder / "controller.txt", "wb") as said:
            words = isolated(str(CONTROLLER), str(INSTALLED.library()), str(theirs.fileno()))
            self._said = folder / "controller.txt"
            self._program(words, folder, {**environment, "WEBOTS_CONTROLLER_URL": address}, said, theirs.fileno())
        self._send_json({"bodies": list(bodies), "tops": list(tops)})
        reply = self._json()
        if reply["missing"]:
            raise EngineError(NAME, f"Webots read the file without {reply['missing'][0]}")
        if reply["time"] != 0.0:
            raise EngineError(NAME, f"Webots had stepped to {reply['time']:g} s when its controller came")
        if reply["timestep"] != round(timestep * 1e3):
            raise EngineError(NAME, f"Webots steps by {reply['timestep']:g} ms, should by {timestep * 1e3:g}")
        pids = _processes(webots.pid)
        self._resources.enter_context(counted(lambda: _processor_seconds(pids)))

    def _program(
        self, words: Sequence[str], folder: Path, environment: dict[str, str], output: Any, descriptor: int = -1
    ) -> subprocess.Popen[bytes]:
        try:
            program = subprocess.Popen(
                words,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                pass_fds=() if descriptor < 0 else (descriptor,),
                start_new_session=True,
            )
        except OSError as error:
            raise EngineError(NAME, f"{words[0]} cannot be started: {error.strerror}") from None
        self._programs.append(program)
        return program

    def _address(self, webots: subprocess.Popen[bytes]) -> str:
        """Where the controller finds Webots, which says so when it has read the world."""
        if webots.stdout is None:
            raise AssertionError("started with a pipe")
        found: queue.Queue[str] = queue.Queue()
        reader = threading.Thread(target=self._listen, args=(webots.stdout, found), daemon=True)
        reader.start()
        ends = time.monotonic() + READY
        while time.monotonic() < ends:
            with contextlib.suppress(queue.Empty):
                return found.get(timeout=0.1)
            if webots.poll() is not None:
                reader.join(1.0)
                with contextlib.suppress(queue.Empty):
                    return found.get_nowait()
                raise EngineError(NAME, f"Webots ended with code {webots.returncode}{self._last()}")
        raise EngineError(NAME, f"Webots was not ready within {READY:g} s{self._last()}")

    def _listen(self, output: IO[bytes], found: queue.Queue[str]) -> None:
        """Read the output of Webots until it ends, so that it never waits for a reader."""
        with output:
            while line := output.readline(8 * MOST_LINE):
                text = clipped(visible(line.decode(errors="replace").strip()), MOST_LINE)
                if ADDRESS.fullmatch(text):
                    found.put(text)
                elif text and len(self._lines) < MOST_LINES:
                    self._lines.append(text)

    def _last(self) -> str:
        """The last message of the controller, or else of Webots, for an error."""
        with contextlib.suppress(IndexError, OSError, subprocess.TimeoutExpired):
            self._programs[1].wait(1.0)  # its messages are then written
            said = self._said.read_bytes()[-8 * MOST_LINE :].decode(errors="replace").strip().splitlines()
            if worst := [line for line in said if FAILED.search(line)] or said:
                return f": {clipped(visible(worst[-1]), MOST_LINE)}"
        return f": {self._lines[-1]}" if self._lines else ""

    # --- messages -------------------------------------------------------------------------------------------------

    def _send(self, content: bytes) -> None:
        try:
            self._channel.sendall(content)
        except OSError as error:
            raise EngineError(NAME, f"its controller ended ({error.strerror}){self._last()}") from None

    def _received(self, count: int) -> bytes:
        parts, ends = [], time.monotonic() + ANSWER
        with selectors.DefaultSelector() as selector:
            selector.register(self._channel, selectors.EVENT_READ)
            while count:
                if not selector.select(min(1.0, max(0.0, ends - time.monotonic()))):
                    if self._programs[0].poll() is not None:
                        raise EngineError(NAME, f"Webots ended with code {self._programs[0].returncode}{self._last()}")
                    if time.monotonic() >= ends:
                        raise EngineError(NAME, f"Webots gave no answer within {ANSWER:g} s{self._last()}")
                    continue
                try:
                    part = self._channel.recv(count)
                except OSError as error:
                    raise EngineError(NAME, f"its controller ended ({error.strerror}){self._last()}") from None
                if not part:
                    raise EngineError(NAME, f"its controller ended{self._last()}")
                parts.append(part)
                count -= len(part)
        return b"".join(parts)

    def _send_json(self, content: Any) -> None:
        text = json.dumps(content).encode()
        self._send(struct.pack("<I", len(text)) + text)

    def _json(self) -> Any:
        (count,) = struct.unpack("<I", self._received(4))
        if count > LARGEST:
            raise EngineError(NAME, f"its controller answers {count:,} bytes")
        return json.loads(self._received(count))

    # --- requests -------------------------------------------------------------------------------------------------

    def nodes(self) -> list[dict[str, Any]]:
        """The nodes of the world as Webots holds them (``controller.py``)."""
        self._send(b"n")
        nodes: list[dict[str, Any]] = self._json()
        return nodes

    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (n, 3) and rotation matrices (n, 3, 3) of the bodies, velocities (tops, 6), in the file's world axes."""
        self._send(b"s")
        numbers = np.frombuffer(self._received(8 * (12 * self._count + 6 * self._tops)), dtype="<f8")
        if not np.isfinite(numbers).all():
            raise EngineError(NAME, "a state is not finite")
        placed = numbers[: 12 * self._count].reshape(-1, 12)
        return placed[:, :3], placed[:, 3:].reshape(-1, 3, 3), numbers[12 * self._count :].reshape(-1, 6)

    def step(self, count: int, wrenches: np.ndarray | None = None) -> None:
        """Step ``count`` times; forces at the centres of mass and torques (tops, 6), in the file's world axes, act in the first
        of them."""
        push = b"" if wrenches is None else b"f" + np.ascontiguousarray(wrenches, dtype="<f8").tobytes()
        self._send(push + b"g" + struct.pack("<I", count))
        (ended,) = struct.unpack("<i", self._received(4))
        if ended:
            raise EngineError(NAME, f"Webots ended in a step{self._last()}")

    def complaints(self) -> list[str]:
        """The errors and warnings that Webots has printed."""
        return [line for line in self._lines if COMPLAINT.search(line)]

    def close(self) -> None:
        """End both programs, and all that they started."""
        for program in reversed(self._programs):
            _end(program)
        self._programs = []
        self._resources.close()


def _end(program: subprocess.Popen[bytes]) -> None:
    for number, patience in ((signal.SIGTERM, ENDING), (signal.SIGKILL, None)):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(program.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            program.wait(patience)
            if number == signal.SIGKILL:
                return


def _free_port() -> int:
    """A port that nothing listens on now; Webots takes another, and says so, where that has changed."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _processes(session: int) -> list[int]:
    """The processes of a session: Webots is started by others."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with contextlib.suppress(OSError, ProcessLookupError):
                if os.getsid(int(entry.name)) == session:
                    found.append(int(entry.name))
    return found


def _processor_seconds(pids: Sequence[int]) -> float:
    """Processor time of processes, to what the system counts by (10 ms)."""
    ticks = 0
    for pid in pids:
        with contextlib.suppress(OSError):
            fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")
