"""The committed output, ``generated/<name>/``: made, kept current, and checked for being current.

A folder holds world.json, one folder of artifacts per engine, certificate.json, and the marker that says so. An engine's proof
in the certificate belongs to exactly the hashes that it names: one that names others is dropped when the folder is written, and
reported by :func:`check`; the others stay (``proof/judge.py``). Files of others in the folder stay, and are not read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from simspec.compiler import Compiled, compile_world, output_files
from simspec.dialects.kit.sidecar import SIDECAR, read_sidecar
from simspec.engines.kit.registry import engine_name, engines
from simspec.errors import Location, Problem, SpecError
from simspec.outputs.files import files_below, read_bytes
from simspec.outputs.targets import COMPILED, MARKER_FILE, Marker, read_marker
from simspec.outputs.writing import Artifacts, update_folder
from simspec.selection import Selection
from simspec.world.canonical import sha256
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate
    from simspec.proof.judge import StoredProofs

GENERATED = Path("generated")
CERTIFICATE_FILE = "certificate.json"


@dataclass(frozen=True)
class CompiledSpec:
    """One compiled spec: the world, what each engine gets, and all files of its folder."""

    world: World
    compiled: Mapping[str, Compiled]
    files: Artifacts


def build(world: World, selection: Selection, locate: Callable[[str], Location | None]) -> CompiledSpec:
    """All files of ``world`` for the engines of ``selection``, compiled here unless choosing them has done it. Raises
    UnsupportedError with every problem."""
    compiled = selection.compiled
    if compiled is None:
        compiled = compile_world(world, selection.engines, locate, pythons=selection.pythons)
    return CompiledSpec(world, compiled, output_files(world, compiled))


@dataclass(frozen=True)
class Written:
    """The result of writing a folder: whether any file changed, and the state of the certificate there (None: there was
    none)."""

    folder: Path
    changed: bool
    stored: StoredProofs | None


def write(built: CompiledSpec, folder: Path) -> Written:
    """Write a compiled spec as simspec's content of ``folder``.

    Engines that were not compiled this time keep their artifacts as long as they are of the same world; a certificate keeps the
    proofs that are of these very files. Raises SpecError when the folder may not be written (:mod:`simspec.outputs.targets`).
    """
    found: list[StoredProofs] = []

    def change(real: Path | None) -> dict[str, bytes] | None:
        files = dict(built.files)
        now = {} if real is None else owned_files(real)
        if real is not None:
            kept = other_engines(built, real, now)
            files.update({name: content for name, content in now.items() if name.split("/")[0] in kept})
            if CERTIFICATE_FILE in now:
                content, stored = _holding(now[CERTIFICATE_FILE], built.world, files, folder)
                files |= {CERTIFICATE_FILE: content} if content is not None else {}
                found.append(stored)
        return None if now == files else files

    changed = update_folder(change, folder, COMPILED) is not None
    return Written(folder, changed, found[0] if found else None)


def _holding(
    content: bytes, world: World, files: Mapping[str, bytes], folder: Path
) -> tuple[bytes | None, StoredProofs]:
    """A certificate without the proofs that do not hold of ``files``, None where none does; and what became of it."""
    from simspec.proof.judge import StoredProofs, holding_proofs

    try:
        certificate = _parsed(content, folder)
    except SpecError as error:
        return None, StoredProofs(unread=_why(error, folder))
    stored = holding_proofs(certificate, world, engine_hashes(files))
    if stored.dropped and stored.kept:
        content = replace(certificate, engines=dict(stored.kept)).to_json().encode()
    return (content if stored.kept else None), stored


def engine_hashes(files: Mapping[str, bytes]) -> dict[str, str]:
    """The hash of each engine's artifacts among the files of a folder, by engine."""
    found: dict[str, dict[str, bytes]] = {}
    for name, content in files.items():
        engine, _, text = name.partition("/")
        if text:
            found.setdefault(engine, {})[text] = content
    return {engine: Artifacts(contents).sha256 for engine, contents in found.items()}


