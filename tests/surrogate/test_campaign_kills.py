"""Campaigns of real runs under attack: killed, shared, with dying workers; the bits stay."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path

import pytest

from bayesdeg.actuator.status import Status
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate import workers
from bayesdeg.surrogate.campaign import complete, missing
from bayesdeg.surrogate.solutions import Run, SolutionStore
from bayesdeg.surrogate.workers import pool
from tests.surrogate.real_campaign import COUNT
from tests.surrogate.small_runs import assert_all_same, contents, made_up, real_runs, runs

ROOT = Path(__file__).resolve().parents[2]
KILLS = 24


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Solutions and files of a serial campaign."""
    store = SolutionStore(tmp_path_factory.mktemp("serial"))
    solutions = complete(real_runs(COUNT), store)
    assert {solution.status for solution in solutions} <= {Status.CONVERGED, Status.LIMIT_POINT}
    return solutions, contents(store.folder)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_a_campaign_killed_at_random_moments_ends_with_the_same_bits(undisturbed, tmp_path):
    module = "tests.surrogate.real_campaign"
    command = [sys.executable, "-m", module, str(tmp_path / "store"), str(KILLS), "20"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["kills"] == KILLS >= 20
    assert told["exit"] == 0
    # the kills hit a campaign at work: what it had done grew between them, and was never lost
    assert told["progress"] == sorted(told["progress"])
    assert len(set(told["progress"])) >= KILLS // 3
    solutions, files = undisturbed
    assert contents(tmp_path / "store") == files
    store = SolutionStore(tmp_path / "store")
    assert missing(real_runs(COUNT), store) == []
    assert_all_same(complete(real_runs(COUNT), store), solutions)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_two_processes_give_the_bits_of_one_though_one_of_them_is_killed(undisturbed, tmp_path):
    runs, (solutions, files) = real_runs(COUNT), undisturbed
    store, finished = SolutionStore(tmp_path), []
    others = {child.pid for child in multiprocessing.active_children()}

    def kill_one(done):
        finished.append(done)
        if len(finished) == 10:
            workers = {child.pid for child in multiprocessing.active_children()} - others
            os.kill(min(workers), signal.SIGKILL)

    with pool(2) as executor:
        with pytest.warns(UserWarning, match="worker process died"):
            found = complete(runs, store, executor=executor, on_run=kill_one)
        assert multiprocessing.active_children()
    assert_all_same(found, solutions)
    assert contents(tmp_path) == files
    assert len(finished) == len(runs)
    seconds = store.seconds()
    assert {run.key() for run in runs} == set(seconds)
    assert all(0.0 < value < 60.0 for value in seconds.values())


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_two_campaigns_at_once_on_one_store_end_with_the_same_bits(undisturbed, tmp_path):
    module = "tests.surrogate.real_campaign"
    command = [sys.executable, "-m", module, str(tmp_path / "store"), "0", "1"]
    solutions, files = undisturbed
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as other:
        store = SolutionStore(tmp_path / "store")
        assert_all_same(complete(real_runs(COUNT), store), solutions)
        assert other.wait() == 0
    assert contents(tmp_path / "store") == files
    assert not list((tmp_path / "store").glob("*.part"))


@pytest.mark.fem
def test_a_real_run_times_out_from_its_start_and_is_recorded(tmp_path):
    store, run = SolutionStore(tmp_path), real_runs(1)[1]
    (late,) = complete([run], store, timeout=1e-6)
    assert late.status is Status.TIMED_OUT
    assert [(f.run, f.status) for f in store.failures()] == [(run, Status.TIMED_OUT)]
    (late,) = complete([run], store, timeout=1e-6)
    assert late.status is Status.TIMED_OUT
    (found,) = complete([run], store, timeout=600.0)
    assert found.status is Status.CONVERGED
    assert store.failures() == []


# ---- pools that break, without finite elements


class Fragile(Executor):
    """Breaks, with all that it was given, as soon as it works on one of the deadly runs."""

    fatal = ()
    workers = 2

    def __init__(self, deadly, *, opens_again=True, deaths=99):
        self.deadly, self.opens_again, self.deaths = deadly, opens_again, deaths
        self.given, self.broken, self.seen = [], False, 0

    def check(self):
        """Work: all that was given, once the campaign waits."""
        given, self.given = self.given, []
        if self.seen < self.deaths and any(run in self.deadly for _, run, _ in given):
            self.seen, self.broken = self.seen + 1, True
            for future, _, _ in given:
                future.set_exception(BrokenExecutor("killed"))
            return
        for future, run, arguments in given:
            future.set_result(workers.solve(run, *arguments))

    def submit(self, _, run, *arguments):
        if self.broken and not self.opens_again:
            raise BrokenExecutor("closed")
        self.broken = False
        future = Future()
        self.given.append((future, run, arguments))
        return future


@pytest.fixture
def wanted(monkeypatch):
    monkeypatch.setattr(workers, "solve_task", lambda task, **_: made_up(Run(*task)))
    monkeypatch.setattr("bayesdeg.surrogate.campaign._PATIENCE", 0.01)
    return runs(8)


def test_a_run_that_kills_its_workers_is_found_and_named(wanted, tmp_path):
    store = SolutionStore(tmp_path)
    executor = Fragile({wanted[2]})
    with (
        pytest.warns(UserWarning, match="retried"),
        pytest.raises(BayesdegError, match=f"run {wanted[2].key()[:12]}"),
    ):
        complete(wanted, store, executor=executor)
    assert executor.seen == 4  # in company, then thrice alone
    assert set(missing(wanted, store)) >= {wanted[2]}
    assert set(missing(wanted, store)).isdisjoint(wanted[:2])


def test_a_death_by_chance_costs_nothing(wanted, tmp_path):
    store = SolutionStore(tmp_path)
    with pytest.warns(UserWarning, match="died"):
        found = complete(wanted, store, executor=Fragile({wanted[2], wanted[7]}, deaths=2))
    assert_all_same(found, [made_up(run) for run in wanted])
    assert missing(wanted, store) == []


def test_a_pool_that_stays_broken_is_a_clear_error(wanted, tmp_path):
    store = SolutionStore(tmp_path)
    with pytest.warns(UserWarning, match="died"), pytest.raises(BayesdegError, match="resume"):
        complete(wanted, store, executor=Fragile({wanted[5]}, opens_again=False))
    assert set(missing(wanted, store)) == set(wanted[4:])
