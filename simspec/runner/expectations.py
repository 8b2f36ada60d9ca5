"""What a spec expects of its runs, and whether a run fulfils it.

Each expectation is measured from the run's arrays by :mod:`simspec.runner.metrics` and held against one bound. A run that
failed, or has no record of what an expectation needs, does not fulfil it. Positions are of the body frame's origin, in
the world.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.runner import metrics
from simspec.runner.run import Run
from simspec.world.kinematics import initial_state, layout
from simspec.world.types import Expectation, World


@dataclass(frozen=True)
class Outcome:
    """One expectation held against one run: what was measured (None when it could not be), the bound that it must not
    pass, their unit, and where or when the measured value occurred."""

    kind: str
    passed: bool
    measured: float | None
    bound: float
    unit: str
    detail: str = ""


@dataclass(frozen=True)
class Measured:
    """A measurement: passes when ``value`` ≤ ``bound`` (``at_least``: ≥)."""

    value: float
    bound: float
    unit: str
    detail: str = ""
    at_least: bool = False


class Unmeasurable(Exception):
    """The run has no record of what an expectation needs; the text says what is missing."""


Parameters = Mapping[str, Any]
Measure = Callable[[Run, Parameters], Measured]


def evaluate(run: Run) -> list[Outcome]:
    """The outcome of every expectation of the run's world, in the world's order."""
    return [_evaluate(run, expectation) for expectation in run.world.expectations]


def _evaluate(run: Run, expectation: Expectation) -> Outcome:
    parameters = dict(expectation.parameters)
    measure = MEASURES[expectation.kind]
    bound = float(
        next(
            (parameters[key] for key in ("tolerance", "depth", "speed", "at_least", "distance") if key in parameters),
            0.0,
        )
    )
    if run.failed is not None or not run.recorded:
        return Outcome(expectation.kind, False, None, bound, "", f"the run failed: {run.failed}")
    try:
        found = measure(run, parameters)
    except Unmeasurable as error:
        return Outcome(expectation.kind, False, None, bound, "", str(error))
    passed = found.value >= found.bound if found.at_least else found.value <= found.bound
    return Outcome(expectation.kind, bool(passed), float(found.value), float(found.bound), found.unit, found.detail)


def _row(run: Run, at: float) -> int:
    """The recorded row of time ``at``. Raises Unmeasurable unless one lies within half a timestep."""
    row = int(np.abs(run.time - at).argmin())
    if abs(run.time[row] - at) > 0.5 * run.world.physics.timestep:
        raise Unmeasurable(f"nothing was recorded at {at:g} s (nearest {run.time[row]:g} s)")
    return row


def _channel(run: Run, name: str, channel: str) -> None:
    if name not in run.arrays:
        raise Unmeasurable(f"the run did not record {channel}: add it to record.channels")


def _path(run: Run, body: str) -> np.ndarray:
    if body not in run.index:
        raise Unmeasurable(f"the world has no body {body!r}")
    return run.arrays["pose"][:, run.index[body], :3]


def _at(run: Run, row: int) -> str:
    return f"at {run.time[row]:.4g} s"


def _ratio(value: float, scale: float) -> float:
    """``value`` relative to ``scale``; nothing relative to nothing is 0."""
    return value / scale if scale > 0.0 else (0.0 if value == 0.0 else float("inf"))


def _energy_never_rises(run: Run, given: Parameters) -> Measured:
    """The largest rise of the total energy above its lowest value before."""
    kinetic, potential = metrics.energy(run.world, run.arrays)
    total = kinetic + potential
    rise = total - np.minimum.accumulate(total)
    scale = metrics.energy_scale(kinetic, potential)
    row = int(rise.argmax())
    return Measured(_ratio(rise[row], scale), given["tolerance"], "", f"of {scale:.4g} J, {_at(run, row)}")


def _energy_conserved(run: Run, given: Parameters) -> Measured:
    """The largest deviation of the total energy from its initial value."""
    kinetic, potential = metrics.energy(run.world, run.arrays)
    total = kinetic + potential
    change = np.abs(total - total[0])
    scale = metrics.energy_scale(kinetic, potential)
    row = int(change.argmax())
    return Measured(_ratio(change[row], scale), given["tolerance"], "", f"of {scale:.4g} J, {_at(run, row)}")


def _momentum_conserved(run: Run, given: Parameters) -> Measured:
    """The largest deviation of linear or angular momentum from its initial value, each relative to its own scale."""
    worst = Measured(0.0, given["tolerance"], "")
    scales = metrics.momentum_scale(run.world, run.arrays)
    for name, values, scale in zip(("linear", "angular"), metrics.momentum(run.world, run.arrays), scales, strict=True):
        change = np.linalg.norm(values - values[0], axis=1)
        row = int(change.argmax())
        ratio = _ratio(change[row], scale)
        if ratio >= worst.value:
            unit = {"linear": "N s", "angular": "N m s"}[name]
            worst = Measured(ratio, given["tolerance"], "", f"{name}, of {scale:.4g} {unit}, {_at(run, row)}")
    return worst


def _no_penetration_deeper_than(run: Run, given: Parameters) -> Measured:
    _channel(run, "contact.distance", "contacts")
    found = metrics.deepest_penetration(run.world, run.arrays)
    detail = f"{' and '.join(found.bodies)} at {found.time:.4g} s" if found.bodies else "no overlap"
    return Measured(found.depth, given["depth"], "m", detail)


def _comes_to_rest(run: Run, given: Parameters) -> Measured:
    """The largest speed of a centre of mass at the end; with ``before``, at any recorded time from then on."""
    moving = metrics.moving_bodies(run.world)
    if not len(moving):
        return Measured(0.0, given["speed"], "m/s", "no body can move")
    first = _row(run, given["before"]) if given.get("before") is not None else len(run.time) - 1
    speeds = metrics.speeds(run.world, run.arrays)[first:, moving]
    row, body = np.unravel_index(int(speeds.argmax()), speeds.shape)
    name = run.world.bodies[moving[body]].name
    return Measured(speeds[row, body], given["speed"], "m/s", f"{name} {_at(run, first + int(row))}")


def _follows_oracle(run: Run, given: Parameters) -> Measured:
    """The largest distance of a body frame's origin from the contact-free motion of the oracle, up to ``until``."""
    steps = run.arrays["step"].astype(np.int64)
    if given.get("until") is not None:
        steps = steps[: _row(run, given["until"]) + 1]
    if len(steps) < 2:
        raise Unmeasurable("the run recorded no motion")
    truth = _oracle_places(run.world, int(steps[-1]), int(steps[1] - steps[0]))
    away = np.linalg.norm(run.arrays["pose"][: len(steps), :, :3] - truth, axis=-1)
    row, body = np.unravel_index(int(away.argmax()), away.shape)
    return Measured(away[row, body], given["tolerance"], "m", f"{run.world.bodies[body].name} {_at(run, int(row))}")


