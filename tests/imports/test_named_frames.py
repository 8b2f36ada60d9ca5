"""Named frames through files of other languages, and places that other tools have named."""

from __future__ import annotations

import re

import numpy as np
import pytest

import simspec
from simspec.formats.mjcf.format import Mjcf
from simspec.formats.sdf.format import Sdf
from simspec.formats.urdf.format import Urdf
from simspec.formats.usd.format import Usd
from simspec.language.load import load
from simspec.world import frames
from simspec.world.kinematics import poses
from simspec.world.types import World

pytestmark = pytest.mark.usefixtures("warm_readers")

LIGHT = "{mass: 0.2, centre_of_mass: [0.02, 0, 0.01], inertia: {principal: [0.001, 0.001, 0.001]}"
TEXT = f"""simspec: 1
name: arm
model:
  bodies:
    base: {{fixed: true, mass: 1, inertia: {{principal: [1, 1, 1]}}}}
    link: {LIGHT}, parent: base, joint: {{type: hinge, axis: [0, 1, 0], origin: {{xyz: [0, 0, 0.3]}}}}}}
  frames:
    base_link: {{body: base, pose: {{xyz: [0, 0, 0.01]}}}}
    tip: {{body: link, pose: {{xyz: [0.5, 0, 0.1], rpy: [0.1, 90 deg, 0]}}}}
"""


def where(world: World) -> dict[str, tuple[str, np.ndarray]]:
    at = poses(world)
    named = {frame.name: (frame.body, frames.compose(at[frame.body], frame.pose)) for frame in world.frames}
    return {name: (body, np.array([*place.position, *place.quaternion])) for name, (body, place) in named.items()}


@pytest.mark.parametrize("kind", [Mjcf, Sdf, Usd])
def test_frames_survive_files_of_other_languages(kind, tmp_path):
    (tmp_path / "arm.yaml").write_text(TEXT)
    world = load(tmp_path / "arm.yaml").resolve()
    files = kind().plain(world).files
    for path, text in files.items():
        model = re.search("<model.*</model>", text, re.DOTALL)  # of SDF alone: a file of a world is a scenario
        (tmp_path / path).write_text(f'<sdf version="1.9">{model[0]}</sdf>' if model else text)
    name = next(path for path in files if path.rpartition(".")[2] in ("xml", "sdf", "usda"))
    scene = {"simspec": 1, "name": "scene", "models": {"arm": {"use": name}}}
    back = simspec.Spec.from_data(scene, folder=tmp_path).resolve()
    found, wanted = where(back), where(world)
    plain = {name.rpartition("/")[2]: value for name, value in found.items()}
    assert plain.keys() == wanted.keys()
    for name, (body, place) in wanted.items():
        assert plain[name][0].rpartition("/")[2] == body
        np.testing.assert_allclose(plain[name][1], place, atol=1e-12)


def test_frames_are_links_of_urdf(tmp_path):
    (tmp_path / "arm.yaml").write_text(TEXT)
    (text,) = (
        text for path, text in Urdf().plain(load(tmp_path / "arm.yaml").resolve()).files.items() if ".urdf" in path
    )
    assert '<link name="tip">' in text or '<link name="tip"/>' in text
    (tmp_path / "arm.urdf").write_text(text)
    back = simspec.Spec.from_data(
        {"simspec": 1, "name": "scene", "models": {"arm": {"use": "arm.urdf", "fixed": True}}}, folder=tmp_path
    ).resolve()
    tip = next(body for body in back.bodies if body.name == "arm/tip")
    assert (tip.joint.kind, tip.joint.parent, tip.inertial.mass) == ("fixed", "arm/link", 0.0)


def test_sites_without_a_name_and_of_the_world_are_reported(tmp_path):
    (tmp_path / "arm.xml").write_text(
        '<mujoco><default><site size="0.02"/></default><worldbody><site name="goal"/><body name="hand">'
        '<joint name="j" axis="0 1 0" pos="0.1 0 0"/><geom size="0.1"/>'
        '<site name="hand" pos="0.3 0 0" rgba="1 0 0 1"/><site pos="1 0 0"/></body></worldbody></mujoco>'
    )
    spec = simspec.Spec.from_data({"simspec": 1, "name": "s", "models": {"arm": {"use": "arm.xml"}}}, folder=tmp_path)
    (frame,) = spec.resolve().frames
    assert (frame.name, frame.body) == ("arm/hand_2", "arm/hand")
    np.testing.assert_allclose(frame.pose.position, (0.2, 0, 0))  # from the joint, where the body's frame is
