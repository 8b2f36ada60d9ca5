"""Actuators of models: their laws at the joint, who acts, commands and limits; every wrong one is an error at its place."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from simspec.control.reference import efforts, positions
from simspec.errors import SpecError
from simspec.language.control import LAWS
from simspec.language.load import Spec, load
from simspec.language.trees import MOST

LINK = {"mass": 1, "inertia": {"principal": [0.1, 0.1, 0.1]}}


def scenario(actuators, controller=None, **model):
    return {
        "simspec": 1,
        "name": "acted",
        "physics": {"timestep": "1 ms", "duration": "1 s"},
        "models": {
            "arm": {
                "bodies": {
                    "base": {"fixed": True},
                    "upper": {"parent": "base", "joint": {"name": "elbow", "type": "hinge", "axis": [0, 1, 0]}, **LINK},
                    "lower": {
                        "parent": "upper",
                        "joint": {"name": "rail", "type": "slide", "axis": [0, 0, 1], "position": 0.1},
                        **LINK,
                    },
                    "tool": {"parent": "lower", "joint": {"name": "wrist", "type": "ball"}, **LINK},
                },
                "actuators": copy.deepcopy(actuators),
                **model,
            }
        },
        "control": {"robot": {"actuators": ["arm/*"], **(controller or {})}},
    }


def world(*arguments, **model):
    return Spec.from_data(scenario(*arguments, **model)).resolve()


def problems(data):
    with pytest.raises(SpecError) as raised:
        Spec.from_data(data).resolve()
    return [(problem.path, problem.message) for problem in raised.value.problems]


@pytest.mark.parametrize(
    ("actuator", "command", "kp", "kd", "target", "feed"),
    [
        ({"kp": 50}, "30 deg", 50, 0, math.pi / 6, 0),
        ({"kp": 50, "kd": 3, "gear": 2}, 0.5, 200, 12, 0.25, 0),
        ({"kp": 50, "kd": 3, "gear": -2}, 0.5, 200, 12, -0.25, 0),
        ({"law": "velocity", "kd": 3, "gear": 2}, "2 rad/s", 0, 12, 0, 12),
        ({"law": "effort", "gear": 0.5}, "4 N m", 0, 0, 0, 2),
        ({"law": "affine", "gain": 10, "bias": [1, -20, -3], "gear": -2}, 0.5, 80, 12, 0, -12),
        ({"law": "affine", "gain": 7}, 2, 0, 0, 0, 14),
    ],
)
def test_a_law_at_its_joint(actuator, command, kp, kd, target, feed):
    """g f is kp (target − q) − kd v + feed, for every q and v."""
    made = world({"a": {"joint": "elbow", **actuator}}, {"commands": {"arm/a": command}})
    (controller,) = made.controllers
    assert (controller.law, controller.joints) == ("pd", ("arm/elbow",))
    assert (controller.kp, controller.kd) == ((kp,), (kd,))
    assert made.trajectory.joints == ("arm/elbow",)
    assert made.trajectory.positions[0] == pytest.approx((target,))
    assert made.trajectory.efforts == (((feed,),) if feed else ())
    law, gear = actuator.get("law", "position"), actuator.get("gear", 1.0)
    value = {"30 deg": math.pi / 6, "2 rad/s": 2.0, "4 N m": 4.0}.get(command, command)
    gain, bias = actuator.get("gain", 1.0), actuator.get("bias", [0.0, 0.0, 0.0])
    p, d = actuator.get("kp", 0.0), actuator.get("kd", 0.0)
    for q, v in ((0.3, -0.7), (-1.1, 0.2)):
        force = {
            "position": p * (value - gear * q) - d * gear * v,
            "velocity": d * (value - gear * v),
            "effort": value,
            "affine": gain * value + bias[0] + bias[1] * gear * q + bias[2] * gear * v,
        }[law]
        assert kp * (target - q) - kd * v + feed == pytest.approx(gear * force)


def test_a_slide_without_stiffness_aims_where_it_begins():
    made = world({"a": {"joint": "rail", "law": "effort", "command": "3 N"}})
    assert made.trajectory.positions == ((0.1,),)
    assert made.trajectory.efforts == ((3.0,),)


def test_the_smaller_limit_holds_and_the_gear_counts():
    data = scenario({"a": {"joint": "elbow", "kp": 1, "gear": -3, "effort_limit": 5}})
    assert Spec.from_data(data).resolve().controllers[0].effort_limits == (15.0,)
    data["models"]["arm"]["bodies"]["upper"]["joint"]["limits"] = {"effort": 4}
    assert Spec.from_data(data).resolve().controllers[0].effort_limits == (4.0,)


def test_who_acts_is_chosen_by_name_in_every_copy():
    two = {"a": {"joint": "elbow", "kp": 1}, "b": {"joint": "rail", "kp": 2, "kd": 1}}
    made = world(two, {"actuators": ["arm/b"], "discretisation": "explicit", "every": "2 ms"})
    assert made.controllers[0].joints == ("arm/rail",)
    assert made.controllers[0].every_steps == 2
    data = scenario(two, {"actuators": ["*/a"]})
    data["models"]["arm"]["array"] = {"line": 2, "step": [1, 1, 1]}
    (controller,) = Spec.from_data(data).resolve().controllers
    assert len(controller.joints) == 2


def test_a_model_file_is_valid_alone_and_in_a_scenario(tmp_path):
    (tmp_path / "pyproject.toml").touch()
    text = """simspec: 1
