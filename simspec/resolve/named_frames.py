"""Named frames of the world: names resolved, copies made, and where a body may be named the frame on it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from simspec.errors import Problem
from simspec.language.document import Key
from simspec.language.named_frames import Frame as SpecFrame
from simspec.language.sources import Source
from simspec.language.strict import near
from simspec.language.trees import model_of, placed
from simspec.resolve.poses import elements, pose
from simspec.world.types import Body, Frame, Pose


@dataclass(frozen=True)
class Written:
    """A frame of one copy of a model, or of the scenario: where it stands, what it says, and the prefix of the body's name."""

    file: Source
    path: tuple[Key, ...]
    content: SpecFrame
    prefix: str = ""

    @property
    def body(self) -> str:
        return self.prefix + self.content.body


Places = Mapping[str, tuple[str, Pose]]
"""Of bodies and frames by name: the body, and the place in its frame."""


def written_frames(source: Source) -> dict[str, Written]:
    """The frames of a scenario and of every copy of every model, by their full names. The nearer file's replaces another's."""
    found: dict[str, Written] = {}

    def take(prefix: str, files: Sequence[Source]) -> None:
        for file in reversed(files):
            model = file.file.model if file.file is not None else None
            for name, content in (model.frames if model is not None else {}).items():
                found[prefix + name] = Written(file, ("model", "frames", name), content, prefix)

    if source.file is not None:
        for name, content in source.file.frames.items():
            found[name] = Written(source, ("frames", name), content)
    if (own := model_of(source)) is not None:
        take("", own.files)
    for placement, use, bodies in placed(source):
        if use is None:
            continue  # has errors, which are reported elsewhere
        for suffix, _ in elements(use.array):
            prefix = f"{placement}{suffix}/"
            take(prefix, bodies.files)
            for name, content in use.frames.items():
                found[prefix + name] = Written(source, ("models", placement, "frames", name), content, prefix)
    return found


def named_frames(
    source: Source, bodies: Iterable[Body], arrays: Iterable[tuple[str, dict[str, str], dict[str, str]]]
) -> tuple[tuple[Frame, ...], list[Problem]]:
    """The frames of a spec, sorted by name, and what is wrong with them. ``arrays``: of every copy of a loose tree in an array
    its suffix, and the full names of its joints and bodies by their names in the spec; frames on it are copied with it, and
    noted among these bodies, since constraints may name them in their place."""
    known = {body.name for body in bodies}
    copies = list(arrays)
    resolved: dict[str, Frame] = {}
    problems: list[Problem] = []
    refused: set[tuple[int, tuple[Key, ...]]] = set()
    for name, written in written_frames(source).items():
        place = (id(written.file), written.path)
        for full, body in _copied(name, written, copies):
            message = hint = None
            key = False
            if body not in known:
                own = [other.removeprefix(written.prefix) for other in known if other.startswith(written.prefix)]
                message, hint = f"there is no body {written.content.body!r}", near(written.content.body, own)
            elif full in known or full in resolved:
                message, hint, key = (
                    f"there is a {'body' if full in known else 'frame'} {full!r} already",
                    "another name",
                    True,
                )
            if message is None:
                resolved[full] = Frame(full, body, pose(written.content.pose))
            elif place not in refused:
                refused.add(place)
                below: tuple[Key, ...] = () if key else ("body",)
                found = full if key else written.content.body
                document = written.file.document
                problems.append(document.problem((*written.path, *below), message, key=key, found=found, hint=hint))
    return tuple(resolved[name] for name in sorted(resolved)), problems


def _copied(
    name: str, written: Written, arrays: Iterable[tuple[str, dict[str, str], dict[str, str]]]
) -> Iterator[tuple[str, str]]:
    """The full name of a frame and of its body, once for each copy of the body."""
    copied = False
    for suffix, _, bodies in arrays if not written.prefix else ():
        if (body := bodies.get(written.body)) is not None:
            copied = True
            bodies.setdefault(name, name + suffix)
            yield name + suffix, body
    if not copied:
        yield name, written.body


def places_of(bodies: Iterable[Body], named: Iterable[Frame]) -> dict[str, tuple[str, Pose]]:
    """What may be named where a point of a body is meant: bodies, each its own frame, and frames."""
    return {body.name: (body.name, Pose()) for body in bodies} | {one.name: (one.body, one.pose) for one in named}
