"""Files of other languages, loaded in an engine as its user would load them: what an engine declares, and what it answers.

The answer is a :class:`simspec.world.types.ReadBack` of the file's own names: bodies under the names of the file, in frames at
their last joint, nothing repaired. A shape of kind ``mesh`` is told by its support function (:func:`support`), not its
vertices.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from simspec.confinement import PROFILES, confine_calls
from simspec.engines.kit.effects import Effect
from simspec.world import frames
from simspec.world.types import Body, EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Vector3

if TYPE_CHECKING:
    from simspec.engines.kit.contract import Engine

Floats = NDArray[np.float64]

MESH = "mesh"
"""The kind of a shape that is told by its support function."""
AXES = 6
"""Directions of a support function of which only the bounding box is known: the first ones."""
UNNAMED = "body_{}"
"""What a body without a name is called, by its place."""


@dataclass(frozen=True, slots=True)
class Reads:
    """That an engine reads a language: ``how``, as a user calls it; ``suffixes`` of its files, and the ``root`` element by
    which they are told from others. ``defines``: what the engine makes of a file is what the language means, where nobody else
    says it. ``effects``: what it does to simspec's plain files, measured with the version ``version``."""

    how: str
    suffixes: tuple[str, ...]
    root: str
    defines: bool = False
    version: str = ""
    effects: tuple[Effect, ...] = ()


@dataclass(frozen=True, slots=True)
class Own:
    """A number that an engine adds to any file, under a name of the read-back's inventory.

    ``meaning``: what it is where nothing is added; None where files do not speak of it. ``changes``: whether the motion of the
    file's model changes, or only something that files leave open. ``why``: what it does, in a sentence.
    """

    meaning: EngineValue | None
    changes: Literal["physics", "default"]
    why: str


def directions() -> Floats:
    """Unit vectors (26, 3): along the axes (+x −x +y −y +z −z), then to the edges and corners of a cube."""
    axes = [sign * row for row in np.eye(3) for sign in (1.0, -1.0)]
    rest = [np.array(one, dtype=float) for one in itertools.product((-1, 0, 1), repeat=3) if np.count_nonzero(one) > 1]
    return np.array([one / np.linalg.norm(one) for one in (*axes, *rest)])


def support(vertices: Floats, count: int | None = None) -> tuple[float, ...]:
    """How far vertices (n, 3) reach along each of :func:`directions` (the first ``count``) from their frame's origin (m)."""
    return tuple((np.asarray(vertices, dtype=float) @ directions()[:count].T).max(axis=0).tolist())


def box_support(lower: Sequence[float], upper: Sequence[float]) -> tuple[float, ...]:
    """The support function of what is only known by its bounding box, along the axes."""
    return tuple(value for low, high in zip(lower, upper, strict=True) for value in (float(high), -float(low)))


MEMORY = 2 * 2**30
"""Bytes of data of a process that loads a stranger's file, engine included: twice what simspec's own importers may take."""


def _bound_memory() -> None:
    """Let this process have no more than :data:`MEMORY`, where the system knows such a bound; a deadline it has anyway."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    least = min((one for one in (MEMORY, soft, hard) if one != resource.RLIM_INFINITY), default=MEMORY)
    with contextlib.suppress(OSError, ValueError):  # a system without it
        resource.setrlimit(resource.RLIMIT_DATA, (least, hard))


class ForeignSession:
    """An engine that holds a foreign file, or nothing yet: stands in place of a session that holds artifacts."""

    artifacts: Path | None = None

    def __init__(self, engine: type[Engine]):
        self._engine = engine()
        self._log: list[str] = []
        self.load_seconds = 0.0

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str]) -> ReadBack:
        """What the engine holds of a file, which it loads in bounded memory and confined by the kernel: whoever wrote it may
        have meant it to take all that there is, or to lead elsewhere."""
        self._engine.prepare_foreign()
        _bound_memory()
        confine_calls(PROFILES["scratch"])  # files were confined before the engine was imported (``worker.py``)
        return self._engine.load_foreign(file, language, packages, self._log)

    def log(self) -> list[str]:
        """What the engine had to say."""
        return self._log

    def close(self) -> None:
        """Free what the engine holds."""
        self._engine.close()


def foreign_answer(session: Any, operation: Mapping[str, Any]) -> ReadBack:
    """The operation ``foreign``: ``file`` in ``language``, with the folders of ``packages``."""
    held: ReadBack = session.load_foreign(Path(operation["file"]), operation["language"], operation["packages"])
    return held


@dataclass(frozen=True, slots=True)
class HeldLink:
    """A body as an engine holds it at the coordinates that the file calls zero: ``pose`` of the engine's own frame in
    the world;
    all else in that frame, ``anchor`` the place of its joint. ``joint`` has everything but ``parent`` and ``origin``."""

    name: str
    parent: str | None
    pose: Pose
    inertial: Inertial
    joint: Joint
    anchor: Vector3 = (0.0, 0.0, 0.0)
    shapes: tuple[Shape, ...] = ()


def bodies_of_links(links: Sequence[HeldLink]) -> tuple[Body, ...]:
    """Bodies in frames at their joints, from links in whatever frames an engine has."""
    at = {link.name: Pose(_point(link.pose, link.anchor), link.pose.quaternion) for link in links}
    return tuple(_body(link, at) for link in links)


def _body(link: HeldLink, at: Mapping[str, Pose]) -> Body:
    inertial, joint, own = link.inertial, link.joint, at[link.name]
    centre = frames.subtract(inertial.centre_of_mass, link.anchor)
    if joint.kind == "free":
        joint = dataclasses.replace(joint, position=(*own.position, *own.quaternion))
    else:
        above = at[link.parent] if link.parent is not None else Pose()
        joint = dataclasses.replace(joint, parent=link.parent, origin=frames.compose(frames.inverse(above), own))
    shapes = tuple(
        dataclasses.replace(shape, pose=Pose(frames.subtract(shape.pose.position, link.anchor), shape.pose.quaternion))
        for shape in link.shapes
    )
    return Body(link.name, link.name, dataclasses.replace(inertial, centre_of_mass=centre), joint, shapes)


def _point(pose: Pose, place: Vector3) -> Vector3:
    return frames.add(pose.position, frames.rotate(pose.quaternion, place))


def told_apart(names: Sequence[str]) -> list[str]:
    """Names that an engine has twice, with a number."""
    counts: dict[str, int] = {}
    apart = []
    for place, name in enumerate(names):
        name = name or UNNAMED.format(place)
        counts[name] = counts.get(name, 0) + 1
        apart.append(name if counts[name] == 1 else f"{name}#{counts[name]}")
    return apart
