"""The store of finite element runs: resumable, atomic, keyed by content."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import Material
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.actuator.status import Status
from bayesdeg.emulator import campaign
from bayesdeg.emulator.campaign import Run, complete, read_solution, space_filling
from bayesdeg.emulator.scaling import TrainingBox
from bayesdeg.measure.settings import Dimensions
from tests.emulator.closed_form import solve

GEOMETRY = Geometry(Dimensions())
RESOLUTION = Resolution(along=2.5, across=2.5, up=2.1)
# the last of them balloons before its largest load
CURVES = [*space_filling(TrainingBox(), 4, seed=3), Curve((0.2, 0.9), Material(-0.025, 6e-4, 90.0))]
RUNS = [Run(GEOMETRY, RESOLUTION, curve) for curve in CURVES]


class Solver:
    """Stands in for the finite element model; counts, and raises at a given call."""

    def __init__(self, *, fails_at=None):
        self.calls, self.fails_at = 0, fails_at

    def __call__(self, task):
        self.calls += 1
        if self.calls == self.fails_at:
            raise RuntimeError("killed")
        return solve(task[2])


@pytest.fixture
def solver(monkeypatch):
    solver = Solver()
    monkeypatch.setattr(campaign, "solve_task", solver)
    return solver


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def assert_same(left, right):
    for field in dataclasses.fields(left):
        np.testing.assert_array_equal(getattr(left, field.name), getattr(right, field.name))
        assert type(getattr(left, field.name)) is type(getattr(right, field.name))


def test_solutions_come_back_in_order_as_they_were_solved(solver, tmp_path):
    for fresh_or_stored in range(2):
        for run, solution in zip(RUNS, complete(RUNS, tmp_path / "store"), strict=True):
            assert_same(solution, solve(run.curve))
        assert solver.calls == len(RUNS), fresh_or_stored
    assert solve(CURVES[-1]).status is Status.LIMIT_POINT


def test_a_second_call_solves_nothing_and_a_larger_one_only_what_is_new(solver, tmp_path):
    ticks = []
    complete(RUNS[:2], tmp_path, on_run=lambda: ticks.append(1))
    complete(RUNS[:2], tmp_path, on_run=lambda: ticks.append(1))
    assert solver.calls == len(ticks) == 2
    complete(RUNS, tmp_path, on_run=lambda: ticks.append(1))
    assert solver.calls == len(ticks) == len(RUNS)


def test_a_run_that_is_wanted_twice_is_solved_once(solver, tmp_path):
    first, second, again = complete([RUNS[0], RUNS[1], RUNS[0]], tmp_path)
    assert solver.calls == 2
    assert_same(first, again)
    assert not np.array_equal(first.bend_angle, second.bend_angle)


def test_a_campaign_that_was_killed_goes_on_where_it_stopped(monkeypatch, tmp_path):
    monkeypatch.setattr(campaign, "solve_task", Solver(fails_at=3))
    with pytest.raises(RuntimeError, match="killed"):
        complete(RUNS, tmp_path)
    assert names(tmp_path) == sorted(f"{run.key()}.npz" for run in RUNS[:2])
    second = Solver()
    monkeypatch.setattr(campaign, "solve_task", second)
    for run, solution in zip(RUNS, complete(RUNS, tmp_path), strict=True):
        assert_same(solution, solve(run.curve))
    assert second.calls == len(RUNS) - 2


def test_a_worker_that_dies_loses_only_its_own_run(monkeypatch, tmp_path):
    monkeypatch.setattr(campaign, "solve_task", Solver(fails_at=3))
    with ThreadPoolExecutor(1) as executor, pytest.raises(RuntimeError, match="killed"):
        complete(RUNS, tmp_path, executor=executor)
    for run in RUNS[:2]:
        assert_same(read_solution(tmp_path / f"{run.key()}.npz"), solve(run.curve))
    assert len(names(tmp_path)) == 2


def test_a_write_that_is_cut_short_leaves_nothing_behind(solver, monkeypatch, tmp_path):
    def broken(file, **arrays):
        file.write(b"PK half a file")
        raise OSError("no space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(campaign.np, "savez", broken)
        with pytest.raises(OSError, match="no space"):
            complete(RUNS[:1], tmp_path)
    assert names(tmp_path) == []
    complete(RUNS[:1], tmp_path)
    assert len(names(tmp_path)) == 1


def test_an_executor_gives_what_the_caller_alone_gives(solver, tmp_path):
    with ThreadPoolExecutor(2) as executor:
        together = complete(RUNS, tmp_path / "a", executor=executor)
    for left, right in zip(together, complete(RUNS, tmp_path / "b"), strict=True):
        assert_same(left, right)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda content: b"",
        lambda content: b"not an archive",
        lambda content: content[: len(content) // 2],
        lambda content: content.replace(b"limit_load", b"limit_lead"),
        lambda content: b"\x93NUMPY" + content[6:],
    ],
    ids=["empty", "garbage", "truncated", "array missing", "wrong magic"],
)
def test_a_damaged_file_is_named_and_solved_again(solver, tmp_path, spoil):
    complete(RUNS, tmp_path)
    path = tmp_path / f"{RUNS[1].key()}.npz"
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.warns(UserWarning, match=RUNS[1].key()):
        solutions = complete(RUNS, tmp_path)
    assert solver.calls == len(RUNS) + 1
    assert_same(solutions[1], solve(CURVES[1]))
    assert_same(read_solution(path), solve(CURVES[1]))


def test_a_flipped_bit_is_noticed(solver, tmp_path):
    complete(RUNS[:1], tmp_path)
    path = tmp_path / f"{RUNS[0].key()}.npz"
    content = bytearray(path.read_bytes())
    at = content.find(solve(CURVES[0]).readings.tobytes())
    assert at > 0
    content[at + 3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.warns(UserWarning, match="damaged"):
        (solution,) = complete(RUNS[:1], tmp_path)
    assert_same(solution, solve(CURVES[0]))


def variants():
    for field in dataclasses.fields(Dimensions):
        value = getattr(Dimensions(), field.name)
        changed = value - 1 if field.name == "chambers" else value * 1.01
        dimensions = dataclasses.replace(Dimensions(), **{field.name: changed})
        yield field.name, dataclasses.replace(RUNS[0], geometry=Geometry(dimensions))
    for field in dataclasses.fields(Resolution):
        changed = dataclasses.replace(
            RESOLUTION, **{field.name: getattr(RESOLUTION, field.name) * 1.01 or 0.01}
        )
        yield field.name, dataclasses.replace(RUNS[0], resolution=changed)
    curve = CURVES[0]
    for field in dataclasses.fields(Material):
        material = dataclasses.replace(
            curve.material,
            **{field.name: getattr(curve.material, field.name) * (1.0 + 1e-15) or 1e-15},
        )
        yield (
            field.name,
            dataclasses.replace(RUNS[0], curve=dataclasses.replace(curve, material=material)),
        )
    for i in range(len(curve.loads)):
        loads = (*curve.loads[:i], np.nextafter(curve.loads[i], 9.0).item(), *curve.loads[i + 1 :])
        yield (
            f"load {i}",
            dataclasses.replace(RUNS[0], curve=dataclasses.replace(curve, loads=loads)),
        )


def test_the_key_depends_on_every_input():
    keys = {name: run.key() for name, run in variants()}
    assert len({*keys.values(), RUNS[0].key()}) == len(keys) + 1
    assert {"floor", "channel_roof", "up", "paper_group"} <= set(keys)


def test_the_key_depends_on_the_version_of_the_model(monkeypatch):
    before = RUNS[0].key()
    assert before == RUNS[0].key()
    monkeypatch.setattr(campaign, "MODEL_VERSION", "another")
    assert RUNS[0].key() != before


def test_a_design_is_reproducible_and_depends_on_its_seed():
    box = TrainingBox()
    assert space_filling(box, 7, seed=1) == space_filling(box, 7, seed=1)
    assert space_filling(box, 7, seed=1) != space_filling(box, 7, seed=2)


def test_a_larger_design_begins_with_the_smaller_and_a_second_set_shares_none():
    box = TrainingBox()
    design = space_filling(box, 16, seed=1)
    assert space_filling(box, 5, seed=1) == design[:5]
    assert space_filling(box, 8, seed=1, skip=8) == design[8:]
    assert not set(space_filling(box, 8, seed=1)) & set(space_filling(box, 8, seed=1, skip=8))


def test_a_design_fills_the_box_evenly():
    box = TrainingBox()
    raw = np.array(
        [
            (
                c.material.c2_ratio / np.sqrt(3.0 * c.material.c3_ratio),
                np.log(c.material.c3_ratio),
                np.log(c.material.paper_group),
            )
            for c in space_filling(box, 64, seed=1)
        ]
    )
    unit = (raw - np.array(box.lower)) / (np.array(box.upper) - np.array(box.lower))
    for axis in range(3):  # a Sobol' design has one point in each of 64 slices
        assert sorted(np.floor(64 * unit[:, axis]).astype(int)) == list(range(64))


def test_loads_rise_to_the_largest_that_the_material_shall_bear():
    box = TrainingBox()
    for curve in space_filling(box, 16, seed=1):
        assert np.all(np.diff(curve.loads) > 0.0)
        assert curve.loads[0] > 0.0
        stiffening = box.unit(1, np.array(np.log(curve.material.c3_ratio)))
        assert curve.loads[-1] == pytest.approx(float(box.largest_load(stiffening)))
