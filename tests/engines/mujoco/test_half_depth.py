"""MuJoCo before 3.4 has half the depth where two boxes touch: refused there, unless that is accepted by name. That other
releases hold the same model is tested in ``tests/engines/test_second_environment.py``, in an environment made for it.
"""

from __future__ import annotations

import json

import pytest

import simspec
from simspec import cli
from simspec.commands.loading import accepted_sets
from simspec.commands.options import Options
from simspec.compiler import compile_world
from simspec.engines.kit.environments import making
from simspec.engines.kit.registry import find_engine, parse, too_old
from simspec.errors import EngineError, UnsupportedError
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.testing import worlds as shipped
from tests import worlds

BOX = Feature.SHAPE_BOX.value
OLD = "mujoco@3.3.7"
MUJOCO = find_engine("mujoco")


def ramp(*sets: str):
    return simspec.load(simspec.find_spec("box-on-ramp"), sets=sets)


def test_boxes_on_boxes_are_refused_with_the_place_and_the_name_to_accept():
    spec = ramp()
    with pytest.raises(UnsupportedError) as caught:
        compile_world(spec.resolve(), [OLD], spec.locate)
    (problem,) = caught.value.problems
    assert "MuJoCo before 3.4 computes half the overlap depth of two boxes" in problem.message
    assert problem.location.file.endswith("box-on-ramp.yaml")
    assert f"engines.mujoco.accept: [{BOX}], or --accept {BOX}" in problem.hint
    assert compile_world(spec.resolve(), ["mujoco@3.4.0", "mujoco@3.4", "mujoco"])


def test_accepted_features_are_compiled_and_listed_in_the_decisions():
    world = ramp(f"engines.mujoco.accept=[contact.friction.impact, {BOX}]").resolve()
    for label, level in ((OLD, Level.APPROXIMATE), ("mujoco@3.4.0", Level.EXACT)):
        compiled = compile_world(world, [label])[label]
        assert {decision.feature: decision.level for decision in compiled.decisions}[Feature.SHAPE_BOX] is level


@pytest.mark.parametrize("world", [worlds.spheres(2), shipped.hinges()], ids=lambda world: world.name)
def test_worlds_in_which_no_two_boxes_meet_need_no_acceptance(world):
    assert compile_world(world, [OLD, "mujoco@3.3"])


def test_a_version_s_needs_are_accepted_on_the_command_line():
    sets = accepted_sets(Options(accept=[BOX], engine=[OLD]), "box-on-ramp")
    assert f"engines.mujoco.accept=[contact.friction.impact, {BOX}]" in sets
    assert any(BOX in entry for entry in accepted_sets(Options(accept=["all"], engine=[OLD]), "box-on-ramp"))


def test_a_version_s_needs_are_written_into_the_spec(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = simspec.find_spec("box-on-ramp").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    assert cli.main(["accept", "mine.yaml", "--engine", OLD, "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["added"]["mujoco"]["accept"]) == [BOX]
    assert BOX in simspec.load("mine.yaml").resolve().options("mujoco").accept
    assert cli.main(["accept", "mine.yaml", "--engine", OLD, "--json"]) == 0
    assert not json.loads(capsys.readouterr().out)["written"]


def test_deviations_of_earlier_releases_count_there_alone():
    law = next(iter(worlds.spheres(1).contact.pairs))
    bounded = [contact_deviation for contact_deviation in MUJOCO.CONTACT_DEVIATIONS if contact_deviation.until]
    assert {"rest", "push", "stop"} <= {deviation.probe for deviation in bounded}
    rest = next(deviation for deviation in bounded if deviation.probe == "rest")
    for version, counts in (("3.3.7", True), ("3.4.0", False), ("4.0.1", False), (None, False), ("main", False)):
        assert rest.counts_for(law, "elliptic", 0.001, {}, version=version) is counts
    for name in ("mjx", "mjwarp"):
        assert not any(contact_deviation.until for contact_deviation in find_engine(name).CONTACT_DEVIATIONS)
        assert not find_engine(name).SUPPORT[Feature.SHAPE_BOX].since


@pytest.mark.parametrize("version", ["3.2", "3.2.7", "3.3.5", "2.3"])
def test_releases_that_do_not_read_the_files_are_refused_before_they_are_installed(version, capsys):
    assert "from 3.3.6 on" in too_old(MUJOCO, version)
    with pytest.raises(EngineError, match=r"from 3\.3\.6 on"):
        making(parse(f"mujoco@{version}"))
    assert cli.main(["engines", "install", f"mujoco@{version}"]) == 3


@pytest.mark.parametrize("version", ["3.3", "3.3.6", "3.3.7", "3.4", "4.0.1", "3"])
def test_others_are_not(version):
    assert too_old(MUJOCO, version) is None
