"""How far an emulator's own error can move a posterior, and curves that make that small."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.commands import training
from bayesdeg.emulator.kept import local_recipe
from bayesdeg.emulator.refinement import Refinement
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.trained import is_refined, write_trained
from bayesdeg.pipeline import refinement
from bayesdeg.pipeline.emulation import Campaign
from bayesdeg.pipeline.refinement import (
    COMMON_ERROR,
    FIRST,
    MORE,
    error_left,
    posteriors_of,
    refining_campaign,
    shifts_of,
)
from bayesdeg.pipeline.run_record import emulator_facts
from tests.pipeline.study_files import SETTINGS, study_in
from tests.pipeline.tiny_campaign import COARSE, FINE, GEOMETRY, RECIPE, TABLE, emulator

MANNER = training.Manner(yes=True, quiet=True, refine=True)


def higher(surrogate, relative):
    """The same map with all curvatures and angles larger."""
    coefficients = surrogate.terms.coefficients.copy()
    constant = np.all(surrogate.terms.orders == 0, axis=1)
    coefficients[:2, constant] += np.log1p(relative)
    return replace(surrogate, terms=replace(surrogate.terms, coefficients=coefficients))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return study_in(tmp_path_factory.mktemp("study"), {"study.toml": SETTINGS + TABLE})


@pytest.fixture(scope="module")
def posteriors(study):
    return posteriors_of(study, emulator(), 7)


def test_the_shift_is_that_of_weighted_least_squares(posteriors):
    (trial, *_), plain, other = posteriors.trials, emulator(), higher(emulator(), 1e-3)
    linear = trial.linear
    first, second = (
        trial.subject.with_world(forward=one).expected(trial.mode[None])[0]
        for one in (plain, other)
    )
    weighted = np.linalg.solve(linear.scatter, linear.jacobian)
    covariance = np.linalg.inv(np.linalg.inv(trial.uncertain) + linear.jacobian.T @ weighted)
    expected = -covariance @ (weighted.T @ (second - first)) / np.sqrt(np.diag(covariance))
    found = shifts_of(trial, plain, other)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-7)
    # of a map that bends further the parameters move so that it bends less
    back = linear.jacobian @ (found * np.sqrt(np.diag(covariance)))
    assert np.sum((second - first) * np.linalg.solve(linear.scatter, back)) < 0.0
    assert np.all(shifts_of(trial, plain, plain) == 0.0)


def test_a_shift_is_linear_in_the_error_of_the_map(posteriors):
    (trial, *_), plain = posteriors.trials, emulator()
    one, ten = (shifts_of(trial, plain, higher(plain, x)) for x in (1e-4, 1e-3))
    np.testing.assert_allclose(ten, 10.0 * one, rtol=5e-3, atol=1e-8)


def test_what_is_left_is_the_jackknife_of_the_curves_left_out(posteriors):
    plain, count = emulator(), 5
    without = tuple(higher(plain, x) for x in (0.0, 0.0, 2e-3, -1e-3, 0.0))
    left = error_left(posteriors, higher(plain, 1e-3), Refinement(plain, without))
    worst = 0.0
    for trial in posteriors.trials:
        kept = [not name.startswith(COMMON_ERROR) for name in trial.subject.table.names]
        each = np.array([shifts_of(trial, plain, one) for one in without])[:, kept]
        worst = max(worst, np.sqrt((count - 1) / count * np.sum(each**2, axis=0)).max())
    assert left.curves == count
    assert left.shift_sd == pytest.approx(worst)
    assert 0.0 < left.moved_sd < left.shift_sd
    assert not left.parameter.startswith(COMMON_ERROR)
    assert left.share_of_reading_errors > 0.0


def test_curves_are_added_to_those_there_are_on_the_mesh_of_the_emulator(posteriors, tmp_path):
    base = Campaign(GEOMETRY, RECIPE, SolutionStore(tmp_path))
    record = json.loads(emulator().record) | {"fine_mesh_mm": vars(COARSE)}
    ground = replace(emulator(), record=json.dumps(record))
    first = refining_campaign(base, posteriors, ground, 0)
    second = refining_campaign(first, posteriors, ground, 1)
    assert len(first.runs) == FIRST
    assert second.runs[:FIRST] == first.runs
    assert len(set(second.runs)) == FIRST + MORE
    assert {run.resolution for run in second.runs} == {COARSE}
    assert {run.resolution for run in refining_campaign(base, posteriors, emulator(), 0).runs} == {
        FINE
    }


def test_a_posterior_holds_the_likeliest_models(posteriors):
    evidence = [trial.log_evidence for trial in posteriors.trials]
    assert max(evidence) - min(evidence) <= refinement.LEAST_FACTOR
    assert len(posteriors.whole.load) > len(posteriors.asked.load)


@pytest.mark.fem
def test_refining_is_resumed_and_ends_with_the_same_bits(study, tmp_path, monkeypatch):
    def recipe(dimensions):
        return replace(local_recipe(dimensions), coarse_mesh=COARSE, fine_mesh=FINE)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training, "LOCAL", recipe)
    monkeypatch.setattr(refinement, "TARGET_SHIFT", np.inf)  # the first round is enough

    given = tmp_path / "given.npz"
    write_trained(given, emulator())

    def work():
        return training.emulator_for(study, given, manner=MANNER, executor=None)

    first = work()
    (kept,) = tmp_path.glob(".cache/emulators/*.npz")
    before, solved = kept.read_bytes(), set(tmp_path.glob(".cache/campaign/*.npz"))
    assert len(solved) == FIRST
    kept.unlink()
    solved.pop().unlink()  # as if it had been stopped before
    second = work()
    assert kept.read_bytes() == before
    assert second.record == first.record
    assert is_refined(first.record)
    assert not is_refined(emulator().record)
    said = json.loads(first.record)["refinement"]
    assert said["curves"] <= FIRST
    sentence = emulator_facts(first.record).record
    assert str(said["curves"]) in sentence
    assert said["parameter"] in sentence
