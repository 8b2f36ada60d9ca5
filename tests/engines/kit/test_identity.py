"""Which engine is meant: labels on the command line, and the version that is at work."""

from __future__ import annotations

import pytest

from simspec.commands.options import engine_names, interpreters, names_alone
from simspec.engines.kit.registry import EngineId, demand_version, engine_name, find_engine, parse
from simspec.errors import EngineError, SpecError


@pytest.mark.parametrize(
    ("word", "expected", "label"),
    [
        ("mujoco", EngineId("mujoco"), "mujoco"),
        ("mujoco=/a/python", EngineId("mujoco", "", "/a/python"), "mujoco"),
        ("mujoco@3.8", EngineId("mujoco", "3.8"), "mujoco@3.8"),
        ("mujoco@3.8=/a=b/python@2", EngineId("mujoco", "3.8", "/a=b/python@2"), "mujoco@3.8"),
        ("x@1.0rc1+cpu", EngineId("x", "1.0rc1+cpu"), "x@1.0rc1+cpu"),
    ],
)
def test_words(word, expected, label):
    assert parse(word) == expected
    assert expected.label == label
    assert engine_name(label) == expected.name


@pytest.mark.parametrize(
    "word", ["", "@3", "mujoco@", "mujoco@x", "mujoco@3/..", "mujoco@../3", "mujoco@3 4", "mujoco=", "=x"]
)
def test_words_that_name_no_engine(word):
    with pytest.raises(SpecError, match="contains no engine name"):
        parse(word)


@pytest.mark.parametrize(
    ("label", "version", "right"),
    [
        ("mujoco", "4.0.1", True),
        ("mujoco@4", "4.0.1", True),
        ("mujoco@4.0.1", "4.0.1", True),
        ("mujoco@3.3", "3.3.7", True),
        ("mujoco@3.3", "3.30.1", False),
        ("mujoco@3.3", "3.3rc1", False),
        ("mujoco@4.0.1", "4.0", False),
    ],
)
def test_a_label_is_the_beginning_of_a_version(label, version, right):
    if right:
        demand_version(label, version)
        return
    with pytest.raises(EngineError, match="--engine mujoco@"):
        demand_version(label, version)


def test_labels_of_a_command():
    words = ["mujoco", "mujoco@3.3=/a/python", "dart", "mujoco"]
    assert engine_names(words) == ["mujoco", "mujoco@3.3", "dart"]
    assert names_alone(words) == ["mujoco", "dart"]
    assert interpreters(["dart=/b/python"], words) == {"mujoco@3.3": "/a/python", "dart": "/b/python"}
    assert find_engine("mujoco@3.3") is find_engine("mujoco")
    with pytest.raises(SpecError, match="two interpreters"):
        interpreters(["mujoco@3.3=/b/python"], words)
    with pytest.raises(EngineError, match="no such engine"):
        engine_names(["nobody@3.3=/a/python"])
