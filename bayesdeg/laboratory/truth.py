"""What nobody in a virtual experiment knows: the material, its scatter, the errors of reading."""

from dataclasses import asdict, dataclass, replace

import numpy as np
import numpy.typing as npt

from bayesdeg.actuator.inputs import PAPER_THICKNESS
from bayesdeg.inference.parameters import node_name
from bayesdeg.material.degradation import NODES, is_stable, yeoh_constants
from bayesdeg.material.strength import limit_stretch

Floats = npt.NDArray[np.float64]
Three = tuple[float, float, float]

TRUTH_NODES = NODES[2]
LEAST_MIDDLE = (0.1, 0.003)  # of the middle Bernstein coefficients of C1 and C3 [MPa]
LARGEST_SHARE = 0.8  # of that of C2 over √(3 C1 C3): from −1 on the material is unstable
LARGEST_DEGRADATION = 30.0  # recorded 25 %, its error, and a misreading on top [%]


@dataclass(frozen=True)
class Truth:
    r"""A material with its scatter, and the errors with which it is read.

    The defaults agree with the published statistics: Young's modulus 6 C1 of 1.73 MPa fresh and
    5.5 times that at 25 %, elongation at break 209.8 % fresh and a quarter of it at 25 %, volume
    ratio 0.62. C2 and C3 have not been published; theirs are assumed, stable and negative in C2.

    Parameters
    ----------
    c1, c2_ratio, c3 : tuple of float
        C1 [MPa], :math:`C_2/\sqrt{3 C_1 C_3}` and C3 [MPa] at D_R = 0, 12.5 and 25 %.
    elongation : tuple of float
        Median elongation at break at the same degradation rates [%].
    elongation_scatter : float
        Standard deviation of the log elongation at break from specimen to specimen.
    stiffness_scatter : float
        Standard deviation of ln stiffness from specimen to specimen.
    degradation_sd : float
        Standard error of the degradation rate of a degraded specimen, where the design states
        none [%].
    volume_ratio, volume_ratio_scatter : float
        α, and its standard deviation from film to film.
    paper_stiffness : float
        Et of the paper [N/m].
    paper_thickness : float
        From which its bending stiffness follows [mm].
    curvature_noise_floor, curvature_noise : float
        Reading error of the curvature: constant [1/m] and proportional, added in quadrature.
    bend_angle_noise_floor, bend_angle_noise : float
        The same of the bend angle [°]; the constant one is 0.1 1/m over a length of 43 mm.
    tensile_noise_floor, tensile_noise : float
        The same of the stress [MPa].
    curvature_noise_length, tensile_noise_length : float
        Path of pressure [kPa] and of stretch [–] along which reading errors stay alike, those of
        the bend angle as those of the curvature; 0 if they are independent.
    reading_correlation : float
        Correlation of the errors of curvature and bend angle that are read from one picture.
    degradation_limit, time_constant : float
        D_∞ [%] and τ [h] of D_R = D_∞ (1 − exp(−t/τ)).
    moisture_initial, moisture_scatter : float
        Wet-basis moisture content of undegraded films, and its standard deviation from film to
        film [%].

    References
    ----------
    Nagai, Kurita, Shintake (2021), Front. Robot. AI 8:760485; doi:10.3389/frobt.2021.760485.

    Examples
    --------
    >>> [round(6.0 * float(Truth().constants([level])[0, 0]), 2) for level in (0.0, 25.0)]
    [1.73, 9.53]
    """

    c1: Three = (0.288, 0.78, 1.588)
    c2_ratio: Three = (-0.10, -0.15, -0.20)
    c3: Three = (0.003, 0.035, 0.1175)
    elongation: Three = (209.8, 105.0, 52.0)
    elongation_scatter: float = 0.05
    stiffness_scatter: float = 0.04
    degradation_sd: float = 0.5
    volume_ratio: float = 0.62
    volume_ratio_scatter: float = 0.05
    paper_stiffness: float = 3e4
    paper_thickness: float = PAPER_THICKNESS
    curvature_noise_floor: float = 0.1
    curvature_noise: float = 0.02
    bend_angle_noise_floor: float = 0.25
    bend_angle_noise: float = 0.02
    tensile_noise_floor: float = 0.005
    tensile_noise: float = 0.02
    curvature_noise_length: float = 0.0
    tensile_noise_length: float = 0.0
    reading_correlation: float = 0.0
    degradation_limit: float = 30.5
    time_constant: float = 14.0
    moisture_initial: float = 20.0
    moisture_scatter: float = 0.3

    def constants(self, degradation: npt.ArrayLike) -> Floats:
        """Return C1, C2, C3 [MPa] at degradation rates (n,) [%], shape (n, 3)."""
        found = yeoh_constants(self.c1, self.c2_ratio, self.c3, degradation, TRUTH_NODES)
        return np.stack(found, axis=-1)

    def limit_stretch(self, degradation: npt.ArrayLike) -> Floats:
        """Return the median stretch at break at degradation rates (n,) [%]."""
        elongation = np.asarray(self.elongation) / 100.0
        return limit_stretch(np.log(elongation), degradation, TRUTH_NODES)

    def is_stable(self) -> bool:
        """Return whether the material is stable up to a degradation rate of 30 %."""
        return bool(
            is_stable(
                self.c1,
                self.c2_ratio,
                self.c3,
                largest_degradation=LARGEST_DEGRADATION,
                nodes=TRUTH_NODES,
            )
        )

    def is_within_trends(self) -> bool:
        """Return whether the trends of a calibration pass through the constants.

        Those are quadratics whose Bernstein coefficients keep C1 and C3 positive and the material
        stable. Other stable materials exist, but a misfit to them would be that of the trend.
        """
        c1, c3 = np.array(self.c1), np.array(self.c3)
        c2 = np.array(self.c2_ratio) * np.sqrt(3.0 * c1 * c3)
        first, second, third = (2.0 * c[1] - 0.5 * (c[0] + c[2]) for c in (c1, c2, c3))
        if first < LEAST_MIDDLE[0] or third < LEAST_MIDDLE[1]:
            return False
        return bool(abs(second) < LARGEST_SHARE * np.sqrt(3.0 * first * third))

    def named(self) -> dict[str, float]:
        """Return every value by the name that a calibrated parameter of the like meaning has.

        Examples
        --------
        >>> Truth().named()["c1_at_12_5"]
        0.78
        """
        named: dict[str, float] = {}
        for name, value in asdict(self).items():
            if isinstance(value, tuple):
                pairs = zip(TRUTH_NODES, value, strict=True)
                named |= {node_name(name, node): at_node for node, at_node in pairs}
            else:
                named[name] = value
        return named


