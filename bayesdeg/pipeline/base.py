"""The base model as a verdict takes it: with the chain of a run, or with as little as it needs."""

from dataclasses import replace

import numpy as np

from bayesdeg.criticism.model_readings import ModelReadings
from bayesdeg.criticism.trials import Trial, base_trial
from bayesdeg.inference.chain import Chain
from bayesdeg.inference.ensemble import EFFORTS, sample
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, Evidence, Laplace, approximate
from bayesdeg.inference.least_squares import near_films
from bayesdeg.inference.model import Model
from bayesdeg.pipeline.calibrate import Fit


def base_of(fit: Fit) -> Trial:
    """Return the base trial of a calibrated model.

    Parameters
    ----------
    fit : Fit
        Its draws are those of the importance sample, or of the chain where that sample is poor.
    """
    known = fit.evidence
    return _trial(fit.model, fit.laplace, known if _enough(known) else _of_chain(known, fit.chain))


def base_without_chain(model: Model, seed: np.random.SeedSequence) -> Trial:
    """Fit a base model as far as its verdict needs: a chain is sampled only if it would be used.

    Parameters
    ----------
    model : Model
        With its readings.
    seed : SeedSequence
        Everything random comes from it.
    """
    approximation, chains = seed.spawn(2)
    generator = np.random.default_rng(approximation)
    laplace = approximate(model, generator, start=near_films(model, generator))
    known = about_mode(model, laplace, generator)
    if not _enough(known):
        known = _of_chain(known, sample(model, known, effort=EFFORTS["quick"], seed=chains))
    return _trial(model, laplace, known)


def _trial(model: Model, laplace: Laplace, posterior: Evidence) -> Trial:
    return base_trial(ModelReadings(model), laplace.mode, posterior)


def _enough(posterior: Evidence) -> bool:
    return posterior.effective >= FEWEST_EFFECTIVE


def _of_chain(posterior: Evidence, chain: Chain) -> Evidence:
    """Put the draws of a chain in the place of a poor importance sample's."""
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    even = np.zeros(len(flat))
    return replace(posterior, draws=flat, log_weights=even, effective=float(len(flat)))
