"""How far the emulator is from the held-out curves, and whether it knows."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from emulator_held_out import HeldOut, inputs_of
from numpy.typing import NDArray
from scipy.stats import norm

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate import campaign
from bayesdeg.surrogate.fit import fit_limit
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.regression import reach
from bayesdeg.surrogate.scaling import Place
from bayesdeg.surrogate.solutions import SolutionStore
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


def limits(emulator: Surrogate, runs: Sequence[tuple[Curve, PathSamples]]) -> dict[str, object]:
    """Compare the limit pressure with the reach of those curves whose reach is known."""
    apart, in_errors, within = [], [], 0
    ends = [(curve, reach(curve, samples)) for curve, samples in runs]
    for curve, end in ends:
        if end.load <= 0.0:
            continue
        known = 1e3 * end.load * Place.of(curve.material).modulus
        limit = emulator.limit_pressure(inputs_of(curve, np.array([known])))
        guess, sd = float(limit.pressure.ravel()[0]), float(limit.sd.ravel()[0])
        if end.open:
            # of a curve that is smooth to its end the reach is larger than the last load
            within += bool(guess < known)
        elif np.isfinite(guess):
            apart.append(guess / known - 1.0)
            in_errors.append(abs(guess - known) / sd)
    smooth = sum(end.open for _, end in ends)
    return {
        **_spread(100.0 * np.abs(np.array(apart))),
        "mean_pct": 100.0 * float(np.mean(apart)) if apart else None,
        "coverage_90": float(np.mean(np.array(in_errors) <= HALF_WIDTH)) if apart else None,
        "smooth_curves": smooth,
        "smooth_curves_whose_limit_is_put_within_their_loads": within,
    }


def limits_left_out(emulator: Surrogate, store: SolutionStore) -> dict[str, Any]:
    """Compare with fine curves that end, the limit fitted without their coarse twins.

    The shift between the meshes comes from every second fine curve, and the others are judged.
    """
    wanted = campaign.runs(Geometry(Dimensions()))
    found = [(run, store.get(run)) for run in wanted]
    pairs = [(run, got) for run, got in found if isinstance(got, PathSamples)]
    fine = [(run.curve, s) for run, s in pairs if run.resolution == Recipe().fine_mesh]
    if not fine:
        return {"missing": "fine training runs in the store"}
    twins = {curve for curve, _ in fine}
    others = [reach(run.curve, s) for run, s in pairs if run.curve not in twins]
    known, judged = fine[::2], fine[1::2]
    shift = [reach(curve, samples) for curve, samples in known]
    fitted = replace(emulator, limit=fit_limit(others, shift).terms)
    return limits(fitted, judged) | {
        "what": f"{len(judged)} fine curves of the training design against a limit fitted to "
        f"{len(others)} other curves of the coarse mesh and shifted by {len(known)} of the fine one"
    }
