"""What a posterior says of new actuators: curvature, rupture, and the pressure for a curvature.

Every answer has warnings: extrapolations, conditions without effect, doubts about the model.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.observations.specimens import has_elongation
from bayesdeg.pages.wording import SPACE, sentences
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.control import Setting, largest_allowed, setting_for
from bayesdeg.prediction.experience import Experience
from bayesdeg.prediction.posterior import TIME, Posterior, Range
from bayesdeg.prediction.predictive import (
    QUANTILES,
    Specimens,
    curvature_bands,
    draw_specimens,
    moving_nothing,
    not_below,
    respond,
    rupture_table,
)
from bayesdeg.prediction.soil import Level, Soil
from bayesdeg.progress import Progress

Floats = NDArray[np.float64]

BAND_DRAWS, RUPTURE_DRAWS, ANSWER_DRAWS = 2000, 1000, 500
RATE_COLUMNS = ("degradation_q05", "degradation_q95")
PRESSURES_AT_ONCE = 40  # bounds the memory
LEAST_ANSWERED = 0.5  # share of the specimens below which there is no band
NEARLY_ALL = 0.99
BAND_COLUMNS = tuple(f"q{round(100 * q):02d}" for q in QUANTILES)
PROBABILITY_COLUMNS = ("probability", "probability_q05", "probability_q95")
NEEDED_COLUMNS = ("needed_q05_kPa", "needed_q50_kPa", "needed_q95_kPa")
POINT = 1.0  # tolerance of degradation rates outside the measured range [%]
MODEL, AVERAGE = "model", "average"
COURSE_STREAM = 3  # stream of the seed: draws of the course are independent of all others
UNITS = (
    {TIME: "h", "wanted_per_m": "1/m", "risk": "–", "reached": "1 yes, 0 no"}
    | dict.fromkeys(("pressure_kPa", "allowed_kPa", *NEEDED_COLUMNS), "kPa")
    | dict.fromkeys(("degradation_pct", *RATE_COLUMNS), "%")
    | dict.fromkeys(BAND_COLUMNS, "1/m")
    | dict.fromkeys((*PROBABILITY_COLUMNS, "answered"), "–")
)


@dataclass(frozen=True)
class Forecast:
    """What a posterior says of new specimens.

    Parameters
    ----------
    table : DataFrame
        With missing values where something is not finite.
    units : mapping of str to str
        By column.
    messages : tuple of str
        Warnings for its user.
    settings : tuple of Setting
        Of `control`, one a row.
    headline : str
        Of a lifetime, its summary in words.
    summary : mapping
        Numbers that belong to no row.
    """

    table: pd.DataFrame
    units: Mapping[str, str]
    messages: tuple[str, ...] = ()
    settings: tuple[Setting, ...] = ()
    headline: str = ""
    summary: Mapping[str, float | None] = field(default_factory=dict)


def stream_of(seed: int) -> np.random.SeedSequence:
    """Return the random stream of answers; a run uses others of its seed."""
    return np.random.SeedSequence([seed, 1])


def levels_after(hours: Floats, soil: Soil, seed: int) -> tuple[Level, ...]:
    """Return degradation rates after times in the soil [h], from the same draws for all times."""
    generator = np.random.default_rng([seed, COURSE_STREAM])
    return soil.drawn(generator, BAND_DRAWS).levels(hours)


def predict(
    posterior: Posterior,
    levels: Sequence[Level],
    pressure: Floats,
    *,
    seed: int,
    progress: Progress,
    conditions: ServiceConditions = PROMPT,
    by_each: bool = False,
) -> Forecast:
    """Predict curvature bands and rupture probabilities of a new specimen.

    Parameters
    ----------
    posterior : Posterior
        Of a model with actuators.
    levels : sequence of Level
        Degradation rates, known or after a time in the soil.
    pressure : array
        As read, rising [kPa].
    seed : int
        Everything random comes from it.
    progress : Progress
        Shows the levels.
    conditions : ServiceConditions
        Of the specimen.
    by_each : bool
        Whether to predict also by each of the sets of causes that are averaged, from the same
        random numbers; the column ``model`` is then ``average`` or the model by its causes.

    Returns
    -------
    Forecast
        For a time in the soil ``time_h`` and ``degradation_q05``, ``degradation_q95``; the columns
        of ``bands.csv`` and ``rupture.csv``; ``answered``, the share of specimens for which the
        forward map has an answer [–]; and ``why`` something is missing.
    """
    messages = cautions(posterior, levels, pressure, conditions)

    def predicted(one: Posterior) -> pd.DataFrame:
        first, second = stream_of(seed).spawn(2)
        specimens = draw_specimens(
            *(one.model, one.chain, np.random.default_rng(second)),
            draws=ANSWER_DRAWS,
            strata=4,
            conditions=conditions,
        )
        pieces = np.array_split(pressure, -(-len(pressure) // PRESSURES_AT_ONCE))
        progress.stage("predicting", total=len(levels) * len(pieces))
        frames = []
        for level in levels:
            for piece in pieces:
                frames.append(_predicted(one, specimens, level, piece, first))
                progress.advance(1, str(level) if len(levels) > 1 else "")
        return pd.concat(frames, ignore_index=True)

    table = predicted(posterior)
    if by_each and posterior.each:
        named = [(AVERAGE, table), *((one.name, predicted(one)) for one in posterior.each)]
        for name, frame in named:
            frame.insert(0, MODEL, name)
        table = pd.concat([frame for _, frame in named], ignore_index=True)
    return Forecast(table, UNITS, messages)


def _predicted(
    posterior: Posterior,
    specimens: Specimens,
    level: Level,
    pressure: Floats,
    seed: np.random.SeedSequence,
) -> pd.DataFrame:
    """Return predictions at one degradation rate; every row uses the same draws."""
    model, chain, conditions = posterior.model, posterior.chain, specimens.conditions
    table = curvature_bands(
        *(model, chain, np.random.default_rng(seed)),
        degradation=level.column(BAND_DRAWS),
        pressure=pressure,
        draws=BAND_DRAWS,
        conditions=conditions,
    )
    table[list(PROBABILITY_COLUMNS)] = np.nan
    if has_elongation(model.base):
        rupture = rupture_table(
            *(model, chain, np.random.default_rng(seed)),
            degradation=level.column(RUPTURE_DRAWS),
            pressure=pressure,
            draws=RUPTURE_DRAWS,
            specimens=posterior.checks(RUPTURE_DRAWS),
            conditions=conditions,
        )
        table[list(PROBABILITY_COLUMNS)] = rupture[list(PROBABILITY_COLUMNS)]
    answered = respond(specimens, level.of_draws(ANSWER_DRAWS), pressure).answered
    unknown = table["probability"].isna() & has_elongation(model.base)
    why = [
        said(
            "unanswered",
            left=1.0 - share,
            nothing=share <= LEAST_ANSWERED,
            some=share < NEARLY_ALL,
            lacks_rupture=bool(lacks),
        )
        for share, lacks in zip(answered, unknown, strict=True)
    ]
    table = table.assign(answered=answered, why=why)
    if not level.is_known:
        table.insert(0, TIME, level.hours)
        ends = zip(RATE_COLUMNS, level.interval[[0, -1]], strict=True)
        for place, (name, end) in enumerate(ends):
            table.insert(2 + place, name, end)
    return table


def said(part: str, **facts: object) -> str:
    """Fill a sentence of ``pages/templates/answers.j2``."""
    return sentences("answers", part, **facts).replace(SPACE, " ")


def control(
    posterior: Posterior,
    levels: Sequence[Level],
    wanted: Floats,
    *,
    risk: float,
    beyond: bool,
    seed: int,
    progress: Progress,
    conditions: ServiceConditions = PROMPT,
) -> Forecast:
    """Find the pressure for each wanted curvature at each degradation rate.

    Parameters
    ----------
    posterior, levels, seed, progress, conditions
        As of `predict`.
    wanted : array
        Curvatures [1/m].
    risk : float
        Largest accepted probability of rupture [–].
    beyond : bool
        Whether pressures above those tested are allowed: then the risk alone bounds them.
    """
    specimens = draw_specimens(
        *(posterior.model, posterior.chain, np.random.default_rng(stream_of(seed))),
        conditions=conditions,
    )
    first, checks = posterior.model.world.largest_pressure, posterior.checks()
    progress.stage("finding pressures", total=len(levels))
    found: list[Setting] = []
    for level in levels:
        rates = level.of_draws(len(specimens.score) // specimens.strata)
        ceiling = np.inf if beyond else ceiling_of(posterior.experience, level)
        allowed = largest_allowed(specimens, rates, risk, first=first, ceiling=ceiling)
        for curvature in wanted:
            one = setting_for(specimens, rates, curvature, risk=risk, first=first, allowed=allowed)
            known = not_below(one.probability, checks)
            found.append(replace(one, probability=known, hours=level.hours, rates=level.interval))
        progress.advance(1, str(level) if len(levels) > 1 else "")
    set_to = np.array([s.pressure for s in found if np.isfinite(s.pressure)])
    allowed_at = {float(rate): one.allowed.pressure for one in found for rate in one.rates}
    messages = (
        *cautions(posterior, levels, set_to, conditions),
        *basis(posterior, allowed_at, beyond=beyond),
        *small_risk(posterior, risk),
    )
    return Forecast(_settings_table(found), UNITS, messages, tuple(found))


def ceiling_of(experience: Experience, level: Level) -> float:
    """Return the pressure that tests allow at all likely degradation rates [kPa]."""
    return min(experience.ceiling(float(rate)) for rate in level.interval)


def _settings_table(found: Iterable[Setting]) -> pd.DataFrame:
    rows = [
        ({} if s.hours is None else {TIME: s.hours})
        | {"degradation_pct": s.degradation}
        | ({} if s.hours is None else dict(zip(RATE_COLUMNS, s.rates[[0, -1]], strict=True)))
        | {
            "wanted_per_m": s.wanted,
            "risk": s.risk,
            "reached": int(s.reached),
            "pressure_kPa": s.pressure,
        }
        | dict(zip(NEEDED_COLUMNS, s.needed, strict=True))
        | {"allowed_kPa": s.allowed.pressure}
        | dict(zip(BAND_COLUMNS, s.curvature, strict=True))
        | dict(zip(PROBABILITY_COLUMNS, s.probability, strict=True))
        | {"why": "" if s.reached else said("out_of_reach", s=s)}
        for s in found
    ]
    return pd.DataFrame(rows).replace([np.inf, -np.inf], np.nan)


# ---- what a user of answers should know


def basis(posterior: Posterior, allowed: Mapping[float, float], *, beyond: bool) -> Iterator[str]:
    """Say which tests limit pressures, or that higher ones rest on no test.

    ``allowed`` is the largest allowed pressure [kPa] by degradation rate [%].
    """
    experience = posterior.experience
    for one in dict.fromkeys(one for rate in allowed for one in experience.near(rate)):
        yield said("burst", b=one, tested=experience.pressure)
    over = {r: c for r, pressure in allowed.items() if pressure > (c := experience.ceiling(r))}
    if beyond and over:
        yield said("rests_on", over=over, strong=has_elongation(posterior.model.base))


def small_risk(posterior: Posterior, risk: float) -> Iterator[str]:
    """Warn about a risk below any probability that the specimens can support."""
    checks = posterior.checks()
    if has_elongation(posterior.model.base) and risk * checks < 1.0:
        yield said("small_risk", risk=risk, checks=checks)


def cautions(
    posterior: Posterior,
    levels: Sequence[Level],
    pressure: Floats,
    conditions: ServiceConditions,
) -> tuple[str, ...]:
    """Return the warnings for answers at these degradation rates and pressures [kPa]."""
    ends = [level.interval[[0, -1]] for level in levels]
    rates = np.unique(np.concatenate([np.empty(0), *ends]))
    if not all(level.is_known for level in levels):
        # after a time in the soil a small rate is not a fraction given by mistake
        rates = np.unique(np.where(_is_small(rates), 0.0, rates))
    longest = max((level.hours or 0.0 for level in levels), default=0.0)
    last = posterior.measured.get(TIME, (0.0, np.inf))[1]
    causes = [cause.name for cause in posterior.model.causes]
    without_effect = moving_nothing(
        posterior.model, posterior.chain, np.unique(rates[[0, -1]]), conditions
    )
    return (
        *_about_model(posterior),
        *extrapolations(posterior.measured, rates, pressure),
        *((said("hours_beyond", last=last, asked=longest),) if longest > 1.001 * last else ()),
        *(
            said("moves_nothing", name=name, value=getattr(conditions, name), causes=causes)
            for name in without_effect
        ),
    )


def extrapolations(
    measured: Mapping[str, Range], degradation: Floats, pressure: Floats
) -> tuple[str, ...]:
    """Warn about answers outside the measurements, at rates [%] and pressures [kPa].

    Examples
    --------
    >>> extrapolations({"pressure_kPa": (0.0, 240.0)}, np.array([0.0]), np.array([300.0]))
    ('pressures were measured up to 240 kPa: predictions at 300 kPa are extrapolations',)
    """
    found = []
    for name, what in (("degradation_pct", "actuators"), ("film_degradation_pct", "films")):
        if name in measured:
            low, high = measured[name]
            outside = degradation[(degradation < low - POINT) | (degradation > high + POINT)]
            if len(outside):
                facts = {"what": what, "low": low, "high": high, "asked": outside.tolist()}
                found.append(said("rates_beyond", **facts))
    tested, highest = measured.get("pressure_kPa"), float(np.max(pressure, initial=0.0))
    if tested is not None and highest > 1.001 * tested[1]:
        found.append(said("pressures_beyond", high=tested[1], asked=highest))
    found += [said("small_rate", rate=r) for r in degradation[_is_small(degradation)][:1]]
    return tuple(found)


def _is_small(degradation: Floats) -> NDArray[np.bool_]:
    """Return rates that look like fractions instead of percent."""
    return (degradation > 0.0) & (degradation < 1.0)


def _about_model(posterior: Posterior) -> Iterator[str]:
    """Yield warnings from the run, its verdict and its data."""
    averaged = posterior.members
    if not posterior.is_stored:
        if averaged:
            yield said("averaged", members=averaged, by_command=False)
        return
    run, verdict = posterior.run, posterior.verdict
    convergence = run.convergence.get("final" if posterior.model.causes else "base")
    if convergence is not None and not convergence.usable:
        yield convergence.sentence
    if verdict.outcome == "unexplained":
        yield said("unexplained")
    if averaged:
        yield said("averaged", members=averaged, by_command=True)
    elif verdict.outcome == "ambiguous":
        yield said("ambiguous", causes=verdict.causes, model=posterior.name)
    if run.update is not None:
        yield said("updated", update=run.update)
    if "pressure_kPa" not in posterior.measured:
        yield said("no_actuator")
    if not has_elongation(posterior.model.base):
        yield said("no_rupture")
