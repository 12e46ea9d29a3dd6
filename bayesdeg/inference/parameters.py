"""Named parameters and their prior laws; vectors of the sampler to names and back."""

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.errors import Fault, StudyError
from bayesdeg.material.degradation import Nodes
from bayesdeg.priors import (
    HalfNormal,
    Law,
    LogNormal,
    Normal,
    Parameter,
    TruncatedNormal,
    Uniform,
)

Floats = NDArray[np.float64]
Named = Mapping[str, Floats]

# Medians follow the published moduli (6 C1 = 1.73 MPa fresh, about 5.5 times that at 25 %) and
# break elongations (210 % and about 52 %); doi:10.3389/frobt.2021.760485. Between the ends they are
# control values: half of what holds at 12.5 % is theirs.
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


@dataclass(frozen=True)
class ParameterTable:
    """Parameters in the order of the sampler's vector.

    The sampler works on an unconstrained scale, log for positive and logit for bounded
    quantities; ``named`` gives the values that users know.

    Parameters
    ----------
    parameters : tuple of Parameter
        With distinct names.
    """

    parameters: tuple[Parameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in order."""
        return tuple(p.name for p in self.parameters)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self.parameters)

    def named(self, vectors: Floats) -> dict[str, Floats]:
        """Return values by name from vectors (..., n_parameters)."""
        return {
            p.name: p.law.from_unconstrained(vectors[..., i]) for i, p in enumerate(self.parameters)
        }

    def vectors(self, values: Named) -> Floats:
        """Return vectors (..., n_parameters) from values by name."""
        return np.stack(
            [p.law.to_unconstrained(np.asarray(values[p.name])) for p in self.parameters], axis=-1
        )

    def log_prior(
        self, vectors: Floats, *, truncate: bool = True, values: Named | None = None
    ) -> Floats:
        """Return the log prior density on the unconstrained scale, shape (...).

        Parameters
        ----------
        vectors : array, shape (..., n_parameters)
            Unconstrained.
        truncate : bool
            False leaves out the bounds of truncated laws, for derivatives at a bound.
        values : mapping, optional
            What ``named`` returns of the vectors, where it is known already.
        """
        total = np.zeros(vectors.shape[:-1])
        for one in np.moveaxis(self.log_priors(vectors, truncate=truncate, values=values), -1, 0):
            total = total + one
        return total

    def log_priors(
        self, vectors: Floats, *, truncate: bool = True, values: Named | None = None
    ) -> Floats:
        """Return the log prior density of each parameter, shape (..., n_parameters).

        The arguments are those of `log_prior`.
        """
        values = self.named(vectors) if values is None else values
        columns = []
        for i, p in enumerate(self.parameters):
            z, x = vectors[..., i], values[p.name]
            density = p.law.log_density(x) if truncate else p.law.untruncated_log_density(x)
            columns.append(density + p.law.log_jacobian(z))
        return np.stack(columns, axis=-1) if columns else np.zeros((*vectors.shape[:-1], 0))

    def sample(self, generator: np.random.Generator, count: int) -> Floats:
        """Draw vectors from the prior, shape (count, n_parameters)."""
        draws = {p.name: p.law.sample(generator, count) for p in self.parameters}
        return self.vectors(draws)


def node_name(quantity: str, node: float) -> str:
    """Return a parameter's name at a node of D_R.

    Examples
    --------
    >>> node_name("c1", 12.5)
    'c1_at_12_5'
    """
    return f"{quantity}_at_{node:g}".replace(".", "_")


def control_name(quantity: str, nodes: Nodes, k: int) -> str:
    """Return the name of a constant's control value: its value at the ends, its pull between them.

    Examples
    --------
    >>> [control_name("c1", (0.0, 12.5, 25.0), k) for k in range(3)]
    ['c1_at_0', 'c1_control_12_5', 'c1_at_25']
    """
    if k in (0, len(nodes) - 1):
        return node_name(quantity, nodes[k])
    return f"{quantity}_control_{nodes[k]:.3g}".replace(".", "_")


def material_parameters(nodes: Nodes) -> tuple[Parameter, ...]:
    """Return the parameters of the Yeoh constants against D_R: their Bernstein control values."""
    parameters = []
    for k, node in enumerate(nodes):
        at_end = k in (0, len(nodes) - 1)
        place = f"at a degradation rate of {node:.3g} %"
        where = place if at_end else f"control value {place}, between the ends"
        ratio = _RATIO_AT_ENDS if at_end else _RATIO_BETWEEN
        parameters += [
            Parameter(control_name("c1", nodes, k), _nearest(_C1, node), "MPa", f"C1, {where}"),
            Parameter(
                control_name("c2_ratio", nodes, k),
                ratio,
                "–",
                f"C2/sqrt(3 C1 C3), {where}; above −1 the material is stable",
            ),
            Parameter(control_name("c3", nodes, k), _nearest(_C3, node), "MPa", f"C3, {where}"),
        ]
    return tuple(parameters)


def elongation_parameters(nodes: Nodes) -> tuple[Parameter, ...]:
    """Return the parameters of the elongation at break against D_R."""
    return (
        *(
            Parameter(
                node_name("elongation", node),
                _nearest(_ELONGATION, node),
                "%",
                f"median elongation at break at a degradation rate of {node:g} %",
            )
            for node in nodes
        ),
        Parameter("elongation_scatter", HalfNormal(0.2), "–", "sd of ln elongation at break"),
    )


STIFFNESS_SCATTER = Parameter(
    "stiffness_scatter", HalfNormal(0.1), "–", "sd of ln stiffness from specimen to specimen"
)
TENSILE = (
    Parameter("tensile_noise", HalfNormal(0.05), "–", "reading error of stress, proportional"),
    Parameter("tensile_noise_floor", HalfNormal(0.02), "MPa", "reading error of stress, constant"),
    Parameter(
        "tensile_noise_length",
        Uniform(0.002, 0.15),
        "–",
        "stretch over which the reading error of stress stays alike",
    ),
)
_ACTUATOR = (
    Parameter(
        "volume_ratio",
        TruncatedNormal(0.62, 0.07, 0.1, 1.0),
        "–",
        "volume of the part over that of its mould, α",
    ),
    Parameter("paper_stiffness", LogNormal(3e4, 0.7), "N/m", "Young's modulus times thickness"),
    Parameter("curvature_noise", HalfNormal(0.05), "–", "reading error of curvature, proportional"),
    Parameter(
        "curvature_noise_floor", HalfNormal(0.3), "1/m", "reading error of curvature, constant"
    ),
)
LONGEST_NOISE = 0.15  # of the pressure range: what lasts longer is no noise but an effect to name
BEND_ANGLE = (
    Parameter("bend_angle_noise", HalfNormal(0.05), "–", "reading error of angle, proportional"),
    Parameter("bend_angle_noise_floor", HalfNormal(0.7), "°", "reading error of angle, constant"),
    Parameter(
        "reading_correlation",
        TruncatedNormal(0.0, 0.5, -0.98, 0.98),
        "–",
        "correlation of the reading errors of curvature and angle in one picture",
    ),
)
_ERROR_MEANING = "error of the emulator common to all curves, {}, in its own standard errors"
EMULATOR = (
    Parameter("emulator_error_level", Normal(0.0, 1.0), "–", _ERROR_MEANING.format("on average")),
    Parameter(
        "emulator_error_pressure", Normal(0.0, 1.0), "–", _ERROR_MEANING.format("with pressure")
    ),
    Parameter(
        "emulator_error_degradation",
        Normal(0.0, 1.0),
        "–",
        _ERROR_MEANING.format("with degradation"),
    ),
)
# of the course of degradation in films
COURSE = (
    # 10 to 30 % of moisture make the published volume ratio plausible
    Parameter("fresh_moisture", LogNormal(20.0, 0.4), "%", "moisture content before degradation"),
    # a film cannot lose more than all of its moisture
    Parameter(
        "degradation_limit", Uniform(0.0, 100.0), "%", "degradation rate that is approached in time"
    ),
    # the films of the source were followed over a day
    Parameter(
        "degradation_time_constant",
        LogNormal(12.0, 1.0),
        "h",
        "time after which 63 % of the limit is reached",
    ),
    # a tenth of the fresh moisture
    Parameter("moisture_scatter", HalfNormal(2.0), "%", "sd of moisture content from film to film"),
)


def actuator_parameters(largest_pressure: float) -> tuple[Parameter, ...]:
    """Return the parameters of actuators tested up to a pressure [kPa]."""
    length = Parameter(
        "curvature_noise_length",
        Uniform(0.005 * largest_pressure, LONGEST_NOISE * largest_pressure),
        "kPa",
        "pressure over which reading errors stay alike",
    )
    return (*_ACTUATOR, length)


def with_causes(base: Iterable[Parameter], causes: Iterable[Cause]) -> ParameterTable:
    """Return the table of a model with causes: their parameters follow, prefixed by their names."""
    extra = (replace(p, name=cause.qualified(p.name)) for cause in causes for p in cause.parameters)
    return ParameterTable((*base, *extra))


def with_priors(
    parameters: Iterable[Parameter], priors: Mapping[str, Law]
) -> tuple[Parameter, ...]:
    """Return parameters with the prior laws that a study gives."""
    return tuple(replace(p, law=priors.get(p.name, p.law)) for p in parameters)


def check_priors(priors: Mapping[str, Law], known: Iterable[str]) -> None:
    """Raise StudyError for priors of parameters that do not exist.

    Raises
    ------
    StudyError
        Naming the nearest known parameter.
    """
    names = list(known)
    faults = []
    for name in priors:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            remedy = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(names)}"
            faults.append(
                Fault("study.toml", "is no parameter of this study", remedy, None, f"priors.{name}")
            )
    if faults:
        raise StudyError(faults)


def _nearest(laws: Mapping[float, Law], node: float) -> Law:
    return laws[min(laws, key=lambda known: abs(known - node))]
