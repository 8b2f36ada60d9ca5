"""The text of a spec that an importer made, in the canonical layout with a comment at each repair; and its timestep."""

from __future__ import annotations

import copy
import hashlib
import math
import os
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from simspec.errors import Location, Problem, SpecError, visible
from simspec.language.beginning import begin_within
from simspec.language.document import MOST_EVENTS, Key, build, event_count, events
from simspec.language.foreign import Imported
from simspec.language.formatting import WIDTH, CommentedEntry, CommentedNode, lines, node_of
from simspec.language.load import Spec
from simspec.language.packages import Package
from simspec.language.shapes import named_files
from simspec.world.damping import retimed
from simspec.world.kinematics import owner_of
from simspec.world.types import World

USUAL: Final = 1e-3
"""s; the language's default."""
SHORTEST: Final = 1e-5
"""s; a drive that needs shorter steps is no spring that anyone would simulate so."""
LEAST: Final = 1e-7
"""s; real robots have dampers that are stable up to 5e-6 s (a wheel of 1 N m s/rad), and 7e-7 s (a finger's last link)."""
RESOLVED: Final = 1e-9
"""s: a timestep at which every spring is stable, so that every world resolves; nothing is stepped."""
SHARE: Final = 0.7
"""Of the longest stable timestep that is taken: other configurations allow less."""
MOST_ROUNDS: Final = 50
DRIVEN: Final = ("spring", "damping")


def has_drives(data: dict[str, Any]) -> bool:
    """Whether a joint of a spec has a spring or a damper."""
    return any(word in joint for body in _bodies(data).values() for joint in _joints(body) for word in DRIVEN)


def add_timestep(imported: Imported) -> None:
    """Say a timestep in the spec of a file that has no word for it, where it is unstable at the usual one."""
    data = imported.data
    if "timestep" in data.get("physics", {}) or not has_drives(data):
        return
    try:
        step = stable_timestep(data, imported.files, None)
    except SpecError:
        return  # a spec that does not resolve is reported by its reader, with its places
    if step is not None:
        words = [word for word in ("simspec", "name", "description", "physics") if word in data]
        first: dict[str, Any] = {word: data.pop(word) for word in words}
        first.setdefault("physics", {})["timestep"] = step
        imported.data = {**first, **data}
        imported.comments["physics.timestep"] = (
            "the file says no timestep; its dampers are stable at this one (with `damping: implicit` at any)"
        )


def stable_timestep(
    data: dict[str, Any], meshes: dict[str, Path], leave_out: Callable[[str, float], None] | None
) -> float | None:
    """The timestep of a spec whose file says none; None for the usual one.

    ``leave_out`` receives the full name of each body whose joint's drives are stable at no timestep of :data:`SHORTEST` or
    more, with the longest (s) at which they are; they are taken out of ``data``. Without it the timestep is as short as it
    takes, down to :data:`LEAST`, and None below. Raises SpecError as resolving does. Without Pinocchio, which knows mass
    matrices, it is not called."""
    try:
        from simspec.dynamics.stability import unstable
    except ModuleNotFoundError:
        return None
    for _ in range(MOST_ROUNDS):
        world = _resolved(data, meshes)
        stiff = unstable(_stepped(world, SHORTEST if leave_out is not None else LEAST))
        if not stiff:
            steps = [instability.largest_stable_step for instability in unstable(_stepped(world, USUAL))]
            return round_step(SHARE * min(steps)) if steps else None
        if leave_out is None:
            return None
        bodies = _bodies(data)
        for instability in stiff:
            for name in dict.fromkeys(owner_of(body) for body in instability.bodies):
                for joint in _joints(bodies[name]):
                    for word in DRIVEN:
                        joint.pop(word, None)
                leave_out(name, instability.largest_stable_step)
    return None


def _stepped(world: World, step: float) -> World:
    return retimed(world, step, world.physics.steps)


def _resolved(data: dict[str, Any], meshes: dict[str, Path]) -> World:
    timed = copy.deepcopy(data)
    for body in _bodies(timed).values():
        if "mass" in body and "inertia" in body:
            body.pop("shapes", None)  # their mass is not needed: meshes need not be read
    begin_within(timed, {})  # as the spec will: beyond their limits joints are refused
    timed.setdefault("physics", {})["timestep"] = RESOLVED
    here = Path.cwd()
    for path, text in list(named_files(timed)):
        _put(timed, path, os.path.relpath(meshes[text], here))
    return Spec.from_data(timed, folder=here, allow_outside=True).resolve()


