"""Frames that are nearly those of their body: MuJoCo computes with them as they are, not as with the body's own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dialects.mujoco.dialect import are_confused, distinct_sites, with_distinct_frames
from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.readback import frame_sites
from simspec.formats.mjcf.tree import MjcfBody, MjcfGeom, MjcfInertial, MjcfSite
from simspec.world import frames
from simspec.world.types import Inertial as WorldInertial
from simspec.world.types import Pose
from tests import worlds
from tests.dialects.mujoco.saying import ALL_SHAPES, as_stored, differences, emit

mujoco = pytest.importorskip("mujoco")


def near(generator, extent):
    """A frame that is off by ``extent`` (m, rad)."""
    turn = frames.normalise((1.0, *(0.5 * extent * generator.normal(size=3)).tolist()))
    return Pose(tuple((extent * generator.normal(size=3)).tolist()), turn)


def nearly_aligned(extent):
    """Shapes and inertial frames on a chain of hinges, all but in their bodies' frames."""
    generator = np.random.default_rng(7)
    drawn = [shape for body in worlds.shapes_world(ALL_SHAPES).bodies for shape in body.shapes]
    shapes = list({shape.kind: shape for shape in drawn if shape.kind in ALL_SHAPES}.values())
    bodies = []
    for body, shape in zip(worlds.tree(["hinge"] * len(ALL_SHAPES), 4), shapes, strict=True):
        place = near(generator, extent)
        tensor = frames.rotate_inertia(place.quaternion, (0.01, 0.015, 0.02, 0.0, 0.0, 0.0))
        inertial = WorldInertial(1.0, place.position, tensor)
        local = dataclasses.replace(shape, pose=near(generator, extent), collision=False, material="")
        bodies.append(dataclasses.replace(body, inertial=inertial, shapes=(local,)))
    return worlds.world(tuple(bodies))


@pytest.mark.parametrize("extent", [1e-7, 1e-9])
def test_frames_that_are_nearly_the_bodys_are_computed_with_as_they_are(extent, load_files):
    world = nearly_aligned(extent)
    engine, oracle = load_files(MuJoCo, emit(world)), Oracle(world)
    for q, v in zip(*random_states(world, 2), strict=True):
        engine.set_state(q, v)
        (mass,) = engine.mass_blocks([np.arange(len(v))])
        wanted = oracle.mass_matrix(q)
        assert np.abs(mass - wanted).max() < 1e-12 * np.abs(wanted).max()
        mujoco.mj_kinematics(engine.model, engine.data)
        poses, _ = engine.body_states()
        for number, body in enumerate(world.bodies):
            pose = Pose(tuple(poses[number, :3].tolist()), tuple(poses[number, 3:].tolist()))
            place = frames.compose(pose, body.shapes[0].pose).position
            assert np.abs(engine.data.geom_xpos[number] - place).max() < 1e-14
    assert not differences(as_stored(world)[0].inertial, engine.read_back().bodies[0].inertial)


BODY = MjcfBody(
    "a",
    (0.0, 0.0, 0.0),
    frames.IDENTITY,
    inertial=MjcfInertial((0.0, 0.0, 0.1), frames.IDENTITY, 1.0, (1.0, 2.0, 2.5)),
    geoms=(MjcfGeom("g", "box", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), frames.IDENTITY),),
)


def test_equal_and_distant_frames_are_written_unchanged():
    assert with_distinct_frames(BODY) == BODY
    mesh = dataclasses.replace(BODY.geoms[0], type="mesh", position=(1e-8, 0.0, 0.0))
    assert with_distinct_frames(dataclasses.replace(BODY, geoms=(mesh,))).geoms == (mesh,)


def test_a_geom_near_the_inertial_frame_is_turned():
    turn = frames.normalise((0.6, 0.8, 0.0, 0.0))
    inertial = dataclasses.replace(BODY.inertial, orientation=turn)
    geom = dataclasses.replace(BODY.geoms[0], position=(0.0, 1e-9, 0.1), orientation=turn)
    body = with_distinct_frames(dataclasses.replace(BODY, inertial=inertial, geoms=(geom,)))
    assert body.inertial == inertial
    half = frames.multiply(frames.conjugate(turn), body.geoms[0].orientation)
    assert half == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-15)
    assert not are_confused(Pose(geom.position, body.geoms[0].orientation), Pose(inertial.position, turn))


def test_both_sites_of_a_constraint_are_turned_alike():
    close = MjcfSite("constraint/pin/1", (1e-9, 0.0, 0.0), frames.IDENTITY)
    far = MjcfSite("constraint/pin/2", (0.3, 0.0, 0.0), frames.normalise((0.6, 0.8, 0.0, 0.0)))
    other = MjcfSite("constraint/glue/1", (0.0, 0.0, 0.0), frames.IDENTITY)
    made = distinct_sites({"a": (close, other), "b": (far,)})
    assert made["a"][1] == other
    first, second = (frames.multiply(site.orientation, (0.5, 0.5, 0.5, 0.5)) for site in (close, far))
    assert (made["a"][0].orientation, made["b"][0].orientation) == (first, second)


def test_sites_of_equalities_are_not_named_frames():
    """Equalities of bodies have the numbers of bodies, which are no sites."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="m"><freejoint/><geom size=".1"/><site name="a"/><site name="z"/></body>
        <body name="n"><freejoint/><geom size=".1"/><site name="b"/><site name="c"/></body></worldbody>
        <equality><weld site1="a" site2="b"/><connect body1="m" body2="n" anchor="0 0 0"/></equality></mujoco>"""
    )
    assert frame_sites(mujoco, model) == {"c": 3, "z": 1}
