"""The contact law in MJCF: which pairs are explicit, hardness there and back, masks of shapes, and what is refused."""

from __future__ import annotations

import dataclasses
import itertools
import re
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.compiler import target_of, write_folder
from simspec.dialects.mujoco.contact import reference
from simspec.dialects.mujoco.dialect import MujocoDialect
from simspec.dialects.mujoco.sidecar import CommonLaw, surface
from simspec.engines.mujoco.engine import MuJoCo
from simspec.errors import UnsupportedError
from simspec.formats.mjcf.format import MODEL
from simspec.formats.mjcf.tree import FILTER_BITS
from simspec.proof.comparator import compare
from simspec.world.types import Body, Contact, Hardness, Inertial, Joint, Material, PairContact, Pose, Shape, World
from tests import worlds

TABLE = {("a", "a"): 0.1, ("a", "b"): 0.8, ("b", "b"): 0.4}
"""No values of single shapes have these as their maxima."""
HARDNESS = {
    "common": Hardness(),
    "time-constant": Hardness("time-constant", time_constant=0.02, damping_ratio=0.7),
    "stiffness": Hardness("stiffness", stiffness=1e5, damping=120.0),
    "native": Hardness("native"),
}


def emit(world: World) -> dict[str, str]:
    return MujocoDialect().emit(world, target_of(world, MuJoCo))


def listed(world: World) -> dict[frozenset[str], dict[str, str]]:
    """The explicit pairs of a world's file."""
    contact = ElementTree.fromstring(emit(world)[MODEL]).find("contact")
    assert contact is not None
    return {frozenset((pair.attrib["geom1"], pair.attrib["geom2"])): pair.attrib for pair in contact.findall("pair")}


def laws(world: World, **changes: object) -> World:
    """The world with every law changed."""
    pairs = tuple(dataclasses.replace(pair, **changes) for pair in world.contact.pairs)
    return dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))


def wrong(world: World, files: dict[str, str], tmp_path) -> set[str]:
    """The differences that the comparator finds in the result of the independent reader."""
    write_folder(files, tmp_path / "a")
    checks = compare(world, MujocoDialect().read(tmp_path / "a"), MuJoCo.RULES, MuJoCo.LAYERS, text=True)
    return {check.name for check in checks if not check.passed}


# --- explicit pairs -----------------------------------------------------------------------------------------------


def test_pairs_are_explicit_only_where_needed():
    world = worlds.table(dict.fromkeys(TABLE, 0.0))
    assert listed(world) == {}
    # the larger number does: explicit for the friction alone, and none under the pyramid, where that has no reference
    world = worlds.table({("a", "a"): 0.1, ("a", "b"): 0.4, ("b", "b"): 0.4})
    shapes = [shape.name for body in world.bodies for shape in body.shapes if not body.name.startswith("tile")]
    tiles = ["tile_a_0", "tile_b_0"]
    expected = {frozenset(pair) for pair in (*itertools.combinations(shapes, 2), *itertools.product(shapes, tiles))}
    assert set(listed(world)) == expected
    pyramid = dataclasses.replace(world.contact, friction_cone="pyramid-inscribed")
    assert listed(dataclasses.replace(world, contact=pyramid)) == {}


def test_laws_that_no_shape_numbers_give_are_explicit_pairs_under_every_cone():
    world = worlds.table(TABLE)
    contact = dataclasses.replace(world.contact, friction_cone="pyramid-inscribed")
    found = listed(dataclasses.replace(world, contact=contact))
    assert found[frozenset(("b_on_a_0", "tile_a_0"))]["friction"] == "0.8 0.8 0 0 0"
    assert frozenset(("a_on_a_0", "a_on_b_0")) not in found  # a with a is what their numbers give


def test_restitution_of_a_pair_alone_is_explicit():
    world = worlds.table(dict.fromkeys(TABLE, 0.0))
    pairs = tuple(dataclasses.replace(p, restitution=0.5 if p.first != p.second else 0.0) for p in world.contact.pairs)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    found = listed(world)
    assert found[frozenset(("b_on_a_0", "tile_a_0"))]["solref"] == "-10000 -1500"
    assert found[frozenset(("b_on_a_0", "tile_a_0"))]["condim"] == "1"


