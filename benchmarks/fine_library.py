"""A second surrogate, for studies by the dozen: a Gaussian process over curves of a finer mesh.

Finer mesh (4616 instead of 2042 elements), another design and another family than the emulator
that inference uses, so that data made with it are no inverse crime. Run as a script it solves the
curves (about 25 minutes on 2 cores, resumable), and prints its own error, by leaving out whole
curves, and the emulator's deviation from it.

    uv run python benchmarks/fine_library.py --json
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from emulator_held_out import path_of
from numpy.typing import NDArray
from scipy.stats import qmc
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from bayesdeg.actuator.curve import Curve, CurveSolution
from bayesdeg.actuator.forward import relative_to_reference
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.mesh import FINE
from bayesdeg.actuator.status import Status
from bayesdeg.console import pool
from bayesdeg.emulator.campaign import Run, complete
from bayesdeg.emulator.design import LOAD_SHARES
from bayesdeg.emulator.observations import reach
from bayesdeg.emulator.scaling import GROUPS, LOAD, MATERIAL, Place, groups_of
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.trained import default_surrogate
from bayesdeg.measure.settings import Dimensions

Floats = NDArray[np.float64]

# narrower than the emulator's: softening, ln stiffening and ln paper as studies draw them
LOWER = np.array([-0.35, np.log(0.002), np.log(8.0)])
UPPER = np.array([0.2, np.log(0.2), np.log(300.0)])
LARGEST_LOAD, LENGTH = 0.96, 50.0
CURVES, SEED = 32, 7
STORE = Path(".cache/fine_library")


@dataclass(frozen=True)
class Table:
    """Points of solved curves as far as those are smooth.

    Parameters
    ----------
    points : array, shape (n, 4)
        Load and groups on [−1, 1].
    load : array, shape (n,)
        p/C1 [–].
    values : array, shape (n, 3)
        ln(κ s L/q), ln((λ − 1)/q) and the stretch of the bottom line less 1 over q.
    curve : array of int, shape (n,)
        To which curve a point belongs.
    """

    points: Floats
    load: Floats
    values: Floats
    curve: NDArray[np.int64]


def unit(groups: Floats) -> Floats:
    """Map (…, 3) groups from their ranges to [−1, 1]."""
    return (2.0 * groups - (LOWER + UPPER)) / (UPPER - LOWER)


def largest_load(unit_stiffening: Floats) -> Floats:
    """Return the largest p/C1: stiff material is not taken as far as soft."""
    return np.interp(unit_stiffening, [0.1, 1.0], [LARGEST_LOAD, 0.35])


def design() -> list[Curve]:
    """Return curves over a scrambled Sobol' design of the base model's groups."""
    points = qmc.Sobol(3, rng=np.random.default_rng(SEED)).random(CURVES)
    curves = []
    for point, load in zip(points, largest_load(2.0 * points[:, 1] - 1.0), strict=True):
        base = dict(zip((g.name for g in MATERIAL), LOWER + (UPPER - LOWER) * point, strict=True))
        values = tuple(float(base.get(g.name, g.neutral)) for g in GROUPS)
        loads = tuple(float(load * share) for share in LOAD_SHARES)
        curves.append(Curve(loads, Place(values).material()))
    return curves


def library(store: Path, workers: int) -> Table:
    geometry = Geometry(Dimensions(length=LENGTH))
    wanted = [Run(geometry, FINE, curve) for curve in design()]
    with pool(workers) as executor:
        solved = complete(wanted, SolutionStore(store), executor=executor)
    parts = [
        _rows(number, run.curve, solution)
        for number, (run, solution) in enumerate(zip(wanted, solved, strict=True))
        if isinstance(solution, CurveSolution)
    ]
    return Table(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _rows(
    number: int, curve: Curve, solution: CurveSolution
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    q = np.array(curve.loads[: len(solution.readings)])
    z = unit(np.array(Place.of(curve.material).values[: len(MATERIAL)]))
    keep = q <= reach(curve, path_of(curve, solution)).load * (1.0 + 1e-9)
    y = np.column_stack(
        [
            np.log(solution.bend_angle / solution.arc_length * LENGTH / q),
            np.log((solution.peak_stretch - 1.0) / q),
            (solution.arc_length / LENGTH - 1.0) / q,
        ]
    )
    points = np.column_stack([2.0 * q / LARGEST_LOAD - 1.0, np.tile(z, (len(q), 1))])
    return points[keep], q[keep], y[keep], np.full(int(keep.sum()), number)


class FineLibrary:
    """The finer mesh's curvature, peak stretch and arc length as a forward map."""

    def __init__(self, table: Table, kernels: list[object] | None = None) -> None:
        self.table = table
        self.processes = [
            self._fit(table.values[:, output], None if kernels is None else kernels[output])
            for output in range(3)
        ]
        # the edge of what was solved, for each point of the library
        self._edge = {
            int(k): float(table.load[table.curve == k].max()) for k in np.unique(table.curve)
        }

    def _fit(self, values: Floats, kernel: object | None) -> GaussianProcessRegressor:
        fixed = kernel is not None
        kernel = kernel or ConstantKernel(1.0, (1e-3, 1e4)) * RBF(
            [1.0, 1.5, 1.5, 1.5], (0.2, 30.0)
        ) + WhiteKernel(1e-6, (1e-9, 1e-3))
        process = GaussianProcessRegressor(
            kernel, normalize_y=True, optimizer=None if fixed else "fmin_l_bfgs_b", random_state=1
        )
        return process.fit(self.table.points, values)

    def left_out_errors(self) -> Floats:
        """Relative errors of the curvature of each curve, predicted without it."""
        kernel = self.processes[0].kernel_
        errors = []
        for k in np.unique(self.table.curve):
            out = self.table.curve == k
            rest = Table(*(part[~out] for part in vars(self.table).values()))
            predicted = FineLibrary(rest, [kernel] * 3).processes[0].predict(self.table.points[out])
            errors.append(predicted - self.table.values[out, 0])
        return np.concatenate(errors)

    def __call__(self, inputs: Inputs) -> Prediction:
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        at = groups_of(inputs)
        material = [at[group.name] for group in MATERIAL]
        load = at[LOAD]
        shape = np.broadcast_shapes(load.shape, *(m.shape for m in material))
        q = np.broadcast_to(load, shape).ravel()
        z = unit(np.stack([np.broadcast_to(m, shape).ravel() for m in material], axis=-1))
        points = np.column_stack([2.0 * q / LARGEST_LOAD - 1.0, z])
        y, doubt = self.processes[0].predict(points, return_std=True)
        stretch, arc = (p.predict(points) for p in self.processes[1:])
        scale = np.broadcast_to(inputs.linear_scale, shape).ravel()
        kappa = q * np.exp(y) / LENGTH
        inside = (np.abs(z).max(axis=1) <= 1.0) & ((doubt < 0.01) | (q == 0.0))
        curvature = np.where(inside, kappa / scale * 1e3, np.nan).reshape(shape)
        return Prediction(
            curvature=curvature,
            bend_angle=np.degrees(kappa * LENGTH * (1.0 + q * arc)).reshape(shape),
            peak_stretch=(1.0 + q * np.exp(stretch)).reshape(shape),
            slope=np.full(shape, np.nan),
            sd=np.zeros(shape),
            bend_angle_sd=np.zeros(shape),
            peak_stretch_sd=np.zeros(shape),
            status=np.where(inside, 0, int(Status.OUTSIDE_TRAINING)).reshape(shape),
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", type=Path, default=STORE)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    table = library(options.store, options.workers)
    fine = FineLibrary(table)
    own = fine.left_out_errors()
    emulator = default_surrogate()
    one = np.ones(len(table.load))
    q = table.load
    raw = 0.5 * (LOWER + UPPER + table.points[:, 1:] * (UPPER - LOWER))
    c3 = np.exp(raw[:, 1])
    predicted = emulator(
        Inputs(q * 1e3, one, raw[:, 0] * np.sqrt(3 * c3), c3, one, np.exp(raw[:, 2]) * 1e3)
    ).curvature
    gap = predicted / (q * np.exp(table.values[:, 0]) / LENGTH * 1e3) - 1.0
    gap = gap[np.isfinite(gap)]
    figures = {
        "curves": CURVES,
        "own_error_rms_pct": 100 * float(np.sqrt(np.mean(own**2))),
        "own_error_p95_pct": 100 * float(np.quantile(np.abs(own), 0.95)),
        "emulator_error_mean_pct": 100 * float(np.mean(gap)),
        "emulator_error_rms_pct": 100 * float(np.sqrt(np.mean(gap**2))),
        "emulator_error_p95_pct": 100 * float(np.quantile(np.abs(gap), 0.95)),
        "emulator_error_max_pct": 100 * float(np.max(np.abs(gap))),
        "points": len(gap),
    }
    print(json.dumps(figures, indent=1) if options.json else figures)


if __name__ == "__main__":
    main()