def owned_files(folder: Path) -> dict[str, bytes]:
    """The files that simspec wrote into a folder and that are there: content by relative path."""
    marker = read_marker(folder)
    found = {}
    for name in sorted(marker.files) if marker is not None else ():
        try:
            found[name] = read_bytes(folder / name, root=folder)
        except (FileNotFoundError, NotADirectoryError):
            continue  # removed by another process: it will be written again
    return found


def other_engines(built: CompiledSpec, folder: Path, names: Iterable[str]) -> list[str]:
    """The engines that have artifacts of the same world among files of ``folder``, but were not compiled this time.

    Raises SpecError where one's sidecar cannot be read.
    """
    engines = sorted({name.split("/")[0] for name in names if name.count("/") and name.endswith(f"/{SIDECAR}")})
    found = []
    for name in engines:
        if name not in built.compiled:
            try:
                content = read_sidecar(folder / name)
            except ValueError as error:
                raise SpecError(
                    [Problem(str(error), hint=f"compile for {name} too, or remove its folder", code="E110")]
                ) from None
            if content.get("world") == sha256(built.world):
                found.append(name)
    return found


def compare(files: Mapping[str, bytes], folder: Path) -> list[str]:
    """How ``folder`` differs from ``files``: "missing: PATH" and "stale: PATH", sorted."""
    found = []
    for name, content in sorted(files.items()):
        path = folder / name
        try:
            if read_bytes(path, root=folder) != content:
                found.append(f"stale: {path.as_posix()}")
        except (FileNotFoundError, NotADirectoryError):
            found.append(f"missing: {path.as_posix()}")
    return found


def check(built: CompiledSpec, folder: Path, named: bool = False) -> list[str]:
    """How ``folder`` differs from what compiling would write, its certificate included; ``named``: whether only some engines
    were requested.

    Files that simspec did not write are none of its business, unless they lie among an engine's files.
    """
    found = compare(built.files, folder)
    names = files_below(folder) if folder.is_dir() else []
    others = other_engines(built, folder, names)
    marker = read_marker(folder)
    owned = {name for name in names if marker is None or marker.owns(name)}
    for name in names:
        top = name.split("/")[0]
        expected = name in built.files or name in (CERTIFICATE_FILE, MARKER_FILE) or (top in others and name in owned)
        if not expected and (name in owned or top in built.compiled or top in others):
            found.append(f"not of this spec: {(folder / name).as_posix()}")
    if marker is None and names:
        found.append(
            f"missing: {(folder / MARKER_FILE).as_posix()} (remove the folder, then simspec compile writes it)"
        )
    elif marker is not None and marker != Marker(COMPILED, frozenset(owned - {MARKER_FILE})):
        found.append(f"stale: {(folder / MARKER_FILE).as_posix()}")
    path = (folder / CERTIFICATE_FILE).as_posix()
    if CERTIFICATE_FILE not in names:
        found.append(f"missing: {path} (simspec verify writes it)")
    elif why := certificate_mismatch(built, folder, named):
        found.append(f"stale: {path}: {why} (simspec verify replaces it)")
    return found


def read_certificate(folder: Path) -> Certificate | None:
    """The certificate in ``folder``; None when there is none. Raises SpecError, which names it, when it cannot be read."""
    path = folder / CERTIFICATE_FILE
    try:
        content = read_bytes(path, root=folder)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return _parsed(content, folder)


def _parsed(content: bytes, folder: Path) -> Certificate:
    from simspec.proof.certificate import Certificate

    return Certificate.from_json(content.decode(errors="replace"), str(folder / CERTIFICATE_FILE))


def _why(error: SpecError, folder: Path) -> str:
    """Why a certificate could not be read, without its name."""
    return error.problems[0].message.removeprefix(str(folder / CERTIFICATE_FILE)).removeprefix(":").strip()


