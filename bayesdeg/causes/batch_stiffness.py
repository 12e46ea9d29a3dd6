"""Batch stiffness: batches of the material differ in stiffness.

Mechanism
    Weighing, gelling time and drying differ from one mixture to the next, so all castings of a
    batch, actuators and films alike, are stiffer or softer than those of other batches.

Equation
    All constants of batch b are exp(x_b) times those of the reference batch, whose x is 0: the
    batch of most films, or of most actuators where films record none (`bayesdeg.data.batches`).
    ``second``, ``third`` and ``fourth`` are x of the other batches in the order of their names.
    Specimens without a batch count as the reference batch.

Typical size
    x = ±0.2: a gel's modulus scales with about the square of its concentration, so a mixture with
    9 % less mass, all of it water, is 21 % stiffer; gelatin films vary by tens of percent with
    gelling and drying. The prior has a standard deviation of 0.25. Batches of a careful laboratory
    differ by no more than ``stiffness_scatter`` absorbs.

Revealed by
    Specimens of one batch that deviate together, at all degradation rates and pressures. It is
    judged only where ``batch`` in actuator.csv names two to four batches: without that column, any
    grouping of specimens would be a guess.

Refuted by
    Batches that differ in their actuators but agree in their films.

Source
    Bigi, Panzavolta, Rubini (2004), Biomaterials 25:5675,
    doi:10.1016/j.biomaterials.2004.01.033, for stiffness of gelatin films against their structure;
    Joly-Duhamel, Hellio, Ajdari, Djabourov (2002), Langmuir 18:7158, doi:10.1021/la020190m, for the
    modulus of gels against what forms their network. The spread between batches is estimated.
"""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import (
    Cause,
    Conditions,
    Effect,
    FilmConditions,
    Floats,
    Stage,
    scaled_stiffness,
)
from bayesdeg.data.batches import recorded_batches
from bayesdeg.data.study import Study
from bayesdeg.priors import Normal, Parameter

CONTRASTS = ("second", "third", "fourth")


def scale_by_batch(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Scale the inputs' constants by exp(x) of each specimen's batch."""
    return scaled_stiffness(inputs, np.exp(_contrast(conditions.batch[:, :1], effect)))


def scale_stress_by_batch(
    stress: Floats, films: FilmConditions, effect: Effect, _: Floats
) -> Floats:
    """Scale stresses by exp(x) of each film's batch."""
    pulled: Floats = stress * np.exp(_contrast(films.batch[:, None], effect))
    return pulled


def _contrast(batch: NDArray[np.int64], effect: Effect) -> Floats:
    """Return x of each specimen, (walkers, n_specimens, 1).

    Films of batches beyond the fourth, which contain no actuator, count as the reference batch.
    """
    parts = [effect[name] * (batch == k) for k, name in enumerate(CONTRASTS, start=1)]
    total: Floats = np.add.reduce(parts)
    return total


def of_one_batch(conditions: Conditions) -> str | None:
    """Say so unless the actuators are known to come from two to four batches.

    Examples
    --------
    >>> of_one_batch(Conditions(np.ones((2, 1)), np.zeros((2, 1)), batch=np.array([[0], [1]])))
    >>> of_one_batch(Conditions(np.ones((2, 1)), np.zeros((2, 1))))
    'all actuators come from one batch, or their batches were not recorded'
    """
    if len(np.unique(conditions.batch)) < 2:
        return "all actuators come from one batch, or their batches were not recorded"
    if conditions.batch.max() > len(CONTRASTS):
        return f"the actuators come from more than {len(CONTRASTS) + 1} batches"
    return None


def in_one_batch(study: Study) -> str | None:
    """Say so unless the study records several batches of actuators.

    Examples
    --------
    >>> from pathlib import Path
    >>> in_one_batch(Study("s", Path("s")))
    'actuator.csv does not record several batches (column batch)'
    """
    if len(set(recorded_batches(study.actuator).values())) > 1:
        return None
    return "actuator.csv does not record several batches (column batch)"


CAUSE = Cause(
    name="batch_stiffness",
    stage=Stage.MATERIAL,
    parameters=tuple(
        Parameter(
            name,
            Normal(0.0, 0.25),
            "–",
            f"ln of the stiffness of the {name} batch relative to the reference batch",
            0.0,
        )
        for name in CONTRASTS
    ),
    mechanism="batches of the material differ in stiffness",
    typical={"second": 0.2, "third": -0.1, "fourth": 0.1},
    revealed_by="specimens of one batch that deviate together; refuted by films of these "
    "batches that agree",
    confusable_with=("film_mismatch", "degradation_misread"),
    needs=("batch",),
    on_inputs=scale_by_batch,
    on_stress=scale_stress_by_batch,
    blind=of_one_batch,
    blind_in=in_one_batch,
)
