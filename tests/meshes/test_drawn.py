"""Surfaces that pages draw: simplified, with the colours of files, stored with a run, and without effect on a world's hash."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import trimesh

from simspec.errors import SpecError
from simspec.language.load import load
from simspec.meshes import drawn
from simspec.meshes.drawn import plain_surface, surface_of, surfaces, wanted
from simspec.meshes.reading import open_mesh, read_surfaces
from simspec.meshes.simplify import simplified
from simspec.report.page.packing import PackedNumbers
from simspec.report.page.shapes import drawn_shapes, surfaces_note
from simspec.report.screen import plain
from simspec.runner.store import load_run
from simspec.world.canonical import canonical_json, sha256
from tests.meshes.solids import box, obj
from tests.runner.synthetic import run

pytestmark = pytest.mark.usefixtures("warm_readers")

RED, BLUE = (0.8, 0.0, 0.0, 1.0), (0.0, 0.0, 0.8, 1.0)
MATERIALS = "newmtl red\nKd 0.8 0 0\nnewmtl blue\nKd 0 0 0.8\n"
SPEC = """
simspec: 1
name: painted
physics: {timestep: 1 ms, duration: 10 ms}
contact: {materials: {wood: {friction: 0.5}}}
bodies:
  painted: {shapes: [{name: own, mesh: {file: painted.obj, scale: 2, max_vertices: 8}, density: 500}]}
  green:
    pose: {xyz: [9, 0, 0]}
    shapes: [{name: said, mesh: {file: painted.obj, scale: 2, max_vertices: 8}, density: 500, colour: [0, 1, 0]}]
