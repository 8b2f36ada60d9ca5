"""One text for one world."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import pytest

from simspec.world.canonical import canonical_json, from_plain, sha256, to_plain
from simspec.world.types import Expectation, Joint, World
from tests import worlds

ROOT = Path(__file__).parents[2]

WORLDS = [
    worlds.every_joint(),
    worlds.damped_springs(),
    worlds.limits_and_armature(),
    worlds.shapes_world(),
    worlds.gripper(),
]


@pytest.mark.parametrize("world", WORLDS, ids=lambda world: world.name)
def test_a_world_survives_its_json(world):
    text = canonical_json(world)
    again = from_plain(World, json.loads(text))
    assert again == world
    assert canonical_json(again) == text


def test_worlds_with_negative_and_positive_zero_are_equal():
    world = worlds.spheres(1)
    other = dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=(-0.0, 0.0, -9.81)))
    assert sha256(other) == sha256(world)


def test_the_last_bit_counts():
    world = worlds.spheres(1)
    other = dataclasses.replace(
        world, physics=dataclasses.replace(world.physics, gravity=(0.0, 0.0, -9.810000000000002))
    )
    assert sha256(other) != sha256(world)


def test_nan_has_no_text():
    world = worlds.spheres(1)
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical_json(dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=float("nan"))))


def test_expectations_distinguish_numbers_words_and_vectors():
    expectation = Expectation("x", (("at", 1.0), ("body", "ball"), ("xyz", (0.0, 1.0, 2.0))))
    assert from_plain(Expectation, json.loads(json.dumps(to_plain(expectation)))) == expectation


def test_expectations_keep_the_places_of_bodies():
    places = (("arm/tool", (0.0, 1.0, 2.0)), ("ball", (3.0, 4.0, 5.0)))
    for targets in (places, places[:1]):
        expectation = Expectation("x", (("targets", targets), ("tolerance", 1.0)))
        again = from_plain(Expectation, json.loads(json.dumps(to_plain(expectation))))
        assert again == expectation
        assert hash(again) == hash(expectation)


def test_a_damaged_place_of_a_body_is_found():
    plain = to_plain(Expectation("x", (("targets", (("ball", (3.0, 4.0, 5.0)),)),)))
    plain["parameters"][0][1][0][1].pop()
    with pytest.raises(TypeError, match="expected 3 values"):
        from_plain(Expectation, plain)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda data: data.pop("kind"), KeyError),
        (lambda data: data.update(colour="red"), KeyError),
        (lambda data: data.update(axis=[0.0, 1.0]), TypeError),
        (lambda data: data.update(damping="much"), TypeError),
        (lambda data: data.update(parent=3), TypeError),
    ],
)
def test_damaged_data_is_found(change, error):
    data = to_plain(Joint("a", "hinge"))
    change(data)
    with pytest.raises(error):
        from_plain(Joint, data)


def test_the_hash_does_not_depend_on_the_process():
    code = "from tests import worlds; from simspec.world.canonical import sha256; print(sha256(worlds.every_joint()))"
    seen = {
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True, env={"PYTHONHASHSEED": seed}
        ).stdout.strip()
        for seed in ("1", "2")
    }
    assert seen == {sha256(worlds.every_joint())}
