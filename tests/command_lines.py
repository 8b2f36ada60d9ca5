"""Command lines in files of shell commands: whether the command line of simspec takes them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator

import typer

from simspec import cli

VALUES = {'"${engines[@]}"': "ENGINE", '"${engines[@]/#/--engine=}"': "--engine=ENGINE", '"${arguments[@]}"': "--quick"}
"""Arrays of the scripts, and words in place of them."""

FALL = """\
simspec: 1
name: fall

physics: {timestep: 1 ms, duration: 20 ms}

bodies:
  ball:
    pose: {xyz: [0, 0, 1]}
    mass: 1
    inertia: {principal: [0.01, 0.01, 0.01]}

record: {every: 10 ms}

expect:
  - displacement: {body: ball, xyz: [0, 0, -0.00206], tolerance: 0.1 mm}
"""
"""A spec that the steps of CI run."""


def commands(script: str) -> Iterator[str]:
    """The commands of simspec in a script, with values in place of variables."""
    for line in script.replace("\\\n", " ").splitlines():
        found = re.match(r"\s*(simspec .*?)(?: \|\| .*)?$", line)
        if found is not None:
            text = found[1]
            for variable, value in VALUES.items():
                text = text.replace(variable, value)
            yield re.sub(r"\$\w+", "value", text.replace("$ENGINES", "--engine ENGINE"))


def parse(command: str) -> None:
    """Parse a command line without calling it. Raises an error of the parser for an unknown command, option or argument."""
    _, *words = shlex.split(command)
    group = typer.main.get_command(cli.app)
    context = group.make_context("simspec", list(words))
    while words and hasattr(group, "commands"):
        group = group.commands[words[0]]
        words = words[1:]
        context = group.make_context(group.name, list(words), parent=context)
