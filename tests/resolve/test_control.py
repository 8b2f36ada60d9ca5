"""Controllers of the world: joints, gears and limits in numbers; unstable gains; shortened runs."""

from __future__ import annotations

import dataclasses
import math
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.language.load import Spec
from simspec.resolve.control import Driven, controllers
from simspec.resolve.scenario import expectations, physics, record, shortened
from simspec.world.actions import JointController
from simspec.world.canonical import canonical_json, from_plain, sha256, to_plain
from simspec.world.types import World

resolve = Spec.resolve

SOLID = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}
POST = {"fixed": True}


def joined(kind: str, name: str, **more: object) -> dict[str, object]:
    return {**SOLID, "parent": "post", "joint": {"name": name, "type": kind, "axis": [0, 0, 1], **more}}


BODIES = {
    "post": POST,
    "rail": joined("slide", "lift", armature="0.5 kg", limits={"effort": "100 N", "velocity": "1 m/s"}),
    "arm": joined("hinge", "elbow", armature=0.25, limits={"effort": "50 N m", "velocity": "2 rad/s"}),
    "hand": joined("hinge", "wrist"),
}


def spec(bodies=None, **control) -> Spec:
    return Spec.from_data({"name": "x", "bodies": bodies or BODIES, "control": control})


def driven(bodies=None, **control) -> Driven:
    """The control of a spec before the check of stability."""
    given_spec = spec(bodies, **control)
    from simspec.resolve.bodies import expand

    found = controllers(given_spec.source, expand(given_spec.source).bodies)
    assert not found.problems, "\n".join(map(str, found.problems))
    return found


def armatures(found: Driven) -> dict[str, float]:
    return {body.joint.name: body.joint.armature for body in found.bodies}


# --- which joints, which numbers ---


def test_joints_are_in_the_order_of_the_bodies():
    kp = {"wrist": 3, "lift": 1, "elbow": 2}
    (found,) = driven(robot={"joints": ["wrist", "*l*"], "kp": kp, "kd": {"w*t": 0, "lift": 0, "el*": 5}}).controllers
    assert found.joints == ("lift", "elbow", "wrist")
    assert found.kp == (1.0, 2.0, 3.0)
    assert found.kd == (0.0, 5.0, 0.0)


def test_every_field_of_the_laws():
    pd = {"joints": ["elbow"], "kp": 2, "kd": 3}
    torque = {"law": "computed-torque", "joints": ["wrist"], "natural_frequency": "60 rpm", "damping_ratio": 0.7}
    found = driven(z=pd, a={**torque, "discretisation": "implicit"})
    assert found.controllers == (
        JointController("a", ("wrist",), "computed-torque", "implicit", (), (), 2 * math.pi, 0.7, False, (None,)),
        JointController("z", ("elbow",), "pd", "explicit", (2.0,), (3.0,), 0.0, 0.0, False, (50.0,)),
    )
    (native,) = driven(n={**pd, "law": "native"}).controllers
    assert (native.law, native.discretisation, native.kp, native.kd) == ("native", "explicit", (2.0,), (3.0,))
    (compensated,) = driven(g={**pd, "gravity_compensation": True}).controllers
    assert compensated.gravity_compensation


def test_an_actuator_has_no_gains_of_other_actuators():
    (speed,) = driven(r={"actuator": "velocity", "joints": ["elbow"], "kd": 3}).controllers
    assert (speed.kp, speed.kd) == ((0.0,), (3.0,))
    (effort,) = driven(r={"actuator": "effort", "joints": ["elbow", "wrist"]}).controllers
    assert (effort.law, effort.kp, effort.kd) == ("pd", (0.0, 0.0), (0.0, 0.0))


def test_joints_of_models_and_arrays_by_their_full_names():
    bodies = {"post": POST, "arm": joined("hinge", "elbow"), "hand": joined("hinge", "wrist")}
    data = {
        "name": "x",
        "models": {"left": {"bodies": bodies}, "row": {"bodies": bodies, "array": {"line": 2, "step": [1, 0, 0]}}},
        "control": {
            "one": {"joints": ["left/*"], "kp": {"left/e*": 1, "*/wrist": 2}, "kd": 1},
            "other": {"joints": ["row_*/elbow"], "kp": 1, "kd": 1},
        },
    }
    controller, other = resolve(Spec.from_data(data)).controllers
    assert (controller.joints, controller.kp) == (("left/elbow", "left/wrist"), (1.0, 2.0))
    assert other.joints == ("row_0/elbow", "row_1/elbow")


