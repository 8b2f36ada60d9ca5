"""Expectations of a spec on its runs, and whether a run fulfils them.

Each expectation is measured and compared with one bound. A run that failed, or has no record of the quantities that an
expectation needs, does not fulfil it. A bound on a distance that is finer than the engine repeats its own run is the
author's word all the same: a run that misses it does not fulfil it, and the outcome says that rounding alone may make so much.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.dynamics.oracle import angles_of
from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.registry import engine_name, engines
from simspec.files import parts, release, zeros
from simspec.runner import metrics
from simspec.runner.run import Run
from simspec.world.constraints import beyond_limits
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.rotations import matrices
from simspec.world.types import World

# How each kind of expectation is measured: from a run's arrays, by :mod:`simspec.runner.metrics`, block by block.
#
# Positions are of the body frame's origin, in the world.


@dataclass(frozen=True)
class Measured:
    """A measurement: passes when ``value`` ≤ ``bound`` (``at_least``: ≥). ``row``: the recorded row of a distance (m) that what
    an engine does not repeat itself to makes uncertain."""

    value: float
    bound: float
    unit: str
    detail: str = ""
    at_least: bool = False
    row: int | None = None


class Unmeasurable(Exception):
    """The run has no record of what an expectation needs; the text says what is missing, and that nothing was measured."""


Parameters = Mapping[str, Any]
Measure = Callable[[Run, Parameters], Measured]


class Largest:
    """The largest of numbers that come block by block, and where the first of that size is; NaN is larger."""

    def __init__(self) -> None:
        self.value, self.row, self.column = -math.inf, 0, 0

    def add(self, values: np.ndarray, first: int) -> None:
        """A block's numbers (rows,) or (rows, columns); ``first``: the row that it begins with."""
        if not values.size or math.isnan(self.value):
            return
        place = np.unravel_index(int(values.argmax()), values.shape)
        if not values[place] <= self.value:
            self.value, self.row = float(values[place]), first + int(place[0])
            self.column = int(place[1]) if len(place) > 1 else 0


def _largest(
    run: Run, of: Callable[[np.ndarray], np.ndarray], bodies: Sequence[str], first: int = 0, last: int | None = None
) -> Largest:
    """The largest of what ``of`` makes of some bodies' poses (rows, bodies, 7), over the rows ``first`` … ``last``."""
    largest, poses, columns = Largest(), run.arrays["pose"], [_index(run, body) for body in bodies]
    rows = len(run.time) if last is None else last + 1
    for part in parts(rows, metrics.TEMPORARY * poses[:1].nbytes, poses, first=first):
        largest.add(of(poses[part][:, columns]), part.start)
    return largest


def _row(run: Run, at: float) -> int:
    """The recorded row of time ``at``. Raises Unmeasurable unless one lies within half a timestep."""
    row = int(np.clip(np.searchsorted(run.time, at), 1, max(1, len(run.time) - 1)))
    if row == len(run.time) or abs(run.time[row - 1] - at) <= abs(run.time[row] - at):
        row -= 1
    if abs(run.time[row] - at) > 0.5 * run.world.physics.timestep:
        raise Unmeasurable(f"nothing was recorded at {at:g} s (nearest {run.time[row]:g} s)")
    return row


def _channel(run: Run, name: str, channel: str) -> None:
    if name not in run.arrays:
        raise Unmeasurable(f"the run did not record {channel}: add it to record.channels")


def _index(run: Run, body: str) -> int:
    if body not in run.index:
        raise Unmeasurable(f"the world has no body {body!r}")
    return run.index[body]


def _path(run: Run, body: str) -> np.ndarray:
    """Places (rows, 3) of a body: a view, of which single rows may be looked at."""
    return run.arrays["pose"][:, _index(run, body), :3]


def _at(run: Run, row: int) -> str:
    return f"at {run.time[row]:.4g} s"


def _ratio(value: float, scale: float) -> float:
    """``value`` relative to ``scale``; nothing relative to nothing is 0."""
    return value / scale if scale > 0.0 else (0.0 if value == 0.0 else float("inf"))


