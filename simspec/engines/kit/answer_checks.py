"""What single operations must answer beyond kinds and shapes. Driver only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simspec.control.reference import driven_joints
from simspec.engines.kit.answer_forms import BadAnswerError, Operation, planned_rows
from simspec.engines.kit.arrays import SECONDS
from simspec.errors import clipped
from simspec.language.vocabulary import JOINT_KINDS, QUATERNION_JOINTS, SHAPE_KINDS
from simspec.mapped import all_finite, parts, release, zeros
from simspec.world.canonical import from_plain
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, ReadBack

UNIT = 1e-6
"""How far from 1 the length of a quaternion that was read back may be: that of a single-precision one is 1e-7."""


def read_back(value: Mapping[str, Any], foreign: bool = False) -> ReadBack:
    """The read-back from plain data; of a foreign file (``foreign``) with joints and shapes of kinds that simspec does
    not have. Raises BadAnswerError where it is none, or holds no numbers where numbers must be."""
    try:
        held: ReadBack = from_plain(ReadBack, value)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise BadAnswerError(clipped(f"no read-back: {type(error).__name__}: {error}")) from None
    seen = set()
    for body in held.bodies:
        joint, place = body.joint, clipped(f"body {body.name!r}")
        if body.name in seen:
            raise BadAnswerError(f"{place} is duplicated")
        seen.add(body.name)
        if joint.kind not in JOINT_KINDS and not foreign:
            raise BadAnswerError(clipped(f"{place}: unknown kind of joint: {joint.kind!r}"))
        sizes = ((joint.position, POSITION_SIZE, "position"), (joint.velocity, VELOCITY_SIZE, "velocity"))
        for numbers, table, what in sizes:
            if joint.kind in table and len(numbers) not in (0, table[joint.kind]):
                raise BadAnswerError(f"{place}: {what} has {len(numbers)} numbers, should have {table[joint.kind]}")
        turns: list[tuple[float, ...]] = [joint.origin.quaternion, *(shape.pose.quaternion for shape in body.shapes)]
        if joint.kind in QUATERNION_JOINTS and joint.position:
            turns.append(joint.position[-4:])
        if not all(abs(math.hypot(*turn) - 1.0) <= UNIT for turn in turns):
            raise BadAnswerError(f"{place}: the orientation is not a unit quaternion")
        for shape in body.shapes:
            if shape.kind not in SHAPE_KINDS and not foreign:
                raise BadAnswerError(clipped(f"{place}: unknown kind of shape: {shape.kind!r}"))
    for name in ("unreadable", "inventory", "neutral"):
        for key, one in getattr(held, name).items():
            if not _plain_value(one) or (name == "unreadable" and not isinstance(one, str)):
                raise BadAnswerError(clipped(f"{name}: {key} is a {type(one).__name__}"))
    return held


def _plain_value(value: Any) -> bool:
    items = value if isinstance(value, list) else [value]
    # a whole number that no double holds would end every comparison of numbers
    return all(isinstance(item, (float, str)) or (isinstance(item, int) and abs(item) < 2**63) for item in items)


def check_touching(result: Mapping[str, Any], arrays: Mapping[str, np.ndarray], dimensions: Mapping[str, int]) -> None:
    """Each row names a state, and two bodies or units, that there are; units are of bodies that there are, or of none."""
    states, bodies = dimensions.get("states"), dimensions.get("bodies")
    for name, things in (("touching", bodies), ("units", len(result["units"]))):
        for column, bound in enumerate((states, things, things)):
            values = arrays[name][:, column]
            if len(values) and (values.min() < 0 or (bound is not None and values.max() >= bound)):
                raise BadAnswerError(f"{name} names {'things' if column else 'states'} that there are not")
    if bodies is not None and any(unit["body"] >= bodies for unit in result["units"]):
        raise BadAnswerError("units contain unknown bodies")


def check_motion(operation: Operation, result: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """All rows are there, unless the motion stopped being finite."""
    rows, planned = len(arrays["pose"]), planned_rows(operation)
    if not 1 <= rows <= planned or (rows < planned and np.isfinite(arrays["pose"][-1]).all()):  # type: ignore[operator]
        raise BadAnswerError(f"{rows} rows, should be {planned}")
    if result["steps"] != min((rows - 1) * operation.parameters["every"], operation.parameters["steps"]):
        raise BadAnswerError(f"{rows} rows of {result['steps']} steps")


def checked_run(operation: Operation, result: dict[str, Any], arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a run, ``step`` as whole numbers: all rows there and finite, or, where it failed, all but the last."""
    asked, failed, rows = operation.parameters, result["failed"], len(arrays["step"])
    planned, same = zeros((rows,), int), True
    for part in parts(rows, 8, planned, arrays["step"]):
        planned[part] = np.minimum(np.arange(part.start, part.stop) * asked["every"], asked["steps"])
        same = same and np.array_equal(arrays["step"][part], planned[part])
    if not rows or (rows != planned_rows(operation) and not failed):
        raise BadAnswerError(f"{rows} rows, should be {planned_rows(operation)}, one every {asked['every']} steps")
    if not same:
        raise BadAnswerError(f"the steps of its {rows} rows are not one every {asked['every']} of {asked['steps']}")
    if result["steps"] != planned[-1]:
        raise BadAnswerError(f"its last row is of step {planned[-1]}, and it reports {result['steps']} steps")
    if failed is not None and (failed["channel"] not in arrays or failed["step"] != result["steps"]):
        raise BadAnswerError("it reports a failure, but not after its last step")
    certain = rows - (failed is not None)
    for name in ("q", "v", "pose", "velocity", "energy", "control.target"):
        if name in arrays and not all_finite(arrays[name][:certain]):
            raise BadAnswerError(f"{name} is not finite, and the run is not reported as failed")
    if "control" in asked:
        _check_control(operation, result, arrays, certain)
    elif result["control"] is not None:
        raise BadAnswerError("controllers that were not requested")
    if "contact.row" in arrays:
        check_contacts(arrays, rows, certain)
    if "seconds" in arrays:
        _check_seconds(result, arrays["seconds"])
    _check_units(operation, result["contact_units"], arrays)
    return {**arrays, "step": planned}


