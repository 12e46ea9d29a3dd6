"""Dimensionless constants of an actuator for the discrete equations."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.body import Body

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MaterialGroups:
    """Groups in units of C1 and at moulded size; all but the first three default to neutral.

    Parameters
    ----------
    c2_ratio, c3_ratio : float
        C2/C1 and C3/C1 of the Yeoh law [–].
    paper_group : float
        Et/(C1 s): stiffness of the paper over C1 and the linear scale s [mm].
    paper_poisson : float
        Poisson's ratio of the paper [–].
    bulk_ratio : float
        K/C1 [–]; at 1e4 the curvature is within 0.05 % of the incompressible one.
    second_invariant_ratio : float
        r/C1 of a term r (√Ī₂ − √3) in the energy [–].
    skin : float
        Logarithm of the stiffness of an exposed surface over that of the volume's mean [–].
    paper_thickness : float
        Thickness over the linear scale, t/s [mm]; it gives the paper its bending stiffness.
    paper_slack : float
        Strain below which a cockled paper carries hardly any load [–].
    paper_mismatch : float
        Excess length of the paper over the body it is bonded to: the linear strain by which the
        body shrank after the paper was bonded [–].
    gravity_along, gravity_up : float
        ρ g s/C1 along the actuator, from the clamp, and up, from the paper [1/mm].
    wall_factor : float
        Thickness of walls and roof over the nominal one [–].
    erosion : float
        Thickness lost from exposed faces, over the linear scale [mm].
    """

    c2_ratio: float
    c3_ratio: float
    paper_group: float
    paper_poisson: float = 0.3
    bulk_ratio: float = 1e4
    second_invariant_ratio: float = 0.0
    skin: float = 0.0
    paper_thickness: float = 0.0
    paper_slack: float = 0.0
    paper_mismatch: float = 0.0
    gravity_along: float = 0.0
    gravity_up: float = 0.0
    wall_factor: float = 1.0
    erosion: float = 0.0


@dataclass(frozen=True)
class LayerGroups:
    """Yeoh constants of a layer of a different elastomer, over C1 of the body.

    Parameters
    ----------
    c1, c2, c3 : float
        Its constants [C1].
    """

    c1: float
    c2: float = 0.0
    c3: float = 0.0


def local_constants(
    material: MaterialGroups, body: Body, layer: LayerGroups | None = None
) -> Floats:
    """Return C1, C2, C3 and r at every quadrature point, (n_elements, n_points, 4) [C1].

    Parameters
    ----------
    material : MaterialGroups
        Of the body, whose skin may be stiffer than its core.
    body : Body
        Body of bricks.
    layer : LayerGroups, optional
        Constants of its layer's bricks, which have no skin.

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> from dataclasses import replace
    >>> body = replace(box((1, 1, 2), divisions=(1, 1, 2)), layer=np.array([True, False]))
    >>> soft = MaterialGroups(c2_ratio=0.0, c3_ratio=0.5, paper_group=0.0)
    >>> local_constants(soft, body, LayerGroups(8.0))[:, 0, :3].tolist()
    [[8.0, 0.0, 0.0], [1.0, 0.0, 0.5]]
    """
    m = material
    uniform = np.array([1.0, m.c2_ratio, m.c3_ratio, m.second_invariant_ratio])
    if m.skin == 0.0:
        local = np.broadcast_to(uniform, (*body.weights.shape, 4)).copy()
    else:
        local = np.exp(m.skin * skin_profile(body))[..., None] * uniform
    if layer is not None:
        local[body.layer] = [layer.c1, layer.c2, layer.c3, 0.0]
    return local


def is_elliptic(material: MaterialGroups) -> bool:
    """Return whether ∂W/∂I₁ > 0 for all strains: C3 ≥ 0 and C2 > −√(3 C1 C3).

    The second-invariant term must not be negative either.

    Examples
    --------
    >>> is_elliptic(MaterialGroups(c2_ratio=-0.5, c3_ratio=0.01, paper_group=100.0))
    False
    """
    c2, c3 = material.c2_ratio, material.c3_ratio
    if not material.second_invariant_ratio >= 0.0:
        return False
    if c3 > 0.0:
        return bool(c2 > -np.sqrt(3.0 * c3))
    return c3 == 0.0 and c2 >= 0.0


SKIN_DEPTH = 0.5  # mm at moulded size, decay length of degradation from an exposed face


def skin_profile(body: Body, depth: float = SKIN_DEPTH) -> Floats:
    """Return the share of the skin's contrast at every quadrature point, (n_elements, n_points).

    ψ = (e^(−d/ℓ) − m)/(1 − m), d the depth under the nearest exposed face and m the volume mean
    of e^(−d/ℓ): ψ is 1 on the face, and its volume mean is 0. Since ln C is nearly linear in the
    degradation rate, ln C(x) = ln C + skin · ψ keeps the volume mean of the degradation rate.

    Parameters
    ----------
    body : Body
        With the depth of its quadrature points.
    depth : float
        Decay length ℓ [mm].

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> float(np.abs(skin_profile(box((1.0, 1.0, 1.0), divisions=(1, 1, 1)))).max())
    0.0
    """
    decay = np.exp(-body.depth / depth)
    mean = float(np.sum(decay * body.weights) / np.sum(body.weights))
    profile: Floats = (decay - mean) / (1.0 - mean)
    return profile
