"""``simspec verify --self-test``: change compiled files on purpose, and see what the proof catches."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

from simspec.errors import EXIT_FAILED, EXIT_OK
from simspec.report import terminal
from simspec.report.complete import complete_data, show_complete
from simspec.report.plain import text
from simspec.report.progress import progress
from simspec.report.screen import console, say


def self_test(engines: Sequence[str], pythons: Mapping[str, str], as_json: bool) -> int:
    """Plant defects into compiled files, one at a time, and count the ones that the proof catches."""
    from simspec.proof.selftest import self_test as plant

    with progress(not as_json) as tell:
        result = plant(engines, pythons=pythons, progress=tell)
    if as_json:
        sys.stdout.write(text({"planted": result.planted, "caught": result.caught, "outcomes": result.outcomes}))
    else:
        screen = console()
        screen.print(terminal.self_test_table(result))
        screen.print(f"caught {result.caught} of {result.planted} planted defects")
    return EXIT_OK if result.passed else EXIT_FAILED


def complete_self_test(engines: Sequence[str], pythons: Mapping[str, str], as_json: bool) -> int:
    """Try every change that compiled files can suffer, and say what was missed."""
    from simspec.proof.complete import complete_self_test as plant

    result = plant(engines, pythons=pythons, progress=lambda line: say(line, error=True))
    if as_json:
        sys.stdout.write(text(complete_data(result)))
    else:
        show_complete(result, console())
    return EXIT_OK if result.passed else EXIT_FAILED