def test_a_world_with_controllers_reads_back_from_its_text():
    world = resolve(
        spec(robot={"joints": ["elbow", "wrist"], "kp": 3, "kd": 1, "effort_limit": {"elbow": 1, "wrist": 9}})
    )
    assert from_plain(World, to_plain(world)) == world
    assert '"effort_limits":[1.0,9.0]' in canonical_json(world)
    softer = resolve(
        spec(robot={"joints": ["elbow", "wrist"], "kp": 2, "kd": 1, "effort_limit": {"elbow": 1, "wrist": 9}})
    )
    assert sha256(softer) != sha256(world)


# --- gears and limits ---

POSITIVE = st.floats(1e-3, 1e3)


@given(
    gear=st.floats(1e-2, 1e2), kp=POSITIVE, kd=POSITIVE, limit=POSITIVE, error=st.floats(-9, 9), speed=st.floats(-9, 9)
)
def test_a_geared_actuator_applies_the_effort_of_its_controller(gear, kp, kd, limit, error, speed):
    """The actuator turns g times as far and as fast as the joint, and its effort counts g times at the joint."""
    numbers = {"kp": kp, "kd": kd, "effort_limit": limit, "gear": gear}
    (found,) = driven(r={"joints": ["wrist"], **numbers}).controllers
    at_motor = max(-limit, min(limit, kp * (gear * error) + kd * (gear * speed)))
    (most,) = found.effort_limits
    at_joint = max(-most, min(most, found.kp[0] * error + found.kd[0] * speed))
    scale = gear * (kp * gear * abs(error) + kd * gear * abs(speed))  # the two terms may cancel
    assert at_joint == pytest.approx(gear * at_motor, rel=1e-12, abs=1e-12 * scale + 1e-300)  # and may be subnormal


@given(gear=st.floats(1e-2, 1e2), rotor=POSITIVE, rate=POSITIVE)
def test_a_rotor_has_the_energy_of_its_armature(gear, rotor, rate):
    found = driven(r={"joints": ["elbow"], "kp": 1, "kd": 1, "gear": gear, "rotor_inertia": rotor})
    turning = 0.5 * rotor * (gear * rate) ** 2
    assert 0.5 * (armatures(found)["elbow"] - 0.25) * rate**2 == pytest.approx(turning, rel=1e-9, abs=1e-12 * rate**2)
    assert armatures(found)["lift"] == 0.5


def test_gears_and_rotors_of_each_joint():
    control = {
        "joints": ["*"],
        "kp": {"lift": 1, "elbow": 1, "wrist": 1},
        "kd": {"lift": 1, "elbow": 1, "wrist": 1},
        "gear": {"lift": 2, "elbow": 10, "w*": 100},
        "rotor_inertia": {"lift": "3 g", "elbow": "1e-4 kg m^2", "wrist": 0},
    }
    found = driven(r=control)
    assert found.controllers[0].kp == (4.0, 100.0, 10000.0)
    assert armatures(found) == pytest.approx({"post_joint": 0.0, "lift": 0.512, "elbow": 0.26, "wrist": 0.0}, rel=1e-15)
    assert resolve(spec(r={**control, "discretisation": "implicit"})).bodies == found.bodies


@pytest.mark.parametrize(
    ("law", "gains"),
    [("pd", {"kp": 1, "kd": 1}), ("native", {"kp": 1, "kd": 1}), ("computed-torque", {"natural_frequency": 9})],
)
def test_the_smaller_limit_holds(law, gains):
    """The joint's own: 50 N m, 2 rad/s; at the wrist none."""
    for limit, gear, elbow, wrist in (
        (None, 1, 50, None),
        (30, 1, 30, 30),
        (60, 1, 50, 60),
        (20, 2, 40, 40),
        (30, 2, 50, 60),
    ):
        more = {} if limit is None else {"effort_limit": f"{limit} N m"}
        (found,) = driven(r={"law": law, "joints": ["elbow", "wrist"], **gains, "gear": gear, **more}).controllers
        assert found.effort_limits == (elbow, wrist)


