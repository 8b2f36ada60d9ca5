"""Plain files are loaded by the programs that they are for, each by its plain loader: what they make of them is the world, but
for what the format does not carry and what is foreseen of the reader."""

from __future__ import annotations

import functools
import importlib.util

import pytest

from simspec.audit.audit import loaded
from simspec.audit.exported import Reader, differences, files_of, foreseen_differences, readers
from simspec.audit.libraries import LIBRARIES
from simspec.audit.meaning import Meaning
from simspec.engines.kit.effects import FILE, REFUSED, Exported
from simspec.engines.kit.registry import engines
from simspec.formats.kit.contract import formats
from tests.files import write
from tests.formats.exported_worlds import NAMES, exported_world

pytestmark = pytest.mark.usefixtures("warm_engines")

LAYOUTS = (
    ("urdf", "fixed-base"),
    ("urdf", "floating"),
    ("mjcf", ""),
    ("sdf", "1.9"),
    ("sdf", "1.6"),
    ("usd", "flat"),
    ("usd", "nested"),
)


def installed(reader: Reader) -> bool:
    if reader.engine:
        return engines()[reader.name].version() is not None
    return importlib.util.find_spec(LIBRARIES[reader.name].module) is not None


def read(reader, path, language):
    """What a reader holds of a file; None where it refuses it."""
    if reader.engine:
        loading = loaded(reader.name, Meaning(path, language), None, 60.0)
        if loading.error is not None and not loading.error.refused:
            raise loading.error
        return loading.held
    try:
        return LIBRARIES[reader.name].load(path, language)
    except ValueError:
        return None


@functools.cache
def plain_of(world, language, profile):
    written = formats()[language]
    return (written.in_profile(profile) if profile else written).plain(exported_world(world))


CASES = [(language, profile, reader) for language, profile in LAYOUTS for reader in readers(language)]


@pytest.mark.parametrize("world", NAMES)
@pytest.mark.parametrize(
    ("language", "profile", "reader"), CASES, ids=[f"{a}-{b or 'only'}-{reader.name}" for a, b, reader in CASES]
)
def test_a_reader_has_the_worlds_model_but_for_what_is_foreseen(world, language, profile, reader, tmp_path):
    if not installed(reader):
        pytest.skip(f"{reader.name} is not installed")
    plain = plain_of(world, language, profile)
    write(plain.files, tmp_path)
    for file, bodies in files_of(exported_world(world), language, plain.files).items():
        exported = Exported(exported_world(world), bodies, language)
        held = read(reader, tmp_path / file, language)
        rules = foreseen_differences(reader, exported, profile, plain.losses)
        found = {(REFUSED, FILE)} if held is None else differences(reader, exported, held, plain.losses)
        assert rules.unlike(found) == (set(), set()), file
