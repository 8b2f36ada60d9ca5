"""Geometry from triangles: hulls, the solid that their surface encloses, fewer vertices, pieces; and the cache."""

from __future__ import annotations

import json
from importlib.util import find_spec

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.meshes import load as cache
from simspec.meshes import load as loading
from simspec.meshes.hulls import enclosed, merged, reduced
from simspec.meshes.load import ManyVerticesError, MeshOptions, bounded, load, made
from simspec.meshes.reading import MeshError, MeshFile, MeshSurface
from simspec.world import frames
from simspec.world.hull import corners, hull, mesh_vertices
from simspec.world.shapes import SHAPES
from simspec.world.types import Pose
from tests.meshes.solids import BOX_FACES, box, l_profile, stl

pytestmark = pytest.mark.usefixtures("warm_readers")

HULL = MeshOptions()


def directions(count: int = 2000) -> np.ndarray:
    drawn = np.random.default_rng(5).normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def test_a_box_is_the_box_of_the_language():
    points, faces = box(0.2, 0.3, 0.5)
    mesh = made(MeshSurface(points, faces), HULL)
    (part,) = mesh.parts
    assert part.pose.quaternion == (1.0, 0.0, 0.0, 0.0)
    assert part.pose.position == pytest.approx((0.1, 0.15, 0.25), rel=1e-15)
    n = directions()
    row, other = SHAPES["mesh"], SHAPES["box"]
    np.testing.assert_allclose(row.support(part.size, n), other.support((0.2, 0.3, 0.5), n), rtol=1e-14)
    assert mesh.hull_volume == mesh.enclosed.volume == pytest.approx(0.03, rel=1e-15)
    assert mesh.enclosed.moments == pytest.approx(
        [0.03 * moment for moment in other.moments((0.2, 0.3, 0.5), 1.0)], rel=1e-14
    )


def test_unit_axes_and_mirrors_are_baked_in():
    """The L of volume 3 in mm, its y turned up, mirrored and stretched: as the same done by hand."""
    points, faces = l_profile()
    scale = (1.0, -2.0, 0.5)
    mesh = made(MeshSurface(points, faces, 1.0, "z"), MeshOptions(0.001, "y", scale))
    x, y, z = points.T * 0.001
    moved = np.stack([x * scale[0], -z * scale[1], y * scale[2]], 1)
    assert mesh.enclosed.volume == pytest.approx(3e-9, rel=1e-14)
    assert mesh.hull_volume == pytest.approx(hull(moved[corners(moved)]).solid.volume, rel=1e-14)
    n = directions()
    (part,) = mesh.parts
    turn = np.array(frames.matrix(part.pose.quaternion))
    reach = SHAPES["mesh"].support(part.size, n @ turn) + n @ np.array(part.pose.position)
    np.testing.assert_allclose(reach, (moved @ n.T).max(axis=0), atol=1e-17)


def test_the_enclosed_volume_is_exact_for_nonconvex_surfaces():
    points, faces = l_profile()
    other = trimesh.Trimesh(points, faces, process=False)
    solid = enclosed(*merged(points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))).solid
    assert solid.volume == pytest.approx(other.volume, rel=1e-14)
    tensor = frames.rotate_inertia(solid.frame.quaternion, (*solid.moments, 0.0, 0.0, 0.0))
    xx, yy, zz, xy, xz, yz = tensor
    np.testing.assert_allclose([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], other.moment_inertia, rtol=1e-13, atol=1e-14)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["torus", "capsule", "annulus", "icosahedron"]),
    place=st.tuples(*(st.floats(-3.0, 3.0) for _ in range(3))),
    stretch=st.tuples(*(st.floats(0.05, 5.0) for _ in range(3))),
)
def test_masses_are_those_of_another_reader(seed, kind, place, stretch):
    mesh = {
        "torus": lambda: trimesh.creation.torus(1.0, 0.3, 12, 8),
        "capsule": lambda: trimesh.creation.capsule(1.0, 0.3, count=[8, 8]),
        "annulus": lambda: trimesh.creation.annulus(0.3, 1.0, 0.5, sections=9),
        "icosahedron": trimesh.creation.icosahedron,
    }[kind]()
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3)))
    mesh.apply_scale(stretch)
    mesh.apply_translation(place)
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    local = enclosed(*merged(points, faces))
    assert local.solid is not None, local.why
    other = trimesh.Trimesh(points - local.solid.frame.position, faces, process=False)
    extent = float(np.ptp(points, axis=0).max())
    assert local.solid.volume == pytest.approx(other.volume, rel=1e-12)
    assert np.abs(other.center_mass).max() <= 1e-12 * (extent + np.abs(points).max())
    xx, yy, zz, xy, xz, yz = frames.rotate_inertia(local.solid.frame.quaternion, (*local.solid.moments, 0.0, 0.0, 0.0))
    tensor = other.moment_inertia
    np.testing.assert_allclose([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], tensor, atol=1e-12 * np.abs(tensor).max())
    assert made(MeshSurface(points, faces), HULL).hull_volume >= local.solid.volume * (1.0 - 1e-12)


