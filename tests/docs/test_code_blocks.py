"""Code of the documentation: specs are valid, commands and options exist, Python compiles and uses names that exist."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import shlex
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from ruamel.yaml import YAML

import simspec
from simspec import cli
from tests.docs.blocks import INLINE, PAGES, ROOT, all_blocks, commands

COMMAND = typer.main.get_command(cli.app)
(USAGE,) = typer.BadParameter.__bases__
"""Errors of the command line, of which typer has a class of its own."""
ELSEWHERE = {
    "docs/reference/language.md": "tests/language/test_reference.py",
    "docs/guide/import.md": "tests/imports/test_page.py and test_panda.py",
}
"""Pages whose specs have other files next to them: the tests that load these specs."""


def wrong(command: str, inline: bool = False) -> str | None:
    """The reason for which the command line refuses the names of commands and options; None where it takes them."""
    try:
        words = shlex.split(re.sub(r"[\[\]…]|\.\.\.", " ", command))[1:]
        here: Any = COMMAND
        context = here.context_class(here, info_name="simspec")
        while words and hasattr(here, "commands"):
            if words[0].startswith("-"):
                break
            found = here.get_command(context, words[0])
            if found is None:
                return f"no command {words[0]!r}"
            here, context, words = found, found.context_class(found, info_name=words[0], parent=context), words[1:]
        here.make_parser(context).parse_args(list(words))
    except (USAGE, ValueError) as error:
        reason = str(getattr(error, "message", error))
        # a sentence may name an option without its value
        return None if inline and reason.endswith("requires an argument.") else reason
    return None


def shell_commands() -> Iterator[tuple[str, str, bool]]:
    for block in all_blocks("", "sh", "bash", "console"):
        for command in commands(block.text):
            yield block.place, command, False
    for page in PAGES:
        for found in INLINE.finditer(page.read_text(encoding="utf-8")):
            yield page.relative_to(ROOT).as_posix(), " ".join(found[1].split()), True


def test_commands_and_options_of_the_pages_exist():
    found = list(shell_commands())
    assert len(found) > 200
    assert not [
        f"{place}: {command}: {reason}" for place, command, inline in found if (reason := wrong(command, inline))
    ]


@pytest.mark.parametrize("command", ["simspec rum SPEC", "simspec run SPEC --qick", "simspec engines instal mjx"])
def test_a_command_or_option_that_does_not_exist_is_found(command):
    assert wrong(command)
    assert wrong("simspec run SPEC [--quick] --engine NAME") is None


YAML_BLOCKS = all_blocks("yaml")
SPECS = [
    block
    for block in YAML_BLOCKS
    if re.search(r"(?m)^simspec: ", block.text) and block.place.partition(":")[0] not in ELSEWHERE
]


@pytest.mark.parametrize("block", SPECS, ids=lambda block: block.place)
def test_a_spec_of_a_page_is_valid(block, tmp_path, monkeypatch):
    """A block with the key ``simspec`` is a spec; any other is a fragment of one."""
    monkeypatch.chdir(ROOT)
    path = tmp_path / "page.yaml"
    path.write_text(block.text.replace("../specs", str(ROOT / "specs")), encoding="utf-8")
    simspec.load(path).resolve()


def test_fragments_are_yaml():
    assert len(YAML_BLOCKS) > len(SPECS)
    for block in YAML_BLOCKS:
        YAML(typ="safe").load(block.text)


def exists(module: str, name: str) -> bool:
    """Whether a module has a name, or a module of that name."""
    found = importlib.import_module(module)
    return hasattr(found, name) or f"{module}.{name}" in {
        part.name for part in pkgutil.iter_modules(getattr(found, "__path__", ()), f"{module}.")
    }


def missing_names(code: str) -> list[str]:
    """Names of simspec that a piece of Python uses and that do not exist."""
    used = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == "simspec":
            used += [(node.module, alias.name) for alias in node.names]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "simspec":
            used.append(("simspec", node.attr))
    return [f"{module}.{name}" for module, name in used if not exists(module, name)]


def test_python_of_the_pages_compiles_and_its_names_exist():
    found = all_blocks("python")
    assert found
    assert not [f"{block.place}: {names}" for block in found if (names := missing_names(block.text))]
    code = "import simspec\nsimspec.lod('x')\nfrom simspec.errors import Nothing, SpecError"
    assert sorted(missing_names(code)) == ["simspec.errors.Nothing", "simspec.lod"]