def test_too_many_pairs_fall_back_to_numbers_or_are_refused_by_name():
    world = worlds.table(TABLE)
    count = len(listed(world))
    # the bound knows only numbers of shapes: three of each material, 3·3/2 + 3·3 + 3·3/2
    for limit, expected in ((18, count), (17, 8)):
        limited = worlds.with_options(world, "mujoco", settings=(("explicit_pairs_limit", limit),))
        assert len(listed(limited)) == expected
    with pytest.raises(UnsupportedError, match="explicit_pairs_limit") as caught:
        emit(worlds.with_options(world, "mujoco", settings=(("explicit_pairs_limit", 2),)))
    assert [problem.path for problem in caught.value.problems] == ["contact.pairs.a.b"]


def test_beyond_the_limit_pairs_use_the_values_of_their_shapes():
    """Pairs whose numbers do are dropped before those whose numbers do not."""
    world = worlds.table(TABLE)
    needed = [pair for pair, given in listed(world).items() if given["friction"].startswith("0.8")]
    most = 3 * 3 + 1  # bound of a with b: three shapes of each
    files = emit(worlds.with_options(world, "mujoco", settings=(("explicit_pairs_limit", most),)))
    root = ElementTree.fromstring(files[MODEL])
    kept = {frozenset((p.attrib["geom1"], p.attrib["geom2"])) for p in root.iterfind("contact/pair")}
    assert kept == set(needed)
    assert '"explicit_pairs": false' in files["sidecar.json"]


# --- hardness -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("kind", HARDNESS)
def test_hardness_is_read_as_written(kind, friction, tmp_path):
    world = laws(worlds.table(dict.fromkeys(TABLE, friction)), hardness=HARDNESS[kind])
    assert wrong(world, emit(world), tmp_path) == set()


@pytest.mark.parametrize("kind", HARDNESS)
def test_the_hardness_of_a_single_pair_is_read_as_written(kind, tmp_path):
    world = worlds.table(dict.fromkeys(TABLE, 0.3))
    pairs = tuple(
        dataclasses.replace(p, hardness=HARDNESS[kind]) if p.first != p.second else p for p in world.contact.pairs
    )
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    assert wrong(world, emit(world), tmp_path) == set()


DAMAGE = [
    ("common", 'solref="-10000 -1000"', 'solref="-9999 -1000"'),
    ("common", 'solimp="0.01 0.999 0.0001 0.5 2"', 'solimp="0.01 0.999 0.0002 0.5 2"'),
    ("common", 'solimp="0.01 0.999 0.0001 0.5 2"', 'solimp="0.02 0.999 0.0001 0.5 2"'),
    ("time-constant", 'solref="0.02 0.7"', 'solref="0.021 0.7"'),
    ("time-constant", 'solref="0.02 0.7"', 'solref="0.02 0.71"'),
    ("time-constant", 'solimp="0.0001 0.0001 0.001 0.5 2"', 'solimp="0.9 0.9 0.001 0.5 2"'),
    ("stiffness", r'solref="-99990 ', 'solref="-99900 '),
    ("stiffness", r'solimp="0.0001 0.0001 0.001 0.5 2"', 'solimp="0.1 0.1 0.001 0.5 2"'),
    ("native", 'solref="0.02 1"', 'solref="0.02 1.1"'),
    ("native", 'solimp="0.9 0.95 0.001 0.5 2"', 'solimp="0.9 0.96 0.001 0.5 2"'),
]


@pytest.mark.parametrize(("kind", "old", "new"), DAMAGE)
def test_changed_hardness_is_found(kind, old, new, tmp_path):
    world = laws(worlds.table(dict.fromkeys(TABLE, 0.5)), hardness=HARDNESS[kind])
    files = emit(world)
    head, tail = files[MODEL].split("<contact>")
    if old in tail:  # an explicit pair says it itself
        tail = tail.replace(old, new, 1)
    elif kind == "common":  # all pairs share it
        head = re.sub(f"(<pair [^>]*){old}", rf"\1{new}", head)
    else:  # shapes alone hold it
        head = re.sub(f"(material/a.>\\s*<geom [^>]*){old}", rf"\1{new}", head)
    changed = "<contact>".join((head, tail))
    assert changed != files[MODEL]
    assert "hardness" in wrong(world, {**files, MODEL: changed}, tmp_path)


