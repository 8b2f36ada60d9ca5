"""The process that reads files of triangles: bounded in time and memory, it opens no files and has no network.

The kernel sees to that, as far as it can (:mod:`simspec.confinement`, profile ``data``), before the first byte of a file is
read: the packages of its reader are imported earlier, as the command line names them.

It gets files by its standard input and answers each by its standard output, in order (:mod:`simspec.meshes.reading` has the
other end): a line of JSON, then bytes. Further files that it needs (the buffers of a glTF) come with it.
"""

from __future__ import annotations

import importlib
import io
import json
import os
import re
import resource
import struct
import sys
from collections.abc import Iterator, Mapping
from typing import IO, Any

import numpy as np

from simspec.confinement import PROFILES, confine
from simspec.meshes.reading import MeshError, gltf_header

CPU_SECONDS = 5
"""Processor time for one file: 80,000 triangles take half a second in the slowest language (measured)."""
MEMORY = 800 * 2**20
"""Bytes of data of this process; 200,000 triangles take 200 MB in the slowest reader."""
MOST_FACES = 200_000
FORBIDDEN = ("socket.connect", "socket.bind", "subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork")

Read = tuple[np.ndarray, np.ndarray, dict[str, Any]]
"""Vertices (n, 3), faces (m, 3), and what the file says of itself: ``unit`` (m), ``up``, ``colours`` (red, green, blue,
opacity; or None) of so many faces in turn."""


class RefusedMeshError(ValueError):
    """Unread content of a file."""


def main() -> None:
    """Answer every file of the standard input. The command line names packages that the readers of these files need."""
    source, answers = os.fdopen(0, "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of a library is no answer
    import trimesh  # noqa: F401  # before opening is forbidden

    for name in sys.argv[1:]:
        importlib.import_module(name)
    _limit(resource.RLIMIT_DATA, MEMORY)
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_FSIZE, 0)
    confine(PROFILES["data"])
    sys.addaudithook(_watch)  # where the kernel has no wall
    while line := source.readline():
        requested = json.loads(line)
        if "pieces" in requested:
            vertices = np.frombuffer(source.read(24 * requested["vertices"]), "<f8").reshape(-1, 3)
            faces = np.frombuffer(source.read(24 * requested["faces"]), "<i8").reshape(-1, 3)
            _allow_cpu(int(requested["pieces"]))
            _answer_pieces(answers, vertices, faces)
            continue
        content = source.read(requested["size"])
        alongside = {name: source.read(size) for name, size in requested["beside"].items()}
        _allow_cpu(CPU_SECONDS)
        _answer(answers, requested["suffix"], content, alongside, requested["colours"])


def _limit(what: int, most: int) -> None:
    soft, hard = resource.getrlimit(what)
    del soft
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    try:
        resource.setrlimit(what, (allowed, hard))
    except (OSError, ValueError):
        return  # a system without this limit: the deadline of the other end is left


def _allow_cpu(seconds: int) -> None:
    used = resource.getrusage(resource.RUSAGE_SELF)
    _limit(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime) + 1 + seconds)


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse what reading triangles does not need: files other than Python's own modules, connections, programs."""
    if event in FORBIDDEN:
        raise PermissionError(f"{event} is not allowed here")
    if event == "open" and isinstance(arguments[0], (str, bytes)):
        path = os.path.realpath(os.fsdecode(arguments[0]))
        roots = [os.path.realpath(entry) for entry in sys.path if entry]
        if not any(path.startswith(os.path.join(root, "")) for root in roots):
            raise PermissionError("no file is opened here")


