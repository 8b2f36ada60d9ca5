"""Named initial states: the world begins where the chosen one says, the nearer one holds, and what is wrong has its place."""

from __future__ import annotations

import math

import pytest

import simspec
from simspec.errors import SpecError
from simspec.world.types import Joint, World

SOLID = "mass: 1, inertia: {principal: [1, 1, 1]}"
MODEL = f"""simspec: 1
name: arm
model:
  bodies:
    base: {{{SOLID}, pose: {{xyz: [0, 0, 1]}}, velocity: {{linear: [1, 0, 0]}}}}
    upper:
      parent: base
      mass: 1
      inertia: {{principal: [1, 1, 1]}}
      joint: {{name: shoulder, type: hinge, axis: [0, 1, 0], position: 0.1, velocity: 0.2, limits: {{position: [-1, 2]}}}}
    fore: {{parent: upper, {SOLID}, joint: {{name: elbow, type: ball}}}}
  states:
    home: {{positions: {{shoulder: 90 deg}}, pose: {{xyz: [0, 0, 2]}}}}
    moving: {{velocities: {{shoulder: 3}}, velocity: {{angular: [0, 0, 1]}}, positions: {{elbow: {{quat: [0, 1, 0, 0]}}}}}}
"""


def scenario(folder, placed: str, model: str = MODEL, sets: tuple[str, ...] = ()) -> World:
    (folder / "arm.yaml").write_text(model, encoding="utf-8")
    (folder / "placed.yaml").write_text(
        f"simspec: 1\nname: placed\nmodels:\n  a: {{use: arm.yaml, {placed}}}\n", encoding="utf-8"
    )
    return simspec.load(folder / "placed.yaml", sets=sets).resolve()


def joints(world: World) -> tuple[Joint, Joint, Joint]:
    base, upper, fore = (body.joint for body in world.bodies)
    return base, upper, fore


def test_a_state_replaces_the_quantities_that_it_names(tmp_path):
    base, upper, fore = joints(scenario(tmp_path, "state: home, pose: {xyz: [5, 0, 0]}"))
    assert base.position[:3] == (5.0, 0.0, 2.0)
    assert base.velocity[:3] == (1.0, 0.0, 0.0)
    assert (upper.position, upper.velocity) == ((math.pi / 2,), (0.2,))
    assert fore.position == (1.0, 0.0, 0.0, 0.0)
    base, upper, fore = joints(scenario(tmp_path, "state: moving, pose: {rpy: [90 deg, 0, 0]}"))
    assert base.velocity == pytest.approx((0.0, 0.0, 0.0, 0.0, -1.0, 0.0))  # in the model's axes, which are turned
    assert (upper.position, upper.velocity) == ((0.1,), (3.0,))
    assert fore.position == (0.0, 1.0, 0.0, 0.0)


def test_a_placement_overrides_the_state_of_the_model(tmp_path):
    _, upper, fore = joints(scenario(tmp_path, "state: moving, positions: {shoulder: 0.7}, velocities: {shoulder: 0}"))
    assert (upper.position, upper.velocity, fore.position) == ((0.7,), (0.0,), (0.0, 1.0, 0.0, 0.0))


def test_the_nearer_state_of_a_name_holds(tmp_path):
    _, upper, _ = joints(scenario(tmp_path, "state: home, states: {home: {positions: {shoulder: 1}}}"))
    assert upper.position == (1.0,)
    text = "states: {home: {positions: {shoulder: 0.5}}}"
    between = f"simspec: 1\nname: between\nmodel:\n  use: arm.yaml\n  state: home\n  {text}\n"
    (tmp_path / "between.yaml").write_text(between, encoding="utf-8")
    (tmp_path / "arm.yaml").write_text(MODEL, encoding="utf-8")
    _, alone, _ = joints(simspec.load(tmp_path / "between.yaml").resolve())
    (tmp_path / "top.yaml").write_text("simspec: 1\nname: top\nmodels:\n  a: {use: between.yaml}\n", encoding="utf-8")
    _, used, _ = joints(simspec.load(tmp_path / "top.yaml").resolve())
    assert alone.position == used.position == (0.5,)
    _, other, _ = joints(simspec.load(tmp_path / "top.yaml", sets=["models.a.state=moving"]).resolve())
    assert other.velocity == (3.0,)


def test_an_unused_state_changes_nothing(tmp_path):
    without = MODEL[: MODEL.index("  states:")]
    assert scenario(tmp_path, "pose: {xyz: [0, 0, 0]}") == scenario(tmp_path, "pose: {xyz: [0, 0, 0]}", without)


def test_the_place_of_a_value_is_that_of_the_state(tmp_path):
    scenario(tmp_path, "state: home")
    place = simspec.load(tmp_path / "placed.yaml").locate("bodies.a/upper.joint.position")
    assert place is not None
    assert str(place.file).endswith("arm.yaml")
    assert place.line == MODEL[: MODEL.index("home:")].count("\n") + 1


@pytest.mark.parametrize(
    ("placed", "message"),
    [
        ("state: hom", "the model has no state 'hom'"),
        ("state: 3", "state"),
        ("states: {low: {positions: {shoulder: 3}}}", "beyond the joint's limits"),
        ("states: {low: {positions: {wrist: 3}}}", "the model has no joint 'wrist'"),
        ("states: {low: {positions: {shoulder: 3 m}}}", "expected an angle"),
        ("states: {low: {poses: {}}}", "unknown key"),
        ("states: {low: 3}", "low"),
        ("fixed: true, state: moving", "velocity"),
    ],
)
def test_errors_are_reported_at_their_location(tmp_path, placed, message):
    with pytest.raises(SpecError) as error:
        scenario(tmp_path, placed)
    assert message in str(error.value)
    assert all(problem.location is not None and problem.location.line for problem in error.value.problems)


def test_a_root_on_a_joint_has_no_pose(tmp_path):
    hinged = MODEL.replace(
        f"base: {{{SOLID}, pose: {{xyz: [0, 0, 1]}}, velocity: {{linear: [1, 0, 0]}}}}",
        f"base: {{{SOLID}, joint: {{type: hinge, axis: [0, 0, 1]}}}}",
    )
    with pytest.raises(SpecError, match="has a joint to the world, so it has no pose of its own"):
        scenario(tmp_path, "fixed: false", hinged)
