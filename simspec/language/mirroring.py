"""Mirrored models: the plain data of a model, seen in a mirror.

A mirror is a ``Flip`` S = diag(±1, ±1, ±1) of the model's frame, of several mirrors the product. Every frame of the model, of
the rotation R and the origin p, becomes the frame S R S at S p: right-handed again, and the mirrored model is S times the
model wherever all joints have the same coordinates. So

- places and directions (positions, velocities, forces, axes of slides) are S v;
- pseudo-vectors (angular velocities, axes of hinges, rotations) are det(S) S v: a mirrored hinge that is turned by q turns
  the other way round about the mirror image of its axis;
- scalars of joints (positions, limits, gains, efforts) are as they are.

Data are plain, as they are written: signs change, nothing is computed. A value that is wrong stays as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from simspec.language import problems
from simspec.language.document import Document, Key, listed, mapping
from simspec.language.quantities import Number
from simspec.language.shapes import AXES, Shape
from simspec.language.strict import Faults

Flip = tuple[int, int, int]
"""The signs of x, y and z."""
SAME: Flip = (1, 1, 1)
PARTS = ("bodies", "frames", "grasps", "actuators", "constraints", "states")
"""The parts of a model, which a mirror changes."""


def flip_of(axis: Any) -> Flip:
    """The mirror through the plane where the coordinate of ``axis`` is 0; none for what is no axis."""
    x, y, z = (-1 if axis == name else 1 for name in AXES)
    return (x, y, z)


def together(first: Flip, second: Flip) -> Flip:
    """Both mirrors."""
    return (first[0] * second[0], first[1] * second[1], first[2] * second[2])


def determinant(flip: Flip) -> int:
    """−1 for a mirror, 1 for a turn by half a revolution, which two mirrors are."""
    return flip[0] * flip[1] * flip[2]


def mirrored(data: Mapping[str, Any], kind: Any, flip: Flip) -> dict[str, Any]:
    """The plain data of a model of the language (``Model`` or ``Use``), with its parts mirrored."""
    fields = problems.fields(kind)
    return {key: _below(fields[key], value, flip) if key in PARTS else value for key, value in data.items()}


def not_mirrored(document: Document, path: tuple[Key, ...]) -> Iterator[tuple[Key, ...]]:
    """The places of what no mirror can change exactly, in the bodies at ``path``: the two triangles of each cell of a height
    field meet along one of its diagonals, and would along the other one."""
    for name, body in mapping(document.at(*path)).items():
        for index, shape in enumerate(listed(mapping(body).get("shapes"))):
            if mapping(shape).get("heightfield") is not None:
                yield (*path, name, "shapes", index, "heightfield")


def _below(kind: Any, value: Any, flip: Flip) -> Any:
    if isinstance(kind, problems.Free) and isinstance(value, Mapping):
        return {key: _below(kind.item, item, flip) for key, item in value.items()}
    if isinstance(kind, list) and isinstance(value, (list, tuple)):
        return [_below(kind[0], item, flip) for item in value]
    if not problems.is_model(kind) or not isinstance(value, Mapping):
        return value
    if kind.__name__ == "Shape":
        return _shape(value, flip)
    table, fields = RULES.get(kind.__name__, {}), problems.fields(kind)
    changed = {
        key: table[key](item, flip) if key in table else _below(fields.get(key), item, flip)
        for key, item in value.items()
    }
    if kind.__name__ == "Joint" and "axis" in value:
        changed["axis"] = (polar if value.get("type") == "slide" else axial)(value["axis"], flip)
    elif kind.__name__ == "Mesh":
        changed["scale"] = _scale(value.get("scale", 1.0), flip)
    return changed


def negative(value: Any) -> Any:
    """A quantity with the other sign, as it is written."""
    if isinstance(value, bool) or value == 0:
        return value
    if isinstance(value, (int, float)):
        return -value
    if not isinstance(value, str) or not value.strip():
        return value
    text = value.strip()
    if text[0] in "-−":
        return text[1:].lstrip()
    return f"-{text.removeprefix('+').lstrip()}"


def _signed(value: Any, signs: tuple[int, ...]) -> Any:
    if hasattr(value, "tolist"):  # an array of numpy
        value = value.tolist()
    if not isinstance(value, (list, tuple)) or len(value) != len(signs):
        return value
    return [negative(item) if sign < 0 else item for item, sign in zip(value, signs, strict=True)]


def polar(value: Any, flip: Flip) -> Any:
    """A place or a direction: S v."""
    return _signed(value, flip)


def axial(value: Any, flip: Flip) -> Any:
    """A pseudo-vector, of a rotation: det(S) S v; also roll, pitch and yaw, each a turn about an axis."""
    return _signed(value, _turned(flip))


def _turned(flip: Flip) -> Flip:
    det = determinant(flip)
    return (det * flip[0], det * flip[1], det * flip[2])


def rotation(value: Any, flip: Flip) -> Any:
    """A quaternion w x y z of S R S."""
    return _signed(value, (1, *_turned(flip)))


def _scale(value: Any, flip: Flip) -> Any:
    return polar(value if isinstance(value, (list, tuple)) or hasattr(value, "tolist") else [value] * 3, flip)


def _of_ball(value: Any, flip: Flip) -> Any:
    """The position or the velocity of a joint, which is a scalar unless the joint is a ball."""
    if isinstance(value, Mapping):
        return {key: ORIENTATION[key](item, flip) if key in ORIENTATION else item for key, item in value.items()}
    return axial(value, flip)


def _of_balls(value: Any, flip: Flip) -> Any:
    """Such values by joint."""
    if not isinstance(value, Mapping):
        return value
    return {name: _of_ball(item, flip) for name, item in value.items()}


def _product(first: int, second: int) -> Rule:
    """A product of inertia: of S I S."""
    return lambda value, flip: negative(value) if flip[first] * flip[second] < 0 else value


Rule = Callable[[Any, Flip], Any]
ORIENTATION: Mapping[str, Rule] = {"rpy": axial, "quat": rotation}
RULES: Mapping[str, Mapping[str, Rule]] = {
    "Pose": {"xyz": polar, **ORIENTATION},
    "Orientation": ORIENTATION,
    "Velocity": {"linear": polar, "angular": axial},
    "SurfaceVelocity": {"linear": polar, "angular": axial},
    "Body": {"centre_of_mass": polar},
    "Inertia": ORIENTATION,
    "Tensor": {"xy": _product(0, 1), "xz": _product(0, 2), "yz": _product(1, 2)},
    "Joint": {"position": _of_ball, "velocity": _of_ball},
    "State": {"positions": _of_balls, "velocities": _of_balls},
    "Connect": {"at": polar, "second_at": polar},
    "GraspForce": {"at": polar, "force": polar},
}
"""How a mirror changes the fields of the language's models, by their names. Other fields stay as they are, or are models
themselves; axes of joints, scales of meshes and planes are above."""


def _shape(shape: Mapping[str, Any], flip: Flip) -> dict[str, Any]:
    """A shape: its frame is S R S at S p, in which a solid that is its own mirror image stays as it is, and a mesh is scaled by
    S. A plane is solid on one side: mirrored in z, its frame is turned by half a revolution about x as well."""
    fields = problems.fields(Shape)
    changed = {key: _below(fields.get(key), value, flip) for key, value in shape.items()}
    if "plane" in shape and flip[2] < 0:
        changed["pose"] = _upside_down(mapping(changed.get("pose")))
        moving = changed.get("surface_velocity")
        if isinstance(moving, Mapping):
            changed["surface_velocity"] = {key: _signed(value, (1, -1, -1)) for key, value in moving.items()}
    return changed


def _upside_down(pose: Mapping[str, Any]) -> dict[str, Any]:
    """A pose whose frame is turned by half a revolution about its x axis."""
    quat, rpy = pose.get("quat"), pose.get("rpy")
    if isinstance(quat, (list, tuple)) and len(quat) == 4:
        w, x, y, z = quat
        return {**pose, "quat": [negative(x), w, z, negative(y)]}
    roll, pitch, yaw = rpy if isinstance(rpy, (list, tuple)) and len(rpy) == 3 else (0.0, 0.0, 0.0)
    try:
        return {**pose, "rpy": [Number("angle").read(roll) + math.pi, pitch, yaw]}
    except Faults:
        return dict(pose)  # reported where it is read
