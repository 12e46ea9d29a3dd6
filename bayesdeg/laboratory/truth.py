"""The hidden truth of a virtual experiment: material, effects and specimens."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.actuator.inputs import PAPER_THICKNESS
from bayesdeg.causes.catalogue import find, in_order
from bayesdeg.causes.cause import Cause, Effect
from bayesdeg.data.uncertain import PREFIX
from bayesdeg.errors import BayesdegError, nearest
from bayesdeg.material.degradation import NODES, derivative, is_stable, yeoh_constants
from bayesdeg.material.strength import ScatterLaw, limit_stretch, scores_from_normal
from bayesdeg.observations.noise import INDEPENDENT
from bayesdeg.observations.specimens import node_name
from bayesdeg.priors import Parameter

Floats = npt.NDArray[np.float64]
Three = tuple[float, float, float]

TRUTH_NODES = NODES[2]
LEAST_MIDDLE = (0.1, 0.003)  # lower bounds of the middle Bernstein coefficients of C1 and C3 [MPa]
LARGEST_SHARE = 0.8  # of |C2|'s over √(3 C1 C3), likewise: C2 from −1 on is unstable
FARTHEST = 5.0  # size of an effect over the 99.8 % range of its prior
LARGEST_DEGRADATION = 30.0  # 25 % recorded, plus its error and a misreading [%]


@dataclass(frozen=True)
class Truth:
    r"""A material with its scatter and reading errors.

    The defaults agree with the published statistics: Young's modulus 6 C1 of 1.73 MPa fresh and
    5.5 times that at 25 %, elongation at break 209.8 % fresh and a quarter of it at 25 %, volume
    ratio 0.62. C2 and C3 are unpublished; they are assumed, stable and with negative C2.

    Parameters
    ----------
    c1, c2_ratio, c3 : tuple of float
        C1 [MPa], :math:`C_2/\sqrt{3 C_1 C_3}` and C3 [MPa] at D_R = 0, 12.5 and 25 %.
    elongation : tuple of float
        Median elongation at break at the same degradation rates [%].
    elongation_scatter : float
        Standard deviation of the log elongation at break between specimens.
    stiffness_scatter : float
        Standard deviation of ln stiffness between specimens.
    degradation_sd : float
        Standard error of the degradation rate of a degraded specimen, if the design states none
        [%].
    volume_ratio, volume_ratio_scatter : float
        α, and its standard deviation between films.
    paper_stiffness : float
        Et of the paper [N/m].
    paper_thickness : float
        Thickness of the paper, which gives its bending stiffness [mm].
    curvature_noise_floor, curvature_noise : float
        Reading error of the curvature: constant [1/m] and proportional, added in quadrature.
    bend_angle_noise_floor, bend_angle_noise : float
        The same for the bend angle [°]; the constant one is 0.1 1/m over a length of 43 mm.
    volume_noise_floor, volume_noise : float
        The same for the cavity volume [ml]: half a graduation of a syringe of 1 ml.
    force_gain : float
        Blocked tip force read by the load cell over the true force [–].
    force_noise_floor, force_noise : float
        Reading error of that force [N]: load cells for 1 N resolve some millinewtons.
    tensile_noise_floor, tensile_noise : float
        The same for the stress [MPa].
    curvature_noise_length, tensile_noise_length : float
        Correlation length of reading errors along the path of pressure [kPa] and of stretch [–];
        the former also for bend angle, volume and tip force; 0 if errors are independent.
    reading_correlation : float
        Correlation of the errors of curvature and bend angle read from one picture.
    degradation_limit, time_constant : float
        D_∞ [%] and τ [h] of D_R = D_∞ (1 − exp(−t/τ)).
    dimensions : mapping of str to float
        Dimensions of the moulded actuator that a study leaves uncertain [mm].
    moisture_initial, moisture_scatter : float
        Wet-basis moisture content of undegraded films, and its standard deviation between films
        [%].

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
    volume_noise_floor: float = 0.005
    volume_noise: float = 0.02
    force_gain: float = 1.0
    force_noise_floor: float = 0.002
    force_noise: float = 0.02
    tensile_noise_floor: float = 0.005
    tensile_noise: float = 0.02
    curvature_noise_length: float = 0.0
    tensile_noise_length: float = 0.0
    reading_correlation: float = 0.0
    degradation_limit: float = 30.5
    time_constant: float = 14.0
    moisture_initial: float = 20.0
    moisture_scatter: float = 0.3
    dimensions: Mapping[str, float] = field(default_factory=dict, hash=False)

    def constants(self, degradation: npt.ArrayLike) -> Floats:
        """Return C1, C2, C3 [MPa] at degradation rates (n,) [%], shape (n, 3)."""
        found = yeoh_constants(self.c1, self.c2_ratio, self.c3, degradation, TRUTH_NODES)
        return np.stack(found, axis=-1)

    def limit_stretch(self, degradation: npt.ArrayLike) -> Floats:
        """Return the median stretch at break at degradation rates (n,) [%]."""
        elongation = np.asarray(self.elongation) / 100.0
        return limit_stretch(np.log(elongation), degradation, TRUTH_NODES)

    def elongation_slope(self, degradation: npt.ArrayLike) -> Floats:
        """Return d ln ε/dD_R of the median elongation at break at degradation rates (n,) [1/%]."""
        return derivative(np.log(self.elongation), degradation, TRUTH_NODES)

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
        """Return whether calibration trends can represent the constants.

        Those trends are quadratics whose Bernstein coefficients keep C1 and C3 positive and the
        material stable. Other stable materials would cause a misfit due to the trend.
        """
        c1, c3 = np.array(self.c1), np.array(self.c3)
        c2 = np.array(self.c2_ratio) * np.sqrt(3.0 * c1 * c3)
        first, second, third = (2.0 * c[1] - 0.5 * (c[0] + c[2]) for c in (c1, c2, c3))
        if first < LEAST_MIDDLE[0] or third < LEAST_MIDDLE[1]:
            return False
        return bool(abs(second) < LARGEST_SHARE * np.sqrt(3.0 * first * third))

    def named(self) -> dict[str, float]:
        """Return every value by the name of the corresponding calibrated parameter.

        Examples
        --------
        >>> Truth().named()["c1_at_12_5"]
        0.78
        """
        named: dict[str, float] = {}
        for name, value in asdict(self).items():
            if name == "dimensions":
                named |= {f"{PREFIX}{size}": mm for size, mm in value.items()}
            elif isinstance(value, tuple):
                pairs = zip(TRUTH_NODES, value, strict=True)
                named |= {node_name(name, node): at_node for node, at_node in pairs}
            else:
                named[name] = value
        return named


