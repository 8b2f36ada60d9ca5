"""``simspec fmt``: give specs their canonical layout, or see which lack it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.language.document import LARGEST_FILE, decode
from simspec.language.foreign import is_foreign
from simspec.language.formatting import format_text
from simspec.outputs.reading import read_bytes
from simspec.outputs.targets import check_file
from simspec.outputs.writing import write_file
from simspec.report.plain import text
from simspec.report.screen import say


def fmt(files: Sequence[Path], check: bool, as_json: bool) -> int:
    """Lay out every file, or say which would change; nothing is written when one of them is no spec."""
    problems: list[Problem] = []
    results: list[tuple[Path, bytes, str]] = []
    for path in files:
        if is_foreign(path.name):
            problems.append(Problem(f"{path} is no spec", hint=f"simspec import {path} -o {path.stem}.yaml"))
            continue
        try:
            before = read_bytes(path, LARGEST_FILE)
            after = format_text(decode(before, str(path)), str(path))
            if not check and before != after.encode():
                check_file(path, before.__eq__)
        except FileNotFoundError:
            problems.append(Problem(f"{path}: no such file"))
        except SpecError as error:
            problems.extend(error.problems)
        else:
            results.append((path, before, after))
    if problems:
        raise SpecError(problems)
    changed = [path for path, before, after in results if before != after.encode()]
    if not check:
        for path, before, after in results:
            if before != after.encode():
                write_file(path, after, before.__eq__)  # only over the very text that was laid out
    if as_json:
        sys.stdout.write(text({"changed": changed, "written": not check}))
    else:
        for path in changed:
            say(f"{path}: {'would change; simspec fmt writes it' if check else 'written'}")
    return EXIT_FAILED if check and changed else EXIT_OK
