"""Tables in Markdown."""

from __future__ import annotations

from simspec.report.page.sheets import Cell, Sheet
from simspec.report.page.words import BAD, WARNING

MARKS = {BAD: "**", WARNING: "*"}
"""Marks of Markdown by the tone of a cell: colours are lost there."""


def markdown(sheet: Sheet) -> str:
    """A table in Markdown, with its title above and its note below."""
    lines = [f"**{escaped(sheet.title)}**", ""]
    lines.append("| " + " | ".join(escaped(cell.text) for cell in sheet.head) + " |")
    lines.append("|" + "|".join("---:" if "right" in cell.classes else "---" for cell in sheet.head) + "|")
    lines += ["| " + " | ".join(_marked(cell) for cell in row) + " |" for row in sheet.rows]
    return "\n".join([*lines, *(["", escaped(sheet.note)] if sheet.note else []), ""])


def _marked(cell: Cell) -> str:
    """A cell's text: in bold what is bad, in italics what is to be known."""
    mark = next((mark for tone, mark in MARKS.items() if tone in cell.classes.split() and cell.text), "")
    return f"{mark}{escaped(cell.text)}{mark}"


def escaped(text: str) -> str:
    for character in "\\|<>`*_[]":
        text = text.replace(character, f"\\{character}")
    return text.replace("\n", " ")
