"""DART's .skel: the independent reader finds the world again; names are safe, nothing is left to a default."""

from __future__ import annotations

import dataclasses
import json
import math
from xml.etree import ElementTree

import numpy as np
import pytest

from simspec.compiler import compile_world, target_of
from simspec.dialects.dart import dialect as skel
from simspec.dialects.dart.dialect import DartDialect
from simspec.dialects.kit.sidecar import SIDECAR, read_sidecar
from simspec.engines.dart.engine import Dart
from simspec.errors import UnsupportedError
from simspec.formats.skel.format import WORLD
from simspec.proof.comparator import compare
from simspec.support.declarations import combine
from simspec.support.negotiation import negotiate
from simspec.world import frames
from simspec.world.kinematics import poses
from simspec.world.types import Contact, Material, PairContact, Pose, Shape
from tests import worlds

SMALL = 3e-4
"""An initial rotation (rad) in the range that DART turns by a Taylor form."""


def target(world):
    return target_of(world, Dart)


SHAPES = tuple(f"shape.{kind}" for kind in ("box", "cylinder", "capsule", "ellipsoid", "plane"))


def emit(world):
    """The files, with the contact of every pair of shapes accepted: no detector of DART is sound for all."""
    given = world.options("dart")
    accepted = worlds.with_options(
        world, "dart", settings=given.settings, outside=given.outside, accept=(*given.accept, *SHAPES)
    )
    return DartDialect().emit(accepted, target(accepted))


def write(files, folder):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def failures(world, held, text=False):
    """The checks of the comparator that fail, as (name, place)."""
    checks = compare(world, held, Dart.RULES, Dart.LAYERS, text=text)
    assert len(checks) > 5
    return [(check.name, check.where) for check in checks if not check.passed]


def change_joint(world, index, **changes):
    """The world with some fields of one body's joint changed."""
    body = world.bodies[index]
    body = dataclasses.replace(body, joint=dataclasses.replace(body.joint, **changes))
    return dataclasses.replace(world, bodies=(*world.bodies[:index], body, *world.bodies[index + 1 :]))


def mixed_shapes():
    """A body with a visual shape between two collision shapes, one of which is not seen."""
    base = worlds.shapes_world(("box",))
    shapes = (
        Shape("solid", "sphere", (0.1,), Pose((0.1, 0.0, 0.0)), "default", visual=False),
        Shape("seen", "capsule", (0.1, 0.3), Pose((0.0, 0.2, 0.0)), collision=False, colour=(0.1, 0.2, 0.3, 0.4)),
        Shape("both", "cylinder", (0.1, 0.3), Pose((0.0, 0.0, 0.3)), "default"),
    )
    return dataclasses.replace(base, bodies=(base.bodies[0], dataclasses.replace(base.bodies[1], shapes=shapes)))


def two_materials():
    """Two materials on one body, above a floor of a third: frictions by min, restitutions by product."""
    base = worlds.shapes_world(("box", "sphere"))
    names = ("ground", "rough", "slick")
    friction = {("ground", "rough"): 0.7, ("ground", "slick"): 0.1}
    pairs = tuple(
        PairContact(one, other, friction.get((one, other), 0.7 if "slick" not in (one, other) else 0.1), 0.25)
        for index, one in enumerate(names)
        for other in names[index:]
    )
    floor, box, sphere = base.bodies
    shapes = (
        Shape("a", "box", (0.1, 0.1, 0.1), Pose(), "rough"),
        Shape("b", "box", (0.1, 0.1, 0.1), Pose((0.2, 0.0, 0.0)), "slick"),
    )
    floor = dataclasses.replace(floor, shapes=(dataclasses.replace(floor.shapes[0], material="ground"),))
    sphere = dataclasses.replace(sphere, shapes=(dataclasses.replace(sphere.shapes[0], material="rough"),))
    contact = Contact(materials=tuple(Material(name, 0.5, 0.25) for name in names), pairs=pairs)
    return dataclasses.replace(base, bodies=(floor, dataclasses.replace(box, shapes=shapes), sphere), contact=contact)


