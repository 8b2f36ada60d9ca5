"""Files of other languages, loaded in an engine as its user would load them: declarations and answers of an engine.

The answer is a :class:`simspec.world.types.ReadBack` of the file's own names: bodies under the names of the file, in frames at
their last joint, nothing repaired. A shape of kind ``mesh`` is given by its support function (:func:`support`), not its
vertices.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from simspec.confinement import PROFILES, confine_calls
from simspec.control.reference import ActuatorDrive, drives
from simspec.formats.kit.contract import Format, formats
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.frames import IDENTITY
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Vector3, World

if TYPE_CHECKING:
    from simspec.engines.kit.contract import Engine


# Known effects of readers on plain files, as rows of data: the exporter lists them, and tests compare them with readers.
#
# Each row names a quantity of the comparison (``audit/compare.py``) and a case: the bodies of a world for which the reader's
# value is another. A case knows the world and the file's format, no reader.

FILE: Final = "the file"
"""The element of what concerns a file as a whole."""
REFUSED: Final = "file"
"""The quantity of a file that a reader refuses: nothing else of it is foreseen."""
EARTH: Final = (0.0, 0.0, -9.81)
"""Gravity (m/s²) that readers take where they read none."""
MANY: Final = 14
"""Moving shapes."""
UNIFORM: Final = 1e-9
"""Relative: how far a tensor may be from that of a uniform shape and be the same."""


@dataclass(frozen=True, slots=True)
class Effect:
    """One thing that a reader does to a file.

    quantity  of the comparison: ``mass``, ``joint.armature``, ``gravity``; ``REFUSED``
    case      a name of ``CASES``: which bodies, or the file
    what      a sentence for users: subject, verb, object
    profiles  layouts of the format in which it happens; empty: all
    seen      exactly: the comparison finds it for each body of the case, and for no other; may: for some or none of the case's
              (of a file: of any body), since the reader's value may happen to be the world's; elsewhere: it is measured by
              other means (tests/audit)
    """

    quantity: str
    case: str
    what: str
    profiles: tuple[str, ...] = ()
    seen: Literal["exactly", "may", "elsewhere"] = "exactly"


@dataclass(frozen=True, slots=True)
class Exported:
    """A file: the world, the bodies of it that the file has, and its format."""

    world: World
    bodies: tuple[Body, ...]
    language: str

    @property
    def written(self) -> Format:
        """The format."""
        return formats()[self.language]

    @property
    def balls_are_hinges(self) -> bool:
        """Whether the format has three hinges, through two links, in place of a ball joint."""
        return self.written.SUPPORT[Feature.JOINT_BALL].level is not Level.EXACT

    @property
    def static(self) -> set[str]:
        """The bodies that cannot move."""
        return {name for name, group in rigid_groups(self.world).items() if group == "world"}


Case = Callable[[Exported], Iterable[str]]


def foreseen(effects: Iterable[Effect], exported: Exported, profile: str) -> list[tuple[Effect, tuple[str, ...]]]:
    """The effects that happen to a file, each with its bodies (or ``FILE``); a refusal stands alone."""
    found = []
    for effect in effects:
        if effect.profiles and profile not in effect.profiles:
            continue
        names = tuple(dict.fromkeys(CASES[effect.case](exported)))
        if names:
            found.append((effect, names))
    refused = [row for row in found if row[0].quantity == REFUSED]
    return refused[:1] or found


# --- cases --------------------------------------------------------------------------------------------------------


def _bodies(holds: Callable[[Exported, Body], bool]) -> Case:
    return lambda exported: (body.name for body in exported.bodies if holds(exported, body))


def _file(holds: Callable[[Exported], bool]) -> Case:
    return lambda exported: (FILE,) if holds(exported) else ()


def _scalar(body: Body) -> bool:
    return body.joint.kind in SCALAR_JOINTS


def _solids(body: Body) -> list[Shape]:
    return [shape for shape in body.shapes if shape.collision]


def _fixed_root(body: Body) -> bool:
    return body.joint.kind == "fixed" and body.joint.parent is None


def _has_volume(body: Body) -> bool:
    return any(shape.kind != "plane" for shape in body.shapes)


def _uniform(body: Body, solids: Sequence[Shape], kinds: tuple[str, ...]) -> bool:
    """Whether a body is one shape of these kinds, uniformly full, at its centre of mass and along its axes."""
    if len(solids) != 1 or solids[0].kind not in kinds:
        return False
    shape = solids[0]
    if shape.kind != "sphere" and shape.pose.quaternion != IDENTITY:
        return False
    if not np.allclose(shape.pose.position, body.inertial.centre_of_mass, rtol=0.0, atol=UNIFORM):
        return False
    moments = np.array((*SHAPES[shape.kind].moments(shape.size, body.inertial.mass), 0.0, 0.0, 0.0))
    return bool(np.allclose(moments, body.inertial.inertia, rtol=UNIFORM, atol=UNIFORM * moments.max()))


def _of_mass_that_moves(exported: Exported, body: Body) -> bool:
    return bool(body.inertial.mass) and body.name not in exported.static


def _several_links(exported: Exported) -> bool:
    """Whether a file has more than one link in a tree; that of the world counts."""
    return len(exported.bodies) > 1 or exported.bodies[0].joint.kind != "free"


def _several_bodies(exported: Exported) -> bool:
    return any(body.joint.parent is not None or _as_hinges(exported, body) for body in exported.bodies)


def _as_hinges(exported: Exported, body: Body) -> bool:
    """Whether a body is on a ball joint, of which the file has three hinges."""
    return body.joint.kind == "ball" and exported.balls_are_hinges


def _limited(exported: Exported, body: Body) -> bool:
    """Whether a joint has position limits, or a format's stand-in for none."""
    return body.joint.position_limits is not None or body.joint.kind in exported.written.RANGED


