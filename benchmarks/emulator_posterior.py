"""Does it matter for a posterior that the emulator is not the finite element model?

The posterior of the gelatin study, its base model with the cause that its verdict names, is
sampled with the emulator; its draws are then weighted by what the density becomes with exact
curves of the emulator's own mesh. So many exact curves cannot be solved, one for each draw and
degradation rate. But specimens differ by their degradation rate alone, apart from deviations of
their stiffness, which only rescale load and paper; and at each rate the posterior is narrow. So
what the emulator lacks is fitted to some exact curves with derivatives at each rate
(``emulator_exact``). How well is seen at exact curves left out.

What the emulator may be wrong by is a part of its posterior: an error common to all curves, whose
parameters say nothing of an exact map, whose own error is that of its mesh. So densities of all
other parameters are compared, the common error being integrated out of both."""

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from emulator_exact import (
    COORDINATES,
    Corrected,
    Level,
    exact_gaps,
    exact_paths,
    fitted,
    left_out,
)
from forward_case import say
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import ForwardMap, Inputs
from bayesdeg.actuator.status import CONVERGED, Resolution
from bayesdeg.analysis.region import asked_of
from bayesdeg.assembly.reach import assemble_within_reach
from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.fit.linear import with_neutral
from bayesdeg.data.study import Study, read_study
from bayesdeg.inference.importance import improved
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import Curvature
from bayesdeg.priors import Named
from bayesdeg.surrogate.refinement import refine
from bayesdeg.surrogate.scaling import LOAD, groups_of
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate

Floats = NDArray[np.float64]

STUDY = Path("studies/gelatin_actuator")
CAUSE = "pressure_offset"  # which the study's verdict names
PROPOSALS, EFFECTIVE = 6000, 1500.0
NEGLIGIBLE = 1e-4  # weight of a draw, over the mean of all, that is left out
RESAMPLINGS = 400
COMMON_ERROR = "emulator_error_"
STAGES, STEP = 2, 0.3  # of the integral over the common error, its unit the prior's sd
BATCH = 300  # draws at a time


@dataclass(frozen=True)
class Draws:
    """Weighted draws of the emulated posterior.

    Parameters
    ----------
    model : JointModel
    vectors : array, shape (n, n_parameters)
        On the unconstrained scale.
    weights : array, shape (n,)
        They sum to 1.
    """

    model: JointModel
    vectors: Floats
    weights: Floats

    @property
    def effective(self) -> float:
        return float(1.0 / np.sum(self.weights**2))

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters but those of the emulator's common error."""
        return tuple(n for n in self.model.table.names if not n.startswith(COMMON_ERROR))

    def values(self) -> Floats:
        """Return the named values as columns, (n, n_names)."""
        named = self.model.table.named(self.vectors)
        return np.stack([named[name] for name in self.names], axis=-1)


def sampled(study: Study, emulator: Surrogate, seed: int) -> Draws:
    """Return draws by importance sampling, as the pipeline does."""
    base, cause = assemble_within_reach(study, emulator).model, find(CAUSE)
    model, generator = base.extended(cause), np.random.default_rng(seed)
    start = with_neutral(approximate(base, generator).mode, base, model)
    rough = evidence(model, approximate(model, generator, start=start), generator, draws=PROPOSALS)
    found = improved(model, rough, generator, enough=EFFECTIVE)
    weights = np.exp(found.log_weights - logsumexp(found.log_weights))
    kept = weights > NEGLIGIBLE / len(weights)
    return Draws(model, found.draws[kept], weights[kept] / weights[kept].sum())


def _levels(draws: Draws) -> tuple[Level, ...]:
    """Return where weighted draws are at each degradation rate."""
    model = draws.model
    equal = np.random.default_rng(4).choice(len(draws.weights), 2000, p=draws.weights)
    assert isinstance(model.world.forward, Surrogate)
    return levels_of(model, model.table.named(draws.vectors[equal]), model.world.forward)


