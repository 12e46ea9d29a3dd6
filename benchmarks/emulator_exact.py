"""Exact curves about a posterior, and the emulator corrected by them.

At each degradation rate some exact curves with their exact derivatives are solved, at materials
spread over the posterior, and one in its middle at many loads; the logarithms of exact over
emulated curvature and bend angle are fitted to values and derivatives, those by the load included,
since a path stops at four loads where it is short: Chebyshev polynomials in the load, linear in
softening, stiffening, paper and its thickness.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from emulator_held_out import inputs_of, show
from fine_library_data import by_load
from forward_case import say
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.stats import norm, qmc

from bayesdeg.actuator.curve import Curve, CurveSolution, PathSamples
from bayesdeg.actuator.inputs import Inputs, Prediction, relative_to_reference
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Resolution
from bayesdeg.surrogate.campaign import complete, missing
from bayesdeg.surrogate.regression import FLOOR, Observed, observe
from bayesdeg.surrogate.scaling import GROUPS, LOAD, MATERIAL, NAMES, Place, groups_of
from bayesdeg.surrogate.solutions import Kind, Run, SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate

Floats = NDArray[np.float64]

COORDINATES = (*(group.name for group in MATERIAL), "paper_thickness")
AXES = [NAMES.index(name) for name in COORDINATES]
LOADS, DEGREE = 14, 10
LINEAR = 3  # degree of what is linear in the material: known where paths stop alone
CROWDED = 1.5  # power by which loads are the denser the smaller they are: an offset is read there
SPREAD = 1.0  # of the exact curves' materials over that of the posterior
DIFFERENCE = 1e-3  # of central differences, in the posterior's spread
RIDGE = 1e-2
"""Squared rounding of paths over what an emulator lacks, 1e-4 over 1e-3. Without it orders between
the few loads where paths stop swing freely: of the gelatin study, with 1e-6 and without readings in
between, by 4 %."""


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
        linear = self.standardised(coordinates)[..., None, :]
        values, changes = (
            np.concatenate(
                [part, (part[..., : LINEAR + 1, None] * linear).reshape(*part.shape[:-1], -1)], -1
            )
            for part in (terms, slopes)
        )
        return values, changes


@dataclass(frozen=True)
class Corrected:
    """The emulator times what exact over emulated readings are at each specimen's level.

    Parameters
    ----------
    emulator : Surrogate
        Uncorrected.
    levels : tuple of Level
    coefficients : tuple of array, shape (n_terms, 2)
        Of the terms of each level, for curvature and bend angle.
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
        gap, change = np.zeros((*shape, 2)), np.zeros((*shape, 2))
        for k, level in enumerate(self.levels):
            here = self.places == k
            values, slopes = level.features(load[:, here], at[:, here])
            gap[:, here] = values @ self.coefficients[k]
            change[:, here] = slopes @ self.coefficients[k]
        curvature, angle = (
            reading * np.exp(gap[..., i])
            for i, reading in enumerate((plain.curvature, plain.bend_angle))
        )
        slope = (plain.slope + plain.curvature * change[..., 0]) * np.exp(gap[..., 0])
        mesh = self.emulator.mesh_error
        sds = (
            (plain.sd * np.exp(gap[..., 0]), plain.bend_angle_sd * np.exp(gap[..., 1]))
            if self.own_error
            else (mesh * np.abs(curvature), mesh * np.abs(angle))
        )
        return replace(
            plain,
            curvature=curvature,
            bend_angle=angle,
            slope=slope,
            sd=sds[0],
            bend_angle_sd=sds[1],
        )


@dataclass(frozen=True)
class Gap:
    """ln of exact over emulated readings along one exact curve, as weighted equations.

    Parameters
    ----------
    matrix : array, shape (n_rows, n_terms)
    targets : array, shape (n_rows, 2)
        The gaps of curvature and bend angle, then their derivatives by the standardised
        coordinates.
    n_values : int
        Rows of the gap itself, weighted by curvature over the curve's largest.
    """

    matrix: Floats
    targets: Floats
    n_values: int


