"""What a study asks for: data as arrays, parameters with priors, causes that can be judged.

Nothing is evaluated, so that a study can be checked without compiled code and emulator.
"""

from dataclasses import dataclass, replace

import numpy as np

from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.causes.cause import Cause
from bayesdeg.data.cells import IN_QUOTES
from bayesdeg.data.plausibility import Expected
from bayesdeg.data.shrinkage import linear_scale
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError, Fault, StudyError
from bayesdeg.inference import data as tables
from bayesdeg.inference import parameters as known
from bayesdeg.inference.data import ActuatorCurves, Breaks, TensileCurves
from bayesdeg.inference.published import PublishedTests, published_tests
from bayesdeg.material.degradation import Nodes, nodes_for
from bayesdeg.priors import Law, Parameter, Uniform


@dataclass(frozen=True)
class Outline:
    """What a study asks for.

    Parameters
    ----------
    base : tuple of Parameter
        Of the base model, with the priors that the study states.
    nodes, elongation_nodes : tuple of float
        Degradation rates at which the material and its elongation limit are parameters [%].
    actuator, tensile, breaks, tests : optional
        Data.
    statistics : tuple of Statistic
        Published means.
    largest : float
        Largest pressure that was applied [kPa].
    candidates, unjudged, missing, alike
        As in `bayesdeg.pipeline.assemble.Assembly`.
    """

    base: tuple[Parameter, ...]
    nodes: Nodes
    elongation_nodes: Nodes
    actuator: ActuatorCurves | None
    tensile: TensileCurves | None
    breaks: Breaks | None
    statistics: tuple[tables.Statistic, ...]
    tests: PublishedTests | None
    largest: float
    candidates: tuple[Cause, ...]
    unjudged: dict[str, str]
    missing: tuple[tuple[str, str], ...]
    alike: tuple[Cause, ...]

    @property
    def needs_forward(self) -> bool:
        """Whether there is anything of actuators to predict."""
        return self.actuator is not None or self.tests is not None

    @property
    def expected(self) -> Expected:
        """What the priors expect of readings, with which these are compared."""
        laws = {parameter.name: parameter.law for parameter in self.base}
        return Expected(
            _at_nodes("c1", self.nodes, laws),
            _at_nodes("elongation", self.elongation_nodes, laws),
            _linear_scale(self.statistics, laws),
        )


def _at_nodes(quantity: str, nodes: Nodes, laws: dict[str, Law]) -> dict[float, Law]:
    """Return the priors of a quantity's values; control values between the ends are none."""
    named = {node: known.node_name(quantity, node) for node in nodes}
    return {node: laws[name] for node, name in named.items() if name in laws}


def _linear_scale(statistics: tuple[tables.Statistic, ...], laws: dict[str, Law]) -> float:
    """Return the length of the part over that of its mould: as measured, else by the prior."""
    measured = [s.value for s in statistics if s.quantity == "volume_ratio"]
    if measured:
        return float(linear_scale(np.median(measured)))
    law = laws.get("volume_ratio")
    return 1.0 if law is None else float(linear_scale(law.quantile(0.5)))


