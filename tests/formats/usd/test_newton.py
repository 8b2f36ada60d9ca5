"""Another reader finds the same in exported files: the package newton, in a process of its own, at single precision.

It runs where newton is installed, or where ``NEWTON_PYTHON`` names an interpreter that has it.
"""

from __future__ import annotations

import functools
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simspec.files import find_spec
from simspec.formats.usd.format import Usd
from simspec.formats.usd.joints import carriers, several
from simspec.formats.usd.stage import SMALLEST_MASS, SMALLEST_MOMENT, is_static, places
from simspec.language.load import Spec, load
from simspec.world import frames
from simspec.world.kinematics import poses, trees

READER = Path(__file__).with_name("newton_reader.py")
LIBRARY = (
    *("ur10e", "ur10e-hand", "double-pendulum", "ball-pendulum", "box-on-ramp", "coupled-gripper", "four-bar-push"),
    *("gripper", "spheres-216", "stack-cylinders", "tumbling-body"),
)
SEVERAL = "several axes"
ROWS = (("slide", [0, 0, 1]), ("hinge", [0, 0, 1]), ("hinge", [0, 1, 0]))
SINGLE = 2e-6
"""Relative: single precision (6e-8), through products of rotations."""
KINDS = {"hinge": "REVOLUTE", "slide": "PRISMATIC", "ball": "BALL", "fixed": "FIXED"}
SHAPES = {"sphere": "SPHERE", "box": "BOX", "cylinder": "CYLINDER", "capsule": "CAPSULE", "plane": "PLANE"}
HULLS = ("CONVEX_MESH", "MESH")


def interpreter():
    if named := os.environ.get("NEWTON_PYTHON"):
        return named
    return sys.executable if all(importlib.util.find_spec(name) for name in ("newton", "warp", "pxr")) else None


PYTHON = interpreter()
pytestmark = pytest.mark.skipif(
    PYTHON is None, reason="newton is not installed, and NEWTON_PYTHON names no interpreter"
)


