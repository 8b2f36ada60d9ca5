"""What a process of its own is told and answers, by its standard input and output: in bounded time and memory."""

from __future__ import annotations

import contextlib
import os
import selectors
import subprocess
import threading
import time
from typing import IO


def exchange(process: subprocess.Popen[bytes], told: bytes, seconds: float, most: int) -> tuple[bytes, str]:
    """What a process answers by its standard output to what it is told by its standard input, and why there is no more of it:
    "late" after ``seconds`` by the clock, "large" beyond ``most`` bytes; "" where it has ended. The process is killed then."""
    source, sink = process.stdout, process.stdin
    assert source is not None
    assert sink is not None
    writer = threading.Thread(target=_tell, args=(sink, told), daemon=True)
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


def _tell(sink: IO[bytes], told: bytes) -> None:
    with contextlib.suppress(BrokenPipeError), sink:  # who has ended hears no more: its answer says so
        sink.write(told)