def _energy_never_rises(run: Run, parameters: Parameters) -> Measured:
    """The largest rise of the total energy above its lowest value before."""
    lowest = math.inf

    def rise(total: np.ndarray) -> np.ndarray:
        nonlocal lowest
        so_far = np.minimum(np.minimum.accumulate(total), lowest)
        lowest = float(so_far[-1])
        return total - so_far

    return _energy(run, rise, parameters["tolerance"])


def _energy_conserved(run: Run, parameters: Parameters) -> Measured:
    """The largest deviation of the total energy from its initial value."""
    initial: list[float] = []

    def change(total: np.ndarray) -> np.ndarray:
        initial.extend(total[:1] if not initial else ())
        return np.abs(total - initial[0])

    return _energy(run, change, parameters["tolerance"])


def _energy(run: Run, of: Callable[[np.ndarray], np.ndarray], tolerance: float) -> Measured:
    """The largest of what ``of`` makes of the total energies of one block of rows after the other, relative to the scale."""
    largest, fastest, low, high = Largest(), -math.inf, math.inf, -math.inf
    for part, block in metrics.by_blocks(run.arrays):
        kinetic, potential = metrics.energy(run.world, block)
        largest.add(of(kinetic + potential), part.start)
        fastest = np.maximum(fastest, kinetic.max())
        low, high = np.minimum(low, potential.min()), np.maximum(high, potential.max())
    scale = metrics.energy_scale(np.array([fastest]), np.array([low, high]))
    return Measured(_ratio(largest.value, scale), tolerance, "", f"of {scale:.4g} J, {_at(run, largest.row)}")


def _momentum_conserved(run: Run, parameters: Parameters) -> Measured:
    """The largest deviation of linear or angular momentum from its initial value, each relative to its own scale."""
    changes, initial, scales = (Largest(), Largest()), None, np.zeros(2)
    for part, block in metrics.by_blocks(run.arrays):
        both = metrics.momentum(run.world, block)
        initial = initial or tuple(values[0] for values in both)
        for largest, values, begun in zip(changes, both, initial, strict=True):
            largest.add(np.linalg.norm(values - begun, axis=1), part.start)
        scales = np.maximum(scales, metrics.momentum_scale(run.world, block))
    worst = Measured(0.0, parameters["tolerance"], "")
    units = {"linear": "N s", "angular": "N m s"}
    for (name, unit), largest, scale in zip(units.items(), changes, scales.tolist(), strict=True):
        ratio = _ratio(largest.value, scale)
        if not ratio < worst.value:
            worst = Measured(
                ratio, parameters["tolerance"], "", f"{name}, of {scale:.4g} {unit}, {_at(run, largest.row)}"
            )
    return worst


def _no_penetration_deeper_than(run: Run, parameters: Parameters) -> Measured:
    _channel(run, "contact.distance", "contacts")
    deepest = metrics.deepest_penetration(run.world, run.arrays)
    detail = f"{' and '.join(deepest.bodies)} at {deepest.time:.4g} s" if deepest.bodies else "no overlap"
    return Measured(deepest.depth, parameters["depth"], "m", detail)


def _comes_to_rest(run: Run, parameters: Parameters) -> Measured:
    """The largest speed of a centre of mass at the end; with ``before``, at any recorded time from then on."""
    moving = metrics.moving_bodies(run.world)
    if not len(moving):
        return Measured(0.0, parameters["speed"], "m/s", "no body can move")
    first = _row(run, parameters["before"]) if parameters.get("before") is not None else len(run.time) - 1
    fastest = Largest()
    for part, block in metrics.by_blocks(run.arrays, first):
        fastest.add(metrics.speeds(run.world, block)[:, moving], part.start)
    name = run.world.bodies[moving[fastest.column]].name
    return Measured(fastest.value, parameters["speed"], "m/s", f"{name} {_at(run, fastest.row)}")


