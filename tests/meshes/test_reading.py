"""Files of triangles: every language, what they say of themselves, and what is refused."""

from __future__ import annotations

import base64
import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.meshes import reading
from simspec.meshes.load import MeshOptions, made
from simspec.meshes.reading import MeshError, open_mesh, read_surfaces
from tests.meshes.solids import box, l_profile, obj, stl, write_all

FACES = 20


def read(*paths):
    """The content of the files, or the texts of their errors; those that are not even opened among them."""
    opened, results = {}, {}
    for path in paths:
        try:
            opened[path] = open_mesh(path)
        except MeshError as error:
            results[path] = str(error)
    for path, answer in zip(opened, read_surfaces(list(opened.values())), strict=True):
        results[path] = str(answer) if isinstance(answer, MeshError) else answer
    return [results[path] for path in paths]


def test_every_language_has_the_same_triangles(tmp_path):
    points, faces = l_profile()
    paths = write_all(tmp_path, points, faces)
    for kind, surface in zip(paths, read(*paths.values()), strict=True):
        assert len(surface.triangles) == FACES, kind
        assert (surface.unit, surface.up) == {"glb": (1.0, "y"), "gltf": (1.0, "y"), "dae": (1.0, "y")}.get(
            kind, (None, None)
        )
        # up is y in a file of the last three: as it stands when that is not turned
        mesh = made(surface, MeshOptions(up="z"))
        assert mesh.hull_volume == pytest.approx(3.5, rel=1e-15), kind
        assert mesh.enclosed.volume == pytest.approx(3.0, rel=1e-15), kind
        assert mesh.enclosed.frame.position == pytest.approx((5 / 6, 5 / 6, 1 / 2), rel=1e-15), kind


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="inch" meter="0.0254"/><up_axis>UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>2 0 0</translate><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


@pytest.mark.parametrize(
    ("up", "place"), [("Z_UP", (2.25, 0.25, 0.25)), ("Y_UP", (2.25, -0.25, 0.25)), ("X_UP", (-0.25, -0.25, 2.25))]
)
def test_collada_says_its_unit_and_its_axis_and_places_what_it_has(tmp_path, up, place):
    path = tmp_path / "t.dae"
    path.write_text(DAE.replace("UP<", f"{up}<"))
    (surface,) = read(path)
    inch = 0.0254
    mesh = made(surface, MeshOptions())
    assert mesh.enclosed.volume == pytest.approx(inch**3 / 6, rel=1e-6)  # its reader has single precision
    assert mesh.enclosed.frame.position == pytest.approx([inch * value for value in place], rel=1e-6)
    given = made(surface, MeshOptions(unit=1.0, up="z"))
    assert given.enclosed.frame.position == pytest.approx((2.25, 0.25, 0.25), rel=1e-6)


def gltf(uri: str, **more: object) -> str:
    """A tetrahedron in a node that mirrors and moves it."""
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "scale": [1, 1, -2], "translation": [0, 5, 0]}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            "textures": [{"source": 0}],
            "images": [{"uri": "../../secret.png"}],
            "buffers": [{"uri": uri, "byteLength": 60}],
            "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR"},
            ],
            **more,
        }
    )


BUFFER = struct.pack("<12f", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1) + bytes([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])


def test_gltf_takes_buffers_from_its_folder_and_pictures_from_nowhere(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "b u.bin").write_bytes(BUFFER)
    (tmp_path / "out.bin").write_bytes(BUFFER)
    texts = {
        "beside": gltf("b%20u.bin"),
        "own": gltf("data:application/octet-stream;base64," + base64.b64encode(BUFFER).decode()),
        "outside": gltf("../out.bin"),
        "absolute": gltf(str(tmp_path / "out.bin")),
        "remote": gltf("http://localhost/out.bin"),
        "missing": gltf("no.bin"),
        "extension": gltf("b%20u.bin", extensionsRequired=["KHR_draco_mesh_compression"]),
    }
    paths = {name: tmp_path / "in" / f"{name}.gltf" for name in texts}
    for name, path in paths.items():
        path.write_text(texts[name])
    found = dict(zip(paths, read(*paths.values()), strict=True))
    for name in ("beside", "own"):
        mesh = made(found[name], MeshOptions())
        assert mesh.enclosed.volume == pytest.approx(1 / 3, rel=1e-15), mesh.open_because
        assert mesh.enclosed.frame.position == pytest.approx((0.25, 0.5, 5.25), rel=1e-15)
    assert "leaves its folder" in found["outside"]
    assert "leaves its folder" in found["absolute"]
    assert "no path of a file" in found["remote"]
    assert "No such file" in found["missing"]
    assert "KHR_draco_mesh_compression" in found["extension"]


