"""Exact curves about a posterior, and the emulator corrected by them.

At each degradation rate some exact curves are solved, at materials spread over the posterior; the
logarithm of exact over emulated curvature is interpolated between them: Chebyshev polynomials in
the load, linear in softening, stiffening, paper and its thickness.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from emulator_held_out import inputs_of
from forward_case import say
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.stats import norm, qmc

from bayesdeg.actuator.curve import Curve, CurveSolution
from bayesdeg.actuator.forward import relative_to_reference
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.mesh import CONVERGED
from bayesdeg.emulator.campaign import Finished, Run, complete, missing
from bayesdeg.emulator.scaling import GROUPS, LOAD, MATERIAL, Place, groups_of
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.measure.settings import Dimensions

Floats = NDArray[np.float64]

COORDINATES = (*(group.name for group in MATERIAL), "paper_thickness")
LOADS, DEGREE = 14, 5
SPREAD = 1.3  # of the exact curves' materials over that of the posterior
RIDGE = 1e-6


@dataclass(frozen=True)
class Level:
    """One degradation rate: where the posterior is in the groups, and how far loads go.

    Parameters
    ----------
    mean, factor : array, shape (4,) and (4, 4)
        Of ``COORDINATES``: mean, and Cholesky factor of the covariance.
    load : float
        Largest p/M.
    """

    mean: Floats
    factor: Floats
    load: float

    def standardised(self, coordinates: Floats) -> Floats:
        """Return (…, 4) coordinates in units of the posterior's spread."""
        out: Floats = np.linalg.solve(self.factor, (coordinates - self.mean)[..., None])[..., 0]
        return out

    def features(self, load: Floats, coordinates: Floats) -> tuple[Floats, Floats]:
        """Return terms and their derivatives by ln load, (…, n_terms)."""
        u = np.clip(2.0 * load / self.load - 1.0, -1.0, 1.0)
        terms = chebyshev.chebvander(u, DEGREE)
        slopes = chebyshev.chebval(u, chebyshev.chebder(np.eye(DEGREE + 1)))
        slopes = (u + 1.0)[..., None] * np.moveaxis(slopes, 0, -1)
        linear = np.concatenate(
            [np.ones((*coordinates.shape[:-1], 1)), self.standardised(coordinates)], axis=-1
        )
        products = [(part[..., :, None] * linear[..., None, :]) for part in (terms, slopes)]
        values, changes = (p.reshape(*p.shape[:-2], -1) for p in products)
        return values, changes


@dataclass(frozen=True)
class Corrected:
    """The emulator times what exact over emulated curvature is at each specimen's level.

    Parameters
    ----------
    emulator : Surrogate
        Uncorrected.
    levels : tuple of Level
    coefficients : tuple of array
        Of the terms of each level.
    places : array of int, shape (n_specimens,)
        Level of each specimen.
    own_error : bool
        Whether the emulator's error of interpolation is kept in the standard error.
    """

    emulator: Surrogate
    levels: tuple[Level, ...]
    coefficients: tuple[Floats, ...]
    places: NDArray[np.int64]
    own_error: bool = False

    def __call__(self, inputs: Inputs) -> Prediction:
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        plain = self.emulator(inputs)
        shape = plain.curvature.shape
        groups = groups_of(inputs)
        load = np.broadcast_to(groups[LOAD], shape)
        at = np.stack([np.broadcast_to(groups[n], shape) for n in COORDINATES], axis=-1)
        gap, change = np.zeros(shape), np.zeros(shape)
        for k, level in enumerate(self.levels):
            here = self.places == k
            values, slopes = level.features(load[:, here], at[:, here])
            gap[:, here] = values @ self.coefficients[k]
            change[:, here] = slopes @ self.coefficients[k]
        curvature = plain.curvature * np.exp(gap)
        share = plain.sd / plain.curvature if self.own_error else self.emulator.mesh_error
        return replace(
            plain,
            curvature=curvature,
            slope=(plain.slope + plain.curvature * change) * np.exp(gap),
            sd=np.where(plain.curvature > 0.0, share * curvature, plain.sd),
        )


