"""Does it matter for a posterior that the emulator is not the finite element model?

The posterior of the gelatin study, its base model with the study's hidden cause, is sampled with
the emulator; its draws are then weighted by what the density becomes with exact curves of the
emulator's own mesh. So many exact curves cannot be solved, one for each draw and degradation rate.
But specimens differ by their degradation rate alone, apart from deviations of their stiffness,
which only rescale load and paper; and at each rate the posterior is narrow. So what the emulator
lacks is interpolated between some exact curves at each rate (``emulator_exact``). How well is seen
at exact curves left out.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from emulator_exact import COORDINATES, Corrected, Level, exact_gaps
from forward_case import say
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.catalogue import find
from bayesdeg.emulator.scaling import LOAD, groups_of
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.ensemble import EFFORTS, sample
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named
from bayesdeg.measure.study import read_study
from bayesdeg.pipeline.assemble import assemble

Floats = NDArray[np.float64]

STUDY = Path("studies/gelatin_actuator")
CAUSE = "pressure_offset"  # the study's hidden one
RESAMPLINGS = 400


def sampled(emulator: Surrogate, seed: int) -> tuple[Model, Floats, dict[str, object]]:
    """Return the model, posterior draws, and what sampling came to."""
    model = assemble(read_study(STUDY), emulator).model.extended(find(CAUSE))
    seeds = np.random.SeedSequence(seed).spawn(2)
    generator = np.random.default_rng(seeds[0])
    laplace = approximate(model, generator)
    start = evidence(model, laplace, generator)

    def show(done: int, smallest: float, largest: float) -> None:
        say(f"  {done} steps: {smallest:.0f} effective draws, R-hat {largest:.3f}")

    effort = EFFORTS["quick"]
    chain = sample(model, start, effort=effort, seed=seeds[1], on_chunk=show)
    draws = chain.thinned(effort.kept).vectors.reshape(-1, len(model.table))
    return (
        model,
        draws,
        {
            "steps": chain.vectors.shape[1],
            "smallest_effective_size": float(np.min(chain.effective())),
            "largest_r_hat": float(np.max(chain.r_hat())),
            "refused_share": chain.refusals.share,
        },
    )


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
        offset = np.minimum(values[f"{CAUSE}.offset"], 0.0)
        groups = groups_of(
            Inputs(
                pressure=model.actuator.pressure.max() - offset,
                c1=c1 * factor,
                c2=c2 * factor,
                c3=c3 * factor,
                linear_scale=np.cbrt(values["volume_ratio"]),
                paper_stiffness=values["paper_stiffness"],
            )
        )
        at_draws = np.stack([groups[name] for name in COORDINATES], axis=-1)
        load = min(float(np.quantile(groups[LOAD], 0.995)), emulator.span.load)
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


def shift_of(values: Floats, log_weights: Floats) -> Shift:
    """Return the shifts of the means of (n, n_parameters) values, with bootstrap errors."""
    usable = np.where(np.isfinite(log_weights), log_weights, -np.inf)
    weights = np.exp(usable - usable.max())
    spread = values.std(axis=0)

    def means(chosen: NDArray[np.int64]) -> Floats:
        share = weights[chosen] / weights[chosen].sum()
        shift: Floats = (share @ values[chosen] - values[chosen].mean(axis=0)) / spread
        return shift

    count, generator = len(values), np.random.default_rng(5)
    again = [means(generator.integers(count, size=count)) for _ in range(RESAMPLINGS)]
    effective = float(weights.sum() ** 2 / np.sum(weights**2))
    return Shift(means(np.arange(count)), np.std(again, axis=0), effective)


def posterior_shift(
    emulator: Surrogate, store: SolutionStore, *, exact_draws: int, seed: int = 11
) -> tuple[float, dict[str, object]]:
    """Return the largest shift of a posterior mean and what was done."""
    model, draws, facts = sampled(emulator, seed)
    values = model.table.named(draws)
    levels = levels_of(model, values, emulator)
    gaps, seconds = exact_gaps(levels, emulator, store, count=exact_draws)
    assert model.actuator is not None
    rates = np.unique(model.actuator.degradation)
    places = np.searchsorted(rates, model.actuator.degradation.ravel())
    columns = np.stack([values[name] for name in model.table.names], axis=-1)
    before = model.log_prob(draws)

    def shift(chosen: NDArray[np.bool_], own_error: bool = False) -> Shift:
        fits = tuple(gap.fitted(chosen) for gap in gaps)
        forward = Corrected(emulator, levels, fits, places, own_error)
        return shift_of(columns, replace(model, forward=forward).log_prob(draws) - before)

    every, numbers = np.ones(exact_draws, dtype=bool), np.arange(exact_draws)
    whole, kept = shift(every), shift(every, own_error=True)
    left_out = np.concatenate([gap.left_out().ravel() for gap in gaps])
    largest = int(np.argmax(np.abs(whole.by_parameter)))
    return whole.largest, facts | {
        "model": f"base model with {CAUSE}, the study's hidden cause; quick effort",
        "draws": len(draws),
        "effective_draws_after_weighting": whole.effective,
        "parameter": model.table.names[largest],
        "standard_error": float(whole.error[largest]),
        "shift_by_parameter": dict(
            zip(model.table.names, whole.by_parameter.tolist(), strict=True)
        ),
        "largest_with_the_emulator_s_error_kept": kept.largest,
        "largest_with_half_of_the_exact_curves": [shift(numbers % 2 == k).largest for k in (0, 1)]
        if exact_draws >= 12
        else None,
        "exact_curves": len(levels) * exact_draws,
        "exact_core_seconds": seconds,
        "gap_rms_pct": 100.0 * _rms(np.concatenate([(g.weights * g.gaps).ravel() for g in gaps])),
        "gap_left_out_rms_pct": 100.0 * _rms(left_out),
        "gap_left_out_max_pct": 100.0 * float(np.max(np.abs(left_out))),
        "largest_loads": [level.load for level in levels],
        "what": "log of exact over emulated curvature, of the emulator's own mesh, interpolated "
        "at each degradation rate between exact curves at materials spread over the posterior; "
        "the exact model's error is that of its mesh alone",
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
