"""Does it matter for a posterior that the emulator is not the finite element model?

The posterior of the gelatin study, its base model with the cause that its verdict names, is
sampled with the emulator; its draws are then weighted by what the density becomes with exact
curves of the emulator's own mesh. So many exact curves cannot be solved, one for each draw and
degradation rate. But specimens differ by their degradation rate alone, apart from deviations of
their stiffness, which only rescale load and paper; and at each rate the posterior is narrow. So
what the emulator lacks is fitted to some exact curves with derivatives at each rate
(``emulator_exact``). How well is seen at exact curves left out."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from emulator_exact import COORDINATES, Corrected, Level, exact_gaps, fitted, left_out
from forward_case import say
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.linear import with_neutral
from bayesdeg.emulator.scaling import LOAD, groups_of
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named
from bayesdeg.measure.study import read_study
from bayesdeg.pipeline.assemble import assemble

Floats = NDArray[np.float64]

STUDY = Path("studies/gelatin_actuator")
CAUSE = "pressure_offset"  # which the study's verdict names
PROPOSALS = 6000
NEGLIGIBLE = 1e-4  # weight of a draw, over the mean of all, that is left out
RESAMPLINGS = 400


@dataclass(frozen=True)
class Draws:
    """Weighted draws of the emulated posterior.

    Parameters
    ----------
    model : Model
    vectors : array, shape (n, n_parameters)
        On the unconstrained scale.
    weights : array, shape (n,)
        They sum to 1.
    """

    model: Model
    vectors: Floats
    weights: Floats

    @property
    def effective(self) -> float:
        return float(1.0 / np.sum(self.weights**2))

    def values(self) -> Floats:
        """Return the named values as columns, (n, n_parameters)."""
        named = self.model.table.named(self.vectors)
        return np.stack([named[name] for name in self.model.table.names], axis=-1)


def sampled(emulator: Surrogate, seed: int) -> Draws:
    """Return draws by importance sampling about the mode, which is sought as the pipeline does."""
    base, cause = assemble(read_study(STUDY), emulator).model, find(CAUSE)
    model, generator = base.extended(cause), np.random.default_rng(seed)
    start = with_neutral(approximate(base, generator).mode, base, cause)
    found = evidence(model, approximate(model, generator, start=start), generator, draws=PROPOSALS)
    weights = np.exp(found.log_weights - logsumexp(found.log_weights))
    kept = weights > NEGLIGIBLE / PROPOSALS
    return Draws(model, found.draws[kept], weights[kept] / weights[kept].sum())


def levels_of(model: Model, values: Named, emulator: Surrogate) -> tuple[Level, ...]:
    """Return where the posterior is at each degradation rate, specimens' deviations included."""
    assert model.actuator is not None
    generator = np.random.default_rng(3)
    rates = np.unique(model.actuator.degradation)
    found = []
    for rate in rates:
        c1, c2, c3 = (c[:, 0] for c in model.constants(values, np.array([rate])))
        # ±2 % of the rate's own error stand in the deviations too
        at = np.argmin(np.abs(model.actuator.degradation.ravel() - rate))
        deviation = model.draw_deviation(values, generator)[:, at, 0]
        factor = np.exp(deviation)
        groups = groups_of(
            Inputs(
                pressure=model.actuator.pressure.max() - values[f"{CAUSE}.offset"],
                c1=c1 * factor,
                c2=c2 * factor,
                c3=c3 * factor,
                linear_scale=np.cbrt(values["volume_ratio"]),
                paper_stiffness=values["paper_stiffness"],
            )
        )
        at_draws = np.stack([groups[name] for name in COORDINATES], axis=-1)
        load = min(float(np.quantile(groups[LOAD], 0.98)), emulator.span.load)
        covariance = np.cov(at_draws.T)
        found.append(Level(at_draws.mean(axis=0), np.linalg.cholesky(covariance), load))
    return tuple(found)


