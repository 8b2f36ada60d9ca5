"""MJCF files of the emitter, read by a parser that shares only the names of constants with it."""

from __future__ import annotations

import dataclasses
import re
from xml.etree import ElementTree

import pytest

from simspec.compiler import write_folder
from simspec.dialects.mujoco.dialect import MujocoDialect
from simspec.errors import UnsupportedError
from simspec.formats.mjcf.bodies import depth_first
from simspec.formats.mjcf.format import MODEL
from simspec.formats.mjcf.tree import FILTER_BITS
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import Physics, Pose, Shape, World
from tests import worlds
from tests.dialects.mujoco.saying import WORLDS, as_stored, box_world, differences, emit, frictional


@pytest.mark.parametrize("name", WORLDS)
def test_the_independent_reader_finds_the_world(name, tmp_path):
    world = WORLDS[name]
    write_folder(emit(world), tmp_path / "a")
    found = MujocoDialect().read(tmp_path / "a")
    assert differences(as_stored(world), found.bodies) == []
    assert found.gravity == world.physics.gravity
    assert found.timestep == world.physics.timestep
    assert found.friction_cone == world.contact.friction_cone


def test_same_input_same_bytes():
    assert emit(worlds.gripper()) == emit(worlds.gripper())


def test_ratings_and_flags_of_shapes_survive(tmp_path):
    base = worlds.limits_and_armature()
    shapes = tuple(
        Shape(f"s{i}", "sphere", (0.1,), Pose(), "default" if c else "", c, v, (0.1, 0.2, 0.3, 0.5))
        for i, (c, v) in enumerate(((True, True), (True, False), (False, True), (False, False)))
    )
    bodies = (*base.bodies[:-1], dataclasses.replace(base.bodies[-1], shapes=shapes))
    bodies = (
        *bodies[:1],
        dataclasses.replace(bodies[1], joint=dataclasses.replace(bodies[1].joint, velocity_limit=None)),
        *bodies[2:],
    )
    contact = dataclasses.replace(base.contact, materials=(worlds.MATERIAL,))
    world = dataclasses.replace(base, bodies=bodies, contact=contact)
    write_folder(emit(world), tmp_path / "a")
    assert differences(as_stored(world), MujocoDialect().read(tmp_path / "a").bodies) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r' mass="[1-9][^"]*"', ' mass="9"'),
        (r'diaginertia="\S+ ', 'diaginertia="0.5 '),
        (r'axis="\S+ ', 'axis="0.01 '),
        (r'springref="0\.1"', 'springref="0.2"'),
        (r'damping="0\.3"', 'damping="0.4"'),
        (r'qpos="\S+ ', 'qpos="0.123 '),
        (r'qvel="\S+ ', 'qvel="0.123 '),
        (r'gravity="0 0 -9.81"', 'gravity="0 0 -9.8"'),
    ],
)
def test_a_changed_file_is_read_as_changed(old, new, tmp_path):
    world = worlds.damped_springs()
    files = emit(world)
    changed = re.sub(old, new, files[MODEL], count=1)
    assert changed != files[MODEL]
    write_folder({**files, MODEL: changed}, tmp_path / "a")
    found = MujocoDialect().read(tmp_path / "a")
    wrong = differences(as_stored(world), found.bodies)
    assert wrong or found.gravity != world.physics.gravity


def test_damaged_files_are_refused(tmp_path):
    files = emit(worlds.gripper())
    cases = (
        ('<body name="bar"', '<body name="rod"', "missing"),
        ('qvel="0 ', 'qvel="', "velocities"),
        ('<joint name="bar_joint"', '<site name="x"/><joint name="bar_joint"', "no attribute 'pos'"),
        ('<joint name="bar_joint"', '<site name="x"/><site name="x"/><joint name="bar_joint"', "another site 'x'"),
        ('<joint name="bar_joint"', '<camera name="x"/><joint name="bar_joint"', "not read"),
        ('angle="radian"', 'angle="degree"', "radian"),
        ('friction="0.4 0.4 0 0 0"', 'friction="0.4 0.5 0 0 0"', "not isotropic"),
    )
    for number, (old, new, message) in enumerate(cases):
        changed = files[MODEL].replace(old, new, 1)
        assert changed != files[MODEL]
        write_folder({**files, MODEL: changed}, tmp_path / f"{number}")
        with pytest.raises(ValueError, match=message):
            MujocoDialect().read(tmp_path / f"{number}")


@pytest.mark.parametrize("restitution", [0.0, 0.05, 0.5, 1.0])
@pytest.mark.parametrize("timestep", [1e-3, 2e-3, 1 / 240])
def test_restitution_is_read_at_any_timestep(restitution, timestep, tmp_path):
    world = dataclasses.replace(frictional(restitution, 100), physics=Physics(timestep=timestep))
    write_folder(emit(world), tmp_path / "a")
    assert differences(as_stored(world), MujocoDialect().read(tmp_path / "a").bodies) == []


