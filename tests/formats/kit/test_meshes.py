"""Files of convex hulls are read back to the last digit, and other meshes are rejected."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.formats.kit.mesh_reading import read_meshes, triangles
from simspec.formats.kit.text import mesh_file, mesh_files, mesh_text
from simspec.world.hull import centred, mesh_size

TETRAHEDRON = ((0.1, 0.0, -0.03), (-0.05, 0.08, -0.03), (-0.05, -0.08, -0.03), (0.0, 0.01, 0.09))


def hull(points):
    return mesh_size(centred(np.array(points, dtype=float))[1])


def ball(count, seed=1, stretch=(1.0, 1.0, 1.0)):
    """Points on an ellipsoid: all of them are corners."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return hull(points / np.linalg.norm(points, axis=1, keepdims=True) * np.array(stretch) * 0.1)


GRID = hull([(x, y, z) for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.05, 0.05)])
"""A box: its faces are of coplanar triangles."""


@pytest.mark.parametrize("size", [hull(TETRAHEDRON), GRID, ball(40), ball(500), ball(60, 2, (1.0, 1.0, 1e-3))], ids=str)
def test_written_meshes_are_read_to_the_last_digit(size, tmp_path):
    for name, text in mesh_files([size, size]).items():
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert read_meshes(tmp_path) == {mesh_file(size): size}


def test_hulls_of_the_same_vertices_share_a_file_and_others_do_not():
    entry, other = hull(TETRAHEDRON), ball(40)
    assert len(mesh_files([entry, other, entry])) == 2
    zero = (*GRID[:3], *(0.0 for _ in GRID[3:6]), *GRID[6:])
    minus = (*GRID[:3], *(-0.0 for _ in GRID[3:6]), *GRID[6:])
    assert mesh_file(zero) == mesh_file(minus), "the text of 0 and -0 is equal"


def lines():
    return mesh_text(hull(TETRAHEDRON)).splitlines()


def changed(number, line):
    """The file with one of its lines replaced; negative numbers count from the end."""
    return "\n".join([*lines()[:number], line, *(lines()[number + 1 :] if number != -1 else [])])


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "0 objects"),
        ("o hull\n", "0 vertices"),
        (changed(2, "v 1 2"), r"h\.obj:3: 'v 1 2' is no vertex of three numbers"),
        (changed(2, "v 1 2 x"), "could not convert"),
        (changed(2, "v 1 2 nan"), "not finite"),
        (changed(2, "v -0.5 0 0"), "not convex"),
        (changed(-1, "f 1 2 3 4"), r"h\.obj:10: 'f 1 2 3 4' is no vertex .* and no triangle"),
        (changed(-1, "f 1 2 9"), "exactly the vertices"),
        (changed(-1, "f 99999999999999999999 2 3"), "h.obj"),
        (changed(-1, lines()[-2]), "exactly the vertices|not closed"),
        (changed(-1, " ".join(["f", *lines()[-1].split()[:0:-1]])), "not closed, or its triangles"),
        ("\n".join([*lines(), "o more"]), "2 objects"),
        ("\n".join([*lines(), "v 9 9 9"]), "4 triangles of 5 vertices"),
        ("\n".join([*lines(), "mtllib x.mtl"]), "'mtllib x.mtl'"),
        (
            "\n".join(line if line[0] != "f" else " ".join(["f", *line.split()[:0:-1]]) for line in lines()),
            "not convex",
        ),
    ],
)
def test_files_that_are_not_hulls_are_rejected(text, why):
    with pytest.raises(ValueError, match=why) as raised:
        triangles(text.encode(), "h.obj")
    assert "h.obj" in str(raised.value)


def test_bytes_of_no_text_are_refused():
    with pytest.raises(ValueError, match="not ASCII at byte 2"):
        triangles(b"v \xff\xfe", "h.obj")


def test_two_closed_surfaces_are_no_hull():
    """Their vertices and triangles are as many as those of one surface with a hole through it."""
    entry, moved = hull(TETRAHEDRON), np.array(hull(TETRAHEDRON)).reshape(-1, 3) + 1.0
    rows = [*lines()[:6], *("v " + " ".join(map(repr, row)) for row in moved.tolist()), *lines()[6:]]
    rows += ["f " + " ".join(str(int(word) + 4) for word in line.split()[1:]) for line in lines()[6:]]
    assert len(entry) == 12
    with pytest.raises(ValueError, match="8 triangles of 8 vertices"):
        triangles("\n".join(rows).encode(), "h.obj")
