"""A Dask cluster gives the results of this machine, to the bit; a lost worker costs its runs only; errors are reported."""

from __future__ import annotations

import signal
import socket
import threading

import pytest

from simspec.errors import SpecError
from simspec.experiments import dask as module
from simspec.experiments.dask import MOST_LOSSES, DaskExecutor
from simspec.experiments.executors import ExecutorError, LocalExecutor, Task
from simspec.experiments.plan import plan_sweep
from simspec.experiments.remote import do_batch
from simspec.experiments.store import Store
from simspec.experiments.sweep import sweep
from simspec.experiments.timing import versions_of
from simspec.language.load import Spec
from tests.experiments.cluster import cluster

distributed = pytest.importorskip("distributed", reason="comes with the extra test")

ENGINE, OTHER = "mujoco", "pybullet"


MANY = {"perturb": {"amount": 1e-9, "seeds": 5}}
"""Words of a sweep: 12 runs for each engine, 2 without them."""


def plan_of(engines=(ENGINE,), **words):
    return plan_sweep(
        Spec.from_data(
            {
                "simspec": 1,
                "name": "fall",
                "physics": {"timestep": "1 ms", "duration": "0.1 s"},
                "bodies": {"ball": {"mass": 1, "inertia": {"principal": [0.01, 0.01, 0.01]}}},
                "record": {"every": "10 ms"},
                "sweep": {"over": {"bodies.ball.mass": [1, 2]}, **words},
            }
        ),
        engines=engines,
        versions=versions_of(engines, {}),
    )


def do(folder, plan, start):
    store = Store.open(folder, create=True)
    return sweep(plan, store, start, verify=False, deadline=100.0), results(store)


def keys(store):
    return list(Store.keys(store))


def results(store):
    """The hash of what a repetition gives to the bit, by run."""
    return {key: store.check(key).result_sha256 for key in keys(store)}


def on(address, plan, publishing=lambda: None):
    """Starts an executor that reports when it publishes."""

    class Telling(DaskExecutor):
        def run(self, tasks, publish):
            def given(task, result):
                publish(task, result)
                publishing()

            super().run(tasks, given)

    return lambda supplies: Telling(supplies, address, plan.versions)


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_costs_its_runs_only_and_the_bits_are_those_of_this_machine(tmp_path):
    plan = plan_of(**MANY)
    with cluster(tmp_path) as dask:
        first, _ = dask.worker(f"{ENGINE}=1"), dask.worker(f"{ENGINE}=1 other=1")
        dask.wait(2)
        outcome, made = do(tmp_path / "far", plan, on(dask.address, plan, first.kill))
        assert first.wait() == -signal.SIGKILL
        assert (outcome.ran, outcome.done) == (12, 0)
        again, same = do(tmp_path / "far", plan, on(dask.address, plan))
        assert (again.ran, again.done, same) == (0, 12, made)
    _, here = do(tmp_path / "near", plan, lambda supplies: LocalExecutor(supplies, 2))
    assert made == here
    store = Store.open(tmp_path / "far")
    assert all(store.facts(key).result.failed is None for key in keys(store))
    assert all(store.load(key).arrays["pose"].shape == (11, 1, 7) for key in keys(store))


@pytest.mark.slow
def test_an_engine_without_a_worker_and_a_lost_scheduler_are_errors(tmp_path):
    both = plan_of((ENGINE, OTHER))
    with cluster(tmp_path) as dask:
        worker = dask.worker(f"{ENGINE}=1 RARE@1.2=3")
        dask.wait(1)
        with pytest.raises(ExecutorError, match=f"no worker of {dask.address} runs {OTHER};.*RARE@1.2, {ENGINE}"):
            do(tmp_path / "store", both, on(dask.address, both))
        assert results(Store.open(tmp_path / "store")) == {}
        with pytest.raises(ExecutorError, match="no Dask scheduler but a Worker"):
            DaskExecutor(None, address_of(worker, dask), {})
        plan = plan_of(**MANY)
        with pytest.raises(ExecutorError, match=f"the scheduler {dask.address} does not answer any more"):
            do(tmp_path / "store", plan, on(dask.address, plan, dask.scheduler.kill))
    stored = results(Store.open(tmp_path / "store"))
    assert stored
    outcome, made = do(tmp_path / "store", plan, lambda supplies: LocalExecutor(supplies, 2))
    assert (outcome.done, outcome.ran) == (len(stored), 12 - len(stored))
    assert stored.items() <= made.items()


def address_of(worker, dask):
    from distributed import Client

    with Client(dask.address, set_as_default=False) as client:
        return next(iter(client.scheduler_info()["workers"]))


# --- what no cluster is needed for --------------------------------------------------------------------------------------


