"""One generated file: written, or looked at for being current."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from simspec.errors import EXIT_FAILED, EXIT_OK
from simspec.outputs.reading import read_bytes
from simspec.outputs.targets import LARGEST_OWN, check_file
from simspec.outputs.writing import write_file
from simspec.report.plain import text
from simspec.report.screen import say


def generated_file(path: Path, wanted: str, ours: Callable[[bytes], bool], check: bool, as_json: bool, how: str) -> int:
    """Write one generated file, or see whether it is current. ``how`` is the command that writes it; ``ours`` says of what is
    there whether that command wrote it: anything else is not replaced."""
    return generated_files({path: (wanted, ours)}, check, as_json, how)


def generated_files(
    files: Mapping[Path, tuple[str, Callable[[bytes], bool]]], check: bool, as_json: bool, how: str
) -> int:
    """The same of several files that one command writes."""
    told, codes = [], [EXIT_OK]
    for path, (wanted, ours) in files.items():
        one, code = _one(path, wanted, ours, check, as_json, how)
        told.append(one)
        codes.append(code)
    if as_json:
        sys.stdout.write(text(told[0] if len(told) == 1 else {"files": told}))
    return max(codes)


def _one(
    path: Path, wanted: str, ours: Callable[[bytes], bool], check: bool, as_json: bool, how: str
) -> tuple[dict[str, object], int]:
    if not check:
        check_file(path, ours)
    try:
        current = read_bytes(path, LARGEST_OWN) == wanted.encode()
    except (FileNotFoundError, NotADirectoryError):
        current = False
    if not check and not current:
        write_file(path, wanted, ours)
    if as_json:
        pass
    elif check and not current:
        say(f"{path} is not current; {how} writes it", error=True)
    elif not check:
        say(f"{path}: {'already current' if current else 'written'}")
    one: dict[str, object] = {"file": path, "current": current, "written": not check and not current}
    return one, EXIT_FAILED if check and not current else EXIT_OK
