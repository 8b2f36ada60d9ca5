"""Shell completion: words, files and folders that may follow on a command line, without an error; the scripts of the shells."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys

import pytest
import typer

from simspec import cli
from simspec.commands.completion import answer_text, parameters_of, values
from simspec.commands.options import COMMANDS
from simspec.engines.kit.registry import engines
from simspec.files import library, resource_folder
from simspec.language.foreign import suffixes
from simspec.support.features import Feature

SHELLS = ("bash", "zsh", "fish")


def offered(*words: str, shell: str = "zsh") -> dict[str, list[str]]:
    """The texts of each kind that may follow."""
    found: dict[str, list[str]] = {}
    for line in answer_text(words, shell).splitlines():
        kind, _, rest = line.partition("\t")
        found.setdefault(kind, []).append(rest.partition("\t")[0])
    return found


def test_every_command_is_offered():
    names = {info.name for info in (*cli.app.registered_commands, *cli.app.registered_groups)}
    assert {word for word in offered("")["word"] if not word.startswith("-")} == names
    assert offered("ver") == {"word": ["verify"]}
    assert offered("engines", "") == {"word": ["show", "doctor", "install"]}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_a_command_is_offered(command):
    group = typer.main.get_command(cli.app)
    for name in command.split():
        group = group.commands[name]
    options = {word for entry in group.params for word in (*entry.opts, *entry.secondary_opts) if word.startswith("-")}
    assert {*offered(*command.split(), "-")["word"]} == options | {"--help"}
    assert all(parameter.description for parameter in parameters_of(command) if parameter.words)


def test_every_argument_has_suggestions_but_a_new_name():
    """A new command whose argument is of an unknown kind is found here."""
    arguments = {(command, part.field) for command in COMMANDS for part in parameters_of(command) if not part.words}
    without = {
        (command, part.field)
        for command in COMMANDS
        for part in parameters_of(command)
        if not part.words and not [*values(part, command)]
    }
    assert len(arguments) > 20
    assert without == {("new", "name")}


def test_an_option_is_offered_again_only_where_it_may_be_repeated():
    words = offered("run", "x", "--engine", "a", "--quick", "--")["word"]
    assert "--engine" in words
    assert "--quick" not in words


@pytest.mark.parametrize("words", [("run", "x", "-e", ""), ("run", "x", "--without", ""), ("engines", "show", "")])
def test_engines_are_offered_by_name(words):
    assert set(engines()) <= set(offered(*words)["word"])


def test_labels_of_the_project_file_are_offered(tmp_path, monkeypatch):
    name = next(iter(engines()))
    (tmp_path / "simspec.toml").write_text(
        f'[engines."{name}@1.5"]\npython = "x"\n[engines."unknown@2"]\npython = "x"\n'
    )
    monkeypatch.chdir(tmp_path)
    assert offered("run", "x", "-e", f"{name}@") == {"word": [f"{name}@1.5"]}
    assert f"{name}@1.5=" in offered("run", "x", "--python", "")["start"]
    assert offered("run", "x", "-e", "unknown@") == {}


def test_scenarios_and_files_of_specs_are_offered():
    assert offered("run", "")["word"] == list(library())
    (ends,) = offered("run", "")["files"]
    assert set(ends.split()) == {".yaml", ".yml", *suffixes()}
    assert "run" not in offered("run", "x", "")  # one spec
    assert offered("check", "x", "")["word"] == list(library())  # several


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("run", "x", "--out", ""), {"folders": [""]}),
        (("run", "x", "--junit", ""), {"files": [""]}),
        (("run", "x", "--junit="), {"files": [""]}),
        (("schema", "--of", "engine-re"), {"word": ["engine-request", "engine-result"]}),
        (("schema", "--of=fig"), {"word": ["--of=figures"]}),
        (("study", "koerber-2021-f"), {"word": ["koerber-2021-figures"], "files": [".yaml .yml"]}),
        (("completion", ""), {"word": list(SHELLS)}),
        (("unknown", ""), {}),
        (("run", "x", "--set", ""), {}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_values_of_options_are_offered(words, found):
    assert offered(*words) == found


def test_features_are_offered():
    assert offered("run", "x", "--accept", "")["word"] == ["all", *(feature.value for feature in Feature)]


def test_bash_replaces_the_part_after_its_ends_of_words():
    (name, *_) = sorted(engines())
    assert offered(f"simspec run --engine={name[:2]}", name[:2], shell="bash")["word"][0] == name
    assert offered("simspec schema --of=fig", "fig", shell="bash") == {"word": ["figures"]}
    assert offered("simspec schema --of fig", "fig", shell="bash") == {"word": ["figures"]}
    assert offered("simspec schema ", "", shell="bash") == {}
    assert offered("simspec run 'a b", "b", shell="bash")["files"]


def test_the_answer_loads_little_and_is_never_an_error(tmp_path):
    """A broken project file, words that no shell splits, no folder of the user: nothing on standard error, exit code 0."""
    (tmp_path / "simspec.toml").write_text("[engines")
    program = (
        "import sys; from simspec.__main__ import main; code = main(); "
        "print(code, *sorted({name.partition('.')[0] for name in sys.modules}), file=sys.stderr)"
    )
    environment = {**os.environ, "_SIMSPEC_COMPLETE": "bash"}
    line = "simspec run x -e '"
    done = subprocess.run(
        [sys.executable, "-c", program, line, ""],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
        check=True,
    )
    code, *modules = done.stderr.split()
    assert (code, done.stdout) == ("0", "")
    assert not {"jinja2", "numpy", "pyarrow", "pydantic", "rich", "ruamel", "scipy"} & {*modules}


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shells_complete_with_the_printed_script(shell, tmp_path):
    """The completion of each installed shell: a word, a file, a folder as the value of an option."""
    program = shutil.which(shell)
    script = (resource_folder("templates") / "completion" / f"simspec.{shell}").read_text(encoding="utf-8")
    if program is None:
        pytest.skip(f"{shell} is not installed")
    if shell == "zsh":  # its completion needs a terminal
        done = subprocess.run([program, "-n", "-c", script], capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return
    (tmp_path / "arm.yaml").touch()
    (tmp_path / "arm.txt").touch()
    (tmp_path / "results").mkdir()
    (tmp_path / "simspec").write_text(f'#!/bin/sh\nexec {sys.executable} -m simspec "$@"\n')
    (tmp_path / "simspec").chmod(0o755)
    lines = {"simspec schema --of fig": "figures", "simspec run ar": "arm.yaml", "simspec run x --out=res": "results"}
    if shell == "bash":
        ends = [
            f"COMP_LINE='{line}' COMP_POINT={len(line)}; _simspec simspec {line.replace('=', ' ').split()[-1]}; "
            'echo "${COMPREPLY[*]}"'
            for line in lines
        ]
    else:
        ends = [f"complete -C '{line}'" for line in lines]
    environment = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        [program, "-c", "\n".join([script, *ends])],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
        check=True,
    )
    found = [line.partition("=")[2] or line for line in done.stdout.replace("/", "").splitlines()]
    assert found == list(lines.values()), done.stderr


def test_the_script_as_json(capsys):
    assert cli.main(["completion", "bash", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["shell"] == "bash"
    assert found["script"].endswith("complete -F _simspec simspec\n")
