"""The help of a command: options under headings, in the order in which a user meets them."""

from __future__ import annotations

import re
from typing import Any, Final

from typer.core import TyperArgument, TyperCommand, TyperGroup

GROUPS: Final = {
    "Engines": "engine all_engines every_engine without python keep_going deadline",
    "Model": "sets others accept strict",
    "Robot files": "repair package package_path arg self_collision allow_outside",
    "Measurements": "quick repeats no_cache no_verify tolerance",
    "CI": "fail_on_diff baseline write_baseline timed_runs junit annotations summary github",
    "Output": "out store csv html report verbose quiet as_json help",
}
"""Fields of options by the heading under which a long help lists them; all others stand under "Options", which come first."""
COMMAND_GROUPS: Final = {
    "Write and check specs": "new init import check list fmt accept schema",
    "Compile and prove": "compile export verify",
    "Run": "run sweep study bisect",
    "Look and compare": "view explain diff report audit pages",
    "Set up and explain": "engines trust completion help",
}
"""All commands, by the heading under which ``simspec --help`` lists them."""
FEW: Final = 12
"""Options up to which a help has no headings."""
_AT_LEAST = re.compile(r"x>=([0-9.]+)")
_BETWEEN = re.compile(r"([0-9.]+)<=x<=([0-9.]+)")
_WHOLE = re.compile(r"\b([0-9]+)\.0\b(?=[;\]])")


class HelpCommand(TyperCommand):
    """A command whose help has headings; arguments have their names alone, without types."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """The words of the usage line."""
        return ["[OPTIONS]", *(usage_name(parameter) for parameter in _arguments(self.get_params(ctx)))]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then options under their headings."""
        parameters = self.get_params(ctx)
        if arguments := [
            (usage_name(argument).strip("[]."), argument.help or "") for argument in _arguments(parameters)
        ]:
            with formatter.section("Arguments"):
                formatter.write_dl(arguments)
        records = {
            parameter.name: (record[0], _plain_range(record[1]))
            for parameter in parameters
            if not isinstance(parameter, TyperArgument) and (record := parameter.get_help_record(ctx)) is not None
        }
        headings = {name: title for title, names in GROUPS.items() for name in names.split()}
        sections: dict[str, list[tuple[str, str]]] = {"Options": [], **{title: [] for title in GROUPS}}
        for name, record in records.items():
            sections[headings.get(name, "Options") if len(records) > FEW else "Options"].append(record)
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


class HelpGroup(TyperGroup):
    """The command ``simspec``, whose help lists its commands under headings."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands."""
        known = {name: command for name in self.list_commands(ctx) if (command := self.get_command(ctx, name))}
        for title, names in COMMAND_GROUPS.items():
            rows = [
                (name, known[name].get_short_help_str(formatter.width * 3)) for name in names.split() if name in known
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl([(name.ljust(max(map(len, known))), text) for name, text in rows])


def _arguments(parameters: list[Any]) -> list[TyperArgument]:
    return [parameter for parameter in parameters if isinstance(parameter, TyperArgument)]


def usage_name(argument: TyperArgument) -> str:
    """An argument in a usage line: its metavar, in brackets where it may be left out."""
    name = argument.metavar or str(argument.name).upper()
    return name if argument.required or name.startswith("[") else f"[{name}]"


def _plain_range(text: str) -> str:
    """The help of an option with the range of its number in words."""
    text = _BETWEEN.sub(r"\1 to \2", _AT_LEAST.sub(r"at least \1", text))
    return _WHOLE.sub(r"\1", text)
