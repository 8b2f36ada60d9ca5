"""One run inside an engine's process: step, under the world's controllers if there are any, record, and time the stepping."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from simspec.control.law import Control, Joints
from simspec.control.reference import Servos
from simspec.control.request import AppliedForces, Prescribed, forces_from_request, from_request, motions_from_request
from simspec.engines.kit.arrays import CONTACT_FIELDS, CONTACT_UNIT, plain_units
from simspec.engines.kit.contract import Actuation
from simspec.engines.kit.session import Session
from simspec.errors import EngineError
from simspec.processes import processor_clock

# The files of a recording, written while it grows: memory does not grow with the number of rows.

CHUNK_BYTES = 1_000_000
"""Size of the buffer that rows are collected in before they are written."""
CONTACT_CHUNK = 20_000
"""Contacts that are collected before they are written."""


class _Files:
    """One file for each array, ``<place><prefix><name>.bin``: little-endian numbers, row after row. ``kinds`` and ``shapes``
    are those of a row, by the arrays' names."""

    def __init__(self, place: Path, prefix: str, kinds: Mapping[str, str], shapes: Mapping[str, tuple[int, ...]]):
        self._prefix, self._kinds, self._shapes = prefix, kinds, shapes
        self._files = {name: open(f"{place}{prefix}{name}.bin", "wb") for name in shapes}  # noqa: SIM115 (closed in close())
        self._rows = dict.fromkeys(shapes, 0)

    def write(self, name: str, rows: np.ndarray) -> int:
        """Add rows to an array's file; returns their size in bytes."""
        block = np.ascontiguousarray(rows, dtype=f"<{self._kinds[name]}")
        self._files[name].write(block.data)
        self._rows[name] += len(block)
        return block.nbytes

    def close(self) -> dict[str, dict[str, Any]]:
        """Returns kind and shape of each array, by its name with the prefix."""
        for file in self._files.values():
            file.close()
        return {
            f"{self._prefix}{name}": {"kind": self._kinds[name], "shape": [self._rows[name], *shape]}
            for name, shape in self._shapes.items()
        }