def changed(**what: object) -> tuple[np.ndarray, np.ndarray]:
    points, faces = box(1.0, 1.0, 1.0)
    faces = faces.copy()
    if "without" in what:
        faces = np.delete(faces, what["without"], axis=0)
    if "turned" in what:
        faces[what["turned"]] = faces[what["turned"], ::-1]
    if "again" in what:
        faces = np.concatenate([faces, faces[what["again"]]])
    return points, faces


@pytest.mark.parametrize(
    ("surface", "why"),
    [
        (changed(without=[3]), "it has 3 open edges"),
        (changed(without=[0, 1]), "it has 4 open edges"),
        (changed(turned=[3]), "its faces are wound inconsistently"),
        (changed(turned=range(12)), "its faces are wound inwards"),
        (changed(again=[3]), "more than two faces"),
        (changed(again=range(12)), "18 of its edges have more than two faces"),
    ],
)
def test_open_surfaces_have_a_hull_and_no_mass(surface, why):
    mesh = made(MeshSurface(*surface), HULL)
    assert mesh.enclosed is None
    assert why in mesh.open_because
    assert mesh.hull_volume == pytest.approx(1.0, rel=1e-14)


def test_a_hollow_is_taken_away_and_two_solids_are_counted():
    points, faces = box(1.0, 1.0, 1.0)
    hollow = np.concatenate([points, 0.25 + 0.5 * points])
    mesh = made(MeshSurface(hollow, np.concatenate([faces, faces[:, ::-1] + 8])), HULL)
    assert mesh.enclosed.volume == pytest.approx(1 - 1 / 8, rel=1e-14)
    two = np.concatenate([points, points + np.array([3.0, 0.0, 0.0])])
    mesh = made(MeshSurface(two, np.concatenate([faces, faces + 8])), HULL)
    assert (mesh.surfaces, mesh.enclosed.volume) == (2, pytest.approx(2.0, rel=1e-14))
    over = np.concatenate([points, points + np.array([0.1, 0.0, 0.0])])
    mesh = made(MeshSurface(over, np.concatenate([faces, faces + 8])), HULL)
    assert "more than its hull" in mesh.open_because


def test_corners_without_faces_and_faces_without_area_change_nothing():
    points, faces = l_profile()
    more = np.concatenate([points, [[9.0, 9.0, 9.0]]])
    surface = MeshSurface(more, np.concatenate([faces, [[0, 0, 1], [5, 5, 5]]]))
    assert made(surface, HULL) == made(MeshSurface(points, faces), HULL)


@pytest.mark.parametrize(
    ("points", "options", "why"),
    [
        (box(1.0, 1.0, 1e-20)[0], HULL, "no volume"),
        (box(1e200, 1e200, 1e200)[0], HULL, "further than"),
        (box(1.0, 1.0, 1.0)[0], MeshOptions(scale=(1e9, 1.0, 1.0)), "further than"),
        (box(1.0, 1.0, 1.0)[0], MeshOptions(unit=1e-120), "no solid|no volume"),
        (box(1.0, 1.0, 1.0)[0][:1].repeat(8, axis=0), HULL, "no volume"),
    ],
)
def test_surfaces_that_enclose_no_solid(points, options, why):
    with pytest.raises(MeshError) as caught:
        made(MeshSurface(points, BOX_FACES), options)
    assert any(part in str(caught.value) for part in why.split("|"))


def test_a_hull_of_too_many_vertices_needs_fewer():
    ball = trimesh.creation.icosphere(subdivisions=3)
    surface = MeshSurface(np.asarray(ball.vertices), np.asarray(ball.faces))
    with pytest.raises(MeshError, match="642 vertices, more than 500; `max_vertices: 64`"):
        bounded(made(surface, HULL), HULL, 500)
    fewer = MeshOptions(max_vertices=64)
    (part,) = bounded(made(surface, fewer), fewer, 500).parts
    assert len(part.size) == 3 * 64
    assert part.vertices == 642


