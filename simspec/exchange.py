"""A request to a child process by its standard input, and the answer by its standard output: in bounded time and memory."""

from __future__ import annotations

import contextlib
import os
import selectors
import subprocess
import threading
import time
from typing import IO


def exchange(process: subprocess.Popen[bytes], request: bytes, seconds: float, most: int) -> tuple[bytes, str]:
    """The answer of a process, and why it is cut off: "late" after ``seconds`` by the clock, "large" beyond ``most`` bytes; ""
    where the process has ended by itself. Otherwise it is killed."""
    source, sink = process.stdout, process.stdin
    assert source is not None
    assert sink is not None
    writer = threading.Thread(target=_send, args=(sink, request), daemon=True)
    writer.start()
    until, parts, size, why = time.monotonic() + seconds, [], 0, ""
    try:
        with selectors.DefaultSelector() as selector:
            selector.register(source, selectors.EVENT_READ)
            while not why:
                left = until - time.monotonic()
                if left <= 0.0 or not selector.select(left):
                    why = "late"
                    break
                part = os.read(source.fileno(), 2**20)
                if not part:
                    break
                size += len(part)
                parts.append(part)
                why = "large" if size > most else ""
        if not why:
            process.wait(max(0.0, until - time.monotonic()))
    except subprocess.TimeoutExpired:
        why = "late"
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        writer.join()
        source.close()
    return b"".join(parts), why


def _send(sink: IO[bytes], request: bytes) -> None:
    with contextlib.suppress(BrokenPipeError), sink:  # the process has ended; its answer shows it
        sink.write(request)