@functools.cache
def worlds():
    link = {"mass": 1, "inertia": {"principal": [1, 1.1, 1.2]}}
    joints = [{"name": f"j{index}", "type": kind, "axis": axis} for index, (kind, axis) in enumerate(ROWS)]
    joints[0]["origin"] = {"xyz": [1, 2, 3], "rpy": [0.1, 0.2, 0.3]}
    bodies = {"a": {"fixed": True, **link}, "b": {"parent": "a", "joints": joints, **link}}
    spec = Spec.from_data({"simspec": 1, "name": "several", "bodies": bodies})
    return {**{name: load(find_spec(name)).resolve() for name in LIBRARY}, SEVERAL: spec.resolve()}


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    folder = tmp_path_factory.mktemp("newton")
    paths = []
    for name, world in worlds().items():
        paths.append(folder / f"{name}.usda")
        paths[-1].write_bytes(Usd().single(Usd().plain(world), ".usda"))
    done = subprocess.run(
        [PYTHON, str(READER), *map(str, paths)], check=False, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return dict(zip(worlds(), json.loads(done.stdout.splitlines()[-1]), strict=True))


def near(ours, theirs, scale=None):
    ours = np.array(ours, dtype=float)
    return np.allclose(theirs, ours, rtol=0.0, atol=SINGLE * max(np.abs(ours).max(initial=0.0), scale or 1.0))


def moving(world):
    left_out = carriers(several(world))
    static = {body.name for bodies in trees(world).values() if is_static(bodies) for body in bodies}
    return [body for body in world.bodies if body.name not in left_out | static]


@pytest.mark.parametrize("name", LIBRARY)
def test_bodies_have_the_same_mass_properties_and_places(read, name):
    world, theirs = worlds()[name], read[name]["bodies"]
    paths, placed = places(world, False).bodies, poses(world)
    bodies = moving(world)
    assert theirs.keys() == {paths[body.name] for body in bodies}
    for body in bodies:
        actual, inertial = theirs[paths[body.name]], body.inertial
        assert actual["mass"] == pytest.approx(max(inertial.mass, SMALLEST_MASS), rel=SINGLE)
        assert near(inertial.centre_of_mass, actual["com"])
        xx, yy, zz, xy, xz, yz = inertial.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if not tensor.any():
            tensor = SMALLEST_MOMENT * np.eye(3)
        assert near(tensor, np.reshape(actual["inertia"], (3, 3)), scale=1e-9)
        assert near(placed[body.name].position, actual["place"][:3])
        x, y, z, w = actual["place"][3:]
        assert abs(np.dot((w, x, y, z), placed[body.name].quaternion)) == pytest.approx(1.0, abs=SINGLE)


@pytest.mark.parametrize("name", LIBRARY)
def test_joints_have_the_same_frames_axes_limits_and_drives(read, name):
    world, theirs = worlds()[name], read[name]["joints"]
    where = places(world, False)
    for body in moving(world):
        joint = body.joint
        if joint.kind == "free":
            continue
        their = theirs[where.joints[body.name]]
        assert their["type"] == KINDS[joint.kind]
        assert their["child"] == where.bodies[body.name]
        assert their["parent"] == (None if joint.parent is None else where.bodies[joint.parent])
        assert near(joint.origin.position, their["in_parent"][:3])
        if joint.kind not in ("hinge", "slide"):
            continue
        x, y, z, w = their["in_parent"][3:]
        (axis,) = their["axes"]
        assert near(frames.rotate(joint.origin.quaternion, joint.axis), frames.rotate((w, x, y, z), tuple(axis)))
        lower, upper = joint.position_limits or (-1e9, 1e9)
        if joint.position_limits is None:
            assert their["lower"][0] <= lower
            assert their["upper"][0] >= upper
        else:
            assert near((lower, upper), (their["lower"][0], their["upper"][0]))
        assert near(joint.spring_stiffness, their["stiffness"][0])
        assert near(joint.damping, their["damping"][0])


def test_axes_of_a_joint_are_in_the_order_of_the_spec(read):
    (joint,) = (joint for joint in read[SEVERAL]["joints"].values() if joint["axes"])
    assert joint["type"] == "D6"
    first = worlds()[SEVERAL].bodies[-1 - len(ROWS) + 1].joint
    x, y, z, w = joint["in_parent"][3:]
    for axis, (_, ours) in zip(joint["axes"], ROWS, strict=True):
        assert near(frames.rotate(first.origin.quaternion, tuple(ours)), frames.rotate((w, x, y, z), tuple(axis)))


@pytest.mark.parametrize("name", LIBRARY)
def test_shapes_have_the_same_sizes_and_friction(read, name):
    world, theirs = worlds()[name], read[name]["shapes"]
    where = places(world, False)
    laws = {pair.first: pair for pair in world.contact.pairs if pair.first == pair.second}
    seen = 0
    for body in world.bodies:
        for shape in body.shapes:
            base = f"{body.model}/" if body.name.startswith(f"{body.model}/") else ""
            their = theirs.get(f"{where.bodies[body.name]}/{shape.name.removeprefix(base)}")
            if their is None:
                assert not shape.collision, f"newton holds no shape {shape.name}"
                continue
            seen += 1
            if shape.kind == "mesh":
                assert their["type"] in HULLS
                assert their["points"] == len(shape.size) // 3
                continue
            assert their["type"] == SHAPES[shape.kind]
            if shape.kind != "plane":
                half = {"sphere": 1.0, "box": 0.5}.get(shape.kind)
                size = [half * value for value in shape.size] if half else [shape.size[0], 0.5 * shape.size[1]]
                assert near(size, their["scale"][: len(size)])
            if shape.collision:
                assert their["friction"] == pytest.approx(laws[shape.material].friction, rel=SINGLE)
    assert seen


@pytest.mark.parametrize("name", LIBRARY)
def test_gravity_is_the_same(read, name):
    gravity = np.ravel(read[name]["gravity"])
    ours = worlds()[name].physics.gravity
    assert near(ours, gravity if len(gravity) == 3 else (0.0, 0.0, gravity[0]))
