"""How long a campaign takes, how far it is, and what it trains."""

from dataclasses import dataclass, field, replace
from statistics import median

import pytest

from bayesdeg.actuator.status import Status
from bayesdeg.progress import Silent
from bayesdeg.surrogate.campaign import (
    Campaign,
    Expectation,
    Finished,
    Meter,
    complete,
    endings,
    expect,
    train_emulator,
)
from bayesdeg.surrogate.kept import duration
from bayesdeg.surrogate.solutions import SolutionStore
from tests.run.tiny_campaign import COARSE, FINE, GEOMETRY, RECIPE, build
from tests.surrogate.closed_form import solution


@dataclass
class Shown:
    """What was shown."""

    stages: list = field(default_factory=list)
    steps: list = field(default_factory=list)

    def stage(self, name, total=None):
        self.stages.append((name, total))

    def advance(self, steps=1.0, note=""):
        self.steps.append((steps, note))


@pytest.fixture
def campaign(tmp_path):
    return Campaign(GEOMETRY, RECIPE, SolutionStore(tmp_path / "campaign"))


def finished(campaign, number, seconds, status=Status.CONVERGED):
    run = campaign.runs[number]
    answer = solution([], [], [], status=status)
    return Finished(run, answer, seconds)


@pytest.mark.fem
def test_the_time_is_known_from_a_factorization_and_then_from_runs(campaign):
    shown = Shown()
    expectation = expect(campaign, shown)
    assert shown.stages == [("timing the meshes", 2)]
    assert len(shown.steps) == 2
    assert expectation.left == {COARSE: 6, FINE: 2}
    assert all(seconds > 0.0 for seconds in expectation.each.values())
    assert expectation.core_seconds == pytest.approx(
        6 * expectation.each[COARSE] + 2 * expectation.each[FINE]
    )
    # nothing was solved for it; what is solved says it better
    assert campaign.store.seconds() == {}
    few = [run for run in campaign.runs if run.resolution == COARSE][:3]
    complete(few, campaign.store)
    again = Shown()
    expectation = expect(campaign, again)
    assert again.stages == [("timing the meshes", 1)]
    assert expectation.left == {COARSE: 3, FINE: 2}
    assert expectation.each[COARSE] == pytest.approx(median(campaign.store.seconds().values()))
    # and so does what was solved of the same actuator for another campaign
    other = replace(campaign, recipe=replace(RECIPE, seed=RECIPE.seed + 1))
    assert not set(few) & set(other.runs)
    assert expect(other, Silent()).each[COARSE] != expectation.each[COARSE]
    alike = expect(replace(other, alike=campaign.runs), Silent())
    assert alike.each[COARSE] == expectation.each[COARSE]


@pytest.mark.fem
def test_the_emulator_is_built_on_what_is_left_and_the_endings_are_of_all(campaign, monkeypatch):
    monkeypatch.setattr("bayesdeg.surrogate.campaign.build", build)
    shown = Shown()
    surrogate = train_emulator(campaign, expect(campaign, Silent()), shown)
    assert surrogate.length == GEOMETRY.dimensions.length
    assert [steps is None for _, steps in shown.stages] == [False, True]
    assert len(shown.steps) == 8
    assert shown.steps[-1][1].startswith(f"8 of 8, {duration(0.0)}")
    ended = endings(campaign)
    assert [run for run, _ in ended] == campaign.runs
    assert all(isinstance(status, Status) for _, status in ended)
    # nothing is left: no campaign is shown
    shown = Shown()
    expectation = expect(campaign, Silent())
    assert expectation.left == {}
    assert expectation.seconds == 0.0
    train_emulator(campaign, expectation, shown)
    assert [steps for _, steps in shown.stages] == [None]


def test_a_bar_counts_runs_by_their_cost_and_says_what_is_left(campaign):
    now = [0.0]
    shown = Shown()
    expectation = Expectation({COARSE: 100, FINE: 10}, {COARSE: 2.0, FINE: 40.0}, workers=2)
    meter = Meter(expectation, shown, clock=lambda: now[0])
    assert shown.stages == [("finite element curves", 600.0)]
    assert meter.remaining() == pytest.approx(300.0)
    now[0] = 1.0
    meter(finished(campaign, 0, 2.0))
    now[0] = 20.0
    meter(finished(campaign, 6, 40.0, Status.EFFORT_EXHAUSTED))
    assert [steps for steps, _ in shown.steps] == [2.0, 40.0]
    # at the pace of two cores: (99 · 2 + 9 · 40) / 2
    assert meter.remaining() == pytest.approx(558.0 / (122.0 / 60.0))
    done, left, failed = shown.steps[-1][1].split(", ")
    assert (done, failed) == ("2 of 110", "1 failed")
    assert left.startswith(duration(meter.remaining()))


def test_what_is_left_follows_measured_times_and_pace(campaign):
    """All runs take twice as long as expected, and one worker of two does nothing."""
    now = [0.0]
    expectation = Expectation({COARSE: 1000}, {COARSE: 2.0}, workers=2)
    meter = Meter(expectation, Shown(), clock=lambda: now[0])
    for _ in range(500):
        now[0] += 4.0
        meter(finished(campaign, 0, 4.0))
    assert meter.remaining() == pytest.approx(500 * 4.0, rel=0.01)


@pytest.mark.parametrize(
    ("status", "failed"),
    [
        (Status.CONVERGED, 0),
        (Status.LIMIT_POINT, 0),
        (Status.BUCKLED, 0),
        (Status.TIMED_OUT, 1),
        (Status.EFFORT_EXHAUSTED, 1),
    ],
)
def test_an_actuator_that_balloons_is_an_answer_and_no_failure(campaign, status, failed):
    meter = Meter(Expectation({COARSE: 2}, {COARSE: 1.0}), Shown())
    meter(finished(campaign, 0, 1.0, status))
    assert meter.failed == failed


def test_more_runs_than_expected_do_no_harm(campaign):
    shown = Shown()
    meter = Meter(Expectation({COARSE: 1}, {COARSE: 1.0}), shown)
    for number in (0, 1, 6):
        meter(finished(campaign, number, 1.0))
    assert meter.remaining() == 0.0
    assert shown.steps[-1][1].startswith("3 of 3")


def test_fewer_runs_than_workers_are_not_divided_among_all():
    assert Expectation({FINE: 1}, {FINE: 30.0}, workers=8).seconds == 30.0


def test_the_expectation_says_how_it_was_found():
    said = str(Expectation({COARSE: 250, FINE: 30}, {COARSE: 2.0, FINE: 40.0}, workers=2))
    for part in ("about 14 min", "250 of 2.0 s", "8 mm", "30 of 40.0 s", "5 mm", "2 at a time"):
        assert part in said


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (59.0, "less than a minute"),
        (61.0, "about 1 min"),
        (3570.0, "about 1 h 0 min"),
        (5400.0, "about 1 h 30 min"),
    ],
)
def test_times_to_come_are_said_in_minutes(seconds, words):
    assert duration(seconds) == words