def test_a_margin_is_found(tmp_path):
    world = worlds.table(TABLE)
    files = emit(world)
    changed = files[MODEL].replace('condim="3" margin="0"', 'condim="3" margin="0.001"', 1)
    assert changed != files[MODEL]
    assert "margin" in wrong(world, {**files, MODEL: changed}, tmp_path)


@pytest.mark.parametrize(
    ("law", "timestep", "hardness"),
    [
        ({}, 1e-3, 1e3),
        ({"torsional_friction": 0.01}, 1e-3, 1e3),
        ({"rolling_friction": 5e-4}, 1e-3, 1e4),  # 0.01 (0.5/5e-4)² / 4 = 2,500
        ({"rolling_friction": 5e-4}, 5e-4, 1e4),  # exactly
        ({"rolling_friction": 5e-4}, 2.5e-4, 1e5),
        ({"torsional_friction": 0.01, "rolling_friction": 1e-4}, 5e-4, 1e6),
        ({"rolling_friction": 1e-8}, 5e-4, 1e7),
        ({"hardness": HARDNESS["time-constant"]}, 1e-3, 1e7),
    ],
)
def test_friction_is_harder_where_it_must_carry_more(law, timestep, hardness):
    world = laws(worlds.table(dict.fromkeys(TABLE, 0.5)), **law)
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=timestep))
    option = ElementTree.fromstring(emit(world)[MODEL]).find("option")
    assert option is not None
    assert float(option.attrib["impratio"]) == hardness


# --- which shapes touch -------------------------------------------------------------------------------------------


def shapes_of(kinds: list[tuple[str, str]], ignored=(), passing=(), per_body: int = 1) -> World:
    """Free bodies of ``per_body`` spheres each, of these (group, material); a body has the group of its first."""
    groups = [kinds[index : index + per_body] for index in range(0, len(kinds), per_body)]
    bodies = tuple(
        Body(
            f"b{i}",
            f"b{i}",
            Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)),
            Joint(f"j{i}", "free", position=(float(i), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
            tuple(Shape(f"s{i}_{k}", "sphere", (0.1,), Pose(), material) for k, (_, material) in enumerate(group)),
            group[0][0],
        )
        for i, group in enumerate(groups)
    )
    names = sorted({material for _, material in kinds})
    pairs = tuple(
        PairContact(a, b, 0.0, 0.0, collide=(a, b) not in passing)
        for a, b in itertools.combinations_with_replacement(names, 2)
    )
    contact = Contact(materials=tuple(Material(name) for name in names), pairs=pairs, ignored_groups=tuple(ignored))
    return World("shapes", bodies, contact)


def touching(world: World) -> set[frozenset[str]]:
    """Shapes of different bodies that touch by MuJoCo's documented rule, worked out from the text."""
    root = ElementTree.fromstring(emit(world)[MODEL])
    main = next(iter(root.iterfind("default/geom"))).attrib
    separate = {frozenset((e.attrib["body1"], e.attrib["body2"])) for e in root.iter("exclude")}
    geoms = [
        (body.attrib["name"], geom.attrib["name"], *(int(geom.get(n, main[n])) for n in ("contype", "conaffinity")))
        for body in root.iter("body")
        for geom in body.findall("geom")
    ]
    return {
        frozenset((geom[1], two[1]))
        for geom, two in itertools.combinations(geoms, 2)
        if geom[0] != two[0] and frozenset((geom[0], two[0])) not in separate and (geom[2] & two[3] or two[2] & geom[3])
    }


def wanted(world: World) -> set[frozenset[str]]:
    """The same by the world's own words."""
    ignored = set(world.contact.ignored_groups)
    passing = {(pair.first, pair.second) for pair in world.contact.pairs if not pair.collide}
    return {
        frozenset((shape.name, two.name))
        for a, b in itertools.combinations(world.bodies, 2)
        for shape in a.shapes
        for two in b.shapes
        if tuple(sorted((a.collision_group, b.collision_group))) not in ignored
        and tuple(sorted((shape.material, two.material))) not in passing
    }