def _follows_oracle(run: Run, parameters: Parameters) -> Measured:
    """The largest distance of a body frame's origin from the contact-free motion of the oracle, up to ``until``."""
    steps = run.arrays["step"]
    rows = _row(run, parameters["until"]) + 1 if parameters.get("until") is not None else len(steps)
    if rows < 2:
        raise Unmeasurable("the run recorded no motion")
    truth = _oracle_places(run.world, int(steps[rows - 1]), int(steps[1] - steps[0]))
    poses, farthest = run.arrays["pose"], Largest()
    for part in parts(rows, 4 * poses[:1].nbytes, poses, truth):
        farthest.add(np.linalg.norm(poses[part, :, :3] - truth[part], axis=-1), part.start)
    name = run.world.bodies[farthest.column].name
    return Measured(farthest.value, parameters["tolerance"], "m", f"{name} {_at(run, farthest.row)}", row=farthest.row)


@functools.lru_cache(maxsize=4)  # the runs of one world in several engines are held against one motion
def _oracle_places(world: World, steps: int, every: int) -> np.ndarray:
    """Positions (rows, bodies, 3) of the oracle's motion from the world's initial state."""
    from simspec.dynamics.oracle import Oracle

    try:
        oracle = Oracle(world)
    except ModuleNotFoundError as error:
        raise Unmeasurable(f"the oracle is not installed ({error.name}): pip install 'simspec-physics[pin]'") from None
    if any(body.joint.dry_friction for body in world.bodies) or any(joint_sum.dry_friction for joint_sum in world.sums):
        raise Unmeasurable("the oracle does not support dry friction")
    if world.controllers:
        raise Unmeasurable("the oracle does not support control")
    if world.forces or world.motions:
        raise Unmeasurable("the oracle's motion has no forces on bodies, and no kinematic ones")
    q, v = initial_state(world)
    places, done = zeros((1 + -(-steps // every), len(world.bodies), 3)), 0
    for states, _ in oracle.motion_by_blocks(q, v, None, steps, every):
        for body, place in zip(world.bodies, layout_of(world).position, strict=True):
            limits = body.joint.position_limits
            if limits is not None and (states[:, place].min() < limits[0] or states[:, place].max() > limits[1]):
                raise Unmeasurable(
                    f"the oracle does not support joint limits, and {body.joint.name} exceeds its limits: set until"
                )
            if (most := body.joint.angle_limit) is not None and (angles_of(states[:, place]) > most).any():
                raise Unmeasurable(
                    f"the oracle does not support limits of balls, and {body.joint.name} exceeds its own: set until"
                )
        if (beyond := beyond_limits(world, states)) is not None:
            raise Unmeasurable(f"the oracle does not support limits of sums, and {beyond} exceeds its own: set until")
        for state in states:
            places[done] = oracle.body_poses(state)[:, :3]
            done += 1
        release(places)
    return places


def _position(run: Run, parameters: Parameters) -> Measured:
    """Distance of a body from a place, at a time (default: the end)."""
    row = _row(run, parameters["at"]) if parameters.get("at") is not None else len(run.time) - 1
    place = _path(run, parameters["body"])[row]
    away = float(np.linalg.norm(place - np.array(parameters["xyz"])))
    return Measured(
        away, parameters["tolerance"], "m", f"{parameters['body']} at {_point(place)} {_at(run, row)}", row=row
    )


def _at_target(run: Run, parameters: Parameters) -> Measured:
    """The largest distance of a body from its place, at a time (default: the end); and which bodies miss theirs."""
    row = _row(run, parameters["at"]) if parameters.get("at") is not None else len(run.time) - 1
    bound, names = parameters["tolerance"], [name for name, _ in parameters["targets"]]
    away = np.array([np.linalg.norm(_path(run, name)[row] - np.array(place)) for name, place in parameters["targets"]])
    worst = int(away.argmax())
    missed = [name for name, far in zip(names, away, strict=True) if not far <= bound]
    detail = f"{names[worst]} {1e3 * away[worst]:.4g} mm away {_at(run, row)}"
    if missed:
        detail += f"; {len(missed)} of {len(names)} miss: {', '.join(missed)}"
    return Measured(float(away[worst]), bound, "m", detail, row=row)


def _displacement(run: Run, parameters: Parameters) -> Measured:
    """How a body moved from its first place, at a time (default: the end): as a vector, or its length alone."""
    row = _row(run, parameters["at"]) if parameters.get("at") is not None else len(run.time) - 1
    path = _path(run, parameters["body"])
    moved = path[row] - path[0]
    if parameters.get("xyz") is not None:
        away = float(np.linalg.norm(moved - np.array(parameters["xyz"])))
    else:
        away = abs(float(np.linalg.norm(moved)) - parameters["distance"])
    detail = f"{parameters['body']} moved {np.linalg.norm(moved):.4g} m, {_point(moved)} {_at(run, row)}"
    return Measured(away, parameters["tolerance"], "m", detail, row=row)


SEEN = 0.01
"""Share of the tolerance that an apex may be above the end of the record: a hundredth changes no measurement that matters, and
what rests, and rises by round-off, has its apex there."""


def _apex_height(run: Run, parameters: Parameters) -> Measured:
    """How far the greatest height z that a body reaches after a time is from the expected one. Raises Unmeasurable where the
    record ends while it rises to that."""
    name, last = parameters["body"], len(run.time) - 1
    top = _largest(run, lambda poses: poses[:, 0, 2], [name], first=_row(run, parameters["after"]))
    if top.row == last:
        speed = float(run.arrays["velocity"][last, _index(run, name), 2])
        slowing = -run.world.physics.gravity[2]
        # a body that gravity alone slows rises by this; without gravity it goes on for ever
        further = speed**2 / (2.0 * slowing) if slowing > 0.0 else math.inf
        if speed > 0.0 and further > SEEN * parameters["tolerance"]:
            ends = f"{name} still rises at {speed:.4g} m/s {_at(run, last)}, where the run ends"
            raise Unmeasurable(f"apex not seen: {ends}: set a longer physics.duration")
    away = abs(top.value - parameters["height"])
    return Measured(away, parameters["tolerance"], "m", f"apex {top.value:.4g} m {_at(run, top.row)}")


def _angular_speed(run: Run, parameters: Parameters) -> Measured:
    """How far a body's angular speed is from the expected one."""
    row = _row(run, parameters["at"]) if parameters.get("at") is not None else len(run.time) - 1
    speed = float(np.linalg.norm(run.arrays["velocity"][row, _index(run, parameters["body"]), 3:]))
    return Measured(
        abs(speed - parameters["speed"]), parameters["tolerance"], "rad/s", f"{speed:.4g} rad/s {_at(run, row)}"
    )


def _stays_within(run: Run, parameters: Parameters) -> Measured:
    """How far a body leaves a box; 0 when it never does."""
    lower, upper = np.array(parameters["lower"]), np.array(parameters["upper"])

    def out(poses: np.ndarray) -> np.ndarray:
        places = poses[:, 0, :3]
        result: np.ndarray = np.maximum(lower - places, places - upper).max(axis=1)
        return result

    farthest = _largest(run, out, [parameters["body"]])
    place = _point(_path(run, parameters["body"])[farthest.row])
    return Measured(max(0.0, farthest.value), 0.0, "m", f"{parameters['body']} at {place} {_at(run, farthest.row)}")


def _keeps_place(run: Run, parameters: Parameters) -> Measured:
    """The largest distance of a body from the place that it had in another body's frame at a time."""
    first = _row(run, parameters["after"])
    last = _row(run, parameters["until"]) if parameters.get("until") is not None else len(run.time) - 1
    initial: list[np.ndarray] = []

    def away(poses: np.ndarray) -> np.ndarray:
        turns = matrices(poses[:, 1, 3:7])
        place, of_other = poses[:, 0, :3], poses[:, 1, :3]
        places = np.einsum("tji,tj->ti", turns, place - of_other)
        initial.extend(places[:1] if not initial else ())
        result: np.ndarray = np.linalg.norm(places - initial[0], axis=1)
        return result

    farthest = _largest(run, away, [parameters["body"], parameters["within"]], first, last)
    where = f"{1e3 * farthest.value:.4g} mm from its place in {parameters['within']} {_at(run, farthest.row)}"
    return Measured(farthest.value, parameters["distance"], "m", f"{parameters['body']} {where}")


def _distance_of_bodies(run: Run, parameters: Parameters) -> Measured:
    """The smallest distance of two bodies' origins."""

    def near(poses: np.ndarray) -> np.ndarray:
        result: np.ndarray = -np.linalg.norm(poses[:, 0, :3] - poses[:, 1, :3], axis=1)
        return result

    nearest = _largest(run, near, [parameters["first"], parameters["second"]])
    return Measured(-nearest.value, parameters["at_least"], "m", _at(run, nearest.row), at_least=True)


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
    "bodies_apart": _distance_of_bodies,
}
"""How each kind of expectation is measured. The language offers exactly these."""


@dataclass(frozen=True)
class Outcome:
    """An expectation evaluated on a run: the measured value (None when it could not be), the bound that it must not pass, their
    unit, and where or when the measured value occurred. ``hint``: a remedy where the engine's numbers are too coarse for the
    bound."""

    kind: str
    passed: bool
    measured: float | None
    bound: float
    unit: str
    detail: str = ""
    hint: str = ""


BOUNDS = ("tolerance", "depth", "speed", "at_least", "distance")
"""Parameters that are an expectation's bound; each has one of them at most."""


ROUNDING_MAKES = 3.0
"""A miss of up to this many times the noise may be rounding alone, as for the differences of two engines."""


def evaluate(run: Run, noise: np.ndarray | None = None) -> list[Outcome]:
    """The outcome of every expectation of the run's world, in the world's order. ``noise``: to what distance (m) the engine
    repeats this run, by recorded row and body, where that was measured."""
    return [_evaluate(run, number, noise) for number in range(len(run.world.expectations))]


def _evaluate(run: Run, number: int, noise: np.ndarray | None) -> Outcome:
    expectation = run.world.expectations[number]
    parameters: Parameters = _in_numbers_of(run, dict(expectation.parameters))
    measure = MEASURES[expectation.kind]
    bound = next((float(parameters[name]) for name in BOUNDS if name in parameters), 0.0)
    if run.failed is not None or not run.recorded:
        return Outcome(expectation.kind, False, None, bound, "", f"the run failed: {run.failed}")
    try:
        measured = measure(run, parameters)
    except Unmeasurable as error:
        return Outcome(expectation.kind, False, None, bound, "", str(error))
    passed = measured.value >= measured.bound if measured.at_least else measured.value <= measured.bound
    detail, hint = measured.detail, ""
    if not passed and noise is not None and (why := _too_fine(run, measured, noise)):
        detail = f"{why}; {detail}"
        name = next(name for name in BOUNDS if name in parameters)
        name += "_single" if f"{name}_single" in parameters else ""
        path = f"expect.{number}.{expectation.kind}.{name}"
        hint = f"another bound in {run.engine} alone: --engine {run.engine} --set {path}=VALUE"
    value, bound = float(measured.value), float(measured.bound)
    return Outcome(expectation.kind, bool(passed), value, bound, measured.unit, detail, hint)


def _in_numbers_of(run: Run, parameters: Parameters) -> Parameters:
    """Parameters of an expectation with the tolerance that holds for the engine's numbers."""
    single = parameters.get("tolerance_single")
    engine = engines().get(engine_name(run.engine))
    if single is None:
        return parameters
    if engine is None or engine.PRECISION == DOUBLE:
        return {name: value for name, value in parameters.items() if name != "tolerance_single"}
    return {**parameters, "tolerance": single}


def _too_fine(run: Run, measured: Measured, noise: np.ndarray) -> str:
    """That a missed bound is finer than the engine's numbers resolve; "" where they do, or the miss is larger than theirs."""
    if measured.row is None or measured.row >= len(noise):
        return ""
    here = float(noise[measured.row].max(initial=0.0))
    if not measured.bound < here < np.inf or measured.value > ROUNDING_MAKES * here:
        return ""
    engine = engines().get(engine_name(run.engine))  # a stored run may be of an engine that is not known here
    numbers = f"{engine.PRECISION} precision" if engine is not None else run.engine
    return f"finer than {numbers} resolves here (noise {here:.2g} m)"
