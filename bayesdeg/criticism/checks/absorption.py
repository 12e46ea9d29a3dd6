r"""Parameters that absorb a model error, and causes that would push them there.

The actuator readings are separated from all else that is known about a parameter θₖ: its prior,
films, and means of replicates. With N(m, U) the law of the parameters given all else, and readings
y = f + X (θ − m) + e, e ~ N(0, V), the likelihood of θₖ from the readings alone is

.. math:: \ell(\theta_k) = \mathrm{N}(y;\ f + X u_k (\theta_k - m_k),\
    V + X (U - U_{kk} u_k u_k^T) X^T), \qquad u_k = U e_k / U_{kk}

where the other parameters follow θₖ as in the law of all else. The posterior is the product of this
and of the law of all else, which are independent; the posterior itself contains both and must not
be compared with either. Under a correct model the posterior mean deviates from m by N(0, s²),

.. math:: s_k^2 = (U X^T \Sigma^{-1} X U)_{kk}, \qquad \Sigma = V + X U X^T

and the law of the readings alone has variance Uₖₖ (Uₖₖ − s²)/s² and a mean Uₖₖ/s² times as far
from m as the posterior. If the readings determine a parameter much better than all else, s² is near
Uₖₖ: it may move by as much as all else is uncertain. That is learning, not a contradiction.

References
----------
Marshall and Spiegelhalter (2007), doi:10.1214/07-BA203, and Presanis, Ohlssen, Spiegelhalter and De
Angelis (2013), doi:10.1214/13-STS426, for conflicts at a node that is split; Evans and Moshonov
(2006), doi:10.1214/06-BA129, for conflicts of priors and data.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr
from threadpoolctl import threadpool_limits

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.findings import Displacement
from bayesdeg.criticism.fit.linear import Linear, columns_of, linearise, with_neutral
from bayesdeg.criticism.fit.search import LEAST_FACTOR, Names, Search
from bayesdeg.criticism.fit.trials import BENT, CandidateFit
from bayesdeg.inference.importance import about_mode, improved
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, approximate
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.means import Means
from bayesdeg.priors import Flat, Parameter

Floats = NDArray[np.float64]

EFFECTIVE = 4000.0
"""Effective draws of the law of all else: p-values down to 2/4001 are resolved, and 20 parameters
times that are still below the deciding level."""
LEAST_LEARNED = 0.01
"""Share of a parameter's variance that readings must remove for it to be judged: below that, they
narrow it by less than half a percent."""
PUSHED = 0.5
"""Share of a displacement that a cause must remove to be said to push a parameter: it explains more
than it leaves, in either direction."""
DRAWS = 4000  # posterior draws for quantiles: those at 5 % are known to a hundredth of the sd
QUANTILES = (0.05, 0.5, 0.95)
STEP = 1e-3  # step of differences, on the sampler's scale
UNMOVED = 1e-9  # relative change of a mean by rounding


@dataclass(frozen=True)
class AllElse:
    """The law of the parameters given all data but the readings that the model is judged by.

    Draws (n, n_parameters) are on the sampler's scale, their weights sum to 1, and `effective`
    draws of equal weight are worth as much.
    """

    draws: Floats
    weights: Floats
    effective: float

    @cached_property
    def mean(self) -> Floats:
        """m, (n_parameters,)."""
        mean: Floats = self.weights @ self.draws
        return mean

    @cached_property
    def covariance(self) -> Floats:
        """U, (n_parameters, n_parameters)."""
        return np.atleast_2d(np.cov(self.draws.T, aweights=self.weights))

    @property
    def sd(self) -> Floats:
        """Roots of the diagonal of U, (n_parameters,)."""
        return np.sqrt(np.diag(self.covariance))

    def p_value(self, place: int, centre: float, sd: float) -> float:
        r"""Return the probability of a value as far from the law of the readings alone.

        .. math:: p = 2 \min(P(\theta' > \theta''),\ P(\theta' < \theta''))

        with θ' from all else and θ'' ~ N(centre, sd²), independent. Draws represent the first,
        since means of few replicates have heavy tails and bounded priors none.

        The centre and sd of the readings alone are on the sampler's scale.
        """
        above = float(self.weights @ ndtr((self.draws[:, place] - centre) / max(sd, UNMOVED)))
        tail = min(above, 1.0 - above)
        return min(1.0, 2.0 * (1.0 + self.effective * tail) / (1.0 + self.effective))


def judged_kinds(model: JointModel) -> tuple[str, ...]:
    """Return the kinds of data that a model is judged by: those that need the forward map.

    If none does, as with films alone, these are all readings.
    """
    forward = tuple(one.name for one in model.observations if one.uses_forward)
    return forward or tuple(one.name for one in model.criticised)


def all_else(model: JointModel, start: Floats) -> AllElse:
    """Return the law of the parameters given all but the data that a model is judged by.

    The search for it begins at `start`, (n_parameters,).

    Raises
    ------
    ValueError
        If importance sampling fails.
    """
    rest, generator = model.without_kinds(*judged_kinds(model)), np.random.default_rng(0)
    found = about_mode(rest, approximate(rest, generator, start=start), generator)
    if found.effective < EFFECTIVE:
        more = improved(rest, found, generator, draws=int(EFFECTIVE), enough=EFFECTIVE)
        found = max(found, more, key=lambda one: one.effective)
    if found.effective < FEWEST_EFFECTIVE:
        raise ValueError(f"all else is known from {found.effective:.0f} effective draws only")
    kept = np.isfinite(found.log_weights)
    weights = np.exp(found.log_weights[kept] - logsumexp(found.log_weights[kept]))
    return AllElse(found.draws[kept], weights, found.effective)


@dataclass(frozen=True)
class Measured:
    """A direct measurement of a parameter: mean and standard error in its unit, and source."""

    value: float
    se: float
    source: str


NOT_MEASURED = Measured(float("nan"), float("nan"), "")


def measured(model: JointModel, vector: Floats) -> dict[str, Measured]:
    """Return the means of replicates that measure one parameter directly, by its name.

    Young's modulus at a degradation rate of zero is always six times C1 there; between the ends it
    depends on several parameters. If several means measure the same parameter, the most precise
    one counts.
    """
    points = vector + STEP * np.vstack([np.zeros(len(vector)), np.eye(len(vector))])
    values = model.table.named(points)
    found: dict[str, Measured] = {}
    compared = [one.compared(model.state(values)) for one in model.of_kind(Means)]
    for mean, expected in chain.from_iterable(compared):
        changes = expected[1:] - expected[0]
        moving = np.flatnonzero(np.abs(changes) > UNMOVED * np.abs(expected[0]))
        if len(moving) != 1:
            continue
        name = model.table.names[moving[0]]
        own = values[name]
        slope = changes[moving[0]] / (own[moving[0] + 1] - own[0])
        one = Measured(
            float(own[0] + (mean.value - expected[0]) / slope),
            float(mean.se / abs(slope)),
            str(mean.source),
        )
        if name not in found or one.se < found[name].se:
            found[name] = one
    return found


def _interval(parameter: Parameter, draws: Floats, weights: Floats | None = None) -> list[float]:
    """Return median and 90 % interval of draws on the sampler's scale, (n,), in the unit."""
    if weights is None:
        found = np.quantile(draws, QUANTILES)
    else:
        order = np.argsort(draws)
        found = np.interp(QUANTILES, np.cumsum(weights[order]), draws[order])
    return [float(parameter.law.from_unconstrained(q)) for q in found]