def _below_balls(exported: Exported) -> Iterator[str]:
    """Bodies on ball joints, but roots, and what stands on them."""
    left: set[str] = set()
    for body in exported.bodies:
        if (body.joint.kind == "ball" and body.joint.parent is not None) or body.joint.parent in left:
            left.add(body.name)
            yield body.name


def _driven(exported: Exported, body: Body) -> ActuatorDrive | None:
    return next((drive for drive in drives(exported.world) if drive.joint == body.joint.name), None)


def _static_tree(exported: Exported, body: Body) -> bool:
    """Whether a body is the root of a tree that cannot move, whose joint to the world is not in the file."""
    joint = body.joint
    tree = {entry.name for entry in exported.bodies if entry.model == body.model}
    return _fixed_root(body) and tree <= exported.static and joint.name == f"{body.name}_joint"


def _plane_and_many(exported: Exported) -> bool:
    """Whether a file has a plane, and ``MANY`` shapes or more of bodies that move."""
    static = exported.static
    moving = sum(len(_solids(body)) for body in exported.bodies if body.name not in static)
    planes = any(shape.kind == "plane" for body in exported.bodies for shape in _solids(body))
    return planes and moving >= MANY


CASES: Final[Mapping[str, Case]] = {
    "every file": _file(lambda _: True),
    "free root": _bodies(lambda _, body: body.joint.kind == "free"),
    "free root or fixed root with mass or volume": _file(
        lambda exported: any(
            body.joint.kind == "free" or (_fixed_root(body) and (body.inertial.mass or _has_volume(body)))
            for body in exported.bodies
        )
    ),
    "a free body": _file(lambda exported: any(body.joint.kind == "free" for body in exported.bodies)),
    "fixed root with mass or volume": _bodies(
        lambda _, body: _fixed_root(body) and (bool(body.inertial.mass) or _has_volume(body))
    ),
    "fixed root with volume, without mass": _bodies(
        lambda _, body: _fixed_root(body) and not body.inertial.mass and _has_volume(body)
    ),
    "tree that cannot move": _bodies(_static_tree),
    "hinge or slide": _bodies(lambda _, body: _scalar(body)),
    "a hinge or a slide": _file(
        lambda exported: any(_scalar(body) or _as_hinges(exported, body) for body in exported.bodies)
    ),
    "velocity limit": _bodies(lambda _, body: body.joint.velocity_limit is not None),
    "effort limit": _bodies(lambda _, body: body.joint.effort_limit is not None),
    "a position limit": _file(lambda exported: any(_limited(exported, body) for body in exported.bodies)),
    "dry friction": _bodies(lambda _, body: bool(body.joint.dry_friction)),
    "spring of a hinge or a slide": _bodies(lambda _, body: _scalar(body) and bool(body.joint.spring_stiffness)),
    "damping of a ball joint": _bodies(lambda _, body: body.joint.kind == "ball" and bool(body.joint.damping)),
    "body on a ball joint, or on such a body": _below_balls,
    "a ball joint": _file(lambda exported: any(body.joint.kind == "ball" for body in exported.bodies)),
    "several links": _file(_several_links),
    "several bodies in a tree": _file(_several_bodies),
    "a loop": _file(lambda exported: exported.written.closes_loops(exported.world)),
    "root on a ball joint": _bodies(lambda _, body: body.joint.kind == "ball" and body.joint.parent is None),
    "several bodies in a tree, or a hinge or a slide": _file(
        lambda exported: any(body.joint.parent is not None or _scalar(body) for body in exported.bodies)
    ),
    "gravity": _file(lambda exported: any(exported.world.physics.gravity)),
    "something joined to the world": _file(
        lambda exported: any(
            body.joint.parent is None and body.joint.kind != "free" and not _static_tree(exported, body)
            for body in exported.bodies
        )
    ),
    "an ellipsoid": _file(
        lambda exported: any(shape.kind == "ellipsoid" for body in exported.bodies for shape in body.shapes)
    ),
    "cylinder": _bodies(lambda _, body: any(shape.kind in ("cylinder", "capsule") for shape in _solids(body))),
    "plane": _bodies(lambda _, body: any(shape.kind == "plane" for shape in _solids(body))),
    "a plane and 14 or more moving shapes": _file(_plane_and_many),
    "a shape that is no sphere": _file(
        lambda exported: any(
            shape.kind not in ("sphere", "ellipsoid") for body in exported.bodies for shape in _solids(body)
        )
    ),
    "mass that moves": _bodies(_of_mass_that_moves),
    "mass that moves, other than a uniform sphere or box": _bodies(
        lambda exported, body: _of_mass_that_moves(exported, body)
        and not _uniform(body, _solids(body), ("sphere", "box"))
    ),
    "mass, other than a uniform sphere, box or cylinder": _bodies(
        lambda _, body: bool(body.inertial.mass) and not _uniform(body, body.shapes, ("sphere", "box", "cylinder"))
    ),
    "no shape": _bodies(
        lambda exported, body: not body.shapes and body.inertial.mass != 1.0 and body.name not in exported.static
    ),
    "no shape, centre elsewhere": _bodies(
        lambda exported, body: (
            not body.shapes and any(body.inertial.centre_of_mass) and body.name not in exported.static
        )
    ),
    "gravity other than 9.81 m/s² down": _file(lambda exported: exported.world.physics.gravity != EARTH),
    "timestep other than 1 ms": _file(lambda exported: exported.world.physics.timestep != 1e-3),
    "effort limit without a controller": _bodies(
        lambda exported, body: body.joint.effort_limit is not None and _driven(exported, body) is None
    ),
    "other effort limit of the controller": _bodies(
        lambda exported, body: (drive := _driven(exported, body)) is not None
        and drive.effort_limit != body.joint.effort_limit
    ),
    "on a fixed root that stands elsewhere": _bodies(
        lambda exported, body: any(
            entry.name == body.joint.parent and _fixed_root(entry) and entry.joint.origin != Pose()
            for entry in exported.bodies
        )
    ),
    "several trees": _file(lambda exported: sum(body.joint.parent is None for body in exported.bodies) > 1),
}
"""Which bodies, or whether the file, by names that say it."""

