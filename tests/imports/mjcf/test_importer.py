"""Imported MJCF files: the words of the spec, that it is the same model, and that nothing is lost in silence."""

from __future__ import annotations

import math
from itertools import combinations

import mujoco
import numpy as np
import pytest

from simspec.errors import SpecError
from simspec.imports.mjcf import comparison
from simspec.imports.mjcf.bodies import MjcfBodies
from simspec.imports.mjcf.compiled import FEATURES, compilers
from simspec.imports.mjcf.contact import MjcfSurface, combined
from simspec.imports.mjcf.importer import MjcfImporter
from simspec.language import foreign
from simspec.language.foreign import Fate, ImportOptions, LossSeverity
from simspec.language.load import load
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from tests.imports.mjcf.models import ARM, SCENE, lost, read, written
from tests.meshes.solids import box, stl

pytestmark = pytest.mark.usefixtures("warm_readers")

SAME = 1e-9


@pytest.mark.parametrize("text", [ARM, SCENE], ids=["arm", "scene"])
def test_the_imported_world_is_the_same_model(tmp_path, text):
    deviations, imported = comparison.deviations(written(tmp_path, text), ImportOptions())
    assert deviations.worst < SAME
    assert not lost(imported)


@pytest.mark.parametrize("array", ["body_mass", "jnt_pos", "dof_damping"])
def test_a_wrong_number_is_seen(tmp_path, monkeypatch, array):
    make = MjcfBodies.make

    def wrong(bodies):
        right = bodies.model[array]
        bodies.model._arrays[array] = right + 1e-3
        make(bodies)
        bodies.model._arrays[array] = right

    monkeypatch.setattr(MjcfBodies, "make", wrong)
    deviations, _ = comparison.deviations(written(tmp_path, ARM), ImportOptions())
    assert deviations.worst > 1e-6


def test_a_single_tree_is_a_model_file(tmp_path):
    bodies = read(written(tmp_path, ARM)).data["model"]["bodies"]
    assert list(bodies) == ["base", "upper", "slider", "ball"]
    joint = bodies["upper"]["joint"]
    assert (joint["name"], joint["type"]) == ("swing", "hinge")
    assert joint["limits"]["position"] == pytest.approx([math.radians(-95), math.radians(5)])
    assert joint["spring"] == pytest.approx({"stiffness": 3.0, "rest": math.radians(4)})
    assert (joint["damping"], joint["armature"], joint["dry_friction"]) == (0.1, 0.01, 0.2)
    assert bodies["base"]["fixed"] is True
    assert [shape["collision"] for shape in bodies["upper"]["shapes"][1:]] == [False]


def test_several_trees_and_the_shapes_of_the_world_are_a_scenario(tmp_path):
    path = written(tmp_path, SCENE)
    data = read(path).data
    assert list(data["bodies"]) == ["ground", "box0", "box1", "box2", "stand"]
    assert data["contact"]["friction_cone"] == "elliptic"
    assert data["contact"]["exclude"] == [["box0", "box1"]]
    world = load(path).resolve()
    laws = {(pair.first, pair.second): pair for pair in world.contact.pairs}
    floor, box = world.bodies[0].shapes[0].material, world.bodies[1].shapes[0].material
    pair = laws[min(floor, box), max(floor, box)]
    assert (pair.friction, pair.torsional_friction, pair.rolling_friction) == (1.0, 0.01, 0.0)
    assert laws[box, box].friction == 0.5


def surface(friction, directions=3, priority=0, bits=(1, 1)):
    return MjcfSurface(*bits, directions, priority, friction)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (surface((0.5, 0.1, 0.01)), surface((0.2, 0, 0)), (0.5, 0, 0)),
        (surface((0.5, 0.1, 0.01), 6), surface((0.2, 0, 0)), (0.5, 0.1, 0.01)),
        (surface((0.5, 0.1, 0.01), 4), surface((0.2, 0, 0.3)), (0.5, 0.1, 0)),
        (surface((0.5, 0.1, 0.01), 1), surface((0.2, 0, 0)), (0.5, 0, 0)),
        (surface((0.5, 0.1, 0.01), 1), surface((0.2, 0, 0), 1), (0, 0, 0)),
        (surface((0.5, 0.1, 0.01), 1), surface((0.2, 0, 0), 3, 2), (0.2, 0, 0)),
        (surface((0.1, 0.3, 0), 4, 3), surface((0.2, 0, 0)), (0.1, 0.3, 0)),
    ],
)
def test_the_law_of_two_surfaces(first, second, expected):
    assert combined(first, second) == combined(second, first) == expected