def _answer(answers: IO[bytes], suffix: str, content: bytes, buffers: Mapping[str, bytes], colours: bool) -> None:
    try:
        vertices, faces, said = _coloured(suffix, content, buffers) if colours else READERS[suffix](content, buffers)
        _check(vertices, faces)
        head: dict[str, Any] = {"vertices": len(vertices), "faces": len(faces), **said}
        body = np.ascontiguousarray(vertices, "<f8").tobytes() + np.ascontiguousarray(faces, "<i8").tobytes()
    except (RefusedMeshError, MeshError) as error:
        head, body = {"error": str(error)}, b""
    except MemoryError:
        head, body = {"error": "reading it takes more memory than is allowed"}, b""
    except RecursionError:
        head, body = {"error": "its parts are nested too deeply"}, b""
    # libraries raise anything for a damaged file; it is reported
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        head, body = {"error": f"damaged, or not such a file ({text})"}, b""
    answers.write(json.dumps(head).encode() + b"\n" + body)
    answers.flush()


def _answer_pieces(answers: IO[bytes], vertices: np.ndarray, faces: np.ndarray) -> None:
    try:
        import coacd  # type: ignore[import-not-found, unused-ignore]

        made = coacd.run_coacd(coacd.Mesh(vertices, faces), seed=0)
        points = [np.ascontiguousarray(piece[0], "<f8") for piece in made]
        head: dict[str, Any] = {"pieces": list(map(len, points))}
        body = b"".join(piece.tobytes() for piece in points)
    # as of readers
    except Exception as error:
        head, body = {"error": " ".join(f"{type(error).__name__}: {error}".split())[:200]}, b""
    answers.write(json.dumps(head).encode() + b"\n" + body)
    answers.flush()


def _check(vertices: np.ndarray, faces: np.ndarray) -> None:
    if len(faces) == 0:
        raise RefusedMeshError("it has no faces")
    if len(faces) > MOST_FACES:
        raise RefusedMeshError(f"it has {len(faces):,} faces, more than the {MOST_FACES:,} that are read")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise RefusedMeshError("a face has a vertex that does not exist")
    if not np.isfinite(vertices[np.unique(faces)]).all():
        raise RefusedMeshError("a vertex is not finite")


class Sidecars(Mapping[str, bytes]):
    """The further files of a file, in trimesh's interface."""

    def __init__(self, contents: Mapping[str, bytes] | None = None):
        self._contents = contents or {}

    def __getitem__(self, name: str) -> bytes:
        """The content of another file. Raises RefusedMeshError for one that did not come with the request."""
        if name not in self._contents:
            raise RefusedMeshError(f"it names another file, {str(name)[:80]!r}, which is not read")
        return self._contents[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._contents)

    def __len__(self) -> int:
        return len(self._contents)


# --- readers --------------------------------------------------------------------------------------------------------


def _stl(content: bytes, buffers: Mapping[str, bytes]) -> Read:
    from trimesh.exchange import stl

    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    text = content[:5].lower() == b"solid"
    if len(content) == 84 + 50 * count:
        if count > MOST_FACES:
            raise RefusedMeshError(f"it has {count:,} faces, more than the {MOST_FACES:,} that are read")
        made = stl.load_stl_binary(io.BytesIO(content)) if count else {}
    elif text:
        made = stl.load_stl_ascii(io.BytesIO(content))
    else:
        expected = f"{84 + 50 * count:,} bytes for its {count:,} faces" if count >= 0 else "at least 84 bytes"
        raise RefusedMeshError(f"{len(content):,} bytes, where a binary STL has {expected}")
    read = _of_mesh(made)
    if text and len(content) != 84 + 50 * count:
        written = content.lower().count(b"endfacet")
        _demand_all(len(read[1]), written)
    return read


def _obj(content: bytes, buffers: Mapping[str, bytes]) -> Read:
    from trimesh import load_scene

    joined = content.replace(b"\\\r\n", b" \v").replace(b"\\\n", b" \v")  # \v: a blank that keeps the count of lines
    if RELATIVE.search(joined):
        joined = content = _counted(joined)
    lines = joined.splitlines()
    corners = [len(line.split()) - 1 for line in lines if line.lstrip()[:2] in (b"f ", b"f\t")]
    written = sum(count - 2 for count in corners)
    if written > MOST_FACES:
        raise RefusedMeshError(f"it has {written:,} faces, more than the {MOST_FACES:,} that are read")
    read = _of_scene(load_scene(io.BytesIO(content), "obj", Sidecars(), skip_materials=True, process=False))
    _demand_all(len(read[1]), written)
    return read


