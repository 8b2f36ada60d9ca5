"""``simspec engines``: list the engines and what each supports, or write that as a page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from simspec.arguments import print_json
from simspec.commands.generated_file import generated_files
from simspec.engines.kit.installed import instances
from simspec.errors import EXIT_OK
from simspec.outputs.targets import check_file
from simspec.project import load_project
from simspec.report import engine_pages, matrix
from simspec.report.screen import console, say
from simspec.report.terminal import engine_tables


def engines(markdown: bool, out: Path, check: bool, as_json: bool) -> int:
    """Print the engines, or write the support matrix to ``out``, and the page of each engine beside it."""
    if markdown:
        pages: dict[Path, tuple[Callable[[], str], Callable[[bytes], bool]]] = {
            out: (matrix.markdown, matrix.is_matrix),
            out.parent / engine_pages.PAGE: (lambda: engine_pages.markdown(Path()), engine_pages.is_page),
        }
        for path, (_, ours) in pages.items() if not check else ():
            check_file(path, ours)
        files = {path: (made(), ours) for path, (made, ours) in pages.items()}
        return generated_files(files, check, as_json, "simspec engines --markdown")
    data = matrix.engine_data()
    project = load_project()
    listed = project.listed_interpreters()
    rows = instances(listed, project.default_engines, listed.not_queried)
    if as_json:
        told = {"project": project.file, "project_trusted": project.not_trusted is None}
        print_json({"instances": rows, **told, "engines": data, "broken": matrix.broken()})
        return EXIT_OK
    for table in engine_tables(rows, data, console().width):
        console().print(table)
    for name, why in matrix.broken().items():
        say(f"{name}: {why}")
    return EXIT_OK
