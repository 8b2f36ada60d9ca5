"""Certificates: their content and their reader, and the self-test catches the defects that it plants."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from types import SimpleNamespace

import pytest

from simspec.dialects.kit.defects import NAMES
from simspec.dynamics.oracle import Oracle
from simspec.errors import SpecError, UnsupportedError
from simspec.proof import motion, selftest
from simspec.proof.certificate import Certificate
from simspec.proof.checks import Check
from simspec.proof.judge import judge
from simspec.proof.selftest import defects_of, self_test
from simspec.proof.verify import LEVELS, verify
from simspec.world.canonical import sha256
from tests import worlds
from tests.installed import INSTALLED, JOINTED
from tests.nightly import EVERYTHING
from tests.proof.wild import WILD, at_4_ms

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = sorted(JOINTED)
MEASURED = ("mujoco", "ode")
"""Of these, the quickest at the probes of contact: in the others the whole certificate is made by ``make slow``."""


@pytest.fixture(scope="module")
def certificate():
    world = worlds.shapes_world(("box", "sphere"))
    return world, verify(world, ENGINES if EVERYTHING else [name for name in ENGINES if name in MEASURED])


def test_it_is_valid_and_holds_every_level_for_every_engine(certificate):
    world, found = certificate
    assert found.valid
    assert found.world_sha256 == sha256(world)
    for proof in found.engines.values():
        assert {check.level for check in proof.checks} == set(LEVELS) - {"L7"}  # nothing is driven there
        assert all(check.count > 0 for check in proof.checks)
        assert proof.not_compared["L7"] == "nothing is driven in this world"
        (motion,) = proof.level("L6")
        assert motion.worst <= 1e-9
        assert "floor" in motion.detail
        assert "2000 steps" in motion.detail


def test_it_survives_its_json(certificate):
    _, found = certificate
    text = found.to_json()
    assert Certificate.from_json(text) == found
    assert json.loads(text)["valid"] is True


def test_a_forged_verdict_is_found(certificate):
    _, found = certificate
    data = json.loads(found.to_json())
    data["engines"]["mujoco"]["checks"][0]["worst"] = 1.0
    with pytest.raises(SpecError, match="was edited"):
        Certificate.from_json(json.dumps(data, indent=2))


def test_it_is_judged_from_its_figures(certificate):
    world, found = certificate
    assert judge(found, world) == []
    assert judge(found, dataclasses.replace(world, name="other")) == ["it belongs to another world"]
    name = "mujoco"
    proof = found.engines[name]
    figure = dataclasses.replace(proof.contact[0], measured=1e6)
    for change, words in (
        ({"contact": proof.contact[1:]}, "no figure of"),
        ({"contact": (figure, *proof.contact[1:])}, "does not follow from its figures"),
        ({"checks": tuple(check for check in proof.checks if check.level != "L5")}, "L5"),
        ({"checks": proof.checks[:3]}, "comparisons, this world has"),
    ):
        forged = dataclasses.replace(found, engines={name: dataclasses.replace(proof, **change)})
        assert any(words in line for line in judge(forged, world)), words


def test_a_certificate_without_checks_is_not_valid():
    assert not Certificate("x", "", "", {}).valid


@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_that_does_not_answer_is_a_failed_check(engine, tmp_path):
    world = worlds.every_joint()
    found = verify(world, [engine], levels=["L1"], pythons={engine: "/bin/false"})
    assert not found.valid
    assert any("without a result" in check.detail for _, check in found.failures())


def test_uncompilable_worlds_are_rejected_for_all_engines_at_once():
    world = worlds.shapes_world()
    contact = dataclasses.replace(world.contact, friction_cone="pyramid-inscribed")
    with pytest.raises(UnsupportedError) as caught:
        verify(dataclasses.replace(world, contact=contact), ENGINES)
    assert len(caught.value.problems) >= 2


SOME: Mapping[str, tuple[str, ...]] = {
    "dart": tuple(NAMES)[0::6],
    "pybullet": tuple(NAMES)[2::6],
    "ode": tuple(NAMES)[4::6],
    "gazebo": tuple(NAMES)[1::6],
    "drake": ("armature", "ball damping", "ball spring", "restitution", "rolling friction", "dry friction", "hardness"),
    "rapier": ("mass", "friction", "restitution", "copy filter", "shape size", "gravity", "excluded pair dropped"),
    "physx": ("mass", "friction", "restitution", "copy filter", "shape size", "gravity", "excluded pair dropped"),
}
"""Which are planted where not all: each in MuJoCo, and every second one in another (half of these at every commit, and the
others in MuJoCo); all in all of them by ``make slow``. Drake needs minutes: ``verify --self-test --engine drake`` plants
all."""


@pytest.mark.parametrize("engine", INSTALLED)
def test_every_planted_defect_is_caught(engine):
    everything = EVERYTHING and engine != "drake"
    some = None if everything else SOME.get(engine, tuple(NAMES))
    if some is not None and not EVERYTHING:
        some = some[::2] if engine in SOME else some[1::2]
    found = self_test([engine], defects=some, every_level=False)
    missed = [outcome.defect for outcome in found.outcomes if outcome.caught is False]
    assert missed == []
    assert found.planted >= (30 if some is None else len(some) // 3)
    for outcome in found.outcomes:
        assert outcome.caught is not None or outcome.reason


def test_every_defect_is_planted_in_mujoco_and_every_second_defect_in_another_engine():
    assert "mujoco" not in SOME
    assert {name for engine in ("dart", "pybullet", "ode") for name in SOME[engine]} == set(tuple(NAMES)[0::2])


def test_a_sound_world_is_proven_once_at_each_requested_level():
    world, requested, valid = worlds.every_joint(), [], [True, True, False]

    def prove(of, engines, *, compiled, levels):
        requested.append(levels)
        return SimpleNamespace(
            valid=valid[len(requested) - 1],
            failures=lambda: [("mujoco", Check("L6", "motion", 1, 0.0, 1.0, "", "it moves"))],
        )

    sound = selftest._Sound("any", world, SimpleNamespace(engine="mujoco"), prove)
    sound.probes(("L0", "L1"))
    assert sound.probes(("L0", "L1")) is sound.probes(("L0", "L1"))
    sound.probes(("L0", "L1", "L3"))
    assert requested == [("L0", "L1"), ("L3",)]
    with pytest.raises(AssertionError, match="the sound world 'any' fails L6 motion: it moves"):
        sound.probes(("L1", "L6"))


def test_worlds_of_other_engine_options_share_a_motion_and_others_do_not():
    world = worlds.world(worlds.tree(["fixed", "hinge", "hinge"], 11))
    planned = motion.plan(world, Oracle(world))
    other = dataclasses.replace(worlds.with_options(world, "mujoco", accept=("inertia",)), name="other")
    assert motion.plan(other, Oracle(other)) is planned
    for physics in ({"gravity": (0.0, 0.0, -9.0)}, {"timestep": 0.5 * world.physics.timestep}):
        changed = dataclasses.replace(world, physics=dataclasses.replace(world.physics, **physics))
        assert motion.plan(changed, Oracle(changed)) is not planned


def test_a_defect_that_changes_nothing_is_an_error():
    plant = defects_of("mujoco")["gravity"]
    with pytest.raises((ValueError, LookupError, KeyError)):
        plant({"model.xml": "<mujoco><option/></mujoco>"})


@pytest.mark.parametrize("case", WILD[:3])
def test_wild_worlds_at_4_ms_are_valid_in_every_engine(case):
    kinds, seed, parents, joint, _ = case
    found = verify(at_4_ms(kinds, seed, parents, **joint), ENGINES, levels=["L6"])
    assert found.valid, found.failures()
    assert set(ENGINES) == set(found.engines)
