"""What specimens are in the eyes of a model: material, its scatter, its elongation limit."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.data import Statistic
from bayesdeg.inference.parameters import Named, control_name, node_name
from bayesdeg.material import degradation as law
from bayesdeg.material.degradation import (
    Controls,
    Nodes,
    bernstein_slopes,
    bernstein_weights,
    constants,
)

Floats = NDArray[np.float64]


class Material(NamedTuple):
    """The median material at the specimens' degradation rates.

    Parameters
    ----------
    constants : array, shape (n, S, 3)
        Yeoh's C1, C2, C3 [MPa].
    slope : array, shape (n, S, 3)
        Their derivatives by D_R [MPa/%].
    """

    constants: Floats
    slope: Floats

    @property
    def sensitivity(self) -> Floats:
        """Return d ln C1/dD_R [1/%], (n, S)."""
        sensitivity: Floats = self.slope[..., 0] / self.constants[..., 0]
        return sensitivity


def controls_of(values: Named, nodes: Nodes) -> Controls:
    """Return the control values of the constants, each (n, n_nodes)."""
    return Controls(
        *(
            np.stack([values[control_name(name, nodes, k)] for k in range(len(nodes))], axis=-1)
            for name in ("c1", "c2_ratio", "c3")
        )
    )


def material_at(controls: Controls, degradation: Floats, nodes: Nodes) -> Material:
    """Return the material at degradation rates (S,) or (n, S)."""
    return Material(
        constants_at(controls, degradation, nodes),
        constants(controls, bernstein_slopes(degradation, nodes)),
    )


def constants_at(controls: Controls, degradation: Floats, nodes: Nodes) -> Floats:
    """Return the constants alone, as of `material_at`."""
    return constants(controls, bernstein_weights(degradation, nodes))


def shared(degradation: Floats) -> Floats:
    """Return degradation rates (n, S) as (S,) where they are one row, broadcast over draws.

    What follows from them alone is then worked out once.

    Examples
    --------
    >>> shared(np.broadcast_to([0.0, 25.0], (3, 2))).tolist()
    [0.0, 25.0]
    """
    one = len(degradation) > 0 and degradation.strides[0] == 0
    return degradation[0] if one else degradation


def elongation_at(values: Named, degradation: Floats, nodes: Nodes) -> Floats:
    """Return the median elongation at break [%] at degradation rates (S,) or (n, S), (n, S)."""
    log_values = np.log(np.stack([values[node_name("elongation", n)] for n in nodes], axis=-1))
    elongation: Floats = np.exp(law.polynomial(log_values, degradation, nodes))
    return elongation


def elongation_spread(values: Named, degradation: Floats, sd: Floats, *, nodes: Nodes) -> Floats:
    """Return the variance of ln elongation at break of specimens, shape (n, S).

    σ² + (d ln ε/dD_R · sd(D_R))²: scatter, and the error of the degradation rate.
    """
    log_values = np.log(np.stack([values[node_name("elongation", n)] for n in nodes], axis=-1))
    sensitivity = law.derivative(log_values, degradation, nodes)
    spread: Floats = values["elongation_scatter"][:, None] ** 2 + (sensitivity * sd) ** 2
    return spread


def expected_statistics(
    values: Named, statistics: tuple[Statistic, ...], *, nodes: Nodes, elongation_nodes: Nodes
) -> Floats:
    """Return what statistics are of, in their units, (n, n_statistics)."""
    kinds = np.array([s.quantity for s in statistics])
    levels = np.array([s.degradation for s in statistics])
    count = len(next(iter(values.values())))
    means = np.empty((count, len(statistics)))
    ratio, modulus = kinds == "volume_ratio", kinds == "young_modulus"
    elongation = ~(ratio | modulus)
    if np.any(ratio):
        means[:, ratio] = values["volume_ratio"][:, None]
    if np.any(modulus):
        at = constants_at(controls_of(values, nodes), levels[modulus], nodes)
        means[:, modulus] = law.young_modulus(at[..., 0])
    if np.any(elongation):
        means[:, elongation] = elongation_at(values, levels[elongation], elongation_nodes)
    return means
