"""Links without mass between joints that move: several joints of one body."""

import numpy as np
import pytest

from simspec.language.load import load
from tests.imports.urdf.robots import SOLID, read, refused


def robot(*kinds: str, empty: str = "", more: str = "") -> str:
    """A base, a link between each two joints of these kinds, and an arm."""
    names = ["base", *(f"between{number}" for number in range(1, len(kinds))), "arm"]
    links = "".join(f'<link name="{name}">{SOLID if name in ("base", "arm") else empty}</link>' for name in names)
    axes = ("1 0 0", "0 1 0", "0 0 1", "1 0 0", "0 1 0", "0 0 1")
    joints = "".join(
        f'<joint name="j{number}" type="{kind}"><parent link="{names[number]}"/><child link="{names[number + 1]}"/>'
        f'<origin xyz="0.1 0 {number}" rpy="0.3 0 0"/><axis xyz="{axes[number % 6]}"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for number, kind in enumerate(kinds)
    )
    return f'<robot name="r">{links}{joints}{more}</robot>'


def test_a_chain_is_a_body_with_several_joints(tmp_path):
    imported = read(robot("revolute", "prismatic", "continuous"), tmp_path)
    bodies = imported.data["model"]["bodies"]
    assert list(bodies) == ["base", "arm"]
    assert [(joint["name"], joint["type"]) for joint in bodies["arm"]["joints"]] == [
        ("j0", "hinge"),
        ("j1", "slide"),
        ("j2", "hinge"),
    ]
    assert bodies["arm"]["parent"] == "base"
    said = {account.what: account.reason for account in imported.accounts}
    assert said["link[between1]/@name"] == "called arm.j0 in the world"
    assert "between1, between2" in imported.comments["model.bodies.arm.joints"]


def test_a_chain_moves_as_the_file_says(tmp_path):
    """The mass matrix is that of another reader of the same file."""
    pinocchio = pytest.importorskip("pinocchio")
    from simspec.dynamics.oracle import Oracle

    text = robot("revolute", "prismatic", "revolute")
    weld = '<link name="world"/><joint name="w" type="fixed"><parent link="world"/><child link="base"/></joint></robot>'
    (tmp_path / "r.urdf").write_text(text.replace("</robot>", weld))
    world = load(tmp_path / "r.urdf").resolve()
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "r.urdf"))
    q = np.array([0.3, -0.2, 0.5])
    expected = pinocchio.crba(model, model.createData(), q)
    assert Oracle(world).mass_matrix(q) == pytest.approx(np.triu(expected) + np.triu(expected, 1).T, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (robot(*["revolute"] * 8), "too many joints"),
        (robot("revolute", "revolute", empty='<visual><geometry><sphere radius="1"/></geometry></visual>'), "seen"),
        (
            robot(
                "revolute",
                "revolute",
                more=f'<link name="side">{SOLID}</link><joint name="s" type="continuous"><parent link="between1"/>'
                '<child link="side"/></joint>',
            ),
            "two joints lead away",
        ),
    ],
)
def test_other_chains_stay_defects(tmp_path, text, why):
    assert all("moves no mass" in problem for problem in refused(text, tmp_path)), why
