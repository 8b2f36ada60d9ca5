"""Meshes of a spec: files found where they may be, shapes and masses of the world, errors and warnings with their places."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from simspec.errors import SpecError
from simspec.language.load import Spec, load
from simspec.resolve import shapes as meshes
from simspec.world import frames
from simspec.world.canonical import canonical_json, from_plain, to_plain
from simspec.world.shapes import SHAPES
from simspec.world.types import World
from tests.meshes.solids import box, l_profile, obj, stl

pytestmark = pytest.mark.usefixtures("warm_readers")


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    """A project with an L of volume 3 and an open box, and a cache folder of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "project"
    (folder / "meshes").mkdir(parents=True)
    (folder / "pyproject.toml").touch()
    (folder / "meshes" / "l.obj").write_text(obj(*l_profile()))
    points, faces = box(1.0, 2.0, 3.0)
    (folder / "meshes" / "open.stl").write_bytes(stl(points, faces[:-1]))
    (folder / "meshes" / "box.stl").write_bytes(stl(points, faces))
    (tmp_path / "outside.stl").write_bytes(stl(points, faces))
    return folder


def spec(folder, **body):
    return Spec.from_data({"name": "s", "contact": {"materials": {"wood": {}}}, "bodies": {"one": body}}, folder=folder)


def body_of(folder, **body):
    (entry,) = spec(folder, **body).resolve().bodies
    return entry


def problems(folder, **body):
    with pytest.raises(SpecError) as caught:
        spec(folder, **body).resolve()
    return caught.value.problems


def test_a_mesh_stands_where_the_spec_puts_its_file(files):
    place = {"xyz": [1, 2, 3], "rpy": ["90 deg", 0, 0]}
    mesh = {"file": "meshes/l.obj", "unit": "dm", "scale": [1, 1, -1]}
    body = body_of(files, shapes=[{"mesh": mesh, "pose": place, "density": 1000}])
    (shape,) = body.shapes
    assert (shape.name, shape.kind, shape.material) == ("one_0", "mesh", "wood")
    points = l_profile()[0] * 0.1 * (1, 1, -1)
    turned = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)  # by 90° about x
    stood = turned + np.array([1, 2, 3])
    drawn = np.random.default_rng(1).normal(size=(300, 3))
    n = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    axes = np.array(frames.matrix(shape.pose.quaternion))
    reach = SHAPES["mesh"].support(shape.size, n @ axes) + n @ np.array(shape.pose.position)
    np.testing.assert_allclose(reach, (stood @ n.T).max(axis=0), atol=1e-14)
    assert body.inertial.mass == pytest.approx(3.0, rel=1e-14)
    assert body.inertial.centre_of_mass == pytest.approx((1 + 0.25 / 3, 2.05, 3 + 0.25 / 3), rel=1e-14)


def test_masses_are_of_the_surface_or_of_the_hull(files):
    def mass(**more):
        mesh = {"file": "meshes/l.obj", **more}
        return body_of(files, shapes=[{"mesh": mesh, "density": 10}]).inertial

    assert mass().mass == pytest.approx(30.0, rel=1e-14)
    assert mass(mass_from="hull").mass == pytest.approx(35.0, rel=1e-14)
    body = body_of(files, mass=30, shapes=[{"mesh": {"file": "meshes/l.obj"}}])
    assert body.inertial.mass == 30
    assert body.inertial.inertia == pytest.approx(mass().inertia, rel=1e-14)
    # with a sphere of the same volume it has half of the mass
    ball = {"sphere": {"radius": (9 / 4 / np.pi) ** (1 / 3)}, "pose": {"xyz": [9, 0, 0]}}
    both = body_of(files, mass=60, shapes=[{"mesh": {"file": "meshes/l.obj"}}, ball])
    assert both.inertial.centre_of_mass == pytest.approx(((5 / 6 + 9) / 2, 5 / 12, 1 / 4), rel=1e-12)


