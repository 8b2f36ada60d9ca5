"""Treatment of plain files by readers: foreseen by rules, without any of them, and found by loading the files in them.

A difference is a quantity of an element, such as ``mass`` of ``imu`` or ``gravity`` of the file. A loss of the format itself
not carry (its own losses) is no difference of a reader.
"""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from simspec.audit import AuditFinding, FindingSeverity, What
from simspec.audit.compare import FileComparison
from simspec.audit.libraries import LIBRARIES
from simspec.audit.meaning import Meaning, match, parents_first
from simspec.control.reference import drives
from simspec.engines.kit.foreign import FILE, Exported, Reads, foreseen
from simspec.engines.kit.registry import engines
from simspec.formats.kit.contract import Loss, formats
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.kinematics import joint_displacement
from simspec.world.types import VELOCITY_SIZE, Body, Inertial, Pose, ReadBack, World

Difference = tuple[str, str]
"""Quantity and element."""

UNLIMITED: Final = 1e9
"""Limits from here on stand for none: formats demand a number (rad, m, N m, N, rad/s, m/s)."""
SMALLEST_MASS: Final = 1.001e-9
"""kg, of bodies between joints, and of those without mass, in formats that demand one."""
AT_ORIGIN: Final = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
TURNS: Final = 3
"""Configurations in which poses are compared."""
ROUND_OFF: Final = 1e-12
"""s."""
SAME: Final = 1e-6
"""m and rad: readers keep numbers of files with twelve digits or in single precision."""
LOST_BY_FORMAT: Final[Mapping[str, tuple[str, ...]]] = {
    Feature.JOINT_BALL.value: ("joint.type",),
    Feature.BALL_DAMPING.value: ("joint.damping",),
    Feature.BALL_SPRING.value: ("joint.spring_stiffness",),
    Feature.DAMPING.value: ("joint.damping",),
    Feature.FREE_DAMPING.value: ("joint.damping",),
    Feature.ARMATURE.value: ("joint.armature",),
    Feature.BALL_ARMATURE.value: ("joint.armature",),
    Feature.FREE_ARMATURE.value: ("joint.armature",),
    Feature.SPRING.value: ("joint.spring_stiffness",),
    Feature.LIMIT_VELOCITY.value: ("joint.velocity_limit",),
    Feature.LIMIT_EFFORT.value: ("joint.effort_limit",),
    Feature.MASSLESS.value: ("mass", "inertia", "centre_of_mass"),
    Feature.INERTIA_SINGULAR.value: ("inertia",),
    Feature.SHAPE_CAPSULE.value: ("shapes",),
    Feature.SHAPE_ELLIPSOID.value: ("shapes",),
    Feature.SHAPE_PLANE.value: ("shapes",),
    Feature.JOINT_SEVERAL.value: ("mass", "inertia"),
}
"""The quantities of a body that a loss of the format explains."""


@dataclass(frozen=True, slots=True)
class FormatReader:
    """A program or library that reads a format. ``engine``: whether it is one of simspec's."""

    name: str
    title: str
    reads: Reads
    engine: bool

    @property
    def short(self) -> str:
        """Title and version."""
        return f"{self.title} {self.reads.version}"

    @property
    def called(self) -> str:
        """As ``losses.json`` names it: title, version and call."""
        return f"{self.short}: {self.reads.how}"


@dataclass(frozen=True, slots=True)
class ReaderLoss:
    """One thing that a reader does to the files of a world, and to which bodies (empty: to the files as a whole)."""

    reader: FormatReader
    element: str
    what: str
    bodies: tuple[str, ...]


def readers(language: str) -> tuple[FormatReader, ...]:
    """The programs and libraries whose treatment of a format's plain files is known, installed or not."""
    found = [
        FormatReader(name, engine.TITLE or name, engine.FOREIGN[language], True)
        for name, engine in engines().items()
        if language in engine.FOREIGN and engine.FOREIGN[language].version
    ]
    found += [
        FormatReader(name, library.title, library.reads[language], False)
        for name, library in LIBRARIES.items()
        if language in library.reads
    ]
    return tuple(found)


