"""Runs on a Dask cluster that is there already: batches of tasks to its workers, results back to this process, which stores
them.

A worker says which engines it has by its resources: ``ENGINE=1``, or ``ENGINE@VERSION=1``, in the number of runs that it does
at a time. simspec sends bytes for one function of this module; distributed itself sends further messages. A cluster executes
any request of any client that reaches its scheduler: this is a property of Dask, and nothing here makes it safer.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import queue
import re
import secrets
import time
from collections.abc import Collection, Iterable, Mapping
from concurrent.futures import Future as Publishing
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simspec.errors import Problem, SpecError, clipped
from simspec.experiments.executors import ExecutorError, Publish, Supplies, Task
from simspec.experiments.remote import EndedError, RefusedTaskError, batch_parcel, do_batch, results_of, wanted_versions

if TYPE_CHECKING:
    from distributed import Client, Future


ADDRESS = re.compile(r"(tcp|tls)://[^\s/@]+:[0-9]{1,5}")
PATIENCE = 10.0
"""s in which a scheduler answers the first time. On a local network it takes milliseconds."""
SILENCE = 60.0
"""s after which a scheduler that answers nothing is given up: one that is busy with many tasks takes seconds."""
ABSENCE = 60.0
"""s without a worker for an engine that has had some, after which its tasks are given up: a nanny starts a worker again in
about 5."""
LOOK_EVERY = 5.0
"""s between two looks at the scheduler and its workers."""
WINDOW = 3
"""Batches that are sent for each run that the workers do at a time: one at work, the others there when it is done."""
BATCH_SECONDS = 4.0
"""s that a batch should take: with 1000 workers, 250 batches end in a second."""
BATCH_BYTES = 16_000_000
"""Bytes that the results of a batch should have."""
LARGEST_BATCH = 64
MOST_LOSSES = 5
"""How often a run is sent anew after Dask gave it up since its workers died. Each time is several workers (distributed's
``allowed-failures``), which may have died of another run that they had."""
PUBLISHERS = 4
"""Threads that store results: they wait for the disk most of the time."""
GATHER = 300.0
"""s in which the results of a batch come here."""
ENDING = 0.5
"""s in which a worker that is being ended notices it; its engines may notice before."""


def demand_address(address: str) -> None:
    """Raise SpecError where that is no address of a scheduler."""
    if ADDRESS.fullmatch(address) is None or int(address.rpartition(":")[2]) > 65535:
        message = "is not an address of a Dask scheduler"
        raise SpecError(
            [Problem(message, "--scheduler", None, address, "tcp://HOST:PORT or tls://HOST:PORT", code="C103")]
        )


def do_on_worker(request: bytes) -> bytes:
    """The function that workers call: see :func:`simspec.experiments.remote.do_batch`."""
    from distributed import get_worker

    worker = get_worker()

    def demand_alive() -> None:
        time.sleep(ENDING)
        if worker.status.name not in ("running", "paused"):
            raise EndedError

    return do_batch(request, demand_alive)


@dataclass
class _Batch:
    """Tasks of one engine that were sent together; ``future``: where their results will be."""

    engine: str
    tasks: list[Task]
    future: Future


@dataclass
class _Usual:
    """Costs of a run in the latest batches of an engine: s, and bytes of results."""

    seconds: float = BATCH_SECONDS
    size: float = float(BATCH_BYTES)

    def learn(self, seconds: float, size: float) -> None:
        """Take notice of one more batch."""
        self.seconds += 0.3 * (seconds - self.seconds)
        self.size += 0.3 * (size - self.size)

    @property
    def batch(self) -> int:
        """Runs that make a batch."""
        most = min(BATCH_SECONDS / max(self.seconds, 1e-6), BATCH_BYTES / max(self.size, 1.0))
        return min(max(int(most), 1), LARGEST_BATCH)


class DaskExecutor:
    """A cluster's workers. ``versions``: by label, what must be at work there, as it is here. Raises ExecutorError where no
    scheduler answers at ``address``."""

    def __init__(self, supplies: Supplies, address: str, versions: Mapping[str, Mapping[str, str]]):
        demand_address(address)
        self._supplies, self._address = supplies, address
        self._wanted = wanted_versions(versions)
        self._client = _connected(address)
        self._slots: dict[str, int] = {}
        self._window = 0
        self._looked = 0.0
        self._absent: dict[str, float] = {}
        self._usual: dict[str, _Usual] = {}
        self._waiting: dict[str, list[Task]] = {}
        self._sent: dict[str, _Batch] = {}
        self._losses: dict[str, int] = {}
        self._given_up: list[str] = []
        self._storing: set[Publishing[list[Task]]] = set()
        self._came: queue.SimpleQueue[str | Publishing[list[Task]]] = queue.SimpleQueue()
        self._names = (f"simspec-{secrets.token_hex(8)}-{number}" for number in itertools.count())

    # --- the contract ---------------------------------------------------------------------------------------------------

    def demand(self, engines: Collection[str]) -> None:
        """As of :class:`simspec.experiments.executors.Executor`: a task that no worker has the resource for would
        wait for ever."""
        self._look()
        missing = [name for name in engines if not self._slots.get(name)]
        if missing:
            offered = ", ".join(sorted(self._slots)) or "none"
            raise ExecutorError(
                f"no worker of {self._address} runs {', '.join(missing)}; resources of its workers: {offered}; "
                f'start workers with: dask worker {self._address} --resources "{missing[0]}=1"'
            )

    def run(self, tasks: Iterable[Task], publish: Publish) -> None:
        """As of :class:`simspec.experiments.executors.Executor`."""
        with ThreadPoolExecutor(PUBLISHERS) as pool:
            try:
                for task in tasks:
                    self._take(task)
                    self._collect(pool, publish, wait=False)
                    while self._at_work >= self._window:
                        self._collect(pool, publish)
                for engine in list(self._waiting):
                    self._send(engine, self._waiting.pop(engine))
                while self._at_work:
                    self._collect(pool, publish)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                self.close()  # ends the waiting of its threads, too
                raise
        if self._given_up:
            raise ExecutorError(
                f"{len(self._given_up)} runs were given up, since workers died of each of them again and again; the first: "
                f"{self._given_up[0]}; the others are stored"
            )

    def close(self) -> None:
        """Leave the cluster. Unfinished batches of its workers are dropped."""
        batches = list(self._sent.values())
        self._sent.clear()
        with _quiet():
            if batches and self._client.status == "running":
                self._client.cancel([batch.future for batch in batches], force=True)
            self._client.close(timeout=PATIENCE)

    # --- batches --------------------------------------------------------------------------------------------------------

    @property
    def _at_work(self) -> int:
        return len(self._sent) + len(self._storing)

    def _take(self, task: Task) -> None:
        """Send a task, or put it to others that are sent when they make a batch, or when workers would have nothing to do."""
        engine = task.engine
        if engine not in self._usual:
            self.demand([engine])
            self._usual[engine] = _Usual()
        waiting = self._waiting.setdefault(engine, [])
        waiting.append(task)
        at_work = sum(batch.engine == engine for batch in self._sent.values())
        if len(waiting) >= self._usual[engine].batch or at_work < self._slots.get(engine, 0):
            self._send(engine, self._waiting.pop(engine))

    def _send(self, engine: str, tasks: list[Task]) -> None:
        parcel = batch_parcel(tasks, self._supplies, self._wanted[engine])
        name = next(self._names)
        future = self._client.submit(do_on_worker, parcel, key=name, resources={engine: 1}, pure=False, retries=0)
        self._sent[name] = _Batch(engine, tasks, future)
        future.add_done_callback(lambda done: self._came.put(done.key))

    def _collect(self, pool: ThreadPoolExecutor, publish: Publish, wait: bool = True) -> None:
        """Take what came: all of it, and with ``wait`` at least one, or a look at the cluster."""
        while True:
            if time.monotonic() - self._looked > LOOK_EVERY:
                self._look()
            try:
                came = self._came.get(timeout=LOOK_EVERY if wait else 0.0)
            except queue.Empty:
                return
            wait = False
            if isinstance(came, str):
                batch = self._sent.pop(came, None)
                if batch is not None:  # a result that was lost and made again comes twice
                    storing = pool.submit(self._receive, batch, publish)
                    self._storing.add(storing)
                    storing.add_done_callback(self._came.put)
            else:
                self._storing.discard(came)
                self._again(came.result())

    def _again(self, lost: list[Task]) -> None:
        """Send tasks anew whose workers died, each alone: only one that kills its worker does so again."""
        for task in lost:
            self._losses[task.key] = self._losses.get(task.key, 0) + 1
            if self._losses[task.key] > MOST_LOSSES:
                self._given_up.append(f"{task.engine}, {clipped(str(task.cell.get('overrides')))}")
            else:
                self._send(task.engine, [task])

    def _receive(self, batch: _Batch, publish: Publish) -> list[Task]:
        """Store the results of a batch; its tasks where its workers died."""
        from distributed import KilledWorker

        future = batch.future
        if future.status == "cancelled":
            raise self._gone("the connection was lost")
        try:
            reply = future.result(timeout=GATHER)
        except KilledWorker:
            return batch.tasks
        except (
            Exception
        ) as error:  # any error of the function, of distributed or of the connection: none of them is a result
            if self._client.status != "running" or future.status == "cancelled":
                raise self._gone("the connection was lost") from error
            text = clipped(f"{type(error).__name__}: {error}")
            raise ExecutorError(f"{batch.engine}: a worker of {self._address} failed: {text}") from error
        try:
            results, seconds = results_of(reply, batch.tasks, self._supplies)
        except EndedError:
            return batch.tasks
        except RefusedTaskError as error:
            raise ExecutorError(f"a worker of {self._address} failed: {error}") from None
        for task, result in zip(batch.tasks, results, strict=True):
            publish(task, result)
        self._usual[batch.engine].learn(seconds / len(results), len(reply) / len(results))
        future.release()
        return []

    # --- the cluster ----------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """See which workers there are. Raises ExecutorError where the scheduler is gone, or silent, or where no worker
        has had an engine for too long."""
        if self._client.status != "running":
            raise self._gone("the connection was lost")
        try:
            identity: Any = self._client.sync(self._client.scheduler.identity, n_workers=-1, callback_timeout=SILENCE)
        except (OSError, TimeoutError) as error:
            raise self._gone(str(error) or f"no answer within {SILENCE:g} s") from error
        self._looked = time.monotonic()
        self._slots, self._window = {}, 1
        for worker in identity["workers"].values():
            local = {name: min(int(count), worker["nthreads"]) for name, count in worker["resources"].items()}
            for name, count in local.items():
                self._slots[name] = self._slots.get(name, 0) + count
            self._window += WINDOW * min(worker["nthreads"], sum(local.get(name, 0) for name in self._wanted))
        for engine in self._usual:
            if self._slots.get(engine):
                self._absent.pop(engine, None)
            elif self._looked - self._absent.setdefault(engine, self._looked) > ABSENCE:
                raise ExecutorError(
                    f"no worker of {self._address} has run {engine} for {ABSENCE:g} s; received results are stored"
                )

    def _gone(self, why: str) -> ExecutorError:
        return ExecutorError(
            f"the scheduler {self._address} does not answer any more: {clipped(why)}; received results are stored, "
            "and the same command does the rest"
        )


def _connected(address: str) -> Client:
    """A client of the scheduler at an address. Raises ExecutorError."""
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        if error.name not in ("distributed", "dask"):
            raise
        raise ExecutorError("Dask is not installed: pip install 'simspec-physics[cluster]'") from None
    with _quiet():
        try:
            # queried before there is a client, which waits for ever where another program listens
            identity = asyncio.run(asyncio.wait_for(_identity(address), PATIENCE))
            if identity.get("type") == "Scheduler":
                return Client(address, timeout=PATIENCE, set_as_default=False, name="simspec")
        except TimeoutError:
            raise ExecutorError(f"no Dask scheduler answers at {address} within {PATIENCE:g} s") from None
        except Exception as error:  # any answer of another program
            text = clipped(f"{type(error).__name__}: {error}")
            raise ExecutorError(f"no Dask scheduler answers at {address}: {text}") from error
    raise ExecutorError(f"{address} is no Dask scheduler but a {clipped(str(identity.get('type')))}")


async def _identity(address: str) -> Mapping[str, Any]:
    from distributed import rpc
    from distributed.security import Security

    arguments = Security().get_connection_args("client")
    async with rpc(address, connection_args=arguments) as remote:
        identity = await remote.identity()
    return identity if isinstance(identity, Mapping) else {}


class _quiet:
    """While the block lasts, distributed does not say on standard error what is an error of ours anyway."""

    def __enter__(self) -> None:
        self._logger = logging.getLogger("distributed")
        self._before = self._logger.level
        self._logger.setLevel(logging.CRITICAL + 1)

    def __exit__(self, *_: object) -> None:
        self._logger.setLevel(self._before)