def drawn_truth(generator: np.random.Generator) -> Truth:
    """Draw a truth about the reference; redraw materials unstable or beyond the trends.

    Standard deviations: 0.15 of ln C1 and 0.25 of ln C3 at each node, 0.05 of the ratio of C2 at
    each node, 0.04 of the volume ratio, 0.4 of the log stiffness of the paper. A third is redrawn,
    which leaves 0.21 of ln C3 at 12.5 and 25 %, and shifts its mean there by ±0.1.

    Examples
    --------
    >>> drawn_truth(np.random.default_rng(1)).is_stable()
    True
    """
    centre = Truth()
    while True:
        z = generator.standard_normal(11)
        truth = replace(
            centre,
            c1=_three(np.array(centre.c1) * np.exp(0.15 * z[0:3])),
            c2_ratio=_three(np.array(centre.c2_ratio) + 0.05 * z[3:6]),
            c3=_three(np.array(centre.c3) * np.exp(0.25 * z[6:9])),
            volume_ratio=float(centre.volume_ratio + 0.04 * z[9]),
            paper_stiffness=float(centre.paper_stiffness * np.exp(0.4 * z[10])),
        )
        if truth.is_stable() and truth.is_within_trends():
            return truth


def _three(values: Floats) -> Three:
    first, second, third = values.tolist()
    return first, second, third


@dataclass(frozen=True)
class HiddenEffect:
    """A cause with values for all its parameters.

    Parameters
    ----------
    cause : Cause
        The acting cause.
    values : mapping of str to float
        By the parameters' short names, each in its unit.
    """

    cause: Cause
    values: Mapping[str, float]

    @property
    def effect(self) -> Effect:
        """The values as needed by the hooks of the cause, for a single walker."""
        named = {self.cause.qualified(name): np.array([v]) for name, v in self.values.items()}
        return self.cause.effect(named)


