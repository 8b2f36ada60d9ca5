"""A stored proof of massless bodies, or of bodies merged for engines, compares the quantities that such a world has."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.proof.certificate import Certificate
from simspec.proof.judge import judge
from simspec.proof.verify import verify
from simspec.testing.worlds import tree, world
from simspec.world.types import Inertial

pytestmark = pytest.mark.usefixtures("warm_engines")
KINDS = ["fixed", "hinge", "fixed", "fixed", "hinge"]
WEIGHTS = {"nothing": (), "of one link": (2,), "of links in a row": (2, 3), "a point mass": ()}


@pytest.mark.parametrize("massless", WEIGHTS)
def test_it_is_equal_when_it_is_read_again(massless):
    bodies = list(tree(KINDS, 3))
    for index in WEIGHTS[massless]:
        bodies[index] = dataclasses.replace(bodies[index], inertial=Inertial(0.0))
    if massless == "a point mass":
        bodies[3] = dataclasses.replace(bodies[3], inertial=Inertial(0.5))
    entry = world(tuple(bodies))
    certificate = verify(entry, ["mujoco", "pybullet"])
    assert certificate.valid
    assert judge(Certificate.from_json(certificate.to_json()), entry) == []
    # and less than that is noticed: one more is of the base, which does not move
    proof = certificate.engines["mujoco"]
    for name in ("mass", "centre of mass", "inertia tensor"):
        fewer = [
            dataclasses.replace(check, count=check.count - 2) if (check.level, check.name) == ("L1", name) else check
            for check in proof.checks
        ]
        changed = dataclasses.replace(certificate, engines={"mujoco": dataclasses.replace(proof, checks=tuple(fewer))})
        assert f"L1 {name}" in str(judge(changed, entry))