def fitted(gaps: Sequence[Gap]) -> Floats:
    """Return the coefficients that curves of one level give, (n_terms, 2)."""
    rows, right = np.vstack([g.matrix for g in gaps]), np.vstack([g.targets for g in gaps])
    normal = rows.T @ rows + RIDGE * np.eye(rows.shape[1])
    found: Floats = np.linalg.solve(normal, rows.T @ right)
    return found


def left_out(gaps: Sequence[Gap]) -> Floats:
    """Return the weighted errors of every curve of a level predicted from the others, (n, 2)."""
    errors = []
    for k, gap in enumerate(gaps):
        rest = fitted([*gaps[:k], *gaps[k + 1 :]])
        errors.append((gap.targets - gap.matrix @ rest)[: gap.n_values])
    return np.vstack(errors)


def _runs(levels: Sequence[Level], count: int, geometry: Moulded, mesh: Resolution) -> list[Run]:
    # the first of more curves are those of fewer
    sampler = qmc.Sobol(len(COORDINATES), rng=np.random.default_rng(7))
    unit = sampler.random(2 ** int(np.ceil(np.log2(count))))[:count]
    normals = SPREAD * norm.ppf(unit)
    runs = [
        Run(geometry, mesh, _curve(level, point), Kind.SAMPLES)
        for level in levels
        for point in level.mean + normals @ level.factor.T
    ]
    # paths stop where they like; along the load the curve in the middle is read where it matters
    runs += [
        Run(geometry, mesh, _curve(level, level.mean, CROWDED), Kind.CURVE) for level in levels
    ]
    return runs


def exact_paths(
    levels: Sequence[Level],
    store: SolutionStore,
    *,
    count: int,
    geometry: Moulded,
    mesh: Resolution,
) -> tuple[list[Curve], list[PathSamples]]:
    """Return the curves with derivatives by the material that ``exact_gaps`` solved."""
    found = [(run.curve, store.get(run)) for run in _runs(levels, count, geometry, mesh)]
    pairs = [(curve, path) for curve, path in found if isinstance(path, PathSamples)]
    return [curve for curve, _ in pairs], [path for _, path in pairs]


def exact_gaps(
    levels: Sequence[Level],
    emulator: Surrogate,
    store: SolutionStore,
    *,
    count: int,
    geometry: Moulded,
    mesh: Resolution,
    executor: Executor | None = None,
) -> tuple[list[list[Gap]], float]:
    """Solve the exact curves that the store lacks; return gaps by level, and core seconds."""
    runs = _runs(levels, count, geometry, mesh)
    left = len(missing(runs, store))
    say(f"{len(runs) - left} of {len(runs)} exact curves stand in the store")

    solved = complete(runs, store, executor=executor, on_run=show)
    gaps: list[list[Gap]] = [[] for _ in levels]
    for k, (run, found) in enumerate(zip(runs, solved, strict=True)):
        is_path = isinstance(found, PathSamples)
        samples = found if isinstance(found, PathSamples) else path_of(run.curve, found)
        length = geometry.dimensions.length
        seen = observe(run.curve, samples, length=length, compliance=emulator.compliance)
        if seen is not None:
            seen = by_load(seen, Place.of(run.curve.material))
            at = k // count if is_path else k - len(levels) * count
            gap = _gap(levels[at], seen, run.curve, emulator, by_material=is_path)
            gaps[at].append(gap)
    seconds = store.seconds()
    return gaps, sum(seconds[run.key()] for run in runs)


def path_of(curve: Curve, solution: CurveSolution) -> PathSamples:
    """Return a curve with its derivatives by the load alone."""
    readings = np.vstack([solution.rest, solution.readings])
    gradients = np.zeros((*readings.shape, len(INPUTS)))
    gradients[:, :, 0] = np.vstack([solution.rest_rates, solution.rates])
    loads = np.array([0.0, *curve.loads[: len(solution.readings)]])
    end = (solution.status, solution.limit_load, solution.iterations, solution.solver)
    return PathSamples(loads, readings, gradients, *end)