@pytest.mark.parametrize("answer", [None, b"\xff" * 4096, b"\0" * 4096, b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_another_server_at_the_address_is_an_error_in_bounded_time(monkeypatch, answer):
    monkeypatch.setattr(module, "PATIENCE", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            while answer is not None:
                try:
                    server.accept()[0].sendall(answer)
                except OSError:
                    return

        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(ExecutorError, match=f"no Dask scheduler answers at {address}") as raised:
            DaskExecutor(None, address, {})
        server.shutdown(socket.SHUT_RDWR)
    assert raised.value.exit_code == 3


@pytest.mark.parametrize(
    "address", ["", "host", "host:8786", "http://host:1", "inproc://x", "tcp://h:99999", "tcp://a@b:1"]
)
def test_a_wrong_address_is_refused(address):
    with pytest.raises(SpecError, match="is not an address of a Dask scheduler"):
        DaskExecutor(None, address, {})


class Scheduler:
    """In place of a client: does what it is given at once, but for what ``fail`` raises. ``sizes``: tasks of each batch."""

    def __init__(self, fail=lambda tasks: None, workers=1):
        self.status, self.scheduler, self.fail, self.sizes = "running", self, fail, []
        self.workers = {number: {"nthreads": 1, "resources": {ENGINE: 1.0}} for number in range(workers)}

    def identity(self, n_workers):
        return {"workers": self.workers}

    def sync(self, function, callback_timeout, **words):
        return function(**words)

    def submit(self, function, parcel, key, resources, **words):
        assert (function, resources) == (module.do_on_worker, {ENGINE: 1})
        return Done(self, parcel, key)

    def cancel(self, futures, force):
        pass

    def close(self, timeout):
        self.status = "closed"


class Done:
    status = "finished"

    def __init__(self, scheduler, parcel, key):
        self.scheduler, self.parcel, self.key = scheduler, parcel, key

    def add_done_callback(self, tell):
        tell(self)

    def result(self, timeout):
        tasks = tasks_of(self.parcel)
        self.scheduler.sizes.append(len(tasks))
        self.scheduler.fail(tasks)
        return do_batch(self.parcel)

    def release(self):
        pass


def tasks_of(parcel) -> list[Task]:
    from simspec.experiments.remote import Parcel, task_from

    return [task_from(data) for data in Parcel.unpack(parcel).facts["tasks"]]


def on_scheduler(monkeypatch, scheduler, folder, plan=None):
    monkeypatch.setattr(module, "_connected", lambda address: scheduler)
    plan = plan or plan_of()
    return do(folder, plan, lambda supplies: DaskExecutor(supplies, "tcp://host:1", plan.versions))


def test_lost_tasks_are_sent_again_and_named_after_all_other_runs_are_stored(monkeypatch, tmp_path):
    died = []

    def fail(tasks):
        if any(task.cell["overrides"] == [["bodies.ball.mass", 2]] for task in tasks):
            died.append(tasks)
            raise distributed.KilledWorker("x", None, 3)

    with pytest.raises(ExecutorError, match=r"1 runs were given up.*bodies\.ball\.mass', 2"):
        on_scheduler(monkeypatch, Scheduler(fail), tmp_path / "store")
    assert len(died) == MOST_LOSSES + 1
    assert len(results(Store.open(tmp_path / "store"))) == 1
    survived = []

    def once(tasks):
        survived.append(tasks)
        if len(survived) == 1:
            raise distributed.KilledWorker("x", None, 3)

    outcome, _ = on_scheduler(monkeypatch, Scheduler(once), tmp_path / "store")
    assert (outcome.ran, outcome.done) == (1, 1)


def test_short_runs_go_in_batches_when_workers_have_enough_to_do(monkeypatch, tmp_path):
    scheduler = Scheduler()
    monkeypatch.setattr(module._Usual, "batch", 4)
    monkeypatch.setattr(Done, "add_done_callback", lambda self, tell: threading.Timer(0.2, tell, [self]).start())
    outcome, made = on_scheduler(monkeypatch, scheduler, tmp_path / "store", plan_of(**MANY))
    assert (outcome.ran, len(made)) == (12, 12)
    assert sum(scheduler.sizes) == 12
    assert max(scheduler.sizes) == 4


def test_an_error_on_a_worker_ends_the_sweep_and_is_not_stored(monkeypatch, tmp_path):
    def full(tasks):
        raise OSError(28, "No space left on device")

    with pytest.raises(ExecutorError, match=r"a worker of tcp://host:1 failed: OSError.*No space left"):
        on_scheduler(monkeypatch, Scheduler(full), tmp_path / "store")
    monkeypatch.setattr("simspec.experiments.remote._versions_here", lambda label: {"simspec": "0.0"})
    with pytest.raises(ExecutorError, match=r"mujoco: simspec is 0\.0 here, and .* where the sweep was started"):
        on_scheduler(monkeypatch, Scheduler(), tmp_path / "store")
    assert results(Store.open(tmp_path / "store")) == {}


def test_workers_that_stay_away_are_waited_for_in_bounded_time(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "ABSENCE", 0.2)
    monkeypatch.setattr(module, "LOOK_EVERY", 0.05)
    scheduler = Scheduler()

    def leave(self, tell):
        scheduler.workers = {}

    monkeypatch.setattr(Done, "add_done_callback", leave)
    with pytest.raises(ExecutorError, match=r"no worker of tcp://host:1 has run mujoco for 0\.2 s"):
        on_scheduler(monkeypatch, scheduler, tmp_path / "store")


def test_engines_of_a_worker_that_is_being_ended_are_no_result(monkeypatch, tmp_path):
    from simspec.errors import EngineError
    from simspec.experiments import remote

    class Ending:
        status = type("Status", (), {"name": "closing"})

    def killed(*arguments, **words):
        raise EngineError(ENGINE, "was ended by signal 15 (SIGTERM)")

    monkeypatch.setattr(remote, "run_case", killed)
    monkeypatch.setattr(module, "ENDING", 0.0)
    monkeypatch.setattr(distributed, "get_worker", Ending)
    monkeypatch.setattr(Done, "result", lambda self, timeout: module.do_on_worker(self.parcel))
    with pytest.raises(ExecutorError, match="2 runs were given up"):
        on_scheduler(monkeypatch, Scheduler(), tmp_path / "store")
    assert results(Store.open(tmp_path / "store")) == {}
    Ending.status.name = "running"
    outcome, made = on_scheduler(monkeypatch, Scheduler(), tmp_path / "store")
    assert len(made) == 2
    assert {row.failed for _, row in outcome.rows()} == {"was ended by signal 15 (SIGTERM)"}
