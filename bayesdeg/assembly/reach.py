"""Actuator readings beyond ballooning, which no curve of the material reaches.

No equilibrium exists beyond the largest pressure of a curve, so no model can match a reading there:
models would be compared by how far their curves reach, and a cause would be named for extending
them. Such readings are identified from films and priors before any model is fitted, so that all
models have the same data. Whole rows are excluded: beyond ballooning a wall counts as burst, so one
that survived would contradict any model too.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.assembly.aside import Exclusion, readings_at, set_aside
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.assembly.outline import outline
from bayesdeg.data.plausibility import doubts
from bayesdeg.data.study import Study
from bayesdeg.errors import Fault
from bayesdeg.inference.model import JointModel, least_squares
from bayesdeg.observations.curvature import ACTUATOR, Curvature, mechanics_inputs
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.surrogate.surrogate import Surrogate

MARGIN = 0.03
"""Margin of readings above the ballooning pressure, relative to it: it is proportional to the
stiffness, which films determine to 2 or 3 %."""
ERRORS = 2.0  # standard errors of the map's ballooning pressure, likewise
MOST = 0.5
"""Share of a specimen's readings: if more lie beyond, a unit or a constant is wrong."""


def assemble_within_reach(study: Study, forward: ForwardMap | None = None) -> Assembly:
    """Build the base model of a study without readings that no curve of the material reaches.

    Parameters
    ----------
    study : Study
        Checked data and settings.
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
    assembly = assemble(study, forward)
    aside = beyond_reach(study, assembly.model)
    if aside is None:
        return assembly
    rest = set_aside(study, [aside])
    return replace(assemble(rest, forward), whole=study, beyond=(aside,))


def beyond_reach(study: Study, model: JointModel) -> Exclusion | None:
    """Return the readings that no curve reaches; None if there are none or too many.

    Specimens whose pressures seem to be in a different unit are not included.

    Parameters
    ----------
    study : Study
        As read.
    model : JointModel
        Its base model with all readings, of which films and priors alone count here.
    """
    if not isinstance(model.world, FilmsAndActuators):
        return None
    places, over = model.places, readings_beyond(study, model)
    specimens = tuple(dict.fromkeys(str(name) for name in places.specimen[over]))
    if not specimens or any(np.mean(over[places.specimen == n]) > MOST for n in specimens):
        return None
    readings = readings_at(places, over)
    return Exclusion(None, "actuator", specimens, readings, is_without_rows=True)


def readings_beyond(study: Study, model: JointModel) -> NDArray[np.bool_]:
    """Return a mask of observations beyond the end of their curve, from films and priors.

    Parameters
    ----------
    study : Study
        With these readings; those in another unit, by its columns, do not count.
    model : JointModel
        Its base model.

    Returns
    -------
    array of bool, shape (n,)
    """
    places = model.places
    read: NDArray[np.bool_] = places.family == ACTUATOR
    over = read & (places.along > _ends(model, places.specimen))
    if np.any(over):
        over &= ~np.isin(places.specimen, [str(one.specimen) for one in in_another_unit(study)])
    return over


def in_another_unit(study: Study) -> list[Fault]:
    """Return single specimens whose values are many times those of the others."""
    odd = (one.fault for one in doubts(study, outline(study).expected) if one.is_alone)
    return [fault for fault in odd if fault.specimen is not None]


def _ends(model: JointModel, specimens: NDArray[np.str_]) -> NDArray[np.float64]:
    """Return the largest pressure kept for each specimen [kPa]; inf if unknown."""
    world = model.world
    known: dict[str, float] = {}
    if isinstance(world, FilmsAndActuators) and isinstance(world.forward, Surrogate):
        state = model.tests(model.table.named(least_squares(model)[None]))
        for one in model.of_kind(Curvature):
            met = mechanics_inputs(state, one.tests, np.zeros_like(one.deviation_sd(state)))
            limit = world.forward.limit_pressure(met)
            with np.errstate(invalid="ignore"):
                end = limit.pressure + ERRORS * limit.sd
            lowest = (1.0 + MARGIN) * np.where(np.isfinite(end[0]), end[0], np.inf).min(axis=-1)
            known |= dict(zip(one.tests.specimens, lowest.tolist(), strict=True))
    return np.array([known.get(str(name), np.inf) for name in specimens])
