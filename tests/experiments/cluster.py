"""A Dask scheduler and workers on this machine, for tests: each a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

START = 120.0
"""s that a process may take to be there."""


class Cluster:
    """A scheduler at ``address``, and the processes that were started with it."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack):
        self._folder, self._stack = folder, stack
        self._file = folder / "scheduler.json"
        words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(self._file)]
        self.scheduler = self._start("scheduler", *words)
        self.address = self._address()
        self.workers: list[subprocess.Popen[bytes]] = []

    def worker(self, resources: str) -> subprocess.Popen[bytes]:
        """Start a worker that does one run at a time."""
        words = ["--nthreads", "1", "--resources", resources, "--no-nanny", "--no-dashboard"]
        worker = self._start("worker", self.address, *words, "--local-directory", str(self._folder))
        self.workers.append(worker)
        return worker

    def wait(self, count: int) -> None:
        """Until so many workers are there."""
        from distributed import Client

        with Client(self.address, timeout=START, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=START)

    def _start(self, what: str, *words: str) -> subprocess.Popen[bytes]:
        with open(self._folder / f"{what}.log", "ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.dask_{what}", *words],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=self._folder,
                env=dict(os.environ),
            )
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process

    def _address(self) -> str:
        ends = time.monotonic() + START
        while time.monotonic() < ends:
            with contextlib.suppress(FileNotFoundError, ValueError):
                return json.loads(self._file.read_text())["address"]
            assert self.scheduler.poll() is None, (self._folder / "scheduler.log").read_text()
            time.sleep(0.05)
        raise AssertionError("no scheduler")


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """A scheduler without workers; all is ended with the block."""
    with contextlib.ExitStack() as stack:
        yield Cluster(folder, stack)
