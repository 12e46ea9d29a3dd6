"""Measures of a wall's state, compared with the elongation at break of films.

Break tests are uniaxial, walls are stretched along two axes, and no criterion is established for
this material. Each is converted to an equally demanding strain of uniaxial tension:

- ``principal_stretch``: the 99 % quantile over the volume of the largest principal stretch;
- ``cauchy_stress``: the stretch of uniaxial tension with the largest Cauchy stress of such walls;
- ``strain_energy``: the stretch of uniaxial tension with their energy;
- ``weakest_link``: Weibull's strain (1/V ∫ ε^m dV)^(1/m), ε = λ − 1: the uniform strain at which
  the volume breaks as often, with independent strengths from point to point.
"""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.data.settings import RuptureCriterion
from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.strength import (
    ScatterLaw,
    largest_cauchy_stress,
    uniaxial_stretch,
    wall_state,
    weibull_modulus,
)

Floats = NDArray[np.float64]

WEIBULL_MODULI = (5.0, 10.0, 20.0, 40.0)
ENERGY, DIFFERENCE = "peak_energy_stretch", "peak_difference_stretch"
MEASURES = (*(f"weibull_strain_{modulus:g}" for modulus in WEIBULL_MODULI), ENERGY, DIFFERENCE)
"""Measures of strain besides the peak stretch, read from an equilibrium."""
_OFFSET = 10.0
"""Interpolation in 1/(m + 10) has an error of the strain up to 0.5 %, as
``benchmarks/rupture_fields.py --moduli`` prints; in 1/m or ln m it would be 1 to 2 %."""
_AT = 1.0 / (np.array(WEIBULL_MODULI) + _OFFSET)
_SMALLEST = 1e-12  # strain of walls at rest, so that its logarithm is finite


@cache
def needed(criterion: str) -> tuple[int, ...]:
    """Return the indices in ``MEASURES`` needed by a criterion."""
    names = {
        "weakest_link": MEASURES[: len(WEIBULL_MODULI)],
        "strain_energy": (ENERGY,),
        "cauchy_stress": (ENERGY, DIFFERENCE),
    }
    return tuple(MEASURES.index(name) for name in names[criterion])


def scatter_law(criterion: RuptureCriterion) -> ScatterLaw:
    """Return the law of the elongation at break for a criterion."""
    return "weibull" if criterion == "weakest_link" else "lognormal"


def within_moduli(modulus: Floats) -> Floats:
    """Clip Weibull's modulus to 5 to 40."""
    return np.clip(modulus, min(WEIBULL_MODULI), max(WEIBULL_MODULI))


def modulus_weights(modulus: Floats) -> Floats:
    """Return weights of ln ε at ``WEIBULL_MODULI`` that interpolate ln ε to a modulus, (…, 4).

    Lagrange's polynomial in 1/(m + 10); values outside 5 to 40 are clipped.

    Examples
    --------
    >>> modulus_weights(np.array([10.0, 80.0])).round(6) + 0.0
    array([[0., 1., 0., 0.],
           [0., 0., 0., 1.]])
    """
    at = 1.0 / (within_moduli(np.asarray(modulus, dtype=np.float64))[..., None] + _OFFSET)
    weights = [
        np.prod((at - others) / (node - others), axis=-1)
        for node, others in ((x, _AT[x != _AT]) for x in _AT)
    ]
    return np.stack(weights, axis=-1)


def demanded_strain(inputs: Inputs, strains: Floats) -> Floats:
    """Return the equally demanding uniaxial strain by the criterion of the inputs.

    Parameters
    ----------
    inputs : Inputs
        With a criterion other than ``principal_stretch``: material constants [MPa], Weibull's
        modulus.
    strains : array, shape (n_needed, …)
        Strains by the measures of `needed`, in the broadcast shape of the inputs [–].

    Returns
    -------
    array
        λ − 1 [–]; nan where a strain is nan.

    Raises
    ------
    ValueError
        If a modulus is needed but not given.
    """
    if inputs.criterion == "strain_energy":
        return np.asarray(strains[0])
    if inputs.criterion == "cauchy_stress":
        # the stress 2 W'(Ī₁) (λ₁² − λ₃²) in uniaxial tension
        energy, difference = 1.0 + strains[0], 1.0 + strains[1]
        law = Yeoh(inputs.c1, inputs.c2, inputs.c3)
        excess = np.maximum(energy**2 - 1.0 / energy, _SMALLEST)
        ratio = (difference**2 - 1.0 / difference) / excess
        stress = ratio * largest_cauchy_stress(law, wall_state(energy, -0.5))
        return uniaxial_stretch(law, stress, start=difference) - 1.0
    if inputs.weibull_modulus is None:
        raise ValueError("the criterion 'weakest_link' needs the inputs' weibull_modulus")
    weights = np.moveaxis(modulus_weights(inputs.weibull_modulus), -1, 0)
    logarithm = np.log(np.maximum(strains, _SMALLEST))
    return np.asarray(np.exp(sum(w * one for w, one in zip(weights, logarithm, strict=True))))


def demanded(
    forward: ForwardMap,
    inputs: Inputs,
    criterion: RuptureCriterion,
    *,
    scatter: Floats,
    size_ratio: float,
) -> Prediction:
    r"""Evaluate a forward map, with the peak stretch as defined by a criterion.

    That of the weakest link grows with the size of the actuator,

    .. math:: \lambda - 1 = \left(\frac{V}{V_0}\right)^{1/m} \varepsilon_w

    with V the shrunk volume, V₀ that of a film, and m from the films' scatter.

    Parameters
    ----------
    forward : ForwardMap
        The mechanics.
    inputs : Inputs
        Its inputs.
    criterion : str
        Rupture criterion.
    scatter : array
        Standard deviation of ln elongation at break of films, in a shape that broadcasts with the
        inputs [–].
    size_ratio : float
        Volume of the actuator as moulded over that of a tested film [–].
    """
    if criterion != "weakest_link":
        changed = criterion != inputs.criterion
        return forward(replace(inputs, criterion=criterion) if changed else inputs)
    with np.errstate(divide="ignore"):  # without scatter the modulus is infinite
        modulus = within_moduli(weibull_modulus(scatter))
    found = forward(replace(inputs, criterion=criterion, weibull_modulus=modulus))
    size = (size_ratio * inputs.linear_scale**3) ** (1.0 / modulus)
    return replace(
        found,
        peak_stretch=1.0 + size * (found.peak_stretch - 1.0),
        peak_stretch_sd=size * found.peak_stretch_sd,
    )