"""


def painted(folder):
    """A spec of two bodies with one file: a box of two colours."""
    points, faces = box(1.0, 2.0, 3.0)
    head, rest = obj(points, faces[:6]), obj(points, faces[6:])
    rest = rest[rest.index("f ") :]
    text = "mtllib painted.mtl\n" + head.replace("f ", "usemtl red\nf ", 1) + "usemtl blue\n" + rest
    (folder / "painted.obj").write_text(text)
    (folder / "painted.mtl").write_text(MATERIALS)
    path = folder / "painted.yaml"
    path.write_text(SPEC)
    return load(path).resolve()


def test_a_simplified_surface_keeps_its_size_and_its_flat_faces():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=2.0)
    points, triangles, kept = simplified(ball.vertices, ball.faces, 1000)
    assert 300 < len(triangles) <= 1000
    assert len(kept) == len(triangles)
    assert np.linalg.norm(points[np.unique(triangles)], axis=1) == pytest.approx(2.0, abs=0.05)
    cuboid = trimesh.creation.box((1.0, 2.0, 3.0)).subdivide_loop(0).subdivide().subdivide().subdivide().subdivide()
    points, triangles, _ = simplified(cuboid.vertices, cuboid.faces, 600)
    few = trimesh.Trimesh(points, triangles, process=False)
    assert len(triangles) <= 600
    assert few.volume == pytest.approx(6.0, rel=1e-6)  # corners and edges stay where they are


def test_few_triangles_stay_as_they_are():
    points, faces = box(1.0, 1.0, 1.0)
    same = simplified(points, faces, 12)
    assert np.array_equal(same[0], points)
    assert np.array_equal(same[1], faces)


def test_colours_of_files_are_drawn_unless_the_spec_gives_some(tmp_path):
    world = painted(tmp_path)
    found = surfaces(world)
    (surface,) = found.values()
    assert surface.colours == ((BLUE, 6), (RED, 6))
    places = np.frombuffer(surface.vertices, "<f4").reshape(-1, 3)
    assert places.max(axis=0).tolist() == [2.0, 4.0, 6.0]
    shown = drawn_shapes(world, PackedNumbers(), found)
    seen = [(entry["body"], tuple(entry["colour"])) for entry in shown if entry["seen"]]
    green = (0.0, 1.0, 0.0, 1.0)
    assert sorted(seen) == sorted([(0, RED), (0, BLUE), (1, green), (1, green)])
    assert [entry["body"] for entry in shown if entry["solid"]] == [0, 1]
    assert surfaces_note(found) is None
    assert surfaces_note({key: dataclasses.replace(surface, faces=900) for key in found}) == (
        "Meshes are drawn with 12 of their 900 triangles."
    )


def test_files_without_materials_are_read_without_colours(tmp_path):
    world = painted(tmp_path)
    (tmp_path / "painted.mtl").unlink()
    (surface,) = surfaces(world).values()
    assert [colour for colour, _ in surface.colours] == [None]
    (tmp_path / "painted.obj").unlink()
    assert surfaces(world) == {}


def test_materials_outside_the_folder_of_a_mesh_are_not_read(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    painted(inside)
    (tmp_path / "secret.mtl").write_text(MATERIALS)
    path = inside / "painted.obj"
    path.write_text(path.read_text().replace("painted.mtl", "../secret.mtl"))
    assert open_mesh(path, colours=True).buffers == {}


def test_colours_of_other_languages(tmp_path):
    scene = trimesh.Scene()
    for place, colour in ((0.0, RED), (5.0, BLUE)):
        part = trimesh.creation.box((1.0, 1.0, 1.0))
        part.apply_translation((place, 0.0, 0.0))
        shade = [round(255 * value) for value in colour]
        part.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(baseColorFactor=shade))
        scene.add_geometry(part)
    paths = [tmp_path / "two.glb", tmp_path / "two.dae"]
    scene.export(paths[0])
    paths[1].write_bytes(trimesh.exchange.dae.export_collada(list(scene.geometry.values())))
    for surface in read_surfaces([open_mesh(path, colours=True) for path in paths]):
        colours = [(tuple(round(value, 2) for value in colour), count) for colour, count in surface.colours]
        assert sorted(colours) == [(BLUE, 12), (RED, 12)]


def test_a_stored_run_keeps_its_surfaces_and_the_hash_of_its_world(tmp_path):
    world = painted(tmp_path)
    assert "drawn" not in canonical_json(world)
    assert "drawn" not in plain(world.bodies[0].shapes[0])  # which has a path of this machine
    run(world).save(tmp_path / "run")
    (tmp_path / "painted.obj").unlink()
    again = load_run(tmp_path / "run")
    assert sha256(again.world) == sha256(world)
    assert again.provenance == run(world).provenance
    (surface,) = surfaces(again.world).values()
    assert surface.colours == ((BLUE, 6), (RED, 6))
    looks = tmp_path / "run" / "looks.json"
    looks.write_text(looks.read_text().replace("0.8", "0.7"))
    with pytest.raises(SpecError, match=r"looks\.json: was edited or is damaged"):
        load_run(tmp_path / "run")
    looks.unlink()
    with pytest.raises(SpecError, match=r"looks\.json is missing"):
        load_run(tmp_path / "run")


@pytest.mark.parametrize("error", [OSError("no process"), MemoryError(), ValueError("odd")])
def test_a_run_is_saved_although_its_surfaces_cannot_be_read(tmp_path, monkeypatch, error):
    def fail(world):
        raise error

    monkeypatch.setattr("simspec.runner.store.looks_of", fail)
    world = painted(tmp_path)
    run(world).save(tmp_path / "run")
    assert not (tmp_path / "run" / "looks.json").exists()
    assert sha256(load_run(tmp_path / "run").world) == sha256(world)


@pytest.mark.parametrize(
    ("name", "value"),
    [("colours", [[None, 3]]), ("triangles", "AAAAAAAA"), ("vertices", "AA=="), ("colours", [[[2, 0, 0, 1], 12]])],
)
def test_damaged_surfaces_are_refused(tmp_path, name, value):
    (surface,) = surfaces(painted(tmp_path)).values()
    stored = json.loads(json.dumps(plain_surface(surface)))
    assert surface_of(stored) == surface
    with pytest.raises((ValueError, KeyError, TypeError)):
        surface_of({**stored, name: value})


def test_surfaces_share_the_budget_of_a_page(tmp_path, monkeypatch):
    world = painted(tmp_path)
    made = []
    monkeypatch.setattr(drawn, "_made", lambda missing, most: made.append(most) or {})
    mesh = world.bodies[0].shapes[0].drawn
    shapes = tuple(
        dataclasses.replace(world.bodies[0].shapes[0], drawn=dataclasses.replace(mesh, file=f"{number}.obj"))
        for number in range(50)
    )
    surfaces(dataclasses.replace(world, bodies=(dataclasses.replace(world.bodies[0], shapes=shapes),)))
    surfaces(world)
    assert made == [drawn.MOST_IN_PAGE // 50, drawn.MOST_TRIANGLES]
    assert wanted(mesh)[0].endswith("painted.obj")
