"""Campaigns of runs: in order, never repeated, resumable."""

import dataclasses
import itertools
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pytest

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.actuator.status import Backend, Status
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate import solutions as run_module
from bayesdeg.surrogate import workers
from bayesdeg.surrogate.campaign import complete, missing
from bayesdeg.surrogate.solutions import Kind, Run, SolutionStore
from tests.surrogate.small_runs import COARSEST, assert_same, made_up, runs

RUNS = runs(5)


def solution_of(run):
    """The last run balloons on its way."""
    if run.curve == RUNS[-1].curve:
        return made_up(run, status=Status.LIMIT_POINT, points=9)
    return made_up(run)


class Solver:
    """Stands in for the finite element model; counts, and raises at a given call."""

    def __init__(self, *, fails_at=None, before=lambda: None):
        self.calls, self.efforts = 0, []
        self.fails_at, self.before = fails_at, before

    def __call__(self, task, *, effort, held, origin=None, backend=Backend.KERNELS):
        assert not held
        assert origin is None
        self.before()
        self.calls += 1
        self.efforts.append(effort)
        if self.calls == self.fails_at:
            raise RuntimeError("out of luck")
        return solution_of(Run(*task))


@pytest.fixture
def solver(monkeypatch):
    solver = Solver()
    monkeypatch.setattr(workers, "solve_task", solver)
    return solver


@pytest.fixture
def store(tmp_path):
    return SolutionStore(tmp_path)


def names(store):
    return sorted(path.name for path in store.folder.glob("*.npz"))


def test_solutions_come_back_in_order_as_they_were_solved(solver, store):
    for fresh_or_stored in range(2):
        for run, solution in zip(RUNS, complete(RUNS, store), strict=True):
            assert_same(solution, solution_of(run))
        assert solver.calls == len(RUNS), fresh_or_stored
    assert solution_of(RUNS[-1]).status is Status.LIMIT_POINT


def test_a_second_call_solves_nothing_and_a_larger_one_only_what_is_new(solver, store):
    told = []
    assert missing(RUNS[:2], store) == RUNS[:2]
    complete(RUNS[:2], store, on_run=told.append)
    complete(RUNS[:2], store, on_run=told.append)
    assert solver.calls == len(told) == 2
    assert missing([*RUNS, *RUNS], store) == RUNS[2:]
    complete(RUNS, store, on_run=told.append)
    assert solver.calls == len(RUNS)
    assert [finished.run for finished in told] == RUNS
    assert all(finished.seconds >= 0.0 for finished in told)
    assert_same(told[3].solution, solution_of(RUNS[3]))


def test_a_run_that_is_wanted_twice_is_solved_once(solver, store):
    first, second, again = complete([RUNS[0], RUNS[1], RUNS[0]], store)
    assert solver.calls == 2
    assert_same(first, again)
    assert not np.array_equal(first.bend_angle, second.bend_angle)


def test_an_unexpected_exception_names_the_run_and_loses_no_other(monkeypatch, store):
    monkeypatch.setattr(workers, "solve_task", Solver(fails_at=3))
    with pytest.raises(RuntimeError, match="out of luck") as raised:
        complete(RUNS, store)
    material = RUNS[2].curve.material
    for words in (RUNS[2].key()[:12], f"c2_ratio={material.c2_ratio:g}", "length=14", "up=9"):
        assert words in str(raised.value)
    assert names(store) == sorted(f"{run.key()}.npz" for run in RUNS[:2])
    second = Solver()
    monkeypatch.setattr(workers, "solve_task", second)
    for run, solution in zip(RUNS, complete(RUNS, store), strict=True):
        assert_same(solution, solution_of(run))
    assert second.calls == len(RUNS) - 2


def test_runs_under_way_are_stored_though_one_raised(monkeypatch, store):
    monkeypatch.setattr(workers, "solve_task", Solver(fails_at=1))
    with ThreadPoolExecutor(1) as executor, pytest.raises(RuntimeError, match=RUNS[0].key()[:12]):
        complete(RUNS, store, executor=executor)
    assert names(store)
    assert f"{RUNS[0].key()}.npz" not in names(store)


def test_an_executor_gives_what_the_caller_alone_gives(solver, tmp_path):
    with ThreadPoolExecutor(2) as executor:
        together = complete(RUNS, SolutionStore(tmp_path / "a"), executor=executor)
    alone = complete(RUNS, SolutionStore(tmp_path / "b"))
    for left, right in zip(together, alone, strict=True):
        assert_same(left, right)


class Counting(ThreadPoolExecutor):
    """Notes how many runs it was given and has not handed back."""

    fatal = ()
    workers = 2

    def __init__(self):
        super().__init__(2)
        self.under_way, self.most = 0, 0

    def check(self):
        pass

    def submit(self, function, /, *args):
        self.under_way += 1
        self.most = max(self.most, self.under_way)
        return super().submit(function, *args)


def test_few_more_runs_are_submitted_than_there_are_workers(solver, store):
    wanted = runs(40, seed=8)
    executor = Counting()

    def landed(_):
        executor.under_way -= 1

    with executor:
        complete(wanted, store, executor=executor, on_run=landed)
    assert solver.calls == len(wanted)
    assert 2 <= executor.most <= 4


def test_what_another_campaign_solves_in_the_meantime_is_taken_over(monkeypatch, store):
    other, own = SolutionStore(store.folder), []
    monkeypatch.setattr(workers, "solve_task", Solver(before=lambda: other.put(RUNS[3], found)))
    found = solution_of(RUNS[3])
    solutions = complete(RUNS, store, on_run=own.append)
    assert {finished.run for finished in own} == set(RUNS)
    assert [f.seconds for f in own if f.run == RUNS[3]] == [0.0]
    assert workers.solve_task.calls == len(RUNS) - 1
    for run, solution in zip(RUNS, solutions, strict=True):
        assert_same(solution, solution_of(run))