def _bodies(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    bodies = dict(data.get("model", {}).get("bodies", {}))
    bodies |= data.get("bodies", {})
    for model, placed in data.get("models", {}).items():
        bodies |= {f"{model}/{name}": body for name, body in placed["bodies"].items()}
    return bodies


def _joints(body: dict[str, Any]) -> list[dict[str, Any]]:
    return [body["joint"]] if "joint" in body else list(body.get("joints", ()))


def round_step(longest: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten that is not above ``longest``."""
    power = math.floor(math.log10(longest))
    return float(f"{max(digit for digit in (1, 2, 5) if digit * 10.0**power <= longest)}e{power}")


MARK: Final = "# Written by simspec import"
"""How a file begins that simspec may write again; then the file that it comes from, and :data:`SUM` of what follows."""
SUM: Final = "; as it was written: "
DIGITS: Final = 16


def spec_text(imported: Imported, source: str, files: Mapping[str, str] | None = None) -> str:
    """The spec of an import, from a file called ``source``. ``files``: the names in the spec of the files that the data
    names, by the texts there. Raises SpecError where the text would not read as the same data."""
    if (problem := too_long(imported, source)) is not None:
        raise SpecError([problem])
    data = _renamed(imported.data, files or {})
    root = node_of(data)
    index: Index = {}
    sentences: dict[str, list[str]] = {path: [text] for path, text in imported.comments.items()}
    for repair in imported.repairs:
        sentences.setdefault(repair.path, []).append(f"repaired ({repair.rule}): {repair.what}")
    header: list[str] = []
    for path, said in sentences.items():
        entry = _entry(root, path, index)
        comment = [line for sentence in said for line in _comment(sentence)]
        if entry is None:
            header += comment
        else:
            entry.above += comment
    body = "\n".join(lines(root, header, [])) + "\n"
    document = build(events(body, "<spec>"), "<spec>")
    if document.problems or document.data != data:
        message = "this import cannot be written as a spec without changing its meaning"
        raise SpecError([*document.problems, Problem(message, hint="report this: it is a bug in simspec", code="C115")])
    return f"{MARK} from {visible(source)}{SUM}{hashlib.sha256(body.encode()).hexdigest()[:DIGITS]}\n{body}"


def too_long(imported: Imported, shown: str) -> Problem | None:
    """The problem of an import that is more than one file of the language may hold; computed before the work of resolving and
    writing it. ``shown``: how messages call the file."""
    if (count := event_count(imported.data)) <= MOST_EVENTS:
        return None
    place = imported.places.get((), Location(shown, 1, 1))
    hint = "a scenario may take the file as it is: models: {NAME: {use: FILE}}"
    message = "as a spec, this file has more keys and values than one file may have"
    return Problem(message, location=place, found=f"{count:,}", allowed=f"{MOST_EVENTS:,}", hint=hint, code="I105")


def is_unchanged(content: bytes) -> bool:
    """Whether a file is as :func:`spec_text` made it, without later changes."""
    first, _, body = content.partition(b"\n")
    head, found, digits = first.decode("utf-8", "replace").rpartition(SUM)
    return bool(found) and head.startswith(MARK) and digits == hashlib.sha256(body).hexdigest()[:DIGITS]


def _comment(sentence: str) -> Iterator[str]:
    for line in textwrap.wrap(visible(sentence), WIDTH - 20, break_on_hyphens=False):
        yield f"# {line}"


Index = dict[int, dict[str, CommentedEntry]]
"""The entries of a node by name, by the ``id`` of the node: a file of many bodies has as many comments."""


def _entry(root: CommentedNode, path: str, index: Index) -> CommentedEntry | None:
    """The entry at a dotted path, or the nearest one around it; None for the whole spec."""
    entry: CommentedEntry | None = None
    node = root
    for depth, step in enumerate(path.split(".")):
        if depth > 0 and node.kind == "scalar":
            break
        if node.kind == "list":
            is_item = step.isascii() and step.isdigit() and int(step) < len(node.entries)
            below = node.entries[int(step)] if is_item else None
        else:
            if id(node) not in index:
                index[id(node)] = {entry.name: entry for entry in reversed(node.entries) if entry.name is not None}
            below = index[id(node)].get(step)
        if below is None:
            break
        entry, node = below, below.node
    return entry


def _renamed(data: dict[str, Any], files: Mapping[str, str]) -> dict[str, Any]:
    changed = copy.deepcopy(data)
    for path, text in named_files(data):
        _put(changed, path, files.get(text, text))
    return changed


def _put(data: Any, path: Sequence[Key], value: str) -> None:
    for step in path[:-1]:
        data = data[step]
    data[path[-1]] = value


def from_folder(imported: Imported, folder: Path, package: Package | None = None) -> dict[str, str]:
    """How a spec in ``folder`` calls the files that the data names: by their names in the ``package`` that they are in, else
    their paths from there."""
    here = folder.resolve()
    return {
        text: (package and package.named(path)) or Path(os.path.relpath(path, here)).as_posix()
        for text, path in imported.files.items()
    }


def copies(imported: Imported, into: Path, folder: Path) -> tuple[dict[str, Path], dict[str, str]]:
    """Names in the folder ``into`` for the files that the data names, each with the file; and what a spec in ``folder`` calls
    them. The files that a glTF file needs would be missing there, so that such a file stays where it is."""
    sources: dict[str, Path] = {}
    called = from_folder(imported, folder)
    place = Path(os.path.relpath(into.resolve(), folder.resolve()))
    names: dict[Path, str] = {}
    for text, path in imported.files.items():
        if path.suffix.lower() == ".gltf":
            continue
        if path not in names:
            name, number = path.name, 1
            while name in sources:
                number += 1
                name = f"{path.stem}_{number}{path.suffix}"
            names[path], sources[name] = name, path
        called[text] = (place / names[path]).as_posix()
    return sources, called