@functools.lru_cache(maxsize=4)  # the runs of one world in several engines are held against one motion
def _oracle_places(world: World, steps: int, every: int) -> np.ndarray:
    """Positions (rows, bodies, 3) of the oracle's motion from the world's initial state."""
    from simspec.dynamics.oracle import Oracle

    try:
        oracle = Oracle(world)
    except ModuleNotFoundError as error:
        raise Unmeasurable(f"the oracle is not installed ({error.name}): pip install 'simspec[pin]'") from None
    if any(body.joint.dry_friction for body in world.bodies):
        raise Unmeasurable("the oracle knows no dry friction")
    if world.controllers:
        raise Unmeasurable("the oracle's motion knows no control")
    q, v = initial_state(world)
    states, _ = oracle.motion(q, v, None, steps, every)
    for body, place in zip(world.bodies, layout(world.bodies).position, strict=True):
        limits = body.joint.position_limits
        if limits is not None and (states[:, place].min() < limits[0] or states[:, place].max() > limits[1]):
            raise Unmeasurable(f"the oracle knows no limits, and {body.joint.name} moves beyond its own: say until")
    return np.array([oracle.body_poses(state)[:, :3] for state in states])


def _position(run: Run, given: Parameters) -> Measured:
    """Distance of a body from a place, at a time (default: the end)."""
    row = _row(run, given["at"]) if given.get("at") is not None else len(run.time) - 1
    found = _path(run, given["body"])[row]
    away = float(np.linalg.norm(found - np.array(given["xyz"])))
    return Measured(away, given["tolerance"], "m", f"{given['body']} at {_point(found)} {_at(run, row)}")


def _at_target(run: Run, given: Parameters) -> Measured:
    """The largest distance of a body from its place, at a time (default: the end); and which bodies miss theirs."""
    row = _row(run, given["at"]) if given.get("at") is not None else len(run.time) - 1
    bound, names = given["tolerance"], [name for name, _ in given["targets"]]
    away = np.array([np.linalg.norm(_path(run, name)[row] - np.array(place)) for name, place in given["targets"]])
    worst = int(away.argmax())
    missed = [name for name, far in zip(names, away, strict=True) if not far <= bound]
    detail = f"{names[worst]} {1e3 * away[worst]:.4g} mm away {_at(run, row)}"
    if missed:
        detail += f"; {len(missed)} of {len(names)} miss: {', '.join(missed)}"
    return Measured(float(away[worst]), bound, "m", detail)


