"""``simspec engines doctor`` and ``install``: each way to have half an engine has its words, and nothing is run unasked."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import os
import shlex
import sys
from pathlib import Path

import pytest

from simspec import cli
from simspec.commands import install as installing
from simspec.engines.drake.engine import Drake
from simspec.engines.kit import environments, registry
from simspec.engines.kit.compiled import NativeBinary, Needs
from simspec.engines.kit.environments import InstallState, diagnose
from simspec.proof import probes as falling
from tests.files import program

REQUIRED = [
    "numpy>=1",
    'toy-core<2,>=1.0; extra == "toy"',
    'simspec-physics[toy-proof]; extra == "toy"',
    'toy-oracle>=3; extra == "toy-proof"',
    'other>=3; extra == "other"',
]


def answer(capsys, *words: str, code: int = 0):
    assert cli.main(["engines", *words, "--json"]) == code
    return json.loads(capsys.readouterr().out)["engines"]


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """An engine whose extra pulls two packages; a function installs packages in a folder that this interpreter looks in."""
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: REQUIRED)
    monkeypatch.syspath_prepend(tmp_path / "site")

    class Toy(Drake):
        NAME, TITLE, DISTRIBUTION, OTHER_DISTRIBUTIONS, EXTRA = "toy", "Toy", "toy-core", ("toy",), "toy"

    monkeypatch.setitem(registry.engines()._loaded, "toy", Toy)

    def install(**versions: str) -> type:
        for name, version in versions.items():
            folder = tmp_path / "site" / f"{name}-{version}.dist-info"
            folder.mkdir(parents=True)
            (folder / "METADATA").write_text(
                f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: {version}\n"
            )
        return Toy

    return install


@pytest.mark.parametrize(
    ("versions", "state", "problems"),
    [
        (
            {},
            InstallState.ABSENT,
            ["toy-core is not installed: simspec-physics[toy] requires toy-core<2,>=1.0", "toy-oracle is not"],
        ),
        ({"toy_core": "1.2", "toy_oracle": "3.1"}, InstallState.WHOLE, []),
        ({"toy": "1.3", "toy_oracle": "3.1"}, InstallState.WHOLE, []),
        (
            {"toy_core": "1.2"},
            InstallState.HALF,
            ["toy-oracle is not installed: simspec-physics[toy] requires toy-oracle>=3"],
        ),
        (
            {"toy_core": "2.0", "toy_oracle": "3.1"},
            InstallState.OTHER_VERSION,
            ["toy-core 2.0 is installed: simspec-physics[toy] requires"],
        ),
        ({"toy_core": "unknown", "toy_oracle": "3.1"}, InstallState.OTHER_VERSION, ["toy-core unknown is installed"]),
        ({"toy_core": "1.2", "toy_oracle": "2"}, InstallState.OTHER_VERSION, ["toy-oracle 2 is installed"]),
    ],
)
def test_packages_that_are_there_in_part_or_in_another_version(packages, versions, state, problems):
    found = diagnose(packages(**versions))
    assert found.state is state
    assert len(found.problems) == len(problems)
    assert all(problem.startswith(words) for problem, words in zip(found.problems, problems, strict=True))
    assert found.install == "pip install 'simspec-physics[toy]'"


def test_requirements_are_those_of_the_extra_alone(packages):
    assert [requirement.name for requirement in environments.requirements("toy")] == ["toy-core", "toy-oracle"]


def test_doctor_ends_with_3_for_what_is_half_there_and_for_what_is_named(packages, capsys):
    assert answer(capsys, "doctor", "toy", code=3)["toy"]["state"] == "not installed"
    packages(toy_core="1.2")
    row = answer(capsys, "doctor", "toy", code=3)["toy"]
    assert (row["state"], row["version"], row["seconds"]) == ("half installed", "1.2", None)
    assert cli.main(["engines", "doctor", "toy"]) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert "toy-oracle is not installed" in said
    assert "pip install 'simspec-physics[toy]'" in said.replace("\n", " ")


@pytest.fixture
def toys(tmp_path, monkeypatch):
    """A function that makes an engine which is a library of the machine, ``toys`` 1.2, with a part of the given text."""
    (tmp_path / "toys.pc").write_text("Name: toys\nDescription: of a test\nVersion: 1.2\n")
    monkeypatch.setenv("PKG_CONFIG_PATH", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def engine(text: str, **more) -> type:
        source = tmp_path / "part.c"
        source.write_text(text)
        part = NativeBinary("toys", "toys-part", (source,), packages=("toys",), **more)

        class Toys(Drake):
            NAME, DISTRIBUTION, EXTRA = "toys", "", ""
            NEEDS = Needs("toys >= 1.0", (part,), (("libtoys-dev", "the engine"), ("gcc", "compiles its part")))

        monkeypatch.setitem(registry.engines()._loaded, "toys", Toys)
        return Toys

    return engine


@pytest.mark.parametrize(
    ("text", "more", "said"),
    [
        ("#include <toys/toys.h>\n", {}, "the header toys/toys.h is not installed"),
        ("int x;\n", {"links": ("-lno_such_toys",)}, "the library no_such_toys is not installed"),
        ("int x\n", {}, "ended with code 1"),
        ("int gone(void); int x(void) { return gone(); }\n", {"flags": ("-Wl,-z,now",)}, "undefined symbol: gone"),
    ],
)
def test_a_part_that_cannot_be_made_or_loaded(toys, capsys, text, more, said):
    toys(text, **more)
    row = answer(capsys, "doctor", "toys", code=3)["toys"]
    assert row["state"] == "fails"
    assert row["version"] == "1.2"
    assert said in row["problems"][0]
    assert row["install"] == "apt-get install libtoys-dev gcc"


def test_a_library_without_a_compiler_is_a_partial_installation_and_an_old_library_a_wrong_version(
    toys, tmp_path, monkeypatch
):
    engine = toys("int x;\n")
    assert diagnose(engine).state is InstallState.WHOLE
    engine.NEEDS = dataclasses.replace(engine.NEEDS, library="toys >= 2")
    old = diagnose(engine)
    assert (old.state, old.version) == (InstallState.OTHER_VERSION, "1.2")
    assert old.problems == ("version 1.2 of its library is installed: it requires toys >= 2",)
    engine.NEEDS = dataclasses.replace(engine.NEEDS, library="toys")
    monkeypatch.setenv("CC", "no-such-compiler")
    half = diagnose(engine)
    assert (half.state, half.version) == (InstallState.HALF, "1.2")
    assert "no-such-compiler (the environment variable CC) is not on the path" in half.problems[0]
    (tmp_path / "toys.pc").unlink()
    monkeypatch.setenv("PKG_CONFIG_PATH", str(tmp_path / "nowhere"))
    monkeypatch.delenv("CC")
    gone = diagnose(engine)
    assert (gone.state, gone.version) == (InstallState.ABSENT, None)
    assert "pkg-config has no toys" in gone.problems[0]


# --- whether it works -------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("warm_engines")
def test_a_ball_falls_as_a_ball_does(capsys):
    row = answer(capsys, "doctor", "mujoco")["mujoco"]
    assert row["state"] == "works"
    assert row["speed_error"] < 1e-13
    assert 0.0 < row["height_error"] <= falling.WAY


@pytest.mark.usefixtures("warm_engines")
def test_a_ball_that_falls_otherwise_is_seen(monkeypatch, capsys):
    genuine = falling.compile_world

    def heavier(world, *words, **more):
        gravity = tuple(1.001 * value for value in world.physics.gravity)
        return genuine(
            dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=gravity)), *words, **more
        )

    monkeypatch.setattr(falling, "compile_world", heavier)
    row = answer(capsys, "doctor", "mujoco", code=3)["mujoco"]
    assert row["state"] == "fails"
    assert "a speed that is 0.001 (relative) off g t" in row["problems"][0]


def test_an_interpreter_without_the_engine_is_reported(tmp_path, monkeypatch, capsys):
    python = program(tmp_path / "python", "#!/bin/sh\nexit 3\n")
    (tmp_path / "simspec.toml").write_text(f'[engines."mujoco@3"]\npython = "{python}"\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert cli.main(["trust"]) == 0
    capsys.readouterr()
    row = answer(capsys, "doctor", "mujoco@3", code=3)["mujoco@3"]
    assert row["state"] == "fails"
    assert "gave no version, exit code 3" in row["problems"][0]


def test_an_unknown_engine_name_is_reported(capsys):
    assert cli.main(["engines", "doctor", "no-such-engine"]) == 3
    assert "no such engine" in capsys.readouterr().err


# --- installing -------------------------------------------------------------------------------------------------------


@pytest.fixture
def commands(tmp_path, monkeypatch):
    """A stub interpreter and a stub apt-get, and a function that returns their calls."""
    log = tmp_path / "log"
    ending = f"exit $(cat {tmp_path}/code 2>/dev/null || echo 0)"
    effect = f"[ ! -e {tmp_path}/effect ] || sh {tmp_path}/effect"
    script = f'#!/bin/sh\necho "$(basename "$0") $@" >> {log}\necho noise\n{effect}\n{ending}\n'
    monkeypatch.setattr(sys, "executable", str(program(tmp_path / "bin" / "python", script)))
    program(tmp_path / "bin" / "apt-get", script)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    return lambda: log.read_text().splitlines() if log.exists() else []


PIP = "python -I -m pip install simspec-physics[toy]"
APT = ["apt-get update --quiet", "apt-get install --yes --no-install-recommends libtoys-dev gcc"]


def test_install_commands_are_printed_and_run_only_on_request(packages, commands, capsys, tmp_path):
    [command] = answer(capsys, "install", "toy")["toy"]["commands"]
    assert command == {
        "words": f"{sys.executable} -I -m pip install 'simspec-physics[toy]'",
        "ran": False,
        "code": None,
    }
    assert shlex.split(command["words"])[0] == sys.executable
    assert commands() == []
    assert cli.main(["engines", "install", "toy"]) == 0
    assert command["words"] in capsys.readouterr().out
    packages(toy_core="1.2", toy_oracle="3.1")
    (tmp_path / "site").rename(tmp_path / "made")
    (tmp_path / "effect").write_text(f"mv {tmp_path}/made {tmp_path}/site\n")
    row = answer(capsys, "install", "toy", "--yes")["toy"]
    assert row["commands"][0]["code"] == 0
    assert (row["state"], row["version"]) == ("installed", "1.2")
    assert commands() == [PIP]


def test_an_installer_that_installs_nothing_is_exit_3(packages, commands, capsys):
    """pip ends with code 0 and a warning where the installed simspec does not know the extra."""
    row = answer(capsys, "install", "toy", "--yes", code=3)["toy"]
    assert row["commands"][0]["code"] == 0
    assert row["problem"].startswith("not installed after these commands: toy-core is not installed")


def test_a_command_that_fails_is_exit_3(packages, commands, capsys, tmp_path):
    (tmp_path / "code").write_text("7")
    row = answer(capsys, "install", "toy", "--yes", code=3)["toy"]
    assert row["commands"][0]["code"] == 7
    assert row["problem"].endswith("ended with code 7")


def test_debians_packages_are_roots_matter(toys, commands, capsys, monkeypatch):
    toys("int x;\n")
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(installing.os, "geteuid", lambda: 1000)
    row = answer(capsys, "install", "toys", "--yes", code=3)["toys"]
    assert row["problem"] == "not run: it needs root"
    assert [command["words"] for command in row["commands"]] == APT
    assert commands() == []
    monkeypatch.setattr(installing.os, "geteuid", lambda: 0)
    assert answer(capsys, "install", "toys")["toys"]["problem"] is None
    assert commands() == []
    row = answer(capsys, "install", "toys", "--yes", code=3)["toys"]  # the stub installs no compiler
    assert "after these commands" in row["problem"]
    assert commands() == APT


def test_installed_engines_are_not_installed_again(packages, commands, capsys):
    packages(toy_core="1.2", toy_oracle="3.1")
    assert answer(capsys, "install", "toy", "--yes")["toy"]["state"] == "installed"
    assert commands() == []


def test_an_engine_without_a_release_for_this_python_ends_with_exit_code_3(commands, capsys, monkeypatch):
    monkeypatch.setattr(Drake, "version", classmethod(lambda cls: None))
    monkeypatch.setattr(environments, "why_not", lambda engine, environment: "cannot be installed on Python 3.99")
    row = answer(capsys, "install", "drake", "--yes", code=3)["drake"]
    assert row["problem"] == "cannot be installed on Python 3.99"
    assert commands() == []


@pytest.mark.parametrize("words", [(), ("mujoco", "--all")])
def test_names_or_all(words, capsys):
    assert cli.main(["engines", "install", *words]) == 2
    assert "one or more engines, or --all" in capsys.readouterr().err


def test_make_installs_every_engine_and_ci_those_below_the_size_limit():
    root = Path(__file__).parents[2]
    make = (root / "Makefile").read_text()
    assert "ENGINES ?= --all\n" in make
    assert "simspec engines install $(ENGINES) --yes" in make
    assert "make engines ||" in (root / ".ci" / "run").read_text()
