"""URDF: the independent reader finds the world again; files are shared, safe, plain; inexpressible features are rejected."""

from __future__ import annotations

import dataclasses
import json
import random
from xml.etree import ElementTree

import pytest

from simspec.contact import contact_plan, pair_needs, surfaces
from simspec.dialects.kit.sidecar import SIDECAR, read_sidecar
from simspec.dialects.pybullet.dialect import PybulletDialect
from simspec.engines.pybullet.engine import PyBullet
from simspec.errors import UnsupportedError
from simspec.support.declarations import combine
from simspec.support.negotiation import negotiate
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import Body, Contact, Hardness, Inertial, Joint, Material, PairContact, Pose, Shape
from tests import worlds
from tests.dialects.pybullet.saying import TEXT, WORLDS, all_limits, assert_same_bodies, emit
from tests.files import write


@pytest.mark.parametrize("name", WORLDS)
def test_the_independent_reader_finds_the_world_again(name, tmp_path):
    world = WORLDS[name]()
    files = emit(world)
    found = PybulletDialect().read(write(files, tmp_path))
    assert_same_bodies(world.bodies, found.bodies, TEXT)
    assert (found.gravity, found.timestep) == (world.physics.gravity, world.physics.timestep)
    assert found.friction_cone == world.contact.friction_cone
    for body, again in zip(world.bodies, found.bodies, strict=True):
        for shape, read in zip(body.shapes, again.shapes, strict=True):
            if shape.collision:
                # the product of two equal numbers is the material's own friction
                friction = next(m.friction for m in world.contact.materials if m.name == shape.material)
                assert read.surfaces[0].friction ** 2 == pytest.approx(friction, abs=TEXT)
            if shape.visual:
                assert read.colour == shape.colour
    assert emit(world) == files, "same input, same bytes"


def test_unlimited_joints_read_as_unlimited(tmp_path):
    found = PybulletDialect().read(write(emit(worlds.world(worlds.tree(["hinge", "slide"], 3))), tmp_path))
    assert [body.joint.position_limits for body in found.bodies] == [None, None]
    assert [body.joint.effort_limit for body in found.bodies] == [None, None]


def test_trees_that_differ_in_name_place_and_speed_share_a_file():
    files = emit(worlds.spheres(30))
    assert sorted(files) == ["ball_0.urdf", "floor.urdf", SIDECAR]
    content = json.loads(files[SIDECAR])
    assert [instance["file"] for instance in content["instances"]] == ["floor.urdf"] + ["ball_0.urdf"] * 30
    assert content["instances"][3]["bodies"] == ["ball_2"]
    assert content["instances"][3]["position"] != content["instances"][2]["position"]


@pytest.mark.parametrize(
    "change",
    [
        {"inertial": Inertial(10.000000000000002, inertia=(0.04, 0.04, 0.04, 0.0, 0.0, 0.0))},
        {"shapes": (Shape("s", "sphere", (0.1000001,), Pose(), "slick"),)},
        {"shapes": (Shape("s", "sphere", (0.1,), Pose((0.0, 0.0, 1e-15)), "slick"),)},
        {"shapes": (Shape("s", "sphere", (0.1,), Pose(), "slick", visual=False),)},
        {"shapes": (Shape("s", "sphere", (0.1,), Pose(), "rough"),)},
    ],
)
def test_unequal_trees_do_not_share_a_file(change):
    world = worlds.spheres(3)
    contact = Contact(
        materials=(Material("rough", 0.5), Material("slick", 0.0)),
        pairs=tuple(
            PairContact(a, b, friction, 0.0)
            for a, b, friction in (("rough", "rough", 0.5), ("rough", "slick", 0.3), ("slick", "slick", 0.2))
        ),
    )
    bodies = (*world.bodies[:3], dataclasses.replace(world.bodies[3], **change))
    files = emit(dataclasses.replace(world, bodies=bodies, contact=contact))
    assert len(files) == 4
    assert json.loads(files[SIDECAR])["instances"][3]["file"] == "ball_2.urdf"


def test_file_names_are_safe_and_distinct():
    names = ["arm/left", "arm.left", "ARM.left", "../up", "con fig"]
    bodies = tuple(
        dataclasses.replace(worlds.tree(["free"], index, prefix=f"{index}")[0], model=name)
        for index, name in enumerate(names)
    )
    files = [name for name in emit(worlds.world(bodies)) if name != SIDECAR]
    assert len({name.lower() for name in files}) == len(names)
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-") for name in files)
    assert not any(name.startswith(".") for name in files)


def test_names_never_break_the_xml():
    body = worlds.tree(["free"], 1)[0]
    unexpected = dataclasses.replace(body, name='a<b>&"é', model="m")
    text = emit(worlds.world((unexpected,)))["m.urdf"]
    assert ElementTree.fromstring(text.encode()).find("link").attrib["name"] == 'a<b>&"é'


