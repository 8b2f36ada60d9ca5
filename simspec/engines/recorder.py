"""One run inside an engine's process: step, under the world's controllers if there are any, record, and time the stepping."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from simspec.control.law import Control
from simspec.control.native import Servos
from simspec.control.request import from_request
from simspec.engines.base import CONTACT_FIELDS, Actuation, Engine


class Stepper:
    """Steps an engine, with the controllers at work between the steps.

    ``seconds``: wall time inside the engine's step calls (``step``), processor time of the same (``cpu``), and wall time of the
    laws and of passing states and efforts (``control``).
    """

    def __init__(self, engine: Engine, control: Control | None):
        self._engine, self.control = engine, control
        self.seconds = {"step": 0.0, "cpu": 0.0, "control": 0.0} if control is None else control.seconds
        self._joints: Actuation | None = None
        self._servos: Servos | None = None
        if control is not None:
            self._joints = engine.actuate(control.q_places, control.v_places)
            own, at = control.native, control.native_places
            if own is not None:
                places = control.q_places[at], control.v_places[at]
                self._servos = engine.track(*places, own.stiffness, own.damping, own.limit)

    def advance(self, done: int, count: int) -> None:
        """Do steps ``done`` … ``done + count − 1`` of the run."""
        if self.control is not None and self._joints is not None:
            self.control.advance(self._joints, done, count, self._servos)
            return
        cpu = time.process_time()
        wall = time.perf_counter()
        self._engine.step(count)
        self.seconds["step"] += time.perf_counter() - wall
        self.seconds["cpu"] += time.process_time() - cpu


class Recording:
    """What a run leaves behind: rows of the named channels, taken one by one; see :func:`record` for their meaning."""

    def __init__(self, engine: Engine, channels: Iterable[str], control: Control | None):
        self._engine, self._control, self._channels = engine, control, frozenset(channels)
        names = ("step", "q", "v", "pose", "velocity", "energy", "control.target", "control.effort")
        self._rows: dict[str, list[Any]] = {name: [] for name in names}
        self._contacts: list[tuple[int, dict[str, np.ndarray]]] = []
        self.seconds = 0.0
        """Wall time of all rows."""

    def take(self, done: int) -> bool:
        """Add a row, after ``done`` steps. Returns whether the state is finite."""
        started = time.perf_counter()
        engine, control, rows = self._engine, self._control, self._rows
        pose, velocity = engine.body_states()
        q, v = engine.get_state()
        for name, value in (("step", done), ("q", q), ("v", v), ("pose", pose), ("velocity", velocity)):
            rows[name].append(value)
        if "energy" in self._channels:
            rows["energy"].append(engine.energy())
        if "contacts" in self._channels and done:
            self._contacts.append((len(rows["step"]) - 1, engine.contacts()))
        if control is not None:
            rows["control.target"].append(control.target if done else q[control.q_places])
            rows["control.effort"].append(control.applied)
        self.seconds += time.perf_counter() - started
        return bool(np.isfinite(pose).all() and np.isfinite(velocity).all())

    def arrays(self) -> dict[str, np.ndarray]:
        """All rows, by channel."""
        found = {name: np.array(values) for name, values in self._rows.items() if values}
        if "contacts" in self._channels:
            lengths = [len(block["distance"]) for _, block in self._contacts]
            found["contact.row"] = np.repeat([row for row, _ in self._contacts], lengths).astype(np.int64)
            for name, shape in CONTACT_FIELDS.items():
                blocks = [block[name] for _, block in self._contacts if len(block["distance"])]
                found[f"contact.{name}"] = np.concatenate(blocks) if blocks else np.zeros((0, *shape))
        return found


def _tell(place: Path, share: float) -> None:
    """Write the share that is done, whole: who looks meanwhile must not see half a number."""
    beside = place.with_name(f"{place.name}.new")
    beside.write_text(f"{share:.6f}", encoding="ascii")
    beside.replace(place)


def record(
    engine: Engine, arrays: dict[str, np.ndarray], operation: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Run ``operation["steps"]`` steps, recording every ``operation["every"]`` into the named ``channels``.

    ``arrays`` may hold q and v (another initial state), and with ``operation["control"]`` the references of the controllers
    (see ``control/request.py``). Row k of every array is the state *after* step ``step[k]``, the initial state first. Contacts
    are ragged: ``contact.row`` says to which row each belongs. ``control.target`` and ``control.effort`` (rows, joints): q* at
    the row's time, and the efforts of the step before it (zero in the first row; NaN for what the engine's own controllers
    drive), of the result's ``control.joints``.

    ``operation["progress"]`` may name a ``file``, to which the share that is done is written ``every`` so many seconds.

    Returns ``steps`` done, ``step_seconds`` (wall time inside the step calls alone, as the seed paper defines the
    real-time factor), ``cpu_seconds`` of the same, ``control_seconds`` (the laws, and passing states and efforts),
    ``control``: joints, largest tracking error and number of clipped steps by joint (None where only the engine knows), and
    ``failed``: None, or what went wrong and when (the state stopped being finite); and the arrays.
    """
    if "q" in arrays:
        engine.set_state(arrays["q"], arrays["v"])
    stepper = Stepper(engine, from_request(operation, arrays))
    control = stepper.control
    recording = Recording(engine, operation["channels"], control)
    steps, every = operation["steps"], operation["every"]
    done, failed = 0, None
    begun = time.perf_counter()
    progress = operation.get("progress")
    told = begun
    while True:
        if not recording.take(done):
            failed = f"the state is not finite after step {done}"
            break
        if done >= steps:
            break
        if progress is not None and time.perf_counter() - told >= progress["every"]:
            told = time.perf_counter()
            _tell(Path(progress["file"]), done / steps)
        count = min(every, steps - done)
        stepper.advance(done, count)
        done += count
    result: dict[str, Any] = {
        "steps": done,
        "step_seconds": stepper.seconds["step"],
        "cpu_seconds": stepper.seconds["cpu"],
        "control_seconds": stepper.seconds["control"],
        "record_seconds": recording.seconds,
        "run_seconds": time.perf_counter() - begun,
        "failed": failed,
    }
    if control is not None:
        native = np.isin(np.arange(len(control.joints)), control.native_places)
        result["control"] = {
            "joints": control.joints,
            "error": [float(value) if np.isfinite(value) else None for value in control.error],
            "clipped": [None if own else int(count) for own, count in zip(native, control.clipped, strict=True)],
        }
    return result, recording.arrays()
