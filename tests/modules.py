"""The modules of simspec and of its tests, read and parsed once for all rules of a test process."""

from __future__ import annotations

import ast
import functools
import gc
from collections.abc import Callable, Iterable
from pathlib import Path

TESTS = Path(__file__).resolve().parent
PACKAGE = TESTS.parent / "simspec"
MODULES = sorted(PACKAGE.rglob("*.py"))
TEST_MODULES = sorted(TESTS.rglob("*.py"))


def name_of(path: Path) -> str:
    """The path inside simspec, or inside tests."""
    return path.relative_to(TESTS if path.is_relative_to(TESTS) else PACKAGE).as_posix()


@functools.cache
def parsed(path: Path) -> ast.Module:
    """The tree of a module. No garbage is collected meanwhile: every node stays, and looking at all of them again and again
    takes three quarters of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        return ast.parse(path.read_text(encoding="utf-8"))
    finally:
        if enabled:
            gc.freeze()
            gc.enable()


def offences(
    rule: Callable[[ast.Module], Iterable[object]], paths: Iterable[Path] = MODULES
) -> dict[str, list[object]]:
    """Offences against a rule, by module; empty if all keep to it. Raises AssertionError without modules."""
    paths = list(paths)
    assert paths, "no module was examined"
    found = {name_of(path): list(rule(parsed(path))) for path in paths}
    return {name: lines for name, lines in found.items() if lines}
