"""How far an emulator's own error can move a posterior, and curves that make that small."""

import json
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from bayesdeg import training
from bayesdeg.analysis import region
from bayesdeg.analysis.region import (
    COMMON_ERROR,
    FIRST,
    MORE,
    WEIGHED,
    error_left,
    posteriors_of,
    refining_campaign,
    shifts_of,
)
from bayesdeg.pages.wording import parameter_words
from bayesdeg.run.run_record import emulator_facts
from bayesdeg.surrogate.campaign import Campaign
from bayesdeg.surrogate.kept import local_recipe
from bayesdeg.surrogate.refinement import Refinement
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.trained import is_refined, write_trained
from tests.run.study_files import SETTINGS, study_in
from tests.run.tiny_campaign import COARSE, FINE, GEOMETRY, RECIPE, TABLE, emulator

MANNER = training.TrainingOptions(yes=True, quiet=True, refine=True)


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


@dataclass(frozen=True)
class NormalPosterior:
    """Parameters whose posterior is normal about what the map says, in widths of 1 and 3."""

    mean: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @property
    def subject(self):
        return self

    def with_world(self, *, forward):
        return replace(self, mean=forward)

    def log_prob(self, vectors):
        return -0.5 * np.sum(((vectors - self.mean) / [1.0, 3.0]) ** 2, axis=1)


def test_the_shift_of_a_normal_posterior_is_that_of_its_mean():
    vectors = np.random.default_rng(1).normal(0.0, [1.0, 3.0], (20_000, 2))
    moved = np.array([0.05, -0.3])
    found = shifts_of(NormalPosterior(), vectors, np.zeros(2), moved)
    np.testing.assert_allclose(found, moved / [1.0, 3.0], atol=5e-3)


@dataclass(frozen=True)
class Bounded(NormalPosterior):
    """The same, of a map that has no answer beyond two widths."""

    def log_prob(self, vectors):
        return np.where(np.abs(vectors[:, 0]) < 2.0, super().log_prob(vectors), -np.inf)


def test_draws_that_neither_map_answers_are_no_part_of_a_shift():
    vectors = np.random.default_rng(1).normal(0.0, [1.0, 3.0], (20_000, 2))
    moved, inside = np.array([0.05, -0.3]), np.abs(vectors[:, 0]) < 2.0
    found = shifts_of(Bounded(), vectors, np.zeros(2), moved)
    wanted = shifts_of(NormalPosterior(), vectors[inside], np.zeros(2), moved)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_the_shift_is_what_weighting_moves_means_by(posteriors):
    (trial, *_), plain, other = posteriors.trials, emulator(), higher(emulator(), 1e-3)
    vectors = trial.draws(np.random.default_rng(1), 1000)
    first, second = (
        trial.subject.with_world(forward=one).log_prob(vectors) for one in (plain, other)
    )
    weights = np.exp(second - first)
    weighted = weights @ vectors / weights.sum()
    expected = (weighted - vectors.mean(axis=0)) / vectors.std(axis=0)
    found = shifts_of(trial, vectors, plain, other)
    assert np.abs(found).max() > 1e-4
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(found).max())
    assert np.all(shifts_of(trial, vectors, plain, plain) == 0.0)


def test_what_is_left_is_the_jackknife_of_the_curves_left_out(posteriors):
    plain, count = emulator(), 5
    without = tuple(higher(plain, x) for x in (0.0, 0.0, 2e-3, -1e-3, 0.0))
    left = error_left(posteriors, higher(plain, 1e-3), Refinement(plain, without))
    worst = 0.0
    for trial in posteriors.trials:
        kept = [not name.startswith(COMMON_ERROR) for name in trial.subject.table.names]
        vectors = trial.draws(np.random.default_rng(0), WEIGHED)
        each = np.array([shifts_of(trial, vectors, plain, one) for one in without])[:, kept]
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
    assert len(set(second.runs)) == len(second.runs)
    assert FIRST + MORE - 2 <= len(second.runs) <= FIRST + MORE  # a draw may be chosen again
    assert {run.resolution for run in second.runs} == {COARSE}
    assert {run.resolution for run in refining_campaign(base, posteriors, emulator(), 0).runs} == {
        FINE
    }


def test_a_posterior_holds_the_likeliest_models(posteriors):
    evidence = [trial.log_evidence for trial in posteriors.trials]
    assert max(evidence) - min(evidence) <= region.LEAST_FACTOR
    assert len(posteriors.whole.load) > len(posteriors.asked.load)


@pytest.mark.long
@pytest.mark.fem
def test_refining_is_resumed_and_ends_with_the_same_bits(study, tmp_path, monkeypatch):
    def recipe(dimensions):
        return replace(local_recipe(dimensions), coarse_mesh=COARSE, fine_mesh=FINE)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training, "LOCAL", recipe)
    monkeypatch.setattr(region, "TARGET_SHIFT", np.inf)  # the first round is enough

    given = tmp_path / "given.npz"
    write_trained(given, emulator())

    def work():
        return training.emulator_for(study, given, options=MANNER, executor=None)

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
    assert parameter_words(said["parameter"]) in sentence
