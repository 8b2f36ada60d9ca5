"""Meshes of SDF: found from the file that names them, also through includes; missing ones are defects of collisions only."""

from __future__ import annotations

import pytest
import trimesh

from simspec.errors import SpecError
from simspec.language.load import load
from tests.imports.sdf.texts import imported, link, lost, model
from tests.meshes.solids import box, obj

pytestmark = pytest.mark.usefixtures("warm_readers")


def shape(tag, uri, more="", words=""):
    geometry = f"<geometry><mesh {words}><uri>{uri}</uri>{more}</mesh></geometry>"
    return f"<{tag} name='{tag}'>{geometry}</{tag}>"


def test_a_collision_and_a_visual_of_the_same_file_are_the_same_shape(tmp_path):
    (tmp_path / "block.obj").write_text(obj(*box(1, 2, 3)))
    scaled = "<scale>2 1 -1</scale>"
    text = model(link("base", shape("collision", "block.obj", scaled) + shape("visual", "block.obj", scaled)))
    result = imported(text, tmp_path)
    assert result.data["model"]["bodies"]["base"]["shapes"] == [
        {"name": "collision", "mesh": {"file": "block.obj", "scale": [2, 1, -1]}}
    ]
    assert not lost(result)
    (body,) = load(tmp_path / "robot.sdf").resolve().bodies
    assert body.shapes[0].kind == "mesh"
    assert body.shapes[0].pose.position == pytest.approx((1.0, 1.0, -1.5))


def test_equal_names_in_two_folders_are_two_files(tmp_path):
    for size, name in enumerate(("left", "right"), start=1):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "m.obj").write_text(obj(*box(size, size, size)))
        (folder / "part.sdf").write_text(model(link("l", shape("collision", "m.obj"))).replace('"robot"', f'"{name}"'))
    includes = "".join(f"<include><uri>{name}/part.sdf</uri></include>" for name in ("left", "right"))
    result = imported(model("<static>true</static>" + includes), tmp_path)
    assert sorted(path.parent.name for path in result.files.values()) == ["left", "right"]
    first, second = load(tmp_path / "robot.sdf").resolve().bodies
    assert (first.shapes[0].pose.position[0], second.shapes[0].pose.position[0]) == pytest.approx((0.5, 1.0))


def test_files_that_are_not_there(tmp_path):
    seen = imported(model(link("base", shape("visual", "m.obj"))), tmp_path)
    assert "shapes" not in seen.data["model"]["bodies"]["base"]
    assert {severity for severity, _ in lost(seen).values()} == {"appearance"}
    text = model(link("base", shape("collision", "m.obj")))
    with pytest.raises(SpecError, match="missing-meshes"):
        imported(text, tmp_path)
    repaired = imported(text, tmp_path, repair=("missing-meshes",))
    assert [repair.rule for repair in repaired.repairs] == ["missing-meshes"]
    assert {severity for severity, _ in lost(repaired).values()} == {"physics"}


def test_files_that_are_not_solid(tmp_path):
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    both = shape("visual", "m.obj") + shape("collision", "m.obj", "<scale>2 2 2</scale>")
    result = imported(model(link("base", both)), tmp_path, repair=("missing-meshes",))
    assert "shapes" not in result.data["model"]["bodies"]["base"]
    assert {severity for severity, _ in lost(result).values()} == {"physics", "appearance"}
    assert [repair.rule for repair in result.repairs] == ["missing-meshes"]


def test_pieces_and_paths_from_the_root(tmp_path):
    (tmp_path / "block.obj").write_text(obj(*box(1, 2, 3)))
    text = model(link("base", shape("collision", "/block.obj", words="optimization='convex_decomposition'")), "1.11")
    result = imported(text, tmp_path)
    (said,) = result.data["model"]["bodies"]["base"]["shapes"]
    assert said["mesh"] == {"file": "block.obj", "as": "pieces"}
    reasons = [account.reason for account in result.accounts if account.what.endswith("/uri")]
    assert reasons == ["relative to the file: there is no such path from the root"]


def test_the_surface_of_a_mesh_is_not_its_hull(tmp_path):
    (tmp_path / "block.obj").write_text(obj(*box(1, 2, 3)))
    concave = shape("collision", "block.obj").replace("<collision", "<collision concave='yes'")
    assert {severity for severity, _ in lost(imported(model(link("base", concave)), tmp_path)).values()} == {"physics"}


def test_a_collada_file_has_the_axes_that_it_has_and_its_unit(tmp_path):
    trimesh.Trimesh(*box(1, 2, 3), process=False).export(tmp_path / "m.dae")
    text = (tmp_path / "m.dae").read_text().replace("<up_axis>Y_UP</up_axis>", "")
    asset = '<asset><unit meter="0.1"/><up_axis>Y_UP</up_axis>'
    start, end = text.index("<asset>"), text.index("</asset>")
    (tmp_path / "m.dae").write_text(text[:start] + asset + text[end:])
    result = imported(model(link("base", shape("collision", "m.dae"))), tmp_path)
    assert result.data["model"]["bodies"]["base"]["shapes"][0]["mesh"] == {"file": "m.dae", "up": "z"}
    (body,) = load(tmp_path / "robot.sdf").resolve().bodies
    assert body.shapes[0].pose.position == pytest.approx((0.05, 0.1, 0.15))
