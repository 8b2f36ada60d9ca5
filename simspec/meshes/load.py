"""Meshes of a spec: from the memory of this process, from the cache, or read and made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from simspec.meshes import cache
from simspec.meshes.files import MeshError, MeshFile, open_mesh
from simspec.meshes.made import MadeMesh, ManyVerticesError, MeshOptions, bounded, made
from simspec.meshes.reading import read_surfaces

Wanted = tuple[Path, MeshOptions]
"""A file, and how it is taken."""
REMEMBERED = 1000
"""Meshes that a process remembers: a sweep resolves the same robot once for each case."""

_remembered: dict[str, MadeMesh] = {}


def load(wanted: Iterable[Wanted], most_vertices: int) -> Mapping[Wanted, MadeMesh | MeshError]:
    """What is made of each file, or why nothing is. ``most_vertices``: of a hull whose options allow any."""
    results: dict[Wanted, MadeMesh | MeshError] = {}
    names: dict[Wanted, str] = {}
    files: dict[Path, MeshFile] = {}
    for item in dict.fromkeys(wanted):
        path, options = item
        try:
            if path not in files:
                files[path] = open_mesh(path)
        except MeshError as error:
            results[item] = error
            continue
        names[item] = name = cache.key(files[path], options)
        known = _remembered.get(name) or cache.read(name)
        if known is not None:
            results[item] = _bounded(_remember(name, known), options, most_vertices)
    missing = [item for item in names if item not in results]
    unread = list(dict.fromkeys(path for path, _ in missing))
    surfaces = dict(zip(unread, read_surfaces([files[path] for path in unread]), strict=True))
    for item in missing:
        path, options = item
        surface = surfaces[path]
        if isinstance(surface, MeshError):
            results[item] = surface
            continue
        try:
            mesh = made(surface, options, most_vertices)
        except MeshError as error:
            results[item] = error
            continue
        results[item] = _bounded(_remember(names[item], mesh), options, most_vertices)
        cache.write(names[item], mesh)
    return results


def _bounded(mesh: MadeMesh, options: MeshOptions, most_vertices: int) -> MadeMesh | MeshError:
    """A mesh, wherever it comes from, or that it has more vertices than are allowed."""
    try:
        return bounded(mesh, options, most_vertices)
    except ManyVerticesError as error:
        return error


def _remember(name: str, mesh: MadeMesh) -> MadeMesh:
    while len(_remembered) >= REMEMBERED:
        del _remembered[next(iter(_remembered))]
    _remembered[name] = mesh
    return mesh
