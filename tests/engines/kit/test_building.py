"""The walk over a document that engines are built from."""

from __future__ import annotations

import pytest

from simspec.engines.kit.building import STATIC, Walk, refuse
from simspec.errors import EngineError
from simspec.formats.world import (
    AxisJoint,
    Excluded,
    FixedJoint,
    FreeJoint,
    Joint,
    JsonBody,
    JsonServo,
    JsonShape,
    JsonWorld,
    ShapeCopy,
)
from simspec.world.types import Pose

AT = Pose((1.0, 0.0, 0.0))
FREE = FreeJoint(name="f", position=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)


def _copy(layer: int) -> ShapeCopy:
    return ShapeCopy(layer, 0.5, 0.0, 0.0, 0.0)


def _shape(name: str, *layers: int, kind: str = "sphere", material: str = "m") -> JsonShape:
    return JsonShape(name, kind, (0.1,), AT, material, None, tuple(_copy(layer) for layer in layers))


def _body(name: str, joint: Joint, *shapes: JsonShape, group: str = "g", mass: float = 0.0) -> JsonBody:
    return JsonBody(name, "", group, mass, (0.0, 0.0, 0.0), (0.0,) * 6, joint, shapes)


def _hinge(parent: str | None, servo: JsonServo | None = None) -> AxisJoint:
    numbers = dict.fromkeys(("damping", "spring_stiffness", "spring_rest", "dry_friction", "armature"), 0.0)
    limits = dict.fromkeys(("position_limits", "velocity_limit", "effort_limit"))
    return AxisJoint(
        name="h", kind="hinge", parent=parent, origin=AT, axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,), servo=servo,
        **numbers, **limits,  # type: ignore[arg-type]
    )  # fmt: skip


def _document(*bodies: JsonBody) -> JsonWorld:
    return JsonWorld(
        gravity=(0.0, 0.0, -9.81),
        timestep=1e-3,
        friction_cone="elliptic",
        bodies=bodies,
        meets=(("m", "m", 0), ("m", "n", 1)),
        excluded=Excluded((("c", "a"),), (("g", "ignored"),)),
    )


DOCUMENT = _document(
    _body("a", FixedJoint(name="", parent=None, origin=AT), _shape("s", 0, 1)),
    _body("b", FREE, _shape("seen"), _shape("t", 1, material="n")),
    _body("c", FixedJoint(name="", parent="b", origin=AT), _shape("u", 0), group="ignored"),
    _body("d", _hinge("c")),
)


def test_bodies_are_placed_in_the_bodies_that_move_them() -> None:
    walk = Walk.of(DOCUMENT)
    assert [body.carrier for body in walk.bodies] == [STATIC, 1, 1, 3]
    assert [body.parent for body in walk.bodies] == [STATIC, STATIC, 1, 2]
    assert [body.pose.position[0] for body in walk.bodies] == [1.0, 0.0, 1.0, 0.0]
    assert walk.trees == {0: [0], 1: [1, 2, 3]}
    assert walk.excluded == ((0, 2),)
    assert walk.excluded_keys().tolist() == [2]


def test_shapes_and_their_copies_are_numbered() -> None:
    walk = Walk.of(DOCUMENT)
    assert [(s.number, s.place, s.shape.name, s.pose.position[0]) for s in walk.shapes] == [
        (0, 0, "s", 1.0),
        (1, 1, "t", 1.0),
        (2, 0, "u", 2.0),
    ]
    assert [(unit.of.number, unit.copy.layer) for unit in walk.units] == [(0, 0), (0, 1), (1, 1), (2, 0)]
    zero, entry, other, ignored = walk.kinds
    pairs = ((zero, zero), (entry, other), (entry, entry), (zero, other), (zero, ignored))
    assert [walk.meet(*pair) for pair in pairs] == [True, True, False, False, False]


@pytest.mark.parametrize(
    ("body", "accepted", "why"),
    [
        (_body("a", FREE), {"cones": ("pyramid",)}, "the friction cone elliptic"),
        (_body("a", _hinge(None)), {"joints": ("free",)}, "does not support the hinge 'h'$"),
        (
            _body("a", _hinge(None, JsonServo(1.0, 0.0, None))),
            {"joints": ("free",)},
            "the hinge 'h' and its controller",
        ),
        (_body("a", _hinge(None, JsonServo(1.0, 0.0, None))), {"servos": False}, "has no controller of its own"),
        (_body("a", FREE, _shape("s", 0)), {"shapes": ("box",)}, "does not support the sphere 's'"),
        (
            _body("a", FREE, _shape("s", 0, kind="plane")),
            {"moving_planes": False},
            "the plane 's' on a body that moves",
        ),
    ],
)
def test_unsupported_parts_are_refused(body: JsonBody, accepted: dict[str, bool], why: str) -> None:
    walk = Walk.of(_document(body, _body("c", FREE)))
    refuse(walk, "engine")
    with pytest.raises(EngineError, match=why):
        refuse(walk, "engine", **accepted)  # type: ignore[arg-type]


def test_carried_mass_is_refused() -> None:
    walk = Walk.of(_document(_body("a", FREE), _body("c", FixedJoint(name="", parent="a", origin=AT), mass=1.0)))
    with pytest.raises(EngineError, match="the mass of 'c', which is fixed to a body that moves"):
        refuse(walk, "engine", carried_mass=False)
