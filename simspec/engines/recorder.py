"""One run inside an engine's process: step, record, and time the stepping alone."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from simspec.engines.base import CONTACT_FIELDS, Engine


def record(
    engine: Engine, arrays: dict[str, np.ndarray], operation: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Run ``operation["steps"]`` steps, recording every ``operation["every"]`` into the named ``channels``.

    ``arrays`` may hold q and v (another initial state). Row k of every array is the state *after* step
    ``step[k]``, the initial state first. Contacts are ragged: ``contact.row`` says to which row each belongs.

    Returns ``steps`` done, ``step_seconds`` (wall time inside the step calls alone, as the seed paper defines the
    real-time factor), ``cpu_seconds`` of the same, and ``failed``: None, or what went wrong and when (the state stopped
    being finite); and the arrays.
    """
    if "q" in arrays:
        engine.set_state(arrays["q"], arrays["v"])
    channels = set(operation["channels"])
    steps, every = operation["steps"], operation["every"]
    rows: dict[str, list[Any]] = {"step": [], "q": [], "v": [], "pose": [], "velocity": [], "energy": []}
    contacts: list[tuple[int, dict[str, np.ndarray]]] = []
    step_seconds = cpu_seconds = 0.0
    done, failed = 0, None
    while True:
        pose, velocity = engine.body_states()
        q, v = engine.get_state()
        for name, value in (("step", done), ("q", q), ("v", v), ("pose", pose), ("velocity", velocity)):
            rows[name].append(value)
        if "energy" in channels:
            rows["energy"].append(engine.energy())
        if "contacts" in channels and done:
            contacts.append((len(rows["step"]) - 1, engine.contacts()))
        if not (np.isfinite(pose).all() and np.isfinite(velocity).all()):
            failed = f"the state is not finite after step {done}"
            break
        if done >= steps:
            break
        count = min(every, steps - done)
        cpu = time.process_time()
        wall = time.perf_counter()
        engine.step(count)
        step_seconds += time.perf_counter() - wall
        cpu_seconds += time.process_time() - cpu
        done += count
    found = {name: np.array(values) for name, values in rows.items() if values}
    if "contacts" in channels:
        lengths = [len(block["distance"]) for _, block in contacts]
        found["contact.row"] = np.repeat([row for row, _ in contacts], lengths).astype(np.int64)
        for name, shape in CONTACT_FIELDS.items():
            blocks = [block[name] for _, block in contacts if len(block["distance"])]
            found[f"contact.{name}"] = np.concatenate(blocks) if blocks else np.zeros((0, *shape))
    return {"steps": done, "step_seconds": step_seconds, "cpu_seconds": cpu_seconds, "failed": failed}, found
