"""Maximum-likelihood kernel of the data, and its derivatives."""

import numpy as np
from fine_library_process import Data, Kernel, condition, spread
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.optimize import minimize

Floats = NDArray[np.float64]


def log_density(kernel: Kernel, data: Data) -> tuple[float, Floats]:
    """Return the log marginal density of the data, and its derivatives by ``Kernel.log``."""
    found = condition(kernel, data)
    whole, known = data.stacked(kernel)
    n, d, outputs = len(data.places), kernel.size, whole.shape[1]
    whole[:n] -= found.process.mean
    counts = np.isfinite(data.slopes).all(axis=1).sum(axis=0)
    log_det = 2.0 * np.sum(np.log(np.diag(found.factor[0])))
    square = np.sum(whole[known] * found.solved)
    density = -0.5 * square - 0.5 * outputs * log_det + outputs * counts @ np.log(kernel.lengths)
    inverse = cho_solve(found.factor, np.eye(len(found.solved)), check_finite=False)
    shares = np.zeros((len(whole), len(whole)))
    shares[np.ix_(known, known)] = 0.5 * (found.solved @ found.solved.T - outputs * inverse)
    gradient = _rates(kernel, data, shares)
    whole[~known] = 0.0
    products = np.sum(spread(found, whole[known]) * found.process.weights, axis=(1, 2))
    gradient[:d] += outputs * counts - products[1:]
    return float(density), gradient


def _rates(kernel: Kernel, data: Data, shares: Floats) -> Floats:
    """Return the sums of shares times derivatives of the matrix by ``Kernel.log``."""
    n, d, kinds = len(data.places), kernel.size, data.kinds
    blocks = shares.reshape(len(kinds), n, len(kinds), n)
    scaled = data.places / kernel.lengths
    k, slope, both = kernel.factors(scaled, scaled)
    out = np.empty(2 * d + 3)
    # rows of a slope, all but the diagonal; the columns add the same
    rows, own = np.zeros((d, n, n)), np.zeros((d, n, n))
    total = blocks[0, :, 0] * k
    for row, i in enumerate(kind - 1 for kind in kinds[1:]):
        rows[i] = blocks[row + 1, :, 0] * k
        for column, j in enumerate(kind - 1 for kind in kinds[1:]):
            if j != i:
                rows[i] -= blocks[row + 1, :, column + 1] * k * slope[j]
        own[i] = blocks[row + 1, :, row + 1] * k
        total += (rows[i] - blocks[0, :, row + 1] * k) * slope[i] + own[i] * both[i]
    for i, c in enumerate(kernel.constants):
        r = scaled[:, i, None] - scaled[None, :, i]
        e = np.exp(-0.5 * r * r)
        share = e / (c + e)
        change = share * (1.0 - share)
        by_length = (share * r * r, share * r - change * r**3)
        by_constant = (1.0 - share - c / (c + 1.0), change * r)
        curved = (change * r * r * (1.0 - r * r) + 2.0 * share * r * r, -change * (1.0 - r * r))
        for place, (factor, line), bend in zip(
            (i, d + i), (by_length, by_constant), curved, strict=True
        ):
            out[place] = np.sum(total * factor + 2.0 * rows[i] * line + own[i] * bend)
    diagonal = np.diag(shares)
    out[-3] = 2.0 * np.sum(total)
    out[-2:] = (
        2.0 * np.array([diagonal[:n].sum(), diagonal[n:].sum()]) * np.exp(2.0 * kernel.log[-2:])
    )
    return out


def most_likely(kernel: Kernel, data: Data, *, iterations: int) -> Kernel:
    """Return the kernel of the largest marginal density, from a first guess."""

    def cost(log: Floats) -> tuple[float, Floats]:
        try:
            density, gradient = log_density(Kernel(log), data)
        except np.linalg.LinAlgError:
            return 1e9, np.zeros_like(log)
        return -density, -gradient

    d = kernel.size
    bounds = [(-1.5, 4.5)] * d + [(-7.0, 7.0)] * d + [(-6.0, 8.0)] + [(-14.0, -4.0)] * 2
    found = minimize(
        cost,
        kernel.log,
        method="L-BFGS-B",
        jac=True,
        bounds=bounds,
        options={"maxiter": iterations},
    )
    return Kernel(found.x)
