"""The project file: found, read, checked; problems have their lines."""

from __future__ import annotations

import json
import os
import tomllib
from pathlib import Path

import jsonschema
import pytest

from simspec.errors import SpecError
from simspec.outputs import trust
from simspec.project import LARGEST, MOST_ENGINES, Project, find_project, load_project, read_project, schema_text

GOOD = """\
# engines of this project
default-engines = ["mujoco", "mujoco@3.8"]
package-paths = ["packages", "../shared"]
allowed-folders = ["../shared"]

[engines."mujoco@3.8"]
python = "envs/old/bin/python"

[engines.dart]
python = "/opt/dart/bin/python"
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with what GOOD names."""
    here = tmp_path / "project"
    (here / "packages").mkdir(parents=True)
    (tmp_path / "shared").mkdir()
    (here / "simspec.toml").write_text(GOOD)
    return here


def problems(folder: Path, text: str | bytes):
    """The problems of a project file with this content."""
    file = folder / "simspec.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SpecError) as raised:
        read_project(file)
    return raised.value.problems


def test_everything_is_relative_to_the_file(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert load_project(folder).not_trusted == "not trusted"
    trust.trust(folder / "simspec.toml", GOOD.encode())
    assert load_project(folder) == Project(
        folder / "simspec.toml",
        {"mujoco@3.8": str(folder / "envs/old/bin/python"), "dart": "/opt/dart/bin/python"},
        ("mujoco", "mujoco@3.8"),
        (folder / "packages", folder / "../shared"),
        (folder / "../shared",),
    )


def test_the_search_ends_at_the_root_of_the_repository(folder):
    below = folder / "a" / "b"
    below.mkdir(parents=True)
    assert find_project(below) == folder / "simspec.toml"
    (folder / ".git").mkdir()
    assert find_project(below) == folder / "simspec.toml", "the root of a repository has its project file"
    (folder / "a" / ".git").write_text("gitdir: elsewhere")
    assert find_project(below) is None
    assert load_project(below) == Project()


def test_the_nearest_file_wins(folder):
    below = folder / "a"
    below.mkdir()
    (below / "simspec.toml").write_text("")
    assert load_project(below) == Project(below / "simspec.toml")


@pytest.mark.parametrize(
    ("text", "line", "path", "words"),
    [
        ("\ndefault-engine = ['dart']", 2, "default-engine", "did you mean default-engines?"),
        ("[engines.dart]\npyhton = 'x'\npython = 'y'", 2, "engines.dart.pyhton", "did you mean python?"),
        ("[engines.dart]", 1, "engines.dart", "no option"),
        ("\n\n[engines.'dart@6']\npython = 3", 4, "engines.dart@6.python", "path of an interpreter"),
        ("[engines.dart]\npython = ''", 2, "engines.dart.python", "path of an interpreter"),
        ('[engines.dart]\npython = "a\\u0000b"', 2, "engines.dart.python", "path of an interpreter"),
        ("engines = ['dart']", 1, "engines", "default-engines"),
        ("engines = {dart = 'python'}", 1, "engines.dart", "expected a table"),
        ("[[engines]]\npython = 'x'", 1, "engines", "expected tables"),
        ("\n[engines.mujocco]\npython = 'x'", 2, "engines.mujocco", "did you mean mujoco?"),
        ("\n[engines.'dart@']\npython = 'x'", 2, "engines.dart@", "not an engine's label"),
        ("\n[engines.'dart=x']\npython = 'x'", 2, "engines.dart=x", "contains an interpreter"),
        ("[engines.mujoco.3.8]\npython = 'x'", 1, "engines.mujoco.3", "unknown key"),
        ("default-engines = 'dart'", 1, "default-engines", "list of strings"),
        ("default-engines = [1]", 1, "default-engines", "list of strings"),
        ("default-engines = []", 1, "default-engines", "empty list"),
        ("\ndefault-engines = [\n 'urdf',\n]", 2, "default-engines", "unknown engine 'urdf'"),
        ("package-paths = ['nowhere']", 1, "package-paths", "not a folder"),
        ("package-paths = ['simspec.toml']", 1, "package-paths", "not a folder"),
        ("allowed-folders = ['simspec.toml']", 1, "allowed-folders", "not a folder"),
        ("allowed-folders = '..'", 1, "allowed-folders", "list of strings"),
        ('x = """\npackage-paths = 1\n"""\npackage-paths = 2', 4, "package-paths", "list of strings"),
    ],
)
def test_problems_have_a_line_and_a_path(folder, text, line, path, words):
    entry = next(problem for problem in problems(folder, text) if problem.path == path)
    assert entry.location is not None
    assert (entry.location.file, entry.location.line) == (str(folder / "simspec.toml"), line)
    assert words in str(entry)


def test_all_problems_come_at_once(folder):
    text = "default-engines = 3\npackage-paths = 4\nother = 5\n[engines.nobody]\npython = 6"
    assert [problem.path for problem in problems(folder, text)] == [
        *("other", "engines.nobody", "engines.nobody.python", "default-engines", "package-paths")
    ]


def test_invalid_toml_is_reported_with_its_line(folder):
    (problem,) = problems(folder, "package-paths = []\ndefault-engines = [,]\n")
    assert problem.location is not None
    assert problem.location.line == 2
    assert "not TOML" in problem.message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"# " + b"x" * LARGEST, "more than the 64,000"),
        (b"\n" + b"a." * 1500 + b"a = 1", "a line of 3,005 characters"),
        (b"x = " + b"[" * 1900, "not TOML"),
        (b"# \xff", "not UTF-8"),
        (b"\n".join(b"[engines.'dart@%d']\npython='x'" % k for k in range(MOST_ENGINES + 1)), "33 engines"),
        (b"a" + b".a" * 900 + b" = {" + b"a." * 90 + b"a = 1}", "unknown key 'a'"),
    ],
    ids=["large", "long-line", "deep", "binary", "many", "dotted"],
)
def test_values_out_of_bounds_are_refused(folder, content, words):
    assert words in "\n".join(map(str, problems(folder, content)))


