"""Values derived from a world are computed once and released with the world."""

from __future__ import annotations

import dataclasses
import gc
import weakref

import pytest

from simspec.contact import Rules, contact_plan
from simspec.world import canonical
from simspec.world import canonical as derived
from simspec.world.canonical import sha256
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import layout_of, rigid_groups, trees
from tests import worlds


def test_it_is_called_once_for_each_world_and_argument():
    calls = []

    @derived.derived
    def length(world, factor):
        calls.append((world.name, factor))
        return factor * len(world.bodies)

    entry, other = worlds.spheres(2), worlds.spheres(3)
    assert [length(entry, 2), length(entry, 2), length(entry, 3), length(other, 2)] == [6, 6, 9, 8]
    assert len(calls) == 3
    assert length(dataclasses.replace(entry), 2) == 6, "an equal world is another"
    assert len(calls) == 4
    with pytest.raises(TypeError, match="by position"):
        length(entry, factor=2)


def test_cached_values_are_released_with_the_world():
    """Looked up by the world's own key: worlds of other tests may end in between, whenever the collector comes."""
    world = worlds.gripper()
    key = id(world)
    assert key not in derived._KEPT
    for work in (rigid_groups, trees, layout_of, meeting_laws, sha256):
        work(world)
    contact_plan(world, Rules("max", "max"), False)
    assert len(derived._KEPT[key]) >= 6
    alive = weakref.ref(world)
    del world
    gc.collect()
    assert alive() is None, "something that is kept holds the world"
    assert key not in derived._KEPT


def test_a_hash_is_worked_out_once(monkeypatch):
    world = worlds.gripper()
    first = sha256(world)
    monkeypatch.setattr(canonical, "canonical_json", lambda value: pytest.fail("worked out again"))
    assert sha256(world) == first


def test_shared_values_are_immutable():
    world = worlds.gripper()
    for kept in (rigid_groups(world), trees(world), meeting_laws(world)):
        with pytest.raises(TypeError):
            kept["new"] = 1
