"""``simspec engines install NAME@VERSION``: a separate environment, found by its label, and never in a foreign folder."""

from __future__ import annotations

import json
import os
import sys

import pytest

from simspec import cli
from simspec.commands.options import interpreters
from simspec.engines.kit.environments import making, requirement
from simspec.engines.kit.registry import find_engine, parse
from simspec.errors import EngineError
from simspec.outputs import files
from simspec.project import NotTrustedError
from tests.files import program

VENV = """#!/bin/sh
echo "$@" >> {log}
if [ "$3" = venv ]; then mkdir -p "$4/bin" && cp "$0" "$4/bin/python"; exit; fi
if [ "$3" = -c ]; then echo '{{"version": "'$(cat {version})'", "numpy": "2.0"}}'; exit; fi
exit $(cat {code} 2>/dev/null || echo 0)
"""


@pytest.fixture
def made(tmp_path, monkeypatch):
    """The folder of environments, with a stub interpreter whose pip installs the version in the file ``version`` and ends with
    the code in the file ``code``; ``log`` has its calls."""
    script = VENV.format(log=tmp_path / "log", version=tmp_path / "version", code=tmp_path / "code")
    monkeypatch.setattr(sys, "executable", str(program(tmp_path / "python", script)))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "version").write_text("3.17.4")
    return tmp_path / "data" / "simspec" / "engines"


def answer(capsys, *words: str, code: int = 0):
    assert cli.main(["engines", *words, "--json"]) == code
    return json.loads(capsys.readouterr().out)["engines"]


def pip_calls(place) -> list[str]:
    log = place.parents[2] / "log"
    return [line for line in log.read_text().splitlines() if line.startswith("-I -m")] if log.exists() else []


def test_a_version_gets_an_environment_that_its_label_finds(made, capsys):
    place = made / "mujoco@3.17"
    [venv, pip] = [command["words"] for command in answer(capsys, "install", "mujoco@3.17")["mujoco@3.17"]["commands"]]
    assert venv == f"{sys.executable} -I -m venv {place}"
    assert pip.startswith(f"{place}/bin/python -I -m pip install 'mujoco==3.17.*' numpy 'pin")
    [_, pip] = [command["words"] for command in answer(capsys, "install", "rapier@0.36")["rapier@0.36"]["commands"]]
    assert "numpy scipy" in pip  # which it needs for hulls of meshes
    assert not made.exists()  # nothing is run unasked
    assert pip_calls(made) == []
    assert interpreters(None) == {}

    row = answer(capsys, "install", "mujoco@3.17", "--yes")["mujoco@3.17"]
    assert (row["state"], row["version"], row["problem"]) == ("installed", "3.17.4", None)
    assert [words.split()[2] for words in pip_calls(made)] == ["venv", "pip"]
    assert interpreters(None) == {"mujoco@3.17": str(place / "bin" / "python")}
    assert interpreters(["mujoco@3.17=/other"]) == {"mujoco@3.17": "/other"}
    assert cli.main(["engines", "--json"]) == 0
    rows = {instance["label"]: instance for instance in json.loads(capsys.readouterr().out)["instances"]}
    assert (rows["mujoco@3.17"]["version"], rows["mujoco@3.17"]["problem"]) == ("3.17.4", None)

    again = answer(capsys, "install", "mujoco@3.17", "--yes")["mujoco@3.17"]
    assert (again["state"], again["commands"]) == ("installed", [])
    assert len(pip_calls(made)) == 2


def test_the_project_file_comes_before_what_simspec_made(made, capsys, tmp_path):
    answer(capsys, "install", "mujoco@3.17", "--yes")
    (tmp_path / "simspec.toml").write_text('[engines."mujoco@3.17"]\npython = "/mine/python"\n')
    with pytest.raises(NotTrustedError, match="simspec trust"):
        interpreters(None)["mujoco@3.17"]  # and not the one that simspec made
    assert cli.main(["trust"]) == 0
    assert interpreters(None) == {"mujoco@3.17": "/mine/python"}