def _link(file: Path) -> None:
    file.symlink_to("elsewhere.toml")


@pytest.mark.parametrize(
    ("make", "words"), [(_link, "a symbolic link"), (os.mkfifo, "a FIFO"), (Path.mkdir, "a folder")]
)
def test_only_a_regular_file_is_read(tmp_path, make, words):
    (tmp_path / "elsewhere.toml").write_text("")
    make(tmp_path / "simspec.toml")
    with pytest.raises(SpecError, match=words):
        load_project(tmp_path)


def test_a_link_that_leads_nowhere_is_no_missing_file(tmp_path):
    (tmp_path / "simspec.toml").symlink_to("nowhere")
    with pytest.raises(SpecError, match="a symbolic link"):
        load_project(tmp_path)


def test_the_file_of_another_user_is_refused(folder, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 4321)
    true = os.lstat
    below = folder / "a"
    below.mkdir()

    def owned(path):
        found = list(true(path))
        found[4] = 1234
        return os.stat_result(found)

    load_project(below)  # of the owner of the working folder, or of root
    monkeypatch.setattr(os, "lstat", owned)
    with pytest.raises(SpecError, match="another user"):
        load_project(below)


def test_the_schema_says_the_same(folder):
    validator = jsonschema.Draft7Validator(json.loads(schema_text()))
    jsonschema.Draft7Validator.check_schema(validator.schema)
    assert list(validator.iter_errors(tomllib.loads(GOOD))) == []
    for text in ("x = 1", "default-engines = []", "engines = []", "[engines.dart]\npyhton = 'x'", "[engines.dart]"):
        assert list(validator.iter_errors(tomllib.loads(text))), text
    committed = Path(__file__).parents[1] / "schema" / "project.schema.json"
    assert committed.read_text(encoding="utf-8") == schema_text()