def levels_of(model: JointModel, values: Named, emulator: Surrogate) -> tuple[Level, ...]:
    """Return where the posterior is at each degradation rate, specimens' deviations included."""
    generator = np.random.default_rng(3)
    rates = np.unique(model.data_of(Curvature).tests.degradation)
    found = []
    for rate in rates:
        c1, c2, c3 = model.world.constants(values, np.array([rate]))[:, 0].T
        # ±2 % of the rate's own error stand in the deviations too
        at = np.argmin(np.abs(model.data_of(Curvature).tests.degradation.ravel() - rate))
        deviation = model.data_of(Curvature).drawn_deviations(model.tests(values), generator)[
            :, at, 0
        ]
        factor = np.exp(deviation)
        groups = groups_of(
            Inputs(
                pressure=model.data_of(Curvature).tests.pressure.max() - values[f"{CAUSE}.offset"],
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


def log_marginal(model: JointModel, vectors: Floats) -> Floats:
    """Return the log posterior density of all parameters but the emulator's common error, (n,).

    Readings are linear in the common error, and its law is normal, so that ln p is nearly a
    quadratic of it: about its top, found by Newton's method, the integral is in closed form.
    """
    parts = [vectors[i : i + BATCH] for i in range(0, len(vectors), BATCH)]
    return np.concatenate([_log_marginal(model, part) for part in parts])


def _log_marginal(model: JointModel, vectors: Floats) -> Floats:
    columns = [i for i, n in enumerate(model.table.names) if n.startswith(COMMON_ERROR)]
    at, size = vectors.copy(), len(columns)
    at[:, columns] = 0.0
    for stage in range(STAGES):
        value, slope, precision = _quadratic(model, at, columns)
        step = np.linalg.solve(precision, slope[..., None])[..., 0]
        if stage + 1 < STAGES:
            at[:, columns] += step
    gain = 0.5 * np.sum(slope * step, axis=-1) - 0.5 * np.linalg.slogdet(precision)[1]
    total: Floats = value + gain + 0.5 * size * np.log(2.0 * np.pi)
    return np.where(np.isfinite(total), total, -np.inf)


def _quadratic(model: JointModel, at: Floats, columns: list[int]) -> tuple[Floats, Floats, Floats]:
    """Return ln p, its gradient and its negative Hessian by some parameters."""
    size = len(columns)
    axes = STEP * np.eye(size)
    pairs = [(i, j) for i in range(size) for j in range(i)]
    both = np.reshape([axes[i] + axes[j] for i, j in pairs], (-1, size))
    moves = np.zeros((1 + 2 * size + 2 * len(pairs), at.shape[1]))
    moves[:, columns] = np.vstack([np.zeros(size), axes, -axes, both, -both])
    points = (at[:, None, :] + moves).reshape(-1, at.shape[1])
    density = model.log_prob(points).reshape(len(at), -1)
    possible = np.isfinite(density).all(axis=1)
    density = np.where(possible[:, None], density, 0.0)
    here, rest = density[:, 0], density[:, 1:]
    forth, back = rest[:, :size], rest[:, size : 2 * size]
    apart = (forth + back - 2.0 * here[:, None]) / STEP**2
    hessian = apart[:, :, None] * np.eye(size)
    for k, (i, j) in enumerate(pairs):
        ahead, behind = rest[:, 2 * size + k], rest[:, 2 * size + len(pairs) + k]
        mixed = 0.5 * ((ahead + behind - 2.0 * here) / STEP**2 - apart[:, i] - apart[:, j])
        hessian[:, i, j] = hessian[:, j, i] = mixed
    precision = np.where(possible[:, None, None], -hessian, np.eye(size))
    return np.where(possible, here, -np.inf), (forth - back) / (2.0 * STEP), precision


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


def smooth_shift(
    draws: Draws, ground: Surrogate, paths: tuple[list[Curve], list[PathSamples]], study: Study
) -> dict[str, Any]:
    """Return the shift by an exact map that is one smooth correction of ``ground`` over all rates.

    Maps of single rates are linear in the material, and draws lie up to three of their standard
    deviations away, where two curves say little: parameters that readings hardly tell move by 0.1
    to 0.2 sd with the degree of their polynomials. One correction over all rates has more to go
    by, and says by the jackknife how well it is known.
    """
    reference = refine(ground, *paths, asked_of(study, study.settings.seed))

    def moved(one: ForwardMap, other: ForwardMap) -> Floats:
        first, second = (
            draws.model.with_world(forward=m).log_prob(draws.vectors) for m in (one, other)
        )
        change = np.where(np.isfinite(second - first), second - first, 0.0)
        values, weights = draws.values(), draws.weights
        centred = values - weights @ values
        sd = np.sqrt(weights @ centred**2)
        found: Floats = (weights * (change - weights @ change)) @ centred / sd
        return found

    found = moved(draws.model.world.forward, reference.surrogate)
    without = np.array([moved(reference.surrogate, one) for one in reference.without])
    count, largest = len(without), int(np.argmax(np.abs(found)))
    error = np.sqrt((count - 1) / count * np.sum(without**2, axis=0))
    return {
        "largest": float(np.abs(found[largest])),
        "parameter": draws.names[largest],
        "standard_error": float(error[largest]),
        "largest_standard_error": float(error.max()),
        "by_parameter": dict(zip(draws.names, found.tolist(), strict=True)),
    }


def posterior_shift(
    emulator: Surrogate,
    store: SolutionStore,
    *,
    exact_draws: int,
    seed: int = 12,
    study: Study | None = None,
    mesh: Resolution = CONVERGED,
    executor: Executor | None = None,
    located_by: Surrogate | None = None,
) -> tuple[float, dict[str, Any]]:
    """Return the largest shift of a posterior mean and what was done.

    Of the gelatin study, unless another is given, in which ``CAUSE`` is at work and whose
    emulator stands for ``mesh``. Exact curves lie about the posterior by ``located_by``, by default
    that of the emulator: several emulators of an actuator are then judged by the same curves.
    """
    study = study or read_study(STUDY)
    draws = sampled(study, emulator, seed)
    model, names = draws.model, draws.names
    say(f"{len(draws.vectors)} draws, effective number {draws.effective:.0f}")
    levels = _levels(draws if located_by is None else sampled(study, located_by, seed))
    gaps, seconds = exact_gaps(
        levels,
        emulator,
        store,
        count=exact_draws,
        geometry=geometry_of_study(study.settings),
        mesh=mesh,
        executor=executor,
    )
    rates = np.unique(model.data_of(Curvature).tests.degradation)
    places = np.searchsorted(rates, model.data_of(Curvature).tests.degradation.ravel())
    before = log_marginal(model, draws.vectors)

    def shift(*, own_error: bool = False, without: int | None = None) -> Shift:
        fits = tuple(fitted([gap for k, gap in enumerate(some) if k != without]) for some in gaps)
        forward = Corrected(emulator, levels, fits, places, own_error)
        after = log_marginal(model.with_world(forward=forward), draws.vectors)
        return shift_of(draws.values(), draws.weights, after - before)

    paths = exact_paths(
        levels, store, count=exact_draws, geometry=geometry_of_study(study.settings), mesh=mesh
    )
    smooth = smooth_shift(draws, located_by or emulator, paths, study)
    say(f"by one smooth correction: {smooth['largest']:.3f} sd of {smooth['parameter']}")
    whole = shift()
    missed = np.vstack([left_out(some) for some in gaps]) if exact_draws > 1 else np.zeros((0, 2))
    largest = int(np.argmax(np.abs(whole.by_parameter)))
    values = np.vstack([gap.targets[: gap.n_values] for some in gaps for gap in some])
    return whole.largest, {
        "model": f"base model with {CAUSE}, the cause that its verdict names",
        "draws": len(draws.vectors),
        "effective_draws": draws.effective,
        "effective_draws_after_weighting": whole.effective,
        "parameter": names[largest],
        "standard_error": float(whole.error[largest]),
        "by_one_smooth_correction": smooth,
        "shift_by_parameter": dict(zip(names, whole.by_parameter.tolist(), strict=True)),
        "largest_with_the_emulator_s_error_kept": shift(own_error=True).largest,
        "largest_with_one_exact_curve_a_rate_left_out": [
            shift(without=k).largest for k in range(exact_draws if exact_draws > 1 else 0)
        ],
        "degradation_pct": rates.tolist(),
        "largest_loads": [level.load for level in levels],
        "exact_curves": sum(len(some) for some in gaps),
        "exact_core_seconds": seconds,
        "gap_rms_pct": 100.0 * _rms(values[:, 0]),
        "gap_left_out_rms_pct": 100.0 * _rms(missed[:, 0]),
        "gap_left_out_max_pct": 100.0 * float(np.max(np.abs(missed[:, 0]), initial=0.0)),
        "bend_angle_gap_rms_pct": 100.0 * _rms(values[:, 1]),
        "bend_angle_gap_left_out_rms_pct": 100.0 * _rms(missed[:, 1]),
        "what": "draws by importance sampling; the log of exact over emulated "
        "readings, of the emulator's own mesh, is fitted at each degradation rate to exact curves "
        "and their derivatives, linear in the material; the exact model's error is its mesh's; the "
        "error common to all curves is integrated out of both densities",
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
