"""The engine's side of the folder contract: read a request, work, write a result. Started by ``keeper.py``, beside this file.

It works in any environment that has numpy and the engine: this file makes its own ``simspec`` package importable without
putting the rest of simspec's environment on the path, so the engine may live in another interpreter.

FOLDER/request.json   schema; engine (its name); program ("module:Class"); operations (a list, see OPERATIONS; each with its
                      folder of artifacts, relative to FOLDER, and the kind and shape of each of its arrays; it may be an
                      ``attempt``, see ``attempts.py``)
FOLDER/at_work.txt    the number of the operation that is at work
FOLDER/request.bin    the arrays of the operations: little-endian, one after the other, in their order
FOLDER/artifacts/     the artifacts
FOLDER/result.json    schema, status (ok | error), error, versions, one entry per operation; an entry's ``arrays`` says the
                      kind (f8, i8) and shape of each array of its result, and where it is
FOLDER/result.bin     the arrays that are ``stored`` there: little-endian, one after the other, in the order of the entries
FOLDER/<index>.<name>.bin   an array that was written row by row, while the operation was at work

The result is written to a temporary name and renamed: a result that exists is whole. What each operation must give is said in
``answer_forms.py``; the other side checks all of it.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import json
import math
import os
import platform
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

SCHEMA = 3
REQUEST, REQUEST_ARRAYS = "request.json", "request.bin"
AT_WORK = "at_work.txt"
KINDS = {"f": "f8", "i": "i8", "b": "i8", "u": "i8"}
"""Kinds of arrays as they are written, by numpy's kinds."""
LINES, LINE, MESSAGE = 200, 2000, 8000
"""Lines of an engine's log, characters of each, and characters of an error or a refusal, that are passed on."""


def _make_simspec_importable() -> None:
    if "simspec" in sys.modules:
        return
    package = Path(__file__).resolve().parents[2]
    spec = importlib.util.spec_from_file_location(
        "simspec", package / "__init__.py", submodule_search_locations=[str(package)]
    )
    if spec is None or spec.loader is None:
        raise ImportError(f"no package at {package}")
    module = importlib.util.module_from_spec(spec)
    sys.modules["simspec"] = module
    spec.loader.exec_module(module)


