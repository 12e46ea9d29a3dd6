"""The world of films and actuators: from parameters to a material, its scatter and limits."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.demand import demanded, scatter_law
from bayesdeg.actuator.inputs import PAPER_THICKNESS, ForwardMap, Inputs, Prediction, continuation
from bayesdeg.actuator.status import Status
from bayesdeg.causes.cause import Cause, FilmConditions, Stage
from bayesdeg.causes.fold import acting, applied
from bayesdeg.data.settings import MaterialLaw, RuptureCriterion
from bayesdeg.data.uncertain import PREFIX
from bayesdeg.material import degradation as rates
from bayesdeg.material.degradation import (
    Controls,
    Nodes,
    bernstein_slopes,
    bernstein_weights,
    constants,
    satisfies_baker_ericksen,
)
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.material.strength import ScatterLaw
from bayesdeg.priors import (
    Distribution,
    HalfNormal,
    LogNormal,
    Named,
    Parameter,
    TruncatedNormal,
    Uniform,
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Medians follow the published moduli (6 C1 = 1.73 MPa fresh, about 5.5 times that at 25 %) and
# break elongations (210 % and about 52 %); doi:10.3389/frobt.2021.760485. Values between the ends
# are control values: they contribute half of the value at 12.5 %.
_C1 = {
    0.0: LogNormal(0.3, 0.4),
    25.0 / 3.0: LogNormal(0.5, 0.6),
    12.5: LogNormal(0.6, 0.6),
    50.0 / 3.0: LogNormal(0.9, 0.6),
    25.0: LogNormal(1.5, 0.6),
}
_C3 = {
    0.0: LogNormal(1.5e-3, 1.0),
    25.0 / 3.0: LogNormal(6e-3, 1.5),
    12.5: LogNormal(1e-2, 1.5),
    50.0 / 3.0: LogNormal(4e-2, 1.5),
    25.0: LogNormal(0.1, 1.2),
}
_RATIO_AT_ENDS = TruncatedNormal(-0.15, 0.25, -0.65, 0.6)
_RATIO_BETWEEN = TruncatedNormal(-0.15, 0.4, -0.9, 1.5)
_ELONGATION = {0.0: LogNormal(200.0, 0.5), 12.5: LogNormal(110.0, 0.6), 25.0: LogNormal(50.0, 0.6)}


_STEP = 5e-4
_STENCIL = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * _STEP)
_AROUND_ONE = 1.0 + _STEP * np.array([-2.0, -1.0, 1.0, 2.0])
"""Stretches about 1, and weights of stresses there that give the slope to 1e-11."""


@cache
def node_name(quantity: str, node: float) -> str:
    """Return a parameter's name at a node of D_R.

    Examples
    --------
    >>> node_name("c1", 12.5)
    'c1_at_12_5'
    """
    return f"{quantity}_at_{node:g}".replace(".", "_")


@cache
def control_name(quantity: str, nodes: Nodes, k: int) -> str:
    """Return the name of a constant's control value: value at the ends, control point between.

    Examples
    --------
    >>> [control_name("c1", (0.0, 12.5, 25.0), k) for k in range(3)]
    ['c1_at_0', 'c1_control_12_5', 'c1_at_25']
    """
    if k in (0, len(nodes) - 1):
        return node_name(quantity, nodes[k])
    return f"{quantity}_control_{nodes[k]:.3g}".replace(".", "_")


def material_parameters(
    nodes: Nodes, *, degrades: bool = True, law: MaterialLaw = "yeoh"
) -> tuple[Parameter, ...]:
    """Return the parameters of Yeoh's constants against D_R: their Bernstein control values.

    A neo-Hookean solid has only those of C1.

    Examples
    --------
    >>> [p.meaning for p in material_parameters((0.0,), degrades=False)][::2]
    ['C1', 'C3']
    >>> [p.name for p in material_parameters((0.0,), law="neo_hookean")]
    ['c1_at_0']
    """
    parameters: list[Parameter] = []
    for k, node in enumerate(nodes):
        at_end = k in (0, len(nodes) - 1)
        place = f"at a degradation rate of {node:.3g} %"
        where = f", {place}" if at_end else f", control value {place}, between the ends"
        where = where if degrades else ""
        ratio = _RATIO_AT_ENDS if at_end else _RATIO_BETWEEN
        parameters.append(
            Parameter(control_name("c1", nodes, k), _nearest(_C1, node), "MPa", f"C1{where}")
        )
        if law == "neo_hookean":
            continue
        parameters += [
            Parameter(
                control_name("c2_ratio", nodes, k),
                ratio,
                "–",
                f"C2/sqrt(3 C1 C3){where}; the material is stable above −1",
            ),
            Parameter(control_name("c3", nodes, k), _nearest(_C3, node), "MPa", f"C3{where}"),
        ]
    return tuple(parameters)


def elongation_parameters(nodes: Nodes, *, degrades: bool = True) -> tuple[Parameter, ...]:
    """Return the parameters of the elongation at break against D_R."""
    where = " at a degradation rate of {:g} %" if degrades else ""
    return (
        *(
            Parameter(
                node_name("elongation", node),
                _nearest(_ELONGATION, node),
                "%",
                f"median elongation at break{where.format(node)}",
            )
            for node in nodes
        ),
        Parameter("elongation_scatter", HalfNormal(0.2), "–", "sd of ln elongation at break"),
    )


LEAST_STIFFENING = 1.0 / 1500.0
"""C3/C1 of a neo-Hookean solid in predictions of actuators: emulators cover stiffening solids only,
with C3/M from 4e-4 on. It raises the stress by 0.8 % at a stretch of 2 and 0.07 % at 1.5."""


STIFFNESS_SCATTER = Parameter(
    "stiffness_scatter", HalfNormal(0.1), "–", "sd of ln stiffness between specimens"
)


COURSE = (
    # 10 to 30 % moisture agrees with the published volume ratio
    Parameter("fresh_moisture", LogNormal(20.0, 0.4), "%", "moisture content before degradation"),
    # a film cannot lose more than all of its moisture
    Parameter(
        "degradation_limit", Uniform(0.0, 100.0), "%", "limit of the degradation rate over time"
    ),
    # the source followed its films over a day
    Parameter(
        "degradation_time_constant",
        LogNormal(12.0, 1.0),
        "h",
        "time after which 63 % of the limit is reached",
    ),
    # a tenth of the fresh moisture
    Parameter("moisture_scatter", HalfNormal(2.0), "%", "sd of moisture content between films"),
)
"""Parameters of the course of degradation in films, see `bayesdeg.inference.course`."""


def _nearest(laws: Mapping[float, Distribution], node: float) -> Distribution:
    return laws[min(laws, key=lambda known: abs(known - node))]


class Material(NamedTuple):
    """The median material at the specimens' degradation rates.

    Parameters
    ----------
    constants : array, shape (n, S, 3)
        Yeoh's C1, C2, C3 [MPa].
    slope : array, shape (n, S, 3)
        Their derivatives with respect to D_R [MPa/%].
    """

    constants: Floats
    slope: Floats

    @property
    def sensitivity(self) -> Floats:
        """Return d ln C1/dD_R [1/%], (n, S)."""
        sensitivity: Floats = self.slope[..., 0] / self.constants[..., 0]
        return sensitivity


def shared(degradation: Floats) -> Floats:
    """Return degradation rates (n, S) as (S,) if they are one row broadcast over draws.

    Results that depend on them alone are then computed once.

    Examples
    --------
    >>> shared(np.broadcast_to([0.0, 25.0], (3, 2))).tolist()
    [0.0, 25.0]
    """
    one = len(degradation) > 0 and degradation.strides[0] == 0
    return degradation[0] if one else degradation


PAPER_STIFFNESS = "paper_stiffness"
#: Every model of actuators has one of these parameters: without paper the first is missing, for tip
#: forces alone the second.
OF_ACTUATORS = frozenset({PAPER_STIFFNESS, "curvature_noise"})


def linear_scale(values: Named) -> Floats:
    """Return the length of the part over that of its mould, (n,).

    It is α^(1/3), and exactly 1 if α is not a parameter: the part is then not known to shrink.

    Examples
    --------
    >>> linear_scale({"volume_ratio": np.array([0.125])}).round(6).tolist()
    [0.5]
    >>> linear_scale({"stiffness_scatter": np.array([0.1])}).tolist()
    [1.0]
    """
    if "volume_ratio" not in values:
        return np.ones(len(values["stiffness_scatter"]))
    scale: Floats = np.cbrt(values["volume_ratio"])
    return scale


def layer_stiffness(values: Named) -> Floats:
    """Return E t of the paper or film, (n,) [N/m].

    It is 0 if it is not a parameter: the actuator then has an elastomer layer, or none.

    Examples
    --------
    >>> layer_stiffness({"stiffness_scatter": np.array([0.1])}).tolist()
    [0.0]
    """
    if PAPER_STIFFNESS not in values:
        return np.zeros(len(values["stiffness_scatter"]))
    return values[PAPER_STIFFNESS]


def elongation_spread(values: Named, slope: Floats, sd: Floats) -> Floats:
    """Return the variance of ln elongation at break of specimens, shape (n, S).

    σ² + (d ln ε/dD_R · sd(D_R))²: scatter, and the error of the degradation rate. The slope, (n, S)
    [1/%], is from `FilmsAndActuators.elongation_slope`.
    """
    spread: Floats = values["elongation_scatter"][:, None] ** 2 + (slope * sd) ** 2
    return spread


def no_map(inputs: Inputs) -> Prediction:
    """Raise an error: the forward map of a world without actuators."""
    raise ValueError("a model without actuators has no forward map")


@dataclass(frozen=True)
class FilmsAndActuators:
    """The common model of films and actuators: the material, and the forward map of actuators.

    Parameters
    ----------
    nodes, elongation_nodes : tuple of float
        Nodes of the constants and of the elongation, degradation rates [%].
    forward : ForwardMap
        Needed to predict actuators.
    paper_thickness : float
        Paper thickness of the actuators [mm].
    largest_pressure : float
        Pressure that scales the emulator's common error [kPa].
    criterion : str
        Measure of a wall's state compared with the films' elongation at break, see
        `bayesdeg.actuator.demand`.
    size_ratio : float
        Volume of the actuator as moulded over that of a tested film, for the weakest
        link [–].
    degrades : bool
        Whether anything in the study degrades, see `bayesdeg.data.study.Study.degrades`.
    law : {"yeoh", "neo_hookean"}
        Which constants are parameters.
    stiffening : float
        C3/C1 of a neo-Hookean solid: 0, and `LEAST_STIFFENING` where actuators are predicted.
    dimensions : tuple of str
        Dimensions of the actuators that are parameters.
    """

    nodes: Nodes
    elongation_nodes: Nodes = (0.0,)
    forward: ForwardMap = no_map
    paper_thickness: float = PAPER_THICKNESS
    largest_pressure: float = 240.0
    criterion: RuptureCriterion = "principal_stretch"
    size_ratio: float = 1.0
    degrades: bool = True
    law: MaterialLaw = "yeoh"
    stiffening: float = 0.0
    dimensions: tuple[str, ...] = ()

    @property
    def is_limited(self) -> bool:
        """Whether allowed parameters may have no solution."""
        return True

    @property
    def is_factored(self) -> bool:
        """Whether densities without data provide their factors."""
        return True

    @property
    def continued(self) -> "FilmsAndActuators":
        """The same world with an extrapolating forward map, if possible."""
        return replace(self, forward=continuation(self.forward))

    def sizes(self, values: Named) -> dict[str, Floats] | None:
        """Return the dimensions that are parameters, each (n, 1, 1) [mm]; None without any."""
        found = {name: values[f"{PREFIX}{name}"][:, None, None] for name in self.dimensions}
        return found or None

    @property
    def scatter_law(self) -> ScatterLaw:
        """Scatter law of the elongation at break between specimens."""
        return scatter_law(self.criterion)

    def answer(self, inputs: Inputs, values: Named) -> Prediction:
        """Evaluate the forward map, with the peak stretch as defined by the criterion."""
        if self.criterion == "principal_stretch":
            return self.forward(inputs)
        scatter = values["elongation_scatter"][:, None, None]
        return demanded(
            self.forward, inputs, self.criterion, scatter=scatter, size_ratio=self.size_ratio
        )

    def check(self, causes: tuple[Cause, ...]) -> None:
        """Refuse no cause: each acts on something of films or actuators."""

    def watched(self, read: Flags, report: Callable[[Flags], None]) -> "FilmsAndActuators":
        """Return the same world with a forward map that reports which vectors it refused, (n,).

        Parameters
        ----------
        read : array of bool
            Where there are readings; other refusals do not count.
        report : callable
            Called at every evaluation.
        """
        forward = self.continued.forward

        def answer(inputs: Inputs) -> Prediction:
            prediction = forward(inputs)
            if prediction.status.shape[-2:] == read.shape:  # else evaluated for different tests
                refused = (prediction.status == Status.OUTSIDE_TRAINING) & read
                report(np.any(refused, axis=(-2, -1)))
            return prediction

        return replace(self, forward=answer)

    def allows(self, values: Named, levels: Floats) -> Flags:
        """Return whether the material is stable at every degradation rate of the specimens, (n,).

        Up to the last node it is stable by construction.
        """
        beyond = np.unique(levels)
        beyond = beyond[beyond > self.nodes[-1]]
        if not beyond.size:
            return np.ones(len(values["stiffness_scatter"]), dtype=bool)
        c1, c2, c3 = np.moveaxis(self.constants(values, beyond), -1, 0)
        stiffens = (c3 > 0.0) | (self.law == "neo_hookean")
        return np.asarray(np.all(stiffens & satisfies_baker_ericksen(c1, c2, c3), axis=-1))

    def _controls(self, values: Named) -> Controls:
        """Return the control values of the constants, each (n, n_nodes).

        Without C2 and C3 the solid is neo-Hookean: C2 = 0, and C3 is a share of C1.
        """
        given = ("c1", "c2_ratio", "c3") if control_name("c3", self.nodes, 0) in values else ("c1",)
        found = [
            np.stack(
                [values[control_name(name, self.nodes, k)] for k in range(len(self.nodes))], axis=-1
            )
            for name in given
        ]
        if len(found) == 1:
            found += [np.zeros_like(found[0]), self.stiffening * found[0]]
        return Controls(*found)

    def constants(self, values: Named, degradation: Floats) -> Floats:
        """Return C1, C2, C3 [MPa] at degradation rates (S,) or (n, S), shape (n, S, 3)."""
        return constants(self._controls(values), bernstein_weights(degradation, self.nodes))

    def material(self, values: Named, degradation: Floats) -> Material:
        """Return the median material at degradation rates (S,) or (n, S)."""
        controls = self._controls(values)
        return Material(
            constants(controls, bernstein_weights(degradation, self.nodes)),
            constants(controls, bernstein_slopes(degradation, self.nodes)),
        )

    def _log_elongations(self, values: Named) -> Floats:
        """Return ln of the median elongation at break at the nodes, (n, n_nodes)."""
        at_nodes = [values[node_name("elongation", node)] for node in self.elongation_nodes]
        found: Floats = np.log(np.stack(at_nodes, axis=-1))
        return found

    def elongation(self, values: Named, degradation: Floats) -> Floats:
        """Return the median elongation at break [%] at degradation rates (S,), shape (n, S)."""
        at_nodes, nodes = self._log_elongations(values), self.elongation_nodes
        elongation: Floats = np.exp(rates.polynomial(at_nodes, degradation, nodes))
        return elongation

    def elongation_slope(self, values: Named, degradation: Floats) -> Floats:
        """Return d ln ε/dD_R of the median elongation at break [1/%], (n, S)."""
        at_nodes = self._log_elongations(values)
        return rates.derivative(at_nodes, degradation, self.elongation_nodes)


def has_elongation(base: tuple[Parameter, ...]) -> bool:
    """Return whether the elongation at break is part of a model with these parameters."""
    return any(p.name == "elongation_scatter" for p in base)


def stiffness_spread(values: Named, material: Material, sd: Floats) -> Floats:
    """Return τ² of specimens whose degradation rates have standard errors sd, (n, S).

    The deviation of a specimen's ln stiffness has variance τ² = σ² + (d ln C1/dD_R · sd(D_R))²:
    scatter of the material, and the error of its degradation rate, which acts through C1 (the
    elasticities to C2 and C3 are below 0.02).
    """
    scatter = values["stiffness_scatter"][:, None]
    spread: Floats = scatter**2 + (material.sensitivity * sd) ** 2
    return spread


def modulus_100(values: Named, constants: Floats, causes: tuple[Cause, ...] = ()) -> Floats:
    r"""Return the nominal stress at a stretch of 2 in uniaxial tension, "100 % modulus" [MPa].

    .. math:: P(2) = \tfrac{7}{2} \left(C_1 + 4 C_2 + 12 C_3\right)

    since I₁ − 3 = 2 there.  Causes that change the material change it; causes that change how the
    study's films were read do not, as it was measured elsewhere.

    Parameters
    ----------
    values : mapping
        Named values with the parameters of the causes, each (n,).
    constants : array, shape (n, S, 3)
        Yeoh's C1, C2, C3 [MPa].
    causes : tuple of Cause
        Active causes.

    Returns
    -------
    array, shape (n, S)
        [MPa]

    Examples
    --------
    >>> modulus_100({}, np.array([[[0.3, -0.01, 0.002]]])).round(6)
    array([[0.994]])
    """
    stress: Floats = constants @ yeoh_basis(2.0, "uniaxial")
    of_material = tuple(cause for cause in causes if cause.stage is Stage.MATERIAL)
    if not any(cause.on_stress is not None for cause in of_material):
        return stress
    return _under_causes(stress[..., None], np.array([2.0]), values, constants, of_material)[..., 0]


def young_modulus(values: Named, constants: Floats, causes: tuple[Cause, ...] = ()) -> Floats:
    r"""Return Young's modulus of films at zero strain under causes [MPa].

    It is the slope of the nominal stress that films show in uniaxial tension, at stretch 1:

    .. math:: Y = \left. \frac{dP}{d\lambda} \right|_{\lambda = 1}

    which is 6 C₁ if no cause acts on that stress, and 6 C₁ (1 + x/(2√3)) with a
    `second_invariant` of ratio x. It is computed from the causes' effect on stresses, by
    fourth-order differences, so no cause has to provide it.

    Arguments and shape are those of `modulus_100`.

    Examples
    --------
    >>> from bayesdeg.causes.catalogue import CATALOGUE
    >>> constants = np.array([[[0.3, -0.01, 0.002]]])
    >>> values = {"second_invariant.ratio": np.array([0.5])}
    >>> young_modulus(values, constants, (CATALOGUE["second_invariant"],)).round(4)
    array([[2.0598]])
    """
    if not any(cause.on_stress is not None for cause in causes):
        return rates.young_modulus(constants[..., 0])
    stress = constants @ yeoh_basis(_AROUND_ONE, "uniaxial").T
    slope: Floats = _under_causes(stress, _AROUND_ONE, values, constants, causes) @ _STENCIL
    return slope


def _under_causes(
    stress: Floats, stretch: Floats, values: Named, constants: Floats, causes: tuple[Cause, ...]
) -> Floats:
    """Return nominal stresses (n, S, k) of films in uniaxial tension under causes."""
    count = constants.shape[-2]
    stretches = np.broadcast_to(stretch, (count, len(stretch)))
    nominal = np.zeros(stretches.shape, dtype=bool)
    tests = FilmConditions(stretches, np.full(count, "uniaxial"), nominal, np.zeros(count))
    return applied("on_stress", stress, tests, acting(causes, values), constants)
