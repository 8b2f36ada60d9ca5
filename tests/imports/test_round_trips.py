"""Robots that simspec writes as plain URDF and MJCF are the same robots when it reads them; SDF, which gives the same bytes
again, has its own test (``tests/formats/sdf``)."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.formats.mjcf.format import Mjcf
from simspec.formats.urdf.format import Urdf
from simspec.language.load import load
from tests.files import write
from tests.robots import assert_same, robot

pytestmark = pytest.mark.usefixtures("warm_readers")

TOLERANCE = 1e-12
"""Angles of URDF, and principal axes of MJCF, are not those that the world has: round-off of turning one into the other."""


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 10**6))
def test_urdf(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("urdf")
    world = robot(seed, ("hinge", "slide", "fixed"), loops=False)
    plain = Urdf().plain(world)
    assert not {"constraint.coupling", "shape.mesh"} & {loss.feature for loss in plain.losses}
    write(plain.files, folder)
    (file,) = folder.glob("*.urdf")
    again = load(file, allow_outside=True).resolve()
    assert_same(world, again, TOLERANCE)
    assert_same(again, load(file, allow_outside=True).resolve(), 0.0)


@pytest.mark.parametrize("seed", [6, 7, 12])
def test_mjcf(tmp_path, seed):
    world = robot(seed)
    write(Mjcf().plain(world).files, tmp_path)
    assert_same(world, load(tmp_path / "model.xml", allow_outside=True).resolve(), TOLERANCE)
