"""``world.json`` as a language of its own: written, read again, and refused with the place where it does not fit together."""

from __future__ import annotations

import copy
import json
import re

import pytest

from simspec.formats.world import (
    WORLD,
    AxisJoint,
    BallJoint,
    Excluded,
    FixedJoint,
    FreeJoint,
    JsonBody,
    JsonShape,
    JsonWorld,
    ShapeCopy,
    WorldJson,
    parent_of,
    state_of,
)
from simspec.world.types import Hardness, Pose
from tests.files import setting

TURN = (0.6, 0.8, 0.0, 0.0)
RED = (1.0, 0.0, 0.0, 1.0)
INERTIA = (0.1, 0.2, 0.3, 0.0, 0.01, 0.0)


def _body(name, joint, *shapes, group="default"):
    return JsonBody(name, "robot", group, 1.5, (0.0, 0.1, 0.0), INERTIA, joint, shapes)


def _ball(name, *copies, colour=RED):
    return JsonShape(name, "sphere", (0.1,), Pose((0.0, 0.0, 1e-17), TURN), "ice" if copies else "", colour, copies)


SOFT = Hardness("stiffness", 0.0, 0.0, 1e5, 30.0)
DOCUMENT = JsonWorld(
    gravity=(0.0, 0.0, -9.81),
    timestep=0.001,
    friction_cone="elliptic",
    bodies=(
        _body(
            "base",
            FixedJoint(name="j0", parent=None, origin=Pose()),
            _ball("base_0", ShapeCopy(0, 0.5, 0.0, 0.0, 0.1), ShapeCopy(2, 0.25, 0.01, 0.02, 0.0, SOFT)),
        ),
        _body(
            "arm",
            AxisJoint(
                name="j1",
                kind="hinge",
                parent="base",
                origin=Pose((1.0, 0.0, 0.0), TURN),
                axis=(0.0, 0.6, 0.8),
                position_limits=(-1.0, 1.0),
                velocity_limit=None,
                effort_limit=12.0,
                damping=0.1,
                spring_stiffness=3.0,
                spring_rest=-0.2,
                dry_friction=0.0,
                armature=0.05,
                position=(0.3,),
                velocity=(-0.1,),
            ),
            _ball("arm_0"),
            group="arm",
        ),
        _body(
            "bob",
            BallJoint(
                name="j2",
                parent="arm",
                origin=Pose(),
                damping=0.0,
                spring_stiffness=1.0,
                position=TURN,
                velocity=(0.0, 1.0, 2.0),
            ),
        ),
        _body(
            "stone",
            FreeJoint(name="j3", position=(1.0, 2.0, 3.0, *TURN), velocity=(0.0, 0.1, 0.2, 0.3, 0.4, 0.5)),
            _ball("stone_0", ShapeCopy(0, 0.5, 0.0, 0.0, 0.0), colour=None),
            group="stones",
        ),
    ),
    meets=(("ice", "ice", 0),),
    excluded=Excluded((("arm", "base"),), (("default", "stones"),)),
)


def _read(folder, text):
    (folder / WORLD).write_text(text, encoding="utf-8")
    return WorldJson().read(folder)


def test_written_worlds_are_read_to_the_last_bit(tmp_path):
    (text,) = WorldJson().write(DOCUMENT).values()
    again = _read(tmp_path, text)
    assert again == DOCUMENT
    assert WorldJson().write(again) == {WORLD: text}


def test_absent_values_are_omitted_or_null():
    content = json.loads(WorldJson().write(DOCUMENT)[WORLD])
    base, arm, bob, stone = content["bodies"]
    assert "hardness" not in base["shapes"][0]["copies"][0]
    assert base["shapes"][0]["copies"][1]["hardness"]["stiffness"] == 1e5
    assert arm["joint"]["velocity_limit"] is None
    assert base["joint"]["parent"] is None
    assert stone["shapes"][0]["colour"] is None
    assert set(stone["joint"]) == {"name", "kind", "position", "velocity"}
    assert "axis" not in bob["joint"]


