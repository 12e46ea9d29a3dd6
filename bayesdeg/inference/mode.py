"""The mode of a log density: derivatives by differences of whole batches, and the climb to it."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from bayesdeg.inference.density import Density, continued

Floats = NDArray[np.float64]
Vector = np.ndarray[tuple[int], np.dtype[np.float64]]

STEP = 1e-3  # of differences, in units of a parameter's scale
INNER = 0.1  # of it, between the densities of a gradient where gradients are differenced
REGULAR = (1e-2, 10.0)  # conditional widths between which a parameter's scale is taken as 1
USUAL, ANY = 10.0 ** np.arange(-3.0, 1.5, 0.5), 10.0 ** np.arange(-10.0, 10.5, 0.5)
IMPOSSIBLE = -1e12  # stands for −inf where an optimiser needs a number
LARGEST = 1e4  # density of which second differences still have digits to spare
FLATTEST = 1e-4  # curvature, in units of the scales, below which a direction is taken as flat
LENGTHS = np.concatenate([[0.0], 2.0 ** np.arange(-8.0, 3.0)])  # of Newton steps tried
CLOSE = 1e-2  # what is still to be gained where a climb ends
LONGEST = 20
ROUNDS, TRIALS, PATIENCE = 200, 100, 4  # of random steps where derivatives do not help


def scales(density: Density, point: Floats) -> Floats:
    """Return the unit in which each parameter is treated at a point, shape (n_parameters,).

    1 where the log density changes by one half over a distance between 0.01 and 10 in all of them,
    as it does for logarithms; else for each the smallest power of √10 over which it does.
    """
    here = float(bounded(density, point[None])[0])

    def changes(steps: Floats) -> NDArray[np.bool_]:
        moves = (steps[:, None, None] * np.eye(len(point))).reshape(-1, len(point))
        change = bounded(density, np.vstack([point + moves, point - moves])) - here
        return np.any(np.abs(change.reshape(2, len(steps), -1)) >= 0.5, axis=0)

    narrow, regular = changes(np.array(REGULAR))
    if np.all(regular & ~narrow):
        return np.ones(len(point))
    reached = changes(USUAL)
    if np.all(reached.any(axis=0) & ~reached[0]):
        return USUAL[np.argmax(reached, axis=0)]
    reached = changes(ANY)
    return np.where(reached.any(axis=0), ANY[np.argmax(reached, axis=0)], 1.0)


def derivatives(
    density: Density, point: Floats, step: float | Floats = STEP
) -> tuple[Floats, Floats]:
    """Return gradient and Hessian of the log density at a point, bounds of priors left out.

    Differences are central, and one-sided where a neighbour is impossible.

    Parameters
    ----------
    density : Density
        What to differentiate.
    point : array, shape (n_parameters,)
        Where.
    step : float or array, shape (n_parameters,)
        Of the differences; where a neighbour is impossible, the distance between gradients, and
        within a gradient a tenth of it.
    """
    steps = np.broadcast_to(np.asarray(step, dtype=np.float64), len(point))
    found = _from_pairs(density, point, steps)
    return _from_gradients(density, point, steps) if found is None else found


def _from_pairs(density: Density, point: Floats, steps: Floats) -> tuple[Floats, Floats] | None:
    """Differences of second order over all pairs of steps.

    None if a neighbour is impossible, or densities are so large that rounding would spoil them.

    H_ij = (f(i, j) + f(−i, −j) − f(i) − f(−i) − f(j) − f(−j) + 2 f) / (2 h_i h_j), with n² + n + 1
    densities in one call.
    """
    size = len(point)
    one = np.diag(steps)
    first, second = np.triu_indices(size, 1)
    both = one[first] + one[second]
    moves = np.vstack([np.zeros(size), one, -one, both, -both])
    values = bounded(density, point + moves)
    if not np.all(np.abs(values) < LARGEST):
        return None
    here, forth, back = values[0], values[1 : size + 1], values[size + 1 : 2 * size + 1]
    pairs = values[2 * size + 1 :].reshape(2, -1).sum(axis=0)
    around = forth + back
    hessian = np.diag((around - 2.0 * here) / steps**2)
    mixed = pairs - around[first] - around[second] + 2.0 * here
    hessian[first, second] = mixed / (2.0 * steps[first] * steps[second])
    hessian[second, first] = hessian[first, second]
    return (forth - back) / (2.0 * steps), hessian


def _from_gradients(density: Density, point: Floats, steps: Floats) -> tuple[Floats, Floats]:
    size = len(point)
    around = point + np.vstack([np.zeros(size), np.diag(steps), -np.diag(steps)])
    possible = (bounded(density, around) > IMPOSSIBLE)[:, None]
    gradients = slopes(density, around, INNER * steps)
    here = gradients[0]
    forth = np.where(possible[1 : size + 1], gradients[1 : size + 1], here)
    back = np.where(possible[size + 1 :], gradients[size + 1 :], here)
    sides = possible[1 : size + 1].astype(np.float64) + possible[size + 1 :]
    hessian = (forth - back) / (steps[:, None] * np.maximum(sides, 1.0))
    return here, 0.5 * (hessian + hessian.T)


def positive_inverse(precision: Floats) -> Floats:
    """Invert a precision, its eigenvalues held between `FLATTEST` and 1e8.

    A direction of too little curvature is taken as unit-wide.
    """
    values, vectors = np.linalg.eigh(precision)
    width = np.where(values > FLATTEST, 1.0 / np.clip(values, FLATTEST, 1e8), 1.0)
    covariance: Floats = (vectors * width) @ vectors.T
    return 0.5 * (covariance + covariance.T)


def bounded(density: Density, points: Floats) -> Floats:
    """Return the log density without bounds of priors, a large negative number where impossible."""
    return np.maximum(continued(density)(points), IMPOSSIBLE)


def slopes(density: Density, points: Floats, step: Floats) -> Floats:
    """Return gradients ∇ ln p at points: differences in one call, central where possible.

    Parameters
    ----------
    density : Density
        p, whose priors are taken without their bounds.
    points : array, shape (n, size)
        On the sampler's scale.
    step : array, shape (size,)
        Of the differences.

    Returns
    -------
    array, shape (n, size)
    """
    count, size = points.shape
    steps = np.vstack([np.zeros(size), np.diag(step), -np.diag(step)])
    values = bounded(density, (points[:, None, :] + steps).reshape(-1, size))
    return _slopes(values.reshape(count, 1 + 2 * size), step)


def _slopes(values: Floats, step: float | Floats) -> Floats:
    """Differences of densities here, a step forth and a step back along each axis, (..., size)."""
    size = (values.shape[-1] - 1) // 2
    here, forth, back = values[..., :1], values[..., 1 : size + 1], values[..., size + 1 :]
    possible = (forth > IMPOSSIBLE).astype(np.float64) + (back > IMPOSSIBLE)
    change = np.where(forth > IMPOSSIBLE, forth, here) - np.where(back > IMPOSSIBLE, back, here)
    found: Floats = change / (step * np.maximum(possible, 1.0))
    return found


def climb(density: Density, start: Floats, generator: np.random.Generator) -> tuple[Floats, Floats]:
    """Climb from a start to a mode: Newton's method where it serves, L-BFGS where it does not.

    Where neither gains, steps at random find the way along a wall, if there is one.

    Returns
    -------
    mode : array, shape (n_parameters,)
    covariance : array, shape (n_parameters, n_parameters)
        Inverse of the negative Hessian there.
    """
    point = np.ravel(start)
    for _ in range(LONGEST):
        scale = scales(density, point)
        gradient, hessian = derivatives(density, point, STEP * scale)
        unit = np.outer(scale, scale)
        regular = positive_inverse(-hessian * unit)
        covariance = unit * regular
        direction = covariance @ gradient
        promised = 0.5 * float(gradient @ direction)
        if np.all(np.linalg.eigvalsh(-hessian * unit) > FLATTEST):
            further = _best(density, point + LENGTHS[:, None] * direction)
            if promised < CLOSE:
                return further, covariance
            if _gain(density, point, further) > 0.3 * promised:
                point = further
                continue
        found = _ascend(density, point, scale[:, None] * np.linalg.cholesky(regular))
        found = _best(density, np.stack([point, found]))
        if _gain(density, point, found) < CLOSE:  # a wall may be in the way
            found = _along_walls(density, found, covariance, generator)
        if _gain(density, point, found) < CLOSE:
            return found, covariance
        point = found
    return point, covariance


def _gain(density: Density, before: Floats, after: Floats) -> float:
    low, high = bounded(density, np.stack([before, after]))
    return float(high - low)


def _best(density: Density, points: Floats) -> Floats:
    found: Floats = points[int(np.argmax(bounded(density, points)))]
    return found


def _along_walls(
    density: Density, point: Floats, covariance: Floats, generator: np.random.Generator
) -> Floats:
    """Climb by random steps, which need no derivative, until none of them gains.

    Where the density is zero beyond a wall, as where the forward map refuses, its gradient may
    point there while the way up leads along it.
    """
    factor = np.linalg.cholesky(covariance)
    here = float(bounded(density, point[None])[0])
    width, failed = 0.3, 0
    for _ in range(ROUNDS):
        moves = generator.standard_normal((TRIALS, len(point))) @ factor.T
        values = bounded(density, point + width * moves)
        best = int(np.argmax(values))
        gains = values[best] - here >= CLOSE
        if gains:
            point, here = point + width * moves[best], float(values[best])
        width, failed = (min(1.5 * width, 1.0), 0) if gains else (0.5 * width, failed + 1)
        if failed > PATIENCE:
            break
    return point


def _ascend(density: Density, origin: Floats, width: Floats) -> Floats:
    """Run L-BFGS once, in units of a width (a square root of the covariance) about the origin."""
    size = len(origin)
    moves = STEP * np.vstack([np.zeros(size), np.eye(size), -np.eye(size)])

    def objective(x: Vector) -> tuple[float, Vector]:
        values = bounded(density, origin + (x + moves) @ width.T)
        return -float(values[0]), np.ravel(-_slopes(values, STEP))

    found = minimize(
        objective,
        np.zeros(size),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 40, "maxcor": 30},
    )
    return origin + width @ found.x