def test_a_hull_of_too_many_vertices_is_refused_before_its_parts_are_made(monkeypatch):
    """Also where fewer are requested: choosing them takes long."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    surface = MeshSurface(np.asarray(ball.vertices), np.asarray(ball.faces))
    monkeypatch.setattr("simspec.meshes.load._convex", None)
    with pytest.raises(ManyVerticesError, match="642 vertices, more than 500; `max_vertices: 64`"):
        made(surface, HULL, 500)
    monkeypatch.setattr("simspec.meshes.load.LARGEST", 600)
    with pytest.raises(MeshError, match="642 vertices, more than the 600"):
        made(surface, MeshOptions(max_vertices=64))


def test_cached_meshes_are_bounded_like_computed_meshes(tmp_path, monkeypatch):
    """A file that was taken where more vertices were allowed is refused where fewer are, whoever remembers it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    ball = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / "ball.stl"
    path.write_bytes(stl(np.asarray(ball.vertices), np.asarray(ball.faces)))
    wanted = (path, HULL)
    assert len(load([wanted], 162)[wanted].parts) == 1
    for _ in ("remembered", "kept"):
        refused = load([wanted], 161)[wanted]
        assert isinstance(refused, ManyVerticesError)
        assert "162 vertices, more than 161" in str(refused)
        monkeypatch.setattr(loading, "_remembered", {})


def test_a_corner_that_the_rotation_puts_into_a_plane_is_left_out(monkeypatch):
    """Faces computed from the vertices of a world would lack it, and no surface would be closed. Rounding stands
    for the rotation, whose own round-off decides over one corner of thousands."""
    monkeypatch.setattr("simspec.meshes.load.centred", lambda points: (Pose(), np.round(points, 1)))
    ball = trimesh.creation.icosphere(subdivisions=3)
    (part,) = made(MeshSurface(np.asarray(ball.vertices), np.asarray(ball.faces)), HULL).parts
    vertices = np.array(part.size).reshape(-1, 3)
    assert 50 < len(vertices) < 642
    assert len(corners(vertices)) == len(vertices)
    assert len(hull(vertices).triangles) == 2 * len(vertices) - 4


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(20, 300), most=st.integers(4, 64))
def test_fewer_vertices_are_within_the_reported_distance_and_reproducible(seed, count, most):
    points = np.random.default_rng(seed).normal(size=(count, 3)) * (1.0, 0.5, 2.0)
    vertices = points[corners(points)]
    kept, error = reduced(vertices, most)
    again, same = reduced(vertices.copy(), most)
    assert np.array_equal(kept, again)
    assert error == same
    assert len(kept) <= max(most, 4)
    whole = {tuple(row) for row in vertices.tolist()}
    assert {tuple(row) for row in kept.tolist()} <= whole
    n = directions(500)
    assert ((vertices @ n.T).max(axis=0) - (kept @ n.T).max(axis=0)).max() <= error + 1e-12
    other = trimesh.Trimesh(kept, hull(kept).triangles, process=False)
    _, separate, _ = trimesh.proximity.closest_point(other, vertices)
    assert error == pytest.approx(separate.max(), abs=1e-9)
    if len(vertices) <= most:
        assert error == 0.0
        assert len(kept) == len(vertices)


def test_more_vertices_lose_less():
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices = np.asarray(ball.vertices)
    errors = [reduced(vertices, most)[1] for most in (8, 16, 32, 64, 128, 642)]
    assert errors == sorted(errors, reverse=True)
    assert errors[3] < 0.1
    assert errors[-1] == 0.0


def test_pieces_fill_what_is_not_convex():
    points, faces = l_profile()
    if find_spec("coacd") is None:
        with pytest.raises(MeshError, match=r"pip install 'simspec-physics\[convex\]'"):
            made(MeshSurface(points, faces), MeshOptions(pieces=True))
        return
    mesh = made(MeshSurface(points, faces), MeshOptions(pieces=True))
    assert len(mesh.parts) == 2
    volumes = [SHAPES["mesh"].volume(part.size) for part in mesh.parts]
    assert sum(volumes) == pytest.approx(3.0, rel=0.01)
    assert mesh.hull_volume == pytest.approx(3.5, rel=1e-14)
    assert made(MeshSurface(points, faces), MeshOptions(pieces=True)) == mesh


# --- the cache --------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache folder of the test's own, and a process that remembers nothing."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(loading, "_remembered", {})
    return tmp_path / "cache" / "simspec" / "meshes"


def forget(monkeypatch):
    monkeypatch.setattr(loading, "_remembered", {})


