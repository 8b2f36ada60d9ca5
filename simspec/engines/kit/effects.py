"""What readers are known to do to plain files, as rows of data: the exporter lists them, and tests compare them with readers.

Each row names a quantity of the comparison (``audit/compare.py``) and a case: the bodies of a world for which the reader's
value is another. A case knows the world and the file's format, no reader.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from simspec.control.native import Drive, drives
from simspec.formats.kit.contract import Format, formats
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world.frames import IDENTITY
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Pose, Shape, World

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
    def still(self) -> set[str]:
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
    return bool(body.inertial.mass) and body.name not in exported.still


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


def _driven(exported: Exported, body: Body) -> Drive | None:
    return next((drive for drive in drives(exported.world) if drive.joint == body.joint.name), None)


def _static_tree(exported: Exported, body: Body) -> bool:
    """Whether a body is the root of a tree that cannot move, whose joint to the world is not in the file."""
    joint = body.joint
    tree = {one.name for one in exported.bodies if one.model == body.model}
    return _fixed_root(body) and tree <= exported.still and joint.name == f"{body.name}_joint"


def _plane_and_many(exported: Exported) -> bool:
    """Whether a file has a plane, and ``MANY`` shapes or more of bodies that move."""
    still = exported.still
    moving = sum(len(_solids(body)) for body in exported.bodies if body.name not in still)
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
        lambda exported, body: not body.shapes and body.inertial.mass != 1.0 and body.name not in exported.still
    ),
    "no shape, centre elsewhere": _bodies(
        lambda exported, body: (
            not body.shapes and any(body.inertial.centre_of_mass) and body.name not in exported.still
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
            one.name == body.joint.parent and _fixed_root(one) and one.joint.origin != Pose() for one in exported.bodies
        )
    ),
    "several trees": _file(lambda exported: sum(body.joint.parent is None for body in exported.bodies) > 1),
}
"""Which bodies, or whether the file, by names that say it."""