@pytest.mark.parametrize(
    ("limit", "gear", "elbow", "wrist"),
    [(None, 1, 2, None), (1.5, 1, 1.5, 1.5), (3, 1, 2, 3), (3, 2, 1.5, 1.5), (8, 2, 2, 4)],
)
def test_the_smaller_speed_is_the_trajectorys(limit, gear, elbow, wrist):
    more = {} if limit is None else {"velocity_limit": limit}
    found = driven(r={"joints": ["elbow", "wrist"], "kp": 1, "kd": 1, "gear": gear, **more})
    wanted = {"lift": 1.0, "elbow": elbow} | ({} if wrist is None else {"wrist": wrist})
    assert found.velocity_limits == wanted
    assert [body.joint.velocity_limit for body in found.bodies] == [None, 1.0, 2.0, None]


# --- stability ---

GAINS = {"joints": ["elbow"], "kp": "400 N m/rad", "kd": "30 N m s/rad"}
ARM = {"post": POST, "arm": joined("hinge", "elbow")}
LARGEST = (-60 + math.sqrt(60**2 + 4 * 400 * 4)) / 800
"""dt² kp/I + 2 dt kd/I = 4 at I = 1 kg m²."""


def at(timestep, control=GAINS, bodies=ARM):
    data = {"name": "x", "physics": {"timestep": timestep}, "bodies": bodies, "control": {"robot": control}}
    return resolve(Spec.from_data(data))


def test_an_unstable_law_is_refused_with_the_largest_step_that_holds():
    at(0.999 * LARGEST)
    with pytest.raises(SpecError) as caught:
        at(1.1 * LARGEST)
    (problem,) = caught.value.problems
    assert problem.path == "control.robot"
    assert "unstable at this timestep" in problem.message
    assert float(problem.allowed.removeprefix("up to ").removesuffix(" s")) == pytest.approx(LARGEST, rel=2e-3)
    assert f"{1.1 * LARGEST:g} s" in problem.found
    assert "discretisation: implicit" in problem.hint


def test_an_implicit_law_is_stable_at_the_same_step():
    at(1.1 * LARGEST, {**GAINS, "discretisation": "implicit"})


def test_a_rotor_makes_a_law_stable():
    with pytest.raises(SpecError, match="unstable"):
        at(1.1 * LARGEST, {**GAINS, "rotor_inertia": 0})
    at(1.1 * LARGEST, {**GAINS, "rotor_inertia": "0.3 kg m^2"})


@pytest.mark.parametrize(
    "law",
    [
        {"law": "computed-torque", "natural_frequency": 5},
        {"law": "pd", "kp": 1, "kd": 1, "gravity_compensation": True},
        {"law": "pd", "kp": 1, "kd": 1, "discretisation": "implicit"},
    ],
)
def test_a_law_that_needs_the_dynamics_of_a_tree_that_has_none_is_refused_at_its_place(law):
    ball = {**SOLID, "parent": "hand", "joint": {"type": "ball"}}
    bodies = {**BODIES, "eye": ball}
    with pytest.raises(SpecError, match="needs a tree of hinges and slides") as caught:
        spec(bodies, robot={"joints": ["elbow"], **law}).resolve()
    (problem,) = caught.value.problems
    assert problem.path == "control.robot"
    assert problem.found == "bodies.eye, with a ball joint"
    spec(bodies, robot={"joints": ["elbow"], "law": "pd", "kp": 1, "kd": 1}).resolve()
    spec(BODIES, robot={"joints": ["elbow"], **law}).resolve()


def test_on_a_free_base_no_hint_names_a_law_that_is_refused_there():
    """A change that follows the hint of the error causes no other error."""
    free = {**ARM, next(iter(ARM)): {key: value for key, value in SOLID.items() if key != "fixed"}}
    step = 1.1 * LARGEST
    with pytest.raises(SpecError, match="unstable at this timestep") as caught:
        at(step, GAINS, free)
    (problem,) = caught.value.problems
    assert "implicit" not in problem.hint
    with pytest.raises(SpecError, match="needs a tree of hinges and slides") as caught:
        at(step, {**GAINS, "discretisation": "implicit"}, free)
    (problem,) = caught.value.problems
    largest = float(problem.hint.partition("physics.timestep of ")[2].partition(" s")[0])
    assert largest < step
    at(0.99 * largest, GAINS, free)


