"""Plain URDF for engines without a dialect: written files are read back, inexpressible features are rejected."""

from __future__ import annotations

import copy
import dataclasses
import json
import re

import pytest

from simspec.contact import Rules, contact_plan
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.defects import NAMES
from simspec.dialects.kit.sidecar import SIDECAR, Target
from simspec.dialects.urdf.defects import DEFECTS
from simspec.dialects.urdf.dialect import UrdfDialect
from simspec.dialects.urdf.sidecar import UrdfSidecar
from simspec.errors import UnsupportedError
from simspec.formats.urdf.format import Urdf
from simspec.formats.urdf.reading import unknown_parts
from simspec.proof.comparator import compare
from simspec.proof.selftest_worlds import WORLDS as SELF_TEST
from simspec.support.negotiation import negotiate
from simspec.world import frames
from simspec.world.types import Hardness, Joint, Pose, Shape
from tests import worlds
from tests.files import setting, write
from tests.planted import SHARED

RULES = Rules("max", "max", "max", "max", "same")
"""The plan of an engine with values of materials and, in addition, explicit pairs."""


def target(world):
    return Target("toy", RULES, contact_plan(world, RULES, False), {"iterations": 3})


def emit(world):
    return UrdfDialect().emit(world, target(world))


def failures(world, folder):
    return [check for check in compare(world, UrdfDialect().read(folder), RULES, False, text=True) if not check.passed]


def without_inertial():
    """A floor of every shape that URDF lacks, on a body without mass."""
    world = worlds.shapes_world(("box",))
    floor = dataclasses.replace(
        world.bodies[0],
        shapes=(
            Shape("ground", "plane", (), Pose((0.0, 0.0, -1.0)), "default", visual=False),
            Shape("egg", "ellipsoid", (0.1, 0.2, 0.3), Pose((1.0, 0.0, 0.0)), "default", colour=(0.1, 0.2, 0.3, 1.0)),
            Shape("seen", "capsule", (0.1, 0.3), Pose((0.0, 0.2, 0.0)), collision=False),
        ),
    )
    return dataclasses.replace(world, bodies=(floor, *world.bodies[1:]))


def without_ball(world):
    """The world with each ball joint fixed, at the angle that it has, which plain URDF supports."""

    def welded(body):
        joint = body.joint
        if joint.kind != "ball":
            return body
        origin = frames.compose(joint.origin, Pose((0.0, 0.0, 0.0), joint.position))
        return dataclasses.replace(body, joint=Joint(joint.name, "fixed", joint.parent, origin))

    return dataclasses.replace(world, bodies=tuple(welded(body) for body in world.bodies))


def self_test(name):
    """A world of the self-test, as far as plain URDF supports it."""
    world = SELF_TEST[name]("mujoco")
    return without_ball(world) if world.constraints else world


WRITTEN = {
    "arms": lambda: worlds.world(worlds.tree(["free", "hinge", "slide", "fixed"], 3)),
    "hung": lambda: worlds.world(worlds.tree(["slide", "hinge"], 4, velocity_limit=2.0)),
    "limits": lambda: worlds.limits_and_armature(armature=0.2, dry_friction=0.3),
    "shapes": worlds.shapes_world,
    "lacking": without_inertial,
    "spheres": lambda: worlds.spheres(5),
    "gripper": worlds.gripper,
    **{name: lambda name=name: self_test(name) for name in SHARED if name not in ("ball joint", "rolling", "ground")},
}


@pytest.mark.parametrize("name", WRITTEN)
def test_written_files_are_read_back_equal(name, tmp_path):
    world = WRITTEN[name]()
    files = emit(world)
    write(files, tmp_path)
    assert failures(world, tmp_path) == []
    read = UrdfDialect().read(tmp_path)
    for body, again in zip(world.bodies, read.bodies, strict=True):
        assert (body.name, body.model, body.joint.name) == (again.name, again.model, again.joint.name)
        limits = ("position_limits", "velocity_limit", "effort_limit", "axis", "damping", "dry_friction", "armature")
        for field in (*limits, "spring_stiffness", "spring_rest", "kind", "parent"):
            assert getattr(body.joint, field) == getattr(again.joint, field), (body.name, field)
        seen = [(shape.name, shape.kind, shape.size, shape.collision, shape.visual) for shape in body.shapes]
        assert seen == [(shape.name, shape.kind, shape.size, shape.collision, shape.visual) for shape in again.shapes]
        colours = [shape.colour for shape in body.shapes if shape.visual]
        assert colours == [shape.colour for shape in again.shapes if shape.visual]
    assert emit(world) == files, "same input, same bytes"


@pytest.mark.parametrize("name", WRITTEN)
def test_the_files_are_plain_urdf(name, tmp_path):
    write(emit(WRITTEN[name]()), tmp_path)
    for robot in Urdf().read(tmp_path).robots.values():
        assert list(unknown_parts(robot)) == []
        demanding = [joint for joint in robot.joints if joint.type in ("revolute", "prismatic")]
        for limit in (joint.limit for joint in demanding):
            assert limit is not None
            assert None not in (limit.lower, limit.upper, limit.effort, limit.velocity)


@pytest.mark.parametrize("name", [name for name, plant in DEFECTS.items() if not isinstance(plant, str)])
def test_planted_defects_act(name, tmp_path):
    world = self_test(NAMES[name])
    if NAMES[name] == "rolling":
        assert world.contact.materials[0].rolling_friction
    files = emit(world)
    planted = DEFECTS[name](files)
    assert planted != files
    write(planted, tmp_path)
    try:
        noticed = failures(world, tmp_path)
    except ValueError:
        return
    filters = [word for word in NAMES if "pair" in word or "group" in word or "filter" in word]
    if name not in filters and name != "hardness":
        assert noticed, "the text says nothing of it"


