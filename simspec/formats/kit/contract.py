"""A format: a language that files are written in. It knows no engine; several may read it, each in its dialect."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.errors import Problem, SpecError, UnsupportedError
from simspec.plugins import Plugins
from simspec.support.declarations import Level, Table, check_total
from simspec.support.negotiation import needs
from simspec.world import frames
from simspec.world.frames import direction
from simspec.world.inertia import gathered
from simspec.world.types import Body, Pose, Quaternion, Vector3, World


class LossFate(StrEnum):
    """The fate of a quantity that a spec states and a file of the format does not."""

    LEFT_OUT = "left out"
    """It is not in the files."""
    APPROXIMATED = "approximated"
    """Something else stands in the files, nearly the same."""
    ALONGSIDE = "beside"
    """It stands in an additional file of simspec, which no tool reads."""
    PLACEHOLDER = "placeholder"
    """The format demands a value where the spec has none; one stands there that never acts."""


FATES: Final[Mapping[Level, LossFate]] = {
    Level.VIA_API: LossFate.ALONGSIDE,
    Level.APPROXIMATE: LossFate.APPROXIMATED,
    Level.OUTSIDE: LossFate.LEFT_OUT,
    Level.UNSUPPORTED: LossFate.LEFT_OUT,
}
"""The fate of a feature that a format has at this level."""


@dataclass(frozen=True, slots=True)
class Loss:
    """One feature that the files do not carry: its name, what happens to it and how, and the places of the spec that use it."""

    feature: str
    fate: LossFate
    how: str
    paths: tuple[str, ...]

    @property
    def of_the_model(self) -> bool:
        """Whether bodies, joints or shapes are not what the spec says; other losses belong to the scene around them."""
        return self.fate in (LossFate.LEFT_OUT, LossFate.APPROXIMATED) and any(
            path.startswith("bodies.") for path in self.paths
        )


@dataclass(frozen=True, slots=True)
class PlainFiles:
    """The files of a world as {relative path: text}, and all that they do not carry of it."""

    files: Mapping[str, str]
    losses: tuple[Loss, ...]


def losses(world: World, table: Table, more: Iterable[Loss] = ()) -> tuple[Loss, ...]:
    """Losses of a world in a format with this table, in the order of the features; then ``more``."""
    lost = []
    for need in needs(world, world.contact.pairs):
        support = table[need.feature].in_world(world)
        if support.level is not Level.EXACT:
            lost.append(Loss(need.feature.value, FATES[support.level], support.how, need.paths))
    return (*lost, *more)


class Format:
    """A language of files. Subclasses are in ``formats/<name>/format.py``."""

    NAME: ClassVar[str]
    SUPPORT: ClassVar[Table]
    """Support of files of the language for each feature, for any reader. ``via_api`` = it stands in an additional file of
    simspec. For plain files; dialects have separate tables."""
    PROFILES: ClassVar[tuple[str, ...]] = ()
    """Names of the ways in which the same plain files can be laid out, the default first."""

    RANGED: ClassVar[tuple[str, ...]] = ()
    """Kinds of joints to which plain files give a range where the world has no limits."""
    DRIVES: ClassVar[bool] = False
    """Whether plain files say a joint's spring and damper and the gains of its controller as one."""

    SINGLE: ClassVar[tuple[str, ...]] = ()
    """Ends of the names of single files that the same plain files can be written as."""

    def single(self, plain: PlainFiles, suffix: str) -> bytes:
        """Plain files as one file of this kind, one of ``SINGLE``."""
        raise NotImplementedError

    def in_profile(self, name: str) -> Format:
        """The format whose plain files are laid out so. Raises SpecError for a name that is not of ``PROFILES``."""
        allowed = ", ".join(self.PROFILES) or f"none: {self.NAME} has one layout"
        raise SpecError([Problem(f"{self.NAME} has no profile {name!r}", allowed=allowed, code="E111")])

    def parts(self, world: World, files: Mapping[str, str]) -> Mapping[str, tuple[Body, ...]]:
        """Those of the plain files of a world that readers load, each with the bodies that it has."""
        return {}

    def closes_loops(self, world: World) -> bool:
        """Whether plain files have joints that close loops."""
        return False

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if hasattr(cls, "SUPPORT"):
            check_total(f"format {cls.NAME}", cls.SUPPORT)

    def write(self, tree: Any) -> dict[str, str]:
        """The files of ``tree``, the format's own tree of plain values (its module ``tree.py``), as {relative path: text}."""
        raise NotImplementedError

    def read(self, folder: Path) -> Any:
        """The format's own document (its module ``document.py``) of the files in ``folder``, by a parser that is neither the
        writer's nor an engine's. Raises ValueError, which names the place, for what is not of the language."""
        raise NotImplementedError

    def plain(self, world: World) -> PlainFiles:
        """``world`` in plain files for any tool, with all that they do not carry. Raises UnsupportedError where this format
        does not write plain files."""
        raise UnsupportedError(
            [Problem(f"{self.NAME} does not support plain files yet", hint="simspec compile --engine", code="E111")]
        )


def _sound(name: str, kind: Any) -> Format:
    """The format, if it is one that can be used. Raises TypeError, ValueError."""
    if not (isinstance(kind, type) and issubclass(kind, Format)):
        raise TypeError("it is not a Format")
    if not hasattr(kind, "NAME") or name != kind.NAME:
        raise ValueError(f"its NAME is {getattr(kind, 'NAME', None)!r}")
    return kind()