def _read_back(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    from simspec.world.canonical import to_plain

    return to_plain(engine.read_back()), {}


def _kinematics(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """q (k, nq), v (k, nv) -> pose (k, bodies, 7), velocity (k, bodies, 6), and the state as read again."""
    import numpy as np

    found: dict[str, list[Any]] = {"pose": [], "velocity": [], "q": [], "v": []}
    for q, v in zip(arrays["q"], arrays["v"], strict=True):
        engine.set_state(q, v)
        pose, velocity = engine.body_states()
        again_q, again_v = engine.get_state()
        for name, value in (("pose", pose), ("velocity", velocity), ("q", again_q), ("v", again_v)):
            found[name].append(value)
    return {}, {name: np.array(values) for name, values in found.items()}


def _dynamics(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """q (k, nq), v (k, nv) -> mass (k, numbers), the blocks of M one after the other, each by rows; bias_force (k, nv); and
    gravity_force (k, nv), the same at rest. ``places`` (n,) are those of all blocks in v, ``sizes`` how many each has."""
    import numpy as np

    ends = np.cumsum(operation["sizes"])
    blocks = np.split(arrays["places"], ends[:-1]) if len(ends) else []
    found: dict[str, list[Any]] = {"mass": [], "bias_force": [], "gravity_force": []}
    for q, v in zip(arrays["q"], arrays["v"], strict=True):
        engine.set_state(q, v)
        found["mass"].append(np.concatenate([np.zeros(0), *(part.ravel() for part in engine.mass_blocks(blocks))]))
        found["bias_force"].append(engine.bias_force())
        engine.set_state(q, np.zeros_like(v))
        found["gravity_force"].append(engine.bias_force())
    return {}, {name: np.array(values) for name, values in found.items()}


def _without_dry_friction(engine: Any, places: Any) -> None:
    """Where nothing has dry friction, an engine that cannot switch it off is not asked to."""
    if len(places):
        engine.disable_dry_friction(places)


def _motion(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Contact-free motion from q (nq,), v (nv,) under a constant effort (nv,): ``steps`` steps, seen every ``every``. The dry
    friction at the places ``rubbing`` (n,) of v is taken away before.

    -> q (n, nq), v (n, nv), pose (n, bodies, 7), velocity (n, bodies, 6), the initial state first.
    """
    import numpy as np

    engine.disable_contact()
    _without_dry_friction(engine, arrays["rubbing"])
    engine.set_state(arrays["q"], arrays["v"])
    found: dict[str, list[Any]] = {"q": [], "v": [], "pose": [], "velocity": []}
    done = 0
    while True:
        q, v = engine.get_state()
        pose, velocity = engine.body_states()
        for name, value in (("q", q), ("v", v), ("pose", pose), ("velocity", velocity)):
            found[name].append(value)
        if done >= operation["steps"] or not np.isfinite(pose).all():
            break
        count = min(operation["every"], operation["steps"] - done)
        engine.step(count, arrays["effort"])
        done += count
    return {"steps": done}, {name: np.array(values) for name, values in found.items()}


def _trials(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Short contact-free motions, each from q (k, nq), v (k, nv) under a constant effort (k, nv), for ``steps``
    (k) -> v (k, nv)."""
    import numpy as np

    engine.disable_contact()
    found = []
    for q, v, effort, steps in zip(arrays["q"], arrays["v"], arrays["effort"], operation["steps"], strict=True):
        engine.set_state(q, v)
        engine.step(steps, effort)
        found.append(engine.get_state()[1])
    return {}, {"v": np.array(found)}


def _drive(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Motion with contact from the files' initial state: phases of (steps, every), effort (phases, nv).

    -> time (n,), pose (n, bodies, 7), velocity (n, bodies, 6), the initial state first.
    """
    import numpy as np

    time, poses, velocities = [], [], []
    done = 0

    def look() -> None:
        pose, velocity = engine.body_states()
        time.append(done * operation["timestep"])
        poses.append(pose)
        velocities.append(velocity)

    look()
    for (steps, every), effort in zip(operation["phases"], arrays["effort"], strict=True):
        given = effort if effort.any() else None
        left = steps
        while left:
            count = min(every, left)
            engine.step(count, given)
            done, left = done + count, left - count
            look()
    return {}, {"time": np.array(time), "pose": np.array(poses), "velocity": np.array(velocities)}


def _respond(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Contact-free motion under the controllers from q (nq,), v (nv,), without dry friction at the places ``rubbing`` (n,) of v
    -> positions (n, driven joints)."""
    from simspec.control.request import from_request

    engine.disable_contact()
    _without_dry_friction(engine, arrays["rubbing"])
    engine.set_state(arrays["q"], arrays["v"])
    control = from_request(operation, arrays)
    joints = engine.actuate(control.q_places, control.v_places)
    return {}, {"positions": control.follow(joints, operation["steps"], operation["every"])}


def _touching(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """q (k, nq) -> units (n, 3): index of the state, then the indices of two collision units that touch in it; touching: the
    same for bodies. The result names the units: index of the body, names of shapes."""
    import numpy as np

    from simspec.engines.kit.arrays import bodies_of

    units = engine.collision_units()
    found: dict[str, list[Any]] = {"units": [np.zeros((0, 3), np.int64)], "touching": [np.zeros((0, 3), np.int64)]}
    velocity = np.zeros(arrays["v"].shape[-1])
    for index, q in enumerate(arrays["q"]):
        engine.set_state(q, velocity)
        pairs = engine.detect_units()
        bodies = bodies_of(units, pairs)
        known = bodies[(bodies >= 0).all(axis=1)]  # a unit of no body of the world stands in ``units``
        for name, rows in (("units", pairs), ("touching", known)):
            found[name].append(np.column_stack([np.full(len(rows), index, np.int64), rows.reshape(-1, 2)]))
    named = [{"body": unit.body, "shapes": list(unit.shapes)} for unit in units]
    return {"units": named}, {name: np.concatenate(rows) for name, rows in found.items()}


def _run(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    from simspec.engines.kit.recorder import record

    return record(engine, arrays, operation, operation["place"])


OPERATIONS = {
    "read_back": _read_back,
    "kinematics": _kinematics,
    "dynamics": _dynamics,
    "motion": _motion,
    "trials": _trials,
    "drive": _drive,
    "respond": _respond,
    "touching": _touching,
    "run": _run,
}


def _work(folder: Path, request: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
    import numpy as np

    from simspec.engines.kit.attempts import attempt

    if request.get("schema") != SCHEMA:
        raise ValueError(f"request schema {request.get('schema')!r}, this worker reads {SCHEMA}")
    module, _, name = request["program"].partition(":")
    engine_class = getattr(importlib.import_module(module), name)
    entries: list[dict[str, Any]] = []
    stored: list[Any] = []
    for index, (asked, arrays) in enumerate(_requested(folder, request)):
        (folder / AT_WORK).write_text(str(index), encoding="ascii")
        operation = {**asked, "artifacts": folder / asked["artifacts"], "place": folder / f"{index}."}
        if operation.get("attempt", False):
            engine_class.prepare()
            entry, own = attempt(
                lambda given=(operation, arrays): _entry(engine_class, *given), operation, folder, MESSAGE
            )
        else:
            entry, own = _entry(engine_class, operation, arrays)
        entries.append(entry)
        stored += own
    return (
        {
            "status": "ok",
            "engine": engine_class.NAME,
            "engine_version": engine_class.version(),
            "numpy_version": np.__version__,
            "python_version": platform.python_version(),
            "platform": platform.platform(),
            "machine": platform.machine(),
            "operations": entries,
        },
        stored,
    )


def _requested(folder: Path, request: dict[str, Any]) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Each operation of a request, with its arrays."""
    import numpy as np

    with open(folder / REQUEST_ARRAYS, "rb") as file:
        for operation in request["operations"]:
            arrays = {}
            for name, form in operation["arrays"].items():
                count = math.prod(form["shape"])
                arrays[name] = np.fromfile(file, dtype=f"<{form['kind']}", count=count).reshape(form["shape"])
            yield operation, arrays


def _entry(engine_class: Any, operation: dict[str, Any], arrays: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
    """What result.json says of one operation, done with an engine loaded anew; and the arrays to be stored."""
    from simspec.dialects.kit.sidecar import read_sidecar

    engine = engine_class()
    failing = True
    started = time.perf_counter()
    try:
        place = operation["artifacts"]
        engine.load(place, read_sidecar(place))
        loaded = time.perf_counter()
        result, found = OPERATIONS[operation["op"]](engine, arrays, operation)
        own: list[Any] = []
        entry = {
            "op": operation["op"],
            "load_seconds": loaded - started,
            "seconds": time.perf_counter() - loaded,
            "log": [line[:LINE] for line in engine.log()[:LINES]],
            "result": result,
            "arrays": {key: _described(value, own) for key, value in found.items()},
        }
        failing = False
    finally:
        # what closing a half-loaded engine complains of must not hide why it could not be loaded
        with contextlib.suppress(*((Exception,) if failing else ())):
            engine.close()
    return entry, own


def _described(value: Any, stored: list[Any]) -> dict[str, Any]:
    """What result.json says of an array; those that are not in a file yet are added to ``stored``."""
    import numpy as np

    if isinstance(value, dict):  # written row by row: see the recorder
        return {**value, "stored": False}
    kind = KINDS.get(np.asarray(value).dtype.kind)
    if kind is None:
        raise TypeError(f"an array of {np.asarray(value).dtype}, not of numbers")
    stored.append(np.ascontiguousarray(value, dtype=f"<{kind}"))
    return {"kind": kind, "shape": list(stored[-1].shape), "stored": True}


def main(folder: Path) -> int:
    """Work off the request in ``folder``; 0 when a result with status ok was written."""
    _make_simspec_importable()
    request = json.loads((folder / REQUEST).read_text(encoding="utf-8"))
    stored: list[Any] = []
    try:
        result, stored = _work(folder, request)
        text = json.dumps({**result, "schema": SCHEMA})
    except Exception as error:  # recorded, whole, as this run's result: the other side decides what it means
        stored = []
        result = {
            "status": "error",
            "error": f"{type(error).__name__}: {error}"[:MESSAGE],
            "traceback": traceback.format_exc()[-MESSAGE:],
        }
        text = json.dumps({**result, "schema": SCHEMA})
    with open(folder / "result.bin.part", "wb") as file:
        for value in stored:
            value.tofile(file)
    os.replace(folder / "result.bin.part", folder / "result.bin")
    (folder / "result.json.part").write_text(text, encoding="utf-8")
    os.replace(folder / "result.json.part", folder / "result.json")
    return 0 if result["status"] == "ok" else 1
