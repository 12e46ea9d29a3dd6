"""Temperature softening: a gel is softer in a warmer room.

Mechanism
    A gelatin gel's network consists of helices that melt as it warms. Actuators inflated on a
    warmer day, or in a warmer room than the films', are softer than the films suggest. The paper is
    not.

Equation
    All constants are exp(−k (T − 24 °C)) times those at 24 °C, of actuators and of films, each at
    the median temperature of its own test; a test without a temperature is taken at 24 °C. Thermal
    strain is ignored.

Typical size
    k = 0.03 /K. Aqueous gels that melt at 28 °C lose most: meshes three times as wide at 25 as at
    5 °C, with a modulus of kT/ξ³, give 0.16 /K. Gels that melt at higher temperatures, as with
    little water, lose less: a share of helices that falls linearly to a melting point T_m, with a
    modulus proportional to its square, gives k = 2/(T_m − T), 0.04 /K at T_m = 80 °C. The prior is
    half normal with 0.05 /K.

Revealed by
    Actuators that bend further the warmer their room was, at all degradation rates and pressures,
    and films likewise. It is judged only where actuator.csv has ``temperature_C`` and tests differ
    in it; all films in one room and all actuators in a different one look like ``film_mismatch``.

Refuted by
    One actuator that bends equally in a cool and a warm room.

Source
    Joly-Duhamel, Hellio, Ajdari, Djabourov (2002), Langmuir 18:7158, doi:10.1021/la020190m, for a
    modulus determined by the helices alone, in water and with glycerol; for the mesh against
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
"""Temperature assumed for a test where none was recorded [°C]."""
SAME = 0.5
"""Temperature difference below which a wall thermometer reads the same [K]."""


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
    """Say so where no temperature was recorded for any actuator test.

    Examples
    --------
    >>> without_temperature(Conditions(np.ones((1, 1)), np.zeros((1, 1)), temperature=27.0))
    >>> without_temperature(Conditions(np.ones((1, 1)), np.zeros((1, 1))))
    'no temperature was recorded in any actuator test'
    """
    if np.any(np.isfinite(conditions.temperature)):
        return None
    return "no temperature was recorded in any actuator test"


def never_warmer(study: Study) -> str | None:
    """Say so where all actuators and films were tested at one temperature.

    Examples
    --------
    >>> from pathlib import Path
    >>> never_warmer(Study("s", Path("s")))
    'no temperature was recorded in any actuator test (column temperature_C of actuator.csv)'
    """
    if study.actuator is None or not study.actuator["temperature_C"].notna().any():
        why = "no temperature was recorded in any actuator test"
        return f"{why} (column temperature_C of actuator.csv)"
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
    "equally in a cool and a warm room",
    confusable_with=("film_mismatch", "gauge_gain", "pressure_loss"),
    needs=("temperature_C",),
    on_inputs=soften_in_warmth,
    on_stress=pull_in_warmth,
    blind=without_temperature,
    blind_in=never_warmer,
)
