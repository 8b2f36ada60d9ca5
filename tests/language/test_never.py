"""`check` reports expectations that no run can meet, before any run."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.load import Spec

SOLID = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}
HINGE = {"type": "hinge", "axis": [0, 0, 1]}
BODIES = {
    "post": {"fixed": True, "pose": {"xyz": [0, 0, 2]}},
    "ball": {**SOLID, "pose": {"xyz": [1, 0, 1]}},
    "arm": {**SOLID, "joint": HINGE},
}
DRIVE = {"arm": {"joints": ["arm_joint"], "law": "pd", "kp": 1, "kd": 1, "discretisation": "implicit"}}


def problems(expectation, **more):
    data = {"name": "x", "physics": {"duration": 1}, "bodies": BODIES, "expect": [expectation], **more}
    try:
        Spec.from_data(data).resolve()
    except SpecError as error:
        return [(problem.path, problem.message) for problem in error.problems]
    return []


FOLLOWS = {"follows_oracle": {"tolerance": 1e-6}}
ROUGH = {"bodies": {"arm": {**SOLID, "joint": {**HINGE, "dry_friction": 0.1}}}}


@pytest.mark.parametrize(
    ("expectation", "more", "path", "words"),
    [
        (FOLLOWS, {"control": DRIVE}, "follows_oracle", "does not support control"),
        (FOLLOWS, ROUGH, "follows_oracle", "does not support dry friction"),
        (FOLLOWS, {"physics": {}}, "follows_oracle", "no motion is recorded"),
        (
            {"follows_oracle": {"tolerance": 1e-6, "until": 0}},
            {"record": {"every": 0.01}},
            "follows_oracle",
            "no motion is recorded",
        ),
        (
            {"no_penetration_deeper_than": {"depth": 1e-3}},
            {"record": {"channels": ["pose"]}},
            "no_penetration_deeper_than",
            "contacts are not recorded",
        ),
        (
            {"keeps_place": {"body": "ball", "within": "arm", "after": 0.5, "until": 0.2, "distance": 1}},
            {},
            "keeps_place.until",
            "until is before after",
        ),
        (
            {"apex_height": {"body": "ball", "height": 1, "tolerance": 0.1, "after": 1}},
            {},
            "apex_height.after",
            "after the end of the run",
        ),
        ({"position": {"body": "post", "xyz": [0, 0, 0], "tolerance": 1}}, {}, "position.xyz", "post cannot move"),
        ({"at_target": {"targets": {"post": [0, 0, 0]}, "tolerance": 1}}, {}, "at_target.targets.post", "cannot move"),
        ({"displacement": {"body": "post", "distance": 1, "tolerance": 0.1}}, {}, "displacement", "post cannot move"),
        (
            {"displacement": {"body": "post", "xyz": [1, 0, 0], "tolerance": 0.1}},
            {},
            "displacement",
            "post cannot move",
        ),
        (
            {"apex_height": {"body": "post", "height": 5, "tolerance": 0.1, "after": 0}},
            {},
            "apex_height.height",
            "post cannot move",
        ),
        ({"angular_speed": {"body": "post", "speed": 1, "tolerance": 0.1}}, {}, "angular_speed.speed", "cannot move"),
        (
            {"stays_within": {"body": "ball", "lower": [-1, -1, -1], "upper": [0.9, 1, 2]}},
            {},
            "stays_within",
            "ball starts outside",
        ),
        (
            {"bodies_apart": {"first": "ball", "second": "post", "at_least": 2}},
            {},
            "bodies_apart.at_least",
            "start closer",
        ),
    ],
)
def test_impossible_expectations_are_rejected(expectation, more, path, words):
    found = dict(problems(expectation, **more))
    message = found[f"expect.0.{path}"]
    assert words in message
    assert "cannot be satisfied" in message


@pytest.mark.parametrize(
    "expectation",
    [
        FOLLOWS,
        {"position": {"body": "post", "xyz": [0, 0, 2.5], "tolerance": 1}},
        {"displacement": {"body": "post", "distance": 0, "tolerance": 0.1}},
        {"stays_within": {"body": "ball", "lower": [1, 0, 1], "upper": [1, 0, 1]}},
        {"bodies_apart": {"first": "ball", "second": "post", "at_least": 1.41}},
        {"no_penetration_deeper_than": {"depth": 1e-3}},
    ],
)
def test_possible_expectations_are_allowed(expectation):
    assert problems(expectation) == []


def test_a_run_made_shorter_says_which_expectation_looks_beyond_it_and_what_to_set():
    data = {"name": "x", "physics": {"duration": 0.5}, "bodies": BODIES}
    data["expect"] = [FOLLOWS, {"comes_to_rest": {"speed": 1, "before": 2}}]
    with pytest.raises(SpecError) as error:
        Spec.from_data(data).resolve()
    [problem] = error.value.problems
    assert problem.path == "expect.1.comes_to_rest.before"
    assert "after the end of the run" in problem.message
    assert problem.hint == "a longer physics.duration, or --set expect.1.comes_to_rest.before=0.5s"
