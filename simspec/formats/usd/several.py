"""Bodies with several joints as one joint of several axes: which of them one ``PhysicsJoint`` says, and along which axes.

UsdPhysics gives a joint axes X, Y and Z to slide along and to turn about, and no order. Readers take slides before turns, and
turns in the order X, Y, Z: a frame is chosen in which a body's joints stand in that order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from simspec.world import frames
from simspec.world.frames import Matrix3
from simspec.world.kinematics import is_carrier
from simspec.world.types import Body, Joint, Pose, Quaternion, Vector3, World

LETTERS: Final = "XYZ"
SQUARE: Final = 1e-12
"""Largest cosine between axes at right angles, which were normalised."""


@dataclass(frozen=True, slots=True)
class Several:
    """A body whose joints are one joint in the file.

    ``bodies``: what carries each joint but the last, then the body itself; ``words``: the axis of each joint (``transX``,
    ``rotZ``; "rot" for a ball); ``turn``: the axes X, Y, Z in the body's frame.
    """

    bodies: tuple[Body, ...]
    words: tuple[str, ...]
    turn: Quaternion

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints, from the parent on."""
        return tuple(body.joint for body in self.bodies)

    @property
    def parent(self) -> str | None:
        """The body that the first joint is fixed on."""
        return self.bodies[0].joint.parent


def several(world: World) -> dict[str, Several]:
    """The bodies whose joints are one joint in the file, by their names. Those of other bodies stay apart."""
    by_name = {body.name: body for body in world.bodies}
    found = {}
    for body in world.bodies:
        if is_carrier(body.name):
            continue
        chain = [body]
        while (above := chain[0].joint.parent) is not None and is_carrier(above):
            chain.insert(0, by_name[above])
        if len(chain) > 1 and (one := _one_joint(tuple(chain))) is not None:
            found[body.name] = one
    return found


def carriers(chains: dict[str, Several]) -> set[str]:
    """The bodies between joints that are not in the file."""
    return {body.name for chain in chains.values() for body in chain.bodies[:-1]}


def apart(world: World) -> list[str]:
    """The bodies between joints that are in the file, since one joint does not say the joints around them."""
    left_out = carriers(several(world))
    return [body.name for body in world.bodies if is_carrier(body.name) and body.name not in left_out]


def _one_joint(chain: tuple[Body, ...]) -> Several | None:
    """The joints of a body as one; None where they are not at one place, at right angles, slides before turns."""
    joints = [body.joint for body in chain]
    if any(joint.origin != Pose() for joint in joints[1:]) or any(body.inertial.mass for body in chain[:-1]):
        return None
    slides = [joint for joint in joints if joint.kind == "slide"]
    turns = joints[len(slides) :]
    if any(joint.kind != "slide" for joint in joints[: len(slides)]):
        return None
    ball = len(turns) == 1 and turns[0].kind == "ball"
    if ball and (turns[0].damping or turns[0].spring_stiffness or turns[0].armature):
        return None
    if not ball and any(joint.kind != "hinge" for joint in turns):
        return None
    axes = _frame([joint.axis for joint in slides], [] if ball else [joint.axis for joint in turns])
    if axes is None:
        return None
    words = [f"trans{_letter(joint.axis, axes)}" for joint in slides]
    words += ["rot"] if ball else [f"rot{_letter(joint.axis, axes)}" for joint in turns]
    if words != sorted(words, key=lambda word: (word.startswith("rot"), word)):
        return None
    x, y, z = axes
    columns: Matrix3 = ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]))
    turn = frames.IDENTITY if list(axes) == UNITS else frames.from_matrix(columns)
    return Several(chain, tuple(words), turn)


UNITS: Final[list[Vector3]] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def _frame(slides: list[Vector3], turns: list[Vector3]) -> tuple[Vector3, Vector3, Vector3] | None:
    """Right-handed axes among which all of these are, in the order of the slides and of the turns; None where none are."""
    for rows in (slides, turns):
        for index, one in enumerate(rows):
            if any(abs(frames.dot(one, other)) > SQUARE for other in rows[:index]):
                return None
    kept: list[Vector3] = list(turns)
    for axis in slides:
        near = [frames.dot(axis, other) for other in kept]
        if any(abs(one - 1.0) <= SQUARE for one in near):
            continue
        if any(abs(one) > SQUARE for one in near):
            return None
        kept.append(axis)
    if len(kept) > 3:
        return None
    if all(axis in UNITS for axis in kept):
        chosen = UNITS
        if _sorted(slides, chosen) and _sorted(turns, chosen):
            return (chosen[0], chosen[1], chosen[2])
    for order in _orders(kept):
        if _sorted(slides, order) and _sorted(turns, order):
            return (order[0], order[1], order[2])
    return None


def _orders(kept: list[Vector3]) -> list[list[Vector3]]:
    """Right-handed frames of up to three axes, in each order."""
    if len(kept) == 1:
        x = kept[0]
        across = min(UNITS, key=lambda unit: abs(frames.dot(unit, x)))
        y = _unit(frames.cross(across, x))
        kept = [x, y]
    if len(kept) == 2:
        x, y = kept
        z = _unit(frames.cross(x, y))
        w = (0.0 - z[0], 0.0 - z[1], 0.0 - z[2])
        return [[x, y, z], [y, z, x], [z, x, y], [y, x, w], [x, w, y], [w, y, x]]
    x, y, z = kept
    if frames.dot(frames.cross(x, y), z) > 0.0:
        return [[x, y, z], [y, z, x], [z, x, y]]
    return [[y, x, z], [x, z, y], [z, y, x]]


def _unit(vector: Vector3) -> Vector3:
    size = frames.dot(vector, vector) ** 0.5
    return (vector[0] / size, vector[1] / size, vector[2] / size)


def _sorted(rows: list[Vector3], axes: list[Vector3]) -> bool:
    """Whether axes are among those of a frame, in its order."""
    places = [next((k for k in range(3) if abs(frames.dot(row, axes[k]) - 1.0) <= SQUARE), -1) for row in rows]
    return -1 not in places and places == sorted(places)


def _letter(axis: Vector3, axes: tuple[Vector3, Vector3, Vector3]) -> str:
    return next(LETTERS[k] for k in range(3) if abs(frames.dot(axis, axes[k]) - 1.0) <= SQUARE)
