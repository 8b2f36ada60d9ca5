"""States that are read in one call, and overlaps of contacts that are read once, against what single objects tell."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from simspec.engines.physx.contacts import depths, pressed
from simspec.engines.physx.engine import PhysX
from simspec.engines.physx.measures import PackedActors
from simspec.engines.physx.units import SCALE
from simspec.errors import EngineError
from tests.engines.free_bodies import ball, loader, scene

installed = pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")
AS_SAPIEN = (3, 4, 5, 6, 0, 1, 2, *range(7, 13))


class Actor(SimpleNamespace):
    __hash__ = object.__hash__


def actor(number: int) -> Actor:
    base = 100.0 * number
    pose = SimpleNamespace(p=base + np.arange(3.0), q=base + np.arange(3.0, 7.0))
    return Actor(
        entity=SimpleNamespace(pose=pose),
        linear_velocity=base + np.arange(7.0, 10.0),
        angular_velocity=base + np.arange(10.0, 13.0),
    )


def system(actors, order=AS_SAPIEN):
    """One that packs ``actors`` as SAPIEN does, or in another order."""

    def pack() -> bytes:
        rows = [
            (*a.entity.pose.p, *a.entity.pose.q, *a.linear_velocity, *a.angular_velocity)
            for a in system.rigid_dynamic_components
        ]
        return np.array(rows, dtype=np.float32)[:, list(order)].tobytes()

    system = SimpleNamespace(rigid_dynamic_components=list(actors), pack=pack)
    return system


def test_states_are_those_of_the_actors_in_order():
    actors = [actor(number) for number in range(3)]
    poses, speeds = PackedActors(system(actors[::-1]), actors).read()
    for row in range(3):
        assert poses[row].tolist() == (100.0 * row + np.arange(7.0)).tolist()
        assert speeds[row].tolist() == (100.0 * row + np.arange(7.0, 13.0)).tolist()


@pytest.mark.parametrize("swapped", [(0, 1), (3, 4), (7, 10), (6, 7)])
def test_another_layout_of_packed_data_is_rejected(swapped):
    order = list(AS_SAPIEN)
    entry, other = swapped
    order[entry], order[other] = order[other], order[entry]
    actors = [actor(1), actor(2)]
    with pytest.raises(EngineError, match="packs states in another way"):
        PackedActors(system(actors, order), actors)


def test_bodies_that_are_not_requested_or_not_packed_are_refused():
    actors = [actor(number) for number in range(3)]
    with pytest.raises(EngineError, match="has 3 bodies that move, not 2"):
        PackedActors(system(actors), actors[:2])
    with pytest.raises(EngineError, match="has 2 bodies that move, not 3"):
        PackedActors(system(actors[:2]), actors)
    with pytest.raises(EngineError, match="packs 36 numbers, not 39"):
        PackedActors(system(actors, tuple(range(12))), actors)


@installed
def test_states_of_the_live_engine_are_those_of_its_objects(load_files):
    turned = (0.5, -0.5, 0.5, 0.5)
    engine = loader(PhysX, load_files)(
        scene(*(ball(str(row), (1.0 * row, 0.0, 0.3 + 0.1 * row), turn=turned) for row in range(3)))
    )
    simulation = engine._simulation
    v = np.arange(18.0) / 10.0
    for steps in (0, 7, 200):
        if not steps:
            engine.set_state(engine.get_state()[0], v)
        engine.step(steps)
        poses, speeds = simulation.singles._packed.read()
        for row, (entity, body) in enumerate(zip(simulation.singles.entities, simulation.bodies, strict=True)):
            assert poses[row].tolist() == [*map(float, entity.pose.p), *map(float, entity.pose.q)]
            assert speeds[row].tolist() == [*map(float, body.linear_velocity), *map(float, body.angular_velocity)]


def contact(bodies, points):
    return SimpleNamespace(
        bodies=list(bodies),
        points=[
            SimpleNamespace(separation=depth * SCALE, impulse=np.array([0.0, 0.0, force])) for depth, force in points
        ],
    )


def test_the_deepest_overlap_of_each_pair_counts():
    floor, actor, two = Actor(), Actor(), Actor()
    rows = {actor: 0, two: 1}
    found = depths(
        [
            contact((two, actor), [(-0.1, 0.0), (-0.3, 1.0)]),
            contact((actor, floor), [(-0.2, 1.0), (0.1, 0.0)]),
            contact((actor, two), [(-0.2, 1.0)]),
            contact((floor, two), [(0.1, 0.0), (0.0, 0.0)]),
            contact((two, floor), []),
        ],
        rows,
    )
    assert found.rows.tolist() == [[-1, 0], [0, 1]]
    assert found.depth == pytest.approx([0.2, 0.3])
    assert depths([], rows).rows.shape == (0, 2)
    assert depths([contact((floor, two), [(-0.1, 0.0)])], rows).rows.tolist() == [[-1, 1]]


def test_pressed_contacts_have_an_impulse():
    floor, actor, two, three = (Actor() for _ in range(4))
    rows = {actor: 0, two: 1, three: 2}
    contacts = [
        contact((floor, actor), [(-0.1, 0.0), (0.0, 0.0)]),
        contact((actor, two), [(0.0, 0.0), (0.0, -2.0)]),
        contact((three, two), [(-0.1, 0.0)]),
    ]
    assert pressed(contacts, rows, [0, 1, 2]) == {0, 1}
    assert pressed(contacts, rows, [1, 2]) == {1}
    assert pressed(contacts, rows, []) == set()