NO_INTERVAL = [float("nan")] * 3  # of a flat prior


def holm(p_values: Floats) -> Floats:
    """Return p-values adjusted for a family of tests (Holm), (k,).

    If every hypothesis holds, the probability that any is at most a level is at most that level,
    for any dependence between the statistics: displacements of confounded parameters are correlated
    with either sign, for which the procedure of Benjamini and Hochberg gives no guarantee. One
    wrongly accused parameter is an error, however many are accused rightly.

    References
    ----------
    Holm (1979), Scandinavian Journal of Statistics 6, 65-70, https://www.jstor.org/stable/4615733.

    Examples
    --------
    >>> holm(np.array([0.01, 0.2, 0.03]))
    array([0.03, 0.2 , 0.06])
    """
    order = np.argsort(p_values)
    stepped = np.maximum.accumulate(p_values[order] * np.arange(len(order), 0, -1))
    adjusted = np.empty(len(order))
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


@dataclass(frozen=True)
class Split:
    """A fitted model with the readings it is judged by separated from all else.

    `known` is what all else says; `linear` the readings that the model is judged by, linearised
    with the law of all else.
    """

    trial: CandidateFit
    known: AllElse
    linear: Linear

    @property
    def model(self) -> JointModel:
        """The fitted model."""
        return self.trial.subject

    @cached_property
    def columns(self) -> Floats:
        """Whitened X U, (n_readings, n_parameters)."""
        return self.linear.whiten_columns(self.linear.jacobian @ self.known.covariance)

    @cached_property
    def learned(self) -> Floats:
        """s²/U of each parameter, (n_parameters,)."""
        share = np.sum(self.columns**2, axis=0) / np.diag(self.known.covariance)
        moves = np.any(self.linear.jacobian != 0.0, axis=0)
        # the scatter of readings has no column of its own: correlated parameters account for it
        return np.where(moves, np.minimum(share, 1.0), 0.0)

    @cached_property
    def draws(self) -> Floats:
        """Draws from the posterior, (n, n_parameters)."""
        return self.trial.draws(np.random.default_rng(0), DRAWS)

    @cached_property
    def moved(self) -> Floats:
        """Shift of the posterior mean from all else, in standard deviations of that."""
        return np.asarray((np.mean(self.draws, axis=0) - self.known.mean) / self.known.sd)

    @cached_property
    def displacements(self) -> tuple[Displacement, ...]:
        """Every parameter except those of causes, in the order of the model."""
        direct = measured(self.model, self.trial.mode)
        names = self.model.table.names
        found = [
            self._one(p, names.index(p.name), direct.get(p.name, NOT_MEASURED))
            for p in self.model.base
        ]
        judged = [k for k, one in enumerate(found) if one.is_judged]
        adjusted = holm(np.array([found[k].p_alone for k in judged]))
        for k, p_value in zip(judged, adjusted, strict=True):
            found[k] = found[k].model_copy(update={"p_adjusted": float(p_value)})
        return tuple(found)

    def _one(self, parameter: Parameter, place: int, direct: Measured) -> Displacement:
        law, share = parameter.law, float(self.learned[place])
        is_flat = isinstance(law, Flat)
        is_unknown = is_flat and len(judged_kinds(self.model)) == len(self.model.observations)
        prior = NO_INTERVAL if is_flat else law.quantile(QUANTILES).tolist()
        weighted = _interval(parameter, self.known.draws[:, place], self.known.weights)
        known = NO_INTERVAL if is_unknown else weighted
        base = _interval(parameter, self.draws[:, place])
        one = Displacement(
            parameter=parameter.name,
            meaning=parameter.meaning,
            unit=parameter.unit,
            prior_q05=prior[0],
            prior_q50=prior[1],
            prior_q95=prior[2],
            all_else_q05=known[0],
            all_else_q50=known[1],
            all_else_q95=known[2],
            base_q05=base[0],
            base_q50=base[1],
            base_q95=base[2],
            measured=direct.value,
            measured_se=direct.se,
            measured_source=direct.source,
            moved_sd=float("nan") if is_unknown else float(self.moved[place]),
            learned=share,
        )
        is_shown = share >= LEAST_LEARNED and (direct is not NOT_MEASURED or not is_flat)
        if not is_shown:
            return one
        # the test of the readings alone against all else
        sd = float(self.known.sd[place])
        centre = float(self.known.mean[place]) + sd * one.moved_sd / share
        alone = sd * float(np.sqrt((1.0 - share) / share))
        p_value = self.known.p_value(place, centre, alone)
        score = one.moved_sd / float(np.sqrt(share))
        return one.model_copy(update={"score_sd": score, "p_alone": p_value})

    @cached_property
    def _films(self) -> Linear | None:
        """The readings that are part of all else, linearised; None if there are none."""
        model = self.model.without_kinds(*judged_kinds(self.model))
        if not len(model.observed):
            return None
        trial = self.trial
        return linearise(model, trial.mode, uncertain=trial.uncertain, centre=trial.centre)

    def shift_by(self, effect: "PlacedEffect") -> Floats:
        r"""Return the shift from all else by an effect that a model lacks, (n_parameters,).

        .. math:: \delta = U X^T \Sigma^{-1} (d - X \delta_0), \qquad
            \delta_0 = U_0 X_0^T \Sigma_0^{-1} d_0

        with d the change of the readings, and d₀ that of the films, which shifts all else by δ₀:
        N(m₀, U₀) is the law without films. In standard deviations of all else.
        """
        off = effect.of(self.linear.subject) - self.linear.jacobian @ self._by_films(effect)
        found = self.columns.T @ self.linear.whiten_columns(off)
        return np.asarray(found / self.known.sd)

    def refit_shift(self, trial: CandidateFit, effect: "PlacedEffect") -> Floats:
        """Return the same shift from a model fitted with the effect, (n_parameters,).

        This is how far the posterior mean returns if the effect is part of the model; in a linear
        model it equals `shift_by`.
        """
        mean = np.mean(trial.draws(np.random.default_rng(0), DRAWS), axis=0)
        there = dict(zip(trial.subject.table.names, mean, strict=True))
        back = np.mean(self.draws, axis=0) - [there[name] for name in self.model.table.names]
        return np.asarray((back - self._by_films(effect)) / self.known.sd)

    def _by_films(self, effect: "PlacedEffect") -> Floats:
        """Return δ₀, (n_parameters,)."""
        films = self._films
        if films is None:
            return np.zeros(len(self.known.mean))
        moved = films.whiten_columns(films.jacobian @ self.trial.uncertain)
        return np.asarray(moved.T @ films.whiten_columns(effect.of(films.subject)))