def test_pieces_stand_behind_so_that_indices_stay(files):
    shapes = [{"mesh": {"file": "meshes/l.obj", "as": "pieces"}, "name": "cup"}, {"sphere": {"radius": 1}}]
    if find_spec("coacd") is None:
        (problem,) = problems(files, mass=3, shapes=shapes)
        assert "pip install 'simspec-physics[convex]'" in problem.message
        return
    body = body_of(files, mass=3, shapes=shapes)
    assert [shape.name for shape in body.shapes] == ["cup", "one_1", "cup_piece_1"]
    alone = body_of(files, mass=3, shapes=shapes[:1])
    assert alone.inertial.centre_of_mass == pytest.approx((5 / 6, 5 / 6, 1 / 2), rel=1e-14)


def test_meshes_of_models_arrays_and_placements(files):
    model = files / "model.yaml"
    model.write_text(
        "simspec: 1\nname: m\nmodel:\n  bodies:\n    a:\n      shapes:\n"
        "        - {name: cup, mesh: {file: meshes/l.obj}, density: 1, material: wood}\n"
        "contact: {materials: {wood: {}}}\n"
    )
    data = {
        "name": "s",
        "models": {
            "x": {"use": "model.yaml", "array": {"grid": [2, 1, 1], "spacing": 5}},
            "y": {"bodies": {"b": {"shapes": [{"mesh": {"file": "meshes/box.stl"}, "density": 1}]}}},
        },
    }
    world = Spec.from_data(data, folder=files).resolve()
    assert [shape.name for body in world.bodies for shape in body.shapes] == ["x_0/cup", "x_1/cup", "y/b_0"]
    assert world.bodies[0].shapes[0].size == world.bodies[1].shapes[0].size
    assert load(model).resolve().bodies[0].shapes[0].size == world.bodies[0].shapes[0].size


@pytest.mark.parametrize(
    ("mesh", "where", "said"),
    [
        ({"file": "meshes/no.stl"}, "mesh.file", "no such file"),
        ({"file": "../outside.stl"}, "mesh.file", "leaves the project folder"),
        ({"file": "meshes"}, "mesh.file", "not a file of triangles"),
        ({"file": "meshes/l.step"}, "mesh.file", "not a file of triangles"),
        ({"file": "meshes/l.obj", "scale": [1, 0, 1]}, "mesh.scale", "factor of 0"),
        ({"file": "meshes/l.obj", "scale": 0}, "mesh.scale", "factor of 0"),
        ({"file": "meshes/l.obj", "scale": [1, 1]}, "mesh.scale", "expected a list of 3"),
        ({"file": "meshes/l.obj", "unit": "kg"}, "mesh.unit", "not an allowed word"),
        ({"file": "meshes/l.obj", "as": "surface"}, "mesh.as", "surface of triangles is not supported yet"),
        ({"file": "meshes/l.obj", "as": "mesh"}, "mesh.as", "not an allowed word"),
        ({"file": "meshes/l.obj", "max_vertices": 3}, "mesh.max_vertices", "out of range"),
        ({"file": "meshes/l.obj", "units": "mm"}, "mesh.units", "unit"),
    ],
)
def test_errors_are_reported_at_their_location(files, mesh, where, said):
    found = problems(files, shapes=[{"mesh": mesh}], mass=1)
    assert any(p.path.endswith(where) and (said in p.message or said in str(p.hint)) for p in found), found


def test_a_surface_that_is_not_closed_needs_a_word(files):
    shapes = [{"mesh": {"file": "meshes/open.stl"}}]
    for body in ({"mass": 1, "shapes": shapes}, {"shapes": [{**shapes[0], "density": 1}]}):
        (problem,) = problems(files, **body)
        assert problem.message == "the mass of this mesh cannot be computed: it has 3 open edges"
        assert "mass_from: hull" in problem.hint
        assert problem.path == "bodies.one.shapes.0.mesh.file"
    hull = [{"mesh": {"file": "meshes/open.stl", "mass_from": "hull"}, "density": 1}]
    assert body_of(files, shapes=hull).inertial.mass == pytest.approx(6.0, rel=1e-14)
    # a body with an inertia, or with another shape that has all the mass, needs no volume of the mesh
    inertia = {"principal": [1, 1, 1]}
    assert body_of(files, mass=1, inertia=inertia, shapes=shapes).inertial.mass == 1
    ball = {"sphere": {"radius": 1}, "density": 1}
    assert body_of(files, shapes=[{**shapes[0], "density": 0}, ball]).inertial.centre_of_mass == (0.0, 0.0, 0.0)
    seen = [{**shapes[0], "collision": False}, {"sphere": {"radius": 1}}]
    assert body_of(files, mass=1, shapes=seen).inertial.mass == 1


