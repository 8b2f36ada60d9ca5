"""Triangles of files, asked of a process of its own (:mod:`simspec.meshes.child`), which a damaged or hostile file may end."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.confinement import ANY_LOCALE
from simspec.exchange import exchange
from simspec.isolated import ELSEWHERE, with_search_path
from simspec.meshes.files import MeshError, MeshFile
from simspec.reading import NotReadableError, parse_json
from simspec.world.hull import Points, Triangles

START_SECONDS, FILE_SECONDS = 60.0, 60.0
"""Deadline of the process, for its start and for each file, where the process does not end itself: it does so after 5 s of
processor time for one file, and machines are busy."""
BATCH = 32
"""Files for one process."""
BATCH_BYTES = 128 * 2**20
LARGEST_ANSWER = 2**30
"""Bytes from one process: 32 files of 200,000 faces have 0.3 GB."""
BUSY = 5.0
"""Times the processor time of a decomposition that its process may take."""
NEEDED = ("trimesh", "collada")
INSTALL = "pip install 'simspec[meshes]'"


@dataclass(frozen=True)
class Surface:
    """Triangles of a file, in its own unit and axes; ``unit`` (m) and ``up`` where the file says them."""

    vertices: Points
    triangles: Triangles
    unit: float | None = None
    up: str | None = None


def read_surfaces(files: Sequence[MeshFile]) -> list[Surface | MeshError]:
    """What each file holds, or why it is not read, in order."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        return [MeshError(f"reading meshes needs packages that are not installed: {INSTALL}") for _ in files]
    answers: list[Surface | MeshError] = []
    while len(answers) < len(files):
        answers += _read(_next_batch(files[len(answers) :]))
    return answers


def _next_batch(files: Sequence[MeshFile]) -> Sequence[MeshFile]:
    total = 0
    for count, file in enumerate(files[:BATCH]):
        total += len(file.content) + sum(map(len, file.beside.values()))
        if count and total > BATCH_BYTES:
            return files[:count]
    return files[:BATCH]


def _read(files: Sequence[MeshFile]) -> list[Surface | MeshError]:
    """The answers that one process gives; at least one, the last of which may be that it ended."""
    needed = ("collada",) if any(file.suffix == ".dae" for file in files) else ()
    output, why = _process(
        b"".join(_request(file) for file in files), needed, START_SECONDS + FILE_SECONDS * len(files)
    )
    answers = _answers(output, len(files))
    if len(answers) < len(files):
        answers.append(MeshError(f"reading it {why}"))
    return answers


def _process(asked: bytes, needed: Sequence[str], seconds: float) -> tuple[bytes, str]:
    """What a process answers within a deadline, and how it ended, as a message says it of what it was busy with. ``needed``:
    packages that it imports before it reads anything."""
    environment = {name: value for name, value in os.environ.items() if name in ("PATH", "HOME", "SYSTEMROOT")}
    environment |= ANY_LOCALE
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    process = subprocess.Popen(
        # not -I, by which PYTHONHASHSEED would have no effect; the environment has no other PYTHON variable of the user
        with_search_path("-m", "simspec.meshes.child", *needed),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=ELSEWHERE,
        env={**environment, **one_thread, "PYTHONNOUSERSITE": "1", "PYTHONHASHSEED": "0"},
        start_new_session=True,
    )
    output, why = exchange(process, asked, seconds, LARGEST_ANSWER)
    if why == "large":
        return b"", "gives more than there can be in it"
    late = why == "late" or process.returncode == -signal.SIGXCPU
    return output, "takes too long" if late else "ends the process that does it"


def split(vertices: Points, triangles: Triangles, seconds: float) -> list[Points]:
    """The corners (n, 3) of convex pieces that are nearly the solid within triangles, by CoACD. Raises MeshError."""
    head = {"pieces": seconds, "vertices": len(vertices), "faces": len(triangles)}
    asked = json.dumps(head).encode() + b"\n" + _bytes(vertices, "<f8") + _bytes(triangles, "<i8")
    output, why = _process(asked, ("coacd",) if find_spec("coacd") else (), START_SECONDS + BUSY * seconds)
    stream = io.BytesIO(output)
    line = stream.readline()
    if not line.endswith(b"\n"):
        raise MeshError(f"finding convex pieces {why}; a file of fewer faces may help, or `as: hull`")
    answer = json.loads(line)
    if "error" in answer:
        raise MeshError(f"no convex pieces can be found: {answer['error']}")
    return [np.frombuffer(stream.read(24 * count), "<f8").reshape(-1, 3) for count in answer["pieces"]]


def _bytes(values: NDArray[Any], kind: str) -> bytes:
    return np.ascontiguousarray(values, kind).tobytes()


def _request(file: MeshFile) -> bytes:
    head = {
        "suffix": file.suffix,
        "size": len(file.content),
        "beside": {name: len(content) for name, content in file.beside.items()},
    }
    return json.dumps(head).encode() + b"\n" + file.content + b"".join(file.beside.values())


def _answers(output: bytes, most: int) -> list[Surface | MeshError]:
    """The whole answers in an output."""
    stream = io.BytesIO(output)
    answers: list[Surface | MeshError] = []
    while len(answers) < most:
        line = stream.readline()
        if not line.endswith(b"\n"):
            break
        try:
            head = parse_json(line)
            if "error" in head:
                answers.append(MeshError(str(head["error"])))
                continue
            counts = int(head["vertices"]), int(head["faces"])
        except (NotReadableError, KeyError, TypeError, ValueError):
            break  # a file may have taken over the reader: it may answer anything
        if min(counts) < 0:
            break
        places, corners = (stream.read(24 * count) for count in counts)
        if len(corners) < 24 * counts[1]:
            break
        vertices = np.frombuffer(places, "<f8").reshape(-1, 3)
        answers.append(
            Surface(vertices, np.frombuffer(corners, "<i8").reshape(-1, 3), head.get("unit"), head.get("up"))
        )
    return answers