FIXED = """<mujoco><worldbody>{0}<body name="base" pos="1 2 3" euler="10 20 30"><geom size="1"/>
<body name="inner" pos="0 0 1" euler="0 30 0"><geom size="0.1"/><body name="arm" pos="0.1 0.2 0.3" euler="40 0 0">
<joint name="j" pos="0.1 0 0"/><geom size="1"/></body></body></body></worldbody></mujoco>"""


def test_a_body_joined_to_a_fixed_body_may_touch_it(tmp_path):
    for number, more in enumerate(('<geom type="plane" size="1 1 1"/>', "")):
        path = written(tmp_path, FIXED.format(more), f"{number}.xml")
        deviations, imported = comparison.deviations(path, ImportOptions())
        assert deviations.worst < SAME
        assert not lost(imported)
        assert imported.data["contact"]["touch"] == [["inner", "arm"]]
        assert CollisionFilter(load(path).resolve()).may_touch("arm", "inner")


CHAIN = """<mujoco><option><flag filterparent="{}"/></option><worldbody><body name="base"><freejoint/><geom size="1"/>
<body name="arm"><joint name="j"/><geom size="1"/><body name="tip"><geom size=".1"/></body>
</body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("flag", ["enable", "disable"])
def test_joined_bodies_touch_where_parents_are_not_filtered(tmp_path, flag):
    path = written(tmp_path, CHAIN.format(flag))
    assert not lost(read(path))
    allowed = CollisionFilter(load(path).resolve())
    found = {pair: allowed.may_touch(*pair) for pair in combinations(("base", "arm", "tip"), 2)}
    off = flag == "disable"
    assert found == {("base", "arm"): off, ("base", "tip"): off, ("arm", "tip"): False}


def test_bits_are_groups_or_pairs_of_materials(tmp_path):
    bodies = [(2, 1), (1, 4), (2, 4), (7, 7)]
    geoms = [f'<geom size="1" contype="{index}" conaffinity="{two}"/>' for index, two in bodies]
    text = "".join(f'<body pos="{3 * number} 0 0"><freejoint/>{geom}</body>' for number, geom in enumerate(geoms))
    world = load(written(tmp_path, f"<mujoco><worldbody>{text}</worldbody></mujoco>")).resolve()
    allowed = CollisionFilter(world)
    mixed = f"<body><freejoint/>{geoms[0]}{geoms[3]}</body>" + text
    with_materials = load(written(tmp_path, f"<mujoco><worldbody>{mixed}</worldbody></mujoco>")).resolve()
    laws = {(pair.first, pair.second): pair for pair in with_materials.contact.pairs}
    for (number, entry), (other, two) in combinations(enumerate(bodies), 2):
        touch = bool(entry[0] & two[1] or two[0] & entry[1])
        assert allowed.may_touch(world.bodies[number].name, world.bodies[other].name) is touch
        first, second = (with_materials.bodies[index + 1].shapes[0].material for index in (number, other))
        assert laws[min(first, second), max(first, second)].collide is touch


LOSSES = {
    '<body gravcomp="1"><joint actuatorgravcomp="true" actuatorfrcrange="-1 1"/><geom size="1"/></body>': "body.gravcomp",
    '<body><joint type="free" damping="1"/><geom size="1" pos="0 1 0"/></body>': "joint.free_damping",
    '<body><joint type="ball" frictionloss="1"/><geom size="1"/></body>': "joint.dry_friction",
    '<body><joint type="free" armature="1"/><geom size="1" pos="0 1 0"/></body>': "joint.armature",
    '<body><joint type="free" stiffness="1"/><geom size="1"/></body>': "joint.free_spring",
    '<body><joint actuatorfrcrange="-1 2"/><geom size="1"/></body>': "joint.effort_range",
    '<body><joint stiffness="1 2"/><geom size="1"/></body>': "joint.polynomial",
}


def test_losses_are_reported(tmp_path):
    bodies = "\n".join(body.replace("<body", f'<body pos="{number * 9} 0 0"') for number, body in enumerate(LOSSES))
    entries = lost(read(written(tmp_path, f"<mujoco><worldbody>\n{bodies}</worldbody></mujoco>")))
    given = {(entry.location.line, entry.reason) for entry in entries}
    assert given == {(line, FEATURES[feature].reason) for line, feature in enumerate(LOSSES.values(), 2)}


MARGINS = """<mujoco><default><geom margin="0.001"/></default><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body name="a"><freejoint/><geom name="a" size=".1" margin="0.002" gap="0.5"/></body>
<body name="b"><freejoint/><geom name="b" size=".1" pos="1 0 0" margin="0"/></body></worldbody>
<contact><pair geom1="b" geom2="a" margin="0.002"/></contact></mujoco>"""


def test_margins_of_shapes_and_pairs(tmp_path):
    imported = read(written(tmp_path, MARGINS))
    bodies = imported.data["bodies"] if "bodies" in imported.data else imported.data["model"]["bodies"]
    margins = [shape.get("margin", 0.0) for body in bodies.values() for shape in body["shapes"]]
    assert margins == [0.001, 0.002, 0.0]
    assert not lost(imported)
    (gap,) = [entry for entry in imported.accounts if entry.what.endswith("/@gap")]
    assert (gap.fate, gap.severity) == (Fate.LOST, LossSeverity.INFORMATION)
    for margin in (0.004, 0.0):
        path = written(tmp_path, MARGINS.replace('"a" margin="0.002"/>', f'"a" margin="{margin}"/>'))
        assert not lost(read(path))
        world = load(path).resolve()
        _, a, b = (body.shapes[0].material for body in world.bodies)
        stated = {(pair.first, pair.second): pair.margin for pair in world.contact.pairs if pair.margin is not None}
        assert stated == {(min(a, b), max(a, b)): margin}


FILTERED = """<mujoco><worldbody><geom name="g" type="plane" size="1 1 1" contype="0" conaffinity="0"/>
<geom name="h" pos="0 0 -9" size="1"/>
<body name="a" pos="0 0 9"><freejoint/><geom name="a1" size=".1"/><geom name="a2" size=".1" pos="1 0 0"/>
<body name="b"><joint/><geom name="b1" size=".1"/><geom name="b2" size=".1" pos="1 0 0"/></body></body>
<body name="c" pos="5 0 9"><freejoint/><geom name="c1" size=".1"/><geom name="c2" size=".1" pos="1 0 0"/></body>
</worldbody><contact><exclude body1="a" body2="c"/><exclude body1="world" body2="c"/><pair geom1="a1" geom2="b2"/>
<pair geom1="c1" geom2="a2" margin="0.01"/><pair geom1="g" geom2="c2"/></contact></mujoco>"""
TOUCH = {"a1 b2", "a2 c1", "c2 g", "b1 c1", "b1 c2", "b2 c1", "b2 c2", "a1 h", "a2 h", "b1 h", "b2 h"}


def test_pairs_of_geoms_touch_although_their_bodies_are_joined_or_excluded(tmp_path):
    """All others of these bodies do not: as the compiler of the file would let them touch, and no more."""
    path = written(tmp_path, FILTERED)
    assert not lost(read(path))
    world = load(path).resolve()
    allowed = CollisionFilter(world)
    shapes = [(body.name, shape) for body in world.bodies for shape in body.shapes]
    touching = {
        " ".join(sorted((shape.name, other.name)))
        for (body, shape), (second, other) in combinations(shapes, 2)
        if allowed.may_touch(body, second) and allowed.may_materials_touch(shape.material, other.material)
    }
    assert touching == TOUCH
    (margin,) = [pair.margin for pair in world.contact.pairs if pair.margin is not None]
    assert margin == 0.01


LOOP = """<mujoco><option><flag filterparent="FLAG"/></option><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body name="a" pos="0 0 1"><freejoint/><geom size=".1"/><site name="in_a"/>
<body name="b" pos="1 0 0"><joint/><geom size=".1"/><site name="in_b" pos="-1 0 0"/></body></body>
<body name="c" pos="3 0 1"><freejoint/><geom size=".1" contype="0"/><site name="in_c" pos="-3 0 0"/></body>
<site name="in_world" pos="0 0 1"/></worldbody><equality><connect site1="in_world" site2="in_a"/>
<connect site1="in_a" site2="in_b"/><connect site1="in_a" site2="in_c"/></equality></mujoco>"""


@pytest.mark.parametrize("flag", ["enable", "disable"])
def test_bodies_of_a_loop_touch_as_in_the_file(tmp_path, flag):
    path = written(tmp_path, LOOP.replace("FLAG", flag))
    assert not lost(read(path))
    world = load(path).resolve()
    allowed = CollisionFilter(world)
    found = {pair for pair in combinations([body.name for body in world.bodies], 2) if allowed.may_touch(*pair)}
    ground = world.bodies[0].name
    joined = {("a", "b")} if flag == "disable" else set()
    assert found == {(ground, "a"), (ground, "b"), (ground, "c"), ("a", "c"), ("b", "c")} | joined


def test_losses_of_classes_are_reported_too(tmp_path):
    text = """<mujoco><default><default class="soft"><geom adhesion="0.01"/></default></default>
    <worldbody><body><freejoint/><geom class="soft" size="1"/></body></worldbody></mujoco>"""
    assert [entry.what for entry in lost(read(written(tmp_path, text)))] == ["default/default[soft]/geom/@adhesion"]
    unused = text.replace('class="soft" size', "size")
    assert not lost(read(written(tmp_path, unused)))


def test_unknown_elements_are_lost(tmp_path):
    text = ARM.replace('<geom class="visual" size=".01"', '<geom class="visual" size=".01" gap="0.1"')
    text = text.replace("</mujoco>", '<sensor><jointpos joint="swing"/></sensor></mujoco>')
    imported = read(written(tmp_path, text))
    assert "sensor" in {entry.what for entry in lost(imported, LossSeverity.INFORMATION)}
    assert {"geom[visual]/@gap"} <= {entry.what.rpartition("body[upper]/")[2] for entry in imported.accounts}
    every = [entry.what for entry in imported.accounts]
    assert len(every) > 60
    assert {entry.fate for entry in imported.accounts if "joint[swing]" in entry.what} == {Fate.CARRIED}


def test_included_files_are_a_single_model_and_keep_their_places(tmp_path):
    written(tmp_path, '<x><body name="b"><joint/><geom size="1" adhesion="1"/></body></x>', "parts/b.xml")
    text = '<mujoco><worldbody>\n<body name="a"><freejoint/><geom size="1"/><include file="parts/b.xml"/></body>'
    path = written(tmp_path, f"{text}</worldbody></mujoco>")
    imported = read(path)
    assert list(imported.data["model"]["bodies"]) == ["a", "b"]
    (entry,) = lost(imported)
    assert (entry.location.file, entry.location.line) == ("parts/b.xml", 1)
    assert len(imported.read) == 2


def test_attached_models(tmp_path):
    inner = """<mujoco model="hand"><compiler angle="degree"/><default><geom margin="0"/></default><worldbody>
    <body name="palm" euler="90 0 0"><joint name="turn" range="-90 90"/><geom size="1" adhesion="1"/></body>
    </worldbody></mujoco>"""
    written(tmp_path, inner, "hand/hand.xml")
    text = """<mujoco><compiler angle="radian"/><asset><model name="h" file="hand/hand.xml"/></asset><worldbody>
    <body name="arm"><freejoint/><geom size="1"/><attach model="h" body="palm" prefix="l_"/>
    <frame pos="1 0 0"><attach model="h" body="palm" prefix="r/"/></frame></body></worldbody></mujoco>"""
    path = written(tmp_path, text)
    deviations, imported = comparison.deviations(path, ImportOptions())
    assert deviations.worst < SAME
    assert list(imported.data["model"]["bodies"]) == ["arm", "l_palm", "r_palm"]
    assert "named 'r/palm' in the file" in imported.comments.values()
    assert {entry.location.file for entry in lost(imported)} == {str(tmp_path / "hand/hand.xml")}


SEVERAL = """<mujoco><worldbody><body name="cart" pos="0 0 1" euler="10 20 30">
<joint name="x" type="slide" axis="1 0 0" pos="0.1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
<joint axis="0 1 0" pos="0.05 0 .1" damping="0.01" stiffness="1"/><geom type="capsule" fromto="0 0 0 .1 0 .3" size=".02"/>
<body name="wrist" pos="0 0.2 .3"><joint name="a" axis="1 0 0" pos="0 .02 0"/><joint name="b" axis="0 1 0" pos=".03 0 0"/>
<geom type="box" size=".1 .02 .03" pos=".1 0 0"/><body name="tip" pos="0 0 0.1"/></body></body></worldbody></mujoco>"""


def test_several_joints_of_a_body(tmp_path):
    deviations, imported = comparison.deviations(written(tmp_path, SEVERAL), ImportOptions())
    assert deviations.worst < SAME
    assert not lost(imported)
    joints = imported.data["model"]["bodies"]["wrist"]["joints"]
    assert [joint["name"] for joint in joints] == ["a", "b"]
    assert joints[1]["origin"] == {"xyz": pytest.approx([0.03, -0.02, 0])}


LOOPS = """<mujoco><compiler angle="radian"/><worldbody><body name="m" mocap="true" pos="0 0.3 2"/>
<body name="f" pos="0 0.3 2.2" euler=".1 .2 .3"><freejoint/><geom size=".1"/></body>
<body name="a" pos="0 0 1"><joint name="j1" axis="0 1 0" pos="0.1 0 0" ref="0.3"/><geom size="1" contype="0"
conaffinity="0"/></body>
<body name="b" pos="1 0 1"><joint name="j2" axis="0 1 0" pos=".2 0 0"/><geom size="1" contype="0" conaffinity="0"/></body>
</worldbody><equality>
<weld body1="m" body2="f" solref="0.01 1"/>
<joint joint1="j1" joint2="j2" polycoef="0 -2 0 0 0"/>
<connect body1="a" body2="b" anchor="0.5 0.1 0.2"/>
<joint joint1="j2" polycoef="0.1 0 0 0 0"/>
<weld body1="a" body2="f" relpose="1 2 3 1 0 0 0"/>
<connect body1="a" body2="b" anchor="0 0 0" active="false"/>
</equality></mujoco>"""


def test_equalities_are_constraints(tmp_path):
    path = written(tmp_path, LOOPS)
    imported = read(path)
    weld, follow, connect = imported.data["constraints"].values()
    assert weld["weld"]["bodies"] == ["m", "f"]
    assert weld["weld"]["pose"]["xyz"] == pytest.approx([0, 0, 0.2])
    assert follow == {"follow": {"joint": "j1", "leader": "j2", "ratio": -2}}
    assert connect["connect"]["at"] == pytest.approx([0.4, 0.1, 0.2])
    assert connect["connect"]["second_at"] == pytest.approx([-0.7, 0.1, 0.2])
    given = {(entry.location.line, entry.severity, entry.reason) for entry in imported.losses()}
    assert {(line, severity) for line, severity, _ in given} == {
        (1, LossSeverity.INFORMATION),  # the mocap body
        (7, LossSeverity.INFORMATION),
        (10, LossSeverity.PHYSICS),
        (11, LossSeverity.PHYSICS),
        (12, LossSeverity.INFORMATION),
    }
    assert len(load(path).resolve().constraints) == 3


MESH = """<mujoco><asset>
<mesh name="a" file="parts/wedge.obj" scale="1 -2 3" refpos=".1 .2 .3"/>
<mesh name="b" file="parts/wedge.obj" scale=".5 .5 .5" refpos=".1 .2 .3" refquat=".5 .5 .5 .5"/></asset><worldbody>
<body><joint pos="0 0 0.5"/><geom type="mesh" mesh="a" pos=".3 .2 .1" quat="0 0 1 0"/></body>
<body><joint/><geom type="mesh" mesh="b" pos="1 0 0" quat=".5 -.5 .5 .5"/></body></worldbody></mujoco>"""
WEDGE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])


def test_meshes_are_where_the_file_has_them(tmp_path):
    vertices = "".join("v " + " ".join(map(str, vertex)) + "\n" for vertex in WEDGE)
    written(tmp_path, vertices + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", "parts/wedge.obj")
    path = written(tmp_path, MESH)
    deviations, imported = comparison.deviations(path, ImportOptions())
    assert deviations.worst < SAME
    assert not lost(imported)
    turned = (WEDGE - [0.1, 0.2, 0.3]) @ np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    first = (WEDGE - [0.1, 0.2, 0.3]) * [1, -2, 3] * [-1, 1, -1] + [0.3, 0.2, 0.1 - 0.5]
    expected = [first, 0.5 * turned @ np.array(frames.matrix((0.5, -0.5, 0.5, 0.5))).T + [1, 0, 0]]
    for body, vertices in zip(load(path).resolve().bodies, expected, strict=True):
        (shape,) = body.shapes
        found = np.reshape(shape.size, (-1, 3)) @ np.array(frames.matrix(shape.pose.quaternion)).T + shape.pose.position
        assert len(found) == 4
        assert max(np.abs(found - vertex).max(axis=1).min() for vertex in vertices) < 1e-9


def test_the_timestep_is_stable_for_explicit_dampers(tmp_path):
    path = written(tmp_path, ARM.replace('damping="0.1"', 'damping="5000"'))
    imported = read(path)
    assert imported.data["physics"]["timestep"] < 0.001
    assert FEATURES["option.timestep"].reason in {entry.reason for entry in lost(imported, LossSeverity.INFORMATION)}
    assert load(path).resolve().physics.timestep == imported.data["physics"]["timestep"]


PAIRS = """<mujoco><worldbody>
<geom name="floor" type="plane" size="1 1 1" friction="0.9"/>
<body name="a" pos="0 0 3"><freejoint/><geom name="ga" size="1" contype="0" conaffinity="0"/></body>
<body name="b" pos="3 0 3"><freejoint/><geom name="gb" size="1"/></body></worldbody><contact>
<pair geom1="ga" geom2="gb" condim="4" friction="0.3 0.3 0.01 0 0"/><pair geom1="gb" geom2="floor" friction="0.2 0.1"/>
</contact></mujoco>"""


def test_pairs_of_geoms_are_pairs_of_materials(tmp_path):
    path = written(tmp_path, PAIRS)
    assert [entry.reason for entry in lost(read(path))] == [FEATURES["contact.uneven"].reason]
    world = load(path).resolve()
    floor, a, b = (body.shapes[0].material for body in world.bodies)
    laws = {frozenset((pair.first, pair.second)): pair for pair in world.contact.pairs}
    pair = laws[frozenset((a, b))]
    assert (pair.collide, pair.friction, pair.torsional_friction) == (True, 0.3, 0.01)
    assert not laws[frozenset((a, floor))].collide
    assert laws[frozenset((b, floor))].collide


def test_without_its_compiler_the_import_says_what_to_install(tmp_path, monkeypatch):
    (compiler,) = compilers().values()
    monkeypatch.setattr(compiler, "version", classmethod(lambda cls: None))
    with pytest.raises(SpecError) as caught:
        read(written(tmp_path, ARM))
    assert "not installed" in str(caught.value)
    assert "pip install" in str(caught.value)


def test_a_spec_uses_the_file(tmp_path):
    written(tmp_path, ARM, "arm.xml")
    spec = "simspec: 1\nname: two\nmodels:\n  one: {use: arm.xml}\n  two: {use: arm.xml, pose: {xyz: [2, 0, 0]}}\n"
    path = written(tmp_path, spec, "two.yaml")
    world = load(path).resolve()
    assert [body.name for body in world.bodies][:2] == ["one/base", "one/upper"]
    assert foreign.is_foreign("arm.xml")


def test_losses_have_a_place_and_a_reason():
    assert len(MjcfImporter.losses()) > 40
    for words, _, reason, _ in MjcfImporter.losses():
        assert words
        assert reason


BELT = """<mujoco><asset><mesh name="m" file="wedge.obj" scale="1 2 1"/></asset><worldbody>
<geom name="belt" type="box" size="5 5 .1" euler="0 0 30" surfacevel="0.5 0 0 0 0 0.2"/>
<geom name="roller" type="mesh" mesh="m" pos="50 1 2" euler="10 20 30" surfacevel="1 2 3 4 5 6"/>
<body pos="0 0 5"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


