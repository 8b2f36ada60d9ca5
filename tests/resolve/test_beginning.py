"""Joints begin within their limits: a spec that says otherwise is refused with the nearest value, an imported model begins there."""

# ruff: noqa: E501 (a case is a line)
from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import simspec
from simspec.errors import SpecError
from simspec.language.beginning import AT_LIMITS
from simspec.language.joints import EDGE, nearest, within
from simspec.world.types import World
from tests.imports.sdf.texts import joint, link, model
from tests.imports.urdf.robots import two_links

BODY = "mass: 1, inertia: {principal: [1, 1, 1]}"
ARM = f"arm: {{{BODY}, joint: {{type: hinge, axis: [0, 0, 1], limits: {{position: [0.3, 1]}}}}}}"


def spec(folder, text: str):
    (folder / "spec.yaml").write_text(f"simspec: 1\nname: s\n{text}\n")
    return simspec.load(folder / "spec.yaml")


def refused(folder, text: str) -> list[tuple[str, str | None, str | None]]:
    """(path, found, hint) of each problem that is about limits."""
    with pytest.raises(SpecError) as error:
        spec(folder, text).resolve()
    assert all("beyond" in problem.message for problem in error.value.problems), error.value
    assert all(problem.location is not None and problem.location.line > 2 for problem in error.value.problems), (
        error.value
    )
    return [(problem.path, problem.found, problem.hint) for problem in error.value.problems]


@pytest.mark.parametrize(
    ("kind", "limits", "position", "hint"),
    [
        ("hinge", "[0.3, 1]", "", "position: 0.3, "),
        ("slide", "[-1, -0.1]", "", "position: -0.1, "),
        ("hinge", "[0.3, 1]", ", position: 90 deg", "1.0, the nearest"),
        ("slide", "[10 mm, 20 mm]", ", position: 0", "0.01, the nearest"),
        ("slide", "[0, 0.1]", ", position: -1.0e-5", "0.0, the nearest"),
        ("ball", "60 deg", ", position: {rpy: [0, 90 deg, 0]}", "{quat: [0.866025404, 0, 0.5, 0]}, the nearest"),
    ],
)
def test_a_position_beyond_its_limits_is_refused_with_the_nearest(tmp_path, kind, limits, position, hint):
    word, axis = ("angle", "") if kind == "ball" else ("position", ", axis: [0, 0, 1]")
    body = f"bodies:\n  arm: {{{BODY}, joint: {{type: {kind}{axis}, limits: {{{word}: {limits}}}{position}}}}}"
    ((path, _, said),) = refused(tmp_path, body)
    assert path == "bodies.arm.joint.position"
    assert hint in said


def test_a_placement_and_a_state_are_refused_alike(tmp_path):
    limited = f"bodies: {{{ARM}}}"
    ((path, found, hint),) = refused(tmp_path, f"models:\n  m: {{{limited}, positions: {{arm_joint: 0.2}}}}")
    assert (path, found) == ("models.m.positions.arm_joint", "0.2")
    assert "0.3, the nearest" in hint
    state = "states: {low: {positions: {arm_joint: 2}}}, state: low"
    ((path, found, hint),) = refused(tmp_path, f"models:\n  m: {{{limited}, {state}}}")
    assert (path, found) == ("models.m.states.low.positions.arm_joint", "2")
    assert "1.0, the nearest" in hint
    world = spec(tmp_path, f"models:\n  m: {{{limited}, positions: {{arm_joint: 0.4}}}}").resolve()
    assert world.bodies[0].joint.position == (0.4,)


def test_a_fault_in_copies_of_a_model_is_reported_once(tmp_path):
    body = f"models:\n  m: {{bodies: {{{ARM}}}, array: {{grid: [5, 1, 1], spacing: [1, 1, 1]}}}}"
    assert len(refused(tmp_path, body)) == 1


def test_a_follower_beyond_its_limits_names_where_its_leader_may_be(tmp_path):
    bodies = (
        "bodies:\n  base: {fixed: true}\n"
        f"  a: {{{BODY}, parent: base, joint: {{type: hinge, axis: [0, 0, 1], limits: {{position: [-1, 1]}}}}}}\n"
        f"  b: {{{BODY}, parent: base, joint: {{type: hinge, axis: [0, 0, 1], limits: {{position: [0.5, 1]}}}}}}\n"
    )
    text = "constraints:\n  c: {follow: {joint: b_joint, leader: a_joint, ratio: -2}}"
    ((path, found, hint),) = refused(tmp_path, bodies + text)
    assert (path, found) == ("constraints.c.follow", "0")
    assert "a_joint at -0.25, the nearest" in hint
    ((_, _, hint),) = refused(tmp_path, bodies + text.replace("-2", "-0.2"))  # a_joint would have to be at -2.5
    assert "another initial position of a_joint" in hint


@settings(deadline=None, max_examples=200)
@given(
    st.floats(-1e4, 1e4),
    st.floats(0.0, 1e3),
    st.floats(-1e4, 1e4),
)
def test_only_round_off_is_taken_for_the_limit(lower, width, position):
    limits = (lower, lower + width)
    found = within(position, limits)
    away = abs(position - nearest(position, limits))
    if limits[0] <= position <= limits[1]:
        assert found == position
    elif away > EDGE * max(1.0, abs(lower), abs(limits[1])):
        assert found is None
    for limit in limits:
        for beyond in (math.nextafter(limit, -math.inf), math.nextafter(limit, math.inf)):
            allowed = within(beyond, limits)
            assert allowed is not None
            assert limits[0] <= allowed <= limits[1]


