"""A stored posterior becomes tables: curvature and rupture, and the pressure for a curvature."""

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.inference.chain import Chain
from bayesdeg.inference.model import Model
from bayesdeg.pipeline.progress import Progress
from bayesdeg.pipeline.stored import Range, Stored
from bayesdeg.prediction.control import Setting, control, largest_allowed
from bayesdeg.prediction.predictive import (
    QUANTILES,
    Specimens,
    curvature_bands,
    draw_specimens,
    respond,
    rupture_table,
)

Floats = NDArray[np.float64]

BAND_DRAWS, RUPTURE_DRAWS = 2000, 1000
PRESSURES_AT_ONCE = 40  # bounds the memory
LEAST_ANSWERED = 0.5  # of the specimens; below, a band says nothing
NEARLY_ALL = 0.99
BAND_COLUMNS = tuple(f"q{round(100 * q):02d}" for q in QUANTILES)
PROBABILITY_COLUMNS = ("probability", "probability_q05", "probability_q95")
POINT = 1.0  # by which a degradation rate may lie outside of what was measured [%]


class Drawn(Protocol):
    """A model and draws of its posterior: of a calibration, or as a run folder holds them."""

    @property
    def model(self) -> Model:
        """Predicts."""
        ...

    @property
    def chain(self) -> Chain:
        """The draws."""
        ...