RELATIVE = re.compile(rb"^[ \t]*f[ \t](?:[^\n]*[ \t\v/])?(?:-|0+(?![\d.]))", re.MULTILINE)
"""A face with a corner that is counted from the end of those before it, or has the number 0."""


def _counted(text: bytes) -> bytes:
    """An OBJ file whose corners are counted from the beginning: trimesh counts relative ones from the end of the file, and
    takes 0 for the last. Raises RefusedMeshError at a corner that is before the first."""
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = []
    place = 1
    for line in text.split(b"\n"):
        words = line.split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == b"f":
            line = b" ".join([b"f", *(_corner(word, tuple(counts.values()), place) for word in words[1:])])
        place += 1 + line.count(b"\v")
        lines.append(line)
    return b"\n".join(lines)


def _corner(word: bytes, counts: tuple[int, ...], line: int) -> bytes:
    """``vertex/texture/normal``, each from 1."""
    parts = word.split(b"/")
    for place, (part, count) in enumerate(zip(parts, counts, strict=False)):
        if not re.fullmatch(rb"[+-]?[0-9]+", part):
            continue  # empty, or damaged: the reader sees it
        number = int(part)
        if number == 0:
            raise RefusedMeshError(
                f"line {line}: the corner {word.decode('ascii', 'replace')[:40]}: numbers begin with 1"
            )
        if number < -count:
            raise RefusedMeshError(
                f"line {line}: the corner {word.decode('ascii', 'replace')[:40]} is before the first one"
            )
        parts[place] = b"%d" % (number if number > 0 else count + 1 + number)
    return b"/".join(parts)


def _ply(content: bytes, buffers: Mapping[str, bytes]) -> Read:
    from trimesh.exchange import ply

    read = _of_mesh(ply.load_ply(io.BytesIO(content), skip_materials=True))
    declared = re.search(rb"element\s+face\s+(\d+)", content[:65_536])
    polygons = int(declared[1]) if declared is not None else 0
    if len(read[1]) < polygons:  # each is a triangle, or several
        _demand_all(len(read[1]), polygons)
    return read


def _msh(content: bytes, buffers: Mapping[str, bytes]) -> Read:
    """The binary form: numbers of vertices, normals, places in a texture and faces, then these."""
    counts = struct.unpack("<4i", content[:16]) if len(content) >= 16 else (-1,) * 4
    points, normals, places, faces = counts
    if min(counts) < 0 or len(content) != 16 + 12 * points + 12 * normals + 8 * places + 12 * faces:
        raise RefusedMeshError(f"{len(content):,} bytes, which is not as long as its numbers say")
    if not faces:
        raise RefusedMeshError("it has no faces")
    vertices = np.frombuffer(content, "<f4", 3 * points, 16).reshape(-1, 3)
    corners = np.frombuffer(content, "<i4", 3 * faces, len(content) - 12 * faces).reshape(-1, 3)
    return vertices.astype(np.float64), corners.astype(np.int64), {}


def _gltf(content: bytes, buffers: Mapping[str, bytes], skip_materials: bool = True) -> Read:
    from trimesh import load_scene

    header = gltf_header(content)
    needed = sorted(set(map(str, header.get("extensionsRequired", []))) - HARMLESS)
    if needed:
        raise RefusedMeshError(f"it requires the extension {needed[0][:80]!r}, which simspec does not support")
    _demand_trees(header.get("nodes", []))
    kind = "glb" if content[:4] == b"glTF" else "gltf"
    scene = load_scene(io.BytesIO(content), kind, Sidecars(buffers), skip_materials=skip_materials, process=False)
    vertices, faces, said = _of_scene(scene)
    return vertices, faces, {**said, "unit": 1.0, "up": "y"}