@dataclass(frozen=True)
class Gaps:
    """ln of exact over emulated curvature of the exact curves of one level.

    Parameters
    ----------
    level : Level
    loads, gaps, weights : array, shape (n_curves, n_loads)
        p/M; the gap, 0 with no weight where either has no answer; curvature over the largest.
    coordinates : array, shape (n_curves, 4)
    """

    level: Level
    loads: Floats
    gaps: Floats
    weights: Floats
    coordinates: Floats

    @cached_property
    def matrix(self) -> Floats:
        at = np.broadcast_to(self.coordinates[:, None], (*self.loads.shape, len(COORDINATES)))
        return self.level.features(self.loads, at)[0]

    def fitted(self, chosen: NDArray[np.bool_]) -> Floats:
        """Return the coefficients that some of the curves give."""
        rows = (self.weights[..., None] * self.matrix)[chosen].reshape(-1, self.matrix.shape[-1])
        right = (self.weights * self.gaps)[chosen].ravel()
        found: Floats = np.linalg.solve(
            rows.T @ rows + RIDGE * np.eye(rows.shape[1]), rows.T @ right
        )
        return found

    def left_out(self) -> Floats:
        """Return the weighted errors of every curve predicted from the others."""
        numbers = np.arange(len(self.loads))
        return np.stack(
            [
                self.weights[k] * (self.gaps[k] - self.matrix[k] @ self.fitted(numbers != k))
                for k in numbers
            ]
        )


def exact_gaps(
    levels: Sequence[Level], emulator: Surrogate, store: SolutionStore, *, count: int
) -> tuple[list[Gaps], float]:
    """Solve the exact curves that the store lacks; return the gaps and the core seconds."""
    geometry = Geometry(Dimensions())
    unit = qmc.Sobol(len(COORDINATES), seed=7).random(2 ** int(np.ceil(np.log2(count))))[:count]
    normals = SPREAD * norm.ppf(np.clip(unit, 0.02, 0.98))
    runs, places = [], []
    for level in levels:
        coordinates = level.mean + normals @ level.factor.T
        places.append(coordinates)
        loads = tuple((level.load * np.arange(1, LOADS + 1) / LOADS).tolist())
        for point in coordinates:
            at = {group.name: group.neutral for group in GROUPS}
            at |= dict(zip(COORDINATES, point.tolist(), strict=True))
            material = Place(tuple(at[group.name] for group in GROUPS)).material()
            runs.append(Run(geometry, CONVERGED, Curve(loads, material)))
    left = len(missing(runs, store))
    say(f"{len(runs) - left} of {len(runs)} exact curves stand in the store")

    def show(finished: Finished) -> None:
        say(f"  {finished.solution.status.name} after {finished.seconds:.1f} s")

    solved = complete(runs, store, on_run=show)
    tables = [_gap(run.curve, s, emulator) for run, s in zip(runs, solved, strict=True)]
    gaps = []
    for k, level in enumerate(levels):
        some = tables[k * count : (k + 1) * count]
        loads = np.array([run.curve.loads for run in runs[k * count : (k + 1) * count]])
        gap, weight = (np.stack(part) for part in zip(*some, strict=True))
        gaps.append(Gaps(level, loads, gap, weight, places[k]))
    seconds = store.seconds()
    return gaps, sum(seconds[run.key()] for run in runs)


def _gap(curve: Curve, solution: object, emulator: Surrogate) -> tuple[Floats, Floats]:
    if not isinstance(solution, CurveSolution):
        raise TypeError("a curve was wanted")
    loads = np.array(curve.loads)
    exact = np.full(len(loads), np.nan)
    reached = len(solution.readings)
    # the base model's actuators are straight at rest
    exact[:reached] = solution.bend_angle / solution.arc_length * 1e3
    gap = np.log(exact / emulator(inputs_of(curve, loads)).curvature)
    known = np.isfinite(gap)
    weight = np.where(known, exact / np.nanmax(exact), 0.0)
    return np.where(known, gap, 0.0), np.where(known, np.maximum(weight, 0.15), 0.0)
