"""``simspec schema``: write a JSON Schema of specs, studies, the project file, or the files between simspec and engines."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path

from simspec import project
from simspec.commands.generated_file import generated_file
from simspec.engines.kit import published
from simspec.errors import EXIT_OK
from simspec.language import schema as language_schema

FILES = {
    name: f"{'simspec' if name == 'language' else name}.schema.json"
    for name in (*language_schema.LANGUAGES, "project", *published.SCHEMAS)
}
"""The file of each schema, below ``schema/``."""


def schema(of: str, out: Path | None, check: bool, as_json: bool) -> int:
    """Write the JSON Schema called ``of`` to ``out`` (default: below ``schema/``; ``-``: standard output)."""
    ours: Callable[[bytes], bool]
    if of in language_schema.LANGUAGES:
        wanted, ours = language_schema.schema_text(of), functools.partial(language_schema.is_schema, of=of)
    elif of == "project":
        wanted, ours = project.schema_text(), project.is_schema
    else:
        wanted, ours = published.schema_text(of), functools.partial(published.is_schema, of)
    if out is not None and str(out) == "-":
        sys.stdout.write(wanted)
        return EXIT_OK
    path = out if out is not None else Path("schema") / FILES[of]
    return generated_file(
        path, wanted, ours, check, as_json, "simspec schema" if of == "language" else f"simspec schema --of {of}"
    )
