"""Files to start from: exports of the library's scenarios, specimens of the tests, and small files written for this purpose.

A seed is a main file and its companions, as bytes. Everything is made in the same order on every machine.
"""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
FILES = Path(__file__).resolve().parent / "files"
SMALL = (
    "ball-pendulum",
    "box-on-ramp",
    "coupled-gripper",
    "double-pendulum",
    "four-bar-push",
    "gripper",
    "ur10e-reach",
    "spring-damper",
)
"""Scenarios whose exports are small and differ in what they say."""
LARGEST = 60_000
"""Largest size of a seed in bytes: a case spends its time on defects, not on size."""
SUFFIX = {
    "urdf": ".urdf",
    "xacro": ".urdf.xacro",
    "mjcf": ".xml",
    "sdf": ".sdf",
    "usd": ".usda",
    "usdc": ".usdc",
    "usdz": ".usdz",
    "simspec": ".yaml",
    "obj": ".obj",
    "stl": ".stl",
    "dae": ".dae",
    "glb": ".glb",
    "gltf": ".gltf",
    "ply": ".ply",
    "msh": ".msh",
}
"""The end of the name of the changed file, by what is fuzzed."""
MESHES = ("obj", "stl", "dae", "glb", "gltf", "ply", "msh")
LANGUAGES = ("xacro", "urdf", "mjcf", "sdf", "usd", "meshes", "simspec")


@dataclass(frozen=True)
class Seed:
    """A file, and the files next to it."""

    content: bytes
    companions: dict[str, bytes] = field(default_factory=dict)


def box_of(kind: str) -> bytes:
    """A box as a file of triangles."""
    import trimesh

    return _exported(trimesh.creation.box((0.2, 0.1, 0.3)), kind)


def _exported(mesh: Any, kind: str) -> bytes:
    if kind == "msh":  # numbers of vertices, normals, places in a texture and faces, then these
        points, corners = np.asarray(mesh.vertices, "<f4"), np.asarray(mesh.faces, "<i4")
        return struct.pack("<4i", len(points), 0, 0, len(corners)) + points.tobytes() + corners.tobytes()
    words = {"embed_buffers": True} if kind == "gltf" else {}
    made = mesh.export(file_type=kind, **words)
    if isinstance(made, dict):
        return bytes(made["model.gltf"])
    return made if isinstance(made, bytes) else made.encode()


@functools.cache
def companions() -> dict[str, bytes]:
    """Files next to every changed file, so that names of files refer to something."""
    written = {path.name: path.read_bytes() for path in sorted(FILES.glob("part.*"))}
    return {**written, **{f"part.{kind}": box_of(kind) for kind in ("stl", "obj", "dae")}}


def _seed_of(name: str) -> Seed:
    return Seed((FILES / name).read_bytes())


@functools.cache
def _exports(language: str) -> tuple[Seed, ...]:
    from simspec.formats.kit.contract import formats

    seeds = []
    for name in SMALL:
        files = {where: text.encode() for where, text in formats()[language].plain(_world(name)).files.items()}
        for where, content in files.items():
            if where.endswith(SUFFIX[language]) and len(content) < LARGEST:
                rest = {other: text for other, text in files.items() if other != where and not other.endswith(".json")}
                seeds.append(Seed(content, rest))
    return tuple(seeds)


@functools.cache
def _world(name: str) -> Any:
    from simspec.language.load import load

    return load(ROOT / "specs" / f"{name}.yaml").resolve()


@functools.cache
def seeds(language: str) -> tuple[Seed, ...]:
    """The files that cases of a language begin with, by what is fuzzed (a key of :data:`SUFFIX`)."""
    from tests.imports.mjcf.models import ARM, SCENE
    from tests.imports.urdf.robots import SPECIMEN, two_links

    if language == "urdf":
        return (Seed(SPECIMEN.encode()), Seed(two_links().encode()), _seed_of("part.urdf"), *_exports("urdf"))
    if language == "xacro":
        exported = _exports("urdf")[:3]
        head = b'xmlns:xacro="http://www.ros.org/wiki/xacro" name='
        return (
            *(_seed_of("robot.xacro"),) * 4,
            *(_seed_of("chain.xacro"),) * 2,
            *(
                Seed(entry.content.replace(b"<robot name=", b"<robot " + head, 1), entry.companions)
                for entry in exported
            ),
        )
    if language == "mjcf":
        more = (_seed_of("more.xml"),) * 4
        return (Seed(ARM.encode()), Seed(SCENE.encode()), *more, *_exports("mjcf"))
    if language == "sdf":
        return (*(_seed_of("more.sdf"),) * 4, _seed_of("part.sdf"), *_exports("sdf"))
    if language == "usd":
        return (*(_seed_of("more.usda"),) * 4, *_exports("usd"))
    if language in ("usdc", "usdz"):
        return tuple(Seed(_packed(export.content, language)) for export in _exports("usd")[:4])
    if language == "simspec":
        specs = ROOT / "specs"
        small = [path.read_bytes() for path in sorted(specs.glob("*.yaml")) if path.stat().st_size < 6000]
        named = [
            path for folder in ("models", "meshes") for path in sorted((specs / folder).iterdir()) if path.is_file()
        ]
        used = {str(path.relative_to(specs)): path.read_bytes() for path in named}
        return (*(Seed(content, used) for content in small), *(_seed_of("more.yaml"),) * 4)
    return (Seed(box_of(language)), Seed(_tetrahedron(language)))


def _tetrahedron(kind: str) -> bytes:
    import trimesh

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    mesh = trimesh.Trimesh(points, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return _exported(mesh, "stl_ascii" if kind == "stl" else kind)


def _packed(text: bytes, kind: str) -> bytes:
    """A text of USD in the binary form, or as a package."""
    import tempfile

    from pxr import Sdf, UsdUtils

    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text.decode())
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder, "a.usdc")
        layer.Export(str(binary))
        if kind == "usdz":
            package = Path(folder, "a.usdz")
            UsdUtils.CreateNewUsdzPackage(str(binary), str(package))
            return package.read_bytes()
        return binary.read_bytes()
