import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from bayesdeg.analysis.judge import judge_model
from bayesdeg.priors import HalfNormal

STUDIES = Path(__file__).resolve().parents[2] / "studies"


@pytest.fixture(scope="module")
def study():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(STUDIES))
        yield importlib.import_module("falling_ball")


@pytest.fixture(scope="module")
def judged(study):
    return {
        known: judge_model(study.asked(gravity_known=known).density, study.CATALOGUE, seed=1)
        for known in (False, True)
    }


@pytest.fixture(scope="module")
def printed():
    """The answers as the command gives them, with another seed."""
    command = [sys.executable, str(STUDIES / "falling_ball.py"), "--json", "--seed", "2"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    return json.loads(done.stdout)


@given(st.floats(0.1, 5.0), st.floats(1e-9, 0.5))
def test_fall_time_with_drag_solves_the_equation_of_motion(study, height, drag):
    time = float(study.fall_time(study.Fall(np.array(height), 9.81, drag), np.array(height)))
    rate, terminal = np.sqrt(9.81 * drag), np.sqrt(9.81 / drag)
    # the speed g/v∞ tanh is the textbook solution; its integral over the time is the height
    fallen = terminal / rate * np.log(np.cosh(rate * time))
    assert fallen == pytest.approx(height, rel=1e-6)


def test_fall_time_agrees_with_integration(study):
    def motion(t, state):
        return state[1], 9.81 - 0.19 * state[1] ** 2

    time = float(study.fall_time(study.Fall(np.array(3.0), 9.81, 0.19), np.array(3.0)))
    found = solve_ivp(motion, (0.0, time), (0.0, 0.0), rtol=1e-10, atol=1e-12)
    assert found.y[0, -1] == pytest.approx(3.0, rel=1e-8)


def test_fall_time_is_smooth_through_zero_drag(study):
    drag = np.array([-1e-6, 0.0, 1e-6])
    times = study.fall_time(study.Fall(np.array(2.0), 9.81, drag), np.array(2.0))
    assert times[1] == np.sqrt(4.0 / 9.81)
    assert times[0] < times[1] < times[2]
    assert times[2] - times[1] == pytest.approx(times[1] - times[0], rel=1e-4)


def test_data_are_those_of_the_source(study):
    subject = study.asked(gravity_known=True).density
    assert len(subject.observed) == 63
    assert len(subject.groups) == 21
    assert subject.places.along.max() == 4.272
    assert subject.observed.sum() == pytest.approx(43.31, abs=0.005)
    header = study.DATA.read_text(encoding="utf-8").splitlines()[0]
    assert "bandframework/surmise" in header
    assert "MIT" in header


def test_g_of_the_formula_is_that_of_quadrature(study, judged):
    """The posterior of g and the timing error, on a grid."""
    base = judged[False].search.base
    height, time = base.subject.places.along, base.subject.observed
    g, sd = np.linspace(6.5, 10.5, 401)[:, None], np.linspace(0.05, 0.15, 301)
    squares = np.sum((time - np.sqrt(2.0 * height / g)) ** 2, axis=1)[:, None]
    log = -0.5 * squares / sd**2 - len(time) * np.log(sd) + HalfNormal(0.1).log_density(sd)
    weight = np.exp(log - log.max()).sum(axis=1)
    weight /= weight.sum()
    mean = weight @ g[:, 0]
    spread = np.sqrt(weight @ (g[:, 0] - mean) ** 2)
    draws = base.subject.table.named(base.draws(np.random.default_rng(0), 4000))["g"]
    assert np.mean(draws) == pytest.approx(mean, abs=0.1 * spread)
    assert np.std(draws) == pytest.approx(spread, rel=0.07)
    assert mean == pytest.approx(8.15, abs=0.03)
    assert spread == pytest.approx(0.22, abs=0.02)


def test_with_g_unknown_the_interval_of_the_formula_excludes_gravity(study, judged):
    base = judged[False].search.base
    draws = base.subject.table.named(base.draws(np.random.default_rng(0), 4000))["g"]
    assert np.quantile(draws, 0.999) < study.GRAVITY


def test_with_g_known_the_misfit_shows_and_drag_is_named(judged):
    found = judged[True]
    assert found.misfit.p_value <= 0.005
    assert (found.decision.outcome, found.decision.causes) == ("named", ("drag",))
    assert found.search.factor(frozenset({"drag"})) > found.search.factor(
        frozenset({"reaction_time"})
    ) + np.log(20.0)
    assert found.left.p_value > 0.05


def test_with_g_unknown_drag_leads_and_g_is_right_once_it_is_there(study, judged):
    found = judged[False]
    assert found.decision.causes == ("drag",)
    draws = found.draws("g", np.random.default_rng(0))
    assert np.quantile(draws, 0.05) < study.GRAVITY < np.quantile(draws, 0.95)
    # it takes more than twice the interval of the formula, which is the price of not knowing g
    base = found.search.base
    alone = base.subject.table.named(base.draws(np.random.default_rng(0), 4000))["g"]
    assert np.std(draws) > 2.0 * np.std(alone)


@pytest.mark.long
@pytest.mark.slow
def test_with_g_unknown_the_name_rests_on_what_is_believed_of_drag(printed):
    open_case, closed = printed["g unknown"], printed["g known"]
    factors = [one[0] for one in open_case["drag_by_prior"].values()]
    assert factors[0] < open_case["threshold"] < factors[2]
    assert all(one[0] > closed["threshold"] for one in closed["drag_by_prior"].values())


@pytest.mark.slow
def test_another_seed_says_the_same(judged, printed):
    for known, title in ((False, "g unknown"), (True, "g known")):
        assert printed[title]["outcome"] == judged[known].decision.outcome
        assert tuple(printed[title]["causes"]) == judged[known].decision.causes
    assert printed["g known"]["units"]["drag.coefficient"] == "1/m"


def test_the_script_is_short():
    assert len((STUDIES / "falling_ball.py").read_text(encoding="utf-8").splitlines()) < 150