@dataclass(frozen=True)
class Shift:
    """What weighting does to the posterior's means, in its standard deviations."""

    by_parameter: Floats
    error: Floats
    effective: float

    @property
    def largest(self) -> float:
        return float(np.max(np.abs(self.by_parameter)))


def shift_of(values: Floats, weights: Floats, log_ratio: Floats) -> Shift:
    """Return the shifts of the means of (n, n_parameters) values, with bootstrap errors."""
    usable = np.where(np.isfinite(log_ratio), log_ratio, -np.inf)
    ratio = np.exp(usable - usable.max())
    mean = weights @ values
    spread = np.sqrt(weights @ (values - mean) ** 2)

    def shift(chosen: NDArray[np.int64]) -> Floats:
        old, x = weights[chosen], values[chosen]
        new = old * ratio[chosen]
        found: Floats = (new @ x / new.sum() - old @ x / old.sum()) / spread
        return found

    count, generator = len(values), np.random.default_rng(5)
    again = [shift(generator.integers(count, size=count)) for _ in range(RESAMPLINGS)]
    new = weights * ratio
    effective = float(new.sum() ** 2 / np.sum(new**2))
    return Shift(shift(np.arange(count)), np.std(again, axis=0), effective)


def posterior_shift(
    emulator: Surrogate, store: SolutionStore, *, exact_draws: int, seed: int = 12
) -> tuple[float, dict[str, object]]:
    """Return the largest shift of a posterior mean and what was done."""
    draws = sampled(emulator, seed)
    model, names = draws.model, draws.model.table.names
    say(f"{len(draws.vectors)} draws, effective number {draws.effective:.0f}")
    equal = np.random.default_rng(4).choice(len(draws.weights), 2000, p=draws.weights)
    levels = levels_of(model, model.table.named(draws.vectors[equal]), emulator)
    gaps, seconds = exact_gaps(levels, emulator, store, count=exact_draws)
    assert model.actuator is not None
    rates = np.unique(model.actuator.degradation)
    places = np.searchsorted(rates, model.actuator.degradation.ravel())
    before = model.log_prob(draws.vectors)

    def shift(*, own_error: bool = False, without: int | None = None) -> Shift:
        fits = tuple(fitted([gap for k, gap in enumerate(some) if k != without]) for some in gaps)
        forward = Corrected(emulator, levels, fits, places, own_error)
        after = replace(model, forward=forward).log_prob(draws.vectors)
        return shift_of(draws.values(), draws.weights, after - before)

    whole = shift()
    missed = np.concatenate([left_out(some) for some in gaps]) if exact_draws > 1 else np.zeros(0)
    largest = int(np.argmax(np.abs(whole.by_parameter)))
    values = np.concatenate([gap.targets[: gap.n_values] for some in gaps for gap in some])
    return whole.largest, {
        "model": f"base model with {CAUSE}, the cause that its verdict names",
        "draws": len(draws.vectors),
        "effective_draws": draws.effective,
        "effective_draws_after_weighting": whole.effective,
        "parameter": names[largest],
        "standard_error": float(whole.error[largest]),
        "shift_by_parameter": dict(zip(names, whole.by_parameter.tolist(), strict=True)),
        "largest_with_the_emulator_s_error_kept": shift(own_error=True).largest,
        "largest_with_one_exact_curve_a_rate_left_out": [
            shift(without=k).largest for k in range(exact_draws if exact_draws > 1 else 0)
        ],
        "degradation_pct": rates.tolist(),
        "largest_loads": [level.load for level in levels],
        "exact_curves": sum(len(some) for some in gaps),
        "exact_core_seconds": seconds,
        "gap_rms_pct": 100.0 * _rms(values),
        "gap_left_out_rms_pct": 100.0 * _rms(missed),
        "gap_left_out_max_pct": 100.0 * float(np.max(np.abs(missed), initial=0.0)),
        "what": "draws by importance sampling about the mode; the log of exact over emulated "
        "curvature, of the emulator's own mesh, is fitted at each degradation rate to exact curves "
        "and their derivatives, linear in the material; the exact model's error is its mesh's",
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
