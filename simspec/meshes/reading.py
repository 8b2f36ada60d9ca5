"""Triangles of files, read in a separate process (:mod:`simspec.meshes.child`), which a damaged or hostile file may end."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import signal
import subprocess
import urllib.parse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec import numerals
from simspec.confinement import ANY_LOCALE
from simspec.errors import UNSEEN_CHARACTERS
from simspec.files import NotReadableError, parse_json, read_bytes
from simspec.processes import ELSEWHERE, exchange, with_search_path
from simspec.world.appearance import Rgba
from simspec.world.hull import Points, Triangles

# Files of triangles before they are parsed: their bytes, and those of the files that they cannot do without.

LARGEST_FILE = 64 * 2**20
"""Bytes of one file: 200,000 triangles as text have 50 million in the most spacious of the languages."""
LARGEST_MATERIALS = 2**20
"""Bytes of a file of materials."""
_LIBRARIES = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]{1,400})", re.MULTILINE)
MOST_BUFFERS = 16
"""Further files that a glTF file may need."""
GLB = b"glTF"


class MeshError(ValueError):
    """A file of triangles that is not read, or of which no solid can be made. The message does not name the file."""


@dataclass(frozen=True)
class MeshFile:
    """A file with its content; ``buffers``: the buffers of a glTF, the materials of an OBJ file, by the text that names them;
    ``colours``: whether the colours of its materials are wanted."""

    path: Path
    content: bytes
    buffers: Mapping[str, bytes] = field(default_factory=dict)
    colours: bool = False

    @property
    def suffix(self) -> str:
        """The end of its name, in small letters."""
        return self.path.suffix.lower()

    def digest(self) -> str:
        """SHA-256 of all of it."""
        digest = hashlib.sha256(f"{self.suffix} {len(self.content)}\0".encode() + self.content)
        for name, content in sorted(self.buffers.items()):
            digest.update(f"{len(name)} {name} {len(content)}\0".encode() + content)
        return digest.hexdigest()


_NUMBERS: Mapping[str, re.Pattern[bytes]] = {
    ".obj": re.compile(rb"^[ \t]*(?:v[tnp]?|f)[ \t]([^\n#]*)", re.MULTILINE),
    ".stl": re.compile(rb"^[ \t]*(?:vertex|facet[ \t]+normal)[ \t]([^\n]*)", re.MULTILINE | re.IGNORECASE),
    ".ply": re.compile(rb"\Aply\s[^\0]*?^format[ \t]+ascii[^\0]*?^end_header[ \t\r]*\n(.*)", re.MULTILINE | re.DOTALL),
    ".dae": re.compile(
        rb"<(?:float_array|int_array|p|v|h|vcount|matrix|translate|rotate|scale|skew|lookat)\b[^>]*>([^<]*)<"
    ),
}
"""Where the numbers of a text are, by the end of its name."""
_UNUSUAL = re.compile(rb"[^\t-\r -~]|[_&]")


def _demand_numerals(suffix: str, content: bytes) -> None:
    """Raise MeshError where numbers of a text have digits other than 0 to 9, underscores or other spaces, which some readers
    take and others do not (:mod:`simspec.numerals`)."""
    if suffix not in _NUMBERS or (content.isascii() and b"_" not in content and b"&" not in content):
        return
    if suffix == ".stl" and not (content[:5].lower() == b"solid" and b"endfacet" in content.lower()):
        return  # binary
    for found in _NUMBERS[suffix].finditer(content):
        if wrong := _UNUSUAL.search(found[1]):
            line = 1 + content.count(b"\n", 0, found.start(1) + wrong.start())
            text = found[1][max(0, wrong.start() - 20) :].strip()[:40].decode("utf-8", "replace")
            why = numerals.refusal(text).python_alone or "a character that is part of no number"
            raise MeshError(f"line {line}: {text!r} should be numbers: {why}")


def open_mesh(path: Path, colours: bool = False) -> MeshFile:
    """A file with the buffers that it needs, which must lie in its folder or below; with ``colours`` also the materials of an
    OBJ file that lie there. Raises MeshError."""
    content = _bytes(path, LARGEST_FILE)
    _demand_numerals(path.suffix.lower(), content)
    if path.suffix.lower() == ".obj" and colours:
        return MeshFile(path, content, _materials(path, content), colours)
    if path.suffix.lower() not in (".gltf", ".glb"):
        return MeshFile(path, content, {}, colours)
    alongside: dict[str, bytes] = {}
    left = LARGEST_FILE - len(content)
    for name in _needed(content):
        target = _buffer_path(path, name)
        if not target.is_relative_to(path.parent):
            raise MeshError(f"it needs {name[:80]!r}, which leaves its folder")
        alongside[name] = _bytes(target, left)
        left -= len(alongside[name])
    return MeshFile(path, content, alongside, colours)


def _materials(path: Path, content: bytes) -> dict[str, bytes]:
    """The files of materials that an OBJ file names, if they are in its folder or below."""
    found: dict[str, bytes] = {}
    for line in _LIBRARIES.findall(content)[:MOST_BUFFERS]:
        name = line.decode("utf-8", "replace").strip()
        try:
            target = _buffer_path(path, name)
            if name and target.is_relative_to(path.parent) and target.suffix.lower() == ".mtl":
                found[name] = _bytes(target, LARGEST_MATERIALS)
        except MeshError:
            continue  # the mesh is drawn without its colours
    return found


def _bytes(path: Path, most: int) -> bytes:
    try:
        return read_bytes(path, max(most, 0), links=True)
    except NotReadableError as error:
        raise MeshError(f"{path.name} cannot be read: {error}") from None
    except OSError as error:
        raise MeshError(f"{path.name} cannot be read: {error.strerror}") from None


def _buffer_path(path: Path, name: str) -> Path:
    try:
        return (path.parent / urllib.parse.unquote(name)).resolve()
    except (OSError, RuntimeError, ValueError):  # links that lead to themselves, a NUL
        raise MeshError(f"it needs {name[:80]!r}, which does not exist") from None


def _needed(content: bytes) -> list[str]:
    buffers = gltf_header(content).get("buffers", [])
    if not isinstance(buffers, list) or not all(isinstance(buffer, dict) for buffer in buffers):
        raise MeshError("damaged: its buffers are no list of objects")
    named = [buffer["uri"] for buffer in buffers if "uri" in buffer]
    if not all(isinstance(name, str) for name in named):
        raise MeshError("damaged: the place of a buffer is no text")
    outside = list(dict.fromkeys(name for name in named if not name.startswith("data:")))
    if len(outside) > MOST_BUFFERS:
        raise MeshError(f"it needs {len(outside)} further files, more than {MOST_BUFFERS}")
    for name in outside:
        if "://" in name or UNSEEN_CHARACTERS.search(name) or len(name) > 1000:
            raise MeshError(f"it needs {name[:80]!r}, which is no path of a file")
    return outside


def gltf_header(content: bytes) -> dict[str, Any]:
    """The JSON of a glTF or GLB file. Raises MeshError for what is damaged."""
    text = content
    if content[:4] == GLB:
        if len(content) < 20 or int.from_bytes(content[8:12], "little") != len(content):
            raise MeshError("damaged: its length is not what it says")
        size = int.from_bytes(content[12:16], "little")
        if content[16:20] != b"JSON" or 20 + size > len(content):
            raise MeshError("damaged: it does not begin with JSON")
        text = content[20 : 20 + size]
    try:
        header = parse_json(text)
    except NotReadableError as error:
        raise MeshError(f"damaged: {error}") from None
    if not isinstance(header, dict):
        raise MeshError("damaged: its JSON is no object")
    return header


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
NEEDS = "reading meshes needs packages that are not installed"
INSTALL = "pip install 'simspec-physics[meshes]'"


def not_installed() -> list[str]:
    """The packages that reading meshes needs and that are not installed."""
    return [name for name in NEEDED if find_spec(name) is None]


@dataclass(frozen=True)
class MeshSurface:
    """Triangles of a file, in its own unit and axes; ``unit`` (m) and ``up`` where the file says them; ``colours`` of so many
    triangles in turn, None where the file has none, where they were wanted."""

    vertices: Points
    triangles: Triangles
    unit: float | None = None
    up: str | None = None
    colours: tuple[tuple[Rgba | None, int], ...] = ()


def read_surfaces(files: Sequence[MeshFile]) -> list[MeshSurface | MeshError]:
    """The content of each file, or why it is not read, in order."""
    if files and not_installed():
        return [MeshError(f"{NEEDS}: {INSTALL}") for _ in files]
    answers: list[MeshSurface | MeshError] = []
    while len(answers) < len(files):
        answers += _read(_next_batch(files[len(answers) :]))
    return answers


def _next_batch(files: Sequence[MeshFile]) -> Sequence[MeshFile]:
    total = 0
    for count, file in enumerate(files[:BATCH]):
        total += len(file.content) + sum(map(len, file.buffers.values()))
        if count and total > BATCH_BYTES:
            return files[:count]
    return files[:BATCH]


def _read(files: Sequence[MeshFile]) -> list[MeshSurface | MeshError]:
    """The answers that one process gives; at least one, the last of which may be that it ended."""
    needed = ("collada",) if any(file.suffix == ".dae" for file in files) else ()
    output, why = _process(
        b"".join(_request(file) for file in files), needed, START_SECONDS + FILE_SECONDS * len(files)
    )
    answers = _answers(output, len(files))
    if len(answers) < len(files):
        answers.append(MeshError(f"reading it {why}"))
    return answers


def _process(request: bytes, needed: Sequence[str], seconds: float) -> tuple[bytes, str]:
    """The answer of a process within a deadline, and how it ended, as part of a message. ``needed``:
    packages that it imports before it reads anything."""
    environment = {name: value for name, value in os.environ.items() if name in ("PATH", "HOME", "SYSTEMROOT")}
    environment |= ANY_LOCALE
    single_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    process = subprocess.Popen(
        # not -I, by which PYTHONHASHSEED would have no effect; the environment has no other PYTHON variable of the user
        with_search_path("-m", "simspec.meshes.child", *needed),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=ELSEWHERE,
        env={**environment, **single_thread, "PYTHONNOUSERSITE": "1", "PYTHONHASHSEED": "0"},
        start_new_session=True,
    )
    output, why = exchange(process, request, seconds, LARGEST_ANSWER)
    if why == "large":
        return b"", "gives more than there can be in it"
    late = why == "late" or process.returncode == -signal.SIGXCPU
    return output, "takes too long" if late else "ends the process that does it"


def split(vertices: Points, triangles: Triangles, seconds: float) -> list[Points]:
    """The corners (n, 3) of convex pieces that are nearly the solid within triangles, by CoACD. Raises MeshError."""
    head = {"pieces": seconds, "vertices": len(vertices), "faces": len(triangles)}
    requested = json.dumps(head).encode() + b"\n" + _request_bytes(vertices, "<f8") + _request_bytes(triangles, "<i8")
    output, why = _process(requested, ("coacd",) if find_spec("coacd") else (), START_SECONDS + BUSY * seconds)
    stream = io.BytesIO(output)
    line = stream.readline()
    if not line.endswith(b"\n"):
        raise MeshError(f"finding convex pieces {why}; a file of fewer faces may help, or `as: hull`")
    answer = json.loads(line)
    if "error" in answer:
        raise MeshError(f"no convex pieces can be found: {answer['error']}")
    return [np.frombuffer(stream.read(24 * count), "<f8").reshape(-1, 3) for count in answer["pieces"]]


def _request_bytes(values: NDArray[Any], kind: str) -> bytes:
    return np.ascontiguousarray(values, kind).tobytes()


def _request(file: MeshFile) -> bytes:
    head = {
        "suffix": file.suffix,
        "size": len(file.content),
        "colours": file.colours,
        "beside": {name: len(content) for name, content in file.buffers.items()},
    }
    return json.dumps(head).encode() + b"\n" + file.content + b"".join(file.buffers.values())


def _answers(output: bytes, most: int) -> list[MeshSurface | MeshError]:
    """The whole answers in an output."""
    stream = io.BytesIO(output)
    answers: list[MeshSurface | MeshError] = []
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
        triangles = np.frombuffer(corners, "<i8").reshape(-1, 3)
        colours = _colours(head.get("colours"), len(triangles))
        answers.append(MeshSurface(vertices, triangles, head.get("unit"), head.get("up"), colours))
    return answers


def _colours(given: Any, count: int) -> tuple[tuple[Rgba | None, int], ...]:
    """The colours in an answer, if they are those of all triangles."""
    try:
        colours = tuple((None if rgba is None else _rgba(*map(float, rgba)), int(faces)) for rgba, faces in given)
    except (TypeError, ValueError):
        return ()
    whole = sum(faces for _, faces in colours) == count and all(faces > 0 for _, faces in colours)
    return colours if whole else ()


def _rgba(red: float, green: float, blue: float, opacity: float) -> Rgba:
    if not all(0.0 <= value <= 1.0 for value in (red, green, blue, opacity)):
        raise ValueError("a colour is four numbers between 0 and 1")
    return red, green, blue, opacity
