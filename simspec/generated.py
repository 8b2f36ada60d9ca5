"""The committed output, ``generated/<name>/``: made, kept current, and checked for being current.

A folder holds world.json, one folder of artifacts per engine, and certificate.json. The certificate belongs to exactly the
hashes that it names: one that names others is dropped when the folder is written, and reported by :func:`check`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from simspec.compiler import Compiled, compile_world, output_files, write_folder
from simspec.errors import Location
from simspec.formats.base import read_sidecar
from simspec.world.canonical import sha256
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate

GENERATED = Path("generated")
CERTIFICATE_FILE = "certificate.json"


@dataclass(frozen=True)
class Built:
    """One compiled spec: the world, what each engine gets, and all files of its folder."""

    world: World
    compiled: Mapping[str, Compiled]
    files: Mapping[str, str]


def build(world: World, engines: list[str], locate: Callable[[str], Location | None]) -> Built:
    """Compile ``world`` for ``engines``. Raises UnsupportedError with every problem."""
    compiled = compile_world(world, engines, locate)
    return Built(world, compiled, output_files(world, compiled))


@dataclass(frozen=True)
class Written:
    """What writing a folder did: whether any file changed, and why an old certificate was dropped (None: it was not)."""

    folder: Path
    changed: bool
    dropped: str | None


def write(built: Built, folder: Path) -> Written:
    """Write a compiled spec as the content of ``folder``.

    Engines that were not compiled this time keep their artifacts as long as they are of the same world; a certificate is kept
    as long as it is of these very files.
    """
    files = dict(built.files)
    dropped = None
    if folder.is_dir():
        for engine in other_engines(built, folder):
            found = folder / engine
            files.update(
                {f"{engine}/{path.relative_to(found).as_posix()}": path.read_bytes().decode() for path in _files(found)}
            )
        certificate = folder / CERTIFICATE_FILE
        if certificate.is_file():
            dropped = certificate_mismatch(built, folder)
            if dropped is None:
                files[CERTIFICATE_FILE] = certificate.read_text(encoding="utf-8")
    changed = bool(compare(files, folder)) or set(_names(folder)) != set(files)
    if changed:
        write_folder(files, folder)
    return Written(folder, changed, dropped)


def other_engines(built: Built, folder: Path) -> list[str]:
    """The engines that have artifacts of the same world in ``folder``, but were not compiled this time."""
    found = []
    for place in sorted(path for path in folder.iterdir() if path.is_dir() and path.name not in built.compiled):
        try:
            if read_sidecar(place).get("world") == sha256(built.world):
                found.append(place.name)
        except (OSError, ValueError):
            continue  # no artifacts, or unreadable ones: not worth keeping
    return found


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _names(folder: Path) -> list[str]:
    return [path.relative_to(folder).as_posix() for path in _files(folder)] if folder.is_dir() else []


def compare(files: Mapping[str, str], folder: Path) -> list[str]:
    """How ``folder`` differs from ``files``: "missing: PATH" and "stale: PATH", sorted."""
    found = []
    for name, text in sorted(files.items()):
        path = folder / name
        if not path.is_file():
            found.append(f"missing: {path.as_posix()}")
        elif path.read_bytes() != text.encode():
            found.append(f"stale: {path.as_posix()}")
    return found


def check(built: Built, folder: Path) -> list[str]:
    """How ``folder`` differs from what compiling would write, its certificate included."""
    found = compare(built.files, folder)
    kept = set(built.files) | {CERTIFICATE_FILE}
    others = other_engines(built, folder) if folder.is_dir() else []
    found += [
        f"not of this spec: {(folder / name).as_posix()}"
        for name in _names(folder)
        if name not in kept and name.split("/")[0] not in others
    ]
    path = (folder / CERTIFICATE_FILE).as_posix()
    if not (folder / CERTIFICATE_FILE).is_file():
        found.append(f"missing: {path} (simspec verify writes it)")
    elif why := certificate_mismatch(built, folder):
        found.append(f"stale: {path}: {why} (simspec verify writes it anew)")
    return found


def read_certificate(folder: Path) -> Certificate | None:
    """The certificate in ``folder``; None when there is none or it cannot be read (an old version's, a damaged one)."""
    from simspec.proof.certificate import Certificate

    try:
        return Certificate.from_json((folder / CERTIFICATE_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def certificate_mismatch(built: Built, folder: Path) -> str | None:
    """Why the certificate in ``folder`` does not hold for a compiled spec; None when it does."""
    certificate = read_certificate(folder)
    if certificate is None:
        return "it cannot be read"
    if certificate.world_sha256 != sha256(built.world):
        return "it is of another world"
    hashes = dict(certificate.artifacts_sha256)
    for engine, compiled in built.compiled.items():
        if engine not in hashes:
            return f"it does not cover {engine}"
        if hashes[engine] != compiled.sha256:
            return f"it is of other files of {engine}"
    if not certificate.valid:
        return "it is not valid"
    return None


def write_certificate(certificate: Certificate, folder: Path) -> bool:
    """Write the certificate into ``folder``; whether anything was written.

    An old one with the same hashes, versions and verdict stays as it is: its timings and last digits may differ, and a
    repository should be quiet when nothing that matters has changed.
    """
    old = read_certificate(folder)
    if old is not None and _identity(old) == _identity(certificate):
        return False
    write_text(certificate.to_json(), folder / CERTIFICATE_FILE)
    return True


def _identity(certificate: Certificate) -> tuple[object, ...]:
    return (
        certificate.world_sha256,
        sorted(dict(certificate.artifacts_sha256).items()),
        sorted(dict(certificate.versions).items()),
        certificate.valid,
    )


def write_text(text: str, path: Path) -> None:
    """Write one file whole: to a temporary name beside it, then renamed."""
    import os

    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    part.write_text(text, encoding="utf-8", newline="\n")
    os.replace(part, path)
