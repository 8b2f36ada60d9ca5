"""Frames that PhysX stores with little round-off."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.engines.physx.engine import PhysX
from simspec.engines.physx.links import to_x
from simspec.engines.physx.roundings import ORDERS, joint_turn, principal_order
from simspec.engines.physx.units import imported
from simspec.world import frames

pytestmark = pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")
AXIS = frames.direction((0.3, -0.5, 0.8))
ORIGIN = frames.from_axis_angle(frames.direction((0.2, 0.9, -0.4)), 1.1)


def lengths_off(sapien, turn):
    """How far lengths of the frames are off that PhysX stores of a joint, in parent and child."""
    parent = sapien.physx.PhysxArticulationLinkComponent()
    child = sapien.physx.PhysxArticulationLinkComponent(parent)
    child.joint.pose_in_parent = sapien.Pose([0.0] * 3, frames.multiply(ORIGIN, turn))
    child.joint.pose_in_child = sapien.Pose([0.0] * 3, turn)
    stored = (child.joint.pose_in_parent, child.joint.pose_in_child)
    return max(abs(np.linalg.norm(np.array(pose.q, dtype=float)) - 1.0) for pose in stored)


def test_the_frame_of_a_joint_keeps_its_axis_and_is_stored_better():
    sapien = imported()
    none = (1.0, 0.0, 0.0, 0.0)
    found = joint_turn(sapien, none, none, ORIGIN, to_x(AXIS))
    assert frames.rotate(found, (1.0, 0.0, 0.0)) == pytest.approx(AXIS, abs=1e-15)
    plain = [
        lengths_off(sapien, frames.multiply(to_x(AXIS), frames.from_axis_angle((1.0, 0.0, 0.0), 0.1 * number)))
        for number in range(20)
    ]
    assert lengths_off(sapien, found) < 2e-8 < np.median(plain), "were all stored as well, there would be no choice"


def test_orders_of_principal_axes_leave_the_tensor():
    moments = np.array([1.0, 2.0, 3.0])
    for order, turn in ORDERS:
        turned = np.array(frames.matrix(turn))
        assert turned @ np.diag(moments[list(order)]) @ turned.T == pytest.approx(np.diag(moments), abs=1e-14)
    order, axes = principal_order(imported(), ORIGIN)
    turn = frames.multiply(frames.conjugate(ORIGIN), axes)
    assert turn == pytest.approx(dict(ORDERS)[order], abs=1e-14)