def test_degrees_that_are_rounded_begin_at_the_limit(tmp_path):
    """-90 deg is 2e-10 below a limit that is written with ten digits."""
    hinge = "joint: {type: hinge, axis: [0, 0, 1], limits: {position: [-1.5707963266, 1]}, position: -90 deg}"
    world = spec(tmp_path, f"bodies:\n  arm: {{{BODY}, {hinge}}}").resolve()
    assert world.bodies[0].joint.position == (-1.5707963266,)


# --- imported files -------------------------------------------------------------------------------------------------


def begins(world: World) -> list[float]:
    return [body.joint.position[0] for body in world.bodies if body.joint.position_limits is not None]


MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="base"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<joint name="thumb" axis="0 0 1" range="0.3 1" limited="true"/>
<body name="tip"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="tip" type="ball" range="0 0.5" limited="true"/></body>
</body></worldbody>
<keyframe><key name="low" qpos="0.1 1 0 0 0"/><key name="far" qpos="0.5 0 1 0 0"/></keyframe></mujoco>"""
USD = """#usda 1.0
(metersPerUnit = 1)
def Sphere "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]) {}
def Sphere "b" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]) {}
def PhysicsRevoluteJoint "thumb" {
    rel physics:body0 = </a>
    rel physics:body1 = </b>
    uniform token physics:axis = "Z"
    float physics:lowerLimit = 17.188733853924695
    float physics:upperLimit = 90
}
"""
AXIS = "<axis><xyz>0 1 0</xyz><limit><lower>0.3</lower><upper>1</upper></limit></axis>"
FILES = {
    "robot.urdf": two_links(
        '<axis xyz="0 0 1"/><limit lower="0.3" upper="1" effort="1" velocity="1"/>', kind="revolute"
    ),
    "robot.sdf": model(link("base") + link("arm") + joint("revolute", AXIS)),
    "robot.xml": MJCF,
    "robot.usda": USD,
}


@pytest.mark.parametrize("name", FILES)
def test_an_imported_model_begins_within_its_limits_and_says_so(tmp_path, name):
    if name.endswith("usda"):
        pytest.importorskip("pxr")
    (tmp_path / name).write_text(FILES[name])
    material = "contact: {materials: {m: {friction: 1}}}\n" if name.endswith("usda") else ""
    placed = spec(tmp_path, f"{material}models:\n  r: {{use: {name}}}")
    world = placed.resolve()
    (position,) = begins(world)
    assert position == pytest.approx(0.3, abs=1e-6)
    moved = [problem for problem in placed.warnings() if problem.message == AT_LIMITS]
    assert len(moved) == 1
    assert moved[0].location.file.endswith(name)
    assert "at 0.3 (not 0)" in moved[0].found
    joint_name = next(body.joint.name for body in world.bodies if body.joint.position_limits).split("/")[1]
    stated = spec(tmp_path, f"{material}models:\n  r: {{use: {name}, positions: {{{joint_name}: 0.5}}}}")
    assert begins(stated.resolve()) == [0.5]
    assert [problem for problem in stated.warnings() if problem.message == AT_LIMITS] == []


def test_a_key_beyond_limits_is_a_state_at_the_limits(tmp_path):
    (tmp_path / "robot.xml").write_text(MJCF)
    low = spec(tmp_path, "models:\n  r: {use: robot.xml, state: low}")
    assert begins(low.resolve()) == [0.3]
    far = spec(tmp_path, "models:\n  r: {use: robot.xml, state: far}")
    tip = far.resolve().bodies[1].joint
    assert begins(far.resolve()) == [0.5]
    assert tip.position == pytest.approx((math.cos(0.25), math.sin(0.25), 0.0, 0.0))
    for placed, said in ((low, "low: thumb at 0.3 (not 0.1)"), (far, "far: tip at 0.5 (not 3.14159)")):
        (moved,) = (problem for problem in placed.warnings() if problem.message == AT_LIMITS)
        assert moved.found == said


def test_a_loop_that_begins_beyond_limits_is_refused(tmp_path):
    """Another position of one of its joints would open it."""
    upright = "<axis><xyz>0 1 0</xyz>{}</axis>"
    limited = upright.format("<limit><lower>0.3</lower><upper>1</upper></limit>")
    parts = [
        joint("fixed", name="hold", parent="world", child="base"),
        joint("revolute", limited, "a", "base", "crank"),
        joint("revolute", upright.format(""), "b", "base", "rocker"),
        joint("revolute", upright.format(""), "c", "crank", "rod"),
        joint("ball", "<pose>2 0 0 0 0 0</pose>", "d", "rocker", "rod"),
    ]
    links = [
        link("base"),
        link("crank", "<pose>0 0 0 0 0 0</pose>"),
        link("rocker", "<pose>2 0 0 0 0 0</pose>"),
        link("rod", "<pose>0 0 1 0 0 0</pose>"),
    ]
    (tmp_path / "robot.sdf").write_text(model("".join(links + parts)))
    with pytest.raises(SpecError, match="r/a: the initial position is beyond the joint's limits") as error:
        spec(tmp_path, "models:\n  r: {use: robot.sdf}").resolve()
    (problem,) = error.value.problems
    assert problem.location.file.endswith("robot.sdf")
    assert "position: 0.3" in problem.hint
