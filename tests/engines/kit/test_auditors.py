"""Engines that load robot files for an audit, and in which simspec runs no world."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import pytest

from simspec import selection
from simspec.audit import sample
from simspec.audit.audit import NOT_RUN, audit
from simspec.cli import main
from simspec.commands import engines as commands
from simspec.engines.kit import registry
from simspec.engines.kit.registry import auditors, engines, find_engine, instances
from simspec.errors import EXIT_ENGINE, EXIT_WRONG, EngineError
from simspec.formats.kit.contract import formats
from simspec.language.foreign import ImportOptions
from simspec.support.features import Feature

NAMES = list(auditors())


@pytest.fixture(params=NAMES)
def name(request):
    return request.param


def test_each_is_found_by_name_and_is_in_no_list_of_engines_that_run(name):
    assert name not in engines()
    assert find_engine(f"{name}@9.9") is auditors()[name]
    assert name in {instance.engine for instance in instances({})}
    assert {auditors()[name].SUPPORT[feature].level.value for feature in Feature} == {"unsupported"}
    assert auditors()[name].FOREIGN


@pytest.mark.parametrize(
    "words", ["run double-pendulum", "compile double-pendulum", "verify double-pendulum", "engines show"]
)
def test_commands_that_need_worlds_name_the_audit(name, words, capsys):
    given = words.split()
    named = [name] if given[0] == "engines" else ["--engine", name]
    assert main([*given, *named]) == EXIT_WRONG
    said = capsys.readouterr().err
    assert f"simspec audit FILE --engine {name}" in said
    assert "E107" in said


def test_a_spec_has_no_options_for_it(name, tmp_path, capsys):
    file = tmp_path / "a.yaml"
    file.write_text(
        f"simspec: 1\nname: a\nbodies: {{b: {{fixed: true}}}}\nengines:\n  {name}: {{}}\n", encoding="utf-8"
    )
    assert main(["check", str(file)]) == EXIT_WRONG
    said = capsys.readouterr().err
    assert f"a.yaml:5:3: error[E107]: engines.{name}: no engine is called '{name}'" in said
    assert f"{name}," not in said


def test_audits_have_it_by_default_where_it_is_installed_and_other_commands_never(name):
    assert name not in selection.available({name: "/python"}).engines
    assert name in selection.available({name: "/python"}, audits=True).engines
    assert name not in selection.available({}, audits=True).engines
    assert name not in selection.known().engines


def test_an_audit_compiles_nothing_for_it(name, tmp_path):
    file = tmp_path / "stone.urdf"
    file.write_text(formats()["urdf"].plain(sample.SAMPLE).files[file.name], encoding="utf-8")
    found = audit(file, [name], ImportOptions(), pythons={name: "/no/python"})
    (proof,) = found.compiled
    assert (proof.engine, proof.valid, proof.why) == (name, None, NOT_RUN)


@pytest.mark.parametrize("language", ["urdf", "mjcf"])
def test_the_sample_loads_in_each_language(language, monkeypatch):
    engine = find_engine("mujoco")
    only = {language: engine.FOREIGN[language]}
    monkeypatch.setattr(sample, "find_engine", lambda label: SimpleNamespace(FOREIGN=only))
    version, seconds = sample.load_sample("mujoco")
    assert version == engine.version()
    assert seconds > 0.0


def test_of_a_language_that_simspec_does_not_write_there_is_no_sample(monkeypatch):
    monkeypatch.setattr(sample, "find_engine", lambda label: SimpleNamespace(FOREIGN={"sdformat": None}))
    with pytest.raises(EngineError, match="no plain file of sdformat"):
        sample.load_sample("mujoco")


def test_a_sample_of_another_mass_is_an_error(monkeypatch):
    true = sample.loaded

    def heavier(*given):
        found = true(*given)
        answer = found.reply.answers[0]
        bodies = tuple(
            dataclasses.replace(body, inertial=dataclasses.replace(body.inertial, mass=2.5))
            for body in answer.read_back.bodies
        )
        back = dataclasses.replace(answer.read_back, bodies=bodies)
        found.reply = dataclasses.replace(found.reply, answers=[dataclasses.replace(answer, read_back=back)])
        return found

    monkeypatch.setattr(sample, "loaded", heavier)
    with pytest.raises(EngineError, match=r"a body of 2 kg has 2\.5 kg"):
        sample.load_sample("mujoco")


def test_doctor_lets_it_load_a_file(name, monkeypatch, capsys):
    assert main(["engines", "doctor", name, "--json"]) == EXIT_ENGINE
    row = json.loads(capsys.readouterr().out)["engines"][name]
    assert row["state"] == "not installed"
    monkeypatch.setattr(
        commands, "diagnose", lambda engine: SimpleNamespace(state="whole", problems=(), version=None, install="")
    )
    monkeypatch.setattr(sample, "load_sample", lambda label, python: ("9.9", 1.5))
    row = commands.examined(name, "/python", None)
    assert (row["state"], row["version"], row["seconds"]) == (commands.LOADS, "9.9", 1.5)


def test_install_says_before_how_much_it_is(name, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert main(["engines", "install", name]) == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert auditors()[name].INSTALLS in first
    assert any("pip install" in line for line in rest)


def test_an_unknown_name_is_answered_with_the_names_of_both(name):
    with pytest.raises(EngineError, match=rf"known: .*{name}.*did you mean '{name}'"):
        registry.find_engine(f"{name}x")