def certificate_mismatch(built: CompiledSpec, folder: Path, named: bool = False) -> str | None:
    """Why the certificate in ``folder`` does not hold for a compiled spec; None when it does. Judged from its figures.

    ``named``: whether only some engines were requested. Of the others, proofs are then reported that do not hold any more, and
    not those that are not valid and say so.
    """
    from simspec.proof.judge import holding_proofs, judge

    try:
        certificate = read_certificate(folder)
    except SpecError as error:
        return _why(error, folder)
    if certificate is None:
        return "there is none"
    if certificate.world_sha256 != sha256(built.world):
        return "it belongs to another world"
    hashes = dict(certificate.artifacts_sha256)
    for engine, compiled in built.compiled.items():
        known = engines().get(engine_name(engine))
        if engine not in hashes and known is not None and known.FILES_ALONE:
            continue  # no certificate of it is valid where it is not installed
        if engine not in hashes:
            return f"it does not cover {engine}"
        if hashes[engine] != compiled.sha256:
            return f"it belongs to other files of {engine}"
    others = {name: proof for name, proof in certificate.engines.items() if name not in built.compiled}
    stored = holding_proofs(
        replace(certificate, engines=others), built.world, engine_hashes(owned_files(folder)) if others else {}
    )
    proofs = {
        name: proof
        for name, proof in certificate.engines.items()
        if name not in stored.dropped and (name in built.compiled or not named)
    }
    found = [f"{name}: {why}" for name, why in stored.dropped.items()]
    if proofs or not others:
        found += judge(replace(certificate, engines=proofs), built.world)
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return f"it is not valid: {found[0]}{more}"
    return None


def other_versions(folder: Path) -> list[str]:
    """A line for each engine whose proof in ``folder`` is of another version than is installed here; none of those that are not
    installed, and of labels, which name the version. :func:`check` reports certificates that cannot be read."""
    try:
        certificate = read_certificate(folder)
    except SpecError:
        return []
    lines = []
    for label, proof in (certificate.engines if certificate is not None else {}).items():
        known = engines().get(label)
        here = None if known is None else known.version()
        if here is not None and not proof.files_alone and proof.version != here:
            where = (folder / CERTIFICATE_FILE).as_posix()
            lines.append(
                f"{where}: proven in {label} {proof.version}, {here} is installed (simspec verify proves it there)"
            )
    return lines


@dataclass(frozen=True)
class Certified:
    """The result of writing a certificate: whether it changed, and the proofs of other engines that were kept or dropped."""

    changed: bool
    stored: StoredProofs


def write_certificate(certificate: Certificate, world: World, folder: Path) -> Certified:
    """Write the certificate of ``world`` into ``folder``, with those proofs of other engines in the old one that still hold.

    An old proof that is equal in all but the seconds stays as it is: a repository should be quiet when nothing has changed.
    Raises SpecError where the files are not those that were verified.
    """
    from simspec.proof.judge import StoredProofs, holding_proofs

    found = StoredProofs()

    def change(real: Path | None) -> dict[str, bytes] | None:
        nonlocal found
        if real is None:
            raise SpecError(
                [Problem(f"{folder}: removed while its content was being verified", hint="verify again", code="C111")]
            )
        now = owned_files(real)
        hashes = engine_hashes(now)
        for engine, wanted in certificate.artifacts_sha256.items():
            if hashes.get(engine) != wanted:
                message = (
                    f"{folder / engine}: the files are not those that were verified; the certificate is not written"
                )
                raise SpecError([Problem(message, hint="verify again", code="C111")])
        if CERTIFICATE_FILE in now:
            try:
                found = holding_proofs(_parsed(now[CERTIFICATE_FILE], folder), world, hashes, certificate.oracle)
            except SpecError as error:
                found = StoredProofs(unread=_why(error, folder))
        content = certificate.joined(found.kept).to_json().encode()
        return None if now.get(CERTIFICATE_FILE) == content else now | {CERTIFICATE_FILE: content}

    changed = update_folder(change, folder, COMPILED) is not None
    return Certified(changed, found.without(certificate.engines))
