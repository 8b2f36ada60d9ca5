"""``simspec schema``: write a JSON Schema of the language, or of the files between simspec and engines."""

from __future__ import annotations

import functools
import sys
from pathlib import Path

from simspec.commands.generated_file import generated_file
from simspec.engines.kit import published
from simspec.errors import EXIT_OK
from simspec.language import schema as language_schema


def schema(of: str, out: Path | None, check: bool, as_json: bool) -> int:
    """Write the JSON Schema called ``of`` to ``out`` (default: below ``schema/``; ``-``: standard output)."""
    language = of == "language"
    wanted = language_schema.schema_text() if language else published.schema_text(of)
    if out is not None and str(out) == "-":
        sys.stdout.write(wanted)
        return EXIT_OK
    path = out if out is not None else Path("schema") / f"{'simspec' if language else of}.schema.json"
    ours = language_schema.is_schema if language else functools.partial(published.is_schema, of)
    return generated_file(path, wanted, ours, check, as_json, "simspec schema" + ("" if language else f" --of {of}"))