def reader_losses(world: World, language: str, profile: str, files: Mapping[str, str]) -> list[ReaderLoss]:
    """The treatment of the plain files of a world by every known reader, by rule."""
    if not readers(language):
        return []
    parts = [Exported(world, bodies, language) for bodies in formats()[language].parts(world, files).values()]
    losses = []
    for reader in readers(language):
        rows: dict[tuple[str, str], list[str]] = {}
        for part in parts:
            for effect, names in foreseen(reader.reads.effects, part, profile):
                rows.setdefault((effect.quantity, effect.what), []).extend(name for name in names if name != FILE)
        losses += [
            ReaderLoss(reader, element, what, tuple(dict.fromkeys(names))) for (element, what), names in rows.items()
        ]
    return losses


@dataclass(frozen=True, slots=True)
class Foreseen:
    """The differences that rules foresee in a file: those that the comparison finds, and no others, and those that it may find
    (of ``FILE``: of any element). ``elsewhere``: those that it cannot see."""

    exactly: frozenset[Difference]
    may: frozenset[Difference]
    elsewhere: frozenset[Difference]

    def unlike(self, found: Collection[Difference]) -> tuple[set[Difference], set[Difference]]:
        """The differences that were found and not foreseen, and those that were foreseen and not found."""
        allowed = self.exactly | self.may | self.elsewhere
        unforeseen = {entry for entry in found if entry not in allowed and (entry[0], FILE) not in self.may}
        missing = {entry for entry in self.exactly if (entry[0], FILE) not in self.may} - set(found)
        return unforeseen, missing


def foreseen_differences(reader: FormatReader, exported: Exported, profile: str, losses: Iterable[Loss]) -> Foreseen:
    """The differences that the rules foresee for a file in a reader."""
    rows = foreseen(reader.reads.effects, exported, profile)
    pairs = {
        kind: {(effect.quantity, name) for effect, names in rows if effect.seen == kind for name in names}
        for kind in ("exactly", "may", "elsewhere")
    }
    gone = {name for quantity, name in pairs["exactly"] if quantity == "body"}
    exactly = {(quantity, name) for quantity, name in pairs["exactly"] if quantity == "body" or name not in gone}
    lost = _lost_by_format(losses)
    return Foreseen(frozenset(exactly - lost), frozenset(pairs["may"]), frozenset(pairs["elsewhere"]))


def differences(reader: FormatReader, exported: Exported, back: ReadBack, losses: Iterable[Loss]) -> set[Difference]:
    """The differences of a file in a reader from the world, without the losses of the format itself."""
    world, support = exported.world, exported.written.SUPPORT
    back = dataclasses.replace(back, bodies=tuple(map(_without_stand_ins, back.bodies)))
    gravity = world.physics.gravity if support[Feature.GRAVITY].level is Level.EXACT else None
    bodies = tuple(_as_said(exported))
    meaning = Meaning(Path(), exported.language, bodies=bodies, gravity=gravity)
    extras = engines()[reader.name].FOREIGN_ADDITIONS if reader.engine else {}
    comparison = FileComparison(reader.name, meaning, back, extras).run()
    found = {difference for finding in comparison.findings if (difference := _difference(finding)) is not None}
    carried = support[Feature.TIMESTEP].level is Level.EXACT
    if carried and back.timestep and abs(back.timestep - world.physics.timestep) > ROUND_OFF:
        found.add(("timestep", FILE))
    found -= _lost_by_format(losses)
    ours = match(bodies, back.bodies).partners
    changed = {element for quantity, element in found if quantity.startswith(("joint.type", "joint.origin", "body"))}
    return found | _displaced(bodies, back.bodies, ours, changed)


def _as_said(exported: Exported) -> Iterator[Body]:
    """The bodies as the format says them: a free root stands at the origin where another file says its place, a drive has the
    joint's spring and damper and the gains of its controller together."""
    drive_of = {drive.joint: drive for drive in drives(exported.world)} if exported.written.DRIVES else {}
    elsewhere = exported.written.SUPPORT[Feature.JOINT_FREE].level is not Level.EXACT
    for body in exported.bodies:
        joint = body.joint
        if elsewhere and joint.kind == "free":
            joint = dataclasses.replace(joint, position=AT_ORIGIN)
        drive = drive_of.get(joint.name)
        if drive is not None and drive.effort_limit != 0:
            stiffness = joint.spring_stiffness + drive.kp
            effort = joint.spring_stiffness * joint.spring_rest + drive.kp * drive.position + drive.effort
            rest = effort / stiffness if stiffness else joint.spring_rest
            joint = dataclasses.replace(
                joint, spring_stiffness=stiffness, damping=joint.damping + drive.kd, spring_rest=rest
            )
        yield dataclasses.replace(body, joint=joint)