def test_surfaces_that_move(tmp_path):
    """Of meshes too, whose frames the compiler, and the language, move to where their hulls have them."""
    written(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n", "wedge.obj")
    path = written(tmp_path, BELT)
    assert not lost(read(path))
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shapes = {shape.name: shape for shape in load(path).resolve().bodies[0].shapes}
    for name, shape in shapes.items():
        linear, angular = np.array(shape.surface_velocity).reshape(2, 3)
        expected = model.geom_surfacevel[model.geom(name).id].reshape(2, 3)
        turn, at = np.array(frames.matrix(shape.pose.quaternion)), np.array(shape.pose.position)
        wanted_turn, wanted_at = data.geom(name).xmat.reshape(3, 3), data.geom(name).xpos
        for point in np.eye(3):
            here = turn @ (linear + np.cross(angular, turn.T @ (point - at)))
            wanted = wanted_turn @ (expected[0] + np.cross(expected[1], wanted_turn.T @ (point - wanted_at)))
            assert here == pytest.approx(wanted, abs=1e-5), name


# --- files that a model is put together of: where they are, as MuJoCo has it ------------------------------------------

BALL = '<mujocoinclude><geom size="0.1"/></mujocoinclude>'
SMALL = '<mujocoinclude><geom size="0.05"/></mujocoinclude>'
INCLUDES_SUB = '<mujoco><worldbody><body name="a"><include file="sub/g.xml"/></body></worldbody></mujoco>'
INNER = '<mujocoinclude><include file="h.xml"/></mujocoinclude>'
PART = '<mujocoinclude><asset><mesh name="m" file="m.stl"/></asset></mujocoinclude>'
WITH_PART = (
    '<mujoco>{}<include file="sub/g.xml"/><worldbody><body><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
)
IN_TWO = '<mujoco><worldbody><body><include file="{}"/></body><body><include file="{}"/></body></worldbody></mujoco>'
LAYOUTS = {
    "an included file's own folder": (INCLUDES_SUB, {"sub/g.xml": INNER, "sub/h.xml": BALL}),
    "the main file's folder first": (INCLUDES_SUB, {"sub/g.xml": INNER, "sub/h.xml": BALL, "h.xml": SMALL}),
    "no folder between the two": (
        INCLUDES_SUB,
        {
            "sub/g.xml": INNER.replace("h.xml", "in/h.xml"),
            "sub/in/h.xml": INNER.replace("h.xml", "k.xml"),
            "sub/k.xml": BALL,
        },
    ),
    "one path twice": (IN_TWO.format("g.xml", "./g.xml"), {"g.xml": BALL}),
    "one name in two folders": (IN_TWO.format("a/g.xml", "b/g.xml"), {"a/g.xml": BALL, "b/g.xml": SMALL}),
    "one file by a link": (IN_TWO.format("g.xml", "link.xml"), {"g.xml": BALL, "link.xml": "-> g.xml"}),
    "a file that includes itself by a link": (INCLUDES_SUB, {"sub/g.xml": INNER, "sub/h.xml": "-> g.xml"}),
    "a mesh next to the included file": (WITH_PART.format(""), {"sub/g.xml": PART, "sub/m.stl": 1}),
    "a mesh next to the main file first": (WITH_PART.format(""), {"sub/g.xml": PART, "sub/m.stl": 1, "m.stl": 2}),
    "a mesh of a folder of meshes first": (
        WITH_PART.format('<compiler meshdir="x"/>'),
        {"sub/g.xml": PART, "sub/m.stl": 1, "x/m.stl": 2},
    ),
    "a mesh next to the included file, not in the folder": (
        WITH_PART.format('<compiler meshdir="x"/>'),
        {"sub/g.xml": PART, "sub/m.stl": 1},
    ),
    "no mesh in a folder of meshes below the included file": (
        WITH_PART.format('<compiler meshdir="x"/>'),
        {"sub/g.xml": PART, "sub/x/m.stl": 1},
    ),
    "the last folder counts": (
        WITH_PART.format('<compiler meshdir="x"/>'),
        {"sub/g.xml": PART.replace("<asset>", '<compiler meshdir="y"/><asset>'), "x/m.stl": 1, "y/m.stl": 2},
    ),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_files_are_where_the_compiler_finds_them(tmp_path, name):
    text, others = LAYOUTS[name]
    path = written(tmp_path, text)
    for file, content in others.items():
        (tmp_path / file).parent.mkdir(exist_ok=True, parents=True)
        if isinstance(content, int):
            (tmp_path / file).write_bytes(stl(*box(0.1 * content, 0.1, 0.1)))
        elif content.startswith("-> "):
            (tmp_path / file).symlink_to(content[3:])
        else:
            (tmp_path / file).write_text(content)
    try:
        theirs = mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        theirs = None
    if theirs is None:
        with pytest.raises(SpecError):
            read(path)
        return
    world = load(path).resolve()
    masses = [body.inertial.mass for body in world.bodies]
    assert masses == pytest.approx(list(theirs.body_mass[1:]))
