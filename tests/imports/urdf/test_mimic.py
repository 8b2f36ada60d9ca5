"""Where joints begin that others follow: a file has no initial positions, and 0 may be beyond what limits allow."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.load import load
from tests.imports.urdf.robots import SOLID, two_links

FOLLOWER = (
    '<link name="{0}">{1}</link><joint name="{0}" type="prismatic"><parent link="base"/><child link="{0}"/>'
    '<axis xyz="0 1 0"/><limit lower="{2[0]}" upper="{2[1]}" effort="1" velocity="1"/>'
    '<mimic joint="{3}" multiplier="{4}" offset="{5}"/></joint>'
)


def robot(local: tuple[float, float], *followers: tuple[object, ...]) -> str:
    """A slide with limits, and others: name, limits, whom it follows, ratio, offset."""
    limit = f'<axis xyz="0 1 0"/><limit lower="{local[0]}" upper="{local[1]}" effort="1" velocity="1"/>'
    more = "".join(FOLLOWER.format(name, SOLID, *rest) for name, *rest in followers)
    return two_links(limit, more=more, kind="prismatic")


def begin(text: str, folder) -> dict[str, float]:
    (folder / "r.urdf").write_text(text)
    world = load(folder / "r.urdf").resolve()
    return {body.joint.name: body.joint.position[0] for body in world.bodies if body.joint.position_limits}


@pytest.mark.parametrize(
    ("limits", "followers", "begins"),
    [
        pytest.param((0.015, 0.037), [("b", (-0.037, -0.015), "hinge", -1, 0)], (0.015, -0.015), id="fingers"),
        pytest.param((-0.5, -0.1), [("b", (0.3, 0.9), "hinge", -2, 0)], (-0.15, 0.3), id="below"),
        pytest.param((-1, 1), [("b", (0.5, 2), "hinge", 2, 0.1)], (0.2, 0.5), id="the follower alone"),
        pytest.param((-1, 1), [("b", (-1, 1), "hinge", 2, 0.1)], (0.0, 0.1), id="0 is inside"),
        pytest.param(
            (-1, 1), [("c", (0.4, 2), "b", 2, 0), ("b", (-1, 1), "hinge", -1, 0)], (-0.2, 0.4, 0.2), id="a chain"
        ),
    ],
)
def test_a_joint_that_leads_begins_where_all_are_within_their_limits(limits, followers, begins, tmp_path):
    found = begin(robot(limits, *followers), tmp_path)
    assert list(found.values()) == pytest.approx(begins, abs=1e-12)


def test_limits_without_such_a_position_are_refused_at_their_line(tmp_path):
    with pytest.raises(SpecError, match=r"r\.urdf:\d+:\d+: .*hinge wants b to begin beyond its limits"):
        begin(robot((0, 1), ("b", (0.5, 1), "hinge", -1, 0)), tmp_path)
