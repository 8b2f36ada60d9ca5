"""Advice of an engine's declarations can be followed: settings that it names exist in the named engine, and for another engine
the text says so."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from simspec.engines.kit.registry import engines

ADVICE = re.compile(r"engines\.(\w+)\.settings: \{(\w+): ([\w-]+)\}")


def advice(name: str) -> Iterator[tuple[str, re.Match[str]]]:
    """Every setting that a text of an engine's declarations advises, and what the text says before."""
    for support in engines()[name].SUPPORT.values():
        texts = [support.how, support.short]
        texts += [text for case in support.cases for text in (case.how or "", case.short, case.note)]
        for text in texts:
            for found in ADVICE.finditer(text):
                yield text[: found.start()].rpartition(";")[2], found


@pytest.mark.parametrize("name", engines())
def test_settings_that_declarations_advise_can_be_set(name):
    for before, found in advice(name):
        engine, setting, value = found.groups()
        assert engine == name or f"the engine {engine} with" in before, f"{name} refuses {found.group()}"
        declared = engines()[engine].SETTINGS[setting]
        assert value in declared.choices, f"{engine} refuses {found.group()}"


def test_features_of_mujoco_alone_are_attributed_to_mujoco():
    for name in ("mjx", "mjwarp"):
        assert "coulomb" not in engines()[name].SETTINGS["friction"].choices
        assert len(list(advice(name))) == 3
    assert len(list(advice("mujoco"))) == 4
