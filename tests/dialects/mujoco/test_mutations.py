"""The lists of what could stand in a model.xml are held against the schema that the installed MuJoCo prints."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from simspec.compiler import compile_world
from simspec.dialects.mujoco import mutation_additions as additions
from simspec.dialects.mujoco.mutations import INERT
from simspec.errors import UnsupportedError
from simspec.formats.mjcf.reading import CHILDREN
from simspec.proof.mutation_worlds import WORLDS

mujoco = pytest.importorskip("mujoco")

VIEWERS = {"visual", "global", "quality", "headlight", "map", "scale", "rgba"}
SECTIONS = {"asset", "deformable", "tendon", "equality", "actuator", "sensor", "custom", "extension"}
"""Elements that only hold others."""
INDENT = 3
"""Of the sections of a file in what MuJoCo prints."""
LINE = re.compile(r"^( *)(\S+) \((?:\*|\?|!|R)\) *(.*)$")


def schema(without: set[str] = frozenset()) -> dict[str, set[str]]:
    """The attributes of each tag, wherever it may stand but in the sections ``without``."""
    found: dict[str, set[str]] = {}
    tag = section = ""
    for line in mujoco.mj_printSchema(False, False).splitlines():
        match = LINE.match(line.rstrip())
        if match:
            tag = match[2].removeprefix("(world)")
            if len(match[1]) <= INDENT:
                section = tag
        if tag and section not in without:
            found.setdefault(tag, set()).update((match[3] if match else line).split())
    return found


def written() -> dict[str, set[str]]:
    """The files that simspec writes, in all worlds of the self-test."""
    found: dict[str, set[str]] = {}
    for world in WORLDS.values():
        try:
            text = compile_world(world("mujoco"), ["mujoco"])["mujoco"].files["model.xml"]
        except UnsupportedError:
            continue
        for element in ElementTree.fromstring(text).iter():
            found.setdefault(element.tag, set()).update(element.attrib)
    return found


def test_every_attribute_of_written_files_is_written_or_added():
    known, there = schema(SECTIONS - {"actuator", "equality"}), written()
    known["fixed"] = schema(SECTIONS - {"tendon"})["fixed"]
    known["hfield"] = schema(SECTIONS - {"asset"})["hfield"]
    assert {
        "option",
        "flag",
        "joint",
        "geom",
        "pair",
        "body",
        "position",
        "velocity",
        "key",
        "site",
        "connect",
        "weld",
        "fixed",
    } <= there.keys()
    for tag in there.keys() - {"worldbody", "contact", "keyframe", "velocity", "asset", "equality", "tendon"}:
        added = set(additions.ATTRIBUTES.get(tag, {}))
        assert known[tag] - there[tag] - added == set(), tag
    added = set(additions.ATTRIBUTES["position"]) - set(additions.NOT_OF_VELOCITY)
    assert known["velocity"] - there["velocity"] - added == set()


def test_every_element_that_is_not_written_is_added_or_left_out_by_name():
    planted = set()
    for row in additions.ELEMENTS:
        names = {tag: ["one", "two", "three"] for tag in ("joint", "body", "geom")}
        root = ElementTree.fromstring(f"<all>{row.value.format_map(names)}</all>")
        planted |= {element.tag for element in root.iter()}
    # a plugin's name is all that can be said without one that is installed
    left = schema().keys() - written().keys() - planted - VIEWERS - SECTIONS - additions.NOT_PLANTED.keys()
    assert left == set()


def test_the_format_knows_every_element_of_the_installed_schema():
    known, parents = set(), {}
    for line in mujoco.mj_printSchema(False, False).splitlines():
        match = LINE.match(line.rstrip())
        if match:
            tag, depth = match[2].removeprefix("(world)"), len(match[1])
            parents[depth] = tag
            above = [parents[other] for other in sorted(parents) if other < depth]
            if above:
                known.add((above[-1], tag))
            parents = {other: name for other, name in parents.items() if other <= depth}
    known = {(parent, "worldbody" if (parent, tag) == ("mujoco", "body") else tag) for parent, tag in known}
    assert len(known) > 150
    assert {(parent, tag) for parent, tag in known if tag not in CHILDREN.get(parent, frozenset())} == set()


def test_every_declaration_gives_a_reason():
    assert all(row.why and row.site for row in INERT)
    assert all(additions.NOT_PLANTED.values())
