"""One posterior over causes that cannot be told apart, each with its probability.

A draw of the model with all of these causes predicts like the model with one of them if the sizes
of the others are neutral in that draw. So draws of the single models, combined in proportion to
their evidence, are draws of one model, and every prediction from them is the average.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import softmax

from bayesdeg.analysis.calibrate import Fit
from bayesdeg.analysis.judge import Judgement
from bayesdeg.causes.common_factor import COMMON_FACTOR
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.pages.record import MemberEntry
from bayesdeg.prediction.posterior import Posterior

Floats = NDArray[np.float64]

DRAWS = 4000
"""Draws in total. A rival at odds of 20 gets some 190 of them; one at odds of 400, as good as a
leading cause of an implausible size, gets 10."""


def stored_form(posterior: Posterior) -> xr.DataTree:
    """Return averaged draws as a run folder holds them, with the member of each draw."""
    flat = posterior.chain.vectors.reshape(-1, posterior.chain.vectors.shape[-1])
    dims, values = ("chain", "draw"), posterior.model.table.named(flat)
    draws = xr.Dataset({name: (dims, drawn[None]) for name, drawn in values.items()})
    stats = xr.Dataset({"member": (dims, posterior.number[None])})
    return xr.DataTree.from_dict({"posterior": draws, "sample_stats": stats})


def averaged(judgement: Judgement, final: Fit, generator: np.random.Generator) -> Posterior | None:
    """Return draws over the causes that cannot be told apart; None where there is one set only.

    Members are the fitted sets that may be right. If a cause of the readings is replaced, the cause
    of published counts keeps the sizes that it has with the leading one.

    Parameters
    ----------
    judgement : Judgement
        Which causes are as good, and their fits.
    final : Fit
        Calibration of the model with the leading ones.
    generator : Generator
        Draws from each.
    """
    others = list(_others(judgement))
    if not others or not judgement.sampled:
        return None
    own = {cause.name: cause for cause in final.model.causes}
    further = {cause.name: cause for one in others for cause in one.trial.subject.causes}
    whole = final.model.extended(*(c for name, c in further.items() if name not in own))
    shares = softmax([0.0, *(one.log_factor for one in others)])
    sets = [tuple(sorted(own)), *(one.causes for one in others)]
    counts = np.maximum(generator.multinomial(DRAWS, shares), 1)  # so that each can be requested
    drawn = [
        _drawn(whole, final, trial, names, int(count), generator)
        for names, trial, count in zip(
            sets, [None, *(one.trial for one in others)], counts, strict=True
        )
    ]
    order = generator.permutation(np.sum(counts))  # so that any first draws cover all members
    number = np.repeat(np.arange(len(sets)), counts)
    members = tuple(
        MemberEntry(causes=n, probability=float(p)) for n, p in zip(sets, shares, strict=True)
    )
    vectors = np.concatenate(drawn)[order][None, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(1))
    return Posterior(whole, chain, members=members, number=number[order])


class _Other(NamedTuple):
    """A rival set, its log Bayes factor over the leading one, and its fit."""

    causes: tuple[str, ...]
    log_factor: float
    trial: CandidateFit


def _others(judgement: Judgement) -> Iterator[_Other]:
    predicted, search, counted = judgement.predicted_with, judgement.search, judgement.counted
    leading = search.factor(judgement.chosen)
    chosen, own = judgement.chosen, frozenset(predicted)
    once = [one.replaced(chosen, r) for one in judgement.supported for r in one.inseparable]
    stated = () if judgement.stated is None else judgement.stated.members
    for names in dict.fromkeys([*once, *(one.names for one in stated if one.fitted)]):
        if names != chosen and names in search.trials and chosen - names <= own:
            instead = tuple(sorted(own - chosen | names))
            yield _Other(instead, search.factor(names) - leading, search.trials[names])
    best = judgement.of_counts if judgement.counts_fitted else None
    if best is None or counted is None:
        return
    trials = {one.name: one.trial for one in counted.tried}
    for rival in best.support.inseparable:
        if rival != COMMON_FACTOR.name:
            instead = tuple(sorted({*predicted} - {best.name} | {rival}))
            yield _Other(instead, -best.support.rivals[rival], trials[rival])


def _drawn(
    whole: JointModel,
    final: Fit,
    trial: CandidateFit | None,
    causes: tuple[str, ...],
    count: int,
    generator: np.random.Generator,
) -> Floats:
    """Draw from one set of causes, as vectors of the model with all, (count, n_parameters).

    The sizes of the other causes are neutral.
    """
    flat = final.chain.vectors.reshape(-1, final.chain.vectors.shape[-1])
    values = final.model.table.named(flat[generator.integers(len(flat), size=count)])
    if trial is not None:
        values |= trial.subject.table.named(trial.draws(generator, count))
    neutral = {
        cause.qualified(p.name): np.full(count, p.neutral or 0.0)
        for cause in whole.causes
        if cause.name not in causes
        for p in cause.parameters
    }
    return whole.table.vectors(values | neutral)