class ColumnBuffer:
    """Rows of float64 of several channels, side by side in one buffer that is written when it is full: one file for each
    channel. Memory does not grow with the number of rows."""

    def __init__(self, shapes: dict[str, tuple[int, ...]], place: Path):
        sizes = {name: int(np.prod(shape, dtype=int)) for name, shape in shapes.items()}
        width = sum(sizes.values())
        self._rows = max(1, CHUNK_BYTES // max(1, 8 * width))
        self._block = np.empty((self._rows, width))
        self.views: dict[str, np.ndarray] = {}
        """The buffer of each channel (rows, ...)."""
        self.ends: dict[str, int] = {}
        """The column after each channel's last."""
        self._files = _Files(place, "", dict.fromkeys(shapes, "f8"), shapes)
        first = 0
        for name, shape in shapes.items():
            last = first + sizes[name]
            self.views[name] = self._block[:, first:last].reshape(self._rows, *shape)
            self.ends[name] = first = last
        self.at = 0
        """The row to be filled."""

    def row(self) -> np.ndarray:
        """The row that is being filled, all channels."""
        row: np.ndarray = self._block[self.at]
        return row

    def done(self) -> int:
        """The row is filled. Returns the bytes that were written because of it."""
        self.at += 1
        return self.write() if self.at == self._rows else 0

    def write(self) -> int:
        """Write what is collected; returns its size in bytes."""
        size = sum(self._files.write(name, view[: self.at]) for name, view in self.views.items())
        self.at = 0
        return size

    def close(self) -> dict[str, dict[str, Any]]:
        """Write the rest; returns kind and shape of each channel's array."""
        self.write()
        return self._files.close()


class Contacts:
    """Ragged contacts, written as :class:`ColumnBuffer` are; with the units that touch where the engine reports them."""

    def __init__(self, place: Path):
        self._place = place
        self._files = self._opened({"row": (), **CONTACT_FIELDS})
        self._units: _Files | None = None
        self._given: bool | None = None
        """Whether the engine reports the units of the contacts so far; None as long as there were none."""
        self._empty_given = False
        self._blocks: dict[str, list[np.ndarray]] = {name: [] for name in ("row", *CONTACT_FIELDS, CONTACT_UNIT)}
        self._collected = 0

    def _opened(self, shapes: Mapping[str, tuple[int, ...]]) -> _Files:
        kinds = {name: "i8" if name in ("row", "body", CONTACT_UNIT) else "f8" for name in shapes}
        return _Files(self._place, "contact.", kinds, shapes)

    def add(self, row: int, found: dict[str, np.ndarray]) -> int:
        """Add the contacts of a row. Returns the bytes that were written because of it. Raises ValueError where units are
        reported for some rows only."""
        count, given = len(found["distance"]), CONTACT_UNIT in found
        if not count:
            self._empty_given = given
            return 0
        if self._given is not None and given != self._given:
            raise ValueError("the units of contacts are reported for some rows only")
        self._given = given
        if given:
            self._blocks[CONTACT_UNIT].append(np.asarray(found[CONTACT_UNIT]).reshape(count, 2))
        self._blocks["row"].append(np.full(count, row, dtype=np.int64))
        for name, shape in CONTACT_FIELDS.items():
            self._blocks[name].append(np.asarray(found[name]).reshape(count, *shape))
        self._collected += count
        return self.write() if self._collected >= CONTACT_CHUNK else 0

    def write(self) -> int:
        """Write what is collected; returns its size in bytes."""
        size = 0
        for name, blocks in self._blocks.items():
            if blocks:
                size += self._of(name).write(name, np.concatenate(blocks))
                blocks.clear()
        self._collected = 0
        return size

    def _of(self, name: str) -> _Files:
        if name != CONTACT_UNIT:
            return self._files
        if self._units is None:
            self._units = self._opened({CONTACT_UNIT: (2,)})
        return self._units

    def close(self) -> dict[str, dict[str, Any]]:
        """Write the rest; returns kind and shape of each array, that of the units where the engine reports them."""
        self.write()
        arrays = self._files.close()
        if self._given or (self._given is None and self._empty_given):
            arrays |= self._of(CONTACT_UNIT).close()
        return arrays


Floats = NDArray[np.float64]


class Outer:
    """External actions on bodies: forces, and motions of kinematic bodies."""

    def __init__(self, forces: AppliedForces | None, prescribed: Prescribed | None):
        self._forces, self._prescribed = forces, prescribed

    @classmethod
    def of(cls, operation: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self | None:
        """The outer effects that a request contains; None without any."""
        forces, prescribed = forces_from_request(operation), motions_from_request(operation, arrays)
        return None if forces is None and prescribed is None else cls(forces, prescribed)

    def stretches(self, first: int, count: int) -> Iterator[tuple[int, int, bool]]:
        """``count`` steps from ``first`` on in pieces (first step, steps, whether something acts)."""
        if self._prescribed is not None or self._forces is None:
            return ((step, 1, True) for step in range(first, first + count))
        return self._forces.stretches(first, count)

    def effort(self, step: int, session: Session) -> Floats:
        """The effort (nv,) of a step, from the engine's state before it."""
        q, v = session.get_state()
        effort = np.zeros(len(v))
        if self._forces is not None and self._forces.acts(step):
            effort += self._forces.effort(step, session.body_states()[0])
        if self._prescribed is not None:
            effort += self._prescribed.effort(step, q, v)
        return effort


class Stepper:
    """Steps a session's engine, with the controllers and what acts from outside at work between the steps.

    ``seconds``: wall time inside the engine's step calls (``step``), processor time of the same (``cpu``), and both of the
    laws, the forces, and of passing states and efforts (``control``, ``control_cpu``).
    """

    def __init__(self, session: Session, control: Control | None, outer: Outer | None = None):
        self._session, self.control, self._outer = session, control, outer
        none = {"step": 0.0, "cpu": 0.0, "control": 0.0, "control_cpu": 0.0}
        self.seconds = none if control is None else control.seconds
        self._joints: Joints | None = None
        self._servos: Servos | None = None
        if control is not None:
            quick = self._joints = session.actuate(control.q_places, control.v_places)
            if outer is not None:
                self._joints = PushedJoints(session, outer, quick, control.q_places, control.v_places)
            native, at = control.native, control.native_places
            if native is not None:
                places = control.q_places[at], control.v_places[at]
                self._servos = session.track(*places, native.stiffness, native.damping, native.limit)

    def advance(self, done: int, count: int) -> None:
        """Do steps ``done`` … ``done + count − 1`` of the run."""
        if self.control is not None and self._joints is not None:
            if isinstance(self._joints, PushedJoints):
                self._joints.begin(done)
            self.control.advance(self._joints, done, count, self._servos)
        elif self._outer is not None:
            self._push(self._outer, done, count)
        else:
            self._step(count, None)

    def _push(self, outer: Outer, done: int, count: int) -> None:
        for first, steps, acts in outer.stretches(done, count):
            if not acts:
                self._step(steps, None)
                continue
            cpu, wall = time.process_time(), time.perf_counter()
            effort = outer.effort(first, self._session)
            self.seconds["control"] += time.perf_counter() - wall
            self.seconds["control_cpu"] += time.process_time() - cpu
            self._step(steps, effort)

    def _step(self, count: int, effort: Floats | None) -> None:
        clock = processor_clock()
        cpu = clock()
        wall = time.perf_counter()
        self._session.step(count, effort)
        self.seconds["step"] += time.perf_counter() - wall
        self.seconds["cpu"] += clock() - cpu


class PushedJoints:
    """The driven joints where forces act on bodies, too: quick access while none acts, all coordinates in the steps in which
    one does, and in the first one after them, which takes efforts on other coordinates away."""

    def __init__(
        self,
        session: Session,
        outer: Outer,
        quick: Actuation,
        q: NDArray[np.intp],
        v: NDArray[np.intp],
    ):
        self._session, self._outer, self._quick, self._q, self._v = session, outer, quick, q, v
        self._effort = np.zeros(0)
        self._step, self._until, self._acts, self._whole = 0, 0, False, False
        self._left = False
        """Whether the last step may have left efforts on other coordinates."""

    def begin(self, step: int) -> None:
        """The next step is step ``step`` of the run."""
        self._step = self._until = step

    def read(self) -> tuple[Floats, Floats]:
        if self._step >= self._until:
            _, steps, self._acts = next(self._outer.stretches(self._step, AHEAD))
            self._until = self._step + (steps if self._acts or not self._left else 1)
            self._whole = self._acts or self._left
        if not self._whole:
            return self._quick.read()
        q, v = self._session.get_state()
        return q[self._q], v[self._v]

    def give(self, effort: Floats) -> None:
        if not self._whole:
            self._quick.give(effort)
            return
        if self._acts:
            self._effort = self._outer.effort(self._step, self._session)
        else:
            self._effort = np.zeros(len(self._session.get_state()[1]))
        self._effort[self._v] += effort

    def step(self) -> None:
        self._step += 1
        if self._whole:
            self._session.step(1, self._effort)
            self._left = self._acts
        else:
            self._quick.step()


AHEAD = 1_000_000
"""Steps up to which it is looked when the next force begins."""


MOST_BYTES = 16 * 2**30
"""Where a request does not say how much may be recorded."""


class Recording:
    """The records of a run: rows of the named channels, taken one by one into files ``<place><channel>.bin``; see
    :func:`record` for their meaning. Raises EngineError when that becomes more than ``most`` bytes."""

    def __init__(
        self,
        session: Session,
        channels: Iterable[str],
        control: Control | None,
        place: Path | str,
        most: int,
        stepping: Mapping[str, float],
    ):
        self._session, self._control, self._place, self._stepping = session, control, Path(place), stepping
        channels = frozenset(channels)
        self._energy = "energy" in channels
        self._contacts = Contacts(self._place) if "contacts" in channels else None
        self._columns: ColumnBuffer | None = None
        self._known: np.ndarray | None = None
        """Columns of efforts that only the engine knows, where it has controllers of its own."""
        self._most, self._bytes = most, 0
        self._row = 0
        self.failed: dict[str, Any] | None = None
        """The first number that was not finite: ``step``, ``channel``, and ``place`` in the channel's row."""
        self.seconds = self.cpu_seconds = 0.0
        """Wall and processor time of all rows."""

    def take(self, done: int) -> bool:
        """Add a row, after ``done`` steps. Returns whether all of it is finite."""
        started, started_cpu = time.perf_counter(), time.process_time()
        session, control = self._session, self._control
        pose, velocity = session.body_states()
        q, v = session.get_state()
        row: dict[str, Any] = {"step": done, "q": q, "v": v, "pose": pose, "velocity": velocity}
        if self._energy:
            row["energy"] = session.energy()
        if control is not None:
            row["control.target"] = control.target if done else q[control.q_places]
            row["control.effort"] = control.applied
        spent = self._stepping
        row["seconds"] = (
            spent["step"],
            spent["cpu"],
            spent["control"],
            spent["control_cpu"],
            self.seconds,
            self.cpu_seconds,
        )
        columns = self._columns
        if columns is None:
            columns = self._columns = self._begin(row)
        views, at = columns.views, columns.at
        for name, value in row.items():
            views[name][at] = value
        if not (
            np.isfinite(columns.row()).all() if self._known is None else np.isfinite(columns.row()[self._known]).all()
        ):
            self.failed = self._which(row, done)
        self._bytes += columns.done()
        if self._contacts is not None and done:
            found = session.contacts()
            if len(found["distance"]) and self.failed is None:
                self.failed = _which_contact(found, done)
            self._bytes += self._contacts.add(self._row, found)
        if self._bytes > self._most:
            why = f"more than {self._most:,} bytes are recorded; record fewer channels, or less often"
            raise EngineError(session.name, why)
        self._row += 1
        self.seconds += time.perf_counter() - started
        self.cpu_seconds += time.process_time() - started_cpu
        return self.failed is None

    def _begin(self, row: dict[str, Any]) -> ColumnBuffer:
        columns = ColumnBuffer({name: np.shape(value) for name, value in row.items()}, self._place)
        native = () if self._control is None else self._control.native_places
        if len(native):
            known = np.ones(len(columns.row()), dtype=bool)
            first = columns.ends["control.effort"] - np.size(row["control.effort"])
            known[first + np.asarray(native)] = False
            self._known = known
        return columns

    def _which(self, row: dict[str, Any], done: int) -> dict[str, Any] | None:
        for name, value in row.items():
            bad = ~np.isfinite(np.asarray(value, dtype=float))
            if name == "control.effort" and self._control is not None:
                bad[self._control.native_places] = False
            if bad.any():
                return {"step": done, "channel": name, "place": [int(k) for k in np.argwhere(bad)[0]]}
        return None

    def arrays(self) -> dict[str, dict[str, Any]]:
        """Close the files; returns kind and shape of every array."""
        found = self._columns.close() if self._columns is not None else {}
        return found | (self._contacts.close() if self._contacts is not None else {})


def _which_contact(found: dict[str, np.ndarray], done: int) -> dict[str, Any] | None:
    for name in ("distance", "normal_force", "position", "normal"):
        bad = ~np.isfinite(found[name])
        if bad.any():
            return {"step": done, "channel": f"contact.{name}", "place": [int(k) for k in np.argwhere(bad)[0]]}
    return None


def _tell(place: Path, share: float) -> None:
    """Write the completed share, atomically: readers must not see half a number."""
    name = place.with_name(f"{place.name}.new")
    name.write_text(f"{share:.6f}", encoding="ascii")
    name.replace(place)


def record(
    session: Session, arrays: Mapping[str, np.ndarray], operation: Mapping[str, Any], place: Path | str
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Run ``operation["steps"]`` steps, recording every ``operation["every"]`` into the named ``channels``, of at most
    ``operation["most"]`` bytes, in files ``<place><channel>.bin``: little-endian numbers, row after row.

    ``arrays`` may hold q and v (another initial state), and with ``operation["control"]`` the references of the controllers
    (see ``control/request.py``). Row k of every array is the state *after* step ``step[k]``, the initial state first. Contacts
    are ragged: ``contact.row`` says to which row each belongs. ``control.target`` and ``control.effort`` (rows, joints): q* at
    the row's time, and the efforts of the step before it (zero in the first row; NaN for what the engine's own controllers
    drive), of the result's ``control.joints``. ``seconds`` (rows, ``SECONDS``): wall and processor time spent until the row was
    reached.

    ``operation["progress"]`` may name a ``file``, to which the share that is done is written ``every`` so many seconds.

    Returns ``steps`` done, ``step_seconds`` (wall time inside the step calls alone, as the seed paper defines the
    real-time factor), ``cpu_seconds`` of the same, ``control_seconds`` (the laws, and passing states and efforts),
    ``control``: joints, largest tracking error and number of clipped steps by joint (None where only the engine knows), and
    ``failed``: None, or the first number of any channel that was not finite: after which ``step``, in which ``channel``, at
    which ``place`` of the channel's row; there the run ended; and, where the engine reports the units of contacts,
    ``contact_units``: the targets of ``contact.unit`` (contacts, 2). And kind and shape of the arrays.
    """
    if "q" in arrays:
        session.set_state(arrays["q"], arrays["v"])
    stepper = Stepper(session, from_request(operation, arrays), Outer.of(operation, arrays))
    control = stepper.control
    recording = Recording(
        session, operation["channels"], control, place, operation.get("most", MOST_BYTES), stepper.seconds
    )
    steps, every = operation["steps"], operation["every"]
    session.ready()
    done = 0
    begun = time.perf_counter()
    progress = operation.get("progress")
    last_progress = begun
    while True:
        if not recording.take(done) or done >= steps:
            break
        if progress is not None and time.perf_counter() - last_progress >= progress["every"]:
            last_progress = time.perf_counter()
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
        "failed": recording.failed,
    }
    if control is not None:
        native = np.isin(np.arange(len(control.joints)), control.native_places)
        result["control"] = {
            "joints": control.joints,
            "error": [float(value) if np.isfinite(value) else None for value in control.error],
            "clipped": [None if local else int(count) for local, count in zip(native, control.clipped, strict=True)],
        }
    written = recording.arrays()
    if "contact.unit" in written:
        result["contact_units"] = plain_units(session.collision_units())
    return result, written