def _displacement(run: Run, given: Parameters) -> Measured:
    """How a body moved from its first place, at a time (default: the end): as a vector, or its length alone."""
    row = _row(run, given["at"]) if given.get("at") is not None else len(run.time) - 1
    path = _path(run, given["body"])
    moved = path[row] - path[0]
    if given.get("xyz") is not None:
        away = float(np.linalg.norm(moved - np.array(given["xyz"])))
    else:
        away = abs(float(np.linalg.norm(moved)) - given["distance"])
    detail = f"{given['body']} moved {np.linalg.norm(moved):.4g} m, {_point(moved)} {_at(run, row)}"
    return Measured(away, given["tolerance"], "m", detail)


def _apex_height(run: Run, given: Parameters) -> Measured:
    """How far the greatest height z that a body reaches after a time is from the expected one."""
    path = _path(run, given["body"])
    first = _row(run, given["after"])
    row = first + int(path[first:, 2].argmax())
    height = float(path[row, 2])
    return Measured(abs(height - given["height"]), given["tolerance"], "m", f"apex {height:.4g} m {_at(run, row)}")


def _angular_speed(run: Run, given: Parameters) -> Measured:
    """How far a body's angular speed is from the expected one."""
    row = _row(run, given["at"]) if given.get("at") is not None else len(run.time) - 1
    if given["body"] not in run.index:
        raise Unmeasurable(f"the world has no body {given['body']!r}")
    speed = float(np.linalg.norm(run.arrays["velocity"][row, run.index[given["body"]], 3:]))
    return Measured(abs(speed - given["speed"]), given["tolerance"], "rad/s", f"{speed:.4g} rad/s {_at(run, row)}")


def _stays_within(run: Run, given: Parameters) -> Measured:
    """How far a body leaves a box; 0 when it never does."""
    path = _path(run, given["body"])
    out = np.maximum(np.array(given["lower"]) - path, path - np.array(given["upper"])).max(axis=1)
    row = int(out.argmax())
    return Measured(max(0.0, float(out[row])), 0.0, "m", f"{given['body']} at {_point(path[row])} {_at(run, row)}")


def _keeps_place(run: Run, given: Parameters) -> Measured:
    """The largest distance of a body from the place that it had in another body's frame at a time."""
    first = _row(run, given["after"])
    last = _row(run, given["until"]) if given.get("until") is not None else len(run.time) - 1
    path, other = _path(run, given["body"])[first : last + 1], _path(run, given["within"])[first : last + 1]
    turns = metrics.rotation_matrices(run.arrays["pose"][first : last + 1, run.index[given["within"]], 3:7])
    places = np.einsum("tji,tj->ti", turns, path - other)
    away = np.linalg.norm(places - places[0], axis=1)
    row = int(away.argmax())
    detail = f"{given['body']} {1e3 * away[row]:.4g} mm from its place in {given['within']} {_at(run, first + row)}"
    return Measured(float(away[row]), given["distance"], "m", detail)


def _bodies_apart(run: Run, given: Parameters) -> Measured:
    """The smallest distance of two bodies' origins."""
    apart = np.linalg.norm(_path(run, given["first"]) - _path(run, given["second"]), axis=1)
    row = int(apart.argmin())
    return Measured(float(apart[row]), given["at_least"], "m", _at(run, row), at_least=True)


def _point(xyz: np.ndarray) -> str:
    return f"({', '.join(f'{value:.4g}' for value in xyz)})"


MEASURES: Mapping[str, Measure] = {
    "energy_never_rises": _energy_never_rises,
    "energy_conserved": _energy_conserved,
    "momentum_conserved": _momentum_conserved,
    "no_penetration_deeper_than": _no_penetration_deeper_than,
    "comes_to_rest": _comes_to_rest,
    "follows_oracle": _follows_oracle,
    "position": _position,
    "at_target": _at_target,
    "displacement": _displacement,
    "apex_height": _apex_height,
    "angular_speed": _angular_speed,
    "stays_within": _stays_within,
    "keeps_place": _keeps_place,
    "bodies_apart": _bodies_apart,
}
"""How each kind of expectation is measured. The language offers exactly these."""
