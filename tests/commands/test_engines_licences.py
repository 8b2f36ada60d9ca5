"""``simspec engines install`` of engines with licence terms: nothing is downloaded or made before the user accepts them; and of
engines whose requirements exclude each other, or those of simspec."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from simspec import cli
from simspec.commands import install as installing
from simspec.engines.drake.engine import Drake
from simspec.engines.kit import registry
from simspec.engines.kit.contract import LicenceTerms
from simspec.engines.kit.environments import environments
from simspec.engines.kit.registry import EngineId
from simspec.errors import EngineError
from simspec.outputs import files
from tests.files import program, write
from tests.wheels import use_alone, write_wheel

TERMS = LicenceTerms("Acme Licence 3", "Acme's engine", ("https://acme.example/3", "https://acme.example/3/annex"))
WORDS = "acme: licence terms of Acme's engine: Acme Licence 3, https://acme.example/3, https://acme.example/3/annex"
REFUSED = "licence not accepted: Acme Licence 3"
WAY = "simspec engines install acme --yes --accept-licence acme"

PYTHON = """#!/bin/sh
echo "$@" >> {log}
if [ "$3" = venv ]; then mkdir -p "$4/bin" && cp "$0" "$4/bin/python"; exit; fi
if [ "$3" = -c ]; then echo '{{"version": "1.2.5", "numpy": "2.0"}}'; fi
"""


def add(monkeypatch, **more) -> type:
    """Make an engine known: a plug-in with an environment of its own."""
    words = {"NAME": "acme", "TITLE": "Acme", "DISTRIBUTION": "acme-engine", "EXTRA": "", "SEPARATE_VERSION": "1.2"}
    engine = type("Acme", (Drake,), {**words, "ALONGSIDE": (), "LICENCES": (TERMS,), **more})
    monkeypatch.setitem(registry.engines()._loaded, engine.NAME, engine)
    return engine


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The folder of environments, and the engine."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    add(monkeypatch)
    return tmp_path / "data" / "simspec" / "engines"


@pytest.fixture
def calls(place, tmp_path, monkeypatch):
    """A stub interpreter, and a function that returns its calls that install something."""
    log = tmp_path / "log"
    monkeypatch.setattr(sys, "executable", str(program(tmp_path / "python", PYTHON.format(log=log))))
    return lambda: [line for line in log.read_text().splitlines() if "-m" in line] if log.exists() else []


def answer(capsys, *words: str, code: int = 0):
    assert cli.main(["engines", "install", *words, "--json"]) == code
    return json.loads(capsys.readouterr().out)["engines"]


def on_terminal(monkeypatch, typed: str, *words: str) -> tuple[int, str]:
    """The exit code and the output of a command on a terminal, into which ``typed`` is typed."""
    outside, inside = pty.openpty()
    os.write(outside, typed.encode())
    with monkeypatch.context() as patch, os.fdopen(inside, "r") as source, os.fdopen(os.dup(inside), "w") as sink:
        patch.setattr(sys, "stdin", source)
        patch.setattr(sys, "stdout", sink)
        code = cli.main(["engines", "install", *words])
    said = read_until(outside, None)
    os.close(outside)
    return code, said


def read_until(terminal: int, words: str | None) -> str:
    """The output on a terminal until ``words``, or to its end."""
    said = ""
    while words is None or words not in said:
        try:
            block = os.read(terminal, 4096)
        except OSError:  # EIO: no process has it open any more
            break
        said += block.decode()
    return said


def test_the_terms_are_printed_before_the_commands(place, calls, capsys):
    assert cli.main(["engines", "install", "acme"]) == 0
    terms, offer, *commands = capsys.readouterr().out.splitlines()
    assert terms == WORDS
    assert offer.endswith("--accept-licence acme gives it")
    assert [line.partition(" -m ")[2].split()[0] for line in commands] == ["venv", "pip"]
    row = answer(capsys, "acme")["acme"]
    assert row["licences"] == [
        {"name": TERMS.name, "covers": TERMS.covers, "addresses": [*TERMS.addresses]},
    ]
    assert row["problem"] is None
    assert calls() == []


def test_yes_alone_is_not_consent(place, calls, capsys):
    assert cli.main(["engines", "install", "acme", "--yes"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == WORDS
    assert lines[-1] == f"acme@1.2: {REFUSED} (there is no terminal for the prompt); {WAY}"
    assert calls() == []
    assert not place.exists()


@pytest.mark.parametrize("typed", ["acme\n", " acme \n"])
def test_the_name_typed_on_a_terminal_is_consent(place, calls, monkeypatch, typed):
    code, said = on_terminal(monkeypatch, typed, "acme", "--yes")
    assert code == 0
    assert said.index(WORDS) < said.index("type acme") < said.index(" -m venv ")
    assert "is installed in" in said
    assert len(calls()) == 2
    # an environment that is whole is not installed again
    code, said = on_terminal(monkeypatch, "no\n", "acme", "--yes")
    assert code == 0
    assert "is installed in" in said
    assert "licence" not in said
    assert len(calls()) == 2


@pytest.mark.parametrize("typed", ["\n", "yes\n", "y\n", "Acme\n", "acme please\n", "\x04"])
def test_another_answer_installs_nothing(place, calls, monkeypatch, typed):
    code, said = on_terminal(monkeypatch, typed, "acme", "--yes")
    assert code == 3
    assert f"{REFUSED} (the answer was not acme); {WAY}" in said
    assert calls() == []
    assert not place.exists()


def test_json_never_prompts(place, calls, monkeypatch):
    code, said = on_terminal(monkeypatch, "acme\n", "acme", "--yes", "--json")
    assert code == 3
    assert f"{REFUSED} (--json does not prompt); {WAY}" in said
    assert calls() == []


def test_without_a_terminal_to_read_from_or_to_write_to_there_is_no_prompt(place, calls, monkeypatch, tmp_path, capsys):
    refused = f"{REFUSED} (there is no terminal for the prompt); {WAY}"
    (tmp_path / "answers").write_text("acme\n")
    with (tmp_path / "answers").open() as answers:
        outside, inside = pty.openpty()
        with os.fdopen(inside, "w") as sink, monkeypatch.context() as patch:
            patch.setattr(sys, "stdin", answers)
            patch.setattr(sys, "stdout", sink)
            assert cli.main(["engines", "install", "acme", "--yes"]) == 3
        assert refused in read_until(outside, None)
        os.close(outside)
    outside, inside = pty.openpty()
    os.write(outside, b"acme\n")
    with os.fdopen(inside, "r") as source:
        monkeypatch.setattr(sys, "stdin", source)
        assert cli.main(["engines", "install", "acme", "--yes"]) == 3
    os.close(outside)
    assert refused in capsys.readouterr().out
    monkeypatch.setattr(sys, "stdin", None)  # Python's for a closed one
    assert cli.main(["engines", "install", "acme", "--yes"]) == 3
    assert refused in capsys.readouterr().out
    assert calls() == []


def test_the_option_is_consent(place, calls, capsys):
    row = answer(capsys, "acme", "--yes", "--accept-licence", "acme")["acme"]
    assert (row["state"], row["version"], row["problem"]) == ("installed", "1.2.5", None)
    assert [words.split()[2] for words in calls()] == ["venv", "pip"]
    again = answer(capsys, "acme", "--yes")["acme"]
    assert (again["state"], again["commands"]) == ("installed", [])
    assert [*environments()] == ["acme@1.2", "acme"]
    other = answer(capsys, "acme@1.3", "--yes", code=3)["acme@1.3"]  # consent is for this command alone
    assert other["problem"].startswith(REFUSED)
    assert [path.name for path in place.iterdir()] == ["acme@1.2"]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("acme mjx --yes --accept-licence mjx", "mjx has no licence terms to accept"),
        ("mjx --yes --accept-licence acme", "acme is not among the engines to install"),
        ("acme --yes --accept-licence acme --accept-licence nothing", "nothing is not among"),
        ("acme --yes --accept-licence acme@1.2", "acme@1.2 is not among"),
        ("acme --accept-licence acme", "nothing is installed without --yes"),
    ],
)
def test_the_option_for_another_engine_is_an_error_of_the_command_line(place, calls, capsys, words, why):
    assert cli.main(["engines", "install", *words.split()]) == 2
    said = capsys.readouterr().err
    assert why in said
    assert "error[C109]" in said
    assert calls() == []
    assert not place.exists()


def test_all_installs_the_others_and_names_those_that_are_not_accepted(place, calls, capsys, monkeypatch):
    add(monkeypatch, NAME="bolt", DISTRIBUTION="bolt")
    monkeypatch.setattr(installing, "registry_engines", lambda: ["acme", "bolt", "mjx"])
    monkeypatch.setattr(registry.find_engine("mjx"), "SEPARATE_VERSION", "1.2")
    rows = answer(capsys, "--all", "--yes", "--accept-licence", "bolt", code=3)
    assert {name: row["state"] for name, row in rows.items()} == {
        "acme": "not installed",
        "bolt": "installed",
        "mjx": "installed",
    }
    assert rows["acme"]["problem"] == f"{REFUSED} (--json does not prompt); {WAY}"
    assert rows["bolt"]["problem"] is rows["mjx"]["problem"] is None
    assert sorted(path.name for path in place.iterdir()) == ["bolt@1.2", "mjx@1.2"]


def test_every_prompt_comes_before_the_first_command(place, calls, monkeypatch):
    add(monkeypatch, NAME="bolt", DISTRIBUTION="bolt")
    code, said = on_terminal(monkeypatch, "acme\nbolt\n", "mjx@1.2", "acme", "bolt", "bolt@1.2", "--yes")
    assert code == 0
    assert said.index("type bolt") < said.index(" -m venv ")
    assert said.count("type bolt") == 1
    assert on_terminal(monkeypatch, "no\nacme\n", "acme@1.3", "acme@1.4", "--yes")[0] == 3
    assert sorted(path.name for path in place.iterdir()) == ["acme@1.2", "bolt@1.2", "mjx@1.2"]


def test_an_engine_of_this_interpreter_with_terms_needs_consent_too(place, calls, capsys, monkeypatch):
    engine = add(monkeypatch, NAME="bolt", DISTRIBUTION="bolt", EXTRA="bolt", SEPARATE_VERSION="")
    row = answer(capsys, "bolt", "--yes", code=3)["bolt"]
    assert row["problem"].startswith(REFUSED)
    assert [command["ran"] for command in row["commands"]] == [False]
    assert calls() == []
    row = answer(capsys, "bolt", "--yes", "--accept-licence", "bolt", code=3)["bolt"]  # the stub installs nothing
    assert row["commands"][0]["ran"]
    assert len(calls()) == 1
    monkeypatch.setattr(engine, "version", classmethod(lambda cls: "1.2"))
    assert cli.main(["engines", "install", "bolt", "--yes"]) == 0
    assert capsys.readouterr().out == "bolt: 1.2 is installed\n"


@pytest.mark.parametrize("yes", [False, True])
def test_versions_that_other_commands_install_need_consent_too(place, calls, yes):
    label = EngineId("acme", "1.2")
    with pytest.raises(
        EngineError, match=f"acme@1.2: not installed: {REFUSED}; .* acme@1.2 --yes --accept-licence acme$"
    ):
        installing.installed_version(label, yes)
    assert calls() == []
    assert not place.exists()
    assert cli.main(["engines", "install", "acme@1.2", "--yes", "--accept-licence", "acme"]) == 0
    assert installing.installed_version(label, yes) == str(place / "acme@1.2" / "bin" / "python")


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("", "Acme", ("https://acme.example",)), ValueError),
        (("Acme Licence", " ", ("https://acme.example",)), ValueError),
        (("Acme Licence", "Acme", ()), ValueError),
        (("Acme Licence", "Acme", ("https://acme.example", "acme.example")), ValueError),
        (("Acme Licence", "Acme", "https://acme.example"), TypeError),
    ],
)
def test_terms_have_a_name_and_addresses(words, error):
    with pytest.raises(error):
        LicenceTerms(*words)


@pytest.mark.parametrize("declared", [TERMS, [TERMS], ("Acme Licence 3",)])
def test_a_declaration_that_would_not_be_seen_is_an_error(monkeypatch, declared):
    with pytest.raises(TypeError, match="expected a tuple of LicenceTerms"):
        add(monkeypatch, LICENCES=declared)


# --- packages that exclude each other ------------------------------------------------------------------------------------


@pytest.fixture
def wheels(tmp_path, monkeypatch):
    """A folder of wheels, the only source of packages: the engine needs an older ``packaging`` than simspec does."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    use_alone(folder, monkeypatch.setenv)
    for name, version in (("packaging", "23.2"), ("packaging", "26.0"), ("numpy", "2.0"), ("pin", "4.1.5")):
        write_wheel(folder, name, version)
    write_wheel(folder, "acme_engine", "1.2.5", "packaging<24")
    return folder