def test_every_defect_is_planted_or_says_why():
    assert set(DEFECTS) == set(NAMES)
    assert isinstance(dialects()["urdf"], UrdfDialect)


def test_the_law_of_every_pair_of_materials_is_written():
    world = SELF_TEST["surfaces"]("mujoco")
    sidecar = UrdfDialect().lower(world, target(world)).sidecar
    assert sidecar.laws == world.contact.pairs
    assert {(pair.first, pair.second) for pair in sidecar.pairs} >= {("floor_ice", "rubber_cube_0")}
    again = UrdfSidecar.of(json.loads(emit(world)[SIDECAR]))
    assert again == sidecar


def test_equal_trees_share_a_file_unless_their_sidecar_shapes_differ():
    world = worlds.spheres(4)
    capsule = Shape("own", "capsule", (0.1, 0.2), Pose(), "default")

    def both(body, first):
        shapes = (*body.shapes, dataclasses.replace(capsule, name=f"{body.name}_more"))
        return dataclasses.replace(body, shapes=shapes if first else shapes[::-1])

    bodies = (world.bodies[0], *(both(body, index < 2) for index, body in enumerate(world.bodies[1:])))
    world = dataclasses.replace(world, bodies=bodies)
    content = json.loads(emit(world)[SIDECAR])
    files = [instance["file"] for instance in content["instances"]]
    assert files[1] == files[2] != files[3] == files[4]


@pytest.mark.parametrize(
    ("kinds", "more", "said"),
    [
        (["free", "ball"], {}, "URDF has no ball joint"),
        (["hinge"], {"effort_limit": 2e9}, "where a joint has none"),
        (["slide"], {"position_limits": (-1e9, 0.0)}, "where a joint has none"),
    ],
)
def test_features_without_a_place_in_the_file_are_rejected(kinds, more, said):
    bodies = worlds.tree(kinds, 1)
    last = dataclasses.replace(bodies[-1], joint=dataclasses.replace(bodies[-1].joint, **more))
    with pytest.raises(UnsupportedError, match=said):
        emit(worlds.world((*bodies[:-1], last)))


def test_negotiation_rejects_features_without_a_place_in_the_file():
    with pytest.raises(UnsupportedError, match=r"joint\.ball"):
        negotiate(worlds.world(worlds.tree(["ball"], 1)), "toy", UrdfDialect.SUPPORT)


@pytest.fixture(scope="module")
def sound():
    return json.loads(emit(without_inertial())[SIDECAR])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (setting("sphere", "beside", 0, "kind"), "'sphere'"),
        (setting("nobody", "beside", 0, "body"), "has no shape"),
        (setting([1.0], "beside", 0, "size"), "has 1 entries, should have 0"),
        (setting(True, "instances", 0, "free"), "does not fit the kinds"),
        (setting([], "groups"), "sidecar.groups"),
        (setting([["floor", "nobody"]], "excluded"), "'nobody'"),
        (setting("wood", "instances", 0, "materials", 0, 0), "'wood'"),
        (setting("soft", "materials", 0, "hardness", "kind"), "'soft'"),
        (setting([], "materials"), "are not known"),
        (setting([], "instances", 1, "position"), "has 0 numbers"),
    ],
)
def test_sidecars_that_do_not_fit_together_are_refused(sound, change, said):
    UrdfSidecar.of(sound)
    content = copy.deepcopy(sound)
    change(content)
    with pytest.raises(ValueError, match=re.escape(said).replace("are\\ not", "(is|are) not")):
        UrdfSidecar.of(content)


def test_files_that_do_not_fit_the_sidecar_are_refused(tmp_path):
    world = WRITTEN["arms"]()
    files = emit(world)
    (name,) = [name for name in files if name.endswith(".urdf")]
    for old, new, said in (
        ("<dynamics", '<mimic joint="x"/><dynamics', "robot/joint/mimic that simspec does not write"),
        ("</robot>", '<material name="paint"/></robot>', "that simspec does not write"),
        ('<link name="link3">', '<link name="link3" type="x">', "the attribute 'type' of robot/link"),
        ("</robot>", "<gazebo/></robot>", "that simspec does not write"),
        ('<link name="link3"', '<link name="link4"', "a link 'link3', which there is not"),
        ('type="continuous"', 'type="spherical"', "not of the dialect"),
        ('type="fixed">', 'type="fixed"><limit effort="1"/>', "has limits or dynamics"),
    ):
        assert old in files[name], old
        write({**files, name: files[name].replace(old, new, 1)}, tmp_path)
        with pytest.raises(ValueError, match=said):
            UrdfDialect().read(tmp_path)


def test_hardness_is_carried_by_material():
    world = worlds.spheres(2)
    soft = Hardness("stiffness", stiffness=1e4, damping=10.0)
    pairs = tuple(dataclasses.replace(pair, hardness=soft) for pair in world.contact.pairs)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    sidecar = UrdfDialect().lower(world, target(world)).sidecar
    assert {numbers.hardness for numbers in sidecar.materials} == {soft}


def test_the_link_that_stands_for_the_world_carries_nothing(tmp_path):
    files = emit(WRITTEN["hung"]())
    (name,) = [name for name in files if name.endswith(".urdf")]
    ball = '<collision name="c"><geometry><sphere radius="1"/></geometry></collision>'
    heavy = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    for more in (ball, ball.replace("collision", "visual"), heavy):
        changed = files[name].replace('<link name="world">', f'<link name="world">{more}')
        assert changed != files[name]
        with pytest.raises(ValueError, match="stands for the world"):
            UrdfDialect().read(write({**files, name: changed}, tmp_path))
