"""Contact margins: shapes are felt at a distance, and come to rest there."""

from __future__ import annotations

import dataclasses
import json
import re

import pytest

import simspec
from simspec.compiler import compile_world
from simspec.errors import SpecError, UnsupportedError
from simspec.language.load import load
from simspec.world.canonical import canonical_json, from_plain
from simspec.world.overlap import deep_overlaps
from simspec.world.types import World

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """
simspec: 1
name: felt
physics: {timestep: 1 ms, duration: 1 s}
contact: {materials: {stone: {friction: FRICTION}, ice: {friction: 0}}}
bodies:
  floor: {fixed: true, shapes: [{plane: {}, material: stone, margin: 1 mm}]}
  ball: {pose: {xyz: [0, 0, 0.105]}, shapes: [{sphere: {radius: 0.1}, density: 1000, margin: 2 mm, material: stone}]}
  cube:
    pose: {xyz: [1, 0, 0.105]}
    shapes: [{box: {size: [0.2, 0.2, 0.2]}, density: 1000, margin: 4 mm, material: ice}]
  bare: {pose: {xyz: [2, 0, 0.105]}, shapes: [{sphere: {radius: 0.1}, density: 1000, material: ice}]}
engines: {mujoco: {accept: [contact.friction.impact]}}
"""
HEIGHTS = {"ball": 0.103, "cube": 0.105, "bare": 0.101}


def felt(folder, friction: float = 0.5) -> World:
    path = folder / "felt.yaml"
    path.write_text(SPEC.replace("FRICTION", str(friction)))
    return load(path).resolve()


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("how", ["native", "coulomb"])
def test_bodies_rest_where_they_are_felt(friction, how, tmp_path):
    """Pairs with friction are explicit (their margin is the sum), and others the engine combines by itself. MuJoCo's own
    friction has a soft first 0.1 mm."""
    world = felt(tmp_path, friction)
    options = dataclasses.replace(world.engines[0], settings=(("friction", how),))
    run = simspec.run(dataclasses.replace(world, engines=(options,)), "mujoco")
    heights = {body.name: run.arrays["pose"][-1, place, 2] for place, body in enumerate(world.bodies)}
    assert {name: heights[name] for name in HEIGHTS} == pytest.approx(HEIGHTS, abs=1.5e-4)
    assert abs(run.arrays["contact.distance"]).max() < 3e-3  # the gap less the margins, not the gap


PAIRS = """
contact:
  materials: {stone: {friction: FRICTION}, ice: {friction: 0}}
  pairs:
    - {between: [stone, stone], margin: 7 mm}
    - {between: [stone, ice], margin: 0}
"""


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("how", ["native", "coulomb"])
def test_a_margin_of_two_materials_stands_in_place_of_their_shapes(friction, how, tmp_path):
    path = tmp_path / "felt.yaml"
    text = re.sub("contact: {materials.*\n", PAIRS, SPEC).replace("FRICTION", str(friction))
    path.write_text(text.replace("accept:", f"settings: {{friction: {how}}}, accept:"))
    world = load(path).resolve()
    run = simspec.run(world, "mujoco")
    heights = {body.name: run.arrays["pose"][-1, place, 2] for place, body in enumerate(world.bodies)}
    expected = {"ball": 0.107, "cube": 0.1, "bare": 0.1}
    assert {name: heights[name] for name in expected} == pytest.approx(expected, abs=1.5e-4)
    assert not deep_overlaps(world)
    if friction == 0.0 and how == "native":
        certificate = simspec.verify(world, ["mujoco"])
        assert certificate.valid
        assert [figure for figure in certificate.engines["mujoco"].contact if "margin 0.007 m" in figure.subject]


@pytest.mark.parametrize("engine", ["pybullet", "dart", "drake"])
def test_engines_without_margins_of_pairs_refuse_them_by_name(engine, tmp_path):
    path = tmp_path / "felt.yaml"
    path.write_text(
        re.sub(
            r"margin: \d mm, |, margin: \d mm",
            "",
            re.sub("contact: {materials.*\n", PAIRS, SPEC).replace("FRICTION", "0").replace("7 mm", "0"),
        )
    )
    with pytest.raises(UnsupportedError, match=r"does not support contact\.pairs\.margin"):
        compile_world(load(path).resolve(), [engine])


def test_the_margin_of_a_pair_is_felt_as_overlap_at_the_start(tmp_path):
    path = tmp_path / "felt.yaml"
    path.write_text(re.sub("contact: {materials.*\n", PAIRS, SPEC).replace("FRICTION", "0").replace("7 mm", "5 cm"))
    world = load(path).resolve()
    (overlap,) = deep_overlaps(world)
    assert overlap.second_body == "ball"
    assert overlap.depth == pytest.approx(0.045)
    assert from_plain(World, json.loads(canonical_json(world))) == world  # a margin of 0 is not the same as none


def test_a_margin_is_seen_as_overlap_at_the_start(tmp_path):
    world = felt(tmp_path)
    assert deep_overlaps(world) == []
    thick = tuple(
        dataclasses.replace(body, shapes=tuple(dataclasses.replace(shape, margin=0.05) for shape in body.shapes))
        for body in world.bodies
    )
    depths = {overlap.second_body: overlap.depth for overlap in deep_overlaps(dataclasses.replace(world, bodies=thick))}
    assert depths == {name: pytest.approx(0.095) for name in HEIGHTS}


@pytest.mark.parametrize("engine", ["pybullet", "dart", "drake"])
def test_engines_without_margins_refuse_them_by_name(engine, tmp_path):
    with pytest.raises(UnsupportedError, match=r"does not support shape\.margin"):
        compile_world(felt(tmp_path), [engine])


def test_worlds_without_margins_keep_their_text(tmp_path):
    assert canonical_json(felt(tmp_path)).count('"margin"') == 3


@pytest.mark.parametrize("shape", ["margin: -1 mm", "margin: 1 mm, collision: false", "margin: 1 kg"])
def test_invalid_margins_are_rejected(shape, tmp_path):
    path = tmp_path / "felt.yaml"
    path.write_text(SPEC.replace("FRICTION", "0").replace("margin: 2 mm", shape))
    with pytest.raises(SpecError, match="margin"):
        load(path).resolve()