def drawn_truth(generator: np.random.Generator) -> Truth:
    """Draw a truth about the reference; materials unstable or beyond all trends are drawn anew.

    Standard deviations: 0.15 of ln C1 and 0.25 of ln C3 at each node, 0.05 of the ratio of C2 at
    each node, 0.04 of the volume ratio, 0.4 of the log stiffness of the paper. A third is drawn
    anew, which leaves 0.21 of ln C3 at 12.5 and 25 %, and moves its mean there by ±0.1.

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    Truth

    Examples
    --------
    >>> drawn_truth(np.random.default_rng(1)).is_stable()
    True
    """
    while True:
        truth = _draw(generator)
        if truth.is_stable() and truth.is_within_trends():
            return truth


def _draw(generator: np.random.Generator) -> Truth:
    z = generator.standard_normal(11)
    centre = Truth()
    return replace(
        centre,
        c1=_three(np.array(centre.c1) * np.exp(0.15 * z[0:3])),
        c2_ratio=_three(np.array(centre.c2_ratio) + 0.05 * z[3:6]),
        c3=_three(np.array(centre.c3) * np.exp(0.25 * z[6:9])),
        volume_ratio=float(centre.volume_ratio + 0.04 * z[9]),
        paper_stiffness=float(centre.paper_stiffness * np.exp(0.4 * z[10])),
    )


def _three(values: Floats) -> Three:
    first, second, third = values.tolist()
    return first, second, third
