"""Which engines a command takes: those that are named have to; where none is, those that support the world do."""

from __future__ import annotations

import json

import pytest

import simspec
from simspec import cli, selection
from simspec.engines.kit.registry import engines
from simspec.errors import UnsupportedError
from tests.caches import cache_home
from tests.installed import INSTALLED, LEFT_OUT

pytestmark = pytest.mark.usefixtures("warm_engines")

BALL = """simspec: 1
name: ball
physics: {timestep: 1 ms, duration: 20 ms}
bodies:
  ball:
    pose: {xyz: [0, 0, 1]}
    shapes: [{sphere: {radius: 50 mm}, density: 1000}]
  floor: {fixed: true, shapes: [{plane: {}}]}
contact:
  materials: {rubber: {friction: 0, restitution: 0.5}}
engines:
  mujoco: {accept: [material.restitution]}
  dart: {accept: [material.restitution]}
  gazebo: {accept: [material.restitution]}
"""
ALONE = """simspec: 1
name: ball
physics: {timestep: 1 ms, duration: 20 ms}
bodies:
  ball:
    pose: {xyz: [0, 0, 1]}
    shapes: [{ellipsoid: {radii: [50 mm, 40 mm, 30 mm]}, density: 1000}]
  floor: {fixed: true, shapes: [{plane: {}}]}
contact:
  friction_cone: pyramid-inscribed
  materials: {rubber: {friction: 0.5}}
engines:
  mujoco: {accept: [contact.friction.impact, contact.cone.pyramid-inscribed]}
"""
"""One engine has this cone and this shape."""
WRONG = BALL.replace("mujoco: {", "mujoco: {settings: {nothing: 1}, ")


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", cache_home(tmp_path))

    def write(text):
        (tmp_path / "ball.yaml").write_text(text)
        return tmp_path

    return write


def answer(capsys, *words, code=0):
    capsys.readouterr()
    assert cli.main([*words, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_refusing_engines_are_listed_with_the_place_and_the_others_continue(place, capsys):
    place(BALL)
    (compiled,) = answer(capsys, "compile", "ball.yaml")["compiled"]
    proven = answer(capsys, "verify", "ball.yaml")
    run = answer(capsys, "run", "ball.yaml", "--all-engines", "--no-repeats")
    assert set(INSTALLED) - {"drake"} <= set(compiled["engines"]) <= set(engines()) - {"drake", "webots"}
    assert set(proven["certificate"]["engines"]) == set(run["runs"]) == set(INSTALLED) - {"drake"}
    for left_out in (compiled["not_compiled"], proven["not_verified"], run["not_run"]):
        assert [name for name in left_out if name not in LEFT_OUT] == ["drake"]
        assert "material.restitution" in left_out["drake"]["reason"]
        assert left_out["drake"]["location"]["file"].endswith("ball.yaml")
        assert left_out["drake"]["acceptable"] is False
    assert run["exit_code"] == 0


def test_tables_have_a_row_for_each_engine_that_is_left_out(place, capsys):
    place(BALL)
    assert cli.main(["run", "ball.yaml", "--all-engines", "--no-repeats", "--no-verify", "-v"]) == 0
    said = capsys.readouterr().out
    assert "Not run" in said
    assert "\nnot run       drake: material.restitution\n" in said
    row = next(line for line in said.splitlines() if line.strip().startswith("drake"))
    assert "material.restitution" in row
    assert cli.main(["compile", "ball.yaml"]) == 0
    assert "not for drake: " in capsys.readouterr().out


@pytest.mark.parametrize("words", [("compile",), ("verify",), ("run",), ("check",)])
def test_an_engine_that_is_named_and_refuses_is_an_error(place, capsys, words):
    place(BALL)
    found = answer(capsys, *words, "ball.yaml", "--engine", "drake", "--engine", "mujoco", code=2)
    assert any("material.restitution" in problem["message"] for problem in found["error"]["problems"])
    assert not list(place(BALL).glob("[gr][eu]n*"))


def test_run_compares_at_least_two(place, capsys):
    place(ALONE)
    found = answer(capsys, "run", "ball.yaml", "--all-engines", code=2)["error"]["problems"]
    assert "at least 2 engines must support this world, and mujoco does" in found[-1]["message"]
    assert found[-1]["hint"] == "run it alone: --engine mujoco"
    assert {problem["message"].split()[0] for problem in found[:-1]} >= {"Drake", "DART"}
    # a proof of one engine is a proof
    assert list(answer(capsys, "verify", "ball.yaml")["certificate"]["engines"]) == ["mujoco"]


def test_a_mistake_for_all_engines_is_an_error(place, capsys):
    place(WRONG)
    for words in (("compile",), ("verify",), ("run", "--all-engines")):
        found = answer(capsys, words[0], "ball.yaml", *words[1:], code=2)
        assert "nothing" in json.dumps(found)


def test_where_no_engine_supports_a_world_all_say_why():
    world = simspec.Spec.from_data({"simspec": 1, "name": "a", "bodies": {"b": {"fixed": True}}}).resolve()
    names = list(engines())
    compiled, left = selection.supporting(world, names, lambda path: None)
    assert (list(compiled), left) == (names, {})
    ball = simspec.load(simspec.find_spec("bouncing-ball")).resolve()
    with pytest.raises(UnsupportedError) as caught:
        selection.Selection(("drake",), False, {}).for_world(ball)
    assert [problem.path for problem in caught.value.problems][:-1] == ["contact.pairs.rubber.rubber.restitution"]
    # named engines stay: compiling is what refuses
    assert selection.named(["drake"]).for_world(ball).engines == ("drake",)


def test_acceptable_features_are_reported(place, capsys):
    place(BALL.replace("  mujoco: {accept: [material.restitution]}\n", ""))
    assert cli.main(["run", "ball.yaml", "--all-engines", "--no-repeats", "--no-verify", "-v"]) == 0
    said = capsys.readouterr().out
    assert "mujoco: material.restitution (can be accepted)" in " ".join(said.split())
    assert "to accept by name what differs: simspec accept SPEC  (mujoco)" in said
    assert cli.main(["accept", "ball.yaml"]) == 0
    said = capsys.readouterr().out
    assert "engines.mujoco.accept: material.restitution" in said
    assert "not for drake: " in said
    assert cli.main(["accept", "ball.yaml", "--engine", "drake"]) == 2
    found = set(answer(capsys, "compile", "ball.yaml")["compiled"][0]["engines"])
    assert set(INSTALLED) - {"drake"} <= found <= set(engines()) - {"drake", "webots"}


def test_engines_that_are_not_installed_are_listed_too(place, capsys, monkeypatch):
    place(BALL)
    monkeypatch.setattr(engines()["dart"], "version", classmethod(lambda cls: None))
    run = answer(capsys, "run", "ball.yaml", "--all-engines", "--no-repeats", "--no-verify")
    assert set(run["runs"]) == set(INSTALLED) - {"dart", "drake"}
    assert run["not_run"]["dart"]["reason"] == "not installed: pip install 'simspec-physics[dart]'"
