"""Exploration of the study with one cause: from the prior, then where it explains the R²."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from bayesdeg.causes.cause import Cause
from bayesdeg.surrogate.surrogate import Surrogate
from nagai_2021.agreement import Fit, fit
from nagai_2021.aimed import Scores, aimed, from_prior
from nagai_2021.causes import Values, misread, predict, values_at, within_grid
from nagai_2021.imagined import NODES_OF_ERROR, Alteration, Model, Unknowns
from nagai_2021.published import LEVELS, Curves, Materials

Floats = NDArray[np.float64]

MORE = 3
DEGRADED = slice(1, None)
SDS = 5
"""Unknowns of a model: sd and share of the D_R error, and three of noise."""


@dataclass(frozen=True)
class Setting:
    """What all causes are compared on.

    Parameters
    ----------
    surrogate : Surrogate
        The mechanics.
    materials, curves : Materials, Curves
        One row a draw, and the curves of the simulation.
    readings : array, shape (3, n, 6, n_pressures)
        Of experiments without a cause where D_R is off by `NODES_OF_ERROR` [1/m].
    rounds : tuple of (int, int)
        Draws and imagined experiments for each: from the prior, aimed, aimed again. Where no cause
        acts the last has `MORE` times as many, since all are compared with that.
    seed : int
        Of what the first round of all causes shares.
    """

    surrogate: Surrogate
    materials: Materials
    curves: Curves
    readings: Floats
    rounds: tuple[tuple[int, int], ...]
    seed: int


@dataclass(frozen=True)
class Outcome:
    """Draws from the prior, which say what is to be expected, and aimed ones for the evidence.

    Parameters
    ----------
    prior : Fit
        Of draws from the prior.
    inside : array of bool
        Which of them can be simulated.
    last : Fit
        Of aimed draws.
    scores : Scores
        Theirs.
    """

    prior: Fit
    inside: NDArray[np.bool_]
    last: Fit
    scores: Scores

    def joint(self, levels: slice = slice(None)) -> Floats:
        """Return ln of each aimed draw's part in the evidence of some levels, (n,)."""
        total: Floats = self.last.log_likelihood[:, levels].sum(axis=1) + self.scores.log_weight
        return total


def set_up(
    surrogate: Surrogate,
    materials: Materials,
    curves: Curves,
    generator: np.random.Generator,
    *,
    rounds: tuple[tuple[int, int], ...],
) -> Setting:
    """Simulate experiments without a cause, and draw the seed of what is shared."""
    most = MORE * max(count for count, _ in rounds)
    rows = np.arange(most) % len(materials)
    some = materials.take(rows)
    part = Curves(curves.log_curvature[rows], curves.growth[rows])
    readings = [predict(surrogate, some, _true(error)).curvature for error in NODES_OF_ERROR]
    seed = int(generator.integers(2**62))
    return Setting(surrogate, some, part, np.stack(readings), rounds, seed)


def explore(
    setting: Setting, model: Model, generator: np.random.Generator, cause: Cause | None = None
) -> Outcome:
    """Draw from the prior, then twice about what did well."""
    count, inner = setting.rounds[0]
    shared = np.random.default_rng(setting.seed)
    own, more = (0, MORE) if cause is None else (len(cause.parameters), 1)
    scores = from_prior(shared, count, SDS)
    values = np.concatenate([scores.standard, generator.standard_normal((count, own))], axis=1)
    scores = Scores(values, scores.log_weight)
    prior, inside = _fit(setting, model, shared, scores, inner=inner, cause=cause)
    last = prior
    for count, inner in setting.rounds[1:]:
        # of all R², and of those that the one at 0 % is judged given
        goals = [last.log_likelihood[:, levels].sum(axis=1) for levels in (slice(None), DEGRADED)]
        scores = aimed(generator, scores, goals, more * count)
        last, _ = _fit(setting, model, generator, scores, inner=inner, cause=cause)
    return Outcome(prior, inside, last, scores)


def alter(setting: Setting, cause: Cause, values: Values) -> Alteration:
    """Return how a cause changes the readings at each level.

    Where the emulator refuses an erroneous D_R only, the change is that at the recorded one.
    """
    ratios = np.stack([_ratio(setting, i, cause, values) for i in range(len(NODES_OF_ERROR))])
    inside = np.isfinite(ratios[1]).all(axis=(1, 2))
    ratios = np.where(np.isfinite(ratios).all(axis=3, keepdims=True), ratios, ratios[1])
    ratios = np.where(inside[:, None, None], ratios, 1.0)
    off = misread(cause, values)
    shift, scatter = (v.astype(np.float32) for v in (off.shift, off.scatter))
    return Alteration(np.moveaxis(ratios, 0, 2).astype(np.float32), shift, scatter, inside)


def _fit(
    setting: Setting,
    model: Model,
    generator: np.random.Generator,
    scores: Scores,
    *,
    inner: int,
    cause: Cause | None,
) -> tuple[Fit, NDArray[np.bool_]]:
    """Return the fit of draws at given scores, and which of them can be simulated."""
    rows = slice(0, len(scores.standard))
    curves = Curves(setting.curves.log_curvature[rows], setting.curves.growth[rows])
    unknowns = _unknowns(model, scores.standard[:, :SDS])
    altered = (
        None if cause is None else alter(setting, cause, values_at(cause, scores.standard[:, SDS:]))
    )
    found = fit(curves, model, generator, inner=inner, unknowns=unknowns, altered=altered)
    inside = np.ones(len(curves), dtype=bool) if altered is None else altered.inside
    return found, inside


def _unknowns(model: Model, scores: Floats) -> Unknowns:
    """Return the sds at standard normal scores of their priors, (n, 5)."""
    uniform = special.ndtr(scores)
    half_normal = special.ndtri(0.5 + 0.5 * uniform)
    none = np.zeros(len(scores))
    return Unknowns(
        model.degradation * half_normal[:, 0],
        uniform[:, 1],
        none,
        none,
        model.noise * half_normal[:, 2],
        model.floor * half_normal[:, 3],
        model.noise_spread * half_normal[:, 4],
    )


def _ratio(setting: Setting, node: int, cause: Cause, values: Values) -> Floats:
    """Return readings with a cause over those without, nan where refused, (n, 6, P)."""
    count = len(next(iter(values.values())))
    before = setting.readings[node, :count]
    if cause.on_inputs is None and cause.on_reading is None:
        return np.ones_like(before)
    prediction = predict(
        setting.surrogate,
        setting.materials.take(np.arange(count)),
        _true(NODES_OF_ERROR[node]),
        cause=cause,
        values=values,
    )
    return np.where(prediction.status == 0, prediction.curvature / before, np.nan)


def _true(error: float) -> Floats:
    return within_grid(LEVELS + error)
