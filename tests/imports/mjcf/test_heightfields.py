"""Height fields of MJCF: the spec's are those of the compiled model, from numbers and from pictures."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.language.load import load
from simspec.testing.worlds import accepting
from simspec.world.shapes import field_of
from tests.imports.mjcf.models import lost, read, written
from tests.pictures import png

pytestmark = pytest.mark.usefixtures("warm_readers")

mujoco = pytest.importorskip("mujoco")
NUMBERS = np.random.default_rng(3).uniform(-2.0, 5.0, (4, 6))
TEXT = """<mujoco>
  <compiler assetdir="assets"/>
  <asset><hfield name="ground" {said} size="1 0.75 0.4 0.2"/></asset>
  <worldbody>
    <body name="stand" pos="0 0 1" quat="0.9 0.1 0 0">
      <geom name="field" type="hfield" hfield="ground" pos="0.1 0.2 0.3" quat="0.8 0 0 0.6" friction="0.7"/>
    </body>
    <body name="ball" pos="0 0 2"><freejoint/><geom size="0.1"/></body>
  </worldbody>
</mujoco>
"""


def inline() -> str:
    return f'nrow="4" ncol="6" elevation="{" ".join(map(str, NUMBERS.ravel()))}"'


def project(folder, said: str, text: str = TEXT, picture: bytes = b""):
    (folder / "pyproject.toml").touch()
    if picture:
        (folder / "assets").mkdir()
        (folder / "assets" / "ground.png").write_bytes(picture)
    return written(folder, text.format(said=said))


@pytest.mark.parametrize("kind", ["inline", "picture"])
def test_the_compiled_spec_has_the_same_heights(kind, tmp_path):
    shades = np.random.default_rng(4).integers(3, 200, (5, 7))
    picture = png(shades) if kind == "picture" else b""
    said = inline() if kind == "inline" else 'file="ground.png"'
    path = project(tmp_path, said, picture=picture)
    imported = read(path)
    assert not lost(imported)
    (shape,) = imported.data["model" if "model" in imported.data else "bodies"]["stand"]["shapes"]
    assert ("file" in shape["heightfield"]) == (kind != "inline")
    assert shape["heightfield"]["size"] == [2.0, 1.5]
    original = mujoco.MjModel.from_xml_path(str(path))
    world = load(path).resolve()
    (stand,) = [body for body in world.bodies if body.name.endswith("stand")]
    rows, columns = field_of(stand.shapes[0].size).shape
    values = np.asarray(original.hfield_data, float).reshape(rows, columns) * 0.4
    np.testing.assert_allclose(field_of(stand.shapes[0].size).heights, values, atol=1e-7)
    files = compile_world(accepting(world, "mujoco"), ["mujoco"])["mujoco"].files
    again = mujoco.MjModel.from_xml_string(files["model.xml"])
    assert np.array_equal(again.hfield_data, original.hfield_data) or kind != "inline"
    np.testing.assert_allclose(again.hfield_data, original.hfield_data, atol=1e-7)
    np.testing.assert_allclose(again.hfield_size, original.hfield_size, rtol=1e-6)
    geom = mujoco.mj_name2id(again, mujoco.mjtObj.mjOBJ_GEOM, "field")
    np.testing.assert_allclose(again.geom_pos[geom], original.geom_pos[0], atol=1e-12)
    np.testing.assert_allclose(again.geom_quat[geom], original.geom_quat[0], atol=1e-12)


def test_a_moving_height_field_is_lost(tmp_path):
    text = TEXT.replace('quat="0.9 0.1 0 0">', 'quat="0.9 0.1 0 0"><joint/><geom size="0.1"/>')
    imported = read(project(tmp_path, inline(), text))
    assert "geom.kind" in str(lost(imported)) or any(
        "height field that may move" in str(loss) for loss in lost(imported)
    )
