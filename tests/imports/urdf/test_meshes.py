"""Meshes of a robot file: found, named in the spec, copied on request; missing ones; paths that lead out."""

import os

import pytest

from simspec.errors import SpecError
from simspec.imports.urdf.importer import UrdfImporter
from simspec.imports.writing import copies, from_folder, spec_text
from simspec.language.foreign import Fate, ImportOptions, LossSeverity
from simspec.language.load import load
from tests.imports.urdf.robots import SOLID, read, refused, two_links, watched
from tests.meshes.solids import box, stl

pytestmark = pytest.mark.usefixtures("warm_readers")


def mesh(tag: str, name: str, more: str = "") -> str:
    return f'<{tag}><geometry><mesh filename="{name}" {more}/></geometry></{tag}>'


@pytest.fixture
def folder(tmp_path):
    package = tmp_path / "arm_description"
    (package / "meshes").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm_description</name></package>")
    (package / "urdf").mkdir()
    (package / "meshes" / "box.stl").write_bytes(stl(*box(0.1, 0.2, 0.3)))
    return package


def write(folder, arm: str):
    file = folder / "urdf" / "arm.urdf"
    file.write_text(two_links(arm=SOLID + arm))
    return file


NAMES = (
    "package://arm_description/meshes/box.stl",
    "../meshes/box.stl",
    "file://../meshes/box.stl",
    "$(find arm_description)/meshes/box.stl",
)


@pytest.mark.parametrize("name", NAMES)
def test_a_mesh_is_found_by_every_kind_of_path(folder, name):
    world = load(write(folder, mesh("collision", name))).resolve()
    (shape,) = world.bodies[1].shapes
    assert (shape.kind, len(shape.size)) == ("mesh", 24)


def test_a_package_path_of_a_file_alone_is_the_file_next_to_it(folder):
    (folder / "urdf" / "box.stl").write_bytes((folder / "meshes" / "box.stl").read_bytes())
    world = load(write(folder, mesh("collision", "package://box.stl"))).resolve()
    assert world.bodies[1].shapes[0].kind == "mesh"


def test_scale_and_the_same_mesh_to_see_and_to_touch(folder):
    both = mesh("visual", NAMES[1], 'scale="2 2 2"') + mesh("collision", NAMES[1], 'scale="2 2 2"')
    file = write(folder, both + mesh("visual", NAMES[1], 'scale="1 -1 1"'))
    shapes = UrdfImporter().read(file, "arm.urdf", ImportOptions()).data["model"]["bodies"]["arm"]["shapes"]
    assert shapes == [
        {"mesh": {"file": NAMES[1], "scale": 2}},
        {"mesh": {"file": NAMES[1], "scale": [1, -1, 1]}, "collision": False},
    ]


def test_the_written_spec_names_the_files_from_where_it_stands_or_copies(folder):
    file = write(folder, mesh("collision", NAMES[0]))
    imported = UrdfImporter().read(file, "arm.urdf", ImportOptions(project=folder))
    text = spec_text(imported, "arm.urdf", from_folder(imported, folder))
    assert "{file: meshes/box.stl}" in text
    (folder / "arm.yaml").write_text(text)
    assert load(folder / "arm.yaml").resolve() == load(file).resolve()
    sources, called = copies(imported, folder / "own", folder)
    assert (sources, called) == ({"box.stl": folder / "meshes" / "box.stl"}, {NAMES[0]: "own/box.stl"})


def test_a_missing_mesh_is_a_defect_where_it_collides_and_a_loss_where_it_is_seen(tmp_path):
    text = two_links(arm=SOLID + mesh("visual", "gone.stl") + mesh("visual", "gone.wrl"))
    lost = [account for account in read(text, tmp_path).accounts if account.fate is Fate.LOST]
    assert [account.severity for account in lost] == [LossSeverity.APPEARANCE] * 2
    text = two_links(arm=SOLID + mesh("collision", "package://gone/a.stl"))
    (problem,) = refused(text, tmp_path)
    assert "the package 'gone' is not found" in problem
    assert "--repair missing-meshes" in problem
    imported = read(text, tmp_path, "missing-meshes")
    assert "shapes" not in imported.data["model"]["bodies"]["arm"]
    assert [account.severity for account in imported.losses()] == [LossSeverity.PHYSICS]