def test_an_instability_at_any_timestep_is_reported(monkeypatch):
    from simspec.control import stability

    monkeypatch.setattr(stability, "unstable", lambda world: [stability.ControlInstability("robot", 0.001, 0.0, 1.5)])
    with pytest.raises(SpecError) as caught:
        at(0.001)
    assert "any timestep" in caught.value.problems[0].allowed


def test_a_spring_without_damping_is_not_called_unstable():
    """Semi-implicit Euler keeps its energy: k dt² < 4 I is enough."""
    at(0.09, {**GAINS, "kd": 0})
    with pytest.raises(SpecError, match="unstable"):
        at(0.11, {**GAINS, "kd": 0})


def test_controllers_that_are_unstable_only_together_are_both_named(monkeypatch):
    from simspec.control import stability

    instability = stability.ControlInstability("first, second", 0.001, 0.0005, 1.5)
    monkeypatch.setattr(stability, "unstable", lambda world: [instability])
    gains = {"kp": 1, "kd": 1}
    with pytest.raises(SpecError) as caught:
        resolve(spec(second={"joints": ["elbow"], **gains}, first={"joints": ["wrist"], **gains}))
    (problem,) = caught.value.problems
    assert problem.path == "control.first"
    assert "of first and second are together unstable" in problem.message


def test_without_the_library_of_dynamics_the_way_out_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert resolve(Spec.from_data({"name": "x", "bodies": ARM})).controllers == ()
    with pytest.raises(SpecError) as caught:
        at(0.001)
    (problem,) = caught.value.problems
    assert problem.path == "control"
    assert "pinocchio" in problem.message
    assert problem.hint == "pip install 'simspec-physics[pin]'"


# --- trajectory.until ---

PLACE = {"body": "arm", "xyz": [0, 0, 0], "tolerance": 1}
FOR_ALL_TIMES = [
    {"energy_never_rises": {"tolerance": 1}},
    {"no_penetration_deeper_than": {"depth": 1}},
    {"stays_within": {"body": "arm", "lower": [0, 0, 0], "upper": [1, 1, 1]}},
    {"bodies_apart": {"first": "arm", "second": "post", "at_least": 0}},
    {"follows_oracle": {"tolerance": 1}},
]
OF_THE_END = [
    {"position": PLACE},
    {"at_target": {"targets": {"arm": [0, 0, 0]}, "tolerance": 1}},
    {"displacement": {"body": "arm", "distance": 1, "tolerance": 1}},
    {"angular_speed": {"body": "arm", "speed": 1, "tolerance": 1}},
    {"comes_to_rest": {"speed": 1}},
    {"apex_height": {"body": "arm", "height": 1, "tolerance": 1, "after": 0}},
]


def kept_expectations(expect, until, **more) -> list[str]:
    """The expectations of a run of 10 s that ends at ``until``."""
    data = {"name": "x", "bodies": ARM, "expect": expect, "physics": {"duration": 10}, **more}
    found = Spec.from_data(data)
    whole = physics(found.data.physics)
    time = shortened(whole, until)
    from simspec.resolve.bodies import expand

    kept, problems = expectations(
        found.source, expand(found.source).bodies, whole, time, record(found.data.record, time)
    )
    if problems:
        raise SpecError(problems)
    return [expectation.kind for expectation in kept]


@pytest.mark.parametrize(("until", "steps"), [(None, 10000), (4.0, 4000), (10.0, 10000), (60.0, 10000)])
def test_a_run_ends_at_the_earlier_time(until, steps):
    whole = physics(Spec.from_data({"name": "x", "bodies": ARM, "physics": {"duration": 10}}).data.physics)
    assert shortened(whole, until).steps == steps
    assert shortened(whole, until).timestep == whole.timestep


def test_a_shortened_run_has_no_expectations_of_its_end():
    everything = [*FOR_ALL_TIMES, *OF_THE_END]
    names = [next(iter(entry)) for entry in everything]
    assert (
        kept_expectations(everything, None)
        == kept_expectations(everything, 10.0)
        == kept_expectations(everything, 11.0)
        == names
    )
    assert kept_expectations(everything, 4.0) == [next(iter(time)) for time in FOR_ALL_TIMES]