def hostile(folder):
    """Files by name, with a part of the error of each."""
    points, faces = l_profile()
    whole = stl(points, faces)
    nan = points.copy()
    nan[0, 0] = np.nan
    glb = b"glTF" + struct.pack("<II", 2, 20) + struct.pack("<I", 2**31) + b"JSON"
    huge = b"\0" * 80 + struct.pack("<I", 1_000_000) + b"\0" * 50_000_000
    bomb = '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "aaaaaaaaaa">]><COLLADA>&a;</COLLADA>'
    return {
        "empty.stl": (b"", "at least 84 bytes"),
        "cut.stl": (whole[:-10], f"has {84 + 50 * FACES:,} bytes for its {FACES} faces"),
        "more.stl": (whole + b"\0", "where a binary STL has"),
        "none.stl": (stl(points, faces[:0]), "no faces"),
        "lying.stl": (b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 50, "for its 4,294,967,295 faces"),
        "huge.stl": (huge, "1,000,000 faces, more than the 200,000"),
        "nan.stl": (stl(nan, faces), "not finite"),
        "text.stl": (b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nendloop\nendfacet\nendsolid", "damaged"),
        "random.stl": (np.random.default_rng(1).bytes(5000), "where a binary STL has"),
        "index.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "damaged|does not exist"),
        "points.obj": (b"v 0 0 0\nv 1 0 0\n", "no faces"),
        "many.obj": (b"v 0 0 0\n" + b"f 1 1 1\n" * 200_001, "200,001 faces"),
        "random.obj": (np.random.default_rng(2).bytes(5000), ""),
        "mtl.obj": (b"mtllib /etc/passwd\n" + obj(points, faces).encode(), None),
        "empty.obj": (b"", "no faces"),
        "cut.msh": (struct.pack("<4i", 4, 0, 0, 4), "not as long as its numbers say"),
        "negative.msh": (struct.pack("<4i", -4, 0, 0, 4), "not as long as its numbers say"),
        "lying.ply": (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float x\nproperty float y\n"
            b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n",
            "",
        ),
        "more.ply": (
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
            b"element face 3\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            "",
        ),
        "random.ply": (np.random.default_rng(3).bytes(5000), "damaged"),
        "length.glb": (glb, "its length is not what it says|JSON"),
        "random.glb": (np.random.default_rng(4).bytes(5000), "damaged"),
        "deep.gltf": (b'{"a":' * 100_000, "damaged"),
        "list.gltf": (b"[]", "no object"),
        "cycle.gltf": (
            gltf("data:;base64," + base64.b64encode(BUFFER).decode(), nodes=[{"mesh": 0, "children": [0]}]).encode(),
            "nodes/0: a node within itself",
        ),
        "circle.gltf": (
            gltf(
                "data:;base64," + base64.b64encode(BUFFER).decode(),
                nodes=[{"mesh": 0}, {"children": [2]}, {"mesh": 0, "children": [3]}, {"children": [1]}],
            ).encode(),
            "a node within itself",
        ),
        "twice.gltf": (
            gltf(
                "data:;base64," + base64.b64encode(BUFFER).decode(),
                nodes=[{"children": [2]}, {"children": [2]}, {"mesh": 0}],
            ).encode(),
            "nodes/1: its child 2 is a child of node 0 too",
        ),
        "nobody.gltf": (
            gltf("data:;base64," + base64.b64encode(BUFFER).decode(), nodes=[{"mesh": 0, "children": [7]}]).encode(),
            "nodes/0: its child 7 does not exist",
        ),
        "zero.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 0 1 2\n", "line 5: the corner 0: numbers begin with 1"),
        "zero in a second part.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/0\n", "line 4: the corner 3/0"),
        "continued.obj": (b"v 0 0 0\nv 1 0 \\\n0\nv 0 1 0\nf 1 2 \\\n0\n", "line 5: the corner 0"),
        "before.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -4\n", "line 4: the corner -4 is before the first one"),
        "bomb.dae": (bomb.encode(), "DOCTYPE"),
        "utf16.dae": (bomb.encode("utf-16"), "not UTF-8"),
        "empty.dae": (b"", "damaged"),
        "noscene.dae": (DAE[: DAE.index("<library_visual")].encode() + b"</COLLADA>", "no scene"),
        "broken.dae": (DAE.replace("0 2 1 0 1 3", "0 2 1 0 1 x").encode(), ""),
        "index.dae": (DAE.replace("0 2 1 0 1 3", "0 2 1 0 1 9").encode(), ""),
        "count.dae": (DAE.replace('count="4" stride', 'count="4000000000" stride').encode(), None),
    }


