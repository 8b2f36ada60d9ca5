"""The meaning of PyBullet's files and sidecar: additions are rejected with their line, never ignored."""

from __future__ import annotations

import dataclasses
import json
import re

import pytest

from simspec.compiler import target_of
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.dialects.pybullet.defects import URDF_ADDITIONS
from simspec.dialects.pybullet.dialect import PybulletDialect
from simspec.dialects.pybullet.sidecar import PybulletSidecar
from simspec.engines.pybullet.engine import PyBullet
from simspec.world.types import Hardness
from tests import worlds
from tests.files import write


def emit(world):
    return PybulletDialect().emit(world, target_of(world, PyBullet))


def read(files, folder):
    return PybulletDialect().read(write(files, folder))


@pytest.fixture(scope="module")
def files():
    return emit(worlds.limits_and_armature(armature=0.2, dry_friction=0.3))


def test_the_sidecar_has_its_declared_type(files):
    sidecar = PybulletSidecar.of(json.loads(files[SIDECAR]))
    assert sidecar.armature[0].armature == 0.2
    assert sidecar.plain() == json.loads(files[SIDECAR])


@pytest.mark.parametrize("row", [row for row in URDF_ADDITIONS if row.where in ("link", "joint", "robot", "contact")])
def test_additions_to_a_file_are_rejected(row, files, tmp_path):
    name = next(name for name in files if name.endswith(".urdf") and "<limit" in files[name])
    value = row.value.replace("{link[0]}", "link0").replace("{joint[0]}", "joint0").replace("{link[1]}", "link1")
    text = files[name]
    at = re.search(rf"<{row.where}\b[^>]*>", text)
    assert at is not None
    if row.name:
        changed = text[: at.end() - 1] + f' {row.name}="{value}"' + text[at.end() - 1 :]
    else:
        end = text.index(f"</{row.where}>", at.end())
        changed = text[:end] + value + text[end:]
    with pytest.raises(ValueError, match=rf"{name}:\d+: |has the shapes|the links of copies"):
        read({**files, name: changed}, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<lateral_friction value="', '<lateral_friction value="x', "should be a finite number"),
        ("<rolling_friction", "<stiffness", "that is repeated|<contact> has no <rolling_friction>"),
        ('type="revolute"', 'type="planar"', "type='planar' of joint"),
        ("</contact>", '<damping value="1"/></contact>', "<contact> has no <stiffness>"),
        ("<contact>", '<contact margin="1">', "that simspec does not write"),
    ],
)
def test_damaged_files_are_rejected_with_their_location(old, new, said, files, tmp_path):
    name = next(name for name in files if name.endswith(".urdf") and old in files[name])
    with pytest.raises(ValueError, match=rf"{name}:\d+: .*({said})"):
        read({**files, name: files[name].replace(old, new, 1)}, tmp_path)


def test_files_that_no_instance_names_are_refused(files, tmp_path):
    name = next(name for name in files if name.endswith(".urdf"))
    with pytest.raises(ValueError, match=r"names no instance of more\.urdf"):
        read({**files, "more.urdf": files[name]}, tmp_path)


def test_a_pair_has_half_the_stiffness_and_twice_the_damping_of_its_links(tmp_path):
    world = worlds.spheres(2)
    soft = Hardness("stiffness", stiffness=1e4, damping=10.0)
    pairs = tuple(dataclasses.replace(pair, hardness=soft) for pair in world.contact.pairs)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    files = emit(world)
    assert '<stiffness value="20000"/>' in files["ball_0.urdf"]
    assert '<damping value="5"/>' in files["ball_0.urdf"]
    assert {shape.surfaces[0].hardness for body in read(files, tmp_path).bodies for shape in body.shapes} == {soft}


def test_the_limits_that_pybullet_takes_for_none(tmp_path):
    files = emit(worlds.world(worlds.tree(["slide"], 1)))
    name = next(name for name in files if name.endswith(".urdf"))
    assert 'lower="1" upper="-1"' in files[name]
    assert read(files, tmp_path).bodies[0].joint.position_limits is None
    for old, new, limits in (
        ('lower="1" upper="-1"', 'upper="2"', (0.0, 2.0)),
        ('lower="1" upper="-1"', 'lower="-2"', (-2.0, -1.0)),
    ):
        changed = read({**files, name: files[name].replace(old, new)}, tmp_path)
        assert changed.bodies[0].joint.position_limits == limits
