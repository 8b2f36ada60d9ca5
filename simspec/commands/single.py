"""``simspec export -o robot.SUFFIX``: one file, with the list of what it does not carry beside it.

The list names the hash of the file: a file that is there is replaced where it is the one that its list names, which simspec
wrote.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.formats.kit.text import json_text
from simspec.outputs.targets import LARGEST_OWN, demand, file_problem
from simspec.outputs.writing import write_file
from simspec.reading import NotReadableError, read_bytes
from simspec.report.plain import text
from simspec.report.screen import say

if TYPE_CHECKING:
    from simspec.commands.plain import Export
    from simspec.formats.kit.contract import Format

BESIDE: Final = ".losses.json"
"""What the name of the list adds to that of the file."""
DIGEST: Final = "file_sha256"


def write_single(
    export: Export,
    language: Format,
    path: Path,
    *,
    check: bool,
    as_json: bool,
    warnings: Sequence[Problem],
    show: Callable[[Export], None],
) -> int:
    """Write one file and its list, and ``show`` what is lost; with ``check``, see whether they are current. Raises SpecError
    where one may not be written."""
    content = language.single(export.plain, path.suffix.lower())
    beside = path.with_name(path.name + BESIDE)
    told = {**export.data(), DIGEST: hashlib.sha256(content).hexdigest()}
    files = {path: content, beside: json_text(told).encode()}
    if check:
        return _check(files, as_json)
    demand(
        [file_problem(path, _named_by(beside)), file_problem(beside, _is_list), _over_the_source(path, export.source)]
    )
    changed = any(_now(place) != wanted for place, wanted in files.items())
    if changed:
        write_file(path, content, _named_by(beside))
        write_file(beside, files[beside], _is_list)
    if as_json:
        names = sorted(place.name for place in files)
        row = {**export.data(), "folder": path.parent, "files": names, "changed": changed}
        sys.stdout.write(text({"plain": [row], "warnings": warnings}))
        return EXIT_OK
    say(f"{path}: {'written' if changed else 'already current'}")
    show(export)
    return EXIT_OK


def only_one(names: Sequence[str], path: Path) -> None:
    """Raise SpecError for several specs and one file."""
    if len(names) > 1:
        raise SpecError(
            [Problem(f"{path} is one file, and there are {len(names)} specs", hint="use a folder: --out DIR")]
        )


def _named_by(beside: Path) -> Callable[[bytes], bool]:
    def ours(content: bytes) -> bool:
        return _data(_now(beside)).get(DIGEST) == hashlib.sha256(content).hexdigest()

    return ours


def _is_list(content: bytes) -> bool:
    return {"schema", "format", "world_sha256", "losses", DIGEST} <= _data(content).keys()


def _data(content: bytes | None) -> dict[str, Any]:
    try:
        data = json.loads(content or b"{}")
    except (ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _now(path: Path) -> bytes | None:
    """What a file holds; None where there is none that can be read."""
    try:
        return read_bytes(path, LARGEST_OWN)
    except (OSError, NotReadableError):
        return None


def _over_the_source(path: Path, source: Path) -> Problem | None:
    same = path.exists() and source.exists() and path.samefile(source)
    return Problem(f"{path}: is the spec that is exported", hint="use a new file name") if same else None


def _check(files: dict[Path, bytes], as_json: bool) -> int:
    stale = [f"not current: {place}" for place, wanted in files.items() if _now(place) != wanted]
    if as_json:
        sys.stdout.write(text({"stale": stale}))
    for line in () if as_json else stale:
        say(line, error=True)
    if not as_json and not stale:
        say("the file is current")
    return EXIT_FAILED if stale else EXIT_OK
