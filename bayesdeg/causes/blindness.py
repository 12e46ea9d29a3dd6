"""Reasons why the tests at hand cannot reveal a cause; None where they can."""

import numpy as np

from bayesdeg.causes.cause import Conditions, FilmConditions
from bayesdeg.causes.history import known_time
from bayesdeg.data.study import Study

FRESH = 0.5
"""Degradation rate up to which a specimen counts as never buried [%]."""


def without_degraded(conditions: Conditions) -> str | None:
    """Say so where no actuator was degraded.

    Examples
    --------
    >>> without_degraded(Conditions(np.array([[20.0]]), np.array([[0.0]])))
    'no degraded actuator was tested'
    """
    return None if np.any(conditions.degradation > FRESH) else "no degraded actuator was tested"


def without_time(conditions: Conditions) -> str | None:
    """Say so where no elapsed time between readings is known.

    Examples
    --------
    >>> without_time(Conditions(np.array([[20.0]]), np.array([[0.0]])))
    'no time was recorded'
    """
    if not np.any(np.isfinite(conditions.time)):
        return "no time was recorded"
    passed = np.ptp(known_time(conditions), axis=-1)
    return None if np.any(passed > 0.0) else "no time passed between readings"


def in_one_mode(films: FilmConditions) -> str | None:
    """Say so where all films were tested in one mode, all in tension or all in compression.

    Along such a path I₁ − 3 and the stretch determine each other, and an energy W(I₁) with
    W' = σ/(∂I₁/∂λ) has any given nominal stress σ(λ): any change of the stress looks like a
    different form of the law. Only Yeoh's truncation after the third term speaks against it.

    Examples
    --------
    >>> stretch, plain = np.array([[1.5, 2.0], [1.5, 2.0]]), np.full((2, 2), False)
    >>> modes = np.array(["uniaxial", "planar"])
    >>> in_one_mode(FilmConditions(stretch, modes, plain, np.zeros(2)))
    >>> one = FilmConditions(stretch[:1], modes[:1], plain[:1], np.zeros(1))
    >>> in_one_mode(one)[:58]
    'films were tested in one mode only (uniaxial) and no actua'
    """
    modes = sorted(set(films.mode.tolist()))
    both_ways = np.any(films.stretch > 1.0) and np.any(films.stretch < 1.0)
    if len(modes) > 1 or both_ways:
        return None
    return (
        f"films were tested in one mode only ({modes[0]}) and no actuators: any curve in one mode "
        "fits some energy in I₁ alone, so this cannot be told from a different form of the law"
    )


def in_one_mode_and_measure(films: FilmConditions) -> str | None:
    """Say so where, in addition, all stresses have the same label, nominal or Cauchy."""
    labels = np.unique(films.cauchy[films.stretch != 1.0])  # padding has no label
    return in_one_mode(films) if len(labels) < 2 else None


def without_membrane(study: Study) -> str | None:
    """Say so where an actuator has neither paper nor film.

    Examples
    --------
    >>> from pathlib import Path
    >>> without_membrane(Study("gelatin", Path("gelatin")))
    """
    layer = study.settings.layer
    if layer.is_membrane:
        return None
    what = "an elastomer layer" if layer.is_slab else "no constraint layer"
    return f"the actuator has {what}, and neither paper nor film"
