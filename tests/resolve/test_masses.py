"""Bodies without mass and with singular tensors: allowed where they are fixed to others that make up for it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle, random_states
from simspec.errors import SpecError
from simspec.language.load import Spec
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.testing import worlds
from simspec.world.inertia import lumped, rigid_members, singular, summed_inertial
from simspec.world.kinematics import initial_state
from simspec.world.types import Inertial, Pose, World

resolve = Spec.resolve

SOLID = {"mass": 2, "inertia": {"principal": [0.3, 0.2, 0.2]}, "centre_of_mass": [0.1, 0, 0.2]}
POINT = {"mass": 1, "inertia": {"principal": [0, 0, 0]}}
ROD = {"mass": 1, "inertia": {"principal": [1, 1, 0]}}
HINGE = {"type": "hinge", "axis": [0, 0, 1]}


def on(parent, *xyz, **joint):
    return {"parent": parent, "joint": {"type": "fixed", **({"origin": {"xyz": list(xyz)}} if xyz else {}), **joint}}


def world(bodies) -> World:
    contact = {"materials": {"m": {"friction": 0.5}}}
    return resolve(Spec.from_data({"name": "x", "contact": contact, "bodies": bodies}))


def problems(bodies):
    with pytest.raises(SpecError) as error:
        world(bodies)
    return [(problem.path, problem.message) for problem in error.value.problems]


ALLOWED = {
    "a root with a welded body": {"base": {}, "inertia": {**SOLID, **on("base")}},
    "a chain": {"a": {}, "b": on("a"), "c": {**SOLID, **on("b")}, "d": on("c"), "e": on("d", 1, 0, 0)},
    "on a hinge": {"arm": {"joint": HINGE}, "weight": {**SOLID, **on("arm", 0, 0, 1)}},
    "with a shape and a child on a joint": {
        "a": {"shapes": [{"box": {"size": [1, 1, 1]}, "material": "m"}]},
        "b": {**SOLID, **on("a")},
        "c": {**SOLID, "parent": "a", "joint": HINGE},
    },
    "a shape of density zero": {
        "a": SOLID,
        "b": {"shapes": [{"sphere": {"radius": 1}, "material": "m", "density": 0}], **on("a")},
    },
    "mass 0": {"a": {"mass": 0}, "b": {**SOLID, **on("a")}},
    "a point mass": {"a": SOLID, "b": {**POINT, **on("a", 1, 2, 3)}},
    "two crossed rods": {"a": ROD, "b": {**ROD, **on("a", origin={"rpy": [1.5, 0, 0]})}},
    "three points": {"a": POINT, "b": {**POINT, **on("a", 1, 0, 0)}, "c": {**POINT, **on("a", 0, 1, 0)}},
}


@pytest.mark.parametrize("name", ALLOWED)
def test_a_rigid_group_needs_a_regular_total_inertia(name):
    found = world(ALLOWED[name])
    tops = rigid_members(found.bodies)
    for members in tops.values():
        whole = summed_inertial((body.inertial, pose) for body, pose in members)
        assert not singular(whole)
        assert np.linalg.eigvalsh(Oracle(found).mass_matrix(initial_state(found)[0])).min() > 0.0


REFUSED = {
    "no mass in the group": ({"a": {}, "b": on("a")}, "bodies.a", "neither this one nor what is fixed to it"),
    "below a joint, though the group above has one": (
        {"a": SOLID, "b": {"parent": "a", "joint": HINGE}, "c": on("b")},
        "bodies.b",
        "neither this one nor",
    ),
    "a lone body": ({"a": {}}, "bodies.a", "a moving body needs a mass"),
    "a lone point": ({"a": POINT}, "bodies.a.inertia", "must be above 0"),
    "a point and nothing": ({"a": POINT, "b": on("a")}, "bodies.a", "principal moments of this body and what is fixed"),
    "two points": ({"a": POINT, "b": {**POINT, **on("a", 1, 0, 0)}}, "bodies.a", "principal moments"),
    "two rods on one line": ({"a": ROD, "b": {**ROD, **on("a", 0, 0, 1)}}, "bodies.a", "principal moments"),
    "inertia without mass": (
        {"a": {"mass": 0, "inertia": {"principal": [1, 1, 1]}}, "b": {**SOLID, **on("a")}},
        "bodies.a.inertia",
        "without mass has no moments",
    ),
    "mass without moments": ({"a": SOLID, "b": {"mass": 1, **on("a")}}, "bodies.b", "needs moments of inertia"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_joints_with_singular_inertia_are_rejected_at_their_location(name):
    bodies, path, message = REFUSED[name]
    ((at, said),) = problems(bodies)
    assert at == path
    assert message in said


def test_a_model_without_mass_may_be_attached_to_a_carrier():
    tool = {"bodies": {"flange": {}, "tip": on("flange", 0, 0, 0.1)}, "attach": "arm/link"}
    arm = {"bodies": {"base": {"fixed": True}, "link": {**SOLID, "parent": "base", "joint": HINGE}}}
    found = resolve(Spec.from_data({"name": "x", "models": {"arm": arm, "tool": tool}}))
    assert [body.inertial.mass for body in found.bodies] == [0.0, 2.0, 0.0, 0.0]
    light = {"bodies": {"base": {"fixed": True}, "link": {**POINT, "parent": "base", "joint": HINGE}}}
    with pytest.raises(SpecError, match="above 0"):
        resolve(Spec.from_data({"name": "x", "models": {"arm": light, "tool": tool}}))


def test_combined_inertias_move_as_their_members():
    """The whole of a group on its topmost body has the mass matrix and the bias force of its members."""
    meant = worlds.weightless()
    inertials = lumped(meant)
    assert inertials
    other = dataclasses.replace(
        meant,
        bodies=tuple(
            dataclasses.replace(body, inertial=inertials.get(body.name, body.inertial)) for body in meant.bodies
        ),
    )
    assert not lumped(other)
    q, v = random_states(meant, 2)
    for row in range(2):
        oracle, two = Oracle(meant), Oracle(other)
        np.testing.assert_allclose(oracle.mass_matrix(q[row]), two.mass_matrix(q[row]), rtol=0, atol=1e-13)
        np.testing.assert_allclose(
            oracle.bias_force(q[row], v[row]), two.bias_force(q[row], v[row]), rtol=0, atol=1e-11
        )
        np.testing.assert_allclose(oracle.body_poses(q[row]), two.body_poses(q[row]), rtol=0, atol=1e-13)


def test_only_required_inertias_are_combined():
    assert not lumped(worlds.tool_frame()), "a body without mass below one with mass"
    assert not lumped(worlds.every_joint())
    assert set(lumped(worlds.point_mass())) == {"link0", "link1"}


def test_sums_are_those_of_the_parallel_axis_theorem():
    generator = np.random.default_rng(3)
    parts = []
    for _ in range(4):
        points, masses = generator.normal(size=(5, 3)), generator.uniform(0.1, 1.0, 5)
        parts.append((points, masses))

    def of(points, masses):
        centre = masses @ points / masses.sum()
        away = points - centre
        full = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, away, strict=True))
        tensor = (full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2])
        return Inertial(float(masses.sum()), tuple(centre), tensor)

    shifted = [Pose(tuple(generator.normal(size=3))) for _ in parts]
    whole = summed_inertial((of(*part), pose) for part, pose in zip(parts, shifted, strict=True))
    points = np.concatenate([part[0] + np.array(pose.position) for part, pose in zip(parts, shifted, strict=True)])
    expected = of(points, np.concatenate([part[1] for part in parts]))
    assert whole.mass == pytest.approx(expected.mass)
    assert whole.centre_of_mass == pytest.approx(expected.centre_of_mass)
    assert whole.inertia == pytest.approx(expected.inertia)


def test_massless_and_singular_bodies_are_separate_features():
    used = {need.feature: need.paths for need in needs(worlds.weightless())}
    assert used[Feature.MASSLESS][0] == "bodies.link0.mass"
    assert used[Feature.INERTIA_SINGULAR][0] == "bodies.link8.inertia"
    assert not {Feature.MASSLESS, Feature.INERTIA_SINGULAR} & {need.feature for need in needs(worlds.every_joint())}
