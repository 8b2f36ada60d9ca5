"""Loading: files that use files, overrides, specs from Python, and the way back from a world to its spec."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from simspec.errors import SpecError
from simspec.language import Array, Body, Contact, File, Joint, Material, Pose, Shape, Sphere, Use
from simspec.language.load import Spec, load

DATA = Path(__file__).parent / "data"
TABLE = DATA / "table.yaml"
SOLID = "mass: 1, inertia: {principal: [1, 1, 1]}"
MODEL = f"simspec: 1\nname: m\nmodel: {{bodies: {{a: {{{SOLID}}}}}}}\n"


def spec(folder, name, text):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def using(name):
    return f"simspec: 1\nname: x\nmodels: {{m: {{use: {name}}}}}\n"


def refused(path, **more):
    with pytest.raises(SpecError) as error:
        load(path, **more).resolve()
    return error.value.problems


# --- use ---


def test_use_is_relative_to_the_file_that_says_it(tmp_path, monkeypatch):
    spec(tmp_path, "a/models/m.yaml", MODEL)
    spec(tmp_path, "a/models/again.yaml", "simspec: 1\nname: again\nmodel: {use: m.yaml}\n")
    path = spec(tmp_path, "a/top.yaml", using("models/again.yaml"))
    monkeypatch.chdir(tmp_path)
    assert [body.name for body in load("a/top.yaml").resolve().bodies] == ["m/a"]
    assert [body.name for body in load(path).resolve().bodies] == ["m/a"]
    assert [body.name for body in load("a/models/again.yaml").resolve().bodies] == ["a"]


def test_a_file_that_is_used_twice_is_read_once(tmp_path):
    spec(tmp_path, "m.yaml", MODEL)
    text = "simspec: 1\nname: x\nmodels: {one: {use: m.yaml}, two: {use: ./m.yaml}, three: {use: m.yaml}}\n"
    found = load(spec(tmp_path, "top.yaml", text))
    assert found.source.uses["m.yaml"] is found.source.uses["./m.yaml"]
    assert [body.name for body in found.resolve().bodies] == ["one/a", "two/a", "three/a"]


def test_use_may_not_leave_the_files_folder(tmp_path):
    spec(tmp_path, "outside.yaml", MODEL)
    path = spec(tmp_path, "in/top.yaml", using("../outside.yaml"))
    (problem,) = refused(path)
    assert "leaves the project folder" in problem.message
    assert problem.hint == "--allow-outside allows it"
    assert str(problem.location) == f"{path}:3:19"
    assert load(path, allow_outside=True).resolve().bodies


def test_a_path_into_an_installed_package_is_answered_with_its_name(tmp_path):
    spec(tmp_path, "venv/site-packages/cranes/arm.yaml", MODEL)
    (problem,) = refused(spec(tmp_path, "in/top.yaml", using("../venv/site-packages/cranes/arm.yaml")))
    assert problem.hint == "package://cranes/arm.yaml names this file of an installed package"


@pytest.mark.parametrize("mark", [".git", "pyproject.toml"])
def test_the_project_is_the_nearest_folder_with_its_mark(tmp_path, mark):
    spec(tmp_path, "project/models/m.yaml", MODEL)
    spec(tmp_path, "outside.yaml", MODEL)
    (tmp_path / "project" / mark).mkdir()
    assert load(spec(tmp_path, "project/specs/a.yaml", using("../models/m.yaml"))).resolve().bodies
    assert refused(spec(tmp_path, "project/specs/b.yaml", using("../../outside.yaml")))


def test_a_link_that_leaves_the_project_is_followed_before_it_is_judged(tmp_path):
    outside = spec(tmp_path, "outside.yaml", MODEL)
    path = spec(tmp_path, "in/top.yaml", using("link.yaml"))
    os.symlink(outside, tmp_path / "in" / "link.yaml")
    assert "leaves the project folder" in refused(path)[0].message
    os.symlink(tmp_path / "in" / "round.yaml", tmp_path / "in" / "round.yaml")
    assert refused(spec(tmp_path, "in/round-user.yaml", using("round.yaml")))


def test_loops_are_shown(tmp_path):
    for name, other in ("ab", "bc", "ca"):
        spec(tmp_path, f"{name}.yaml", f"simspec: 1\nname: {name}\nmodel: {{use: {other}.yaml}}\n")
    messages = [problem.message for problem in refused(tmp_path / "a.yaml")]
    assert messages == ["circular use of files: a.yaml -> b.yaml -> c.yaml -> a.yaml"]
    path = spec(tmp_path, "self.yaml", using("self.yaml"))
    assert "self.yaml -> self.yaml" in refused(path)[0].message


def test_a_chain_without_end_is_refused(tmp_path):
    for index in range(40):
        spec(tmp_path, f"m{index}.yaml", f"simspec: 1\nname: m\nmodel: {{use: m{index + 1}.yaml}}\n")
    assert "in a chain" in refused(tmp_path / "m0.yaml")[0].message


def test_a_used_file_must_be_a_model(tmp_path):
    path = spec(tmp_path, "top.yaml", using("scene.yaml"))
    assert "no such file" in refused(path)[0].message
    spec(tmp_path, "scene.yaml", f"simspec: 1\nname: s\nbodies: {{a: {{{SOLID}}}}}\n")
    assert "contains no model" in refused(path)[0].message
    spec(tmp_path, "scene.yaml", "simspec: 1\nname: [")
    assert "not YAML" in refused(path)[0].message
    assert "paths cannot contain" in refused(spec(tmp_path, "nul.yaml", using('"a\\0b"')))[0].message


def test_problems_of_a_used_file_are_placed_in_it_and_come_with_the_others(tmp_path):
    model = spec(tmp_path, "m.yaml", "simspec: 1\nname: m\nmodel: {bodies: {a: {mas: 1}}}\n")
    path = spec(tmp_path, "top.yaml", using("m.yaml") + "physics: {gravty: 1}\n")
    places = [str(problem.location) for problem in refused(path)]
    assert places == [f"{model}:3:22", f"{path}:4:11"]


def test_the_same_name_with_another_meaning(tmp_path):
    spec(tmp_path, "m.yaml", MODEL + "contact: {materials: {steel: {friction: 0.2}}, groups: {g: {ignores: []}}}\n")
    same = "contact: {materials: {steel: {friction: 0.2}}, groups: {g: {ignores: []}}}\n"
    assert load(spec(tmp_path, "same.yaml", using("m.yaml") + same)).resolve().contact.materials[0].friction == 0.2
    other = "contact: {materials: {steel: {friction: 0.3}}, groups: {g: {ignores: [g]}}}\n"
    path = spec(tmp_path, "other.yaml", using("m.yaml") + other)
    found = refused(path)
    assert [problem.path for problem in found] == ["contact.materials.steel", "contact.groups.g"]
    assert all(f"{path}:4:" in problem.found for problem in found)
    assert all(problem.location.file.endswith("m.yaml") for problem in found)


def test_excluded_pairs_of_every_file_on_the_way_are_kept(tmp_path):
    two = "a: {mass: 1, inertia: {principal: [1, 1, 1]}}"
    parts = [f"{name}: {{parent: a, joint: {{type: ball}}, {SOLID}}}" for name in "bcd"]
    bodies = ", ".join([two, *parts])
    spec(tmp_path, "m.yaml", f"simspec: 1\nname: m\nmodel: {{bodies: {{{bodies}}}}}\ncontact: {{exclude: [[b, c]]}}\n")
    again = spec(tmp_path, "again.yaml", "simspec: 1\nname: n\nmodel: {use: m.yaml}\ncontact: {exclude: [[d, c]]}\n")
    joined = {("a", "b"), ("a", "c"), ("a", "d")}
    assert set(load(again).resolve().contact.excluded_bodies) == joined | {("b", "c"), ("c", "d")}
    top = load(spec(tmp_path, "top.yaml", using("again.yaml")))
    expected = {(f"m/{a}", f"m/{b}") for a, b in joined | {("b", "c"), ("c", "d")}}
    assert set(top.resolve().contact.excluded_bodies) == expected
    wrong = spec(tmp_path, "wrong.yaml", "simspec: 1\nname: n\nmodel: {use: m.yaml}\ncontact: {exclude: [[d, e]]}\n")
    (problem,) = refused(wrong)
    assert (problem.path, problem.message) == ("contact.exclude.0.1", "the model has no body 'e'")


@pytest.mark.parametrize(
    ("root", "placement", "path", "message"),
    [
        ("joint: {type: ball}", "fixed: true", "models.m.fixed", "cannot be fixed as well"),
        ("velocity: {linear: [0, 0, 1]}", "fixed: true", "models.m.fixed", "has a velocity"),
        ("fixed: true", "velocity: {linear: [0, 0, 1]}", "models.m.velocity", "is not free"),
        ("fixed: false", "fixed: true, velocity: {linear: [0, 0, 1]}", "models.m.velocity", "is not free"),
        ("array: {line: 2, step: [1, 0, 0]}", "pose: {}", "models.m.bodies.a.array", "where it is used"),
        (
            "fixed: true",
            "positions: {a_joint: 1}",
            "models.m.positions.a_joint",
            "a fixed joint, which has no position",
        ),
        (
            "fixed: false",
            "velocities: {a_joint: 1}",
            "models.m.velocities.a_joint",
            "a free joint, which has no velocity",
        ),
        ("joint: {type: ball}", "positions: {a_joint: 1}", "models.m.positions.a_joint", "is an orientation"),
        ("joint: {type: ball, name: j}", "positions: {k: 1}", "models.m.positions.k", "the model has no joint 'k'"),
        (
            "joint: {type: hinge, axis: [0, 0, 1], limits: {position: [0, 1]}}",
            "positions: {a_joint: 90 deg}",
            "models.m.positions.a_joint",
            "beyond the joint's limits",
        ),
    ],
)
def test_a_placement_that_contradicts_its_model(tmp_path, root, placement, path, message):
    text = f"simspec: 1\nname: x\nmodels: {{m: {{bodies: {{a: {{{SOLID}, {root}}}}}, {placement}}}}}\n"
    (problem,) = refused(spec(tmp_path, "top.yaml", text))
    assert problem.path == path
    assert message in problem.message


def test_a_placement_may_fix_a_root_that_says_it_is_free(tmp_path):
    text = f"simspec: 1\nname: x\nmodels: {{m: {{bodies: {{a: {{{SOLID}, joint: {{type: free}}}}}}, fixed: true}}}}\n"
    assert load(spec(tmp_path, "top.yaml", text)).resolve().bodies[0].joint.kind == "fixed"


# --- overrides ---


def test_overrides():
    sets = [
        "physics.timestep=5ms",
        "bodies.box.pose.xyz=[0, 0, 1 cm]",
        "bodies.floor.shapes.0.material=rubber",
        "contact.materials.wood.friction=0.25",
        "engines.mujoco.settings.tolerance=1e-9",
        "engines.elsewhere.accept=[joint.armature]",
        "record.channels.0=energy",
        "models.left.positions.shoulder=-10 deg",
        "models.crowd.array.ring=2",
    ]
    before, after = load(TABLE), load(TABLE, sets=sets)
    world = after.resolve()
    assert world.physics.timestep == 0.005
    assert next(body for body in world.bodies if body.name == "box_00").joint.position[:3] == (0.0, 0.0, 0.01)
    assert world.bodies[0].shapes[0].material == "rubber"
    assert dict(world.options("mujoco").settings) == {"iterations": 50, "tolerance": 1e-9}
    assert world.options("elsewhere").accept == ("joint.armature",)
    assert world.record.channels == ("energy",)
    assert sum(body.name.startswith("crowd_") for body in world.bodies) == 6
    assert before.resolve() != world
    assert after.data.physics.timestep == 0.005


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("bodies.bax.mass=1", "the spec has no 'bodies.bax'", "'box'"),
        ("bodies.box.mas=1", "the spec has no 'bodies.box.mas'", "'mass'"),
        ("phisics.timestep=1", "the spec has no 'phisics'", "'physics'"),
        ("models.lft.pose.xyz=[0, 0, 0]", "the spec has no", "'left'"),
        ("bodies.floor.shapes.1.material=wood", "no such element", None),
        ("bodies.floor.shapes.first=1", "no such element", None),
        ("physics.timestep.unit=1", "this value has no elements", None),
        ("physics.timestep", "expected path=value", "physics.timestep=2ms"),
        ("=3", "expected path=value", None),
        ("physics.timestep=2 deg", "wrong unit", None),
        ("physics.timestep=", "expected a time", None),
        ("physics.timestep=[", "not YAML", None),
        ("physics.timestep=.nan", "finite", None),
        ("physics.timestep=!!int 3", "tags are not allowed", None),
        ("models.left.positions.elbow=1", "the model has no joint 'elbow'", None),
    ],
)
def test_wrong_overrides_are_placed_at_the_override(text, message, hint):
    with pytest.raises(SpecError) as error:
        load(TABLE, sets=["physics.duration=2 s", text])
    found = [problem for problem in error.value.problems if message in problem.message]
    assert len(found) == 1, error.value
    assert found[0].location.file == "--set"
    assert found[0].location.line == 2
    assert hint is None or hint in found[0].hint


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("physics.gravity.2=-5", "physics.gravity=[…, …, …]"),
        ("physics.gravity.z=-5", "physics.gravity=[…, …, …]"),
        ("bodies.a.pose.xyz.1=3", "bodies.a.pose.xyz=[…, …, …]"),
        ("contact.hardness.stiffness=100", "contact.hardness=…"),
        ("expect.0.position.body=a", "expect=…"),
        ("engines.mujoco.pairs.0.settings.x=1", "engines.mujoco.pairs=…"),
    ],
)
def test_an_override_of_a_part_of_a_missing_value_is_a_single_error(text, hint, tmp_path):
    """Nothing says what the other parts would be; and what could not be put in leaves nothing behind, to be found wrong."""
    path = tmp_path / "m.yaml"
    path.write_text("simspec: 1\nname: m\nbodies: {a: {fixed: true}}\n", encoding="utf-8")
    with pytest.raises(SpecError) as error:
        load(path, sets=[text])
    (problem,) = error.value.problems
    assert (problem.path, str(problem.location)) == (text.partition("=")[0], "--set:1:1")
    assert "so that no part of it can be changed" in problem.message
    assert problem.hint == hint


@pytest.mark.parametrize("text", ["bodies.a.joint.typ=hinge", "bodies.a.inertia.prncipal=[1, 1, 1]"])
def test_a_path_that_ends_nowhere_leaves_nothing_behind(text, tmp_path):
    """An empty joint, say, whose type would be missing."""
    path = tmp_path / "m.yaml"
    path.write_text("simspec: 1\nname: m\nbodies: {a: {fixed: true}}\n", encoding="utf-8")
    with pytest.raises(SpecError) as error:
        load(path, sets=[text])
    assert [problem.path for problem in error.value.problems] == [text.partition("=")[0]]


def test_the_column_is_that_of_the_value():
    with pytest.raises(SpecError) as error:
        load(TABLE, sets=["physics.gravity=[0, 0, 1 s]"])
    assert str(error.value.problems[0].location) == "--set:1:17"


# --- from Python ---


def test_a_spec_of_python_objects_is_the_spec_of_its_yaml(tmp_path):
    ball = Body(
        array=Array(line=3, step=(0.5, 0, 0)),
        pose=Pose(xyz=["10 cm", 0, 1]),
        shapes=[Shape(sphere=Sphere(radius="5 cm"), density="1 g/cm^3")],
    )
    arm = Body(
        mass=1,
        inertia={"principal": [0.1, 0.1, 0.01]},
        joint=Joint(type="ball", position={"rpy": [0, 0, "90 deg"]}, velocity=[0, 0, 1], spring={"stiffness": 2}),
    )
    file = File(
        simspec=1,
        name="made",
        contact=Contact(materials={"m": Material(friction=0.5)}, combine="mean"),
        bodies={"ball": ball},
        models={"arm": Use(bodies={"arm": arm}, positions={"arm_joint": {"quat": [1, 0, 0, 0]}})},
        expect=[{"position": {"body": "ball_0", "xyz": [0, 0, 0], "tolerance": "1 mm"}}],
    )
    made = Spec.from_data(file)
    path = spec(tmp_path, "made.yaml", made.to_yaml())
    assert load(path).resolve() == made.resolve()
    assert load(path).data == made.data
    assert made.path is None
    assert made.locate("bodies.ball_1.mass") is None


def test_plain_data_may_leave_out_the_version_and_hold_arrays_of_numpy():
    numpy = pytest.importorskip("numpy")
    data = {"name": "x", "bodies": {"a": {"mass": numpy.float32(2), "inertia": {"principal": numpy.full(3, 1.0)}}}}
    assert Spec.from_data(data).resolve().bodies[0].inertial.mass == 2.0


def test_use_in_python_is_relative_to_the_folder_given(tmp_path):
    spec(tmp_path, "m.yaml", MODEL)
    data = {"name": "x", "models": {"one": {"use": "m.yaml"}}}
    assert Spec.from_data(data, folder=tmp_path).resolve().bodies[0].name == "one/a"
    with pytest.raises(SpecError, match="no such file"):
        Spec.from_data(data, folder=tmp_path / "elsewhere")


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"name": "x"},
        {"name": "x", "bodies": {1: {}}},
        {"name": "x", "bodies": {"a": {"mass": float("nan")}}},
        3,
        None,
    ],
)
def test_wrong_data_is_a_spec_error(data):
    with pytest.raises(SpecError):
        Spec.from_data(data)


def test_overrides_are_in_the_yaml():
    text = load(TABLE, sets=["physics.timestep=5 ms"]).to_yaml()
    assert "timestep: 5 ms" in text


# --- from the world back to the spec ---


@pytest.mark.parametrize(
    ("path", "file", "text"),
    [
        ("name", "table", "table"),
        ("physics.timestep", "table", "2 ms"),
        ("physics.gravity", "table", "physics"),
        ("bodies.floor.shapes.0", "table", "{plane"),
        ("bodies.box_03.mass", "table", "1"),
        ("bodies.box_03.inertia", "table", "1"),
        ("bodies.box_03.shapes.0.box.size", "table", "size: [0.2"),
        ("bodies.box_03.velocity", "table", "box"),
        ("bodies.left/base.mass", "arm", "4 kg"),
        ("bodies.left/upper.joint.damping", "arm", "0.5"),
        ("bodies.left/upper.joint.limits.effort", "arm", "50"),
        ("bodies.left/upper.joint.position", "table", "30 deg"),
        ("bodies.left/upper.joint.velocity", "table", "1"),
        ("bodies.left/hand.mass", "arm", "shapes"),
        ("bodies.crowd_2/upper.joint.damping", "arm", "0.5"),
        ("bodies.crowd_2/upper.joint.position", "arm", "joint"),
        ("bodies.crowd_2/base.velocity", "table", "velocity"),
        ("contact.materials.wood.friction", "table", "0.4"),
        ("contact.materials.rubber.friction", "arm", "0.9"),
        ("contact.groups", "arm", "groups"),
        ("contact.friction_cone", "table", "contact"),
        ("engines.mujoco.settings.iterations", "table", "50"),
        ("engines.mujoco.settings.other", "table", "settings|{"),
        ("engines.none.settings", "table", "engines"),
        ("bodies.nobody.mass", "table", "bodies"),
    ],
)
def test_every_path_of_the_world_has_its_place(path, file, text):
    place = load(TABLE).locate(path)
    assert Path(place.file).stem == file
    shown = Path(place.file).read_text().splitlines()[place.line - 1][place.column - 1 :]
    assert shown.startswith(tuple(text.split("|"))), (place, shown)


def test_every_body_of_a_world_is_found():
    found = load(TABLE)
    for body in found.resolve().bodies:
        assert found.locate(f"bodies.{body.name}.joint.damping").line > 12


def calls(work):
    """How many Python functions a piece of work calls: the same number on every machine, however busy."""
    count = 0

    def counted(frame, event, argument):
        nonlocal count
        count += event == "call"

    sys.setprofile(counted)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


def chain(count):
    bodies = {
        f"b{n}": {"mass": 1, "inertia": {"principal": [1, 1, 1]}, "joint": {"type": "ball"}} for n in range(count)
    }
    for n in range(1, count):
        bodies[f"b{n}"]["parent"] = f"b{n - 1}"
    return {"name": "x", "bodies": bodies}


def pile(count):
    ball = {"mass": 1, "shapes": [{"sphere": {"radius": 1}}], "array": {"line": count, "step": [1, 0, 0]}}
    return {"name": "x", "contact": {"materials": {"m": {}}}, "bodies": {"ball": ball}}


@pytest.mark.parametrize("make", [chain, pile])
def test_the_work_grows_with_the_number_of_bodies_and_no_faster(make):
    Spec.from_data(make(10)).resolve()
    few, many = (calls(lambda count=count: Spec.from_data(make(count)).resolve()) for count in (100, 800))
    assert many < 8.2 * few  # 8 times the bodies; the rest is what sorting and hashing cost