def _without_stand_ins(body: Body) -> Body:
    """A body without the limits and the mass that formats demand where a world has none."""
    joint, ends = body.joint, body.joint.position_limits
    free = ends is not None and max(map(abs, ends)) >= UNLIMITED
    none = dataclasses.replace(
        joint,
        position_limits=None if free else ends,
        velocity_limit=_rating(joint.velocity_limit),
        effort_limit=_rating(joint.effort_limit),
    )
    inertial = body.inertial if body.inertial.mass > SMALLEST_MASS else Inertial(0.0)
    return dataclasses.replace(body, joint=none, inertial=inertial)


def _rating(value: float | None) -> float | None:
    return None if value is None or value >= UNLIMITED else value


def _difference(finding: AuditFinding) -> Difference | None:
    """The difference of a finding of the comparison; None for another form of the same model, and for values that files leave
    open."""
    quantity = finding.quantity
    if finding.what is What.MERGED:
        return (
            ("joint.type", finding.element) if finding.severity is not FindingSeverity.INFORMATION else None
        )  # a free root
    if quantity == "body" and finding.what is What.ADDED:
        mass = finding.engine_value.split()[0]
        return ("mass", finding.element) if mass[0].isdigit() and float(mass) > SMALLEST_MASS else None
    if quantity.startswith("joint.origin"):
        quantity = "joint.origin.xyz"
    if quantity == "joint":
        quantity = "body"
    wanted = finding.severity in (FindingSeverity.PHYSICS, FindingSeverity.RATING) or quantity == "joint.type"
    return (quantity, finding.element) if wanted else None


def _lost_by_format(losses: Iterable[Loss]) -> set[Difference]:
    lost = set()
    for loss in losses:
        for quantity in LOST_BY_FORMAT.get(loss.feature, ()):
            lost |= {(quantity, path.split(".")[1]) for path in loss.paths if path.startswith("bodies.")}
    return lost


def _displaced(
    bodies: Sequence[Body], actual: Sequence[Body], ours: Mapping[str, Body], changed: Collection[str]
) -> set[Difference]:
    """Bodies that stand elsewhere in some of a few configurations, drawn by a seed. A body that stands on one whose joint is
    another (``changed``) is not compared."""
    found: set[Difference] = set()
    draw = random.Random(7)
    for _ in range(TURNS):
        angles = {body.name: draw.uniform(-1.0, 1.0) for body in bodies if body.joint.kind in SCALAR_JOINTS}
        mine, compared = _places(bodies, angles), _as_written(bodies, changed)
        called = {partner.name: name for name, partner in ours.items()}
        theirs = _places(actual, {entry: angles[name] for entry, name in called.items() if name in angles})
        for name in compared:
            if name not in ours:
                continue
            here, there = mine[name], theirs[ours[name].name]
            turn = frames.multiply(frames.conjugate(here.quaternion), there.quaternion)
            if math.dist(here.position, there.position) > SAME or 2.0 * math.hypot(*turn[1:]) > 2.0 * SAME:
                found.add(("pose", name))
    return found


def _as_written(bodies: Sequence[Body], changed: Collection[str]) -> list[str]:
    left: set[str] = set(changed)
    for body in parents_first(bodies):
        if body.joint.parent in left or body.joint.kind == "ball":
            left.add(body.name)
    return [body.name for body in bodies if body.name not in left and _root_is_placed(body, bodies)]


def _root_is_placed(body: Body, bodies: Sequence[Body]) -> bool:
    """Whether the file says where the root of a body's tree stands: of a free one not in every format."""
    by_name = {body.name: body for body in bodies}
    while body.joint.parent is not None:
        body = by_name[body.joint.parent]
    return body.joint.kind != "free"


def _places(bodies: Sequence[Body], angles: Mapping[str, float]) -> dict[str, Pose]:
    placed: dict[str, Pose] = {}
    for body in parents_first(bodies):
        joint = body.joint
        start = joint.origin if joint.parent is None else frames.compose(placed[joint.parent], joint.origin)
        if joint.kind in SCALAR_JOINTS:
            start = frames.compose(start, joint_displacement(body, (angles.get(body.name, 0.0),)))
        placed[body.name] = start
    return placed


def freedoms(bodies: Iterable[Body]) -> int:
    """How many degrees of freedom bodies have together."""
    return sum(VELOCITY_SIZE.get(body.joint.kind, 0) for body in bodies)