def small_turns(**more):
    """A free and a ball joint that start with a small rotation."""
    world = worlds.world(worlds.tree(["free", "ball", "hinge"], 8, **more))
    q = (math.cos(SMALL / 2.0), 0.6 * math.sin(SMALL / 2.0), 0.0, 0.8 * math.sin(SMALL / 2.0))
    world = change_joint(world, 0, position=(*world.bodies[0].joint.position[:3], *q))
    return change_joint(world, 1, position=q)


def reserved_name():
    """A body called as DART calls the world."""
    bodies = worlds.tree(["hinge", "ball"], 4)
    first = dataclasses.replace(bodies[0], name="world", model="world")
    second = dataclasses.replace(bodies[1], model="world", joint=dataclasses.replace(bodies[1].joint, parent="world"))
    return worlds.world((first, second), contact=Contact(excluded_bodies=(("link1", "world"),)))


def interleaved():
    """Two trees whose bodies alternate in the world's order."""
    one, other = worlds.tree(["free", "hinge"], 5, prefix="a"), worlds.tree(["ball", "slide"], 6, prefix="b")
    return worlds.world((one[0], other[0], one[1], other[1]))


WORLDS = {
    "every-joint": lambda: worlds.every_joint(damping=0.2),
    "damped-springs": worlds.damped_springs,
    "limits": lambda: worlds.limits_and_armature(armature=0.2, dry_friction=0.3),
    "shapes": worlds.shapes_world,
    "ellipsoid-and-plane": lambda: worlds.shapes_world(("ellipsoid", "plane")),
    "mixed-shapes": mixed_shapes,
    "two-materials": two_materials,
    "spheres": worlds.spheres,
    "gripper": worlds.gripper,
    "small-turns": small_turns,
    "reserved-name": reserved_name,
    "interleaved": interleaved,
    "hung": lambda: worlds.world(worlds.tree(["ball", "slide", "hinge"], 4, velocity_limit=2.0, effort_limit=3.0)),
}


@pytest.mark.parametrize("name", WORLDS)
def test_the_independent_reader_finds_the_world_again(name, tmp_path):
    world = WORLDS[name]()
    files = emit(world)
    assert sorted(files) == sorted([WORLD, SIDECAR])
    held = DartDialect().read(write(files, tmp_path))
    assert failures(world, held, text=True) == []
    assert [body.name for body in held.bodies] == [body.name for body in world.bodies]
    for body, again in zip(world.bodies, held.bodies, strict=True):
        for shape, read in zip(body.shapes, again.shapes, strict=True):
            assert (shape.name, shape.collision, shape.visual) == (read.name, read.collision, read.visual)
            assert not shape.visual or shape.colour == read.colour
    assert emit(world) == files, "same input, same bytes"


DEFECTS = {
    "mass": ("<mass>", "<mass>1"),
    "inertia": ("<ixy>", "<ixy>1"),
    "centre": ("<offset>", "<offset>1"),
    "joint type": ('type="revolute"', 'type="prismatic"'),
    "axis": ("<xyz>", "<xyz>1"),
    "limit": ("<upper>2", "<upper>3"),
    "dry friction": ("<friction>0.3", "<friction>0.4"),
    "position": ("<init_pos>", "<init_pos>1"),
    "velocity": ("<init_vel>", "<init_vel>1"),
    "gravity": ("-9.81", "-9.8"),
    "timestep": ("<time_step>0.001", "<time_step>0.002"),
}


@pytest.mark.parametrize("name", DEFECTS)
def test_the_reader_sees_a_changed_file(name, tmp_path):
    world = WORLDS["limits"]()
    files = emit(world)
    head, found, tail = files[WORLD].rpartition(DEFECTS[name][0])
    assert found
    # a sign after the digit would no longer be a number
    changed = (head + DEFECTS[name][1] + tail).replace("1-", "-1")
    assert failures(world, DartDialect().read(write({**files, WORLD: changed}, tmp_path)), text=True) != []


