"""Whether an imported file is the same model as the original: mass matrix, bias force, passive forces and the place of every
body, in random states. The compiler computes the original, the oracle the imported world; they share no code.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.dynamics.oracle import Oracle
from simspec.imports.files import Files
from simspec.imports.mjcf.assembly import assemble
from simspec.imports.mjcf.bodies import MjcfBodies, Vector, inverse, product, rotated
from simspec.imports.mjcf.compiled import BALL, FREE, MjcfFeatures, compile_model
from simspec.imports.mjcf.constraints import without_effect
from simspec.imports.mjcf.importer import imported
from simspec.language.foreign import Imported, ImportOptions
from simspec.language.load import Spec
from simspec.world.inertia import lumped_inertial
from simspec.world.types import World

SPREAD: Final = 0.7
"""Standard deviation of random positions (rad, m) about the reference configuration; velocities have 1."""

SHORT: Final = 1e-8
"""s: a timestep at which no damper is unstable, so that every world resolves; nothing here is stepped."""


@dataclass(frozen=True)
class Deviations:
    """The largest deviations over all states, relative to the largest number of each kind; places in m, or relative beyond
    1 m."""

    mass: float
    bias: float
    passive: float
    place: float

    @property
    def worst(self) -> float:
        """The largest of all."""
        return max(self.mass, self.bias, self.passive, self.place)


def deviations(path: Path, options: ImportOptions, states: int = 3, seed: int = 1) -> tuple[Deviations, Imported]:
    """How far the world of an imported file is from the file's own compiled model, and what was imported. Raises SpecError as
    reading, checking and resolving do, ValueError for a model without coordinates."""
    files = Files(path, str(path), options)
    assembly = assemble(files)
    model = compile_model(assembly, (states, seed, SPREAD))
    if not model.dynamics:
        raise ValueError("nothing in this model moves")
    bodies = MjcfBodies(model, MjcfFeatures())
    what = imported(assembly, bodies, files)
    timed = {**what.data, "physics": {**what.data["physics"], "timestep": SHORT}}
    world = Spec.from_data(timed, folder=path.parent, allow_outside=options.project is None).resolve()
    worst = np.zeros(4)
    for answer in model.dynamics:
        worst = np.maximum(worst, _compare(world, bodies, answer))
    return Deviations(*(float(value) for value in worst)), what


def _compare(world: World, bodies: MjcfBodies, answer: dict[str, Any]) -> Vector:
    """Relative deviations of mass matrix, bias force, passive force and places in one state."""
    q, v, change, extra = _coordinates(world, bodies, answer)
    oracle = Oracle(world)
    local_mass = oracle.mass_matrix(q)
    mass = change.T @ local_mass @ change
    bias = change.T @ (oracle.bias_force(q, v) + local_mass @ extra)
    passive = change.T @ oracle.joint_effort(q, v)
    wanted = {name: np.asarray(answer[name]) for name in ("mass", "bias", "passive", "position", "quaternion")}
    missing = _moving(bodies, passive - wanted["passive"])
    scale = max(1e-12, float(np.abs(wanted["mass"]).max()))
    force = max(scale, float(np.abs(wanted["bias"]).max()))
    return np.array(
        [
            np.abs(mass - wanted["mass"]).max() / scale,
            np.abs(bias - wanted["bias"]).max() / force,
            np.abs(missing).max() / max(force, float(np.abs(wanted["passive"]).max())),
            _places(world, bodies, oracle.body_poses(q), wanted),
        ]
    )


def _moving(bodies: MjcfBodies, force: Vector) -> Vector:
    """The part of a force that moves anything, in addition to the sums of joint positions that constraints fix."""
    effect = without_effect(bodies.model, bodies.fixed_tendons)
    along = np.zeros((len(effect), len(force)))
    for row, summed in zip(along, effect, strict=True):
        for joint, coefficient in summed.items():
            row[int(bodies.model["jnt_dofadr"][joint])] = coefficient
    absorbed: Vector = along.T @ np.linalg.lstsq(along.T, force, rcond=None)[0] if effect else np.zeros_like(force)
    return force - absorbed


def _rows(world: World, bodies: MjcfBodies) -> dict[int, int]:
    """Rows of the world's bodies that joints move, by the compiler's numbers of the joints."""
    model = bodies.model
    named = {body.joint.name.rpartition("/")[2]: row for row, body in enumerate(world.bodies)}
    rows = {}
    for number, row in _numbers(world, bodies).items():
        for joint in model.joints_of(number):
            rows[joint] = named[bodies.joints[joint]] if joint in bodies.joints else row
    return rows


def _numbers(world: World, bodies: MjcfBodies) -> dict[int, int]:
    rows = {body.name.rpartition("/")[2]: row for row, body in enumerate(world.bodies)}
    return {number: rows[name] for number, name in bodies.names.items()}


def _coordinates(
    world: World, bodies: MjcfBodies, answer: dict[str, Any]
) -> tuple[Vector, Vector, NDArray[np.float64], Vector]:
    """A state of the compiler in the world's coordinates (q, v), the matrix C in v = C w of its velocities w, and Ċ w."""
    model, layout = bodies.model, Oracle(world).layout
    positions, velocities = np.asarray(answer["qpos"]), np.asarray(answer["qvel"])
    q, extra = np.zeros(layout.nq), np.zeros(layout.nv)
    change = np.zeros((layout.nv, model.numbers["nv"]))
    for joint, row in _rows(world, bodies).items():
        at_q, at_v = layout.position[row], layout.velocity[row]
        kind, from_q, from_v = (int(model[f"jnt_{word}"][joint]) for word in ("type", "qposadr", "dofadr"))
        if kind == FREE:
            turn = positions[from_q + 3 : from_q + 7]
            lever = rotated(turn, np.asarray(lumped_inertial(world, world.bodies[row]).centre_of_mass))
            q[at_q] = np.r_[positions[from_q : from_q + 3] + lever, turn]
            change[at_v, from_v : from_v + 6] = _at_centre(turn, lever)
            spin = rotated(turn, velocities[from_v + 3 : from_v + 6])
            extra[at_v.start : at_v.start + 3] = np.cross(spin, np.cross(spin, lever))
        elif kind == BALL:
            q[at_q] = positions[from_q : from_q + 4]
            change[at_v, from_v : from_v + 3] = np.eye(3)
        else:
            q[at_q] = positions[from_q] - model["qpos0"][from_q]
            change[at_v, from_v] = 1.0
    return q, change @ velocities, change, extra


def _at_centre(turn: Vector, lever: Vector) -> NDArray[np.float64]:
    """From (velocity of the origin, angular velocity in the body's axes) to that of the centre of mass, which is at ``lever``
    from it in world axes."""
    matrix = np.eye(6)
    for axis in range(3):
        matrix[:3, 3 + axis] = np.cross(rotated(turn, np.eye(3)[axis]), lever)
    return matrix


def _places(world: World, bodies: MjcfBodies, poses: Vector, wanted: dict[str, Vector]) -> float:
    """The largest deviation of a body's origin (m, relative beyond 1 m) or orientation (rad)."""
    worst = 0.0
    for number, row in _numbers(world, bodies).items():
        turn = wanted["quaternion"][number]
        place = wanted["position"][number] + rotated(turn, bodies.shifts[number])
        off = np.abs(poses[row][:3] - place).max() / max(1.0, float(np.abs(place).max()))
        angle = 2.0 * np.linalg.norm(product(inverse(turn), poses[row][3:])[1:])
        worst = max(worst, float(off), float(angle))
    return worst
