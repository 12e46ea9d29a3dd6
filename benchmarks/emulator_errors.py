"""How far the emulator is from the held-out curves, and whether it knows."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from emulator_held_out import HeldOut, inputs_of
from numpy.typing import NDArray
from scipy.stats import norm

from bayesdeg.actuator.curve import Curve
from bayesdeg.surrogate.surrogate import OUTPUTS, Surrogate

Floats = NDArray[np.float64]

HALF_WIDTH = float(norm.ppf(0.95))  # of a 90 % interval, in standard errors


@dataclass(frozen=True)
class Compared:
    """One held-out curve beside the emulator's.

    Parameters
    ----------
    causes : int
        At work.
    truth, predicted, error, total_error : array, shape (3, n)
        Fine mesh, emulator, its standard error of interpolation and that with the mesh's error;
        nan where it refuses.
    refusals : tuple of str
        Why, by the names of the groups.
    """

    causes: int
    truth: Floats
    predicted: Floats
    error: Floats
    total_error: Floats
    refusals: tuple[str, ...]

    @property
    def largest_pct(self) -> Floats:
        """Largest error of each output over the curve's largest value [%]; nan if all refused."""
        size = np.max(np.abs(self.truth), axis=1, keepdims=True)
        apart = np.abs(self.predicted - self.truth) / size
        known = np.isfinite(apart)
        worst = np.max(np.where(known, apart, 0.0), axis=1)
        return np.where(known.any(axis=1), 100.0 * worst, np.nan)


def compare(emulator: Surrogate, curves: Sequence[HeldOut]) -> list[Compared]:
    bare, found = emulator.without_mesh_error(), []
    for held in curves:
        if not len(held.solution.readings):
            continue
        inputs = held.inputs
        own, whole = bare(inputs), emulator(inputs)
        found.append(
            Compared(
                held.causes,
                held.truth,
                np.stack([own.curvature, own.bend_angle, own.peak_stretch - 1.0]),
                np.stack([own.sd, own.bend_angle_sd, own.peak_stretch_sd]),
                np.stack([whole.sd, whole.bend_angle_sd, whole.peak_stretch_sd]),
                tuple(emulator.refusals(inputs)),
            )
        )
    return found


def errors(pairs: Sequence[Compared]) -> dict[str, dict[str, float]]:
    """Return 95th percentile and largest error over curves by output [%]."""
    worst = np.array([pair.largest_pct for pair in pairs])
    return {name: _spread(column) for name, column in zip(OUTPUTS, worst.T, strict=True)}


def _spread(values: Floats) -> dict[str, float]:
    known = values[np.isfinite(values)]
    if not len(known):
        return {"curves": 0}
    return {
        "p95_pct": float(np.quantile(known, 0.95)),
        "max_pct": float(np.max(known)),
        "median_pct": float(np.median(known)),
        "curves": len(known),
    }


def by_causes(pairs: Sequence[Compared]) -> dict[str, dict[str, dict[str, float]]]:
    words = ("none", "one", "two")
    kinds = {word: [pair for pair in pairs if pair.causes == n] for n, word in enumerate(words)}
    return {word: errors(some) for word, some in kinds.items() if some}


def coverage(pairs: Sequence[Compared], *, with_mesh_error: bool = False) -> dict[str, float]:
    """Return the share of values inside the emulator's own 90 % interval, by output."""
    found = {}
    for k, name in enumerate(OUTPUTS):
        ratios = [
            np.abs(pair.predicted[k] - pair.truth[k])
            / (pair.total_error if with_mesh_error else pair.error)[k]
            for pair in pairs
        ]
        known = np.concatenate(ratios)
        known = known[np.isfinite(known)]
        found[name] = float(np.mean(known <= HALF_WIDTH))
    return found


def refusals(pairs: Sequence[Compared], curves: Sequence[HeldOut]) -> dict[str, object]:
    """Count the values that the emulator refuses; and those that the fine mesh does not reach."""
    refused = [int(np.sum(~np.isfinite(pair.predicted[0]))) for pair in pairs]
    reasons = Counter(reason for pair in pairs for reason in pair.refusals)
    return {
        "values": sum(refused),
        "of_values": sum(pair.truth.shape[1] for pair in pairs),
        "curves": sum(count > 0 for count in refused),
        "curves_by_reason": dict(reasons),
        "values_not_reached_by_finite_elements": sum(
            len(held.curve.loads) - len(held.solution.readings) for held in curves
        ),
        "curves_by_status": dict(Counter(held.solution.status.name for held in curves)),
    }


def limits(emulator: Surrogate, runs: Sequence[tuple[Curve, float]]) -> dict[str, object]:
    """Compare the limit pressure with the limit load of curves, inf where they end smoothly."""
    apart, in_errors, within = [], [], 0
    for curve, known in runs:
        last = 1e3 * min(known, curve.loads[-1])
        limit = emulator.limit_pressure(inputs_of(curve, np.array([last])))
        guess, sd = limit.pressure.item(), limit.sd.item()
        if not np.isfinite(known):
            within += bool(guess < last)
        elif np.isfinite(guess):
            apart.append(guess / last - 1.0)
            in_errors.append(abs(guess - last) / sd)
    return {
        **_spread(100.0 * np.abs(np.array(apart))),
        "mean_pct": 100.0 * float(np.mean(apart)) if apart else None,
        "coverage_90": float(np.mean(np.array(in_errors) <= HALF_WIDTH)) if apart else None,
        "smooth_curves": sum(not np.isfinite(known) for _, known in runs),
        "smooth_curves_whose_limit_is_put_within_their_loads": within,
    }
