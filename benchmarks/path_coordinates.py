"""Which coordinate along a path an emulator should have, measured on paths through ballooning.

    uv run python benchmarks/path_coordinates.py --json

fits solved paths of the default actuator (``solved_paths.npz``) in five ways, with the same terms,
and leaves each path out in turn. A path is followed by its cavity volume: to the last load asked
for, or just beyond the limit point. With q = p/M, κ the change of curvature, L the length and
t = ΔV/(c L³) the volume that the cavity swept, c such that t ≈ q at first, it is known by

    load, to where it steepens    ln(κ/q) as a function of q, to d ln κ/d ln q = 2.75
    load                          the same to the limit point
    volume                        ln(q/t) and ln(κ/t) as functions of t
    ln(1 + volume)                the same as functions of ln(1 + t)
    bend angle                    ln(q/θ) and ln(κ/θ) as functions of ln(1 + θ)

The error is that of the curvature at a given load: from those of both logarithms at a given t or θ,
e_κ − g e_q with g = d ln κ/d ln q. It is the largest of a path, over its largest curvature, up to
99 % of the limit pressure. That of the limit pressure is e_q where q is largest.

Keys by way: ``readings_pct``, the share of all solved equilibria to 99 % of the limit that it
covers; ``curvature_pct`` and ``limit_pct``, with median, rms, 95th percentile and the number of
paths; by kind of path, ``study`` (materials typical of studies) or ``range`` (a Sobol' design over
the whole range). ``fine`` has the same for the chosen way on the fine mesh, the coarse mesh's terms
corrected by few, and the fine path left out with its coarse twin. Solve the paths again with
``--solve FILE`` (half an hour). ``shipped`` has the errors of the package's emulator against fine
paths that it was not trained on: those, which served to choose its terms, and ``fresh`` ones, of
material drawn as for virtual studies and not degraded, which chose nothing. They do not balloon:
beyond some 260 kPa curvature grows steeply, and the walls stiffen again.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from emulator_held_out import inputs_of
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import SAMPLING, Curve, PathSamples, sample_task
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.status import Status
from bayesdeg.data.settings import Dimensions
from bayesdeg.laboratory.truth import Truth, drawn_truth
from bayesdeg.surrogate.coordinates import SECOND_INVARIANT, SLACK, coordinates, scaled_material
from bayesdeg.surrogate.design import LOAD_SHARES, space_filling, study_like
from bayesdeg.surrogate.fit import POWERS, summary
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.regression import (
    DERIVATIVE_WEIGHT,
    FLOOR,
    Equations,
    Prior,
    Regression,
    fit,
    half_ranges,
    input_jacobian,
    quantities,
)
from bayesdeg.surrogate.scaling import MATERIAL, NAMES, Place, TrainingRange
from bayesdeg.surrogate.terms import Family, Terms, feature_gradients, features
from bayesdeg.surrogate.trained import default_surrogate

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Summary = dict[str, dict[str, dict[str, float]]]

PATHS = Path(__file__).with_name("solved_paths.npz")
LENGTH = Dimensions().length
COMPLIANCE = 3.56e-3  # c: ΔV/(L³ q) of the half model at small loads
HIGHER = 1.3  # loads asked for over those of the shipped emulator's design
COUNTS = {"study": 48, "range": 73}
FINE = {"study": 12, "fresh": 10}
SEEDS = {"study": 77, "range": 11, "fresh": 31}
HIGHEST, TRAINED = 1.6, 1.25  # p/M of fresh material, solved and that the emulator answers
TO = 0.99  # of the limit pressure
STEEPEST = 2.75  # d ln κ/d ln q
KAPPA, ANGLE, VOLUME = 0, 1, -1  # columns of `quantities`

# ---- solved paths


class Solved(NamedTuple):
    """A solved path: of which kind of material, on which mesh."""

    kind: str
    is_fine: bool
    curve: Curve
    samples: PathSamples

    @property
    def limit(self) -> float:
        """p/M of the limit point; inf without one."""
        return float(self.samples.limit_load) / Place.of(self.curve.material).modulus


def curves(kind: str) -> list[Curve]:
    """Return the curves of a kind."""
    if kind == "fresh":
        generator = np.random.default_rng(SEEDS[kind])
        return [fresh(drawn_truth(generator)) for _ in range(FINE[kind])]
    span, count, seed = TrainingRange(), COUNTS[kind], SEEDS[kind]
    if kind == "range":
        found = space_filling(span, count, seed=seed)
        return [replace(one, loads=tuple(HIGHER * q for q in one.loads)) for one in found]
    found = []
    for one in study_like(count, seed=seed):
        at = Place.of(one.material)
        stiffening = scaled_material(np.array(at.values[: len(MATERIAL)]))[1]
        most = HIGHER * float(span.largest_load(stiffening)) * at.modulus
        end = min(most, 1.5 * one.loads[-1])
        found.append(replace(one, loads=tuple(end * share for share in LOAD_SHARES)))
    return found


def fresh(truth: Truth) -> Curve:
    """Return a curve of material that has not degraded."""
    (c1, c2, c3), scale = truth.constants(0.0), float(np.cbrt(truth.volume_ratio))
    material = MaterialGroups(
        c2 / c1,
        c3 / c1,
        1e-3 * truth.paper_stiffness / (c1 * scale),
        paper_thickness=truth.paper_thickness / scale,
    )
    return Curve((HIGHEST,), material)


def solve() -> Iterator[Solved]:
    """Solve all paths, those of the fine mesh last."""
    geometry, recipe = Geometry(Dimensions()), Recipe()
    with threadpool_limits(1):
        for is_fine, counts in ((False, COUNTS), (True, FINE)):
            mesh = recipe.fine_mesh if is_fine else recipe.coarse_mesh
            for kind, count in counts.items():
                for curve in curves(kind)[:count]:
                    samples = sample_task((geometry, mesh, curve), effort=SAMPLING)
                    yield Solved(kind, is_fine, curve, samples)


def write(paths: Sequence[Solved], file: Path) -> None:
    """Write solved paths; readings and derivatives as 32-bit numbers."""
    samples = [one.samples for one in paths]
    np.savez_compressed(
        file,
        kind=np.array([one.kind for one in paths]),
        is_fine=np.array([one.is_fine for one in paths]),
        material=np.array([list(vars(one.curve.material).values()) for one in paths]),
        highest=np.array([one.curve.loads[-1] for one in paths]),
        count=np.array([len(one.loads) for one in samples]),
        status=np.array([int(one.status) for one in samples]),
        limit=np.array([one.limit_load for one in samples]),
        loads=np.concatenate([one.loads for one in samples]),
        readings=np.concatenate([one.readings for one in samples]),
        gradients=np.concatenate([one.gradients for one in samples]).astype(np.float32),
    )


def read(file: Path = PATHS) -> list[Solved]:
    """Read solved paths."""
    with np.load(file) as stored:
        table = dict(stored)
    ends = np.cumsum(table["count"])
    found = []
    for k, (first, last) in enumerate(zip(ends - table["count"], ends, strict=True)):
        samples = PathSamples(
            table["loads"][first:last],
            table["readings"][first:last],
            table["gradients"][first:last].astype(np.float64),
            Status(int(table["status"][k])),
            float(table["limit"][k]),
            iterations=0,
            solver="",
        )
        curve = Curve((float(table["highest"][k]),), MaterialGroups(*table["material"][k].tolist()))
        found.append(Solved(str(table["kind"][k]), bool(table["is_fine"][k]), curve, samples))
    return found


# ---- a path by one coordinate


@dataclass(frozen=True)
class Way:
    """A coordinate z along the path, and what is known as its function.

    Parameters
    ----------
    name : str
        As in the module's text.
    of : {"load", "volume", "bend angle"}
        The quantity z.
    is_logarithmic : bool
        Whether polynomials are in ln(1 + z).
    ends_steep : bool
        Whether the path ends where d ln κ/d ln q passes `STEEPEST`.
    largest : float
        Largest z.
    """

    name: str
    of: str
    is_logarithmic: bool
    ends_steep: bool
    largest: float

    def along(self, z: Floats) -> tuple[Floats, Floats]:
        """Return the coordinate on [−1, 1] and its derivative by z."""
        if not self.is_logarithmic:
            return 2.0 * z / self.largest - 1.0, np.full(z.shape, 2.0 / self.largest)
        whole = float(np.log1p(self.largest))
        return 2.0 * np.log1p(z) / whole - 1.0, 2.0 / (1.0 + z) / whole


LARGEST_VOLUME, LARGEST_ANGLE = 14.0, 12.0
CHOSEN = Way("ln(1 + volume)", "volume", True, False, LARGEST_VOLUME)
WAYS = (
    Way("load, to where it steepens", "load", False, True, 1.4),
    Way("load", "load", False, False, 1.4),
    Way("volume", "volume", False, False, LARGEST_VOLUME),
    CHOSEN,
    Way("bend angle", "bend angle", True, False, LARGEST_ANGLE),
)


@dataclass(frozen=True)
class Seen:
    """A path in the coordinates of one way.

    Parameters
    ----------
    path : Solved
        The path.
    points, jacobian : array
        Coordinates of its equilibria (n, 13), and their derivatives by z and groups.
    z, load, kappa : array, shape (n,)
        z, p/M, and κ L.
    values : array, shape (n, 2)
        ln(q/z) and ln(κ L/z).
    gradients : array, shape (n, 2, 13)
        Their derivatives by z and groups.
    """

    path: Solved
    points: Floats
    jacobian: Floats
    z: Floats
    load: Floats
    kappa: Floats
    values: Floats
    gradients: Floats

    @property
    def weights(self) -> Floats:
        """κ over its largest, at least `FLOOR`, (n, 1)."""
        return np.maximum(self.kappa / self.kappa.max(), FLOOR)[:, None]

    @property
    def growth(self) -> Floats:
        """d ln κ/d ln q, (n,); infinite at the limit point."""
        by_load, by_kappa = (1.0 / self.z + self.gradients[:, k, 0] for k in (0, 1))
        with np.errstate(divide="ignore"):
            growth: Floats = by_kappa / by_load
        return growth

    @property
    def is_before_limit(self) -> NDArray[np.bool_]:
        """Which equilibria come before `TO` of the limit."""
        rising = np.arange(len(self.z)) <= np.argmax(self.load)
        return rising & (self.load < TO * self.path.limit)


def seen(path: Solved, way: Way) -> Seen | None:
    """Return a path in the coordinates of a way; None if fewer than three equilibria are left."""
    place, samples = Place.of(path.curve.material), path.samples
    if len(samples.loads) < 4:
        return None
    q = samples.loads[1:] / place.modulus
    sizes, by_inputs = quantities(samples, LENGTH)
    columns = [KAPPA, ANGLE, VOLUME]
    changes = sizes[1:, columns] - sizes[0, columns]
    slopes = by_inputs[1:, columns].copy()
    slopes[..., 1:] -= by_inputs[0, columns, 1:]
    changes[:, 2], slopes[:, 2] = changes[:, 2] / COMPLIANCE, slopes[:, 2] / COMPLIANCE
    by_groups = np.concatenate(
        [slopes[..., :1] * place.modulus, slopes[..., 1:] @ input_jacobian(place)], axis=-1
    )
    by_groups[..., SECOND_INVARIANT] += slopes[..., 0] * (q * place.modulus**2)[:, None]
    kappa, angle, volume = changes.T
    of_load = np.zeros((len(q), len(NAMES)))
    of_load[:, 0] = 1.0
    z, of_z = {
        "load": (q, of_load),
        "volume": (volume, by_groups[:, 2]),
        "bend angle": (angle, by_groups[:, 1]),
    }[way.of]

    def at_z(rate: Floats) -> Floats:
        """Return derivatives at a given z from those at a given load."""
        found: Floats = rate - rate[:, :1] * of_z / of_z[:, :1]
        found[:, 0] = rate[:, 0] / of_z[:, 0]
        return found

    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.log(np.column_stack([q / z, kappa / z]))
        parts = [at_z(of_load) / q[:, None], at_z(by_groups[:, 0]) / kappa[:, None]]
        gradients = np.stack(parts, axis=1)
        gradients[:, :, 0] -= 1.0 / z[:, None]
    groups = np.column_stack([z, np.tile(place.values, (len(z), 1))])
    usable = np.isfinite(values).all(axis=1) & np.isfinite(gradients).all(axis=(1, 2))
    usable &= (z > 0.0) & (z <= way.largest)
    found = coordinates(np.where(usable[:, None], groups, 0.0))
    points, jacobian = found.points, found.jacobian
    jacobian[:, 0] = 0.0
    points[:, 0], jacobian[:, 0, 0] = way.along(np.where(usable, z, 0.0))
    whole = Seen(path, points, jacobian, z, q, kappa, values, gradients)
    if way.of == "load":
        usable &= whole.is_before_limit
    if way.ends_steep:
        with np.errstate(invalid="ignore"):
            usable &= np.cumsum(~(whole.growth < STEEPEST) & (np.arange(len(z)) > 1)) == 0
    if np.count_nonzero(usable) < 3:
        return None
    arrays = {name: part[usable] for name, part in vars(whole).items() if name != "path"}
    return replace(whole, **arrays)


# ---- fits and their errors

OF_LOAD = Family((12, 8, 8, 5), (8, 5, 5, 4), POWERS, (4, 2, 2, 2), (1, 1, 1, 1))
OF_KAPPA = Family((8, 4, 4, 4), (5, 3, 3, 3), POWERS, (3, 1, 1, 1))
OF_FINE = Family((4, 2, 2, 2), (2, 1, 1, 1), tuple(min(2, power) for power in POWERS))
PRIOR = Prior(0.65, 0.5, 0.5, 1e-3)
OF_FINE_PRIOR = Prior(0.5, 0.4, 0.3, 1e-2)


def equations(one: Seen, orders: Indices, output: int, below: Sequence[Terms] = ()) -> Equations:
    """Return the equations of a path for one of its logarithms, less terms that are known."""
    weights = one.weights if output == 1 else np.ones((len(one.z), 1))
    by_group = DERIVATIVE_WEIGHT * half_ranges()
    sizes = [DERIVATIVE_WEIGHT * one.z[:, None], *by_group]
    if one.path.curve.material.paper_slack > 0.0:
        sizes[SLACK] = 0.0 * one.z[:, None]

    def rows(orders: Indices) -> Floats:
        slopes = np.einsum(
            "npt,npk->knt", feature_gradients(orders, one.points), one.jacobian, optimize=True
        )
        parts = [size * along for size, along in zip(sizes, slopes, strict=True)]
        return np.vstack([weights * part for part in (features(orders, one.points), *parts)])

    by_z = one.gradients[:, output].T[..., None]
    parts = [size * rate for size, rate in zip(sizes, by_z, strict=True)]
    target = np.vstack([weights * part for part in (one.values[:, [output]], *parts)])
    for terms in below:
        target = target - rows(terms.orders) @ terms.coefficients.T
    return Equations(rows(orders), target, len(one.z))


@dataclass(frozen=True)
class LeftOut:
    """A fit of one logarithm, and the errors of each path left out."""

    regression: Regression
    errors: list[Floats]


def left_out(
    paths: Sequence[Seen], output: int, family: Family, prior: Prior, below: Sequence[Terms] = ()
) -> LeftOut:
    """Fit one logarithm to all paths, and leave each out."""
    parts = [equations(one, family.orders, output, below) for one in paths]
    found = fit(parts, family.orders, prior, outputs=1)
    errors = []
    for one, part in zip(paths, parts, strict=True):
        error = (part.targets - part.matrix @ found.without(part).T)[: part.n_values, 0]
        errors.append(error / (one.weights[:, 0] if output == 1 else 1.0))
    return LeftOut(found, errors)


def reported(paths: Sequence[Seen], of_load: list[Floats], of_kappa: list[Floats]) -> Summary:
    """Return errors of curvature at a load and of the limit, by kind of path."""
    found: Summary = {}
    for kind in dict.fromkeys(one.path.kind for one in paths):
        worst, limits = [], []
        for one, e_load, e_kappa in zip(paths, of_load, of_kappa, strict=True):
            if one.path.kind != kind:
                continue
            error = (e_kappa - one.growth * e_load) * one.weights[:, 0]
            worst.append(float(np.max(np.abs(error[one.is_before_limit]), initial=0.0)))
            if np.isfinite(one.path.limit) and np.any(np.diff(one.load) < 0.0):
                limits.append(float(e_load[np.argmax(one.load)]))
        found[kind] = {
            "curvature_pct": summary(worst) | {"paths": len(worst)},
            "limit_pct": summary(limits) | {"paths": len(limits)},
        }
    return found


def before_limit(path: Solved) -> int:
    """Return how many equilibria of a path come before `TO` of its limit, without that at rest."""
    load = path.samples.loads[1:]
    rising = np.arange(len(load)) <= np.argmax(load)
    return int(np.sum(rising & (load < TO * path.samples.limit_load)))


def measured(way: Way, paths: Sequence[Solved]) -> tuple[Summary, list[Seen]]:
    """Return the errors of a way on the coarse mesh."""
    known = [one for path in paths if not path.is_fine and (one := seen(path, way)) is not None]
    if way.of == "load":
        zero = [np.zeros(len(one.z)) for one in known]
        return reported(known, zero, left_out(known, 1, OF_LOAD, PRIOR).errors), known
    of_load = left_out(known, 0, OF_LOAD, PRIOR).errors
    return reported(known, of_load, left_out(known, 1, OF_KAPPA, PRIOR).errors), known


def corrected(paths: Sequence[Solved]) -> Summary:
    """Return the errors of the chosen way on the fine mesh."""
    coarse = [one for p in paths if not p.is_fine and (one := seen(p, CHOSEN)) is not None]
    fine = [
        one
        for p in paths
        if p.is_fine and p.kind in COUNTS and (one := seen(p, CHOSEN)) is not None
    ]
    twins = {one.path.curve.material: one for one in coarse}
    errors = []
    for output, family in ((0, OF_LOAD), (1, OF_KAPPA)):
        base = left_out(coarse, output, family, PRIOR).regression
        terms = Terms(base.orders, base.coefficients)
        shift = left_out(fine, output, OF_FINE, OF_FINE_PRIOR, [terms])
        whole = []
        for one, error in zip(fine, shift.errors, strict=True):
            twin = twins[one.path.curve.material]
            change = base.without(equations(twin, base.orders, output)) - base.coefficients
            whole.append(error - features(base.orders, one.points) @ change[0])
        errors.append(whole)
    return reported(fine, *errors)


def shipped(paths: Sequence[Solved]) -> Summary:
    """Return the errors of the package's emulator against fine paths, up to `TO` of the limit."""
    emulator, found = default_surrogate(), dict[str, dict[str, dict[str, float]]]()
    for kind in FINE:
        worst, limits = [], []
        for path in (one for one in paths if one.is_fine and one.kind == kind):
            load, kappa = path.samples.loads[1:], quantities(path.samples, LENGTH)[0][:, KAPPA]
            limit = path.samples.limit_load
            known = (np.arange(len(load)) <= np.argmax(load)) & (load < TO * limit)
            if kind == "fresh":
                known &= load <= TRAINED
            inputs = inputs_of(path.curve, load[known][None])
            predicted = LENGTH * 1e-3 * emulator(inputs).curvature[0]
            truth = (kappa[1:] - kappa[0])[known]
            worst.append(float(np.max(np.abs(predicted - truth)) / truth.max()))
            if np.isfinite(limit):
                limits.append(1e-3 * emulator.limit_pressure(inputs).pressure.item() / limit - 1.0)
        found[kind] = {
            "curvature_pct": summary(worst) | {"paths": len(worst)},
            "limit_pct": summary(limits) | {"paths": len(limits)},
        }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the whole document")
    parser.add_argument("--solve", type=Path, metavar="FILE", help="solve the paths again")
    options = parser.parse_args()
    if options.solve is not None:
        write(list(solve()), options.solve)
    paths = read(options.solve or PATHS)
    whole = sum(before_limit(one) for one in paths if not one.is_fine)
    document: dict[str, object] = {}
    for way in WAYS:
        errors, known = measured(way, paths)
        covered = sum(int(one.is_before_limit.sum()) for one in known)
        document[way.name] = {"readings_pct": 100.0 * covered / whole} | errors
        if not options.json:
            print(way.name, json.dumps(document[way.name], indent=1))
    document["fine"], document["shipped"] = corrected(paths), shipped(paths)
    print(
        json.dumps(
            document if options.json else {k: document[k] for k in ("fine", "shipped")}, indent=1
        )
    )


if __name__ == "__main__":
    main()
