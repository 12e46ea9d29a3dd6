"""Dask: scheduler and workers as processes of their own, some of which are killed."""

import json
import os
import signal
import subprocess
import sys
import sysconfig
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate import workers
from bayesdeg.surrogate.campaign import complete, missing
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.workers import cluster_executor, pool
from tests.surrogate.small_runs import assert_all_same, contents, real_runs

ROOT = Path(__file__).resolve().parents[2]
DASK = Path(sysconfig.get_path("scripts")) / "dask"
RUNS = real_runs(12)


class Processes:
    """A scheduler and its workers."""

    def __init__(self, folder):
        self.folder, self.workers = folder, []
        self.file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0")
        deadline = time.monotonic() + 60.0
        while not self.file.exists() or not self.file.read_text():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]

    def add_worker(self, threads=1):
        options = ("--nthreads", str(threads), "--no-nanny", "--local-directory", self.folder)
        self.workers.append(self._start("worker", *options))

    def _start(self, role, *options):
        log = (self.folder / f"{role}{len(self.workers)}.log").open("wb")
        with log:
            command = [DASK, role, "--scheduler-file", self.file, "--no-dashboard", *options]
            paths = os.environ | {"PYTHONPATH": str(ROOT)}
            return subprocess.Popen(command, cwd=ROOT, env=paths, stdout=log, stderr=log)

    def stop(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextmanager
def dask_processes(folder, workers):
    started = Processes(folder)
    try:
        for _ in range(workers):
            started.add_worker()
        yield started
    finally:
        started.stop()


def kill(process):
    os.kill(process.pid, signal.SIGKILL)
    process.wait()


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    store = SolutionStore(tmp_path_factory.mktemp("serial"))
    return complete(RUNS, store), contents(store.folder)


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    monkeypatch.setattr(workers, "CONNECTING", 60.0)
    monkeypatch.setattr(workers, "JOINING", 60.0)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_dask_gives_the_bits_of_one_process_though_a_worker_is_killed(serial, tmp_path):
    solutions, files = serial
    finished = []
    with dask_processes(tmp_path, workers=2) as dask:

        def kill_one(done):
            finished.append(done.run)
            if len(finished) == 8:
                kill(dask.workers[0])

        store = SolutionStore(tmp_path / "store")
        with pool(1, dask.address) as executor:
            executor._client.wait_for_workers(2, timeout=60)
            found = complete(RUNS, store, executor=executor, on_run=kill_one)
            assert len(executor._client.nthreads()) == 1
        assert dask.scheduler.poll() is None
    assert_all_same(found, solutions)
    assert contents(store.folder) == files
    assert set(finished) == set(RUNS)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_a_scheduler_that_vanishes_is_a_clear_error_and_nothing_is_lost(serial, tmp_path):
    solutions, files = serial
    store, kept = SolutionStore(tmp_path / "store"), []
    with dask_processes(tmp_path, workers=1) as dask:

        def kill_scheduler(done):
            kept.append(done.run)
            if len(kept) == 5:
                kill(dask.scheduler)

        start = time.monotonic()
        with cluster_executor(dask.address) as executor:
            with pytest.raises(BayesdegError, match="was lost") as raised:
                complete(RUNS, store, executor=executor, on_run=kill_scheduler)
            executor.shutdown(wait=False, cancel_futures=True)
        assert time.monotonic() - start < 90.0
    assert dask.address in str(raised.value)
    assert len(kept) >= 5
    assert set(missing(RUNS, store)) == set(RUNS) - set(kept)
    assert_all_same(complete(RUNS, store), solutions)
    assert contents(store.folder) == files


@pytest.mark.slow
def test_workers_that_lack_or_differ_are_clear_errors(monkeypatch, tmp_path):
    store = SolutionStore(tmp_path / "store")
    with dask_processes(tmp_path, workers=0) as dask, ExitStack() as stack:
        with monkeypatch.context() as hasty:
            hasty.setattr(workers, "JOINING", 0.5)
            with (
                pytest.raises(BayesdegError, match=r"joined.*dask worker"),
                cluster_executor(dask.address),
            ):
                pass
        dask.add_worker(threads=2)
        with monkeypatch.context() as newer:
            newer.setattr(workers, "MODEL_VERSION", "of tomorrow")
            with (
                pytest.raises(BayesdegError, match=r"of tomorrow.*tcp://"),
                cluster_executor(dask.address),
            ):
                pass
        monkeypatch.setattr(workers, "DESERTED", 1.0)
        monkeypatch.setattr(workers, "_COUNTING", 0.2)
        with pytest.warns(UserWarning, match="have several threads"):
            opened = stack.enter_context(cluster_executor(dask.address))
        kill(dask.workers[0])
        with pytest.raises(BayesdegError, match="no worker"):
            complete(RUNS, store, executor=opened)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "127.0.0.1:9", "nonsense://x", "::", ""])
def test_a_scheduler_that_cannot_be_reached_is_a_clear_error(monkeypatch, address):
    monkeypatch.setattr(workers, "CONNECTING", 0.5)
    with pytest.raises(BayesdegError, match="dask scheduler"), cluster_executor(address):
        pass


def test_without_the_package_the_way_to_install_it_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(BayesdegError, match=r"pip install 'bayesdeg\[cluster\]'"),
        pool(2, "tcp://127.0.0.1:9"),
    ):
        pass