@pytest.mark.parametrize(("at_time", "kept"), [(3.0, True), (4.0, True), (4.001, False), (10.0, False)])
def test_only_expectations_within_the_run_are_kept(at_time, kept):
    expect = [{"position": {**PLACE, "at": at_time}}, {"comes_to_rest": {"speed": 1, "before": at_time}}]
    expect.append({"at_target": {"targets": {"arm": [0, 0, 0]}, "tolerance": 1, "at": at_time}})
    assert kept_expectations(expect, 4.0) == (["position", "comes_to_rest", "at_target"] if kept else [])


def test_dropped_expectations_are_validated_too():
    with pytest.raises(SpecError, match="after the end of the run"):
        kept_expectations([{"position": {**PLACE, "at": 11}}], 4.0)
    with pytest.raises(SpecError, match="no body 'amr'"):
        kept_expectations([{"position": {**PLACE, "body": "amr"}}], 4.0)
    with pytest.raises(SpecError, match="nothing is recorded"):
        kept_expectations([{"position": {**PLACE, "at": 7.5}}], 4.0, record={"every": 1})


def test_the_end_of_the_cut_run_is_recorded():
    expect = [{"position": {**PLACE, "at": 4.5}}]
    assert kept_expectations(expect, 4.5, record={"every": 1}) == ["position"]
    with pytest.raises(SpecError, match="nothing is recorded"):
        kept_expectations(expect, None, record={"every": 1})


def reaching(**more):
    """A scenario of 10 s whose trajectory says when the run ends."""
    points = [{"at": 0, "positions": {"elbow": 0}}, {"at": 10, "positions": {"elbow": 0.4}}]
    return {
        "name": "x",
        "bodies": ARM,
        "physics": {"duration": 10},
        "control": {"robot": {**GAINS, "kp": 4, "kd": 1}},
        "trajectory": {"points": points, **more},
        "expect": [{"position": PLACE}, {"energy_never_rises": {"tolerance": 1}}],
    }


def test_until_cuts_the_run_and_nothing_else():
    whole, short = (resolve(Spec.from_data(reaching(**more))) for more in ({}, {"until": "2.5 s"}))
    assert (whole.physics.steps, short.physics.steps) == (10000, 2500)
    assert [expectation.kind for expectation in short.expectations] == ["energy_never_rises"]
    assert dataclasses.replace(short, physics=whole.physics, expectations=whole.expectations) == whole


@pytest.mark.parametrize(("until", "allowed"), [("0.5 ms", "0.001 s"), (2.0004, "2.0 s or 2.001 s")])
def test_until_is_a_whole_number_of_steps(until, allowed):
    with pytest.raises(SpecError) as caught:
        Spec.from_data(reaching(until=until))
    (problem,) = caught.value.problems
    assert problem.path == "trajectory.until"
    assert allowed in problem.allowed


# --- at_target ---


def test_targets_of_many_bodies_are_sorted_pairs():
    targets = {"hand": [0, 0, "1 cm"], "arm": [1, 2, 3]}
    data = {"name": "x", "bodies": BODIES, "expect": [{"at_target": {"targets": targets, "tolerance": "1 cm"}}]}
    world = resolve(Spec.from_data(data))
    (found,) = world.expectations
    assert dict(found.parameters) == {
        "targets": (("arm", (1.0, 2.0, 3.0)), ("hand", (0.0, 0.0, 0.01))),
        "tolerance": 0.01,
    }
    assert hash(found) is not None
    assert from_plain(World, to_plain(world)) == world


@pytest.mark.parametrize(
    ("targets", "path", "message"),
    [
        ({"amr": [0, 0, 0]}, "targets.amr", "there is no body 'amr'"),
        ({"arm": [0, 0]}, "targets.arm", "expected a list of 3 lengths"),
        ({"arm": [0, 0, "1 s"]}, "targets.arm.2", "wrong unit"),
        ({"a b": [0, 0, 0]}, "targets.a b", "not a valid name"),
        ({}, "targets", "expected places by"),
        ([0, 0, 0], "targets", "expected places by"),
    ],
)
def test_targets_that_are_none(targets, path, message):
    data = {"name": "x", "bodies": ARM, "expect": [{"at_target": {"targets": targets, "tolerance": 1}}]}
    with pytest.raises(SpecError) as caught:
        resolve(Spec.from_data(data))
    (problem,) = caught.value.problems
    assert problem.path == f"expect.0.at_target.{path}"
    assert message in problem.message