def parse_effect(text: str) -> tuple[Cause, dict[str, float]]:
    """Read an effect from the command line.

    Parameters
    ----------
    text : str
        ``cause=value`` for the first parameter of the cause, its size, or
        ``cause.parameter=value``.

    Returns
    -------
    cause : Cause
    values : dict of str to float
        Only the values given.

    Raises
    ------
    BayesdegError
        If the cause or parameter is unknown, or the value is not a number or impossible; the
        message says what would be right.

    Examples
    --------
    >>> cause, values = parse_effect("pressure_offset=14")
    >>> cause.name, values
    ('pressure_offset', {'offset': 14.0})
    >>> parse_effect("degradation_misread.shft=3")
    Traceback (most recent call last):
    ...
    bayesdeg.errors.BayesdegError: degradation_misread has no parameter 'shft'; did you mean 'shift'?
    """  # noqa: E501
    target, equals, value = (part.strip() for part in text.partition("="))
    name, dot, short = target.partition(".")
    cause = find(name)
    by_name = {parameter.name: parameter for parameter in cause.parameters}
    if dot and short not in by_name:
        best = nearest(short, list(by_name))
        hint = f"did you mean {best!r}?" if best else f"it has {', '.join(by_name)}"
        raise BayesdegError(f"{cause.name} has no parameter {short!r}; {hint}")
    parameter = by_name[short] if dot else cause.parameters[0]
    if not equals:
        example = f"{target}={cause.typical[parameter.name]:g}"
        raise BayesdegError(f"{text!r} gives no value; write for example {example}")
    return cause, {parameter.name: _number(value, cause, parameter)}


def parse_effects(texts: Iterable[str]) -> tuple[HiddenEffect, ...]:
    """Read all effects of a command line; omitted parameters are neutral.

    Parameters
    ----------
    texts : iterable of str
        As in `parse_effect`; several may give parameters of the same cause.

    Returns
    -------
    tuple of HiddenEffect
        In the order in which causes are applied.

    Raises
    ------
    BayesdegError
        As in `parse_effect`, or if a parameter is given twice.

    Examples
    --------
    >>> [hidden] = parse_effects(["degradation_misread.scatter=1"])
    >>> hidden.values
    {'shift': 0.0, 'scatter': 1.0}
    """
    causes: dict[str, Cause] = {}
    given: dict[str, dict[str, float]] = {}
    for text in texts:
        cause, values = parse_effect(text)
        causes[cause.name] = cause
        before = given.setdefault(cause.name, {})
        for twice in before.keys() & values.keys():
            raise BayesdegError(f"{cause.qualified(twice)} is given twice; give it once")
        before |= values
    return tuple(
        HiddenEffect(
            cause,
            {p.name: given[cause.name].get(p.name, p.neutral or 0.0) for p in cause.parameters},
        )
        for cause in in_order(causes.values())
    )


def _number(text: str, cause: Cause, parameter: Parameter) -> float:
    name, unit = cause.qualified(parameter.name), parameter.unit
    example = f"give a number [{unit}], for example {cause.typical[parameter.name]:g}"
    try:
        value = float(text)
    except ValueError:
        raise BayesdegError(f"{name}: {text!r} is not a number; {example}") from None
    if not math.isfinite(value) or not parameter.law.allows(value):
        raise BayesdegError(f"{name}: {text} is impossible under {parameter.law}; {example}")
    low, middle, high = (float(parameter.law.quantile(q)) for q in (0.001, 0.5, 0.999))
    least, most = middle - FARTHEST * (middle - low), middle + FARTHEST * (high - middle)
    if value != parameter.neutral and not least <= value <= most:
        raise BayesdegError(
            f"{name}: {text} is far beyond the prior's range {low:.3g} to {high:.3g}; {example}"
        )
    return value


