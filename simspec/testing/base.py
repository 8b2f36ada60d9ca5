"""What all suites share: the engine's name, the interpreter it lives in, and a bench to ask it on."""

from __future__ import annotations

from typing import ClassVar

import pytest

from simspec.testing.bench import Bench


class Suite:
    """A suite of tests of one engine. Subclasses say which."""

    engine: ClassVar[str]
    """Its name, as in its entry point."""
    python: ClassVar[str | None] = None
    """The interpreter that it lives in; None: the one that runs the tests, or none for an engine that is a program."""

    @pytest.fixture(scope="class")
    @classmethod
    def bench(cls, tmp_path_factory: pytest.TempPathFactory) -> Bench:
        """The engine under test."""
        return Bench(cls.engine, cls.python, tmp_path_factory.mktemp("bench"))