def test_nothing_is_left_to_a_default():
    for text in (text for name, text in emit(worlds.shapes_world()).items() if name.endswith(".urdf")):
        for link in ElementTree.fromstring(text.encode()).iter("link"):
            assert link.find("inertial/mass") is not None
            assert link.find("inertial/origin") is not None
            assert link.find("contact/lateral_friction") is not None
            assert link.find("contact/restitution") is not None
    text = emit(worlds.every_joint())["link0.urdf"]
    inertias = [element.attrib for element in ElementTree.fromstring(text.encode()).iter("inertia")]
    assert all(float(inertia[key]) == 0.0 for inertia in inertias for key in ("ixy", "ixz", "iyz"))
    moments = [sorted(float(inertia[key]) for key in ("ixx", "iyy", "izz")) for inertia in inertias]
    assert all(largest <= small + middle for small, middle, largest in moments), "PyBullet zeroes others"


def test_a_root_with_a_joint_is_attached_to_a_massless_link_with_a_unique_name(tmp_path):
    bodies = worlds.tree(["hinge", "fixed"], 2)
    clash = dataclasses.replace(bodies[1], name="link0__world")
    world = worlds.world((bodies[0], clash))
    files = emit(world)
    links = [link.attrib["name"] for link in ElementTree.fromstring(files["link0.urdf"].encode()).iter("link")]
    assert links == ["link0__world_", "link0", "link0__world"]
    assert_same_bodies(world.bodies, PybulletDialect().read(write(files, tmp_path)).bodies, TEXT)


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('<mass value="', '<mass value="1', "inertial"),
        ('friction="0.3"', 'friction="0.4"', "joint"),
        ('<dynamics damping="0"', '<dynamics damping="0.1"', "joint"),
        ('effort="50"', 'effort="51"', "joint"),
        ('velocity="3"', 'velocity="4"', "joint"),
        ('upper="2"', 'upper="2.1"', "joint"),
        ("revolute", "prismatic", "joint"),
    ],
)
def test_the_reader_sees_a_changed_file(old, new, field, tmp_path):
    world = all_limits()
    files = emit(world)
    assert old in files["link0.urdf"]
    plain = PybulletDialect().read(write(files, tmp_path)).bodies
    head, _, tail = files["link0.urdf"].rpartition(old)
    changed = PybulletDialect().read(write({**files, "link0.urdf": head + new + tail}, tmp_path)).bodies
    assert [getattr(body, field) for body in changed] != [getattr(body, field) for body in plain]


def test_the_reader_refuses_files_that_do_not_fit_the_sidecar(tmp_path):
    files = emit(worlds.gripper())
    swapped = files["palm.urdf"].replace('"left"', '"x"').replace('"right"', '"left"').replace('"x"', '"right"')
    write({**files, "palm.urdf": swapped}, tmp_path)
    with pytest.raises(ValueError, match=r"palm\.urdf: the links are not those of the sidecar"):
        PybulletDialect().read(tmp_path)
    write({**files, "palm.urdf": files["palm.urdf"].replace('name="left_0"', 'name="other"')}, tmp_path)
    with pytest.raises(ValueError, match="left"):
        PybulletDialect().read(tmp_path)