Floats = NDArray[np.float64]

MESH = "mesh"
"""The kind of a shape that is given by its support function."""
AXES = 6
"""Directions of a support function of which only the bounding box is known: the first ones."""
UNNAMED = "body_{}"
"""The name of a body without a name, by its place."""


@dataclass(frozen=True, slots=True)
class Reads:
    """That an engine reads a language: ``how``, as a user calls it; ``suffixes`` of its files, and the ``root`` element by
    which they are distinguished from others. ``defines``: the engine's reading of a file defines the language, where it has no
    other definition. ``effects``: its effects on simspec's plain files, measured with the version ``version``."""

    how: str
    suffixes: tuple[str, ...]
    root: str
    defines: bool = False
    version: str = ""
    effects: tuple[Effect, ...] = ()


@dataclass(frozen=True, slots=True)
class EngineAddition:
    """A number that an engine adds to any file, under a name of the read-back's inventory.

    ``meaning``: its value where nothing is added; None where files do not define it. ``changes``: whether the motion of the
    file's model changes, or only something that files leave open. ``why``: its effect, in a sentence.
    """

    meaning: EngineValue | None
    changes: Literal["physics", "default"]
    why: str


def directions() -> Floats:
    """Unit vectors (26, 3): along the axes (+x −x +y −y +z −z), then to the edges and corners of a cube."""
    axes = [sign * row for row in np.eye(3) for sign in (1.0, -1.0)]
    rest = [
        np.array(entry, dtype=float) for entry in itertools.product((-1, 0, 1), repeat=3) if np.count_nonzero(entry) > 1
    ]
    return np.array([axis / np.linalg.norm(axis) for axis in (*axes, *rest)])