@pytest.mark.parametrize("name", ["damping", "armature", "springs", "velocity_limits", "effort_limits"])
def test_the_reader_reads_the_sidecar(name, tmp_path):
    world = change_joint(WORLDS["limits"](), 1, damping=0.5, spring_stiffness=2.0, spring_rest=0.1)
    files = emit(world)
    content = json.loads(files[SIDECAR])
    key = "stiffness" if name == "springs" else "value"
    content[name][0][key] *= 1.001
    write({**files, SIDECAR: json.dumps(content)}, tmp_path)
    assert len(failures(world, DartDialect().read(tmp_path), text=True)) == 1


def test_the_reader_refuses_files_that_do_not_fit_the_sidecar(tmp_path):
    files = emit(worlds.shapes_world())
    head, _, tail = files[WORLD].partition("        <collision_shape>")
    write({**files, WORLD: head + tail.partition("</collision_shape>\n")[2]}, tmp_path)
    with pytest.raises(ValueError, match="too few collision shapes"):
        DartDialect().read(tmp_path)
    limited = emit(WORLDS["limits"]())
    content = json.loads(limited[SIDECAR])
    content["enforce_limits"].pop()
    write({**limited, SIDECAR: json.dumps(content)}, tmp_path)
    with pytest.raises(ValueError, match="not both given and enforced"):
        DartDialect().read(tmp_path)


def skeletons(text):
    return list(ElementTree.fromstring(text.encode()).iter("skeleton"))


def test_there_is_one_skeleton_for_each_tree_and_static_ones_are_not_mobile():
    found = skeletons(emit(worlds.shapes_world(("box", "sphere")))[WORLD])
    assert [one.attrib["name"] for one in found] == ["floor", "box", "sphere"]
    assert [one.findtext("mobile") for one in found] == ["false", "true", "true"]
    (arm,) = skeletons(emit(worlds.damped_springs())[WORLD])
    assert arm.findtext("mobile") == "true", "its root is fixed, its links move"


def test_poses_are_those_of_the_world_at_zero():
    """Bodies stand in the world, at zero configuration, as a position and intrinsic X-Y-Z angles."""
    world = worlds.damped_springs()
    (arm,) = skeletons(emit(world)[WORLD])
    wanted = poses(world, at_zero=True)
    for body in arm.iter("body"):
        numbers = [float(word) for word in body.findtext("transformation").split()]
        pose = wanted[body.attrib["name"]]
        np.testing.assert_allclose(numbers[:3], pose.position, atol=1e-15)
        (sa, ca), (sb, cb), (sc, cc) = ((math.sin(x), math.cos(x)) for x in numbers[3:])
        about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
        about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        about_z = np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
        np.testing.assert_allclose(about_x @ about_y @ about_z, frames.matrix(pose.quaternion), atol=1e-15)


