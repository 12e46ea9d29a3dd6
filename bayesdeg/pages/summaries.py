"""The tables of a run folder, arranged as the page shows them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.criticism.outcome import Outcome
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.pages.tables import ALL_LEVELS, present
from bayesdeg.pages.wording import number

BASE = "base"
FINAL = "final"
MOST_LEVELS = 9
LEAST_PART = 0.05  # rounding of a gain in log density shown to one decimal
WIDE = 10.0  # a positive prior whose ends differ by this factor is drawn on a logarithmic scale

type Row = dict[str, float | str | None]


@dataclass(frozen=True)
class LevelRow:
    """How well the models describe one degradation rate; None where a model is absent."""

    level: str
    n: float | None
    base_r_squared: float | None
    final_r_squared: float | None
    published_r_squared: float | None
    base_rms: float | None
    final_rms: float | None


@dataclass(frozen=True)
class TensileError:
    """Error of a model in one mode of loading, over all its readings.

    Parameters
    ----------
    model, mode : str
        Which model, which mode.
    fitted : bool
        Whether the model was fitted to these readings, or they were held out.
    n : int
        Number of readings.
    rms : float
        Root mean square of measured less predicted nominal stress [MPa].
    largest : float
        Largest measured nominal stress [MPa].
    inside : float
        Fraction of readings inside the 90 % interval.
    """

    model: str
    mode: str
    fitted: bool
    n: int
    rms: float
    largest: float
    inside: float


@dataclass(frozen=True)
class Span:
    """Position and width of an interval on a bar, in percent of its length."""

    left: float
    width: float


@dataclass(frozen=True)
class ParameterRow:
    """One parameter of one model, with its prior and posterior 90 % intervals drawn to scale.

    Parameters
    ----------
    row : dict
        Cells of the table.
    prior, posterior : Span, optional
        Where the intervals lie; None if an end is not known.
    logarithmic : bool
        Whether the scale is logarithmic, as for a prior that spans powers of ten.
    """

    row: Row
    prior: Span | None
    posterior: Span | None
    logarithmic: bool = False


@dataclass(frozen=True)
class DecisionPair:
    """The pressures that each model would have chosen at one degradation rate.

    Parameters
    ----------
    degradation_pct, wanted_per_m : float
        Degradation rate, and the wanted curvature.
    before : dict
        Row of ``decisions.csv`` of the base model.
    after : dict or None
        That of the final model; None where nothing was added to the base model.
    """

    degradation_pct: float
    wanted_per_m: float
    before: Row
    after: Row | None

    @property
    def change_kPa(self) -> float | None:  # noqa: N802  a unit
        """Difference of the pressures [kPa]; None if one of them is unknown."""
        ends = [row["needed_q50_kPa"] for row in (self.before, self.after) if row]
        known = [float(end) for end in ends if end is not None]
        return known[1] - known[0] if len(known) > 1 else None


@dataclass(frozen=True)
class GainParts:
    """Parts of the gain of a cause in log predictive density of all held-out data."""

    total: float
    total_se: float | None
    here: float

    @property
    def beside(self) -> float:
        """The part of films and measured means, which are not in ``gain.csv``."""
        return self.total - self.here


def rows_of(frame: pd.DataFrame | None) -> list[Row]:
    """Return a table row by row, missing values as None.

    Examples
    --------
    >>> rows_of(pd.DataFrame({"a": [1.0, np.nan], "b": ["x", None]}))
    [{'a': 1.0, 'b': 'x'}, {'a': None, 'b': None}]
    """
    if frame is None:
        return []
    plain = frame.astype(object).where(frame.notna(), None)
    return [{str(key): value for key, value in row.items()} for row in plain.to_dict("records")]


def farthest_first(absorption: pd.DataFrame | None) -> list[Row]:
    """Return the parameters that were judged, the most displaced first.

    Examples
    --------
    >>> table = pd.DataFrame({"parameter": ["a", "b", "c"], "score_sd": [1.0, np.nan, -4.0]})
    >>> [row["parameter"] for row in farthest_first(table)]
    ['c', 'a']
    """
    if absorption is None:
        return []
    judged = absorption[absorption["score_sd"].notna()]
    return rows_of(judged.sort_values("score_sd", key=lambda score: -score.abs(), kind="stable"))


def models_of(frame: pd.DataFrame | None) -> tuple[str, ...]:
    """Return the models of a table in its order."""
    return () if frame is None else tuple(dict.fromkeys(frame["model"].astype(str)))


def extended_model(gain: pd.DataFrame | None, verdict: VerdictRecord) -> str | None:
    """Return the name in ``gain.csv`` of the base model extended by the causes that act.

    These are the named causes and, from each list of which one more acts, the first, which the
    evidence favours: with the named causes alone a model may predict worse than with none. Causes
    shown by rupture counts are excluded: they change no predicted reading.

    Examples
    --------
    >>> from bayesdeg.pages.record import VerdictRecord
    >>> gain = pd.DataFrame({"model": ["base", "base+creep"]})
    >>> extended_model(gain, VerdictRecord.read({"outcome": "named", "causes": ["creep"]}))
    'base+creep'
    >>> gain = pd.DataFrame({"model": ["base", "base+creep", "base+creep+pressure_loss"]})
    >>> lists = [["creep"], ["pressure_loss", "film_mismatch"]]
    >>> both = VerdictRecord.read({"outcome": "named", "causes": ["creep"], "sets": lists})
    >>> extended_model(gain, both)
    'base+creep+pressure_loss'
    """
    if verdict.outcome is not Outcome.NAMED:
        return None
    of_counts = {name for one in verdict.rupture_counts for name in one.explained_by}
    beside = {names[0] for names in verdict.sets} or set(next(iter(verdict.alternatives), ()))
    known = models_of(gain)
    for causes in ({*verdict.causes, *beside} - of_counts, {*verdict.causes} - of_counts):
        for model in known if causes else ():
            if model == FINAL or set(model.split("+")) == {BASE, *causes}:
                return model
    return None


def gain_parts(gain: pd.DataFrame | None, verdict: VerdictRecord) -> GainParts | None:
    """Return the parts of the gain of a single cause; None if there is one part or several causes.

    A cause is judged by all held-out data, while ``gain.csv`` scores what the study predicts.
    """
    extended = extended_model(gain, verdict)
    alone = len(verdict.causes) == 1 and len(verdict.sets) < 2 and not verdict.alternatives
    found = verdict.candidate(verdict.causes[0]) if alone else None
    rows = {row["model"]: row for row in rows_of(pooled(gain))}
    here = rows[extended]["elpd_diff"] if extended in rows else None
    if found is None or found.elpd_diff is None or here is None:
        return None
    parts = GainParts(found.elpd_diff, found.elpd_diff_se, float(here))
    return None if abs(parts.beside) < LEAST_PART else parts


def by_criterion(criteria: pd.DataFrame | None) -> list[Row]:
    """Return one row per degradation rate at the largest pressure, one column per criterion.

    Examples
    --------
    >>> table = pd.DataFrame({"criterion": ["principal_stretch", "strain_energy"],
    ...     "degradation_pct": 0.0, "pressure_kPa": 240.0, "probability": [0.1, 0.2]})
    >>> by_criterion(table)[0]["strain_energy"]
    0.2
    """
    if criteria is None or criteria.empty:
        return []
    last = criteria[criteria["pressure_kPa"] == criteria["pressure_kPa"].max()]
    rows = [
        {"degradation_pct": level, "pressure_kPa": some["pressure_kPa"].iloc[0]}
        | dict(zip(some["criterion"], some["probability"], strict=True))
        for level, some in last.groupby("degradation_pct")
    ]
    return rows_of(pd.DataFrame(rows))


def influence_of_criteria(criteria: pd.DataFrame | None, *, degrades: bool = True) -> str:
    """Return the largest difference between criteria in a probability of rupture; empty if none.

    Examples
    --------
    >>> table = pd.DataFrame({"criterion": ["principal_stretch", "strain_energy"],
    ...     "degradation_pct": 0.0, "pressure_kPa": 240.0, "probability": [0.1, 0.2]})
    >>> influence_of_criteria(table)
    'from 0.100 to 0.200 at 0 % and 240 kPa'
    """
    if criteria is None or criteria.empty:
        return ""
    grouped = criteria.groupby(["degradation_pct", "pressure_kPa"])["probability"]
    ends = grouped.agg(["min", "max"]).dropna()
    if ends.empty:
        return ""
    spread = (ends["max"] - ends["min"]).to_numpy()
    place = int(np.argmax(spread))
    level, pressure = ends.index[place]
    low, high = (number(float(ends[name].iloc[place])) for name in ("min", "max"))
    rate = f"{level:g} % and " if degrades else ""
    return f"from {low} to {high} at {rate}{pressure:g} kPa"


def decision_pairs(decisions: pd.DataFrame | None) -> list[DecisionPair]:
    """Return the decisions of the base and the final model side by side, by rate."""
    by_rate: dict[float, list[Row]] = {}
    for row in rows_of(decisions):
        by_rate.setdefault(float(row["degradation_pct"] or 0.0), []).append(row)
    return [
        DecisionPair(
            rate, float(rows[0]["wanted_per_m"] or 0.0), rows[0], rows[1] if len(rows) > 1 else None
        )
        for rate, rows in sorted(by_rate.items())
    ]


def pooled(gain: pd.DataFrame | None) -> pd.DataFrame | None:
    """Return the rows of a table that pool every degradation rate."""
    return None if gain is None else present(gain[gain["degradation_pct"] == ALL_LEVELS])


def by_level(table: pd.DataFrame | None) -> pd.DataFrame | None:
    """Return the rows of a table that hold for one degradation rate, as numbers."""
    if table is None:
        return None
    single = table[table["degradation_pct"] != ALL_LEVELS]
    return present(single.assign(degradation_pct=single["degradation_pct"].astype(float)))


def several_levels(table: pd.DataFrame | None) -> pd.DataFrame | None:
    """Return the rows by degradation rate if there are several; else the pooled row suffices."""
    single = by_level(table)
    return None if single is None or single["degradation_pct"].nunique() < 2 else single


def level_rows(levels: pd.DataFrame | None) -> list[LevelRow]:
    """Return the models side by side, one row per degradation rate, the pooled row last."""
    rows: dict[str, dict[str, Row]] = {}
    for row in rows_of(levels):
        level = str(row["degradation_pct"])
        rows.setdefault(level, {})[str(row["model"])] = row

    def cell(level: str, model: str, column: str) -> float | None:
        value = rows[level].get(model, {}).get(column)
        return float(value) if value is not None else None

    found = []
    for level in sorted(rows, key=lambda one: (one == ALL_LEVELS, float(one.replace("all", "0")))):
        models = list(rows[level])
        published = (cell(level, model, "published_r_squared") for model in models)
        found.append(
            LevelRow(
                level,
                cell(level, models[0], "n"),
                cell(level, BASE, "r_squared"),
                cell(level, FINAL, "r_squared"),
                next((value for value in published if value is not None), None),
                cell(level, BASE, "rms_per_m"),
                cell(level, FINAL, "rms_per_m"),
            )
        )
    return found


def tensile_errors(tensile: pd.DataFrame | None) -> list[TensileError]:
    """Return the error of every model in every mode, held-out modes first.

    Examples
    --------
    >>> curve = {"model": "base", "mode": "planar", "fitted": 0.0, "stress_MPa": [1.0, 3.0],
    ...          "mean_MPa": [1.0, 2.0], "q05_MPa": [0.9, 1.9], "q95_MPa": [1.1, 2.1]}
    >>> error = tensile_errors(pd.DataFrame(curve))[0]
    >>> round(error.rms, 4), error.inside
    (0.7071, 0.5)
    """
    if tensile is None:
        return []
    groups = tensile.groupby(["fitted", "mode", "model"], sort=False)
    errors = [
        TensileError(
            str(model),
            str(mode),
            bool(fitted),
            len(curve),
            float(np.sqrt(np.mean((curve["stress_MPa"] - curve["mean_MPa"]) ** 2))),
            float(curve["stress_MPa"].max()),
            float(curve["stress_MPa"].between(curve["q05_MPa"], curve["q95_MPa"]).mean()),
        )
        for (fitted, mode, model), curve in groups
    ]
    return sorted(errors, key=lambda error: error.fitted)


def meanings_of(parameters: pd.DataFrame | None) -> dict[str, str]:
    """Return what each parameter means, by its name in the posterior."""
    return {str(row["parameter"]): str(row["meaning"] or "") for row in rows_of(parameters)}


def parameter_rows(parameters: pd.DataFrame | None) -> list[ParameterRow]:
    """Return the parameters, each with prior and posterior intervals on its own scale.

    Parameters of a final model that is the base model are not repeated.
    """
    if parameters is None:
        return []
    once = ~parameters.duplicated([name for name in parameters if name != "model"])
    return [_parameter_row(row) for row in rows_of(parameters[once])]


def _parameter_row(row: Row) -> ParameterRow:
    """Return a parameter with its intervals, on a logarithmic scale if its prior is wide."""
    ends = [row[key] for key in ("prior_q05", "prior_q95", "q05", "q95")]
    if any(end is None for end in ends):
        return ParameterRow(row, None, None)
    values = np.array([float(end) for end in ends if end is not None])
    logarithmic = bool(values.min() > 0.0 and values[1] > WIDE * values[0])
    if logarithmic:
        values = np.log(values)
    start = values.min()
    places = 100.0 * (values - start) / (float(np.ptp(values)) or 1.0)
    low, high, own_low, own_high = places.tolist()
    return ParameterRow(row, Span(low, high - low), Span(own_low, own_high - own_low), logarithmic)


def panel_levels(*tables: pd.DataFrame | None) -> list[float]:
    """Return the degradation rates that get a panel: those of the first table that has any.

    More than nine are merged to multiples of 5 %, then thinned evenly.
    """
    for table in tables:
        if table is not None and not table.empty:
            values = np.unique(table["degradation_pct"].to_numpy(float))
            if values.size > MOST_LEVELS:
                values = np.unique(5.0 * np.round(values / 5.0))
            keep = (
                np.linspace(0, values.size - 1, min(values.size, MOST_LEVELS)).round().astype(int)
            )
            return [float(value) for value in values[keep]]
    return []


def nearest_level(
    degradation_pct: npt.ArrayLike, levels: Sequence[float]
) -> npt.NDArray[np.float64]:
    """Return for each degradation rate the nearest of the levels that get a panel.

    Examples
    --------
    >>> nearest_level([0.4, 9.1, 14.0], [0.0, 10.0, 15.0]).tolist()
    [0.0, 10.0, 15.0]
    """
    grid = np.asarray(levels, float)
    distance = np.abs(np.asarray(degradation_pct, float)[:, None] - grid)
    return np.asarray(grid[np.argmin(distance, axis=1)], float)
