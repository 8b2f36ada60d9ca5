"""Tables in Markdown."""

from __future__ import annotations

from simspec.report.page.sheets import Sheet


def markdown(sheet: Sheet) -> str:
    """A table in Markdown, with its title above and its note below."""
    lines = [f"**{escaped(sheet.title)}**", ""]
    lines.append("| " + " | ".join(escaped(cell.text) for cell in sheet.head) + " |")
    lines.append("|" + "|".join("---:" if "right" in cell.classes else "---" for cell in sheet.head) + "|")
    lines += ["| " + " | ".join(escaped(cell.text) for cell in row) + " |" for row in sheet.rows]
    return "\n".join([*lines, *(["", escaped(sheet.note)] if sheet.note else []), ""])


def escaped(text: str) -> str:
    for character in "\\|<>`*_[]":
        text = text.replace(character, f"\\{character}")
    return text.replace("\n", " ")