def _demand_trees(nodes: Any) -> None:
    """Raise RefusedMeshError unless the nodes of a glTF are trees, as its specification demands: otherwise a mesh would be
    placed twice, or for ever."""
    if not isinstance(nodes, list):
        raise RefusedMeshError("damaged: its nodes are no list")
    above: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []) if isinstance(node, dict) else ():
            if not isinstance(child, int) or not 0 <= child < len(nodes):
                raise RefusedMeshError(f"nodes/{number}: its child {str(child)[:40]} does not exist")
            if child in above:
                raise RefusedMeshError(f"nodes/{number}: its child {child} is a child of node {above[child]} too")
            above[child] = number
    rooted: set[int] = set()
    for number in above:
        path, node = [number], number
        while node in above and node not in rooted:
            node = above[node]
            if node == number:
                raise RefusedMeshError(f"nodes/{number}: a node within itself")
            if len(path) > len(nodes):
                raise RefusedMeshError(f"nodes/{node}: a node within itself")
            path.append(node)
        rooted.update(path)


HARMLESS = frozenset({"KHR_materials_unlit", "KHR_texture_transform", "KHR_mesh_quantization", "KHR_texture_basisu"})
"""Extensions of glTF that change no place of a vertex, or that the reader has."""


def _dae(content: bytes, buffers: Mapping[str, bytes]) -> Read:
    import collada

    for word in (b"<!DOCTYPE", b"<!ENTITY"):
        if word in content:
            raise RefusedMeshError(f"{word.decode()} is not read")
    if b"\0" in content:
        raise RefusedMeshError("it is not UTF-8")
    ignored = [collada.common.DaeError]
    document = collada.Collada(io.BytesIO(content), ignore=ignored, aux_file_loader=_no_file)
    if document.scene is None:
        raise RefusedMeshError("it has no scene")
    wrong = [error for error in document.errors if not _of_appearance(error)]
    if wrong:
        raise RefusedMeshError(f"damaged: {' '.join(str(wrong[0]).split())[:200]}")
    if next(document.scene.objects("controller"), None) is not None:
        raise RefusedMeshError("it has a skin or a morph, which simspec does not support")
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    colours: list[tuple[list[float] | None, int]] = []
    count = 0
    for bound in document.scene.objects("geometry"):
        for primitive in bound.primitives():
            triangles = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
            if not hasattr(triangles, "vertex_index") or triangles.vertex_index is None or len(triangles) == 0:
                continue
            if triangles.vertex_index.ndim != 2 or triangles.vertex_index.shape[1] != 3:
                continue  # lines
            vertices.append(np.asarray(triangles.vertex, np.float64))
            faces.append(np.asarray(triangles.vertex_index, np.int64) + count)
            count += len(triangles.vertex)
            diffuse = getattr(getattr(primitive.material, "effect", None), "diffuse", None)
            colours.append((_rgba(diffuse) if isinstance(diffuse, tuple) else None, len(faces[-1])))
    if not faces:
        raise RefusedMeshError("it has no faces")
    asset = document.assetInfo
    up = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}[asset.upaxis] if asset.upaxis is not None else "y"
    unit = 1.0 if asset.unitmeter is None else float(asset.unitmeter)
    return np.concatenate(vertices), np.concatenate(faces), {"unit": unit, "up": up, "colours": colours}


def _of_appearance(error: Exception) -> bool:
    """Whether what a reader could not read is a material or a picture, which changes no place of a vertex."""
    text = str(error).lower()
    return any(word in text for word in ("material", "image", "effect", "texture", "sampler", "surface", "shader"))


def _no_file(name: str) -> bytes:
    raise RefusedMeshError("it names another file")