def test_an_incomplete_environment_is_not_used_and_is_made_again(made, capsys, tmp_path):
    (tmp_path / "code").write_text("7")
    row = answer(capsys, "install", "mujoco@3.17", "--yes", code=3)["mujoco@3.17"]
    assert row["problem"].endswith("ended with code 7")
    assert interpreters(None) == {}
    (tmp_path / "code").unlink()
    (made / "mujoco@3.17" / "left").write_text("")
    assert answer(capsys, "install", "mujoco@3.17", "--yes")["mujoco@3.17"]["state"] == "installed"
    assert not (made / "mujoco@3.17" / "left").exists()


def test_a_version_that_differs_from_the_label_is_reported(made, capsys, tmp_path):
    (tmp_path / "version").write_text("3.1.7")
    row = answer(capsys, "install", "mujoco@3.17", "--yes", code=3)["mujoco@3.17"]
    assert (row["state"], row["version"]) == ("not installed", "3.1.7")
    assert "is version 3.1.7, not 3.17" in row["problem"]


@pytest.mark.parametrize("made_by_others", ["", "nonsense", '{"name": "mujoco@3.1", "whole": true}'])
def test_a_folder_that_simspec_did_not_make_stays(made, capsys, made_by_others):
    place = made / "mujoco@3.17"
    place.mkdir(parents=True)
    (place / files.BEGUN).write_text(made_by_others)
    (place / "mine").write_text("")
    program(place / "bin" / "python", "#!/bin/sh\n")
    assert interpreters(None) == {}
    row = answer(capsys, "install", "mujoco@3.17", "--yes", code=3)["mujoco@3.17"]
    assert "simspec did not make it" in row["problem"]
    assert (place / "mine").exists()
    assert pip_calls(made) == []


def test_an_engine_in_conflict_with_others_gets_a_separate_environment_that_its_name_finds(made, capsys):
    row = answer(capsys, "install", "mjx", "--yes")["mjx"]
    assert (row["state"], row["version"], row["problem"]) == ("installed", "3.17.4", None)
    assert "'mujoco-mjx==3.17.*' numpy 'pin" in row["commands"][1]["words"]
    python = str(made / "mjx@3.17" / "bin" / "python")
    assert interpreters(None) == {"mjx": python, "mjx@3.17": python}
    # the label finds the version that is installed here
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(find_engine("mjx"), "version", classmethod(lambda cls: "3.17.0"))
        assert interpreters(None) == {"mjx@3.17": python}


def test_an_environment_of_another_user_is_not_started(made, capsys, monkeypatch):
    answer(capsys, "install", "mujoco@3.17", "--yes")
    monkeypatch.setattr(files.os, "geteuid", lambda: os.getuid() + 1)
    monkeypatch.setattr(files.os, "fstat", lambda descriptor: os.stat_result([0o100644, 0, 0, 1, 4242, *[0] * 5]))
    assert interpreters(None) == {}


@pytest.mark.parametrize(
    ("label", "wanted"),
    [
        ("mujoco@3.17", "mujoco==3.17.*"),
        ("mujoco@3.3.7", "mujoco==3.3.7.*"),
        ("mujoco@4.0", "mujoco-core==4.0.*"),
        ("mujoco@3.2.0rc1", "mujoco==3.2.0rc1"),
        ("drake@1.40", "drake==1.40.*"),
    ],
)
def test_pip_receives_the_version_of_the_label(label, wanted):
    engine = parse(label)
    assert requirement(find_engine(engine.name), engine.version) == wanted


@pytest.mark.parametrize(("label", "why"), [("ode@0.16", "comes with the machine"), ("mujoco@3-x", "is not a version")])
def test_labels_without_an_installable_version_get_no_environment(label, why, capsys, made):
    with pytest.raises(EngineError, match=why):
        making(parse(label))
    assert why in answer(capsys, "install", label, "--yes", code=3)[label]["problem"]
    assert not made.exists()


def test_an_interpreter_is_not_installed(capsys):
    assert cli.main(["engines", "install", "mujoco@3.3=/some/python"]) == 2
    assert "has an interpreter already" in capsys.readouterr().err
