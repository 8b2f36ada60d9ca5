"""Trees of the MJCF language as files, and back: by the format alone, without any engine."""

from __future__ import annotations

import dataclasses
import math

import pytest

from simspec.compiler import write_folder
from simspec.formats.kit.contract import formats
from simspec.formats.mjcf import tree as contact
from simspec.formats.mjcf.format import MODEL, Mjcf
from simspec.formats.mjcf.reading import MjcfDocument
from simspec.formats.mjcf.tree import MjcfBody, MjcfKey, MjcfModel
from simspec.support.declarations import check_total
from tests.formats.mjcf.models import AT, FULL, STRAIGHT
from tests.runner.synthetic import free_body, world


def written_and_read(model: MjcfModel, tmp_path) -> MjcfDocument:
    write_folder(Mjcf().write(model), tmp_path / "files")
    return Mjcf().read(tmp_path / "files")


def test_written_files_are_read_back(tmp_path):
    document = written_and_read(FULL, tmp_path)
    assert document.root.attributes["model"] == FULL.name
    assert document.compiler.values == {"angle": "radian", "autolimits": "false", "boundmass": "0"}
    assert document.option.numbers("gravity") == (0.0, 0.0, -9.81)
    assert document.flags.values == {"contact": "enable", "limit": "disable"}
    assert document.size.values == {"nuser_jnt": "2"}
    assert set(document.classes) == {"main", "soft", "eye"}
    depths: list[int] = []
    for body in document.bodies:
        depths.append(0 if body.parent is None else depths[body.parent] + 1)
    assert [body.item.text("name") for body in document.bodies] == [body.name for body in FULL.bodies]
    assert depths == [body.depth for body in FULL.bodies]
    for body, wanted in zip(document.bodies, FULL.bodies, strict=True):
        assert body.item.numbers("pos") == wanted.position
        assert body.item.numbers("quat") == wanted.orientation
        assert [item.text("name") for item in body.all("joint")] == [joint.name for joint in wanted.joints]
        assert [item.text("name") for item in body.all("geom")] == [geom.name for geom in wanted.geoms]
    (inertial,) = document.bodies[0].all("inertial")
    assert inertial.number("mass") == 2.5
    assert inertial.numbers("diaginertia") == (1.0, 2.0, 2.5)
    two = document.bodies[2].all("geom")[0]
    assert two.class_name == "soft"
    assert (two.text("group"), two.numbers("solref"), two.text("condim")) == ("4", (0.02, 1.0), "4")
    assert document.bodies[1].all("geom")[0].text("group") == "3"
    assert document.bodies[1].all("joint")[0].number("damping") == 0.5
    assert [item.tag for item in document.section("contact")] == ["pair", "exclude"]
    assert [item.text("name") for item in document.section("keyframe")] == ["start", "end"]
    assert document.section("actuator")[0].tag == "position"
    assert not document.unknown
    assert not document.includes
    assert not document.world


def test_an_empty_model_is_a_sound_file(tmp_path):
    document = written_and_read(MjcfModel("empty"), tmp_path)
    assert not document.bodies
    assert document.section("keyframe") == document.section("contact") == ()


def test_the_same_tree_gives_the_same_bytes():
    assert Mjcf().write(FULL) == Mjcf().write(dataclasses.replace(FULL))


def test_numbers_are_written_to_the_last_bit(tmp_path):
    values = (0.1, 1 / 3, 5e-324, 1.7976931348623157e308, math.pi, -0.0)
    document = written_and_read(MjcfModel("numbers", keys=(MjcfKey("all", values, ()),)), tmp_path)
    assert document.section("keyframe")[0].numbers("qpos") == values
    assert document.section("keyframe")[0].numbers("qvel") == ()


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_numbers_that_are_not_finite_are_not_written(value):
    with pytest.raises(ValueError, match="cannot be written"):
        Mjcf().write(MjcfModel("bad", option=(("timestep", value),)))


@pytest.mark.parametrize("depths", [(1,), (0, 2), (0, 1, 3), (0, -1)])
def test_bodies_that_are_not_depth_first_are_refused(depths):
    bodies = tuple(MjcfBody(f"b{index}", AT, STRAIGHT, depth) for index, depth in enumerate(depths))
    with pytest.raises(ValueError, match=r"(the body|the bodies after) 'b\d'"):
        Mjcf().write(MjcfModel("bad", bodies=bodies))


def test_a_deep_chain_grows_with_its_length():
    sizes = [
        len(
            Mjcf().write(
                MjcfModel("chain", bodies=tuple(MjcfBody("b", AT, STRAIGHT, depth) for depth in range(count)))
            )[MODEL]
        )
        for count in (200, 4000)
    ]
    assert sizes[1] < 21.0 * sizes[0]


def test_another_tree_is_refused():
    with pytest.raises(TypeError, match="str is not a Model"):
        Mjcf().write("model")


def test_the_format_is_offered_with_the_features_of_its_language():
    assert isinstance(formats()["mjcf"], Mjcf)
    check_total("format mjcf", Mjcf.SUPPORT)


def test_the_arena_grows_with_the_longest_path_of_joints():
    """Bodies without shapes have the rows of limits and dry friction alone, each with the velocities on its path."""
    count = contact.MOST_BY_DEFAULT // 6 + 1
    bodies = [free_body(f"b{index}") for index in range(count)]
    for path, parents in ((6, [None] * count), (12, [None, *["b0"] * (count - 1)])):
        tree = [
            dataclasses.replace(body, joint=dataclasses.replace(body.joint, parent=parent))
            for body, parent in zip(bodies, parents, strict=True)
        ]
        rows = 2 * 6 * count * (contact.ROW_BYTES + 2 * path * contact.ENTRY_BYTES)
        size = contact.BASE + rows + contact.PAIR_BYTES * (1 + count) ** 2
        assert contact.arena_megabytes(world(*tree), newton=False) == math.ceil(size / contact.MIB)