def _of_mesh(made: Mapping[str, Any]) -> Read:
    """The result of trimesh's readers of one mesh."""
    if "vertices" not in made or "faces" not in made:
        raise RefusedMeshError("it has no faces")
    return np.asarray(made["vertices"], np.float64), np.asarray(made["faces"], np.int64).reshape(-1, 3), {}


def _of_scene(scene: Any) -> Read:
    """The meshes of a scene, where it places them."""
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    colours: list[tuple[list[float] | None, int]] = []
    count = total = 0
    for node in scene.graph.nodes_geometry:
        place, name = scene.graph[node]
        mesh, place = scene.geometry[name], np.asarray(place, np.float64)
        if not hasattr(mesh, "faces") or len(mesh.faces) == 0:
            continue  # lines, points
        total += len(mesh.faces)
        if total > MOST_FACES:
            raise RefusedMeshError(f"it has more than the {MOST_FACES:,} faces that are read")
        values = np.asarray(mesh.vertices, np.float64)
        vertices.append(values @ place[:3, :3].T + place[:3, 3])
        mirrored = np.linalg.det(place[:3, :3]) < 0.0
        faces.append(np.asarray(mesh.faces, np.int64)[:, :: -1 if mirrored else 1] + count)
        count += len(values)
        colours.append((_colour_of(mesh), len(faces[-1])))
    if not faces:
        raise RefusedMeshError("it has no faces")
    return np.concatenate(vertices), np.concatenate(faces), {"colours": colours}


# --- colours: for pictures alone ------------------------------------------------------------------------------------


def _coloured(suffix: str, content: bytes, buffers: Mapping[str, bytes]) -> Read:
    """A file with the colours of its materials; without them where they cannot be read."""
    if suffix not in WITH_MATERIALS:
        return READERS[suffix](content, {} if suffix == ".obj" else buffers)
    try:
        return WITH_MATERIALS[suffix](content, buffers)
    # a material may be damaged in any way, and costs no more than its colour
    except Exception:
        return READERS[suffix](content, {} if suffix == ".obj" else buffers)


def _obj_materials(content: bytes, buffers: Mapping[str, bytes]) -> Read:
    from trimesh import load_scene

    plain = _obj(content, {})
    read = _of_scene(load_scene(io.BytesIO(content), "obj", Sidecars(buffers), process=False, group_material=True))
    _demand_all(len(read[1]), len(plain[1]))
    return read


def _gltf_materials(content: bytes, buffers: Mapping[str, bytes]) -> Read:
    return _gltf(content, buffers, skip_materials=False)


def _colour_of(mesh: Any) -> list[float] | None:
    """The colour of the material of one of trimesh's meshes; None where it has none, or a picture."""
    material = getattr(mesh.visual, "material", None)
    picture = any(getattr(material, name, None) is not None for name in ("image", "baseColorTexture"))
    if material is None or picture:
        return None
    for name in ("baseColorFactor", "diffuse"):
        value = getattr(material, name, None)
        if value is not None:
            values = np.asarray(value)
            return _rgba(values / 255.0 if values.dtype == np.uint8 else values)
    return None


def _rgba(values: Any) -> list[float] | None:
    numbers = [min(1.0, max(0.0, float(value))) for value in values]
    return [*numbers, 1.0][:4] if len(numbers) in (3, 4) and np.isfinite(numbers).all() else None


def _demand_all(read: int, written: int) -> None:
    if read != written:
        raise RefusedMeshError(f"{written:,} triangles are written in it, and {read:,} can be read")


WITH_MATERIALS = {".obj": _obj_materials, ".gltf": _gltf_materials, ".glb": _gltf_materials}
READERS = {".stl": _stl, ".obj": _obj, ".ply": _ply, ".msh": _msh, ".gltf": _gltf, ".glb": _gltf, ".dae": _dae}

if __name__ == "__main__":
    main()