def test_campaigns_in_step_part_and_share_the_work(monkeypatch, store):
    """The other always solves the first of the runs that are left, just while this one does."""
    wanted = runs(32, seed=8)
    other = SolutionStore(store.folder)

    def advance():
        for run in itertools.islice(missing(wanted, other), 1):
            other.put(run, solution_of(run))

    solver = Solver(before=advance)
    monkeypatch.setattr(workers, "solve_task", solver)
    complete(wanted, store)
    assert solver.calls <= len(wanted) // 2 + 4


def test_an_executor_that_cancels_is_named_and_not_taken_for_a_solution(solver, store):
    class Cancelling(ThreadPoolExecutor):
        def submit(self, function, /, *args):
            future = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with Cancelling(1) as executor, pytest.raises(BayesdegError, match="cancelled"):
        complete(RUNS, store, executor=executor)
    assert not names(store)


# ---- time


class TimedOut(Solver):
    """Needs a second for every curve."""

    def __call__(self, task, *, effort, held, origin=None, backend=Backend.KERNELS):
        solution = super().__call__(task, effort=effort, held=held)
        late = effort.seconds < 1.0
        return dataclasses.replace(solution, status=Status.TIMED_OUT) if late else solution


def test_a_run_that_times_out_is_recorded_and_tried_again_only_with_more_time(monkeypatch, store):
    solver = TimedOut()
    monkeypatch.setattr(workers, "solve_task", solver)
    run = RUNS[0]

    def status(timeout):
        (solution,) = complete([run], store, timeout=timeout)
        return solution.status, solver.calls

    assert status(0.5) == (Status.TIMED_OUT, 1)
    assert [(f.run, f.status) for f in store.failures()] == [(run, Status.TIMED_OUT)]
    assert status(0.5) == status(0.2) == (Status.TIMED_OUT, 1)
    assert status(0.6) == (Status.TIMED_OUT, 2)
    assert status(np.inf) == (Status.CONVERGED, 3)
    assert status(0.1) == status(np.inf) == (Status.CONVERGED, 3)
    assert store.failures() == []


def test_the_worker_is_told_the_time_and_none_by_default(solver, store):
    complete(RUNS[:1], store)
    complete(RUNS[1:2], store, timeout=7.5)
    assert [effort.seconds for effort in solver.efforts] == [np.inf, 7.5]


# ---- keys


SHAPE, CURVE = Dimensions(), RUNS[0].curve
BASE = dataclasses.replace(RUNS[0], geometry=Geometry(SHAPE))


def variants():
    for field in dataclasses.fields(Dimensions):
        value = getattr(SHAPE, field.name)
        changed = value - 1 if field.name == "chambers" else value * 1.01
        dimensions = dataclasses.replace(SHAPE, **{field.name: changed})
        yield field.name, dataclasses.replace(BASE, geometry=Geometry(dimensions))
    yield "walls", dataclasses.replace(BASE, geometry=Geometry(SHAPE, wall_factor=1.01))
    yield "kind", dataclasses.replace(BASE, kind=Kind.SAMPLES)
    for field in dataclasses.fields(Resolution):
        changed = dataclasses.replace(
            COARSEST, **{field.name: getattr(COARSEST, field.name) * 1.01 or 0.01}
        )
        yield field.name, dataclasses.replace(BASE, resolution=changed)
    curve = CURVE
    for field in dataclasses.fields(MaterialGroups):
        material = dataclasses.replace(
            curve.material,
            **{field.name: getattr(curve.material, field.name) * (1.0 + 1e-15) or 1e-15},
        )
        yield (
            field.name,
            dataclasses.replace(BASE, curve=dataclasses.replace(curve, material=material)),
        )
    for i in range(len(curve.loads)):
        loads = (*curve.loads[:i], np.nextafter(curve.loads[i], 9.0).item(), *curve.loads[i + 1 :])
        yield (
            f"load {i}",
            dataclasses.replace(BASE, curve=dataclasses.replace(curve, loads=loads)),
        )


def test_the_key_depends_on_every_input():
    keys = {name: run.key() for name, run in variants()}
    assert len({*keys.values(), BASE.key()}) == len(keys) + 1
    assert {"floor", "channel_roof", "up", "paper_group"} <= set(keys)


def test_the_key_depends_on_the_version_of_the_model(monkeypatch):
    before = RUNS[0].key()
    assert before == RUNS[0].key()
    monkeypatch.setattr(run_module, "MODEL_VERSION", "another")
    assert RUNS[0].key() != before


def test_equal_runs_have_the_same_key_however_their_numbers_are_written():
    whole = dataclasses.replace(SHAPE, length=50, floor=2)
    as_arrays = dataclasses.replace(CURVE, loads=tuple(np.array(CURVE.loads)))
    assert Run(Geometry(whole), COARSEST, as_arrays).key() == BASE.key()


def test_parameters_lead_back_to_the_run():
    for _, run in variants():
        assert run_module.run_of(run.parameters()) == run


def test_a_worker_with_another_version_of_the_model_refuses(monkeypatch, store):
    keys = {run: run.key() for run in RUNS}
    monkeypatch.setattr(run_module, "MODEL_VERSION", "another")
    with pytest.raises(BayesdegError, match="version"):
        workers.solve(RUNS[0], keys[RUNS[0]], np.inf)