name: arm
model:
  bodies:
    base: {fixed: true}
    upper:
      parent: base
      mass: 1
      inertia: {principal: [1, 1, 1]}
      joint: {name: elbow, type: hinge, axis: [0, 1, 0]}
  actuators:
    servo: {joint: elbow, kp: 5}
control:
  robot:
    actuators: ["*"]
"""
    (tmp_path / "arm.yaml").write_text(text)
    assert load(tmp_path / "arm.yaml").resolve().controllers[0].kp == (5.0,)
    placed = """simspec: 1
name: placed
models:
  one:
    use: arm.yaml
    actuators:
      servo: {joint: elbow, kp: 7, command: 3}
control:
  robot:
    actuators: ["*"]
    commands:
      one/servo: 0.25
"""
    (tmp_path / "placed.yaml").write_text(placed)
    made = load(tmp_path / "placed.yaml").resolve()
    assert made.controllers[0].kp == (7.0,)
    assert made.trajectory.positions == ((0.25,),)
    plain = placed[: placed.index("control")]
    (tmp_path / "placed.yaml").write_text(plain)
    made = load(tmp_path / "placed.yaml").resolve()
    assert (made.controllers, made.trajectory) == ((), None)


def test_bodies_outside_models_have_top_level_actuators():
    data = scenario({"a": SERVO})
    model = data["models"].pop("arm")
    data |= {"bodies": model["bodies"], "actuators": model["actuators"], "control": {"robot": {"actuators": ["a"]}}}
    assert Spec.from_data(data).resolve().controllers[0].joints == ("elbow",)
    data["model"] = {"bodies": data.pop("bodies")}
    del data["models"]
    assert ("actuators", "actuators of a model stand in the model itself") in problems(data)


SERVO = {"joint": "elbow", "kp": 1}
WRONG = {
    "no such joint": (({"a": {"joint": "elbo", "kp": 1}},), "models.arm.actuators.a.joint", "no joint 'arm/elbo'"),
    "a ball": (({"a": {"joint": "wrist", "kp": 1}},), "models.arm.actuators.a.joint", "is a ball joint"),
    "two on a joint": (({"a": SERVO, "b": SERVO},), "models.arm.actuators.b.joint", "driven already"),
    "no such actuator": (({"a": SERVO}, {"actuators": ["arm/c"]}), "control.robot.actuators.0", "no actuator 'arm/c'"),
    "a command of none": (
        ({"a": SERVO}, {"commands": {"arm/c": 1}}),
        "control.robot.commands.arm/c",
        "not an actuator",
    ),
    "a command outside": (
        ({"a": {**SERVO, "command_limits": [-1, 1]}}, {"commands": {"arm/a": 2}}),
        "control.robot.commands.arm/a",
        "outside its limits",
    ),
    "an own command outside": (
        ({"a": {**SERVO, "command_limits": [1, 2]}},),
        "models.arm.actuators.a.command",
        "outside its limits",
    ),
    "a wrong unit": (({"a": {"joint": "elbow", "kp": "3 N/m"}},), "models.arm.actuators.a.kp", "unit"),
    "a command of a wrong unit": (
        ({"a": SERVO}, {"commands": {"arm/a": "3 N"}}),
        "control.robot.commands.arm/a",
        "unit",
    ),
    "no gain": (({"a": {"joint": "elbow"}},), "models.arm.actuators.a", "needs kp"),
    "a gain of another law": (
        ({"a": {"joint": "elbow", "law": "effort", "kp": 3}},),
        "models.arm.actuators.a.kp",
        "has no kp",
    ),
    "no gear": (({"a": {**SERVO, "gear": 0}},), "models.arm.actuators.a.gear", "does nothing"),
    "an unstable bias": (
        ({"a": {"joint": "elbow", "law": "affine", "bias": [0, 1, 0]}},),
        "models.arm.actuators.a.bias.1",
        "unstable",
    ),
    "gains of a controller": (({"a": SERVO}, {"kp": 3}), "control.robot.kp", "not allowed with actuators"),
    "joints too": (({"a": SERVO}, {"joints": ["arm/elbow"]}), "control.robot.joints", "not allowed with actuators"),
    "too stiff": (({"a": {"joint": "elbow", "kp": 1e7}},), "control.robot", "unstable at this timestep"),
    "too large": (
        ({"a": {**SERVO, "gear": 1e6, "law": "affine", "gain": 1e300}},),
        "models.arm.actuators.a.kp",
        "no kp",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_actuators_are_located_errors(name):
    arguments, path, message = WRONG[name]
    found = problems(scenario(*arguments))
    assert any(at == path and message in said for at, said in found), found


def test_a_controller_has_joints_or_actuators():
    data = scenario({"a": SERVO})
    data["control"] = {"robot": {"law": "pd", "kp": 1, "kd": 1}}
    assert ("control.robot.joints", "joints is missing") in problems(data)
    data["control"] = {"robot": {"joints": ["arm/elbow"], "kp": 1, "kd": 1, "commands": {"arm/a": 1}}}
    assert any(path == "control.robot.commands" for path, _ in problems(data))


def test_a_second_controller_of_a_joint_is_rejected():
    data = scenario({"a": SERVO})
    data["control"]["other"] = {"joints": ["arm/elbow"], "kp": 1, "kd": 1}
    assert any("has a controller already" in message for _, message in problems(data))


def with_trajectory(actuator, trajectory):
    data = scenario({"a": actuator})
    data["control"]["other"] = {"joints": ["arm/rail"], "kp": 1, "kd": 1}
    return {**data, "trajectory": trajectory}


WAYS = {
    "points": {"points": [{"at": 0, "positions": {"arm/rail": 0.0}}, {"at": "50 ms", "positions": {"arm/rail": 0.1}}]},
    "with velocities": {
        "points": [
            {"at": 0, "positions": {"arm/rail": 0.0}, "velocities": {"arm/rail": 0.0}},
            {"at": "50 ms", "positions": {"arm/rail": 0.1}, "velocities": {"arm/rail": 0.2}},
        ]
    },
    "held": {"points": [{"at": "20 ms", "positions": {"arm/rail": 0.1}}], "interpolation": "hold"},
    "linear": {
        "points": [{"at": 0, "positions": {"arm/rail": 0.0}}, {"at": "50 ms", "positions": {"arm/rail": 0.1}}],
        "interpolation": "linear",
    },
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("law", ["position", "effort"])
def test_a_trajectory_moves_joints_without_actuators(way, law):
    """The target of an actuator outside the trajectory is constant, and the trajectory is the same as without the actuator."""
    actuator = {**SERVO, "command": 0.3} if law == "position" else {"joint": "elbow", "law": "effort", "command": 0.3}
    data = with_trajectory(actuator, WAYS[way])
    both = Spec.from_data(data).resolve().trajectory
    data["control"].pop("robot")
    alone = Spec.from_data(data).resolve().trajectory
    assert both.joints == ("arm/elbow", "arm/rail")
    times = np.array([0.0, 0.013, 0.04, 0.05, 0.2])
    for found, expected in zip(positions(both).at(times, 2), positions(alone).at(times, 2), strict=True):
        np.testing.assert_array_equal(found[:, 1], expected[:, 0])
    target, speed, acceleration = (values[:, 0] for values in positions(both).at(times, 2))
    value, fed = (0.3, 0.0) if law == "position" else (0.0, 0.3)
    np.testing.assert_allclose(target, np.full(5, value), atol=1e-15)  # a polynomial's last digit
    np.testing.assert_allclose([speed, acceleration], np.zeros((2, 5)), atol=1e-12)
    np.testing.assert_array_equal(efforts(both).at(times)[0], np.tile([fed, 0.0], (5, 1)))


def test_a_trajectory_does_not_move_what_an_actuator_acts_on():
    wrong = {"points": [{"at": 0, "positions": {"arm/rail": 0.1, "arm/elbow": 0.2}}]}
    message = "arm/elbow moves here, and an actuator with a constant command acts on it"
    assert problems(with_trajectory(SERVO, wrong)) == [("trajectory", message)]


def test_too_many_are_refused_before_they_are_copied():
    data = scenario({f"a{number}": SERVO for number in range(200)})
    data["models"]["arm"]["array"] = {"line": MOST["actuators"] // 100, "step": [1, 1, 1]}
    assert any("too many actuators" in message for _, message in problems(data))


def test_every_law_is_tried():
    assert set(LAWS) == {"position", "velocity", "effort", "affine"}


def test_a_state_says_commands():
    """The controller's own replace the state's, and these the actuator's."""
    data = scenario({"a": {**SERVO, "command": 0.1}, "b": {"joint": "rail", "law": "effort"}})
    data["models"]["arm"] |= {"states": {"up": {"commands": {"a": 0.3, "b": "2 N"}}}, "state": "up"}
    made = Spec.from_data(data).resolve().trajectory
    assert made.positions[0] == pytest.approx((0.3, 0.1))
    assert made.efforts[0] == pytest.approx((0.0, 2.0))
    data["control"]["robot"]["commands"] = {"arm/a": 0.4}
    assert Spec.from_data(data).resolve().trajectory.positions[0] == pytest.approx((0.4, 0.1))
    data["models"]["arm"].pop("state")
    data["control"]["robot"].pop("commands")
    assert Spec.from_data(data).resolve().trajectory.positions[0] == pytest.approx((0.1, 0.1))


@pytest.mark.parametrize(
    ("commands", "message"),
    [({"c": 1}, "the model has no actuator 'c'"), ({"a": "2 N"}, "N"), ({"a": 9}, "the command is outside its limits")],
)
def test_wrong_commands_of_a_state_are_errors_at_their_places(commands, message):
    data = scenario({"a": {**SERVO, "command_limits": [-1, 1]}})
    data["models"]["arm"] |= {"states": {"up": {"commands": commands}}, "state": "up"}
    (name,) = commands
    found = problems(data)
    assert any(path == f"models.arm.states.up.commands.{name}" and message in said for path, said in found), found
