"""The engine's side of the folder contract: read a request, work, write a result. Run as a script.

``python worker.py FOLDER`` in any environment that has numpy and the engine: this file makes its own ``simspec`` package
importable without putting the rest of simspec's environment on the path, so the engine may live in another interpreter.

FOLDER/request.json   schema; engine ("module:Class"); artifacts (folder); operations (a list, see OPERATIONS; each may
                      name another folder of artifacts, and be an ``attempt``: an exception is then its answer, as
                      ``{"refused": message}``, and the next operation follows)
FOLDER/request.npz    arrays of the operations, named "<index>.<name>"
FOLDER/result.json    schema, status (ok | error), error, versions, one entry per finished operation
FOLDER/result.npz     arrays of the results, named "<index>.<name>"

The result is written to a temporary name and renamed: a result that exists is whole.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import platform
import sys
import time
import traceback
from pathlib import Path
from typing import Any

SCHEMA = 1


def _make_simspec_importable() -> None:
    if "simspec" in sys.modules:
        return
    package = Path(__file__).resolve().parent.parent
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
    """q (k, nq), v (k, nv) -> mass_matrix (k, nv, nv), bias_force (k, nv), energy (k, 2)."""
    import numpy as np

    mass, bias, energy = [], [], []
    for q, v in zip(arrays["q"], arrays["v"], strict=True):
        engine.set_state(q, v)
        mass.append(engine.mass_matrix())
        bias.append(engine.bias_force())
        energy.append(engine.energy())
    return {}, {"mass_matrix": np.array(mass), "bias_force": np.array(bias), "energy": np.array(energy)}


def _motion(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Contact-free motion from q (nq,), v (nv,) under a constant effort (nv,): ``steps`` steps, seen every ``every``. The dry
    friction at the places ``rubbing`` (n,) of v is taken away before.

    -> q (n, nq), v (n, nv), pose (n, bodies, 7), velocity (n, bodies, 6), the initial state first.
    """
    import numpy as np

    engine.disable_contact()
    engine.disable_dry_friction(arrays["rubbing"])
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
    engine.disable_dry_friction(arrays["rubbing"])
    engine.set_state(arrays["q"], arrays["v"])
    control = from_request(operation, arrays)
    joints = engine.actuate(control.q_places, control.v_places)
    return {}, {"positions": control.follow(joints, operation["steps"], operation["every"])}


def _touching(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """q (k, nq) -> touching (n, 3): index of the state, then the indices of two bodies that touch in it."""
    import numpy as np

    rows = []
    velocity = np.zeros(arrays["v"].shape[-1])
    for index, q in enumerate(arrays["q"]):
        engine.set_state(q, velocity)
        pairs = engine.detect_contacts()
        rows.append(np.column_stack([np.full(len(pairs), index), pairs]) if len(pairs) else np.zeros((0, 3)))
    return {}, {"touching": np.concatenate(rows).astype(np.int64) if rows else np.zeros((0, 3), np.int64)}


def _run(engine: Any, arrays: dict[str, Any], operation: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    from simspec.engines.recorder import record

    return record(engine, arrays, operation)


OPERATIONS = {
    "read_back": _read_back,
    "kinematics": _kinematics,
    "dynamics": _dynamics,
    "motion": _motion,
    "drive": _drive,
    "respond": _respond,
    "touching": _touching,
    "run": _run,
}


def _work(folder: Path, request: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    import numpy as np

    from simspec.formats.base import read_sidecar

    if request.get("schema") != SCHEMA:
        raise ValueError(f"request schema {request.get('schema')!r}, this worker reads {SCHEMA}")
    module, _, name = request["engine"].partition(":")
    engine_class = getattr(importlib.import_module(module), name)
    artifacts = Path(request["artifacts"])
    given: dict[str, Any] = {}
    if (folder / "request.npz").exists():
        with np.load(folder / "request.npz", allow_pickle=False) as archive:
            given = {key: archive[key] for key in archive.files}
    entries: list[dict[str, Any]] = []
    results: dict[str, Any] = {}
    for index, operation in enumerate(request["operations"]):
        prefix = f"{index}."
        arrays = {key[len(prefix) :]: value for key, value in given.items() if key.startswith(prefix)}
        engine = engine_class()
        started = loaded = time.perf_counter()
        try:
            place = Path(operation.get("artifacts", artifacts))
            engine.load(place, read_sidecar(place))
            loaded = time.perf_counter()
            entry, found = OPERATIONS[operation["op"]](engine, arrays, operation)
            log = engine.log()
        except Exception as error:  # only where the request says so: what it refuses is then this operation's answer
            if not operation.get("attempt", False):
                raise
            entry, found, log = {"refused": f"{type(error).__name__}: {error}"}, {}, []
        finally:
            engine.close()
        entries.append(
            {
                "op": operation["op"],
                "load_seconds": loaded - started,
                "seconds": time.perf_counter() - loaded,
                "log": log,
                "result": entry,
            }
        )
        results.update({f"{prefix}{key}": value for key, value in found.items()})
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
        results,
    )


def main(folder: Path) -> int:
    """Work off the request in ``folder``; 0 when a result with status ok was written."""
    _make_simspec_importable()
    request = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    arrays: dict[str, Any] = {}
    try:
        result, arrays = _work(folder, request)
    except Exception as error:  # recorded, whole, as this run's result: the other side decides what it means
        result = {
            "status": "error",
            "error": f"{type(error).__name__}: {error}",
            "traceback": traceback.format_exc(),
        }
    import numpy as np

    result["schema"] = SCHEMA
    with open(folder / "result.npz.part", "wb") as file:
        np.savez(file, **arrays)
    os.replace(folder / "result.npz.part", folder / "result.npz")
    (folder / "result.json.part").write_text(json.dumps(result), encoding="utf-8")
    os.replace(folder / "result.json.part", folder / "result.json")
    return 0 if result["status"] == "ok" else 1


if __name__ == "__main__":
    sys.path.pop(0)  # this script's own folder, which would shadow engines' packages (engines/mujoco.py)
    code = main(Path(sys.argv[1]))
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # engines' own exit handlers have been seen to crash after all work was done