def test_nothing_is_left_to_a_default():
    text = emit(worlds.limits_and_armature())[WORLD]
    world = ElementTree.fromstring(text.encode()).find("world")
    for path in ("time_step", "gravity", "collision_detector"):
        assert world.findtext(f"physics/{path}")
    for body in world.iter("body"):
        assert body.findtext("gravity") == "true"
        for path in (
            "mass",
            "offset",
            *(f"moment_of_inertia/i{pair}" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")),
        ):
            assert body.findtext(f"inertia/{path}"), path
    for joint in world.iter("joint"):
        assert joint.find("parent") is not None
        if joint.attrib["type"] != "weld":
            assert joint.findtext("axis/dynamics/damping") == "0", "DART's own damping is implicit in time"
            assert joint.findtext("axis/dynamics/spring_stiffness") == "0", "and so is its spring"
            assert joint.findtext("axis/limit/lower")
            assert joint.findtext("init_pos")


def test_unlimited_joints_have_no_limits(tmp_path):
    files = emit(worlds.world(worlds.tree(["hinge", "slide"], 3)))
    assert "<limit>" not in files[WORLD]
    assert json.loads(files[SIDECAR])["enforce_limits"] == []


def test_names_never_break_the_xml(tmp_path):
    world = worlds.world(worlds.tree(["free", "hinge"], 1))
    name = 'a<b>&"é  c'
    first = dataclasses.replace(world.bodies[0], name=name, model=name)
    second = dataclasses.replace(
        world.bodies[1], model=name, joint=dataclasses.replace(world.bodies[1].joint, parent=name)
    )
    world = dataclasses.replace(
        world, bodies=(first, second), contact=Contact(excluded_bodies=(tuple(sorted((name, "link1"))),))
    )
    assert failures(world, DartDialect().read(write(emit(world), tmp_path)), text=True) == []


def test_an_ellipsoids_size_are_its_diameters():
    text = emit(worlds.shapes_world(("ellipsoid",)))[WORLD]
    (size,) = {element.text for element in ElementTree.fromstring(text.encode()).iterfind(".//ellipsoid/size")}
    assert size.split() == ["0.1", "0.16", "0.22"]


@pytest.mark.parametrize(
    ("turn", "written"), [(0.0, 0.0), (1e-6, 1e-6), (SMALL, SMALL - 2.0 * math.pi), (1e-2, 1e-2), (3.1, 3.1)]
)
def test_rotation_vectors_avoid_the_range_of_the_taylor_form(turn, written):
    found = skel.rotation_vector((math.cos(turn / 2.0), 0.0, math.sin(turn / 2.0), 0.0))
    assert found[0] == found[2] == 0.0
    assert found[1] == pytest.approx(written, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize(
    ("kinds", "detector"),
    [
        (("sphere", "box", "capsule"), "dart"),
        (("sphere", "plane"), "dart"),
        (("box", "cylinder"), "ode"),
        (("box", "plane"), "ode"),
    ],
)
def test_the_detector_suits_the_shapes(kinds, detector, tmp_path):
    world = worlds.shapes_world(kinds)
    if "plane" in kinds:
        world = dataclasses.replace(world, bodies=world.bodies[1:] if "box" not in kinds else world.bodies)
    content = read_sidecar(write(emit(world), tmp_path))
    assert content["settings"]["collision_detector"] == detector
    assert f"<collision_detector>{detector}<" in emit(world)[WORLD]
    asked = worlds.with_options(world, "dart", settings=(("collision_detector", "bullet"),))
    assert json.loads(emit(asked)[SIDECAR])["settings"]["collision_detector"] == "bullet"


def with_cone(cone):
    world = worlds.shapes_world()
    return dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))


def refusals(world):
    with pytest.raises(UnsupportedError) as caught:
        negotiate(world, "dart", combine(DartDialect.SUPPORT, Dart.SUPPORT))
    return str(caught.value)


def test_what_cannot_be_had_is_refused_by_name():
    assert "contact.cone.pyramid-inscribed" in refusals(with_cone("pyramid-inscribed"))
    assert "joint.armature" in refusals(worlds.limits_and_armature(armature=0.1))


def test_a_solver_setting_changes_the_cone_only_where_that_is_accepted():
    dantzig = (("contact_solver", "dantzig"),)
    pyramid, elliptic = with_cone("pyramid-circumscribed"), with_cone("elliptic")
    shapes, cone = ("shape.capsule", "shape.cylinder"), "contact.cone.elliptic"
    compile_world(worlds.with_options(pyramid, "dart", settings=dantzig, accept=shapes), ["dart"])
    compile_world(worlds.with_options(elliptic, "dart", accept=shapes), ["dart"])
    with pytest.raises(UnsupportedError, match=r"accept: \[contact\.cone\.elliptic\]"):
        compile_world(worlds.with_options(elliptic, "dart", settings=dantzig, accept=shapes), ["dart"])
    compile_world(worlds.with_options(elliptic, "dart", settings=dantzig, accept=(*shapes, cone)), ["dart"])


def test_surfaces_invert_darts_rules(tmp_path):
    """Friction is the smaller of two numbers, restitution their product."""
    content = read_sidecar(write(emit(two_materials()), tmp_path))
    held = {
        shape["name"]: [one[key] for one in shape["surfaces"] for key in ("friction", "restitution")]
        for shape in content["shapes"]
    }
    assert content["copies"] == [], "all meet all others: two materials stay on one node"
    assert min(held["floor_0"][0], held["a"][0]) == 0.7
    assert min(held["floor_0"][0], held["b"][0]) == 0.1
    assert held["a"][1] * held["b"][1] == pytest.approx(0.25, rel=1e-15)
