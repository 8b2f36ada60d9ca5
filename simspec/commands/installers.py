"""Programs that install engines, pip and apt-get: whether one may be run, running it, and its own words where it fails."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from simspec import files
from simspec.errors import clipped, visible
from simspec.outputs.files import file_size
from simspec.processes import ELSEWHERE

DEADLINE = 3600.0
"""s for one command: the largest engine is some 100 MB, and a slow line has an hour for it."""
STANDARD_ERROR = 2
"""Its descriptor: standard output is for the answer."""
LOG = "PIP_LOG"
"""The environment variable that names the file to which pip adds its messages, whatever it shows."""
LARGEST_LOG = 256 * 2**20
"""Bytes of such a file; of a resolution of 110 packages it has 1 MB."""
LOG_END = 4 * 2**20
"""Bytes at its end that are read: pip's errors, and their traceback."""
CLASH = "packages conflict"
"""Beginning of the reason where the requirements of an engine exclude each other."""
_TIME = re.compile(r"^\d{4}-\d\d-\d\dT[\d:,.]+ ?")
"""The time before each line of the file."""
_CAUSES = "The conflict is caused by:"
_ERROR = "ERROR: "


def forbidden(command: Sequence[str]) -> str | None:
    """Why a command is not run for the user."""
    if command[0] != "apt-get":
        return None
    if shutil.which("apt-get") is None:
        return "this system has no apt-get; the names of the packages may differ"
    return None if os.geteuid() == 0 else "it needs root"


def run(command: Sequence[str], quiet: bool = False) -> tuple[int | None, str | None]:
    """The exit code of a command, whose words go to standard error unless ``quiet``, and what is wrong: for pip the conflict or
    the error that it states, else the last of its words where it is ``quiet``. None: it gave none."""
    with files.scratch_folder("install") as folder:
        # pip shows its progress on a terminal alone, so that its errors are read from its log and not from a pipe
        log = Path(ELSEWHERE, os.path.expanduser(os.environ.get(LOG, ""))) if os.environ.get(LOG) else folder / "log"
        begin = file_size(log)
        try:
            done = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if quiet else STANDARD_ERROR,
                stderr=subprocess.STDOUT if quiet else None,
                cwd=ELSEWHERE,
                env={**os.environ, "DEBIAN_FRONTEND": "noninteractive", LOG: str(log)},
                timeout=DEADLINE,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return None, f"did not end within {DEADLINE:g} s"
        except OSError as error:
            return None, f"cannot be started: {error.strerror}"
        if not done.returncode:
            return 0, None
        said = error_of_pip(_added(log, begin))
    if not said and quiet:
        said = clipped(visible(((done.stdout or b"").decode(errors="replace").strip().splitlines() or [""])[-1]))
    return done.returncode, f"ended with code {done.returncode}{f': {said}' if said else ''}"


def error_of_pip(lines: Sequence[str]) -> str:
    """The reason of a failure in a log of pip: the requirements that exclude each other, else the last error; "": none."""
    causes: list[str] = []
    error = ""
    for at, line in enumerate(lines):
        if line.strip() == _CAUSES:
            causes = []
            for cause in lines[at + 1 :]:
                if not cause.startswith(" "):
                    break
                causes.append(clipped(visible(cause.strip())))
        elif line.startswith(_ERROR):
            error = line
    if causes:
        return f"{CLASH}: {'; '.join(causes)}"
    return clipped(visible(error))


def _added(log: Path, begin: int) -> list[str]:
    """The last lines of a log that were added after its byte ``begin``, without their times; none where it is no file that can
    be read: the user may have named a device."""
    try:
        with os.fdopen(files.open_regular(log, LARGEST_LOG), "rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            stream.seek(max(begin, size - LOG_END))
            text = stream.read(LOG_END).decode(errors="replace")
    except (OSError, files.NotReadableError):
        return []
    return [_TIME.sub("", line) for line in text.splitlines()]
