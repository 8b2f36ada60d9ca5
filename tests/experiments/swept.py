"""A small scenario with a sweep, for the tests of plans, stores and drivers."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from simspec.language.load import Spec

ENGINES = ("mujoco", "dart")
VERSIONS: Mapping[str, Mapping[str, str]] = {
    label: {"simspec": "1", "engine_version": "1"} for label in (*ENGINES, "pybullet", "mujoco@3.8")
}
DATA: Mapping[str, Any] = {
    "simspec": 1,
    "name": "rod",
    "description": "A rod on a hinge",
    "physics": {"gravity": [0, 0, -9.81], "timestep": "1 ms", "duration": "20 ms"},
    "bodies": {
        "rod": {
            "mass": "2 kg",
            "inertia": {"principal": [0.04, 0.04, 0.001]},
            "joint": {"type": "hinge", "axis": [0, 1, 0], "origin": {"xyz": [0, 0, 1]}, "position": "60 deg"},
        },
        "ball": {"pose": {"xyz": [1, 0, 1]}, "mass": 1, "inertia": {"principal": [0.01, 0.01, 0.01]}},
    },
    "record": {"every": "10 ms", "show": ["rod"]},
    "expect": [{"position": {"body": "ball", "xyz": [1, 0, 1], "tolerance": 1, "at": "20 ms"}}],
    "engines": {"mujoco": {"settings": {"iterations": 50}}, "dart": {"settings": {"collision_detector": "bullet"}}},
}

SWEEP: Mapping[str, Any] = {
    "over": {"physics.timestep": ["1 ms", "2 ms"], "bodies.rod.mass": {"from": 1, "to": 3, "count": 3}},
    "together": [{"physics.duration": ["20 ms", "40 ms"], "record.every": ["10 ms", "20 ms"]}],
    "cases": {"heavy": {"physics.gravity.2": -20.0}},
    "samples": {"count": 2, "seed": 7, "values": {"bodies.ball.mass": {"uniform": ["1 kg", "2 kg"]}}},
    "perturb": {"amount": 1e-9, "seeds": 2},
    "repeat": 2,
}
"""All words of a sweep: 576 runs of 48 worlds in two engines."""


def data(**more: Any) -> dict[str, Any]:
    """The scenario as plain data, with other parts."""
    return {**copy.deepcopy(dict(DATA)), **more}


def spec(sweep: Mapping[str, Any] | None = None, **more: Any) -> Spec:
    """The scenario with a sweep."""
    return Spec.from_data(data(**more) if sweep is None else data(sweep=dict(sweep), **more))