def split(trial: CandidateFit) -> Split:
    """Separate a fitted model's readings from all else.

    If a parameter has adapted to the readings, these are linearised at its value from all else: a
    scatter that grew to accommodate an effect would hide the shifts of the others, and a law with
    heavy tails adapts completely.

    Raises
    ------
    ValueError
        If all else could not be sampled, or the model does not answer where it was fitted.
    """
    model = trial.subject
    known = all_else(model, trial.mode)
    judged = judged_kinds(model)
    alone = model.without_kinds(*(k.name for k in model.criticised if k.name not in judged))
    bent = np.abs(trial.mode - known.mean) > BENT * known.sd
    for cause in model.causes:
        bent[columns_of(model, cause)] = False
    for point in (np.where(bent, known.mean, trial.mode), trial.mode):
        linear = linearise(alone, point, uncertain=known.covariance, centre=known.mean)
        if linear.is_known:
            return Split(trial, known, linear)
    raise ValueError("the model does not answer at its mode")


@dataclass(frozen=True)
class PlacedEffect:
    """Causes at given sizes, at a point of the parameter space.

    `vector` (n_parameters + n_sizes,) is of the model with the causes; `neutral` is the same where
    they have no effect.
    """

    causes: tuple[Cause, ...]
    vector: Floats
    neutral: Floats

    @classmethod
    def at(cls, model: JointModel, point: Floats, cause: Cause, size: Floats) -> "PlacedEffect":
        """Return the effect of a cause that a model lacks.

        Point (n_parameters,) and size (n_sizes,) are on the sampler's scale.
        """
        extended = model.extended(cause)
        neutral = with_neutral(point, model, extended)
        vector = neutral.copy()
        vector[columns_of(extended, cause)] = size
        return cls((cause,), vector, neutral)

    def of(self, model: JointModel) -> Floats:
        """Return the change of a model's readings, (n,); nan where it cannot be computed."""
        readings = model.extended(*self.causes).expected(np.stack([self.vector, self.neutral]))
        change: Floats = readings[0] - readings[1]
        return change