@functools.cache
def formats() -> Plugins[Format]:
    """Every installed format by name (entry points ``simspec.formats``)."""
    return Plugins("simspec.formats", _sound)


# --- normalisations before a template prints; plain floats and no LAPACK: the same bytes on every machine ---


MOST_FACTORS: Final = 1000
"""Lengths that are tried for an axis; of 20,000 axes drawn at random none needed more than 363."""


def readable(axis: Vector3) -> Vector3:
    """The axis, as long as it must be to read back to the same doubles: its reader makes it a unit vector again, which
    changes some unit vectors."""
    for factor in range(1, MOST_FACTORS):
        written: Vector3 = (axis[0] * factor, axis[1] * factor, axis[2] * factor)
        if direction(written) == axis:
            return written
    return axis


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return (x, y, z)


def _quaternion(values: Sequence[float]) -> Quaternion:
    w, x, y, z = values
    return (w, x, y, z)


def recentre_free_roots(world: World) -> tuple[World, dict[str, Vector3]]:
    """Put every free root's frame at its centre of mass, after gathering inertias (:func:`gathered`).

    Returns the world with moved frames, and for each moved body the position of the new frame in the old one (its
    centre of mass). Axes stay parallel. Shapes, children and the initial state move along, so that the world is
    physically the same. Why: engines integrate the frame of a free root or its centre of mass; only when both are one
    point do all of them do the same (see ``world/kinematics.py``).
    """
    world = gathered(world)
    offsets = {
        body.name: body.inertial.centre_of_mass
        for body in world.bodies
        if body.joint.kind == "free" and any(body.inertial.centre_of_mass)
    }
    if not offsets:
        return world, {}

    def moved(pose: Pose, offset: Vector3) -> Pose:
        return dataclasses.replace(pose, position=frames.subtract(pose.position, offset))

    bodies = []
    for body in world.bodies:
        joint = body.joint
        if joint.parent in offsets:
            body = dataclasses.replace(
                body, joint=dataclasses.replace(joint, origin=moved(joint.origin, offsets[joint.parent]))
            )
        if body.name in offsets:
            offset = offsets[body.name]
            lever = frames.rotate(_quaternion(joint.position[3:7]), offset)
            linear = frames.add(_vector(joint.velocity[:3]), frames.cross(_vector(joint.velocity[3:]), lever))
            body = dataclasses.replace(
                body,
                inertial=dataclasses.replace(body.inertial, centre_of_mass=(0.0, 0.0, 0.0)),
                shapes=tuple(dataclasses.replace(shape, pose=moved(shape.pose, offset)) for shape in body.shapes),
                joint=dataclasses.replace(
                    joint,
                    position=(*frames.add(_vector(joint.position[:3]), lever), *joint.position[3:7]),
                    velocity=(*linear, *joint.velocity[3:]),
                ),
            )
        bodies.append(body)
    return dataclasses.replace(world, bodies=tuple(bodies)), offsets


def restore_free_root(body: Body, offset: Vector3) -> Body:
    """Move a read-back body from the file's frame (at ``offset`` in the world's body frame) back to the world's frame."""
    return dataclasses.replace(
        body,
        inertial=dataclasses.replace(body.inertial, centre_of_mass=frames.add(body.inertial.centre_of_mass, offset)),
        shapes=tuple(
            dataclasses.replace(
                shape, pose=dataclasses.replace(shape.pose, position=frames.add(shape.pose.position, offset))
            )
            for shape in body.shapes
        ),
    )


def restore_frames(bodies: tuple[Body, ...], offsets: dict[str, Vector3]) -> tuple[Body, ...]:
    """Undo :func:`recentre_free_roots` on a read-back: bodies, their shapes, and the origins of their children.

    The initial state (``joint.position``, ``joint.velocity``) of free roots is moved back too where it is present.
    """
    restored = []
    for body in bodies:
        joint = body.joint
        if joint.parent in offsets:
            origin = dataclasses.replace(
                joint.origin, position=frames.add(joint.origin.position, offsets[joint.parent])
            )
            body = dataclasses.replace(body, joint=dataclasses.replace(joint, origin=origin))
        if body.name in offsets:
            body = restore_free_root(body, offsets[body.name])
            if joint.kind == "free" and joint.position:
                lever = frames.rotate(_quaternion(joint.position[3:7]), offsets[body.name])
                position = (*frames.subtract(_vector(joint.position[:3]), lever), *joint.position[3:7])
                velocity = joint.velocity
                if velocity:
                    linear = frames.subtract(_vector(velocity[:3]), frames.cross(_vector(velocity[3:]), lever))
                    velocity = (*linear, *velocity[3:])
                body = dataclasses.replace(body, joint=dataclasses.replace(joint, position=position, velocity=velocity))
        restored.append(body)
    return tuple(restored)


def tensor(moments: Vector3, turn: Quaternion) -> tuple[float, float, float, float, float, float]:
    """The inverse of :func:`simspec.world.inertia.principal_axes`: (xx, yy, zz, xy, xz, yz) from principal moments and their
    axes."""
    return frames.rotate_inertia(turn, (*moments, 0.0, 0.0, 0.0))
