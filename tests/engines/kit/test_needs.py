"""The requirements of an engine are data, and every message about missing requirements and their installation is made of it."""

from __future__ import annotations

import os
import shutil
import sys

import pytest

from simspec import selection
from simspec.comparison.study import missing_engines
from simspec.engines.drake.engine import Drake
from simspec.engines.kit import process, registry
from simspec.engines.kit import registry as installed
from simspec.engines.kit.compiled import NativeBinary, Needs
from simspec.engines.kit.registry import how_to_install, not_installed, why_not
from simspec.errors import EngineError
from tests.files import program


@pytest.fixture
def toys(tmp_path, monkeypatch):
    """An engine that is a library of the machine, which is there as ``toys`` 1.2; its folder."""
    (tmp_path / "toys.pc").write_text("Name: toys\nDescription: of a test\nVersion: 1.2\n")
    monkeypatch.setenv("PKG_CONFIG_PATH", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    part = NativeBinary("toys", "toys-part", (tmp_path / "part.c",), packages=("toys >= 1.0",))
    (tmp_path / "part.c").write_text("int x;\n")
    debian = (("libtoys-dev", "the engine"), ("gcc", "compiles its part"))

    class Toys(Drake):
        NAME, TITLE, DISTRIBUTION, EXTRA = "toys", "Toys", "", ""
        NEEDS = Needs("toys >= 1.0", (part,), debian)

    monkeypatch.setitem(registry.engines()._loaded, "toys", Toys)
    return Toys


def test_its_version_is_the_librarys(toys):
    assert toys.version() == "1.2"
    assert toys.distributions() == ()
    assert toys.NEEDS.lacking() == ()


def test_a_library_that_is_too_old_is_none(toys, tmp_path):
    toys.NEEDS = Needs("toys >= 1.3", toys.NEEDS.parts, toys.NEEDS.debian)
    assert toys.version() is None


def test_without_a_compiler_it_is_not_installed_and_says_so_everywhere(toys, tmp_path, monkeypatch):
    program(tmp_path / "bin" / "pkg-config", f'#!/bin/sh\nexec {os.path.realpath(shutil.which("pkg-config"))} "$@"\n')
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert toys.version() is None
    text = not_installed(toys)
    assert text.startswith("not installed (toys-part (part.c) cannot be compiled: no C compiler")
    assert text.endswith(": apt-get install libtoys-dev gcc")
    assert missing_engines(["toys"]) == {"toys": text}
    assert selection.available({}).not_taken["toys"].reason == text
    [row] = [instance for instance in installed.instances({}) if instance.engine == "toys"]
    assert (row.version, row.problem) == (None, text)
    process._installed.cache_clear()
    with pytest.raises(EngineError, match="no C compiler"):
        process.call("toys", tmp_path, [])


def test_the_words_are_those_of_every_way():
    class Both(Drake):
        NEEDS = Needs(debian=(("libtoys", "a library"),))

    class Neither(Drake):
        EXTRA = ""

    assert (
        how_to_install(Drake)
        == not_installed(Drake).removeprefix("not installed: ")
        == "pip install 'simspec-physics[drake]'"
    )
    assert how_to_install(Both) == "pip install 'simspec-physics[drake]' and apt-get install libtoys"
    assert (how_to_install(Neither), not_installed(Neither), why_not(Neither)) == ("", "not installed", None)


def test_another_interpreter_has_the_machines_library(toys, tmp_path):
    python = program(tmp_path / "python", f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    [row] = [instance for instance in installed.instances({"toys": str(python)}) if instance.label == "toys"]
    assert (row.version, row.problem) == ("1.2", None)