def touching_by_the_file(world: World) -> set[tuple[str, str]]:
    """The pairs that MuJoCo's documented rule lets touch, worked out from the text."""
    root = ElementTree.fromstring(emit(world)[MODEL])
    main = next(iter(root.iterfind("default/geom"))).attrib
    masks = {}
    for body in root.iter("body"):
        for geom in body.findall("geom"):
            masks[body.attrib["name"]] = tuple(int(geom.get(name, main[name])) for name in ("contype", "conaffinity"))
    excluded = {tuple(sorted((e.attrib["body1"], e.attrib["body2"]))) for e in root.iter("exclude")}
    names = sorted(masks)
    return {
        (a, b)
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if (masks[a][0] & masks[b][1] or masks[b][0] & masks[a][1]) and (a, b) not in excluded
    }


@pytest.mark.parametrize(
    ("groups", "ignored"),
    [
        (["a", "a", "b", "b", "c"], ()),
        (["a", "a", "b", "b", "c"], (("a", "a"),)),
        (["a", "a", "b", "b", "c", "d"], (("a", "b"), ("b", "b"), ("c", "d"))),
        (["a", "b", "c"], (("a", "a"), ("a", "b"), ("a", "c"), ("b", "b"), ("b", "c"), ("c", "c"))),
        ([f"g{i:02}" for i in range(FILTER_BITS + 3)], tuple((f"g{i:02}", f"g{i:02}") for i in range(FILTER_BITS + 3))),
        (
            [f"g{i // 2:02}" for i in range(2 * FILTER_BITS)],
            (*((f"g{i:02}", f"g{i:02}") for i in range(FILTER_BITS)), ("g00", "g05")),
        ),
    ],
)
def test_masks_and_excludes_give_exactly_the_filter(groups, ignored):
    world = box_world(groups, tuple(sorted(ignored)))
    allowed = CollisionFilter(world)
    names = sorted(body.name for body in world.bodies)
    want = {(a, b) for i, a in enumerate(names) for b in names[i + 1 :] if allowed.may_touch(a, b)}
    assert touching_by_the_file(world) == want


def test_excluded_pairs_stand_in_the_file():
    root = ElementTree.fromstring(emit(worlds.gripper())[MODEL])
    found = [(e.attrib["body1"], e.attrib["body2"]) for e in root.iter("exclude")]
    assert found == [("bar", "palm"), ("left", "palm"), ("palm", "right")]


def test_friction_lists_exactly_the_pairs_that_may_touch():
    world = worlds.gripper()
    root = ElementTree.fromstring(emit(world)[MODEL])
    found = {
        frozenset((p.attrib["geom1"][:-2], p.attrib["geom2"][:-2])) for p in root.iter("pair") if "geom1" in p.attrib
    }
    assert found == {frozenset(("bar", "left")), frozenset(("bar", "right"))}


def test_too_many_frictional_pairs_are_omitted_and_reported():
    assert "<pair geom1" in emit(frictional(0.0, 100))[MODEL]
    files = emit(frictional(0.0, 3))
    assert "<pair geom1" not in files[MODEL]
    assert '"explicit_pairs": false' in files["sidecar.json"]


def test_too_many_frictional_pairs_that_bounce_are_refused():
    with pytest.raises(UnsupportedError, match="explicit_pairs_limit"):
        emit(frictional(0.5, 3))


def test_equal_limits_are_refused_by_name():
    world = worlds.limits_and_armature()
    joint = dataclasses.replace(world.bodies[1].joint, position_limits=(0.5, 0.5))
    bodies = (world.bodies[0], dataclasses.replace(world.bodies[1], joint=joint), *world.bodies[2:])
    with pytest.raises(UnsupportedError, match="equal"):
        emit(dataclasses.replace(world, bodies=bodies))


def test_a_body_called_world_keeps_its_name(tmp_path):
    body = dataclasses.replace(worlds.tree(["free"], 1)[0], name="world", model="world")
    world = worlds.world((body,))
    write_folder(emit(world), tmp_path / "a")
    assert MujocoDialect().read(tmp_path / "a").bodies[0].name == "world"


def test_names_cannot_break_the_file(tmp_path):
    name = "a<&\"'>é b"
    world = dataclasses.replace(worlds.world(worlds.tree(["free", "hinge"], 1, prefix=name)), name=name)
    write_folder(emit(world), tmp_path / "a")
    assert [body.name for body in MujocoDialect().read(tmp_path / "a").bodies] == [body.name for body in world.bodies]


def test_a_deep_chain_is_written_in_linear_size_and_read(tmp_path):
    """Any depth; the bytes per body do not grow (an uncapped indent would add 2 bytes per level and line)."""
    sizes = {}
    for count in (200, 3000):
        bodies = worlds.tree(["hinge"] * count, 5)
        files = emit(worlds.world(bodies))
        sizes[count] = len(files[MODEL]) / count
    assert sizes[3000] < 1.05 * sizes[200]
    write_folder(files, tmp_path / "a")
    found = MujocoDialect().read(tmp_path / "a")
    assert [body.name for body in found.bodies] == [body.name for body in bodies]


def test_the_file_is_depth_first_for_every_order_of_the_world():
    bodies = worlds.tree(["fixed", "hinge", "hinge", "hinge", "hinge"], 3, [-1, 0, 0, 1, 2])
    order = depth_first(worlds.world(bodies))
    assert [row.body.name for row in order] == ["link0", "link1", "link3", "link2", "link4"]
    assert [row.depth for row in order] == [0, 1, 2, 1, 2]
