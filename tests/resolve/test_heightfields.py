"""Height fields of a spec: rows and files as the world has them, errors with their places, files that are wicked."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from simspec.errors import SpecError
from simspec.language.load import Spec
from simspec.meshes.load import read_grid
from simspec.meshes.reading import MeshError
from simspec.world.shapes import HEIGHTFIELD_HEAD, field_of
from tests.pictures import png

pytestmark = pytest.mark.usefixtures("warm_readers")


def ground(folder, field, **more):
    body = {"fixed": True, "shapes": [{"heightfield": field}], **more}
    data = {"name": "s", "contact": {"materials": {"soil": {}}}, "bodies": {"ground": body}}
    return Spec.from_data(data, folder=folder)


def shape_of(folder, field, **more):
    return ground(folder, field, **more).resolve().bodies[0].shapes[0]


def problems(folder, field, **more):
    with pytest.raises(SpecError) as caught:
        ground(folder, field, **more).resolve()
    return caught.value.problems


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "pyproject.toml").touch()
    return tmp_path


ROWS = [[0.3, 0.2, 0.4], [0.5, 0.1, "20 cm"]]


def test_rows_are_a_map_whose_lowest_point_is_at_the_shapes_origin(folder):
    shape = shape_of(folder, {"rows": ROWS, "size": [4, "300 cm"], "base": "5 dm"})
    field = field_of(shape.size)
    assert (field.x, field.y, field.base) == (4.0, 3.0, 0.5)
    np.testing.assert_allclose(field.heights, [[0.4, 0.0, 0.1], [0.2, 0.1, 0.3]], atol=1e-16)
    assert shape.pose.position == (0.0, 0.0, 0.1)
    assert shape.material == "soil"


def test_heights_scale_the_values(folder):
    shape = shape_of(folder, {"rows": ROWS, "size": [4, 3], "heights": [-1, 1]})
    assert shape.pose.position == (0.0, 0.0, -1.0)
    np.testing.assert_allclose(field_of(shape.size).heights, np.array([[4, 0, 1], [2, 1, 3]]) * 0.5, atol=1e-15)
    flat = shape_of(folder, {"rows": [[2, 2], [2, 2]], "size": [1, 1], "heights": [0.25, 1]})
    assert flat.pose.position == (0.0, 0.0, 0.25)
    assert set(flat.size[HEIGHTFIELD_HEAD:]) == {0.0}


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("filters", [None, [0, 1, 2, 3, 4], [4, 3]])
def test_a_picture_is_read_with_every_filter(folder, depth, filters):
    shades = np.random.default_rng(depth).integers(0, 256 ** (depth // 8), (9, 6))
    (folder / "map.PNG").write_bytes(png(shades, depth, filters))
    np.testing.assert_array_equal(read_grid(folder / "map.PNG"), shades)
    shape = shape_of(folder, {"file": "map.PNG", "size": [2, 2], "heights": [0, 0.5]})
    share = (shades[::-1] - shades.min()) / (shades.max() - shades.min())
    np.testing.assert_allclose(field_of(shape.size).heights, 0.5 * share, atol=1e-15)


@pytest.mark.parametrize("text", ["# of a survey\n1, 2,3\n\n4,5e0,-6\n", "1 2 3\r\n 4\t5 -6"])
def test_a_text_is_heights_in_metres(folder, text):
    (folder / "map.csv").write_text(text)
    shape = shape_of(folder, {"file": "map.csv", "size": [2, 2]})
    assert field_of(shape.size).heights.tolist() == [[10.0, 11.0, 0.0], [7.0, 8.0, 9.0]]
    assert shape.pose.position == (0.0, 0.0, -6.0)


BAD = {
    "rows of two lengths": ({"rows": [[1, 2], [1, 2, 3]], "size": [1, 1]}, "rows.1", "equally long"),
    "one row": ({"rows": [[1, 2]], "size": [1, 1]}, "rows", "at least 2 rows"),
    "one column": ({"rows": [[1], [2]], "size": [1, 1]}, "rows.0", "equally long"),
    "a word": ({"rows": [[1, 2], [1, "high"]], "size": [1, 1]}, "rows.1.1", ""),
    "an angle": ({"rows": [[1, 2], ["3 deg", 1]], "size": [1, 1]}, "rows.1.0", ""),
    "no size": ({"rows": [[1, 2], [1, 2]]}, "size", ""),
    "a flat size": ({"rows": [[1, 2], [1, 2]], "size": [1, 0]}, "size.1", "above 0"),
    "no base": ({"rows": [[1, 2], [1, 2]], "size": [1, 1], "base": 0}, "base", "above 0"),
    "upside down": ({"rows": [[1, 2], [1, 2]], "size": [1, 1], "heights": [1, 0]}, "heights", "least"),
    "both": ({"rows": [[1, 2], [1, 2]], "file": "a.csv", "size": [1, 1]}, "file", "exclude"),
    "neither": ({"size": [1, 1]}, "", "rows, file"),
    "another file": ({"file": "map.tif", "size": [1, 1]}, "file", "not a file of heights"),
    "no heights": ({"file": "map.png", "size": [1, 1]}, "", "heights is missing"),
    "no such file": ({"file": "map.csv", "size": [1, 1]}, "file", "no such file"),
    "outside": ({"file": "../map.csv", "size": [1, 1]}, "file", "leaves the project folder"),
    "too many": ({"rows": [[0.0] * 600] * 600, "size": [1, 1]}, "rows", "too many"),
}


@pytest.mark.parametrize("name", BAD)
def test_errors_have_their_location(folder, name):
    field, path, said = BAD[name]
    (found, *_) = problems(folder, field)
    assert found.path == ".".join(filter(None, ("bodies.ground.shapes.0.heightfield", path)))
    assert said in found.message


def test_only_fixed_bodies_have_height_fields(folder):
    field = {"rows": [[1, 2], [1, 2]], "size": [1, 1]}
    (found,) = problems(folder, field, fixed=False, mass=1.0, inertia={"principal": [1, 1, 1]})
    assert found.message == "a height field requires a body fixed to the world, and this body moves"
    data = {
        "name": "s",
        "contact": {"materials": {"soil": {}}},
        "bodies": {"ground": {"fixed": True, "shapes": [{"heightfield": field, "density": 1000}]}},
    }
    with pytest.raises(SpecError, match="no density"):
        Spec.from_data(data, folder=folder).resolve()


WICKED = {
    "no picture": (b"GIF89a", "no PNG"),
    "cut": (png([[1, 2], [3, 4]])[:-5], "ends too early"),
    "a wrong checksum": (png([[1, 2], [3, 4]])[:-1] + b"\0", "checksum"),
    "colours": (png([[1, 2], [3, 4]], colours=2), "grey"),
    "interlaced": (png([[1, 2], [3, 4]], interlaced=1), "interlaced"),
    "one line": (png([[1, 2]]), "at least 2"),
    "a line too few": (png([[1, 2], [3, 4]], high=3), "not as many"),
    "a line too many": (png([[1, 2], [3, 4], [5, 6]], high=2), "not as many"),
    "enormous": (png([[1, 2], [3, 4]], wide=2**31, high=2**31), "more than the"),
    "no deflate": (png([[1, 2], [3, 4]], body=b"nonsense, long enough"), "damaged"),
    "a bomb": (png([[1, 2], [3, 4]], body=zlib.compress(b"\0" * 50_000_000, 9)), "not as many"),
    "an unknown filter": (png([[1, 2], [3, 4]], body=zlib.compress(b"\x07ab\x07cd")), "unknown way 7"),
}


@pytest.mark.parametrize("name", WICKED)
def test_a_wicked_picture_is_an_error(folder, name):
    content, said = WICKED[name]
    (folder / "map.png").write_bytes(content)
    (found,) = problems(folder, {"file": "map.png", "size": [1, 1], "heights": [0, 1]})
    assert said in found.message
    assert found.path == "bodies.ground.shapes.0.heightfield.file"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"1,2\n3", "1 numbers in line 2"),
        (b"1,nan\n3,4", "'nan' in line 1"),
        (b"1,2\n3,1_0", "'1_0' in line 2"),
        (b"1,2\n3,\xd9\xa3", "not ASCII at byte 6"),
        (b"1e400,2\n3,4", "1e400"),
        (b"", "0 rows"),
        (b"1,2\n" * 2**18, "more than the"),
        (b"#" * (17 * 2**20), "bytes"),
    ],
)
def test_a_wicked_text_is_an_error(folder, content, said):
    (folder / "map.txt").write_bytes(content)
    with pytest.raises(MeshError, match=said.replace("'", ".")):
        read_grid(folder / "map.txt")


def test_all_fields_of_a_world_share_the_limit_of_heights(folder):
    (folder / "map.csv").write_text("\n".join([",".join(["0"] * 500)] * 400))
    shape = {"heightfield": {"file": "map.csv", "size": [9, 9]}}
    data = {
        "name": "s",
        "contact": {"materials": {"soil": {}}},
        "bodies": {"one": {"fixed": True, "shapes": [shape]}, "two": {"fixed": True, "shapes": [shape]}},
    }
    with pytest.raises(SpecError, match="400,000 heights, copies included"):
        Spec.from_data(data, folder=folder).resolve()
