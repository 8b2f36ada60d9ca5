"""Bodies that a program moves, held to others that begin elsewhere than in the file's reference."""

from __future__ import annotations

import pytest

from simspec.imports.mjcf.compiled import FEATURES
from simspec.language.load import load
from tests.imports.mjcf.models import lost, read, written

pytestmark = pytest.mark.usefixtures("warm_readers")

LIFT = """<mujoco><compiler angle="radian"/><worldbody>
<body name="target" mocap="true" pos="{mocap}"><geom size=".1" mass="1" contype="0" conaffinity="0"/></body>
<body name="lift"><joint type="slide" axis="0 0 1" range=".1 1"/><geom size=".1"/>
<body name="hand" pos=".5 0 .2" euler="0 0 1"><joint axis="0 0 1" range="-1 1"/><geom size=".1"/></body></body></worldbody>
<equality>{loop}</equality></mujoco>"""


@pytest.mark.parametrize(
    "loop",
    [
        '<weld body1="target" body2="hand"/>',
        '<weld body1="hand" body2="target"/>',
        '<connect body1="target" body2="hand" anchor=".1 .2 .3"/>',
        '<connect body1="hand" body2="target" anchor=".1 .2 .3"/>',
    ],
)
def test_a_body_that_a_program_moves_begins_where_its_loop_is_closed(tmp_path, loop):
    """The reference of the lift is 0.1 m below its range: its load begins 0.1 m higher, and so does a body welded to it."""
    path = written(tmp_path, LIFT.format(loop=loop, mocap="0.3 0.2 0.1"))
    imported = read(path)
    assert not lost(imported)
    assert FEATURES["body.mocap_start"].reason in {entry.reason for entry in imported.accounts}
    (target,) = (body for body in load(path).resolve().bodies if body.name == "target")
    assert target.joint.origin.position == pytest.approx((0.3, 0.2, 0.2))


def test_a_loop_that_limits_open_is_reported(tmp_path):
    """Of two bodies on joints none can be put elsewhere."""
    text = LIFT.format(loop='<weld body1="target" body2="hand"/>', mocap="0 0 0").replace(' mocap="true"', "")
    (entry,) = lost(read(written(tmp_path, text)))
    assert entry.reason == FEATURES["equality"].reason