def test_parents_and_states_of_every_kind_of_joint():
    joints = [body.joint for body in DOCUMENT.bodies]
    assert [parent_of(joint) for joint in joints] == [None, "base", "arm", None]
    assert [tuple(map(len, state_of(joint))) for joint in joints] == [(0, 0), (1, 1), (4, 3), (7, 6)]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (setting(2, "schema"), "schema 2, this simspec reads 1"),
        (setting(-0.001, "timestep"), "world.json.timestep is -0.001, should be above zero"),
        (setting(10**400, "timestep"), "world.json.timestep is 1000"),
        (setting("round", "friction_cone"), "world.json.friction_cone has 'round'"),
        (setting("screw", "bodies", 1, "joint", "kind"), "world.json.bodies.1.joint.kind has 'screw'"),
        (setting([], "bodies", 1, "joint", "kind"), "world.json.bodies.1.joint.kind is [], should be a text"),
        (setting([], "bodies", 1, "joint"), "world.json.bodies.1.joint is [], should be an object"),
        (lambda content: content["bodies"][1]["joint"].pop("kind"), "bodies.1.joint.kind is None"),
        (setting("ball", "bodies", 1, "joint", "kind"), "world.json.bodies.1.joint lacks the fields []"),
        (setting([0.1, 0.2], "bodies", 1, "joint", "position"), "joint.position has 2 entries, should have 1"),
        (setting([0.0, 0.0, 2.0], "bodies", 1, "joint", "axis"), "bodies.1.joint.axis is [0.0, 0.0, 2.0]"),
        (setting("stone", "bodies", 1, "joint", "parent"), "'stone', which is no body before it"),
        (setting("arm", "bodies", 1, "joint", "parent"), "'arm', which is no body before it"),
        (setting([1.0, 0.1, 0.0, 0.0], "bodies", 2, "joint", "position"), "bodies.2.joint.position"),
        (setting([0.1, 0.1], "bodies", 0, "shapes", 0, "size"), "shapes.0.size has 2 entries, should have 1"),
        (setting("cone", "bodies", 0, "shapes", 0, "kind"), "bodies.0.shapes.0.kind has 'cone'"),
        (setting([], "bodies", 3, "shapes", 0, "copies"), "bodies.3.shapes.0 is neither visual nor collision"),
        (setting("ice", "bodies", 1, "shapes", 0, "material"), "has the material 'ice' and is no collision shape"),
        (setting(0, "bodies", 0, "shapes", 0, "copies", 1, "layer"), "not in the order of their layers"),
        (setting(True, "bodies", 0, "shapes", 0, "copies", 1, "layer"), "layer is True, should be a whole number"),
        (setting(None, "bodies", 0, "shapes", 0, "copies", 1, "hardness"), "hardness is None"),
        (setting([1.0, 0.0, 0.0], "bodies", 0, "shapes", 0, "colour"), "colour has 3 entries, should have 4"),
        (setting([["ice", "ice", 2], ["ice", "ice", 0]], "meets"), "('ice', 'ice') twice"),
        (setting([["ice", "ice", 1]], "meets"), "no copy in that layer"),
        (setting([["arm", "arm"]], "apart", "bodies"), "world.json.apart.bodies has 'arm' twice"),
        (setting([["arm", "unknown"]], "apart", "bodies"), "'unknown', which is not known"),
        (setting([["arm", "stones"]], "apart", "groups"), "'arm', which is not known"),
        (setting("base", "bodies", 1, "name"), "world.json.bodies has 'base' twice"),
        (setting("j0", "bodies", 1, "joint", "name"), "(joints) has 'j0' twice"),
        (setting("base_0", "bodies", 1, "shapes", 0, "name"), "(shapes) has 'base_0' twice"),
        (setting(0.1, "bodies", 1, "drag"), "'drag'"),
    ],
)
def test_inconsistent_content_is_rejected_with_its_location(tmp_path, change, said):
    content = json.loads(WorldJson().write(DOCUMENT)[WORLD])
    sound = copy.deepcopy(content)
    change(content)
    assert content != sound
    with pytest.raises(ValueError, match=re.escape(said)):
        _read(tmp_path, json.dumps(content))


@pytest.mark.parametrize("text", ["", "[]", "{", "null", '{"schema": NaN}', "[" * 100_000, "\ud800"])
def test_other_files_are_rejected(tmp_path, text):
    (tmp_path / WORLD).write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(ValueError, match=r"world\.json"):
        WorldJson().read(tmp_path)


def test_a_link_is_not_followed(tmp_path):
    (tmp_path / "other.json").write_text(WorldJson().write(DOCUMENT)[WORLD], encoding="utf-8")
    (tmp_path / WORLD).symlink_to(tmp_path / "other.json")
    with pytest.raises(ValueError, match=r"world\.json"):
        WorldJson().read(tmp_path)