def outline(study: Study, *, emulated: bool = True) -> Outline:
    """Return what a study asks for.

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
    actuator = tables.actuator_curves(study)
    tensile = tables.tensile_curves(study, fitted=True)
    breaks, statistics = tables.breaks(study), tables.statistics(study)
    found = published_tests(study)
    tests = None if found is None else found.without_ruptures()
    if actuator is None and tests is None:
        statistics = tuple(s for s in statistics if s.quantity != "volume_ratio")
    nodes = _nodes(tensile, actuator, statistics, tests, order=study.settings.order)
    elongation_nodes = _elongation_nodes(breaks, statistics)
    base = [*known.material_parameters(nodes), known.STIFFNESS_SCATTER]
    base += known.TENSILE if tensile is not None else ()
    largest = 240.0 if actuator is None else float(actuator.pressure.max())
    base += known.actuator_parameters(largest) if actuator is not None or tests is not None else ()
    base += known.BEND_ANGLE if actuator is not None and actuator.with_angle else ()
    base += known.elongation_parameters(elongation_nodes) if elongation_nodes else ()
    base += known.EMULATOR if actuator is not None and emulated else ()
    limited = bool(elongation_nodes)
    candidates, unjudged, alike = _candidates(study, actuator, tensile, tests, limited=limited)
    _check(study, base, (*candidates, *alike))
    return Outline(
        base=known.with_priors(_default_priors(base, statistics), study.settings.priors),
        nodes=nodes,
        elongation_nodes=elongation_nodes,
        actuator=actuator,
        tensile=tensile,
        breaks=breaks,
        statistics=statistics,
        tests=tests,
        largest=largest,
        candidates=candidates,
        unjudged=unjudged,
        missing=_missing(study),
        alike=alike,
    )


def _nodes(
    tensile: TensileCurves | None,
    actuator: ActuatorCurves | None,
    statistics: tuple[tables.Statistic, ...],
    tests: PublishedTests | None,
    *,
    order: int,
) -> Nodes:
    levels = [s.degradation for s in statistics if s.quantity == "young_modulus"]
    for curves in (tensile, actuator):
        if curves is not None:
            levels += curves.degradation.ravel().tolist()
    levels += [] if tests is None else tests.degradation.tolist()
    return nodes_for(levels or [0.0], order)


def _elongation_nodes(breaks: Breaks | None, statistics: tuple[tables.Statistic, ...]) -> Nodes:
    levels = [s.degradation for s in statistics if s.quantity == "elongation_at_break"]
    levels += [] if breaks is None else breaks.degradation.tolist()
    return nodes_for(levels) if levels else ()


def _default_priors(
    base: list[Parameter], statistics: tuple[tables.Statistic, ...]
) -> tuple[Parameter, ...]:
    # the default prior of α is the published mean; where data of α are given it would count twice
    measured = any(s.quantity == "volume_ratio" for s in statistics)
    wide: dict[str, Law] = {"volume_ratio": Uniform(0.2, 1.0)} if measured else {}
    return known.with_priors(base, wide)


def _candidates(
    study: Study,
    actuator: ActuatorCurves | None,
    tensile: TensileCurves | None,
    tests: PublishedTests | None,
    *,
    limited: bool,
) -> tuple[tuple[Cause, ...], dict[str, str], tuple[Cause, ...]]:
    """Return what can be judged, what cannot and why, and what films alone cannot tell apart.

    Causes are judged on ruptures where the model has a limit of elongation, whatever that rests on.
    """
    wanted = study.settings.candidates
    causes = CATALOGUE.values() if wanted is None else [find(name) for name in wanted]
    alone = tensile if actuator is None and tests is None else None
    judged: list[Cause] = []
    alike: list[Cause] = []
    unjudged: dict[str, str] = {}
    for cause in causes:
        on_films = "tensile" in cause.acts_on
        indistinct = cause.blind_on_films(alone.conditions) if alone and on_films else None
        why = indistinct or _unseen(cause, study, actuator, tensile, limited=limited)
        if why is not None:
            unjudged[cause.name] = why
        if why is None or indistinct is not None:
            stated = replace(cause, parameters=_stated_priors(cause, study))
            (judged if why is None else alike).append(stated)
    return tuple(judged), unjudged, tuple(alike)


def _unseen(
    cause: Cause,
    study: Study,
    actuator: ActuatorCurves | None,
    tensile: TensileCurves | None,
    *,
    limited: bool,
) -> str | None:
    """Say why the data at hand cannot reveal a cause; None if they can."""
    if "tensile" in cause.acts_on and tensile is not None:
        return None
    if actuator is None:
        missing = "actuator readings (actuator.csv)"
        films = " and no tensile curves (tensile.csv)" if "tensile" in cause.acts_on else ""
        return f"there are no {missing}{films}"
    recorded = study.recorded.get("actuator", frozenset())
    lacking = [column for column in cause.needs if column not in recorded]
    if lacking:
        return f"actuator.csv does not record {', '.join(lacking)}"
    if cause.is_of_rupture_alone and not limited:
        return "there is no elongation at break (break.csv, summary.csv) to compare ruptures with"
    return cause.blind(actuator.conditions)


def _stated_priors(cause: Cause, study: Study) -> tuple[Parameter, ...]:
    """Return a cause's parameters with the priors that the study states."""
    stated = study.settings.priors
    parameters, faults = [], []
    for parameter in cause.parameters:
        name = cause.qualified(parameter.name)
        law = stated.get(name, parameter.law)
        neutral = float(law.to_unconstrained(parameter.neutral or 0.0))
        if np.isfinite(neutral) and np.isfinite(float(law.log_density(parameter.neutral or 0.0))):
            parameters.append(replace(parameter, law=law))
        else:
            problem = f"leaves out {parameter.neutral:g}, the value without an effect"
            remedy = "use normal, student_t, or truncated_normal with a bound at that value"
            faults.append(Fault("study.toml", problem, remedy, None, f"priors.{name}", str(law)))
    if faults:
        raise StudyError(faults)
    return tuple(parameters)


def _check(study: Study, base: list[Parameter], candidates: tuple[Cause, ...]) -> None:
    names = [p.name for p in known.with_causes(base, candidates).parameters]
    names += [p.name for p in known.COURSE] if study.moisture is not None else []
    known.check_priors(study.settings.priors, names)
    if not base:
        raise BayesdegError(f"{study.name}: there is nothing to calibrate")


def _missing(study: Study) -> tuple[tuple[str, str], ...]:
    costs = {
        "tensile": "the Yeoh constants rest on priors and published statistics",
        "actuator": "nothing can be said of the actuator: no misfit, no cause, no bands",
        "breaks": "the elongation limit rests on priors and published statistics",
        "shrinkage": "the volume ratio α rests on its prior and published statistics",
        "moisture": "degradation rates are taken as recorded, without a check against time",
        "summary": "nothing is compared with, or rests on, published statistics",
    }
    files = {"breaks": "break.csv"}
    absent = (
        (files.get(name, f"{name}.csv"), cost)
        for name, cost in costs.items()
        if getattr(study, name) is None
    )
    return (*passed_over(study), *absent)


def passed_over(study: Study) -> tuple[tuple[str, str], ...]:
    """Say which lines of a study look like rows but are comments.

    Examples
    --------
    >>> from pathlib import Path
    >>> passed_over(Study("rubber", Path("rubber"), passed_over={"tensile.csv": 1}))[0][0]
    'the lines of tensile.csv that begin with # (1 with the cells of a row)'
    """
    return tuple(
        (
            f"the lines of {file} that begin with # ({count} with the cells of a row)",
            f"they are comments; {IN_QUOTES}",
        )
        for file, count in study.passed_over.items()
    )
