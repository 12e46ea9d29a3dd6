"""Proposals that the emulator refuses are counted, kept, and said."""

import json
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from bayesdeg.actuator.status import Status
from bayesdeg.analysis.calibrate import calibrate
from bayesdeg.inference.laplace import Evidence, approximate, evidence
from bayesdeg.inference.model import CountedDensity, Refusals
from bayesdeg.inference.sampling import Effort, sample
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.progress import Silent
from bayesdeg.run.run_record import emulator_facts, refusal_words
from tests.inference.small_study import altered, draws_near_truth, small_model, values_of
from tests.surrogate.closed_form import trained

SHORT = Effort(effective=1e9, r_hat=1.0, chunk=10, longest=20, ensembles=2)


def model():
    return altered(small_model(), forward=trained())


@cache
def vectors():
    """Some of them outside the training, some impossible for other reasons."""
    return draws_near_truth(model(), 400, spread=0.4)


def test_counting_changes_no_density():
    counted = CountedDensity(model())
    np.testing.assert_array_equal(counted(vectors()), model().log_prob(vectors()))
    assert counted.refusals.proposed == len(vectors())


def test_refused_is_what_prior_and_stability_allow_and_the_emulator_does_not():
    counted = CountedDensity(model())
    density = counted(vectors())
    table = model().table
    with np.errstate(all="ignore"):
        values = table.named(vectors())
        allowed = np.isfinite(table.log_prior(vectors())) & model().allows(values)
        status = model().data_of(Curvature).predicted(model().tests(values)).prediction.status
    outside = np.any(
        (status == Status.OUTSIDE_TRAINING) & model().data_of(Curvature).tests.mask, axis=(1, 2)
    )
    # outside at the median of the specimens, or at their deviations alone
    assert 0 < np.sum(allowed & outside) <= counted.refusals.refused < np.sum(allowed)
    assert np.all(np.isfinite(density) == allowed)
    assert np.sum(~allowed) > 0
    alone = [CountedDensity(model()) for _ in vectors()]
    for one, vector in zip(alone, vectors(), strict=True):
        one(vector[None])
    assert counted.refusals.refused == sum(one.refusals.refused for one in alone)


@dataclass(frozen=True)
class Refusing:
    """Refuses one reading of one specimen, whatever is asked."""

    specimen: int
    point: int

    def __call__(self, inputs):
        prediction = trained()(inputs)
        status = prediction.status.copy()
        status[:, self.specimen, self.point] = Status.OUTSIDE_TRAINING
        return replace(prediction, status=status)


@pytest.mark.parametrize(("reading", "share"), [((0, 3), 1.0), ((1, 3), 0.0)])
def test_only_readings_that_were_taken_count(reading, share):
    """Specimen 1 has no reading at its point 3."""
    counted = CountedDensity(altered(model(), forward=Refusing(*reading)))
    counted(np.tile(model().table.vectors(values_of()), (5, 1)))
    assert counted.refusals == Refusals(5, round(5 * share))


def test_a_model_without_actuators_refuses_nothing():
    counted = CountedDensity(altered(model(), actuator=None, forward=None))
    counted(vectors())
    assert counted.refusals == Refusals(len(vectors()), 0)


@cache
def start():
    generator = np.random.default_rng(0)
    laplace = approximate(model(), generator, start=model().table.vectors(values_of())[0])
    return evidence(model(), laplace, generator, draws=500)


def test_the_sampler_counts_every_density_that_it_asks_for():
    chain = sample(model(), start(), effort=SHORT, seed=np.random.SeedSequence(5))
    ensembles, _, walkers, _ = chain.vectors.shape
    # each walker once a step
    assert chain.refusals.proposed == ensembles * walkers * 20
    assert chain.thinned(10).refusals == chain.refusals


def test_refusals_of_the_sampler_are_those_of_its_ensembles():
    """Walkers that start at the edge of the training propose what is outside."""
    draws = draws_near_truth(model(), 60, spread=0.2)
    possible = np.isfinite(model().log_prob(draws))
    edge = Evidence(0.0, 0.1, draws, np.where(possible, 0.0, -np.inf), float(possible.sum()))
    chain = sample(model(), edge, effort=SHORT, seed=np.random.SeedSequence(1))
    assert 0 < chain.refusals.refused < chain.refusals.proposed


def test_a_resumed_calibration_keeps_its_counts(tmp_path):
    checkpoints = Checkpoints(tmp_path, "this study")

    def fit():
        return calibrate(
            model(),
            "base",
            effort=SHORT,
            seed=np.random.SeedSequence(3),
            checkpoints=checkpoints,
            progress=Silent(),
            start=model().table.vectors(values_of())[0],
        )

    first, again = fit(), fit()
    assert first.chain.refusals.proposed > 0
    assert again.chain.refusals == first.chain.refusals
    np.testing.assert_array_equal(again.chain.vectors, first.chain.vectors)


@pytest.mark.parametrize(
    ("refused", "words", "warned"),
    [
        (0, "None of the 10000", False),
        (100, "100 of 10000", False),
        (101, "(1 %)", True),
        (2500, "(25 %)", True),
    ],
)
def test_refusals_are_said_in_plain_words_with_what_to_do_above_one_percent(refused, words, warned):
    said = refusal_words(Refusals(10000, refused))
    assert words in said
    assert ("Narrow the priors" in said) == warned


def test_without_proposals_nothing_is_said():
    assert refusal_words(Refusals()) == ""


def test_a_record_shows_what_it_has_and_is_silent_of_the_rest():
    assert emulator_facts("{}").record == ""
    assert emulator_facts("{}").accuracy == ()
    measures = {"rms_pct": 0.3, "p95_pct": 0.6, "max_pct": 1.9, "coverage_90": 0.92}
    accuracy = {"curvature": measures, "limit": {"p95_pct": 1.0}}
    record = {"model_version": "7", "mesh_error_pct": 0.4, "accuracy": accuracy}
    facts = emulator_facts(json.dumps(record)).document()
    assert facts["model_version"] == "7"
    assert facts["coarse_curves"] is None
    assert facts["error_pct"] == pytest.approx(0.5)
    assert facts["accuracy"][0] == {"quantity": "curvature", **measures}
    assert facts["accuracy"][1]["rms_pct"] is None
    assert "0.30 % rms" in facts["record"]


def test_records_of_the_first_version_are_read():
    trained_once = {
        "coarse_curves": 256,
        "fine_curves": 32,
        "left_out_rms_pct": 0.52,
        "left_out_p95_pct": 0.84,
        "left_out_largest_pct": 5.2,
        "mesh_error_pct": 0.65,
    }
    facts = emulator_facts(json.dumps(trained_once)).document()
    assert facts["accuracy"] == [
        {
            "quantity": "curvature",
            "rms_pct": 0.52,
            "p95_pct": 0.84,
            "max_pct": 5.2,
            "coverage_90": None,
        }
    ]
    assert facts["record"].startswith("256 curves")
    assert " 32 of" in facts["record"]