def support(vertices: Floats, count: int | None = None) -> tuple[float, ...]:
    """How far vertices (n, 3) reach along each of :func:`directions` (the first ``count``) from their frame's origin (m)."""
    return tuple((np.asarray(vertices, dtype=float) @ directions()[:count].T).max(axis=0).tolist())


def box_support(lower: Sequence[float], upper: Sequence[float]) -> tuple[float, ...]:
    """The support function of what is only known by its bounding box, along the axes."""
    return tuple(value for low, high in zip(lower, upper, strict=True) for value in (float(high), -float(low)))


MEMORY = 2 * 2**30
"""Bytes of data of a process that loads an untrusted file, engine included: twice what simspec's own importers may take."""
REMAINING = MEMORY // 2
"""Bytes for the file at least, in an engine that holds more than the other half before (``Engine.FOREIGN_MEMORY``)."""


def _bound_memory(engine: type[Engine]) -> None:
    """Let this process have no more than :data:`MEMORY`, or :data:`REMAINING` more than the engine holds, where the system
    knows such a bound; a deadline it has anyway."""
    import resource

    most = max(MEMORY, engine.FOREIGN_MEMORY + REMAINING)
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    least = min((index for index in (most, soft, hard) if index != resource.RLIM_INFINITY), default=most)
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
        """The engine's model of a file, which it loads in bounded memory and confined by the kernel: its author may have meant
        it to exhaust memory, or to lead elsewhere."""
        self._engine.prepare_foreign()
        _bound_memory(type(self._engine))
        confine_calls(PROFILES["scratch"])  # files were confined before the engine was imported (``worker.py``)
        return self._engine.load_foreign(file, language, packages, self._log)

    def log(self) -> list[str]:
        """Messages of the engine."""
        return self._log

    def close(self) -> None:
        """Free what the engine holds."""
        self._engine.close()


def foreign_answer(session: Any, operation: Mapping[str, Any]) -> ReadBack:
    """The operation ``foreign``: ``file`` in ``language``, with the folders of ``packages``."""
    foreign: ReadBack = session.load_foreign(Path(operation["file"]), operation["language"], operation["packages"])
    return foreign


@dataclass(frozen=True, slots=True)
class EngineLink:
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


def bodies_of_links(links: Sequence[EngineLink]) -> tuple[Body, ...]:
    """Bodies in frames at their joints, from links in whatever frames an engine has."""
    at = {link.name: Pose(_point(link.pose, link.anchor), link.pose.quaternion) for link in links}
    return tuple(_body(link, at) for link in links)


def _body(link: EngineLink, at: Mapping[str, Pose]) -> Body:
    inertial, joint, pose = link.inertial, link.joint, at[link.name]
    centre = frames.subtract(inertial.centre_of_mass, link.anchor)
    if joint.kind == "free":
        joint = dataclasses.replace(joint, position=(*pose.position, *pose.quaternion))
    else:
        above = at[link.parent] if link.parent is not None else Pose()
        joint = dataclasses.replace(joint, parent=link.parent, origin=frames.compose(frames.inverse(above), pose))
    shapes = tuple(
        dataclasses.replace(shape, pose=Pose(frames.subtract(shape.pose.position, link.anchor), shape.pose.quaternion))
        for shape in link.shapes
    )
    return Body(link.name, link.name, dataclasses.replace(inertial, centre_of_mass=centre), joint, shapes)


def _point(pose: Pose, place: Vector3) -> Vector3:
    return frames.add(pose.position, frames.rotate(pose.quaternion, place))


def distinct_names(names: Sequence[str]) -> list[str]:
    """Names that an engine has twice, with a number."""
    counts: dict[str, int] = {}
    separate = []
    for place, name in enumerate(names):
        name = name or UNNAMED.format(place)
        counts[name] = counts.get(name, 0) + 1
        separate.append(name if counts[name] == 1 else f"{name}#{counts[name]}")
    return separate
