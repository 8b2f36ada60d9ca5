"""Operations in a separate process: shared processes, and operations after the end of a process."""

from __future__ import annotations

import os
import signal
import time

import numpy as np

from simspec.engines.kit.worker import attempt

OPERATIONS = [{"op": name, "cpu_seconds": 5.0} for name in ("fine", "fine", "crash", "fine", "refuse", "fine")]


def begin():
    count = [0]

    def work(place):
        name = OPERATIONS[place]["op"]
        if name == "crash":
            os.kill(os.getpid(), signal.SIGKILL)
        if name == "refuse":
            raise ValueError("I do not like it")
        count[0] += 1
        values = np.array([place, count[0]], dtype=float)
        return {"op": name, "arrays": {"at": {"kind": "f8", "shape": [2], "stored": True}}}, [values]

    return work


def test_operations_share_a_process_until_an_operation_ends_it(tmp_path):
    (tmp_path / "attempt.5.json").write_text("of before")
    begun = time.perf_counter()
    entries = list(attempt(begin, OPERATIONS, tmp_path, 100))
    elapsed = time.perf_counter() - begun
    refusals = [entry for entry, _ in entries if "refused" in entry.get("result", {})]
    assert all(0.0 < entry["seconds"] <= elapsed for entry in refusals)
    assert [entry.get("result", {}).get("refused") for entry, _ in entries] == [
        *(None, None),
        "the engine's process was ended by signal 9 (SIGKILL)",
        None,
        "ValueError: I do not like it",
        None,
    ]
    assert [values[0].tolist() for _, values in entries if values] == [[0, 1], [1, 2], [3, 1], [5, 1]]
    assert [entry["op"] for entry, _ in entries] == [operation["op"] for operation in OPERATIONS]


def test_an_operation_that_ends_a_used_process_is_retried_in_a_new_process(tmp_path):
    """An earlier operation may have ended the process: the retry succeeds, and later operations share its process."""
    operations = [{"op": str(place), "artifacts": str(place)} for place in range(4)]

    def begin():
        count = [0]

        def work(place):
            count[0] += 1
            if place == 3 or (place == 1 and count[0] > 1):
                os.kill(os.getpid(), signal.SIGKILL)
            values = np.array([place, count[0]], dtype=float)
            return {"op": str(place), "arrays": {"at": {"kind": "f8", "shape": [2], "stored": True}}}, [values]

        return work

    entries = list(attempt(begin, operations, tmp_path, 100))
    assert [values[0].tolist() for _, values in entries if values] == [[0, 1], [1, 1], [2, 2]]
    assert [entry["op"] for entry, _ in entries] == ["0", "1", "2", "3"]
    assert "SIGKILL" in entries[3][0]["result"]["refused"]
