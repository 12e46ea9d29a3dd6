"""Search of a study for mishaps before calibration.

Suspects beyond doubt are set aside, unless the study wants them kept: calibration, verdict and
predictions exclude them, and the report gives the outcome that includes them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.assembly.aside import FILES, Exclusion, asides, set_aside
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.assembly.reach import assemble_within_reach, in_another_unit
from bayesdeg.criticism.checks.suspects import Suspect, find_suspects
from bayesdeg.data.batches import recorded_batches
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.laplace import find_mode
from bayesdeg.inference.model import JointModel, near_films
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.specimens import FilmsAndActuators

Floats = NDArray[np.float64]

SEED = 0  # seed of starts of the mode search, which hardly depends on them


def assemble_screened(study: Study, forward: ForwardMap | None = None) -> Assembly:
    """Build the base model of a study, without suspects unless it wants them kept.

    Parameters
    ----------
    study : Study
        Checked data and settings.
    forward : ForwardMap, optional
        By default the emulator that ships with the package.

    Returns
    -------
    Assembly
        With the suspects, and the study that is left.

    Raises
    ------
    StudyError, BayesdegError
        As of `assemble`.
    """
    return screened(assemble_within_reach(study, forward), forward)


def screened(assembly: Assembly, forward: ForwardMap | None) -> Assembly:
    """Return an assembly with the suspects of its study, without those that are set aside.

    Parameters
    ----------
    assembly : Assembly
        With all readings that curves reach.
    forward : ForwardMap, optional
        With which it was assembled.
    """
    study, model = assembly.study, assembly.model
    if not isinstance(model.world, FilmsAndActuators) or not model.of_kind(Curvature):
        return assembly
    seen = tuple(
        Exclusion(None, FILES[fault.file], (str(fault.specimen),), ())
        for fault in in_another_unit(study)
        if fault.file in FILES
    )
    rest = assemble(set_aside(study, seen), forward) if seen else assembly
    aside = (*seen, *_suspects(rest.study, rest.model, forward))
    if not study.settings.suspects.set_aside:
        aside = tuple(replace(one, is_out=False) for one in aside)
    if any(one.is_out for one in aside):
        rest = assemble(set_aside(study, aside), forward)
        return replace(rest, whole=assembly.whole, aside=aside, beyond=assembly.beyond)
    return replace(assembly, aside=aside)


def _suspects(study: Study, model: JointModel, forward: ForwardMap | None) -> tuple[Exclusion, ...]:
    """Return what the others contradict; out is what is beyond doubt, and no recorded batch."""
    start = near_films(model, np.random.default_rng(SEED))
    if start is None:
        return ()
    mode = find_mode(model, start)[0]

    def refit(found: Sequence[Suspect]) -> Floats | None:
        return _mode_of(set_aside(study, asides(model, found)), forward, model, mode)

    batches: dict[str, tuple[str, ...]] = {}
    for table in (study.actuator, study.tensile):
        for name, batch in recorded_batches(table).items():
            batches[batch] = (*batches.get(batch, ()), name)
    found = asides(model, find_suspects(model, mode, refit, batches.values()))
    recorded = [set(names) for names in batches.values()]  # which a cause may explain
    judged = [
        replace(one, is_out=_is_out(one, model, mode) and set(one.specimens) not in recorded)
        for one in found
    ]
    whole = {n for one in judged if one.is_out and not one.readings for n in one.specimens}
    return tuple(one for one in judged if not (one.readings and whole >= set(one.specimens)))


def _is_out(one: Exclusion, model: JointModel, mode: Floats) -> bool:
    """Return whether an exclusion is to be made, being beyond doubt."""
    return one.is_out and one.suspect is not None and one.suspect.is_beyond_doubt(model, mode)


def _mode_of(
    study: Study, forward: ForwardMap | None, whole: JointModel, start: Floats
) -> Floats | None:
    """Return the mode of a study without suspects, as a vector of the whole model."""
    try:
        model = assemble(study, forward).model
    except BayesdegError:  # the rest is not a study
        return None
    values = {name: value[0] for name, value in whole.table.named(start[None]).items()}
    medians = {p.name: float(p.law.quantile(0.5)) for p in model.table.parameters}
    known = medians | {name: values[name] for name in medians if name in values}
    vector = model.table.vectors({name: np.array(known[name]) for name in medians})
    climbed = find_mode(model, np.asarray(vector))[0]
    found = {name: value[0] for name, value in model.table.named(climbed[None]).items()}
    mode = whole.table.vectors({n: np.array(found.get(n, values[n])) for n in whole.table.names})
    return np.asarray(mode) if np.all(np.isfinite(mode)) else None
