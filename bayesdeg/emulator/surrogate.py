"""The trained map: Chebyshev polynomials in load and material groups, with their own error.

With u the load and z the material groups, each scaled to [−1, 1], an emulator holds

    ln(κ s L / q) = Σ a_t T_i(u) T_j(z₁) T_k(z₂) T_l(z₃),   q = p/C1,

the same for ln((λ − 1)/q) of the peak stretch and for (arc length / L − 1)/q. So the curvature is
zero at zero pressure, smooth in it, and has exact derivatives.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator.forward import relative_to_reference
from bayesdeg.actuator.inputs import Inputs, Prediction, departs
from bayesdeg.actuator.status import Status
from bayesdeg.emulator.scaling import TrainingBox, groups

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

OUTPUTS = ("curvature", "peak_stretch", "arc_length")


@dataclass(frozen=True)
class Surrogate:
    """A forward map trained on finite element curves.

    Parameters
    ----------
    length : float
        Length of the actuator as moulded [mm].
    box : TrainingBox
        Range of the groups.
    orders : array, shape (n_terms, 4)
        Orders of the Chebyshev polynomials of each term.
    coefficients : array, shape (3, n_terms)
        For ``OUTPUTS``.
    limit_orders, limit_coefficients : array
        ln of the load up to which curves are smooth, less twice its standard error, as a
        polynomial of z.
    error_loads, error : array, shape (n,)
        Relative standard error of the curvature against load [–].
    record : str
        How it was trained: design, code version, accuracy (JSON).
    """

    length: float
    box: TrainingBox
    orders: Indices
    coefficients: Floats
    limit_orders: Indices
    limit_coefficients: Floats
    error_loads: Floats
    error: Floats
    record: str

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the prediction; outside the training range it is nan with a status."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        load, *material = groups(inputs)
        shape = np.broadcast_shapes(np.shape(load), *(np.shape(m) for m in material))
        kappa, stretch, arc, growth, outside = self._evaluate(load, material, shape)
        outside = outside | departs(inputs)
        scale = np.broadcast_to(inputs.linear_scale, shape)
        curvature = np.where(outside, np.nan, kappa / scale * 1e3)
        return Prediction(
            curvature=curvature,
            bend_angle=np.degrees(np.where(outside, np.nan, kappa * arc)),
            peak_stretch=np.where(outside, np.nan, stretch),
            slope=curvature * growth,
            sd=curvature * np.interp(np.broadcast_to(load, shape), self.error_loads, self.error),
            status=np.where(outside, int(Status.OUTSIDE_TRAINING), 0),
        )

    def _evaluate(
        self, load: Floats, material: list[Floats], shape: tuple[int, ...]
    ) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]:
        """Evaluate with one contraction for each curve if its material is one along the load."""
        shared = all(np.ndim(m) == 0 or np.shape(m)[-1] == 1 for m in material)
        columns = shape[-1] if shared else 1
        rows = (*shape[:-1], 1) if shared else shape
        z = [self.box.unit(i, np.broadcast_to(m, rows).reshape(-1)) for i, m in enumerate(material)]
        points = np.stack(z, axis=1)
        loads = np.ascontiguousarray(np.broadcast_to(load, shape)).reshape(-1, columns)
        safe = np.where(np.isfinite(points), np.clip(points, -1.2, 1.2), 0.0)
        # polynomials overflow far outside, where their values are not used
        near = np.minimum(loads, 1.5 * self.box.load)
        out = _evaluate_batch(near, safe, self.box.load, self.orders, self.coefficients)
        limit = np.exp(polynomial(self.limit_orders, self.limit_coefficients, safe))
        limit = np.minimum(limit, self.box.largest_load(safe[:, 1]))
        inside = np.all(np.abs(points) <= 1.0, axis=1)[:, None] & (loads <= limit[:, None])
        kappa, stretch, arc, growth = (out[i].reshape(shape) for i in range(4))
        outside = ~(inside & np.isfinite(loads) & (loads >= 0.0)).reshape(shape)
        return kappa / self.length, stretch, arc * self.length, growth, outside

    def to_arrays(self) -> dict[str, Floats | Indices | NDArray[np.str_]]:
        """Return everything as plain arrays, for a npz file."""
        return {
            "length": np.array(self.length),
            "box_load": np.array(self.box.load),
            "box_lower": np.array(self.box.lower),
            "box_upper": np.array(self.box.upper),
            "orders": self.orders,
            "coefficients": self.coefficients,
            "limit_orders": self.limit_orders,
            "limit_coefficients": self.limit_coefficients,
            "error_loads": self.error_loads,
            "error": self.error,
            "record": np.array(self.record),
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[np.generic]]) -> Self:
        """Return the surrogate that ``to_arrays`` described."""
        lower, upper = (tuple(float(v) for v in arrays[k]) for k in ("box_lower", "box_upper"))
        return cls(
            length=float(arrays["length"]),
            box=TrainingBox(float(arrays["box_load"]), lower, upper),  # type: ignore[arg-type]
            orders=arrays["orders"].astype(np.int64),
            coefficients=arrays["coefficients"].astype(np.float64),
            limit_orders=arrays["limit_orders"].astype(np.int64),
            limit_coefficients=arrays["limit_coefficients"].astype(np.float64),
            error_loads=arrays["error_loads"].astype(np.float64),
            error=arrays["error"].astype(np.float64),
            record=str(arrays["record"]),
        )


def total_degree_orders(degrees: tuple[int, ...]) -> Indices:
    """Return all orders n with Σ nᵢ/degreeᵢ ≤ 1, shape (n_terms, n_inputs).

    Examples
    --------
    >>> total_degree_orders((1, 2)).tolist()
    [[0, 0], [0, 1], [0, 2], [1, 0]]
    """
    grids = np.meshgrid(*(np.arange(d + 1) for d in degrees), indexing="ij")
    orders = np.stack([g.ravel() for g in grids], axis=1)
    within: Indices = orders[np.sum(orders / np.array(degrees), axis=1) <= 1.0 + 1e-9]
    return within


def chebyshev_features(orders: Indices, points: Floats) -> Floats:
    """Return products of Chebyshev polynomials, shape (n_points, n_terms).

    Parameters
    ----------
    orders : array, shape (n_terms, n_inputs)
        Orders of each term.
    points : array, shape (n_points, n_inputs)
        On [−1, 1].
    """
    features = np.ones((len(points), len(orders)))
    for axis in range(orders.shape[1]):
        table = np.polynomial.chebyshev.chebvander(points[:, axis], int(orders[:, axis].max()))
        features *= table[:, orders[:, axis]]
    return features


def polynomial(orders: Indices, coefficients: Floats, points: Floats) -> Floats:
    """Return the Chebyshev polynomial at points on [−1, 1], shape (n_points,)."""
    return chebyshev_features(orders, points) @ coefficients


@njit(cache=True)
def _evaluate_batch(
    loads: Floats, points: Floats, largest: float, orders: Indices, coefficients: Floats
) -> Floats:  # pragma: no cover - compiled
    """Return κ s L, peak stretch, arc length / L and d ln κ / d ln q, shape (4, rows, columns)."""
    n_rows, n_columns = loads.shape
    n_terms = orders.shape[0]
    degree = 0
    for t in range(n_terms):
        for axis in range(4):
            degree = max(degree, orders[t, axis])
    table = np.ones((3, degree + 1))
    along = np.empty((3, degree + 1))
    cheb = np.ones(degree + 1)
    slope = np.zeros(degree + 1)
    out = np.empty((4, n_rows, n_columns))
    for row in range(n_rows):
        for axis in range(3):
            z = points[row, axis]
            table[axis, 1] = z
            for n in range(2, degree + 1):
                table[axis, n] = 2.0 * z * table[axis, n - 1] - table[axis, n - 2]
        along[:] = 0.0
        for t in range(n_terms):
            product = table[0, orders[t, 1]] * table[1, orders[t, 2]] * table[2, orders[t, 3]]
            for output in range(3):
                along[output, orders[t, 0]] += coefficients[output, t] * product
        for column in range(n_columns):
            q = loads[row, column]
            u = 2.0 * q / largest - 1.0
            cheb[1] = u
            slope[1] = 1.0
            for n in range(2, degree + 1):
                cheb[n] = 2.0 * u * cheb[n - 1] - cheb[n - 2]
                slope[n] = 2.0 * cheb[n - 1] + 2.0 * u * slope[n - 1] - slope[n - 2]
            y0, y1, y2, d0 = 0.0, 0.0, 0.0, 0.0
            for n in range(degree + 1):
                y0 += along[0, n] * cheb[n]
                y1 += along[1, n] * cheb[n]
                y2 += along[2, n] * cheb[n]
                d0 += along[0, n] * slope[n]
            out[0, row, column] = q * np.exp(y0)
            out[1, row, column] = 1.0 + q * np.exp(y1)
            out[2, row, column] = 1.0 + q * y2
            out[3, row, column] = 1.0 + 2.0 * q / largest * d0
    return out