def many_groups(groups):
    shape = Shape("s", "sphere", (0.1,), Pose(), "default")
    bodies = tuple(
        Body(
            f"b{i}",
            f"b{i}",
            Inertial(1.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0)),
            Joint(f"j{i}", "free", position=(float(i), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
            (dataclasses.replace(shape, name=f"s{i}"),),
            f"g{i % groups:02d}",
        )
        for i in range(2 * groups)
    )
    generator = random.Random(groups)
    pairs = {tuple(sorted((f"g{generator.randrange(groups):02d}", f"g{i:02d}"))) for i in range(groups)}
    contact = Contact(
        materials=(worlds.MATERIAL,),
        pairs=(PairContact("default", "default", 0.4, 0.0),),
        ignored_groups=tuple(sorted(pairs)),
    )
    return worlds.world(bodies, contact=contact)


@pytest.mark.parametrize("groups", [3, 40])
def test_the_sidecars_filter_is_the_worlds(groups, tmp_path):
    """With 40 groups there are more classes than bits, and pairs take their place."""
    world = many_groups(groups)
    content = read_sidecar(write(emit(world), tmp_path))["collision_filter"]
    bits = {name: (class_["group"], class_["mask"]) for class_ in content["classes"] for name in class_["links"]}
    assert max(group for group, _ in bits.values()) < 2**31
    excluded = {tuple(pair) for pair in content["excluded"]}
    allowed = CollisionFilter(world)
    names = [body.name for body in world.bodies]
    for entry in names:
        for other in names:
            if entry != other:
                touch = bool(bits[entry][0] & bits[other][1] and bits[other][0] & bits[entry][1])
                touch = touch and (min(entry, other), max(entry, other)) not in excluded
                assert touch == allowed.may_touch(entry, other), (entry, other)


def refusals(world):
    extra = pair_needs(world, PyBullet.RULES)
    with pytest.raises(UnsupportedError) as caught:
        negotiate(world, "pybullet", combine(PybulletDialect.SUPPORT, PyBullet.SUPPORT), extra_needs=extra)
    return str(caught.value)


def test_inexpressible_features_are_rejected_by_name():
    assert "shape.ellipsoid" in refusals(worlds.shapes_world(("ellipsoid",)))
    assert "tree.size" in refusals(worlds.world(worlds.tree(["free"] + ["fixed"] * 128, 1)))
    inscribed = worlds.shapes_world()
    inscribed = dataclasses.replace(
        inscribed, contact=dataclasses.replace(inscribed.contact, friction_cone="pyramid-inscribed")
    )
    assert "contact.cone.pyramid-inscribed" in refusals(inscribed)


def three_materials(**law):
    """A floor and two spheres of materials that no product gives, and a third sphere of the first's."""
    world = worlds.spheres(3)
    names = ("a", "b", "c")
    pairs = tuple(PairContact(x, y, 0.5 if x == y else 0.1, 0.0, **law) for x in names for y in names if x <= y)
    contact = Contact(materials=tuple(Material(name, 0.5) for name in names), pairs=pairs)

    def of(body, material):
        return dataclasses.replace(body, shapes=(dataclasses.replace(body.shapes[0], material=material),))

    bodies = (of(world.bodies[0], "a"), *(of(body, name) for body, name in zip(world.bodies[1:], names, strict=True)))
    return dataclasses.replace(world, bodies=bodies, contact=contact)


def test_three_materials_that_no_product_gives_get_copies(tmp_path):
    world = three_materials()
    plan = contact_plan(world, PyBullet.RULES, True)
    assert plan.layered
    files = emit(world)
    content = json.loads(files[SIDECAR])
    copies = {copy["link"]: copy for instance in content["instances"] for copy in instance["copies"]}
    assert len(copies) == sum(len(plan.layers(shape.material)) - 1 for body in world.bodies for shape in body.shapes)
    found = PybulletDialect().read(write(files, tmp_path))
    for body, again in zip(world.bodies, found.bodies, strict=True):
        assert again.shapes[0].surfaces == surfaces(body.shapes[0], plan)
    # a copy that is unlike its shape, off its place, or has a mass, is noticed
    name = next(instance["file"] for instance in content["instances"] if instance["copies"])
    for old, new, message in (
        ('radius="0.1"', 'radius="0.2"', "unlike the shape"),
        ('<mass value="0"/>', '<mass value="1"/>', "has a mass"),
        ('type="fixed"', 'type="continuous"', "not welded"),
    ):
        head, _, tail = files[name].rpartition(old)
        assert head or new == 'radius="0.2"', (old, name)
        if head:
            with pytest.raises(ValueError, match=message):
                PybulletDialect().read(write({**files, name: head + new + tail}, tmp_path))


def test_pairs_that_differ_in_a_global_parameter_are_rejected():
    world = three_materials()
    contact = world.contact

    def with_pairs(change):
        pairs = tuple(change(index, pair) for index, pair in enumerate(contact.pairs))
        return dataclasses.replace(world, contact=dataclasses.replace(contact, pairs=pairs))

    bouncing = with_pairs(
        lambda i, pair: dataclasses.replace(pair, restitution=0.5, restitution_threshold=0.1 * (i % 2))
    )
    with pytest.raises(UnsupportedError, match="one restitution_threshold"):
        emit(bouncing)
    native = with_pairs(lambda i, pair: dataclasses.replace(pair, hardness=Hardness("native" if i % 2 else "common")))
    with pytest.raises(UnsupportedError, match="native hardness for all pairs or none"):
        emit(native)
    with pytest.raises(UnsupportedError, match="does not support friction above 10"):
        emit(with_pairs(lambda i, pair: dataclasses.replace(pair, friction=11.0)))


def test_a_tree_with_too_many_coordinates_is_refused():
    emit(worlds.world(worlds.tree(["free"] + ["hinge"] * 121, 1)))
    with pytest.raises(UnsupportedError, match=r"bodies\.link0.*tree\.size.*128 position numbers"):
        emit(worlds.world(worlds.tree(["free"] + ["hinge"] * 122, 1)))