def draw_specimens(
    names: pd.Series,
    truth: Truth,
    *,
    degradation: Floats,
    sd: Floats,
    generator: np.random.Generator,
    law: ScatterLaw = "lognormal",
) -> pd.DataFrame:
    r"""Draw the true specimens.

    .. math:: D = D_{believed} + \sigma_D z_1, \quad \ln(C/C(D)) = \sigma_C z_2, \quad
        \ln(\varepsilon_b/\varepsilon_b(D)) = \sigma_\varepsilon z_3

    Parameters
    ----------
    names : pandas.Series of str, length n
        The specimens.
    truth : Truth
        Material and scatter.
    degradation, sd : array, shape (n,)
        Recorded degradation rate and its standard error [%].
    law : str
        Scatter law of the elongation at break; for Weibull's, z₃ is not normal.

    Returns
    -------
    pandas.DataFrame
        By ``specimen_id``: ``degradation_pct`` [%], ``ln_stiffness`` (deviation from the material's
        mean), ``limit_stretch`` at which it breaks.

    Examples
    --------
    >>> fresh = draw_specimens(
    ...     pd.Series(["a"]), Truth(stiffness_scatter=0.0, elongation_scatter=0.0),
    ...     degradation=np.zeros(1), sd=np.zeros(1), generator=np.random.default_rng(0),
    ... )
    >>> round(float(fresh.loc["a", "limit_stretch"]), 3)
    3.098
    """
    z = generator.standard_normal((3, len(names)))
    true = degradation + sd * z[0]
    score = scores_from_normal(z[2], law)
    elongation = (truth.limit_stretch(true) - 1.0) * np.exp(truth.elongation_scatter * score)
    return pd.DataFrame(
        {
            "degradation_pct": true,
            "ln_stiffness": truth.stiffness_scatter * z[1],
            "limit_stretch": 1.0 + elongation,
        },
        index=pd.Index(names, name="specimen_id"),
    )


def constants_of(specimens: pd.DataFrame, truth: Truth) -> Floats:
    """Return C1, C2, C3 [MPa] of each specimen, shape (n, 3)."""
    factor = np.exp(specimens["ln_stiffness"].to_numpy())
    return truth.constants(specimens["degradation_pct"].to_numpy()) * factor[:, None]


def stated_sd(table: pd.DataFrame, truth: Truth) -> Floats:
    """Return the standard error of the degradation rate on each row [%].

    If the table states none it is the truth's; fresh specimens were never buried and have no
    error.
    """
    assumed = np.where(table["degradation_pct"] > 0.0, truth.degradation_sd, 0.0)
    return np.where(table["degradation_sd_pct"].isna(), assumed, table["degradation_sd_pct"])


def noise(value: Floats, z: Floats, *, floor: float | Floats, share: float) -> Floats:
    r"""Return reading errors with standard deviation :math:`\sqrt{f^2 + (s v)^2}`."""
    return np.hypot(floor, share * value) * z


def correlate_along(place: Floats, z: Floats, *, specimen: npt.ArrayLike, length: float) -> Floats:
    r"""Correlate independent normals along each specimen's path, like reading errors.

    The correlation of two readings i ≠ j of a specimen is (1 − w) exp(−|s_i − s_j|/ℓ), by the
    Cholesky factor of their covariance; w is `bayesdeg.observations.noise.INDEPENDENT`.

    Parameters
    ----------
    place : array, shape (n,)
        s, length of path up to each reading.
    z : array, shape (n,)
        Independent standard normals.
    specimen : array_like, shape (n,)
        Specimen of each reading.
    length : float
        ℓ, in the unit of s; at 0 the normals are unchanged.

    Examples
    --------
    >>> at, z = np.array([0.0, 1e9]), np.array([1.0, 3.0])
    >>> correlate_along(at, z, specimen=["a", "a"], length=1.0).round(3).tolist()
    [1.0, 3.0]
    """
    if length == 0.0:
        return z
    alike = np.empty_like(z)
    owner, names = pd.factorize(np.asarray(specimen))
    for k in range(len(names)):
        rows = np.flatnonzero(owner == k)
        rows = rows[np.argsort(place[rows], kind="stable")]
        distance = np.abs(place[rows, None] - place[rows])
        common = (1.0 - INDEPENDENT) * np.exp(-distance / length)
        alike[rows] = np.linalg.cholesky(common + INDEPENDENT * np.eye(len(rows))) @ z[rows]
    return alike


def significant(values: Floats, digits: int) -> Floats:
    """Round to significant digits.

    Examples
    --------
    >>> significant(np.array([0.00123456, 0.0, 12.3456]), 3).tolist()
    [0.00123, 0.0, 12.3]
    """
    return np.array([float(f"{value:.{digits}g}") for value in values])