def _curve(level: Level, coordinates: Floats, power: float = 1.0) -> Curve:
    shares = (np.arange(1, LOADS + 1) / LOADS) ** (power - 1.0)
    loads = level.load * np.arange(1, LOADS + 1) / LOADS * shares
    return Curve(tuple(loads.tolist()), _place(coordinates).material())


def _place(coordinates: Floats) -> Place:
    at = {group.name: group.neutral for group in GROUPS}
    at |= dict(zip(COORDINATES, coordinates.tolist(), strict=True))
    return Place(tuple(at[group.name] for group in GROUPS))


def _gap(
    level: Level, seen: Observed, curve: Curve, emulator: Surrogate, *, by_material: bool
) -> Gap:
    place = Place.of(curve.material)
    groups = dict(zip((group.name for group in GROUPS), place.values, strict=True))
    here = np.array([groups[name] for name in COORDINATES])
    value = _emulated(emulator, seen.load, here)
    known = np.isfinite(value).all(axis=-1)
    load, weight = seen.load[known], seen.weights[known]
    terms, _ = level.features(load, np.broadcast_to(here, (len(load), len(here))))
    rows = [weight[:, None] * terms]
    targets = [weight[:, None] * (seen.values[known, :2] - value[known])]
    for row, target in (
        _along_load(level, seen, known, here, emulator),
        _at_rest(level, seen, here, emulator),
    ):
        rows.append(row)
        targets.append(target)
    for k in range(len(COORDINATES)) if by_material else ():
        # the direction in which only the k-th standardised coordinate changes
        step = DIFFERENCE * level.factor[:, k]
        by = (_emulated(emulator, load, here + step) - _emulated(emulator, load, here - step)) / (
            2.0 * DIFFERENCE
        )
        exact = seen.gradients[known, :2][..., AXES] @ level.factor[:, k]
        smooth = np.isfinite(by).all(axis=-1)
        ahead = level.features(load, np.broadcast_to(here + step, (len(load), len(here))))[0]
        rows.append((weight[:, None] * (ahead - terms) / DIFFERENCE)[smooth])
        targets.append((weight[:, None] * (exact - by))[smooth])
    return Gap(np.vstack(rows), np.vstack(targets), len(load))


def _along_load(
    level: Level, seen: Observed, known: NDArray[np.bool_], here: Floats, emulator: Surrogate
) -> tuple[Floats, Floats]:
    """Return the equations of derivatives by ln load: a path stops at few loads."""
    load, weight = seen.load[known], seen.weights[known, None]
    _, slopes = level.features(load, np.broadcast_to(here, (len(load), len(here))))
    forth, back = (_emulated(emulator, load * (1.0 + s), here) for s in (DIFFERENCE, -DIFFERENCE))
    by = (forth - back) / (2.0 * DIFFERENCE)
    exact = seen.gradients[known, :2, 0] * load[:, None]
    smooth = np.isfinite(by).all(axis=-1)
    return (weight * slopes)[smooth], (weight * (exact - by))[smooth]


def _at_rest(
    level: Level, seen: Observed, here: Floats, emulator: Surrogate
) -> tuple[Floats, Floats]:
    """Return the equation of the first slope of a curve; it counts as the smallest reading does."""
    load = np.array([DIFFERENCE * level.load])
    terms, _ = level.features(load, here[None])
    gap = seen.first[None, :2] - _emulated(emulator, load, here)
    known = np.isfinite(gap).all(axis=-1)
    return FLOOR * terms[known], FLOOR * gap[known]


def _emulated(emulator: Surrogate, load: Floats, coordinates: Floats) -> Floats:
    """Return ln(κ s L/q) and ln(bend angle/q) of the emulator, (n, 2), nan where it refuses."""
    material = _place(coordinates).material()
    seen = emulator(inputs_of(Curve(tuple(load.tolist()), material), load))
    relative = (seen.curvature * 1e-3 * emulator.length, np.radians(seen.bend_angle))
    found: Floats = np.log(np.stack(relative, axis=-1) / load[:, None])
    return found
