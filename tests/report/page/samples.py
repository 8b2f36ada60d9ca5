"""Stored studies made by hand, whose page is known: no engine runs."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simspec.commands.run import Results
from simspec.comparison.floor import measure_floor
from simspec.comparison.runs import diff
from simspec.comparison.study import Study
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check
from simspec.runner.expectations import evaluate
from simspec.runner.run import Run
from simspec.world.canonical import sha256
from simspec.world.types import Body, Expectation, Inertial, Joint, Pose, Shape, World
from tests.runner.synthetic import SPHERE, column, free_body, run, world

HOSTILE = (
    "<script>document.title='owned'</script>",
    "</script><img src=x onerror=\"document.title='owned'\">",
    "\" onmouseover=\"document.title='owned'",
    "a' b & c < d > e",
    "line\u2028separator\u2029and \x00 control",
    "<!-- <script> ]]> ${x} {{ 7 * 7 }}",
)
"""Names that are markup, end an element, or are no character of a page."""
HOSTILE_BODIES = (HOSTILE[3], HOSTILE[0], HOSTILE[1], HOSTILE[2])
SPEEDS = (0.0, 1e-5, 0.4)
"""Speed of the second body in three engines, m/s: the reference, within the tolerance of it, and beyond the tolerance."""


def shaped(body: Body, kind: str, size: tuple[float, ...], name: str = "shape") -> Body:
    return dataclasses.replace(body, shapes=(Shape(name, kind, size),))


def floor_body(name: str = "floor") -> Body:
    joint = Joint(f"{name}_joint", "fixed")
    return Body(name, name, Inertial(0.0), joint, (Shape("ground", "plane", (), visual=False),))


def arm(name: str = "arm") -> Body:
    joint = Joint(
        "elbow", "hinge", origin=Pose((0.0, 0.0, 0.5)), axis=(0.0, 1.0, 0.0), position=(0.0,), velocity=(0.0,)
    )
    return Body(name, name, Inertial(1.0, (0.1, 0.0, 0.0), SPHERE), joint, (Shape("rod", "capsule", (0.03, 0.3)),))


def a_world(names: Sequence[str] = ("floor", "resting", "mover", "arm"), title: str = "sample") -> World:
    ground, resting, mover, driven = names
    bodies = (
        floor_body(ground),
        shaped(free_body(resting), "box", (0.2, 0.3, 0.4)),
        shaped(free_body(mover), "sphere", (0.1,)),
        arm(driven),
    )
    expectation = Expectation("position", (("body", mover), ("tolerance", 0.1), ("xyz", (0.0, 0.0, 0.1))))
    return dataclasses.replace(world(*bodies, expect=(expectation,), steps=200), name=title)


def a_run(of: World, engine: str, speed: float) -> Run:
    """The second free body moves along x, the arm turns to 1 rad and lags its target by 0.1 rad."""
    mover = of.bodies[2].name
    contacts = [(row, 2, 0, -1e-3, 10.0 * (row + 1)) for row in range(3, 10)]
    made = run(of, lambda body, t: column(speed * t * (body == mover), 0, 0.1), engine=engine, contacts=contacts)
    made.arrays["contact.normal"][:, 2] = 1.0
    angle = np.linspace(0.0, 1.0, len(made.time))
    made.arrays["pose"][:, 3] = np.stack(
        [0 * angle, 0 * angle, 0.5 + 0 * angle, np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle], axis=1
    )
    made.arrays["q"][:, -1] = angle
    arrays = {**made.arrays, "control.target": angle[:, None] + 0.1, "control.effort": np.full((len(angle), 1), 1.0)}
    control = {"joints": ["elbow"], "clipped": [0], "error": [0.1]}
    return dataclasses.replace(made, arrays=arrays, provenance={**made.provenance, "control": control})


def a_study(
    of: World | None = None,
    engines: Sequence[str] = ("first", "second", "third"),
    valid: bool = True,
    proven: bool = True,
) -> Study:
    of = a_world() if of is None else of
    runs = {name: a_run(of, name, speed) for name, speed in zip(engines, SPEEDS, strict=False)}
    floors = {
        name: measure_floor(run, [run, dataclasses.replace(run, provenance={**run.provenance, "perturb": 1e-15})])
        for name, run in runs.items()
    }
    diffs = tuple(diff(a, b, floor=list(floors.values())) for a, b in itertools.combinations(runs.values(), 2))
    check = Check("L1", "mass", 4, 1e-9, 1e-16 if valid else 1e-3, of.bodies[2].name, "")
    proof = EngineProof("1.0", "0" * 64, (check,))
    certificate = Certificate(of.name, sha256(of), "oracle 1", dict.fromkeys(runs, proof)) if proven else None
    return Study(of, certificate, runs, {}, floors, {name: tuple(evaluate(run)) for name, run in runs.items()}, diffs)


def stored(study: Study, folder: Path) -> Path:
    """The study as ``simspec run`` writes it."""
    results = Results(study.world, folder)
    if study.certificate is not None:
        results.certificate(study.certificate)
    for recorded in study.runs.values():
        results.run(recorded)
    for floor in study.floors.values():
        results.floor(floor)
    results.finish(study)
    return folder