@dataclass(frozen=True)
class Push:
    """Shift of a model's parameters by one or several causes that the model lacks.

    `shifts` are by parameter, off all else, in standard deviations of all else; the Bayes factor is
    against the model without a cause [nats].
    """

    causes: tuple[str, ...]
    log_bayes_factor: float
    shifts: Mapping[str, float]

    def share(self, one: Displacement) -> float:
        """Return the explained share of a displacement [–]; nan if there is none."""
        return self.shifts[one.parameter] / one.moved_sd if one.moved_sd else float("nan")

    def explains(self, one: Displacement) -> bool:
        """Return whether more of a displacement is removed than is left, see `PUSHED`."""
        return abs(1.0 - self.share(one)) <= PUSHED


@dataclass(frozen=True)
class Absorption:
    """Displacements of the base model's parameters, and causes that would push them.

    `pushes` are by every cause by itself, then by those together that the evidence favours, if
    several; `after` are the same parameters with these, empty if there are none.
    """

    displacements: tuple[Displacement, ...]
    pushes: tuple[Push, ...] = ()
    after: tuple[Displacement, ...] = ()

    @classmethod
    def complete(
        cls,
        displacements: Iterable[Displacement],
        pushes: tuple[Push, ...] = (),
        after: tuple[Displacement, ...] = (),
    ) -> "Absorption":
        """Return displacements that know what pushed them, and where they are with the causes."""
        given, completed = cls(tuple(displacements), pushes, after), []
        for one in given.displacements:
            there, known = given.returned(one), dict[str, object]()
            if there is not None:
                known = {
                    "after_q05": there.base_q05,
                    "after_q50": there.base_q50,
                    "after_q95": there.base_q95,
                    "after_moved_sd": there.moved_sd,
                }
            pushed_by = given.pushed_by(one) if one.in_question else ()
            if pushed_by:
                known["pushed_by"] = tuple(push.causes for push in pushed_by)
                known["pushed_share"] = pushed_by[0].share(one)
            completed.append(one.model_copy(update=known))
        return replace(given, displacements=tuple(completed))

    @property
    def judged(self) -> tuple[Displacement, ...]:
        """Parameters that the readings could have contradicted."""
        return tuple(one for one in self.displacements if one.is_judged)

    @property
    def in_question(self) -> tuple[Displacement, ...]:
        """Parameters that the readings contradict, the most displaced first."""
        found = [one for one in self.displacements if one.in_question]
        return tuple(sorted(found, key=lambda one: -abs(one.score_sd)))

    def pushed_by(self, one: Displacement) -> tuple[Push, ...]:
        """Return the causes that would push a parameter to its value, the best first.

        Each has a favourable Bayes factor, within odds of 20 of the best, and explains more of the
        displacement than it leaves: any one of them may be responsible. If no single cause does,
        the causes that the evidence favours together, if they do. Empty if nothing in the catalogue
        does.
        """
        factors = [push.log_bayes_factor for push in self.pushes]
        least = max(LEAST_FACTOR, max(factors, default=-np.inf) - LEAST_FACTOR)
        leading = [push for push in self.pushes if push.log_bayes_factor >= least]
        found = [push for push in leading if push.explains(one)]
        found.sort(key=lambda push: -push.log_bayes_factor)
        alone = tuple(push for push in found if len(push.causes) == 1)
        return alone or tuple(found)

    def of(self, name: str) -> Displacement | None:
        """Return the entry of a parameter of the base model; None if it does not exist."""
        return next((one for one in self.displacements if one.parameter == name), None)

    def returned(self, one: Displacement) -> Displacement | None:
        """Return the entry of a parameter with the causes that the evidence favours."""
        return next((other for other in self.after if other.parameter == one.parameter), None)


