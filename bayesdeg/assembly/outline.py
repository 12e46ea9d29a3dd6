"""The requirements of a study: data arrays, parameters with priors, causes that can be judged.

Nothing is evaluated, so a study can be checked without compiled code or emulator.
"""

import importlib
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Asked, Inputs
from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.causes.cause import Cause
from bayesdeg.causes.fold import Acting, applied, with_causes
from bayesdeg.data.cells import IN_QUOTES
from bayesdeg.data.plausibility import Expected, times_stiffer
from bayesdeg.data.settings import FILE
from bayesdeg.data.shrinkage import linear_scale
from bayesdeg.data.study import Study
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.errors import BayesdegError, Fault, StudyError, use_one_of
from bayesdeg.material.degradation import Nodes, nodes_for
from bayesdeg.observations.catalogue import TABLES, observations_of, of_kind
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.observations.curvature import OF_DEGRADATION, Curvature
from bayesdeg.observations.kinds import Observations, Pointwise
from bayesdeg.observations.means import Means, Statistic
from bayesdeg.observations.published import published_counts
from bayesdeg.observations.specimens import (
    COURSE,
    PAPER_STIFFNESS,
    STIFFNESS_SCATTER,
    elongation_parameters,
    material_parameters,
    node_name,
)
from bayesdeg.observations.tensile import Tensile
from bayesdeg.priors import (
    Choice,
    Distribution,
    LogNormal,
    Parameter,
    Uniform,
    check_priors,
    with_least,
    with_priors,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Outline:
    """The requirements of a study.

    Parameters
    ----------
    base : tuple of Parameter
        Of the base model, with the priors that the study states.
    nodes, elongation_nodes : tuple of float
        Degradation rates at which the material and its elongation limit are parameters [%].
    observations : tuple of Observations
        Data.
    largest : float
        Largest pressure that was applied [kPa].
    candidates, unjudged, missing, alike, counts, of_counts
        As in `bayesdeg.assembly.assemble.Assembly`.
    degrades : bool
        Whether anything of the study does.
    dimensions : tuple of UncertainDimension
        Dimensions of the actuator that are parameters.
    """

    base: tuple[Parameter, ...]
    nodes: Nodes
    elongation_nodes: Nodes
    observations: tuple[Observations, ...]
    largest: float
    candidates: tuple[Cause, ...]
    unjudged: dict[str, str]
    missing: tuple[tuple[str, str], ...]
    alike: tuple[Cause, ...]
    counts: RuptureCounts | None = None
    of_counts: tuple[Cause, ...] = ()
    degrades: bool = True
    dimensions: tuple[UncertainDimension, ...] = ()

    @property
    def needs_forward(self) -> bool:
        """Whether actuators are to be predicted."""
        return any(one.uses_forward for one in self.observations)

    @property
    def asked(self) -> tuple[Asked, ...]:
        """Outputs that the data need from the forward map besides the shape."""
        return tuple(dict.fromkeys(one.asks for one in self.observations if one.asks))

    @property
    def has_actuators(self) -> bool:
        """Whether actuators were read."""
        return bool(of_kind(self.observations, Curvature))

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """Means of replicates."""
        return _statistics(self.observations)

    @property
    def expected(self) -> Expected:
        """Prior expectations that readings are compared with."""
        return _expected(self.base, self.nodes, self.elongation_nodes, self.statistics)


def _expected(
    base: Iterable[Parameter],
    nodes: Nodes,
    elongation_nodes: Nodes,
    statistics: tuple[Statistic, ...],
) -> Expected:
    laws = {parameter.name: parameter.law for parameter in base}
    return Expected(
        _at_nodes("c1", nodes, laws),
        _at_nodes("elongation", elongation_nodes, laws),
        _linear_scale(statistics, laws),
    )


def _statistics(observations: tuple[Observations, ...]) -> tuple[Statistic, ...]:
    return tuple(s for one in of_kind(observations, Means) for s in one.statistics)


def _at_nodes(
    quantity: str, nodes: Nodes, laws: dict[str, Distribution]
) -> dict[float, Distribution]:
    """Return the priors of a quantity's values, without control values between the ends."""
    named = {node: node_name(quantity, node) for node in nodes}
    return {node: laws[name] for node, name in named.items() if name in laws}


def _linear_scale(statistics: tuple[Statistic, ...], laws: dict[str, Distribution]) -> float:
    """Return the length of the part over that of its mould: measured, else from the prior."""
    measured = [s.value for s in statistics if s.quantity == "volume_ratio"]
    if measured:
        return float(linear_scale(np.median(measured)))
    law = laws.get("volume_ratio")
    return 1.0 if law is None else float(linear_scale(law.quantile(0.5)))


def outline(study: Study, *, emulated: bool = True) -> Outline:
    """Return the requirements of a study.

    Parameters
    ----------
    study : Study
        Checked data and settings.
    emulated : bool
        Whether an emulator, whose error is a parameter, stands for the mechanics.

    Raises
    ------
    StudyError
        If a prior is given for a parameter that does not exist.
    BayesdegError
        If a candidate does not exist.
    """
    found = observations_of(study)
    nodes = nodes_for(
        _levels(one.material_levels for one in found) or [0.0], study.settings.material.order
    )
    elongation_levels = _levels(one.elongation_levels for one in found)
    by_vendor = not elongation_levels and _vendor_elongation(study, found)
    if by_vendor:
        elongation_levels = [0.0, *_levels(one.levels for one in found if one.uses_forward)]
    elongation_nodes = nodes_for(elongation_levels) if elongation_levels else ()
    degrades = study.degrades
    law = study.settings.material.law
    base = [*material_parameters(nodes, degrades=degrades, law=law), STIFFNESS_SCATTER]
    base += {p.name: p for one in found for p in one.parameters}.values()
    base += elongation_parameters(elongation_nodes, degrades=degrades) if elongation_nodes else ()
    base += [p for one in found for p in one.error_parameters if emulated]
    least = {name: size for one in found for name, size in one.least(study.digits).items()}
    base = [*with_least((p for p in base if p.name not in _without(study)), least)]
    candidates, unjudged, alike = _candidates(study, found, limited=bool(elongation_nodes))
    counts = published_counts(study)
    of_counts = _of_counts(study, counts)
    stated = {cause.name: cause for cause in (*candidates, *alike, *of_counts)}
    _check(study, base, tuple(stated.values()))
    uncertain = study.settings.uncertain if _are_predicted(study, found) else ()
    pressures = [float(one.tests.pressure.max()) for one in of_kind(found, Curvature)]
    usual = _default_priors(base, _statistics(found))
    usual = with_priors(usual, vendor_prior(study) if by_vendor else {})
    gelatin = _expected(usual, nodes, elongation_nodes, _statistics(found))
    usual = _of_own_material(usual, study, gelatin)
    return Outline(
        base=(
            *with_priors(usual, study.settings.priors),
            *(one.parameter for one in uncertain),
        ),
        nodes=nodes,
        elongation_nodes=elongation_nodes,
        observations=found,
        largest=max(pressures, default=240.0),
        candidates=candidates,
        unjudged=unjudged,
        missing=(*unlinked(found), *_missing(study), *_followed(usual, study, gelatin)),
        alike=alike,
        counts=counts,
        of_counts=of_counts,
        degrades=degrades,
        dimensions=uncertain,
    )


def _are_predicted(study: Study, found: tuple[Observations, ...]) -> bool:
    """Return whether there are actuator readings that a forward map can predict."""
    return study.actuator is not None and any(one.uses_forward for one in found)


def _without(study: Study) -> frozenset[str]:
    """Return the parameters without meaning in a study, unless it states a prior for them.

    If nothing degraded or shrank, the part has the size of its mould; without paper or film there
    is no layer stiffness.
    """
    of_size = frozenset() if study.degrades else frozenset(OF_DEGRADATION)
    of_paper = frozenset() if study.settings.layer.is_membrane else {PAPER_STIFFNESS}
    return (of_size - {*study.settings.priors}) | of_paper


def _asked(study: Study) -> list[Cause]:
    """Return the candidate causes of a study: by default all with a meaning in it.

    Raises
    ------
    StudyError
        If it names one that is not in the catalogue.
    """
    wanted = study.settings.causes.candidates
    if wanted is not None:
        unknown = [
            Fault(FILE, "is not a cause", use_one_of(name, CATALOGUE),
                  None, "causes.candidates", name)
            for name in wanted if name not in CATALOGUE
        ]  # fmt: skip
        if unknown:
            raise StudyError(unknown)
        return [find(name) for name in wanted]
    meant = study.degrades
    stated = study.settings.priors.keys()
    return [
        cause
        for cause in CATALOGUE.values()
        if meant or not cause.of_degradation or stated & {*cause.corrects}
    ]


def _of_counts(study: Study, counts: RuptureCounts | None) -> tuple[Cause, ...]:
    """Return the causes that published rupture counts may show, whatever the columns.

    Counts never have the columns that a cause needs, but it may still have acted.
    """
    if counts is None:
        return ()
    return tuple(
        replace(cause, parameters=stated_priors(cause, study))
        for cause in _asked(study)
        if cause.is_of_rupture_alone
        and (cause.needs or cause.blind(counts.tests.conditions) is None)
    )


def _levels(parts: Iterable[Floats]) -> list[float]:
    return [float(level) for part in parts for level in part]


def _default_priors(
    base: list[Parameter], statistics: tuple[Statistic, ...]
) -> tuple[Parameter, ...]:
    # the default prior of α is the published mean; with data of α it would count twice
    measured = any(s.quantity == "volume_ratio" for s in statistics)
    wide: dict[str, Distribution] = {"volume_ratio": Uniform(0.2, 1.0)} if measured else {}
    return with_priors(base, wide)


def _vendor_elongation(study: Study, found: tuple[Observations, ...]) -> bool:
    """Return whether a vendor states an elongation at break that actuators could reach."""
    stated = study.settings.vendor.elongation_at_break is not None
    return stated and any(one.uses_forward for one in found)


def _of_own_material(
    usual: tuple[Parameter, ...], study: Study, gelatin: Expected
) -> tuple[Parameter, ...]:
    """Return parameters with the priors of gelatin's constants scaled to a study's material.

    C1 at every rate is scaled with the stated fresh value, or else with films of a different
    material; C3 is scaled with C1. C2 is parametrized as a ratio.
    """
    stated, laws = study.settings.priors, {p.name: p.law for p in usual}
    fresh, of_c1 = node_name("c1", min(gelatin.c1)), {n for n in laws if n.startswith("c1_")}
    if fresh in stated:
        factor = _over(stated[fresh], laws[fresh])
    else:
        factor = 1.0 if stated.keys() & of_c1 else times_stiffer(study, gelatin)
    found = {n: _times(laws[n], factor) for n in of_c1}
    for name, law in laws.items():
        if name.startswith("c3_"):
            c1 = name.replace("c3_", "c1_", 1)
            found[name] = _times(law, _over(stated.get(c1, found[c1]), laws[c1]))
    return with_priors(usual, found)


def _followed(
    usual: Iterable[Parameter], study: Study, gelatin: Expected
) -> tuple[tuple[str, str], ...]:
    """Say that priors follow the films, if these are of a material without stated priors."""
    first = min(gelatin.c1)
    name = node_name("c1", first)
    now = {p.name: p.law for p in usual}[name]
    factor = _over(now, gelatin.c1[first])
    if factor == 1.0 or name in study.settings.priors:
        return ()
    facts = {"factor": factor, "c1": _median(now), "name": name}
    return ((f"[priors] {name}", _sentences("priors_follow", **facts)),)


def _over(one: Distribution, other: Distribution) -> float:
    """Return the ratio of two positive medians; 1 if the first is not positive."""
    ratio = _median(one) / _median(other)
    return ratio if ratio > 0.0 else 1.0


def _median(law: Distribution) -> float:
    """Return the median; a quantile would import scipy.special, half a second of `check`."""
    return law.median if isinstance(law, LogNormal) else float(law.quantile(0.5))


def _times(law: Distribution, factor: float) -> Distribution:
    """Return a prior law scaled by a factor."""
    return LogNormal(law.median * factor, law.sigma) if isinstance(law, LogNormal) else law


def vendor_prior(study: Study) -> dict[str, Distribution]:
    """Return the prior of the fresh elongation at break from a vendor's figure."""
    figure = study.settings.vendor.elongation_at_break
    if figure is None:
        return {}
    return {node_name("elongation", 0.0): LogNormal(figure.value, figure.sd / figure.value)}


def _candidates(
    study: Study, found: tuple[Observations, ...], *, limited: bool
) -> tuple[tuple[Cause, ...], dict[str, str], tuple[Cause, ...]]:
    """Return causes that can be judged, those that cannot, and those that films cannot separate.

    Causes are judged on ruptures if the model has an elongation limit, from whatever data.
    """
    actuators, films = of_kind(found, Curvature), of_kind(found, Tensile)
    alone = () if any(one.uses_forward for one in found) else films
    judged: list[Cause] = []
    alike: list[Cause] = []
    unjudged: dict[str, str] = {}
    for cause in _asked(study):
        on_films = "tensile" in cause.acts_on
        blind = [cause.blind_on_films(one.tests.conditions) for one in alone if on_films]
        indistinct = next(iter(blind), None)
        why = indistinct or _unseen(cause, study, actuators, films, limited=limited)
        why = None if any(one.reveals(cause) for one in found) else why
        why = cause.blind_in(study) or _of_no_part(cause, study, actuators) or why
        if why is not None:
            unjudged[cause.name] = why
        if why in (None, indistinct):
            stated = replace(cause, parameters=stated_priors(cause, study))
            (judged if why is None else alike).append(stated)
    return tuple(judged), unjudged, tuple(alike)


def _of_no_part(cause: Cause, study: Study, actuators: tuple[Curvature, ...]) -> str | None:
    """Say why a cause has no meaning for an actuator that is a mesh; None if it has one.

    A mesh does not mark walls or exposed faces.
    """
    if study.geometry.kind != "mesh" or cause.on_inputs is None or not actuators:
        return None
    one, conditions = np.ones((1, 1, 1)), actuators[0].tests.conditions
    plain = Inputs(conditions.pressure * one, one, 0.0 * one, one, one, one)
    acting = (Acting(cause, {name: size * one for name, size in cause.typical.items()}),)
    met = applied("on_inputs", plain, conditions, acting)
    moved = [name for name in ("wall_factor", "erosion", "skin") if getattr(met, name) is not None]
    return "the mesh does not mark which faces are walls" if moved else None


def _unseen(
    cause: Cause,
    study: Study,
    actuators: tuple[Curvature, ...],
    films: tuple[Tensile, ...],
    *,
    limited: bool,
) -> str | None:
    """Say why the data at hand cannot reveal a cause; None if they can."""
    if "tensile" in cause.acts_on and films:
        return None
    if not actuators:
        missing = "actuator readings (actuator.csv)"
        neither = " and no tensile curves (tensile.csv)" if "tensile" in cause.acts_on else ""
        return f"there are no {missing}{neither}"
    recorded = study.recorded.get("actuator", frozenset())
    lacking = [column for column in cause.needs if column not in recorded]
    if lacking:
        return f"actuator.csv does not record {', '.join(lacking)}"
    if cause.is_of_rupture_alone and not limited:
        return "there is no elongation at break (break.csv, summary.csv) to compare ruptures with"
    return cause.blind(actuators[0].tests.conditions)


def stated_priors(cause: Cause, study: Study) -> tuple[Parameter, ...]:
    """Return a cause's parameters with the priors of the study."""
    stated = study.settings.priors
    parameters, faults = [], []
    for parameter in cause.parameters:
        name = cause.qualified(parameter.name)
        law = stated.get(name, parameter.law)
        if isinstance(parameter.law, Choice) and name in stated:
            problem = f"is {parameter.law}, which is not a valid prior range"
            remedy = "remove it; to rule the cause out, leave it out of [causes] candidates"
            faults.append(Fault("study.toml", problem, remedy, None, f"priors.{name}", str(law)))
            continue
        neutral = float(law.to_unconstrained(parameter.neutral or 0.0))
        if np.isfinite(neutral) and law.allows(parameter.neutral or 0.0):
            parameters.append(replace(parameter, law=law))
        else:
            problem = f"excludes {parameter.neutral:g}, the value without an effect"
            remedy = "use normal, student_t, or truncated_normal with a bound at that value"
            faults.append(Fault("study.toml", problem, remedy, None, f"priors.{name}", str(law)))
    if faults:
        raise StudyError(faults)
    return tuple(parameters)


def _check(study: Study, base: list[Parameter], candidates: tuple[Cause, ...]) -> None:
    names = [p.name for p in with_causes(base, candidates).parameters]
    names += [p.name for p in COURSE] if study.moisture is not None else []
    check_priors(study.settings.priors, names)
    if not base:
        raise BayesdegError(f"{study.name}: there is nothing to calibrate")


def _missing(study: Study) -> tuple[tuple[str, str], ...]:
    absent = (
        (table.file, table.cost)
        for table in TABLES.values()
        if table.cost_in(degrades=study.degrades) and study.table(table.name) is None
    )
    return (*passed_over(study), *absent)


def _sentences(macro: str, **facts: object) -> str:
    """Fill a template of a run; jinja is imported only here, since most studies do not need it."""
    wording = importlib.import_module("bayesdeg.pages.wording")
    return str(wording.sentences("run", macro, **facts))


def unused(study: Study) -> tuple[str, ...]:
    """Return the rows of a study's files that no likelihood uses, and why.

    Examples
    --------
    >>> from pathlib import Path
    >>> import pandas as pd
    >>> films = pd.DataFrame({"specimen_id": ["a"], "stretch": [1.0], "stress_MPa": [0.0]})
    >>> unused(Study("rubber", Path("rubber"), tensile=films))
    ('1 row of tensile.csv (a): stretch 1 and stress 0, as for every material',)
    """
    return tuple(_sentences("unused", one=one) for one in study.unused)


def unlinked(observations: tuple[Observations, ...]) -> tuple[tuple[str, str], ...]:
    """Return data left out because they depend on readings from different tests.

    Parameters
    ----------
    observations : tuple of Observations
        All that a study has.
    """
    return tuple(
        (
            _sentences("unlinked", kind=one.name, count=len(one.observed)),
            _sentences("unlinked_cost"),
        )
        for one in observations
        if isinstance(one, Pointwise) and one.linked(observations) is None
    )


def passed_over(study: Study) -> tuple[tuple[str, str], ...]:
    """Return commented lines of a study that look like rows.

    Examples
    --------
    >>> from pathlib import Path
    >>> passed_over(Study("rubber", Path("rubber"), passed_over={"tensile.csv": 1}))[0][0]
    'the lines of tensile.csv that begin with # (1 with the cells of a row)'
    """
    return tuple(
        (
            _sentences("passed_over", file=file, rows=count),
            f"they are comments; {IN_QUOTES}",
        )
        for file, count in study.passed_over.items()
    )
