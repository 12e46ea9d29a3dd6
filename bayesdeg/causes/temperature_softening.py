"""Temperature softening: a gel is softer in a warmer room.

Mechanism
    The network of a gelatin gel is of helices that melt as it gets warmer. Actuators that were
    inflated on a warmer day, or in a warmer room than the films were pulled in, are softer than the
    films say. The paper is not.

Equation
    All constants are exp(−k (T − 24 °C)) times those at 24 °C, of actuators and of films, each at
    the median temperature of its own test; a test without a temperature is taken at 24 °C. Strain
    that heat itself causes is left out.

Typical size
    k = 0.03 /K. Aqueous gels that melt at 28 °C lose most: meshes that are three times as wide at
    25 as at 5 °C, and a modulus of kT/ξ³, are 0.16 /K. Gels that melt at higher temperatures, as
    with little water, lose less: a share of helices that falls linearly to a melting point T_m, and
    a modulus with its square, give k = 2/(T_m − T), 0.04 /K at T_m = 80 °C. The prior is half
    normal with 0.05 /K.

Revealed by
    Actuators that bend further the warmer their room was, at all degradation rates and pressures,
    and films likewise. It is judged only where ``temperature_C`` stands in actuator.csv and tests
    differ in it; tests of all films in one room and all actuators in another read like
    ``film_mismatch``.

Refuted by
    The same actuator that bends alike in a cool and in a warm room.

Source
    Joly-Duhamel, Hellio, Ajdari, Djabourov (2002), Langmuir 18:7158, doi:10.1021/la020190m, for a
    modulus that the helices alone determine, in water and with glycerol; for the mesh against
    temperature, the abstract of "Effect of salt and temperature on visco-elasticity of gelatin
    hydrogels", J. Surf. Sci. Technol. (informaticsjournals.com/index.php/jsst/article/view/1967).
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, for 24 °C.
"""

import numpy as np

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
from bayesdeg.data.study import Study
from bayesdeg.priors import Parameter, TruncatedNormal

USUAL = 24.0
"""Temperature of a test where none was recorded [°C]."""
SAME = 0.5
"""Temperatures that differ by less are the same to a thermometer on the wall [K]."""


def soften_in_warmth(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with all constants times exp(−k (T − 24 °C)) of each specimen."""
    above = _above(conditions.room_temperature)[:, None]
    return scaled_stiffness(inputs, np.exp(-effect["softening"] * above))


def pull_in_warmth(stress: Floats, films: FilmConditions, effect: Effect, _: Floats) -> Floats:
    """Return stresses times exp(−k (T − 24 °C)) of each film."""
    pulled: Floats = stress * np.exp(-effect["softening"] * _above(films.temperature)[:, None])
    return pulled


def _above(temperature: Floats) -> Floats:
    """Return T − 24 °C; 0 where no temperature was recorded."""
    return np.nan_to_num(temperature - USUAL)


def without_temperature(conditions: Conditions) -> str | None:
    """Say so where no temperature of an actuator's test is known.

    Examples
    --------
    >>> without_temperature(Conditions(np.ones((1, 1)), np.zeros((1, 1)), temperature=27.0))
    >>> without_temperature(Conditions(np.ones((1, 1)), np.zeros((1, 1))))
    'no temperature of a test of an actuator was recorded'
    """
    if np.any(np.isfinite(conditions.temperature)):
        return None
    return "no temperature of a test of an actuator was recorded"


def never_warmer(study: Study) -> str | None:
    """Say so where all tests of actuators and films were made at one temperature.

    Examples
    --------
    >>> from pathlib import Path
    >>> never_warmer(Study("s", Path("s")))
    'no temperature of a test of an actuator was recorded (temperature_C in actuator.csv)'
    """
    if study.actuator is None or not study.actuator["temperature_C"].notna().any():
        why = "no temperature of a test of an actuator was recorded"
        return f"{why} (temperature_C in actuator.csv)"
    tables = [table for table in (study.actuator, study.tensile) if table is not None]
    known = [
        table["temperature_C"].groupby(table["specimen_id"]).median().fillna(USUAL)
        for table in tables
    ]
    low, high = min(one.min() for one in known), max(one.max() for one in known)
    if high - low < SAME:
        return f"all actuators and films were tested at one temperature ({low:.1f} °C)"
    return None


CAUSE = Cause(
    name="temperature_softening",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "softening",
            TruncatedNormal(0.0, 0.05, 0.0, 0.3),
            "1/K",
            "relative loss of stiffness per degree",
            0.0,
        ),
    ),
    mechanism="actuators and films are softer in a warmer room",
    typical={"softening": 0.03},
    revealed_by="actuators that bend further the warmer their room; refuted by one that bends "
    "alike in a cool and a warm room",
    confusable_with=("film_mismatch", "gauge_gain", "pressure_loss"),
    needs=("temperature_C",),
    on_inputs=soften_in_warmth,
    on_stress=pull_in_warmth,
    blind=without_temperature,
    blind_in=never_warmer,
)