def absorption(search: Search, chosen: Names) -> Absorption:
    """Return the displacements of the base model's parameters, and the causes that would push them.

    Raises
    ------
    ValueError
        As of `split`.
    """
    with threadpool_limits(limits=1):  # the same sums in the same order on every machine
        base = split(search.base)
        pushes = tuple(_pushes(search, base, chosen))
        after = split(search.trials[chosen]).displacements if chosen else ()
    return Absorption.complete(base.displacements, pushes, after)


def _pushes(search: Search, base: Split, chosen: Names) -> Iterable[Push]:
    """Yield the shifts by every single cause, then by the favoured causes together.

    For a cause fitted alone, from that fit; for one fitted only together with others, or only
    screened, from the linear model at its size there.
    """
    step, names = search.step(search.base.names), base.model.table.names
    for cause in search.causes:
        own = frozenset({cause.name})
        if own in search.trials and (cause.name not in chosen or chosen == own):
            shift = base.refit_shift(search.trials[own], effect_in(search.trials[own], own))
            factor = search.factor(own)
        elif cause.name in chosen:
            shift = base.shift_by(effect_in(search.trials[chosen], own))
            factor = search.factor(chosen)
        else:
            effect = PlacedEffect.at(base.model, base.linear.mode, *step.guess(cause.name))
            shift, factor = base.shift_by(effect), step.screened[cause.name].log_bayes_factor
        yield Push((cause.name,), factor, dict(zip(names, shift.tolist(), strict=True)))
    if len(chosen) > 1:
        trial = search.trials[chosen]
        shifts = base.refit_shift(trial, effect_in(trial, chosen)).tolist()
        together = dict(zip(names, shifts, strict=True))
        yield Push(tuple(sorted(chosen)), search.factor(chosen), together)


def effect_in(trial: CandidateFit, names: Names) -> PlacedEffect:
    """Return the effect of some of a fitted model's causes."""
    acting = tuple(cause for cause in trial.subject.causes if cause.name in names)
    lacking = replace(trial.subject, causes=acting)
    table = dict(zip(trial.subject.table.names, trial.mode, strict=True))
    vector = np.array([table[name] for name in lacking.table.names])
    bare = replace(lacking, causes=())
    neutral = with_neutral(vector[: len(bare.table)], bare, lacking)
    return PlacedEffect(acting, vector, neutral)
