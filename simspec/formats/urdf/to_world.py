"""What URDF means, in the world's types: frames, inertias, shapes of the language. For everybody who reads a document.

What is absent has the value that the language gives it: no turn, no way, the axis x.
"""

from __future__ import annotations

from simspec.formats.urdf.document import Inertial, Node, Origin, Shape
from simspec.world import frames
from simspec.world.types import Inertial as WorldInertial
from simspec.world.types import Pose, Vector3

DEFAULT_AXIS: Vector3 = (1.0, 0.0, 0.0)


def pose_of(origin: Origin | None) -> Pose:
    """An origin as a pose."""
    if origin is None:
        return Pose()
    return Pose(origin.xyz or (0.0, 0.0, 0.0), frames.from_rpy(*(origin.rpy or (0.0, 0.0, 0.0))))


def inertial_of(inertial: Inertial | None) -> WorldInertial:
    """Mass, centre of mass, and the tensor turned into the link's axes. A link without one has no mass."""
    if inertial is None:
        return WorldInertial(0.0)
    pose = pose_of(inertial.origin)
    tensor = tuple(value or 0.0 for value in inertial.inertia)
    return WorldInertial(inertial.mass, pose.position, frames.turn_inertia(pose.quaternion, tensor))


def named(shape: Shape) -> str:
    """The name of a shape. Raises ValueError where it has none."""
    return shape.node.word("name")


def size_of(geometry: Node) -> tuple[str, tuple[float, ...]]:
    """The kind and size of a geometry of the language, but a mesh. Raises ValueError for others."""
    if geometry.tag == "box":
        geometry.word("size")
        return "box", geometry.numbers("size", 3) or ()
    if geometry.tag == "sphere":
        return "sphere", (geometry.need_number("radius"),)
    if geometry.tag == "cylinder":
        return "cylinder", (geometry.need_number("radius"), geometry.need_number("length"))
    raise geometry.error(f"a <{geometry.tag[:60]}> is not read here")