def test_a_mesh_that_cannot_be_read_is_as_a_missing_mesh(tmp_path):
    (tmp_path / "bad.stl").write_bytes(b"solid nothing")
    (problem,) = refused(two_links(arm=SOLID + mesh("collision", "bad.stl")), tmp_path)
    assert "robot.urdf:3" in problem
    assert read(two_links(arm=SOLID + mesh("visual", "bad.stl")), tmp_path).losses()


def test_a_flat_mesh_is_an_empty_shape(tmp_path):
    vertices, triangles = box(1, 1, 1)
    (tmp_path / "flat.stl").write_bytes(stl(vertices * [1, 1, 0], triangles))
    text = two_links(arm=SOLID + mesh("collision", "flat.stl"))
    (problem,) = refused(text, tmp_path, "missing-meshes")
    assert "it has no volume" in problem
    assert "--repair empty-shapes" in problem
    (repair,) = read(text, tmp_path, "empty-shapes").repairs
    assert (repair.rule, repair.location.line) == ("empty-shapes", 3)


OUTSIDE = (
    "../secret.stl",
    "file:///{0}/secret.stl",
    "{0}/secret.stl",
    "package://inside/../../secret.stl",
    "package://../secret.stl",
    "package://link.stl",
    "$(find ..)/secret.stl",
    "link.stl",
    "http://127.0.0.1/x.stl",
)


@pytest.mark.parametrize("tag", ["visual", "collision"])
@pytest.mark.parametrize("name", OUTSIDE)
def test_no_path_leads_out_of_the_project(tmp_path, name, tag):
    project = tmp_path / "project"
    (project / "inside").mkdir(parents=True)
    (tmp_path / "secret.stl").write_bytes(stl(*box(1, 1, 1)))
    os.symlink(tmp_path / "secret.stl", project / "link.stl")
    file = project / "r.urdf"
    file.write_text(two_links(arm=SOLID + mesh(tag, name.format(tmp_path))))
    opened: list[str] = []
    with watched(opened):
        try:
            imported = UrdfImporter().read(file, "r.urdf", ImportOptions(project=project))
        except SpecError as error:
            imported, problems = None, error.problems
    assert not any("secret" in path for path in opened)
    if imported is None:
        assert all(problem.location is not None for problem in problems)
    else:  # a package or a file that is not there, of what is only seen
        assert tag == "visual"
        assert not imported.files


def test_a_hull_of_more_vertices_than_a_spec_may_have_keeps_some_of_them(tmp_path, monkeypatch):
    """The limit and what is kept are made small, so that a ball of 162 vertices is too much."""
    import trimesh

    from simspec.imports import draft as meshes

    monkeypatch.setattr(meshes, "MOST_VERTICES", 100)
    monkeypatch.setattr(meshes, "FEWER", 50)
    (tmp_path / "ball.stl").write_bytes(trimesh.creation.icosphere(2, 0.1).export(file_type="stl"))
    shapes = "".join(
        f'<{tag}><origin xyz="0 0 {place}"/><geometry><mesh filename="ball.stl"/></geometry></{tag}>'
        for tag, place in (("collision", 0), ("visual", 1))
    )
    imported = read(two_links(arm=SOLID + shapes), tmp_path)
    (shape,) = imported.data["model"]["bodies"]["arm"]["shapes"]
    assert shape["mesh"] == {"file": "ball.stl", "max_vertices": 50}
    (given,) = [account for account in imported.losses() if account.what.endswith("@filename")]
    assert "50 of the hull's 162 vertices" in given.reason
    assert given.severity == "information"
    assert any(account.severity == "appearance" for account in imported.losses())
