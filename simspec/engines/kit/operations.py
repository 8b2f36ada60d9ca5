"""The named operations that an engine's process does (``docs/design/engine-process.md``), each with a session of the engine.

An operation is given its arrays and its parameters, and answers a plain result and arrays. Their forms are defined in
``answer_forms.py``; the other side checks all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.control.request import from_request
from simspec.engines.kit.arrays import CONTACT_FIELDS, bodies_of, plain_units
from simspec.engines.kit.foreign import foreign_answer
from simspec.engines.kit.recorder import Outer, Stepper, record
from simspec.engines.kit.session import Condition, Session
from simspec.world.canonical import to_plain

Arrays = Mapping[str, np.ndarray]
Parameters = Mapping[str, Any]
Result = tuple[Any, dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Named:
    """The function of an operation, and the latest condition of the session that it permits."""

    do: Callable[[Any, Arrays, Parameters], Result]
    needs: Condition = Condition.FRESH
    bare: bool = False
    """Whether it is given an engine that has loaded nothing."""


def _read_back(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    return to_plain(session.read_back()), {}


def _foreign(session: Any, arrays: Arrays, operation: Parameters) -> Result:
    """``file`` (absolute) of ``language``, loaded as a user would, with ``packages`` (folders by name) -> a read-back."""
    return to_plain(foreign_answer(session, operation)), {}


def _kinematics(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """q (k, nq), v (k, nv) -> pose (k, bodies, 7), velocity (k, bodies, 6), the state as read again, and, where the engine
    receives named frames, ``frame`` (k, frames, 7)."""
    rows: dict[str, list[Any]] = {"pose": [], "velocity": [], "q": [], "v": []}
    for q, v in zip(arrays["q"], arrays["v"], strict=True):
        session.set_state(q, v)
        _add_state(rows, session)
        if (frames := session.frame_poses()) is not None:
            rows.setdefault("frame", []).append(frames)
    return {}, {name: np.array(values) for name, values in rows.items()}


def _add_state(rows: dict[str, list[Any]], session: Session) -> np.ndarray:
    """Add the present state, coordinates and bodies, to rows; returns the poses."""
    pose, velocity = session.body_states()
    q, v = session.get_state()
    for name, value in (("pose", pose), ("velocity", velocity), ("q", q), ("v", v)):
        rows[name].append(value)
    return pose


def _dynamics(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """q (k, nq), v (k, nv) -> mass (k, numbers), the blocks of M one after the other, each by rows; bias_force (k, nv); and
    gravity_force (k, nv), the same at rest. ``places`` (n,) are those of all blocks in v, ``sizes`` how many each has;
    ``quantities`` says which are requested: ``mass_matrix``, ``bias_force`` (and with it the gravity force)."""
    wanted = operation["quantities"]
    ends = np.cumsum(operation["sizes"])
    blocks = np.split(arrays["places"], ends[:-1]) if len(ends) else []
    rows: dict[str, list[Any]] = {}
    for q, v in zip(arrays["q"], arrays["v"], strict=True):
        session.set_state(q, v)
        if "mass_matrix" in wanted:
            mass = np.concatenate([np.zeros(0), *(part.ravel() for part in session.mass_blocks(blocks))])
            rows.setdefault("mass", []).append(mass)
        if "bias_force" in wanted:
            rows.setdefault("bias_force", []).append(session.bias_force())
            session.set_state(q, np.zeros_like(v))
            rows.setdefault("gravity_force", []).append(session.bias_force())
    return {}, {name: np.array(values) for name, values in rows.items()}


def _motion(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """Contact-free motion from q (nq,), v (nv,) under a constant effort (nv,): ``steps`` steps, seen every ``every``. The dry
    friction at the places ``rubbing`` (n,) of v is taken away before. ``pushed``: the same under the forces on bodies, too, or
    with what moves kinematic bodies.

    -> q (n, nq), v (n, nv), pose (n, bodies, 7), velocity (n, bodies, 6), the initial state first.
    """
    session.disable_contact()
    session.disable_dry_friction(arrays["rubbing"])
    session.set_state(arrays["q"], arrays["v"])
    rows: dict[str, list[Any]] = {"q": [], "v": [], "pose": [], "velocity": []}
    done, outer = 0, Outer.of(operation, arrays)
    while True:
        pose = _add_state(rows, session)
        if done >= operation["steps"] or not np.isfinite(pose).all():
            break
        count = min(operation["every"], operation["steps"] - done)
        if outer is None:
            session.step(count, arrays["effort"])
        else:
            for step in range(done, done + count):
                session.step(1, arrays["effort"] + outer.effort(step, session))
        done += count
    return {"steps": done}, {name: np.array(values) for name, values in rows.items()}


def _limit(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """The contact-free motion of :func:`_motion` by each of ``timesteps`` (s): from the same state for the same time, of which
    the first is passed in ``steps`` steps, seen every ``every`` of these -> pose (timesteps × rows, bodies, 7), the initial
    ones first; NaN after a motion that is no longer finite."""
    session.disable_contact()
    session.disable_dry_friction(arrays["rubbing"])
    times, every = operation["timesteps"], operation["every"]
    poses = []
    for timestep in times:
        finer = round(times[0] / timestep)
        session.set_timestep(timestep)
        session.set_state(arrays["q"], arrays["v"])
        poses.append(session.body_states()[0])
        for _ in range(0, operation["steps"], every):
            if np.isfinite(poses[-1]).all():
                session.step(every * finer, arrays["effort"])
                poses.append(session.body_states()[0])
            else:
                poses.append(np.full_like(poses[-1], np.nan))
    return {}, {"pose": np.array(poses)}


def _trials(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """Short contact-free motions, each from q (k, nq), v (k, nv) under a constant effort (k, nv), for ``steps``
    (k) -> v (k, nv). ``stopped``, ``accelerations``: without dry friction at the places ``rubbing`` (n,) of v."""
    session.disable_contact()
    if "rubbing" in arrays:
        session.disable_dry_friction(arrays["rubbing"])
    velocities = []
    for q, v, effort, steps in zip(arrays["q"], arrays["v"], arrays["effort"], operation["steps"], strict=True):
        session.set_state(q, v)
        session.step(steps, effort)
        velocities.append(session.get_state()[1])
    return {}, {"v": np.array(velocities)}


def _drive(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """Motion with contact from the files' initial state: phases of (steps, every), effort (phases, nv).

    -> time (n,), pose (n, bodies, 7), velocity (n, bodies, 6), the initial state first.
    """
    time, poses, velocities = [], [], []
    done = 0

    def look() -> None:
        pose, velocity = session.body_states()
        time.append(done * operation["timestep"])
        poses.append(pose)
        velocities.append(velocity)

    look()
    for (steps, every), effort in zip(operation["phases"], arrays["effort"], strict=True):
        acting = effort if effort.any() else None
        left = steps
        while left:
            count = min(every, left)
            session.step(count, acting)
            done, left = done + count, left - count
            look()
    return {}, {"time": np.array(time), "pose": np.array(poses), "velocity": np.array(velocities)}


def _respond(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """Contact-free motion under the controllers from q (nq,), v (nv,), without dry friction at the places ``rubbing`` (n,) of v
    -> positions (n, driven joints)."""
    control = from_request(operation, arrays)
    if control is None:
        raise ValueError("respond needs controllers")
    session.disable_contact()
    session.disable_dry_friction(arrays["rubbing"])
    session.set_state(arrays["q"], arrays["v"])
    joints = session.actuate(control.q_places, control.v_places)
    return {}, {"positions": control.follow(joints, operation["steps"], operation["every"])}


def _touching(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """q (k, nq) -> units (n, 3): index of the state, then the indices of two collision units that touch in it; touching: the
    same for bodies. The result names the units: index of the body, names of shapes."""
    units = session.collision_units()
    tables: dict[str, list[np.ndarray]] = {
        "units": [np.zeros((0, 3), np.int64)],
        "touching": [np.zeros((0, 3), np.int64)],
    }
    velocity = np.zeros(arrays["v"].shape[-1])
    for index, q in enumerate(arrays["q"]):
        session.set_state(q, velocity)
        pairs = session.detect_units()
        bodies = bodies_of(units, pairs)
        known = bodies[(bodies >= 0).all(axis=1)]  # a unit of no body of the world stands in ``units``
        for name, rows in (("units", pairs), ("touching", known)):
            tables[name].append(np.column_stack([np.full(len(rows), index, np.int64), rows.reshape(-1, 2)]))
    return {"units": plain_units(units)}, {name: np.concatenate(rows) for name, rows in tables.items()}


def _windows(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    """Short motions with contact and under the controllers, ``steps`` steps each, from q (k, nq), v (k, nv), each the state
    after ``starts`` (k) steps of a run -> q (k, nq), v (k, nv), pose (k, bodies, 7), velocity (k, bodies, 6) at their ends.
    With the channel ``contacts`` also the contacts of each one's last step; ``contact.row`` is its place among the k. With
    ``q_before``, ``v_before`` (k, ...), states ``steps`` steps earlier, the engine first steps from these, so that it has the
    contact points that it keeps from earlier steps."""
    stepper = Stepper(session, from_request(operation, arrays), Outer.of(operation, arrays))
    with_contacts = "contacts" in operation["channels"]
    rows: dict[str, list[Any]] = {"pose": [], "velocity": [], "q": [], "v": []}
    touching: dict[str, list[np.ndarray]] = {name: [] for name in ("row", *CONTACT_FIELDS)}
    for index, (q, v, start) in enumerate(zip(arrays["q"], arrays["v"], operation["starts"], strict=True)):
        if "q_before" in arrays and start >= operation["steps"]:
            session.set_state(arrays["q_before"][index], arrays["v_before"][index])
            stepper.advance(start - operation["steps"], operation["steps"])
            session.move_to(q, v)
        else:
            session.set_state(q, v)
        stepper.advance(start, operation["steps"])
        _add_state(rows, session)
        if with_contacts:
            contacts = session.contacts()
            count = len(contacts["distance"])
            touching["row"].append(np.full(count, index, np.int64))
            for name, shape in CONTACT_FIELDS.items():
                touching[name].append(np.asarray(contacts[name]).reshape(count, *shape))
    answer: dict[str, Any] = {name: np.array(values) for name, values in rows.items()}
    if with_contacts:
        answer |= {f"contact.{name}": np.concatenate(blocks) for name, blocks in touching.items()}
    return {}, answer


def _run(session: Session, arrays: Arrays, operation: Parameters) -> Result:
    return record(session, arrays, operation, operation["place"])


OPERATIONS: Mapping[str, Named] = {
    "read_back": Named(_read_back, Condition.QUERIED),
    "kinematics": Named(_kinematics, Condition.PLACED),
    "dynamics": Named(_dynamics, Condition.PLACED),
    "touching": Named(_touching, Condition.PLACED),
    "motion": Named(_motion),
    "pushed": Named(_motion),
    "prescribed": Named(_motion),
    "trials": Named(_trials),
    "stopped": Named(_trials),
    "accelerations": Named(_trials),
    "limit": Named(_limit),
    "drive": Named(_drive),
    "respond": Named(_respond),
    "windows": Named(_windows),
    "run": Named(_run),
    "foreign": Named(_foreign, bare=True),
}
"""Each motion begins with a load of its own. Operations that set the states of their queries may share one; the
model, of which the initial state is a part, is read back before any state is set."""