@given(st.data())
def test_masks_give_exactly_the_law_of_groups_and_materials(data):
    groups, materials = ("g", "h", "i"), ("m", "n", "o")
    every = [tuple(pair) for pair in itertools.combinations_with_replacement(groups, 2)]
    each = [tuple(pair) for pair in itertools.combinations_with_replacement(materials, 2)]
    kinds = data.draw(st.lists(st.tuples(st.sampled_from(groups), st.sampled_from(materials)), min_size=4, max_size=8))
    ignored = data.draw(st.lists(st.sampled_from(every), unique=True).map(sorted))
    passing = data.draw(st.sets(st.sampled_from(each)))
    world = shapes_of(kinds, ignored, passing, per_body=data.draw(st.sampled_from((1, 2))))
    assert touching(world) == wanted(world)


@pytest.mark.parametrize("count", [FILTER_BITS - 1, FILTER_BITS + 3])
def test_more_classes_than_bits_become_excluded_bodies(count):
    kinds = [("g", f"m{index:02}") for index in range(count)]
    passing = {(f"m{index:02}", f"m{index:02}") for index in range(count)} | {("m00", "m01")}
    world = shapes_of([*kinds, *kinds], passing=passing)
    assert touching(world) == wanted(world)


def test_kinds_with_the_same_excluded_kinds_share_a_bit():
    """40 materials that all pass through one: two classes, not 41."""
    kinds = [("g", f"m{index:02}") for index in range(40)] + [("g", "x")]
    world = shapes_of(kinds, passing={(f"m{index:02}", "x") for index in range(40)}, per_body=2)
    assert touching(world) == wanted(world)


def test_bodies_that_touch_in_part_beyond_the_bits_are_refused():
    count = FILTER_BITS + 1
    kinds = [("g", f"m{index:02}") for index in range(count)]
    passing = {(f"m{index:02}", f"m{index:02}") for index in range(count)}
    mixed = [("g", "m00"), ("g", "m01")]
    with pytest.raises(UnsupportedError, match=r"some shapes of 'b.*' and 'b.*' may touch and others not"):
        emit(shapes_of([*kinds, *mixed, *mixed], passing=passing, per_body=2))


def test_excluded_pairs_have_no_explicit_pair():
    world = worlds.table(TABLE)
    pairs = tuple(dataclasses.replace(p, collide=p.first == p.second) for p in world.contact.pairs)
    found = listed(dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs)))
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    assert found
    assert all(len({material[name] for name in pair}) == 1 for pair in found)


# --- what MuJoCo cannot have --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cone", "law", "message"),
    [
        ("pyramid-inscribed", {"torsional_friction": 0.01}, "torsional friction is wrong"),
        ("pyramid-inscribed", {"rolling_friction": 0.01}, "rolling friction is wrong"),
        ("pyramid-inscribed", {"hardness": HARDNESS["stiffness"]}, "does not stick"),
        ("elliptic", {"hardness": HARDNESS["time-constant"], "restitution": 0.5}, "does not support restitution with"),
        ("elliptic", {"hardness": Hardness("time-constant", time_constant=0.0019, damping_ratio=1.0)}, "two timesteps"),
        ("elliptic", {"hardness": Hardness("stiffness", stiffness=3e6, damping=0.0)}, "too hard for the timestep"),
        ("elliptic", {"hardness": Hardness("stiffness", stiffness=1e3, damping=1100.0)}, "too hard for the timestep"),
    ],
)
def test_laws_that_mujoco_lacks_are_refused_at_their_place(cone, law, message):
    world = laws(worlds.table(dict.fromkeys(TABLE, 0.5)), **law)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))
    with pytest.raises(UnsupportedError, match=message) as caught:
        emit(world)
    assert {problem.path.rsplit(".", 1)[0] for problem in caught.value.problems} == {
        "contact.pairs.a.a",
        "contact.pairs.a.b",
        "contact.pairs.b.b",
    }


def test_stiffness_of_mechanisms_is_refused():
    world = worlds.gripper()
    with pytest.raises(UnsupportedError, match="not for mechanisms"):
        emit(laws(world, hardness=HARDNESS["stiffness"]))


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.5, 1.0])
def test_restitution_is_read_back_as_written_at_every_timestep(restitution):
    """At 13 ms and eight others of these (1 + e) / dt dt is not 1 + e."""
    rigid = (0.9999, 0.9999, 0.001, 0.5, 2.0)
    for step in range(1, 60):
        timestep = step / 1000
        solref = reference(0.2, restitution, timestep)
        common = CommonLaw(timestep, 0.2, (rigid,))
        assert surface(1, (0.0, 0.0, 0.0), solref, rigid, common).restitution == restitution