def test_a_mesh_is_made_once(tmp_path, folder, monkeypatch):
    path = tmp_path / "l.stl"
    path.write_bytes(stl(*l_profile()))
    wanted = [(path, HULL), (path, MeshOptions(unit=0.1))]
    first = load(wanted, 4096)
    assert len(list(folder.iterdir())) == 2
    forget(monkeypatch)
    monkeypatch.setattr(loading, "read_surfaces", lambda files: [1 / 0 for _ in files])
    assert load(wanted, 4096) == first
    with pytest.raises(ZeroDivisionError):
        load([(path, MeshOptions(unit=0.2))], 4096)
    path.write_bytes(stl(*box(1, 1, 1)))
    with pytest.raises(ZeroDivisionError):
        load(wanted, 4096)


@pytest.mark.parametrize("damage", ["cut", "changed", "renamed", "nothing", "another"])
def test_a_damaged_entry_is_made_anew(tmp_path, folder, monkeypatch, damage):
    """The surface is that of the file, without the process that reads it."""
    monkeypatch.setattr(loading, "read_surfaces", lambda files: [MeshSurface(*l_profile()) for _ in files])
    path = tmp_path / "l.stl"
    path.write_bytes(stl(*l_profile()))
    first = load([(path, HULL)], 4096)
    (entry,) = folder.iterdir()
    text = entry.read_text()
    values = json.loads(text)
    entry.write_text(
        {
            "cut": text[:-20],
            "changed": text.replace("3.5", "3.6", 1),
            "renamed": json.dumps({**values, "key": "0" * 64}),
            "nothing": "",
            "another": json.dumps({**values, "simspec_mesh": 2}),
        }[damage]
    )
    forget(monkeypatch)
    assert load([(path, HULL)], 4096) == first
    assert entry.read_text() == text or damage == "changed"


def test_without_a_folder_it_is_only_slower(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    forget(monkeypatch)
    path = tmp_path / "l.stl"
    path.write_bytes(stl(*l_profile()))
    (mesh,) = load([(path, HULL)], 4096).values()
    assert mesh.hull_volume == pytest.approx(3.5)
    assert cache.read("0" * 64) is None


def test_the_key_holds_all_that_matters(tmp_path):
    file = MeshFile(tmp_path / "a.stl", b"x")
    keys = {
        cache.key(file, HULL),
        cache.key(MeshFile(tmp_path / "a.obj", b"x"), HULL),
        cache.key(MeshFile(tmp_path / "a.stl", b"y"), HULL),
        cache.key(MeshFile(tmp_path / "a.stl", b"x", {"b": b"1"}), HULL),
        cache.key(MeshFile(tmp_path / "a.stl", b"x", {"b": b"2"}), HULL),
        *(cache.key(file, MeshOptions(**entry)) for entry in ({"unit": 1.0}, {"up": "y"}, {"scale": (1.0, 1.0, -1.0)})),
        *(cache.key(file, MeshOptions(**entry)) for entry in ({"pieces": True}, {"max_vertices": 5})),
    }
    assert len(keys) == 10
    assert cache.key(MeshFile(tmp_path / "elsewhere" / "b.stl", b"x"), HULL) in keys


def test_vertices_of_parts_are_in_the_frame_of_their_mass():
    points, faces = l_profile()
    (part,) = made(MeshSurface(points, faces), HULL).parts
    solid = hull(mesh_vertices(part.size)).solid
    assert np.abs(solid.frame.position).max() < 1e-15
    assert solid.frame.quaternion[0] == pytest.approx(1.0, abs=1e-12)


def test_fewer_vertices_of_a_mirrored_mesh_are_those_of_the_mesh():
    points = np.random.default_rng(3).normal(size=(40, 3))
    surface = MeshSurface(*_hull_surface(points))
    mesh, other = (made(surface, MeshOptions(scale=scale, max_vertices=8)) for scale in ((1, 2, 1), (1, -2, 1)))
    places = []
    for result in (mesh, other):
        (part,) = result.parts
        local = np.array(part.size).reshape(-1, 3)
        places.append(local @ np.array(frames.matrix(part.pose.quaternion)).T + part.pose.position)
    assert len(places[0]) == 8
    np.testing.assert_allclose(places[1], places[0] * [1, -1, 1], atol=1e-15)
    assert (other.enclosed.moments, other.hull_volume) == (mesh.enclosed.moments, mesh.hull_volume)
    assert other.enclosed.frame.position == tuple(np.array(mesh.enclosed.frame.position) * [1, -1, 1])


def _hull_surface(points):
    solid = trimesh.convex.convex_hull(points)
    return np.array(solid.vertices), np.array(solid.faces)