INTERPRETER = """#!/bin/sh
if [ "$3" = venv ]; then {python} -I -m venv --without-pip "$4" && ln -s {pip} "$4"/lib/python*/site-packages/; exit; fi
exec {python} "$@"
"""


@pytest.fixture
def interpreter(tmp_path) -> str:
    """This interpreter, whose environments have its pip: installing pip anew takes most of the time."""
    spec = importlib.util.find_spec("pip")
    assert spec is not None
    assert spec.origin is not None
    pip = Path(spec.origin).parent
    return str(program(tmp_path / "interpreter", INTERPRETER.format(python=sys.executable, pip=pip)))


COMMAND = """
import sys
from simspec.cli import main
sys.executable = sys.argv[1]
sys.exit(main(sys.argv[2:]))
"""
PLUGIN = """
from simspec.engines.drake.engine import Drake
from simspec.engines.kit.contract import LicenceTerms

class Acme(Drake):
    NAME, TITLE, DISTRIBUTION, EXTRA, SEPARATE_VERSION, ALONGSIDE = "acme", "Acme", "acme-engine", "", "1.2", ()
    LICENCES = (LicenceTerms("Acme Licence 3", "Acme's engine", ("https://acme.example/3", "https://acme.example/3/annex")),)
"""


def test_a_plug_in_is_installed_once_the_user_of_a_terminal_has_seen_its_terms(wheels, interpreter, tmp_path):
    """With pip: the engine's requirements exclude those of simspec, and each keeps its own."""
    about = "acme_plugin-1.0.dist-info"
    plugin = {
        "acme_plugin.py": PLUGIN,
        f"{about}/METADATA": "Metadata-Version: 2.1\nName: acme_plugin\nVersion: 1.0\n",
        f"{about}/entry_points.txt": "[simspec.engines]\nacme = acme_plugin:Acme\n",
    }
    (tmp_path / "plugin").mkdir()
    write(plugin, tmp_path / "plugin")
    data = tmp_path / "data"
    command = {
        "args": [sys.executable, "-c", COMMAND, interpreter, "engines", "install", "acme", "--yes"],
        "env": {**os.environ, "XDG_DATA_HOME": str(data), "PYTHONPATH": str(tmp_path / "plugin")},
        "stderr": subprocess.PIPE,
    }
    outside, inside = pty.openpty()
    with subprocess.Popen(**command, stdin=inside, stdout=inside) as process:
        os.close(inside)
        said = read_until(outside, "type acme")
        assert WORDS in said
        assert not data.exists()
        os.write(outside, b"acme\n")
        said = read_until(outside, None)
        _, errors = process.communicate()
    os.close(outside)
    assert process.returncode == 0, errors
    python = data / "simspec" / "engines" / "acme@1.2" / "bin" / "python"
    assert f"acme@1.2: 1.2.5 is installed in {python.parents[1]}" in said
    version = "import importlib.metadata; print(importlib.metadata.version('packaging'))"
    there = subprocess.run([python, "-I", "-c", version], capture_output=True, text=True, check=True).stdout.strip()
    assert there == "23.2"
    assert importlib.metadata.version("packaging") not in ("23.2", "26.0")
    again = subprocess.run(**{**command, "stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE}, check=True)
    assert again.stdout.decode() == f"acme@1.2: 1.2.5 is installed in {python.parents[1]}\n"


def test_packages_that_exclude_each_other_are_named_and_nothing_half_installed_is_used(
    wheels, interpreter, place, monkeypatch, capsys
):
    monkeypatch.setattr(sys, "executable", interpreter)
    add(monkeypatch, LICENCES=(), ALONGSIDE=("acme-laws",))
    write_wheel(wheels, "acme_laws", "1.0", "packaging>=25")
    row = answer(capsys, "acme", "--yes", code=3)["acme"]
    causes = "packages conflict: acme-engine 1.2.5 depends on packaging<24; acme-laws 1.0 depends on packaging>=25"
    assert row["problem"] == f"{row['commands'][1]['words']}: ended with code 1: {causes}"
    assert (row["state"], [command["code"] for command in row["commands"]]) == ("not installed", [0, 1])
    assert files.is_complete(place / "acme@1.2") is False
    assert environments() == {}
    with pytest.raises(EngineError, match=f"cannot be installed: .*{causes}"):
        installing.installed_version(EngineId("acme", "1.2"), True)

    (place / "acme@1.2" / "left").write_text("")
    write_wheel(wheels, "acme_laws", "1.1", "packaging>=20")
    row = answer(capsys, "acme", "--yes")["acme"]
    assert (row["state"], row["version"]) == ("installed", "1.2.5")
    assert not (place / "acme@1.2" / "left").exists()


STUB = """#!/bin/sh
echo "$(date +%Y-%m-%dT%H:%M:%S),123 {first}" >> "$PIP_LOG"
cat {log} >> "$PIP_LOG"
exit 1
"""
CONFLICT = """2026-11-29T18:21:02,857 ERROR: Cannot install a because these package versions have conflicting dependencies.
2026-11-29T18:21:02,857
2026-11-29T18:21:02,857 The conflict is caused by:
2026-11-29T18:21:02,857     The user requested packaging<24
2026-11-29T18:21:02,857     bolt 1.0 depends on packaging>=25\x1b[31m
2026-11-29T18:21:02,857
2026-11-29T18:21:02,857 To fix this you could try to:
2026-11-29T18:21:02,858 ERROR: ResolutionImpossible: for help visit https://pip.example
Traceback (most recent call last):
"""
CAUSES = r"packages conflict: The user requested packaging<24; bolt 1.0 depends on packaging>=25\x1b[31m"
ABSENT = "2026-11-29T18:21:02,857 ERROR: No matching distribution found for bolt\n"


@pytest.mark.parametrize("users", [False, True])
@pytest.mark.parametrize(
    ("log", "said"),
    [
        (CONFLICT, f": {CAUSES}; simspec engines install bolt@VERSION --yes uses a separate environment"),
        (ABSENT, ": ERROR: No matching distribution found for bolt"),
        ("2026-11-29T18:21:02,857 Collecting bolt\n", ""),
    ],
)
def test_a_failure_of_pip_in_this_interpreter_has_its_reason(place, tmp_path, monkeypatch, capsys, log, said, users):
    """pip's log is read, of which the user may have one (``PIP_LOG``) with other commands before."""
    add(monkeypatch, NAME="bolt", DISTRIBUTION="bolt", EXTRA="bolt", SEPARATE_VERSION="", LICENCES=())
    if users:
        (tmp_path / "users.log").write_text(CONFLICT.replace("bolt", "other"))
        monkeypatch.setenv("PIP_LOG", str(tmp_path / "users.log"))
    (tmp_path / "log").write_text(log)
    stub = STUB.format(first="Using pip", log=tmp_path / "log")
    monkeypatch.setattr(sys, "executable", str(program(tmp_path / "python", stub)))
    row = answer(capsys, "bolt", "--yes", code=3)["bolt"]
    assert row["problem"] == f"{row['commands'][0]['words']}: ended with code 1{said}"


def test_a_log_that_is_no_file_is_not_read(place, tmp_path, monkeypatch, capsys):
    """The user may have given pip a pipe: reading it would wait for ever."""
    add(monkeypatch, NAME="bolt", DISTRIBUTION="bolt", EXTRA="bolt", SEPARATE_VERSION="", LICENCES=())
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setenv("PIP_LOG", str(tmp_path / "pipe"))
    monkeypatch.setattr(sys, "executable", str(program(tmp_path / "python", "#!/bin/sh\nexit 1\n")))
    row = answer(capsys, "bolt", "--yes", code=3)["bolt"]
    assert row["problem"].endswith("ended with code 1")
