"""Flaws hidden in actuators that burst are found from the shipped study's folder alone.

Its walls break at their weakest integration point; flaws are cracks there. Neither is the model
that is fitted.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.inference.sampling import Chain
from bayesdeg.prediction.predictive import rupture_table
from tests.hidden_effects.judging import judged

STUDY = Path(__file__).parents[2] / "studies" / "gelatin_rupture"
FLAWS = "flaw_embrittlement"
PRESSURE = 400.0


@pytest.fixture(scope="module")
def judgement(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rupture") / "study"
    shutil.copytree(STUDY, folder, ignore=shutil.ignore_patterns("truth.json"))
    return judged(assemble(read_study(folder)))


def predicted(trial):
    """Probabilities to have burst at 400 kPa, at 10 and 25 % degradation."""
    generator = np.random.default_rng(0)
    vectors = trial.draws(generator, 300)[None, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(1))
    table = rupture_table(
        trial.subject,
        chain,
        generator,
        degradation=np.array([10.0, 25.0]),
        pressure=np.array([PRESSURE]),
        draws=300,
    )
    return table["probability"].to_numpy()


@pytest.mark.long
@pytest.mark.slow
def test_flaws_are_named(judgement):
    truth = json.loads((STUDY / "truth.json").read_text(encoding="utf-8"))
    assert list(truth["causes"]) == ["flaws"]
    assert judgement.decision.causes == (FLAWS,)
    assert judgement.rupture.p_value < 0.02
    assert judgement.misfit.p_value > 0.05  # readings of curvature show nothing


@pytest.mark.long
@pytest.mark.slow
def test_the_onset_of_flaws_is_that_of_the_truth(judgement):
    truth = json.loads((STUDY / "truth.json").read_text(encoding="utf-8"))
    (flaws,) = (one for one in judgement.candidates if one.cause == FLAWS)
    onset = flaws.effect["onset"]
    assert onset.q05 < truth["causes"]["flaws"]["onset"] < onset.q95
    assert onset.q95 - onset.q05 < 10.0  # %; its prior leaves 17


@pytest.mark.long
@pytest.mark.slow
def test_probabilities_follow_what_burst(judgement):
    """Seven in eight of those like the six most degraded burst before 400 kPa."""
    base = predicted(judgement.search.base)
    final = predicted(judgement.search.trials[frozenset({FLAWS})])
    assert np.all(base < 0.1)
    assert final[0] < 0.2
    assert final[1] > 0.6
