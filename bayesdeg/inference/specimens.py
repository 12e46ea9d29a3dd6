"""What specimens are in the eyes of a model: material, its scatter, its elongation limit."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause, FilmConditions
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
from bayesdeg.material.hyperelastic import yeoh_basis

Floats = NDArray[np.float64]
Causes = tuple[Cause, ...]

_STEP = 5e-4
_STENCIL = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * _STEP)
_AROUND_ONE = 1.0 + _STEP * np.array([-2.0, -1.0, 1.0, 2.0])
"""Stretches about 1, and weights with which stresses there give the slope to a part in 1e11."""


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


def with_effects(
    stress: Floats, tests: FilmConditions, values: Named, constants: Floats, causes: Causes
) -> Floats:
    """Return what films read in place of a stress (n, S, n_points) under causes."""
    for cause in causes:
        if cause.on_stress is not None:
            stress = cause.on_stress(stress, tests, cause.effect(values), constants)
    return stress


def young_modulus(values: Named, constants: Floats, causes: Causes = ()) -> Floats:
    r"""Return Young's modulus of films at zero strain under causes [MPa].

    It is the slope of the nominal stress that films show in uniaxial tension, at stretch 1:

    .. math:: Y = \left. \frac{dP}{d\lambda} \right|_{\lambda = 1}

    which is 6 C₁ where no cause acts on that stress, and 6 C₁ (1 + x/(2√3)) with a
    `second_invariant` of ratio x. It is taken from what causes do to stresses, by differences of
    fourth order, so no cause has to state it.

    Parameters
    ----------
    values : mapping
        Named values with the parameters of the causes, each (n,).
    constants : array, shape (n, S, 3)
        Yeoh's C1, C2, C3 [MPa].
    causes : tuple of Cause
        Those that act.

    Returns
    -------
    array, shape (n, S)
        [MPa]

    Examples
    --------
    >>> from bayesdeg.causes.catalogue import CATALOGUE
    >>> constants = np.array([[[0.3, -0.01, 0.002]]])
    >>> values = {"second_invariant.ratio": np.array([0.5])}
    >>> young_modulus(values, constants, (CATALOGUE["second_invariant"],)).round(4)
    array([[2.0598]])
    """
    if not any(cause.on_stress is not None for cause in causes):
        return law.young_modulus(constants[..., 0])
    count = constants.shape[-2]
    stretch = np.broadcast_to(_AROUND_ONE, (count, len(_AROUND_ONE)))
    nominal = np.zeros(stretch.shape, dtype=bool)
    tests = FilmConditions(stretch, np.full(count, "uniaxial"), nominal, np.zeros(count))
    stress = constants @ yeoh_basis(_AROUND_ONE, "uniaxial").T
    slope: Floats = with_effects(stress, tests, values, constants, causes) @ _STENCIL
    return slope


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
    values: Named,
    statistics: tuple[Statistic, ...],
    *,
    nodes: Nodes,
    elongation_nodes: Nodes,
    causes: Causes = (),
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
        means[:, modulus] = young_modulus(values, at, causes)
    if np.any(elongation):
        means[:, elongation] = elongation_at(values, levels[elongation], elongation_nodes)
    return means
