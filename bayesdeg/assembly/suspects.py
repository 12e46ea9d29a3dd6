"""Search of a study for mishaps before calibration, if it asks for it.

Suspects are set aside: calibration, verdict and predictions exclude them, and the report gives the
outcome that includes them.
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
    """Build the base model of a study, without suspects if it asks for that.

    Parameters
    ----------
    study : Study
        Checked data and settings; `Settings.set_aside` says whether to look it through.
    forward : ForwardMap, optional
        By default the emulator that ships with the package.

    Returns
    -------
    Assembly
        With what was set aside, and the study that is left.

    Raises
    ------
    StudyError, BayesdegError
        As of `assemble`.
    """
    assembly = assemble_within_reach(study, forward)
    return without_suspects(assembly, forward) if study.settings.suspects.set_aside else assembly


def without_suspects(assembly: Assembly, forward: ForwardMap | None) -> Assembly:
    """Return an assembly without the suspects of its study, or itself if there are none.

    Parameters
    ----------
    assembly : Assembly
        With all readings that curves reach.
    forward : ForwardMap, optional
        With which it was assembled.
    """
    model, study = assembly.model, assembly.study
    if not isinstance(model.world, FilmsAndActuators) or not model.of_kind(Curvature):
        return assembly
    whole, beyond = assembly.whole, assembly.beyond
    seen = tuple(
        Exclusion(None, FILES[fault.file], (str(fault.specimen),), ())
        for fault in in_another_unit(study)
        if fault.file in FILES
    )
    if seen:
        found = without_suspects(assemble(set_aside(study, seen), forward), forward)
        return replace(found, whole=whole, aside=(*seen, *found.aside), beyond=beyond)
    aside = asides(model, _suspects(study, model, forward))
    if not aside:
        return assembly
    found = assemble(set_aside(study, aside), forward)
    return replace(found, whole=whole, aside=aside, beyond=beyond)


def _suspects(study: Study, model: JointModel, forward: ForwardMap | None) -> tuple[Suspect, ...]:
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
    return find_suspects(model, mode, refit, batches.values())


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