ROUNDING = 1e-9
"""s, and relative: by how much the last row of ``seconds`` may exceed the totals, which may be added up in another order."""


def _check_seconds(result: Mapping[str, Any], seconds: np.ndarray) -> None:
    """Seconds never fall, and the last row is within the totals."""
    last = np.zeros(len(SECONDS))
    for part in parts(len(seconds), seconds[:1].nbytes, seconds):
        rows = np.vstack([last, seconds[part]])
        if not (np.isfinite(rows).all() and (np.diff(rows, axis=0) >= 0.0).all()):
            raise BadAnswerError("seconds are not finite, or fall from one row to the next")
        last = rows[-1]
    totals = {
        "step": "step_seconds",
        "step_cpu": "cpu_seconds",
        "control": "control_seconds",
        "record": "record_seconds",
    }
    for name, total in totals.items():
        if last[SECONDS.index(name)] > result[total] * (1.0 + ROUNDING) + ROUNDING:
            raise BadAnswerError(f"seconds: more in {name} than {total}")


def _check_control(
    operation: Operation, result: Mapping[str, Any], arrays: Mapping[str, np.ndarray], certain: int
) -> None:
    told = result["control"]
    if told is None:
        raise BadAnswerError("the controllers are missing")
    joints, columns = told["joints"], arrays["control.target"].shape[1]
    if not len(joints) == len(told["error"]) == len(told["clipped"]) == columns or len(set(joints)) != columns:
        raise BadAnswerError(f"{len(joints)} driven joints, and {columns} columns of them")
    if operation.world is not None:
        unknown = set(joints) - {body.joint.name for body in operation.world.bodies}
        missing = set(driven_joints(operation.world)) - set(joints)
        if unknown or missing:
            odd = ", ".join(sorted(unknown | missing))
            raise BadAnswerError(clipped(f"driven joints that are missing, or not the world's: {odd}"))
    # the efforts of the engine's own controllers are not known: None in the count of clipped steps, NaN in the rows
    known = np.array([one is not None for one in told["clipped"]], dtype=bool)
    effort = arrays["control.effort"][:certain]
    for part in parts(len(effort), effort[:1].nbytes, effort):
        if not np.isfinite(effort[part][:, known]).all():
            raise BadAnswerError("control.effort is not finite, and the run is not reported as failed")


def _check_units(
    operation: Operation, units: Sequence[Mapping[str, Any]] | None, arrays: Mapping[str, np.ndarray]
) -> None:
    """Units of contacts are there with their list or not at all; each is of its contact's body, and of shapes of that body."""
    if (units is None) != ("contact.unit" not in arrays):
        raise BadAnswerError("contact.unit and contact_units come together or not at all")
    if units is None:
        return
    told, body = arrays["contact.unit"], arrays["contact.body"]
    bodies = np.array([unit["body"] for unit in units], dtype=np.int64)
    used = np.zeros(len(units), dtype=bool)
    for part in parts(len(told), 64, told, body):
        if ((told[part] < 0) | (told[part] >= len(units))).any():
            raise BadAnswerError("contact.unit names units that are not in contact_units")
        if (bodies[told[part]] != body[part]).any():
            raise BadAnswerError("contact.unit names units of other bodies than contact.body")
        used[told[part]] = True
    for number in np.flatnonzero(used).tolist():
        unit = units[number]
        if not unit["shapes"]:
            raise BadAnswerError(f"contact_units: unit {number} touches, and has no shapes")
        if operation.world is not None:
            known = {shape.name for shape in operation.world.bodies[unit["body"]].shapes}
            if odd := set(unit["shapes"]) - known:
                message = (
                    f"contact_units: {sorted(odd)[0]!r} is no shape of {operation.world.bodies[unit['body']].name!r}"
                )
                raise BadAnswerError(clipped(message))


def check_contacts(arrays: Mapping[str, np.ndarray], rows: int, certain: int) -> None:
    """Contacts are of bodies that there are, in the order of the rows, and finite in the first ``certain`` of them."""
    row, body = arrays["contact.row"], arrays["contact.body"]
    bodies = arrays["pose"].shape[1]
    last = 0
    for part in parts(len(row), 24, row, body):
        some = row[part]
        if len(some) and (some[0] < last or some[-1] >= rows or (np.diff(some) < 0).any()):
            raise BadAnswerError("contact.row does not match the rows")
        if len(some):
            last = int(some[-1])
        if ((body[part] < 0) | (body[part] >= bodies)).any():
            raise BadAnswerError("contact.body contains unknown bodies")
    count = int(np.searchsorted(row, certain))
    release(row)
    for name in ("position", "normal", "distance", "normal_force"):
        if not all_finite(arrays[f"contact.{name}"][:count]):
            raise BadAnswerError(f"contact.{name} is not finite, and the run is not reported as failed")