def test_hostile_files_are_refused_by_what_is_wrong_with_them(tmp_path):
    """An empty text: it must be refused, for any reason; None: its hostile part is not read."""
    files = hostile(tmp_path)
    for name, (content, _) in files.items():
        (tmp_path / name).write_bytes(content)
    answers = dict(zip(files, read(*(tmp_path / name for name in files)), strict=True))
    for name, (_, wanted) in files.items():
        if wanted is None:
            continue
        assert isinstance(answers[name], str), name
        assert any(part in answers[name] for part in wanted.split("|")), (name, answers[name])
    assert len(answers["mtl.obj"].triangles) == FACES


@given(data=st.data())
def test_corners_that_are_counted_from_the_end_are_those_that_stand_before(data):
    """The language: -1 is the last vertex before the face. Both ways of writing a file have the same triangles."""
    from simspec.meshes.child import READERS

    absolute, relative, count = [], [], 0
    for _ in range(data.draw(st.integers(1, 4))):
        for _ in range(data.draw(st.integers(3, 5))):
            place = data.draw(st.tuples(*[st.integers(-9, 9)] * 3))
            line = "v {} {} {}".format(*place)
            absolute.append(line)
            relative.append(line)
            count += 1
        corners = data.draw(st.lists(st.integers(1, count), min_size=3, max_size=3, unique=True))
        absolute.append("f " + " ".join(map(str, corners)))
        relative.append("f " + " ".join(str(corner - count - 1) for corner in corners))
    surfaces = [READERS[".obj"]("\n".join(lines).encode(), {}) for lines in (absolute, relative)]
    first, second = (vertices[faces] for vertices, faces, _ in surfaces)
    assert np.array_equal(first, second)


def test_a_file_that_ends_the_process_is_reported_and_the_others_are_read(tmp_path, monkeypatch):
    """A library may do anything: here it gets a length of more bytes than there are, and so waits for the next file in vain."""
    genuine = reading._request

    def lying(file):
        return genuine(file) if file.path.name != "bad.stl" else b"this is no request\n"

    monkeypatch.setattr(reading, "_request", lying)
    paths = [tmp_path / name for name in ("a.stl", "bad.stl", "b.stl")]
    for path in paths:
        path.write_bytes(stl(*box(1, 2, 3)))
    first, second, third = read(*paths)
    assert len(first.triangles) == len(third.triangles) == 12
    assert second == "reading it ends the process that does it"


def test_a_file_that_takes_too_long_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "START_SECONDS", 0.0)
    monkeypatch.setattr(reading, "FILE_SECONDS", 0.0)
    path = tmp_path / "a.stl"
    path.write_bytes(stl(*box(1, 2, 3)))
    assert read(path) == ["reading it takes too long"]


def test_files_that_are_no_files(tmp_path):
    (tmp_path / "folder.stl").mkdir()
    (tmp_path / "loop.stl").symlink_to(tmp_path / "loop.stl")
    large = tmp_path / "large.stl"
    with open(large, "wb") as file:
        file.truncate(65 * 2**20)
    for name, said in (("folder.stl", "a folder"), ("loop.stl", "cannot be read"), ("large.stl", "more than the")):
        with pytest.raises(MeshError, match=said):
            open_mesh(tmp_path / name)


def test_the_process_opens_nothing_and_connects_nowhere():
    """Its guard, called here: Python's own modules may be opened, nothing else."""
    from simspec.meshes import child

    child._watch("open", (np.__file__, "r", 0))
    child._watch("import", ("os",))
    for event, argument in (("open", "/etc/passwd"), ("open", b"../x"), ("socket.connect", None), ("os.system", "ls")):
        with pytest.raises(PermissionError):
            child._watch(event, (argument,))