def predict(
    stored: Drawn,
    degradation: Floats,
    pressure: Floats,
    *,
    seed: np.random.SeedSequence,
    progress: Progress,
) -> pd.DataFrame:
    """Return curvature bands and rupture probabilities of a new specimen.

    Parameters
    ----------
    stored : Drawn
        Model and posterior.
    degradation, pressure : array
        Degradation rates [%] and pressures as read [kPa], both rising.
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows the levels.

    Returns
    -------
    DataFrame
        The columns of ``bands.csv`` and ``rupture.csv``; ``answered``, the share of specimens for
        which the forward map has an answer [–]; and ``why`` something is missing.
    """
    first, second = seed.spawn(2)
    specimens = draw_specimens(
        stored.model, stored.chain, np.random.default_rng(second), draws=500, strata=4
    )
    pieces = np.array_split(pressure, -(-len(pressure) // PRESSURES_AT_ONCE))
    progress.stage("predicting", total=len(degradation) * len(pieces))
    frames = []
    for level in degradation:
        for piece in pieces:
            frames.append(_predicted(stored, specimens, level, piece, first))
            progress.advance(1, f"{level:g} %")
    return pd.concat(frames, ignore_index=True)


def _predicted(
    stored: Drawn,
    specimens: Specimens,
    level: float,
    pressure: Floats,
    seed: np.random.SeedSequence,
) -> pd.DataFrame:
    model, chain, at = stored.model, stored.chain, np.array([level])
    # anew from the seed, so that every row is about the same draws
    generator = np.random.default_rng(seed)
    table = curvature_bands(
        model, chain, generator, degradation=at, pressure=pressure, draws=BAND_DRAWS
    )
    table[list(PROBABILITY_COLUMNS)] = np.nan
    if model.has_elongation:
        generator = np.random.default_rng(seed)
        rupture = rupture_table(
            model, chain, generator, degradation=at, pressure=pressure, draws=RUPTURE_DRAWS
        )
        table[list(PROBABILITY_COLUMNS)] = rupture[list(PROBABILITY_COLUMNS)]
    answered = respond(specimens, level, pressure).answered
    unknown = table["probability"].isna() & model.has_elongation
    why = [_why(a, rupture=bool(u)) for a, u in zip(answered, unknown, strict=True)]
    return table.assign(answered=answered, why=why)


def _why(answered: float, *, rupture: bool) -> str:
    beyond = "balloon before this pressure or lie outside the emulator's training"
    left = f"{100.0 * (1.0 - answered):.0f} % of new specimens {beyond}"
    if answered <= LEAST_ANSWERED:
        return f"{left}, so there is no prediction"
    if answered < NEARLY_ALL:
        said = f"{left}; the band is that of the others"
        return f"{said}, and there is no probability of rupture" if rupture else said
    return f"the softest specimens {beyond}: no probability of rupture" if rupture else ""


def settings(
    stored: Drawn,
    degradation: Floats,
    wanted: Floats,
    *,
    risk: float,
    seed: np.random.SeedSequence,
    progress: Progress,
) -> list[Setting]:
    """Return the pressure for each wanted curvature at each degradation rate.

    Parameters
    ----------
    stored : Drawn
        Model and posterior.
    degradation, wanted : array
        Degradation rates [%] and curvatures [1/m].
    risk : float
        Largest probability of rupture that is accepted [–].
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows the levels.
    """
    specimens = draw_specimens(stored.model, stored.chain, np.random.default_rng(seed))
    first = stored.model.largest_pressure
    progress.stage("finding pressures", total=len(degradation))
    found = []
    for level in degradation:
        allowed = largest_allowed(specimens, level, risk, first=first)
        found += [
            control(specimens, level, curvature, risk=risk, first=first, allowed=allowed)
            for curvature in wanted
        ]
        progress.advance(1, f"{level:g} %")
    return found


def settings_table(found: list[Setting]) -> pd.DataFrame:
    """Return settings as a table, one row each; what is not finite is empty."""
    rows = [
        {
            "degradation_pct": s.degradation,
            "wanted_per_m": s.wanted,
            "risk": s.risk,
            "reached": int(s.reached),
            "pressure_kPa": s.pressure,
        }
        | dict(zip(("needed_q05_kPa", "needed_q50_kPa", "needed_q95_kPa"), s.needed, strict=True))
        | {"allowed_kPa": s.allowed.pressure}
        | dict(zip(BAND_COLUMNS, s.curvature, strict=True))
        | dict(zip(PROBABILITY_COLUMNS, s.probability, strict=True))
        | {"why": statement(s)}
        for s in found
    ]
    return pd.DataFrame(rows).replace([np.inf, -np.inf], np.nan)


def statement(setting: Setting) -> str:
    """Say why a wanted curvature is not reached; empty if it is."""
    if setting.reached:
        return ""
    asked = f"{setting.wanted:g} 1/m at {setting.degradation:g} %"
    if np.isnan(setting.pressure):
        return f"{asked} is out of reach: no pressure is {_allowed_words(setting)}"
    middle = setting.curvature[2]
    reached = (
        f"; half of the specimens bend by more than {middle:.3g} 1/m there"
        if np.isfinite(middle)
        else ""
    )
    needed = setting.needed[1]
    wants = (
        f"half of the specimens need more than {needed:.4g} kPa"
        if np.isfinite(needed)
        else "half of the specimens never reach it"
    )
    return (
        f"{asked} is out of reach: {wants}, and {setting.pressure:.4g} kPa is the largest "
        f"pressure {_allowed_words(setting)}{reached}"
    )


def _allowed_words(setting: Setting) -> str:
    allowed, risk = setting.allowed, setting.risk
    if not allowed.found:
        return "that was tried"
    if allowed.by_rupture:
        return f"at which the probability of rupture is not above {risk:g}"
    return (
        f"at which not more than {100.0 * risk:g} % of the specimens balloon, burst, or lie "
        "outside the emulator's training"
    )


def warnings(stored: Stored, degradation: Floats, pressure: Floats) -> tuple[str, ...]:
    """Say what a user of predictions at these places should know.

    Parameters
    ----------
    stored : Stored
        Model and posterior, and what was measured.
    degradation : array
        [%].
    pressure : array
        [kPa].
    """
    return (*_about_model(stored), *extrapolations(stored.measured, degradation, pressure))


def extrapolations(
    measured: Mapping[str, Range], degradation: Floats, pressure: Floats
) -> tuple[str, ...]:
    """Say where predictions lie outside of what was measured.

    Parameters
    ----------
    measured : mapping
        As in `bayesdeg.pipeline.stored.Stored`.
    degradation, pressure : array
        [%] and [kPa].

    Examples
    --------
    >>> extrapolations({"pressure_kPa": (0.0, 240.0)}, np.array([0.0]), np.array([300.0]))
    ('pressures were measured up to 240 kPa: what is said of 300 kPa extrapolates',)
    """
    said = _outside_degradation(measured, degradation)
    highest = float(np.max(pressure, initial=0.0))
    tested = measured.get("pressure_kPa")
    if tested is not None and highest > 1.001 * tested[1]:
        said.append(
            f"pressures were measured up to {tested[1]:g} kPa: what is said of {highest:.4g} kPa "
            "extrapolates"
        )
    small = degradation[(degradation > 0.0) & (degradation < 1.0)]
    if len(small):
        said.append(f"degradation rates are in percent: {small[0]:g} is read as {small[0]:g} %")
    return tuple(said)


def _about_model(stored: Stored) -> tuple[str, ...]:
    said = []
    label = "base" if not stored.model.causes else "final"
    convergence = stored.run.convergence.get(label)
    if convergence is not None and not convergence.usable:
        said.append(convergence.sentence)
    if stored.verdict.outcome == "unexplained":
        said.append(
            "the run found a misfit that no cause explains: bands do not contain it, so curvatures "
            "may lie outside of them"
        )
    if stored.verdict.outcome == "ambiguous":
        said.append(
            f"the run could not tell {', '.join(stored.verdict.causes)} apart: predictions are "
            f"those of {stored.name}"
        )
    if "pressure_kPa" not in stored.measured:
        said.append(
            "no actuator was read in this study: predictions rest on films, priors and published "
            "statistics"
        )
    if not stored.model.has_elongation:
        said.append(
            "the study has no elongation at break (break.csv), so nothing is known of rupture; "
            "ballooning is"
        )
    return tuple(said)


def _outside_degradation(measured: Mapping[str, Range], degradation: Floats) -> list[str]:
    said = []
    for name, what in (("degradation_pct", "actuators"), ("film_degradation_pct", "films")):
        if name not in measured:
            continue
        low, high = measured[name]
        outside = degradation[(degradation < low - POINT) | (degradation > high + POINT)]
        if len(outside):
            at = f"at {low:g} %" if low == high else f"from {low:g} to {high:g} %"
            places = ", ".join(f"{level:g} %" for level in outside)
            said.append(f"{what} were measured {at}: what is said of {places} extrapolates")
    return said
