"""A study becomes the base model: which data, which parameters, which priors."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.reading import as_read
from bayesdeg.causes.cause import Cause
from bayesdeg.causes.fold import with_causes
from bayesdeg.data.batches import recorded_batches
from bayesdeg.data.study import Study
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.trained import refuse_lacking, surrogate_for
from bayesdeg.errors import BayesdegError, Fault, StudyError, use_one_of
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.observations.specimens import LEAST_STIFFENING, FilmsAndActuators, no_map
from bayesdeg.pipeline.aside import Aside
from bayesdeg.pipeline.formula import OwnMap, probe
from bayesdeg.pipeline.outline import Outline, outline, stated_priors
from bayesdeg.pipeline.user_code import own_causes, own_map, try_out
from bayesdeg.priors import Parameter, check_priors, with_priors


@dataclass(frozen=True)
class Assembly:
    """The base model of a study and what surrounds it.

    Parameters
    ----------
    model : JointModel
        Base model.
    candidates : tuple of Cause
        Causes that can be judged with the columns at hand.
    unjudged : dict of str to str
        Causes that cannot, and why.
    missing : tuple of (str, str)
        Data that are not there, and what that costs.
    alike : tuple of Cause
        Those of the unjudged that act on the films of a study without actuators, and that these
        films cannot tell from another form of the law, nor from each other.
    own : OwnMap, optional
        A forward map of the user's own, where the study is of no films and actuators.
    counts : RuptureCounts, optional
        How many of the actuators of others burst.
    of_counts : tuple of Cause
        Causes that such counts may show.
    aside : tuple of Aside
        Specimens and readings that were set aside, since they do not belong with the rest.
    batches : dict of str to str
        The batch of each specimen of which one is recorded.
    study, whole : Study, optional
        What is left of the study, and the study with all of it, where something was.
    """

    model: JointModel
    candidates: tuple[Cause, ...]
    unjudged: dict[str, str]
    missing: tuple[tuple[str, str], ...]
    alike: tuple[Cause, ...] = ()
    own: OwnMap | None = None
    counts: RuptureCounts | None = None
    of_counts: tuple[Cause, ...] = ()
    aside: tuple[Aside, ...] = ()
    batches: dict[str, str] = field(default_factory=dict)
    study: Study | None = None
    whole: Study | None = None

    @property
    def causes(self) -> tuple[Cause, ...]:
        """All causes that a model of the study may have, each once, with the priors it states."""
        known = {one.name: one for one in (*self.candidates, *self.alike, *self.of_counts)}
        return tuple(known.values())

    def extended(self, *causes: Cause) -> JointModel:
        """Return the model with causes active, fitted to all that such a model is fitted to.

        Raises
        ------
        ValueError
            If a cause acts on nothing of the model, or names clash.
        """
        return self.with_its_counts(self.model.extended(*causes))

    def with_its_counts(self, model: JointModel) -> JointModel:
        """Return a model with published counts of ruptures as data, if one of its causes says so.

        A cause that acts on rupture alone makes them data. Without one they are held against the
        model, see `bayesdeg.observations.counts`.
        """
        are_data = any(cause.is_of_rupture_alone for cause in model.causes)
        if self.counts is None or not are_data:
            return model
        return model.with_observations(self.counts)


def assemble_own(
    own: OwnMap, parameters: Iterable[Parameter], candidates: Iterable[Cause] = ()
) -> Assembly:
    """Build the base model of readings and a forward map of one's own.

    Raises
    ------
    BayesdegError
        If names clash, or shapes do not go together.
    """
    model = own.model(parameters)
    probe(model)
    return Assembly(model, tuple(candidates), {}, (), own=own)


def _assemble_study(study: Study) -> Assembly:
    """Build the base model of a study of one's own forward map, with the causes that it brings.

    Raises
    ------
    StudyError
        If code of the study fails, or a prior or a cause does not exist.
    """
    own, causes, stated = own_map(study), own_causes(study), study.settings
    assert stated.forward is not None
    try:
        base = own.model(stated.forward.parameters)
    except BayesdegError as fault:
        raise StudyError([Fault("study.toml", str(fault), "change the names")]) from fault
    check_priors(stated.priors, with_causes(base.base, causes).names)
    tried = tuple(
        replace(one, parameters=stated_priors(one, study))
        for one in causes
        if stated.candidates is None or one.name in stated.candidates
    )
    known = [cause.name for cause in causes]
    unknown = [
        Fault("study.toml", "is no cause of this study",
              use_one_of(name, known) if known else "add causes/NAME.py",
              None, "causes.candidates", name)
        for name in stated.candidates or () if name not in known
    ]  # fmt: skip
    if unknown:
        raise StudyError(unknown)
    model = replace(base, base=with_priors(base.base, stated.priors))
    try_out(study, model, tried)
    absent = (("causes/*.py", "no cause can be named, only a misfit be found"),)
    return Assembly(model, tried, {}, () if tried else absent, own=own)


def assemble(study: Study, forward: ForwardMap | None = None) -> Assembly:
    """Build the base model of a study.

    Parameters
    ----------
    study : Study
        Checked data and settings.
    forward : ForwardMap, optional
        By default the emulator that ships with the package.

    Raises
    ------
    StudyError
        If a prior is given for a parameter that does not exist.
    BayesdegError
        If a candidate does not exist, or there is no emulator of the study's geometry.
    """
    if study.settings.forward is not None:
        return _assemble_study(study)
    emulated = forward is None or isinstance(forward, Surrogate)
    plan = outline(study, emulated=emulated)
    geometry = geometry_of_study(study.settings)
    if plan.needs_forward and (forward is None or isinstance(forward, Surrogate)):
        forward = surrogate_for(geometry, forward)
        refuse_lacking(forward, plan.asked, plan.dimensions)
    if plan.has_actuators and forward is not None:
        points, of_line = study.settings.reading_points, study.line_points
        forward = as_read(
            forward, study.settings.operator, of_line or points, of_line=of_line is not None
        )
    world = FilmsAndActuators(
        nodes=plan.nodes,
        elongation_nodes=plan.elongation_nodes or (0.0,),
        forward=no_map if forward is None or not plan.needs_forward else forward,
        paper_thickness=study.settings.paper_thickness_mm,
        largest_pressure=plan.largest,
        criterion=study.settings.rupture_criterion,
        size_ratio=geometry.volume / study.settings.film_volume_mm3,
        degrades=plan.degrades,
        law=study.settings.law,
        stiffening=_stiffening(study, plan),
        dimensions=tuple(one.name for one in plan.dimensions),
    )
    model = JointModel(plan.base, plan.observations, world)
    return Assembly(
        model,
        plan.candidates,
        plan.unjudged,
        plan.missing,
        plan.alike,
        counts=plan.counts,
        of_counts=plan.of_counts,
        batches=batches_of(study),
    )


def batches_of(study: Study) -> dict[str, str]:
    """Return the batch of each specimen, where a table says of which it is."""
    return recorded_batches(study.actuator) | recorded_batches(study.tensile)


def _stiffening(study: Study, plan: Outline) -> float:
    """Return C3/C1 where C3 is no parameter."""
    return LEAST_STIFFENING if study.settings.law == "neo_hookean" and plan.needs_forward else 0.0


def level_grid(model: JointModel) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the degradation rates at which predictions are shown [%]."""
    top = max(model.nodes)
    return np.array(model.nodes) if top == 0.0 else np.arange(0.0, top + 1e-9, 5.0)
