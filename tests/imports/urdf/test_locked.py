"""Joints whose limits leave them one position: fixed there."""

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.language.foreign import Fate
from simspec.language.load import load
from tests.imports.urdf.robots import SOLID, read, two_links

WELD = '<link name="world"/><joint name="w" type="fixed"><parent link="world"/><child link="base"/></joint>'
ORIGIN = '<origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/>'
NEXT = (
    f'<link name="tip">{SOLID}</link><joint name="next" type="{{kind}}"><parent link="arm"/><child link="tip"/>{ORIGIN}'
    '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>{inside}</joint>'
)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("at", [0.0, -0.4])
def test_bodies_are_where_another_reader_puts_them_at_that_position(kind, at, tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    inside = f'{ORIGIN}<axis xyz="1 -2 0.5"/><limit lower="{at}" upper="{at}" effort="9" velocity="2"/><dynamics damping="3"/>'
    text = two_links(inside, more=WELD + NEXT.format(kind="revolute", inside=""), kind=kind)
    (tmp_path / "r.urdf").write_text(text)
    world = load(tmp_path / "r.urdf").resolve()
    arm, tip = world.bodies[-2:]
    assert (arm.joint.kind, tip.joint.kind) == ("fixed", "hinge")
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "r.urdf"))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array([at, 0.7]))
    poses = Oracle(world).body_poses(np.array([0.7]))
    for row, name in ((-2, "arm"), (-1, "tip")):
        assert poses[row][:3] == pytest.approx(data.oMf[model.getFrameId(name)].translation, abs=1e-14)


def test_losses_of_a_joint_that_cannot_move_are_reported(tmp_path):
    inside = (
        '<axis xyz="0 0 1"/><limit lower="0" upper="0" effort="9" velocity="2"/><dynamics damping="3" friction="1"/>'
    )
    imported = read(two_links(inside, kind="revolute"), tmp_path)
    assert imported.data["model"]["bodies"]["arm"]["joint"] == {"name": "hinge", "type": "fixed"}
    fates = {
        account.what.rpartition("/@")[2]: account.fate for account in imported.accounts if "[hinge]" in account.what
    }
    assert {fates[name] for name in ("lower", "upper", "xyz")} == {Fate.CARRIED}
    assert {fates[name] for name in ("effort", "velocity", "damping", "friction")} == {Fate.UNUSED}


@pytest.mark.parametrize("leads", [True, False])
def test_a_joint_that_leads_or_follows_stays(leads, tmp_path):
    """Its leader, or its follower, depends on it."""
    locked = '<axis xyz="0 0 1"/><limit lower="0.2" upper="0.2" effort="9" velocity="2"/>'
    follow = '<mimic joint="{}" multiplier="2"/>'
    text, other = ("", follow.format("hinge")) if leads else (follow.format("next"), "")
    imported = read(
        two_links(locked + text, more=NEXT.format(kind="revolute", inside=other), kind="revolute"), tmp_path
    )
    assert imported.data["model"]["bodies"]["arm"]["joint"]["type"] == "hinge"
    assert imported.data["model"]["constraints"]