def test_a_damaged_file_is_reported_at_its_location(files):
    (files / "meshes" / "bad.stl").write_bytes(b"\0" * 100)
    path = files / "s.yaml"
    path.write_text(
        "simspec: 1\nname: s\nbodies:\n  one:\n    mass: 1\n    fixed: true\n    shapes:\n"
        "      - collision: false\n        mesh:\n          file: meshes/bad.stl\n"
    )
    with pytest.raises(SpecError) as caught:
        load(path).resolve()
    (problem,) = caught.value.problems
    assert (problem.location.line, problem.found) == (10, "meshes/bad.stl")
    assert "where a binary STL has" in problem.message


def test_volume_that_a_hull_adds_or_loses_is_reported(files):
    def given(body):
        found = spec(files, **body).warnings()
        return [p.message for p in found if "mesh" in p.path]

    l_shape = {"file": "meshes/l.obj"}
    assert given({"mass": 1, "shapes": [{"mesh": {"file": "meshes/box.stl"}}]}) == []
    assert given({"mass": 1, "shapes": [{"mesh": l_shape}]}) == []  # 1.17 times
    (files / "meshes" / "u.obj").write_text(obj(*_u_profile()))
    (message,) = given({"mass": 1, "shapes": [{"mesh": {"file": "meshes/u.obj"}}]})
    assert message == "the convex hull has 1.29 times the volume of the mesh, and is what touches"
    assert given({"mass": 1, "shapes": [{"mesh": {"file": "meshes/u.obj"}, "collision": False}]}) == []
    (message,) = given({"mass": 1, "shapes": [{"mesh": {**l_shape, "max_vertices": 8}}]})
    assert message.startswith("with 8 of 10 vertices the hull is up to ")


def _u_profile():
    """A U of seven cubes in a hull of nine."""
    import trimesh  # before opening is forbidden

    parts = [
        trimesh.creation.box((3, 1, 1), trimesh.transformations.translation_matrix((1.5, 0.5, 0.5))),
        trimesh.creation.box((1, 2.5, 1), trimesh.transformations.translation_matrix((0.5, 1.75, 0.5))),
        trimesh.creation.box((1, 2.5, 1), trimesh.transformations.translation_matrix((2.5, 1.75, 0.5))),
    ]
    whole = trimesh.boolean.union(parts, engine="manifold")
    return np.asarray(whole.vertices), np.asarray(whole.faces)


def test_a_world_with_a_mesh_goes_through_its_files(files):
    world = spec(files, shapes=[{"mesh": {"file": "meshes/l.obj"}, "density": 1}]).resolve()
    assert from_plain(World, to_plain(world)) == world
    assert '"kind":"mesh"' in canonical_json(world)
    again = spec(files, shapes=[{"mesh": {"file": "meshes/l.obj"}, "density": 1}]).resolve()
    assert canonical_json(again) == canonical_json(world)


def test_a_scenario_of_too_many_vertices_is_refused(files, monkeypatch):
    monkeypatch.setattr(meshes, "MOST_IN_WORLD", 50)
    shapes = [{"mesh": {"file": "meshes/l.obj"}}]
    body = {"mass": 1, "shapes": shapes, "array": {"grid": [6, 1, 1], "spacing": 5}}
    (problem,) = problems(files, **body)
    assert "60 vertices, copies included; up to 50" in problem.message
    assert "max_vertices" in problem.hint
