"""Tutorials as notebooks: Markdown that Jupytext reads, with the output of each cell in the page after it."""

from __future__ import annotations

import re

OUTPUT = re.compile(r"<!-- output(?P<kind>: varies)? -->\n```text\n(?P<text>.*?)```\n", re.DOTALL)
"""An output of the cell before it; one that varies is not compared when the tutorials run."""

HEADER = "---\njupyter:\n  kernelspec:\n    name: python3\n    language: python\n    display_name: Python 3\n---\n\n"
"""Without it, the language of most cells is that of the notebook."""


def notebook(page: str) -> str:
    """The text of the ``.ipynb`` file of a tutorial, with its outputs."""
    import jupytext
    import nbformat

    read = jupytext.reads(HEADER + page, fmt="md")
    cells = []
    for number, cell in enumerate(read.cells):
        cell["id"] = f"cell-{number}"  # the same at each build
        found = OUTPUT.match(cell.source + "\n") if cell.cell_type == "markdown" else None
        if found and cells and cells[-1].cell_type == "code":
            cells[-1].outputs = [nbformat.v4.new_output("stream", text=found["text"])]
            cell.source = OUTPUT.sub("", cell.source + "\n", count=1).strip()
            if not cell.source:
                continue
        cells.append(cell)
    read.cells = cells
    read.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    nbformat.validate(read)
    return nbformat.writes(read)
