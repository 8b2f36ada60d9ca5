"""DART's .skel: the independent reader finds the world again; names are safe, nothing is left to a default."""

from __future__ import annotations

import dataclasses
import json
import math
from xml.etree import ElementTree

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dialects.dart import dialect as skel
from simspec.dialects.dart.dialect import DartDialect
from simspec.dialects.kit.sidecar import SIDECAR, read_sidecar
from simspec.engines.dart.engine import Dart
from simspec.errors import UnsupportedError
from simspec.formats.skel.format import WORLD
from simspec.support.declarations import combine
from simspec.support.negotiation import negotiate
from simspec.world import frames
from simspec.world.kinematics import poses
from simspec.world.types import Contact
from tests import worlds
from tests.dialects.dart.saying import (
    SMALL,
    WORLDS,
    change_joint,
    emit,
    failures,
    two_materials,
    with_cone,
)
from tests.files import write


@pytest.mark.parametrize("name", WORLDS)
def test_the_independent_reader_finds_the_world_again(name, tmp_path):
    world = WORLDS[name]()
    files = emit(world)
    assert sorted(files) == sorted([WORLD, SIDECAR])
    back = DartDialect().read(write(files, tmp_path))
    assert failures(world, back, text=True) == []
    assert [body.name for body in back.bodies] == [body.name for body in world.bodies]
    for body, again in zip(world.bodies, back.bodies, strict=True):
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


def test_each_tree_is_a_skeleton_and_static_trees_are_not_mobile():
    found = skeletons(emit(worlds.shapes_world(("box", "sphere")))[WORLD])
    assert [entry.attrib["name"] for entry in found] == ["floor", "box", "sphere"]
    assert [entry.findtext("mobile") for entry in found] == ["false", "true", "true"]
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
    options = worlds.with_options(world, "dart", settings=(("collision_detector", "bullet"),))
    assert json.loads(emit(options)[SIDECAR])["settings"]["collision_detector"] == "bullet"


def refusals(world):
    with pytest.raises(UnsupportedError) as caught:
        negotiate(world, "dart", combine(DartDialect.SUPPORT, Dart.SUPPORT))
    return str(caught.value)


def test_unsupported_features_are_rejected_by_name():
    assert "contact.cone.pyramid-inscribed" in refusals(with_cone("pyramid-inscribed"))
    assert "joint.armature" in refusals(worlds.limits_and_armature(armature=0.1))


def test_a_solver_setting_changes_the_cone_only_where_that_is_accepted():
    dantzig = (("contact_solver", "dantzig"),)
    pyramid, elliptic = with_cone("pyramid-circumscribed"), with_cone("elliptic")
    shapes, cone = ("shape.capsule", "shape.cylinder"), "contact.cone.elliptic"
    flat, mark = "contact.cone.pyramid-circumscribed", r"accept: \[contact\.cone\.pyramid-circumscribed\]"
    with pytest.raises(UnsupportedError, match=rf"the tilt of the lower face[\s\S]*{mark}"):
        compile_world(worlds.with_options(pyramid, "dart", accept=shapes), ["dart"])
    with pytest.raises(UnsupportedError, match=rf"normal forces of the frictionless problem[\s\S]*{mark}"):
        compile_world(worlds.with_options(pyramid, "dart", settings=dantzig, accept=shapes), ["dart"])
    compile_world(worlds.with_options(pyramid, "dart", settings=dantzig, accept=(*shapes, flat)), ["dart"])
    compile_world(worlds.with_options(elliptic, "dart", accept=shapes), ["dart"])
    with pytest.raises(UnsupportedError, match=r"accept: \[contact\.cone\.elliptic\]"):
        compile_world(worlds.with_options(elliptic, "dart", settings=dantzig, accept=shapes), ["dart"])
    compile_world(worlds.with_options(elliptic, "dart", settings=dantzig, accept=(*shapes, cone)), ["dart"])


def test_surfaces_invert_darts_rules(tmp_path):
    """Friction is the smaller of two numbers, restitution their product."""
    content = read_sidecar(write(emit(two_materials()), tmp_path))
    actual = {
        shape["name"]: [surface[key] for surface in shape["surfaces"] for key in ("friction", "restitution")]
        for shape in content["shapes"]
    }
    assert content["copies"] == [], "all meet all others: two materials stay on one node"
    assert min(actual["floor_0"][0], actual["a"][0]) == 0.7
    assert min(actual["floor_0"][0], actual["b"][0]) == 0.1
    assert actual["a"][1] * actual["b"][1] == pytest.approx(0.25, rel=1e-15)
