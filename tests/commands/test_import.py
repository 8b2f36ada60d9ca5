"""``simspec import`` and the other commands on a robot file: written files, messages, refusals."""

import json

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.commands.loading import source_of
from simspec.commands.options import RobotFileOptions
from simspec.imports import writing
from simspec.imports.writing import is_unchanged
from simspec.language.document import event_count, events
from simspec.language.foreign import ImportOptions
from simspec.language.formatting import node_of
from simspec.language.load import Spec, load
from simspec.world.canonical import sha256

INERTIAL = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="{0}" ixy="0" ixz="0" iyz="0"/></inertial>'
ROBOT = """\
<robot name="two">
  <link name="base"/>
  <link name="arm">{inertial}</link>
  <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0.1 0.3 1e-5"/>
    <unheard/></joint>
  <transmission name="t"/>
</robot>
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "good.urdf").write_text(ROBOT.format(inertial=INERTIAL.format(0.15)))
    (tmp_path / "bad.urdf").write_text(ROBOT.format(inertial=INERTIAL.format(1)))
    return tmp_path


def simspec(*words: str, code: int = 0):
    done = CliRunner().invoke(cli.app, list(words))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == code, done.output
    return done


def test_the_written_spec_is_the_same_world(folder):
    simspec("import", "good.urdf", "-o", "good.yaml")
    assert sha256(load(folder / "good.yaml").resolve()) == sha256(load(folder / "good.urdf").resolve())
    assert simspec("import", "good.urdf").stdout == (folder / "good.yaml").read_text()
    simspec("fmt", "--check", "good.yaml")


def test_an_edited_spec_is_not_overwritten(folder):
    simspec("import", "bad.urdf", "--repair", "triangle-inequality", "-o", "robot.yaml")
    simspec("import", "good.urdf", "-o", "robot.yaml")
    text = (folder / "robot.yaml").read_text()
    assert is_unchanged(text.encode())
    (folder / "robot.yaml").write_text(text.replace("mass: 2", "mass: 3"))
    simspec("import", "good.urdf", "-o", "robot.yaml", code=2)
    assert "mass: 3" in (folder / "robot.yaml").read_text()


def test_the_robot_file_itself_is_never_written(folder):
    before = (folder / "good.urdf").read_bytes()
    for words in (("import", "good.urdf", "-o", "good.urdf"), ("accept", "good.urdf"), ("fmt", "good.urdf")):
        simspec(*words, code=2)
    assert (folder / "good.urdf").read_bytes() == before


def test_strict_refuses_what_changes_physics_and_writes_nothing(folder):
    done = simspec("import", "good.urdf", "--strict", "-o", "good.yaml", code=2)
    assert "good.urdf:5:1" in done.stderr
    assert "transmission" not in done.stderr
    assert not (folder / "good.yaml").exists()


def test_json_has_counts_losses_and_repairs(folder):
    data = json.loads(simspec("import", "bad.urdf", "--repair", "triangle-inequality", "--json").stdout)
    assert data["counts"] == {"carried": 25, "carried_but_unused": 0, "lost": 2, "lost_of_physics": 1}
    assert [(loss["what"], loss["line"], loss["severity"]) for loss in data["losses"]] == [
        ("joint[hinge]/unheard", 5, "physics"),
        ("transmission[t]", 6, "information"),
    ]
    assert [(repair["rule"], repair["path"]) for repair in data["repairs"]] == [
        ("triangle-inequality", "model.bodies.arm.inertia")
    ]
    assert "# repaired (triangle-inequality)" in data["text"]
    assert all(digest.isalnum() for digest in data["read"].values())


@pytest.mark.parametrize("words", [("check", "bad.urdf"), ("diff", "bad.urdf", "good.urdf"), ("compile", "bad.urdf")])
def test_defects_end_every_command(folder, words):
    assert "bad.urdf:3:1" in simspec(*words, code=2).stderr


def test_check_warns_of_losses_of_physics_and_strict_refuses_them(folder):
    done = simspec("check", "good.urdf")
    assert "good.urdf:5:1: warning[W119]: joint[hinge]/unheard" in done.stderr
    assert "transmission" not in done.stderr
    simspec("check", "good.urdf", "--strict", code=2)


def test_a_scenario_repairs_and_warns_as_well(folder):
    scenario = "simspec: 1\nname: s\nmodels:\n  r:\n    use: bad.urdf\n"
    (folder / "s.yaml").write_text(scenario)
    assert "bad.urdf:3:1" in simspec("check", "s.yaml", code=2).stderr
    (folder / "s.yaml").write_text(scenario + "    import: {repair: [triangle-inequality]}\n")
    assert "bad.urdf:5:1: warning" in simspec("check", "s.yaml").stderr
    simspec("diff", "bad.urdf", "s.yaml", code=2)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nothing.urdf",), "no such file"),
        (("panda_description",), "robot_descriptions"),
        ((".",), "is a folder"),
        (("good.urdf", "--package", "a"), "expected NAME=DIR"),
        (("good.urdf", "--package", "a=b", "--package", "a=c"), "given twice"),
        (("good.urdf", "--arg", "=x"), "expected NAME=VALUE"),
        (("good.urdf", "--repair", "everything"), "no rule of repair is called 'everything'"),
    ],
)
def test_wrong_words_are_named(folder, words, message):
    assert message in simspec("import", *words, code=2).stderr


def test_a_spec_is_not_imported(folder):
    simspec("import", "good.urdf", "-o", "good.yaml")
    assert "not a file of a language" in simspec("import", "good.yaml", code=2).stderr


def test_overrides_reach_into_a_robot_file(folder):
    simspec("check", "good.urdf", "--set", "model.bodies.arm.joint.damping=0.5", "--set", "physics.duration=1s")
    world = load(folder / "good.urdf", sets=["model.bodies.arm.mass=5"]).resolve()
    assert world.bodies[1].inertial.mass == 5.0


def test_an_import_beyond_the_limits_of_a_spec_is_an_error_at_the_robot_file_before_resolution(folder, monkeypatch):
    monkeypatch.setattr(writing, "MOST_EVENTS", 30)
    monkeypatch.setattr(Spec, "resolve", lambda self: pytest.fail("resolved"))
    done = simspec("import", "good.urdf", "-o", "good.yaml", code=2)
    assert "good.urdf:1:" in done.stderr
    assert "more keys and values than one file may have" in done.stderr
    assert "{use: FILE}" in done.stderr
    assert not (folder / "good.yaml").exists()


def test_keys_and_values_are_counted_as_the_reader_counts_them(folder):
    data = load(folder / "good.urdf").source.imported.data
    text = simspec("import", "good.urdf").stdout
    assert event_count(data) == len(list(events(text, "good.yaml")))
    assert event_count({"a": [], "b": {}, "c": [1, "x", None, {"d": 0.5}]}) == len(
        list(events("a: []\nb: {}\nc: [1, x, null, {d: 0.5}]\n", "a.yaml"))
    )


def test_comments_find_their_entries():
    data = {"bodies": {"a": {"shapes": [{"x": 1}, {"x": 2}]}, "b": {"mass": 1}}}
    root, index = node_of(data), {}
    for path in ("bodies.a.shapes.1.x", "bodies.b.mass", "bodies.a"):
        assert writing._entry(root, path, index).node is _below(root, path)
    assert writing._entry(root, "bodies.b.mass.more", index).name == "mass"
    assert writing._entry(root, "bodies.a.shapes.9", index).name == "shapes"
    assert writing._entry(root, "nothing", index) is None


def _below(node, path):
    for step in path.split("."):
        entries = node.entries
        node = (entries[int(step)] if step.isdigit() else next(child for child in entries if child.name == step)).node
    return node


def test_check_lists_what_all_repaired_and_a_run_keeps_it(folder):
    said = simspec("check", "bad.urdf", "--repair", "all").stdout
    assert "ok, 2 bodies" in said
    assert "triangle-inequality" in said
    (row,) = json.loads(simspec("check", "bad.urdf", "--repair", "all", "--json").stdout)["specs"]
    assert [(repair["rule"], repair["line"]) for repair in row["repairs"]] == [("triangle-inequality", 3)]
    (row,) = json.loads(simspec("check", "good.urdf", "--repair", "all", "--json").stdout)["specs"]
    assert row["repairs"] == []
    spec = load("bad.urdf", options=ImportOptions(repair=("all",)))
    source = source_of("bad.urdf", None, spec, RobotFileOptions(repair=("all",)))
    assert [repair["rule"] for repair in source["repairs"]] == ["triangle-inequality"]
    assert "# repaired (triangle-inequality): " in simspec("import", "bad.urdf", "--repair", "all").stdout
