"""The tables of a run folder: every column with its unit and meaning, in the order of the file.

This is the only list of them: the folder writes and reads these tables, the page shows them, and a
run makes it (`bayesdeg.run.writing.BUILDS`).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import Final

import pandas as pd

from bayesdeg.criticism.findings import Displacement
from bayesdeg.records import Record

GAIN = "gain"
GAIN_LEVELS = "gain_levels"
GAIN_MODES = "gain_modes"
BANDS = "bands"
RUPTURE = "rupture"
CRITERIA = "criteria"
OBSERVATIONS = "observations"
FITTED = "fitted"
TENSILE = "tensile"
CONSTANTS = "constants"
PARAMETERS = "parameters"
LEVELS = "levels"
ELONGATION = "elongation"
MEASURED = "measured"
MISFIT_NULL = "misfit_null"
LEAVE_ONE_OUT = "leave_one_out"
PRIOR_SENSITIVITY = "prior_sensitivity"
PRIOR_PREDICTIVE = "prior_predictive"
COURSE = "course"
ORDERS = "orders"
MATERIAL_LAWS = "material_laws"
DECISIONS = "decisions"
LIFETIME = "lifetime"
STATISTICS = "statistics"
LOO_PIT = "loo_pit"
DISCREPANCY = "discrepancy"
SHARES = "shares"
SUSPECTS = "suspects"
SET_ASIDE = "set_aside"
TRACES = "traces"
PHOTO_LINES = "photo_lines"
ABSORPTION = "absorption"
PUSHES = "pushes"
MISSING_TERMS = "missing_terms"
MISFIT_COLUMNS = "misfit_columns"
TERM_READINGS = "missing_terms_readings"
SETS = "sets"

ALL_LEVELS = "all"
"""Value of ``degradation_pct`` in a row that pools every degradation rate."""


class CellKind(Enum):
    """What the cells of a column hold."""

    NUMBER = "a number"
    TEXT = "a text"
    LEVEL = "a degradation rate or 'all'"


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Parameters
    ----------
    name : str
        Header in the file.
    unit : str
        Unit; an en dash if it has none.
    meaning : str
        In a few words.
    kind : CellKind
        What the cells hold; an empty cell means "not available".
    finite : bool
        Whether a number must be finite; what is not is written as "not available".
    may_be_empty : bool
        Whether a cell may be "not available"; False for columns that identify the row.
    field : str
        The field of a record that fills it, where it has one.
    """

    name: str
    unit: str
    meaning: str
    kind: CellKind = CellKind.NUMBER
    finite: bool = True
    may_be_empty: bool = True
    field: str = ""


def _cell(value: object) -> object:
    """Return a value of a record as a table holds it: sets of causes as ``a+b or c``."""
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, tuple):
        return " or ".join(one if isinstance(one, str) else "+".join(one) for one in value)
    return value


@dataclass(frozen=True)
class ResultTable:
    """A table of the run folder.

    Parameters
    ----------
    name : str
        Of its file, without the ending.
    columns : tuple of Column
        In the order of the file, which may hold more; those are kept.
    """

    name: str
    columns: tuple[Column, ...]

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"{self.name}.csv"

    @property
    def headings(self) -> list[str]:
        """The names of its columns."""
        return [column.name for column in self.columns]

    def rows(self, records: Iterable[Record]) -> pd.DataFrame | None:
        """Return the table of records, a row each; None without any."""
        rows = [
            {c.name: _cell(getattr(one, c.field or c.name)) for c in self.columns}
            for one in records
        ]
        return pd.DataFrame(rows) if rows else None

    def empty(self) -> pd.DataFrame:
        """Return the table without rows."""
        return pd.DataFrame(columns=self.headings)


def columns_of(record: type[Record], *names: str, unit: str = "–") -> tuple[Column, ...]:
    """Return the columns of a table made of fields of a record.

    Parameters
    ----------
    record : type
        Its fields have the meaning, and the unit in brackets.
    *names : str
        Of the fields.
    unit : str
        Of those whose meaning does not end with a unit.

    Examples
    --------
    >>> from bayesdeg.criticism.findings import LevelMisfit
    >>> columns_of(LevelMisfit, "excess_pct")[0].unit
    '%'
    """
    found = []
    for name in names:
        field = record.model_fields[name]
        meaning, _, own = (field.description or "").removesuffix("]").partition(" [")
        extra = field.json_schema_extra
        header = str(extra["column"]) if isinstance(extra, dict) else name
        is_text = isinstance(field.default, str | tuple)
        kind = CellKind.TEXT if is_text else CellKind.NUMBER
        found.append(Column(header, own or ("–" if is_text else unit), meaning, kind, field=name))
    return tuple(found)


def _log(name: str, meaning: str) -> Column:
    """Return a column of log densities or tails, which may be infinite."""
    return Column(name, "–", meaning, finite=False)


def _text(name: str, meaning: str) -> Column:
    return Column(name, "–", meaning, CellKind.TEXT)


_MODEL = replace(
    _text("model", "base, base with the added causes, or the course of degradation alone"),
    may_be_empty=False,
)
_LEVEL = Column(
    "degradation_pct",
    "%",
    "degradation rate, or all of them pooled",
    CellKind.LEVEL,
    may_be_empty=False,
)
_DEGRADATION = Column("degradation_pct", "%", "degradation rate")
_PRESSURE = Column("pressure_kPa", "kPa", "gauge pressure")
_SPECIMEN = _text("specimen_id", "the specimen")


def _quantiles(unit: str, *percents: int, prefix: str = "", suffix: str = "") -> tuple[Column, ...]:
    return tuple(
        Column(f"{prefix}q{percent:02d}{suffix}", unit, f"{percent} % quantile")
        for percent in percents
    )


_AGREEMENT = (
    Column("r_squared", "–", "1 − SSE/SST"),
    Column("coverage_50", "–", "fraction of readings inside the 50 % interval"),
    Column("coverage_90", "–", "fraction of readings inside the 90 % interval"),
)
_GAIN = (
    _MODEL,
    _LEVEL,
    _log("elpd", "expected log predictive density of held-out specimens"),
    _log("elpd_se", "its standard error"),
    _log("elpd_diff", "its difference to the base model; positive is better"),
    _log("elpd_diff_se", "standard error of the difference"),
    Column("rmse_per_m", "1/m", "root mean square error of the prediction"),
    Column("crps_per_m", "1/m", "continuous ranked probability score"),
    *_AGREEMENT,
)

_TABLES = (
    ResultTable(GAIN, _GAIN),
    ResultTable(GAIN_LEVELS, _GAIN),
    ResultTable(
        GAIN_MODES,
        (
            _MODEL,
            _text("mode", "uniaxial, equibiaxial or planar: held out, predicted from the others"),
            _log("elpd", "log predictive density of the mode's readings"),
            _log("elpd_diff", "its difference to the base model; positive is better"),
            Column("rmse_MPa", "MPa", "root mean square error of the prediction"),
            Column("crps_MPa", "MPa", "continuous ranked probability score"),
            *_AGREEMENT,
        ),
    ),
    ResultTable(
        STATISTICS,
        (
            _text("statistic", "what is measured"),
            Column("value", "as stated", "on the data"),
            _text("unit", "unit of value and quantiles"),
            Column("simulated_q05", "as stated", "5 % quantile on data simulated from the model"),
            Column("simulated_q95", "as stated", "95 % quantile on such data"),
            Column("p_value", "–", "share of simulated data at least as extreme"),
            Column("p_adjusted", "–", "the same for all statistics together"),
            _text("reading", "what it means physically"),
        ),
    ),
    ResultTable(
        LOO_PIT,
        (
            _MODEL,
            Column("probability", "–", "predictive probability at which the share is compared"),
            Column("difference", "–", "share of readings below it less that probability"),
            Column("low", "–", "lower end of the 95 % band for whole curves"),
            Column("high", "–", "upper end of it"),
            Column("p_value", "–", "share of simulated readings that depart as much"),
            _text("sentence", "what it means"),
        ),
    ),
    ResultTable(
        DISCREPANCY,
        (
            _MODEL,
            _text("kind", "what was read"),
            _text("history", "branch, cycle and mount, or mode of tension"),
            _SPECIMEN,
            _DEGRADATION,
            Column("along", "as stated", "pressure [kPa] or stretch [–]"),
            Column("discrepancy", "as read", "smooth discrepancy of the model"),
            Column(
                "residual", "as read", "reading less model, fitted together with the discrepancy"
            ),
        ),
    ),
    ResultTable(
        DECISIONS,
        (
            _MODEL,
            _DEGRADATION,
            Column("wanted_per_m", "1/m", "wanted curvature: half of the largest measured"),
            Column("needed_q05_kPa", "kPa", "pressure that 5 % of new specimens need less than"),
            Column("needed_q50_kPa", "kPa", "pressure that half of new specimens need"),
            Column("needed_q95_kPa", "kPa", "pressure that 95 % of new specimens need less than"),
            Column(
                "allowed_kPa",
                "kPa",
                "largest pressure that was tested and has a risk not above 5 %",
            ),
            Column(
                "probability",
                "–",
                "probability of rupture at the pressure that half need, not below one in the "
                "specimens tested",
            ),
            Column(
                "rupture_checks",
                "–",
                "specimens tested, as the model knows them: films broken and actuators loaded",
            ),
        ),
    ),
    ResultTable(BANDS, (_DEGRADATION, _PRESSURE, *_quantiles("1/m", 5, 25, 50, 75, 95))),
    ResultTable(
        RUPTURE,
        (
            _DEGRADATION,
            _PRESSURE,
            Column(
                "probability",
                "–",
                "probability of rupture up to this pressure, not below one in the specimens tested",
            ),
            Column("probability_q05", "–", "5 % quantile of it"),
            Column("probability_q95", "–", "95 % quantile of it"),
        ),
    ),
    ResultTable(
        CRITERIA,
        (
            _text(
                "criterion",
                "measure of the wall's state that is compared with the elongation at break",
            ),
            _DEGRADATION,
            _PRESSURE,
            Column("probability", "–", "probability of rupture up to this pressure by it"),
            Column("probability_q05", "–", "5 % quantile of it"),
            Column("probability_q95", "–", "95 % quantile of it"),
        ),
    ),
    ResultTable(
        OBSERVATIONS,
        (
            _MODEL,
            _SPECIMEN,
            _DEGRADATION,
            _PRESSURE,
            _text("branch", "loading or unloading"),
            Column("cycle", "–", "loading cycle"),
            Column("curvature_per_m", "1/m", "measured curvature"),
            Column("mean_per_m", "1/m", "posterior predictive mean"),
            *_quantiles("1/m", 5, 95, suffix="_per_m"),
            Column("residual_per_m", "1/m", "measured less predictive mean"),
        ),
    ),
    ResultTable(
        FITTED,
        (
            _MODEL,
            _text("kind", "what was read"),
            _text("unit", "unit of the readings"),
            _SPECIMEN,
            Column(
                "level",
                "as stated",
                "degradation rate, or another quantity that was set for a specimen",
            ),
            _text("level_unit", "unit of the level"),
            _text("history", "branch, cycle and mount, or another history of loading"),
            Column("along", "as stated", "what was varied in the test"),
            _text("axis", "what that is, with its unit"),
            Column("measured", "as stated", "reading"),
            Column("mean", "as stated", "posterior mean for an average specimen"),
            *_quantiles("as stated", 5, 25, 75, 95),
        ),
    ),
    ResultTable(
        TENSILE,
        (
            _MODEL,
            _SPECIMEN,
            _text("mode", "uniaxial, equibiaxial or planar"),
            _DEGRADATION,
            Column("stretch", "–", "stretch along the load"),
            Column("stress_MPa", "MPa", "measured nominal stress"),
            Column("fitted", "–", "1 if the model was fitted to it, 0 if it was held out"),
            Column("mean_MPa", "MPa", "posterior predictive mean"),
            *_quantiles("MPa", 5, 95, suffix="_MPa"),
        ),
    ),
    ResultTable(
        CONSTANTS,
        (
            _MODEL,
            _DEGRADATION,
            _text("constant", "c1, c2, c3 or young_modulus"),
            _text("unit", "unit of the quantiles"),
            *_quantiles("as stated", 5, 25, 50, 75, 95),
        ),
    ),
    ResultTable(
        PARAMETERS,
        (
            _MODEL,
            _text("parameter", "name in the posterior"),
            _text("unit", "unit of its values"),
            _text("meaning", "what it is"),
            Column("mean", "as stated", "posterior mean"),
            Column("sd", "as stated", "posterior standard deviation"),
            *_quantiles("as stated", 5, 50, 95),
            *_quantiles("as stated", 5, 50, 95, prefix="prior_"),
            Column("r_hat", "–", "R̂ over independent ensembles"),
            Column("ess_bulk", "–", "effective sample size, bulk"),
            Column("ess_tail", "–", "effective sample size, tails"),
        ),
    ),
    ResultTable(
        LEVELS,
        (
            _MODEL,
            _LEVEL,
            Column("n", "–", "number of readings"),
            Column("r_squared", "–", "1 − SSE/SST, pooled over the readings"),
            Column("rms_per_m", "1/m", "root mean square residual"),
            Column("published_r_squared", "–", "as published for another simulation"),
        ),
    ),
    ResultTable(
        ELONGATION,
        (
            _text("kind", "band or measured"),
            _DEGRADATION,
            Column("value", "%", "measured elongation at break; empty for the band"),
            *_quantiles("%", 5, 50, 95),
        ),
    ),
    ResultTable(
        MEASURED,
        (
            _text("quantity", "which quantity"),
            _DEGRADATION,
            Column("value", "as stated", "its value"),
            Column("sd", "as stated", "its standard deviation"),
            _text("unit", "unit of value and standard deviation"),
            Column("n", "–", "number of specimens"),
            _text("rests_on", "what it was computed from"),
        ),
    ),
    ResultTable(
        LEAVE_ONE_OUT,
        (
            _SPECIMEN,
            _text("kind", "kinds of reading on it, all of which are left out"),
            _log("elpd", "log predictive density of its readings given the other specimens"),
            _log("elpd_error", "Monte Carlo standard error of it"),
            _log("influence", "what its own readings add to its log density"),
            _log("pareto_k", "shape of the tail of the importance weights"),
            Column("refitted", "–", "1 if the model was calibrated again without it"),
        ),
    ),
    ResultTable(
        PRIOR_SENSITIVITY,
        (
            _text("quantity", "a conclusion of the report, or a parameter"),
            _text("kind", "conclusion or parameter"),
            Column("prior", "–", "change of its posterior per doubling of the priors' power"),
            Column("likelihood", "–", "the same for the likelihood"),
            Column("prior_noise", "–", "the change that unrelated draws would show for the priors"),
            Column(
                "likelihood_noise",
                "–",
                "the change that unrelated draws would show for the likelihood",
            ),
            Column("shift_sd", "–", "shift of its mean over its sd per doubling of the priors"),
            _text("diagnosis", "data, prior, prior and data, or neither"),
            _text("hangs_on", "parameter whose own prior matters most"),
            _text("rests_on", "kind of data that matters most"),
        ),
    ),
    ResultTable(
        PRIOR_PREDICTIVE,
        (
            _text("quantity", "curvature or nominal_stress"),
            _text("mode", "of a stress: uniaxial, equibiaxial or planar"),
            _DEGRADATION,
            Column("pressure_kPa", "kPa", "gauge pressure; empty for a stress"),
            Column("stretch", "–", "stretch along the load; empty for a curvature"),
            _text("unit", "unit of the quantiles"),
            Column("answered", "–", "share of the prior draws that could be computed"),
            *_quantiles("as stated", 5, 25, 50, 75, 95),
        ),
    ),
    ResultTable(
        COURSE,
        (
            _text("kind", "band or film"),
            _text("film_id", "the film; empty for the band"),
            Column("time_h", "h", "time in the soil"),
            Column("moisture_pct", "%", "measured moisture content, wet basis"),
            Column(
                "degradation_pct",
                "%",
                "degradation rate of a film relative to the mean fresh moisture",
            ),
            *_quantiles("%", 5, 25, 50, 75, 95),
            *_quantiles("%", 5, 50, 95, prefix="moisture_"),
        ),
    ),
    ResultTable(
        LIFETIME,
        (
            Column("time_h", "h", "time in the soil"),
            Column("pressure_kPa", "kPa", "pressure of the duty"),
            Column("wanted_per_m", "1/m", "curvature of the duty"),
            Column("risk", "–", "largest probability of rupture that is accepted"),
            *_quantiles("%", 5, 50, 95, prefix="degradation_"),
            *_quantiles("1/m", 5, 50, 95, suffix="_per_m"),
            Column(
                "burst_probability",
                "–",
                "probability of having burst, ballooned or left the emulator's range by then",
            ),
            *_quantiles("–", 5, 95, prefix="burst_"),
            Column("lost_probability", "–", "probability of bending less than wanted by then"),
            Column("failed_probability", "–", "probability of either by then"),
            *_quantiles("–", 5, 95, prefix="failed_"),
            Column("needed_q05_kPa", "kPa", "pressure that 5 % of new specimens need less than"),
            Column("needed_q50_kPa", "kPa", "pressure that half of new specimens need"),
            Column("needed_q95_kPa", "kPa", "pressure that 95 % of new specimens need less than"),
            Column("allowed_kPa", "kPa", "largest pressure that the tests and the risk allow"),
            Column("reachable", "–", "share of new specimens that need no more than is allowed"),
        ),
    ),
    ResultTable(
        ORDERS,
        (
            Column("order", "–", "order of the polynomials of the degradation rate"),
            Column("used", "–", "1 for the order of the study's model"),
            Column("parameters", "–", "number of parameters"),
            _log("log_evidence", "log marginal likelihood of the films"),
            _log("log_evidence_error", "Monte Carlo standard error of it"),
            _log("log_bayes_factor", "its difference to the order used"),
            _log("log_bayes_factor_error", "Monte Carlo standard error of it"),
            _log("elpd", "log predictive density of held-out films"),
            _log("elpd_diff", "its difference to the order used; positive is better"),
            _log("elpd_diff_se", "standard error of it, over films"),
            Column("films", "–", "number of films, each left out in turn"),
            _log("pareto_k_max", "heaviest tail of the importance weights"),
            Column("refitted", "–", "films for which the model was calibrated again"),
            Column("effective", "–", "effective draws behind the evidence"),
        ),
    ),
    ResultTable(
        MATERIAL_LAWS,
        (
            _text("law", "yeoh, neo_hookean, mooney_rivlin, gent or ogden"),
            _LEVEL,
            Column("used", "–", "1 for the law of the study's model"),
            Column("parameters", "–", "number of constants at a degradation rate"),
            Column("films", "–", "number of films that are fitted"),
            Column("held_out", "–", "number of films that were left out in turn"),
            _log("elpd", "log predictive density of held-out films"),
            _log("elpd_diff", "its difference to the law used; positive is better"),
            _log("elpd_diff_se", "standard error of it, over films"),
            Column("rmse_MPa", "MPa", "root mean square error of films that are fitted"),
            Column("held_out_rmse_MPa", "MPa", "the same of films that were left out"),
            Column("shear_modulus_MPa", "MPa", "shear modulus at zero strain"),
            Column("c1_MPa", "MPa", "C1 of (I1 − 3)"),
            Column("c2_MPa", "MPa", "C2 of (I1 − 3)²"),
            Column("c3_MPa", "MPa", "C3 of (I1 − 3)³"),
            Column("c01_MPa", "MPa", "C01 of (I2 − 3)"),
            Column("mu_MPa", "MPa", "shear modulus of Gent's law"),
            Column("j_m", "–", "limit of I1 − 3 of Gent's law"),
            *(
                column
                for k in (1, 2, 3)
                for column in (
                    Column(f"mu_{k}_MPa", "MPa", f"constant of term {k} of Ogden's law"),
                    Column(f"alpha_{k}", "–", f"power of term {k} of Ogden's law"),
                )
            ),
            Column("tensile_noise_floor", "MPa", "constant reading error, fitted with the law"),
            Column("tensile_noise", "–", "proportional reading error, fitted with the law"),
            Column("stiffness_scatter", "–", "scatter of stiffness, fitted with the law"),
            Column("tensile_noise_length", "–", "correlation length of the errors, in stretch"),
        ),
    ),
    ResultTable(
        SHARES,
        (
            _DEGRADATION,
            _PRESSURE,
            _text("source", "what is uncertain: parameters, specimen, degradation rate, reading"),
            Column("first_order", "–", "share of the variance removed if only this is known"),
            Column("total", "–", "share of the variance that remains if all else is known"),
            Column("share", "–", "Shapley effect: its share; the shares of all sources sum to 1"),
            Column("sd_per_m", "1/m", "standard deviation of a curvature read on a new actuator"),
            Column("explained", "–", "share of the prediction's variance that this accounts for"),
        ),
    ),
    ResultTable(
        SUSPECTS,
        (
            _text("file", "its file"),
            _text("specimens", "specimens, separated by spaces"),
            _text("column", "its column, if any"),
            _text("value", "value in that column"),
            _text("oddity", "how it is odd; empty if found from its columns alone"),
            Column("size", "–", "size: of ln stiffness, a fraction, or an offset in kPa"),
            Column("score", "–", "standard deviations from what all others predict"),
            Column("p_value", "–", "chance of such a score, times the number examined"),
            Column("readings", "–", "its rows"),
            Column("set_aside", "–", "1 if excluded from calibration and verdict"),
            _text("why", "what is odd, and a possible reason"),
        ),
    ),
    ResultTable(
        TRACES,
        (
            _text("file", "the photograph"),
            _SPECIMEN,
            _DEGRADATION,
            _PRESSURE,
            Column("bend_angle_deg", "deg", "bend angle that was traced; empty where none was"),
            Column("bend_angle_error_deg", "deg", "its standard error"),
            Column(
                "bent_ends",
                "–",
                "probability that the line bends up to its ends: from 0.5 on the angle is that "
                "between end tangents, else between straight lines through stiff ends",
            ),
            Column("curvature_per_m", "1/m", "bend angle over length of the line"),
            Column("curvature_error_per_m", "1/m", "its standard error"),
            Column("length_mm", "mm", "length of the line"),
            _text("scale_from", "source of the scale"),
            _text("not_sure", "what to check by eye"),
            _text("refused", "why nothing was traced; empty where it was"),
        ),
    ),
    ResultTable(
        PHOTO_LINES,
        (
            _text("picture", "file of the run folder with the cut of the photograph"),
            _text("file", "the photograph"),
            _SPECIMEN,
            _DEGRADATION,
            _PRESSURE,
            _text("line", "measured, or predicted by base or final"),
            Column("curvature_per_m", "1/m", "curvature of that line"),
            Column("x_px", "px", "a point of the line in the picture, from the left"),
            Column("y_px", "px", "the same, from the top"),
        ),
    ),
    ResultTable(
        SET_ASIDE,
        (
            _SPECIMEN,
            _DEGRADATION,
            _PRESSURE,
            Column("curvature_per_m", "1/m", "as read"),
            Column("set_aside", "–", "1 if excluded from calibration and verdict"),
        ),
    ),
    ResultTable(
        ABSORPTION,
        (
            *columns_of(Displacement, "parameter", "unit", "meaning"),
            *columns_of(
                Displacement,
                *("prior_q05", "prior_q50", "prior_q95"),
                *("all_else_q05", "all_else_q50", "all_else_q95"),
                *("measured", "measured_se", "measured_source"),
                *("base_q05", "base_q50", "base_q95"),
                *("after_q05", "after_q50", "after_q95"),
                unit="as stated",
            ),
            *columns_of(Displacement, "moved_sd", "learned", "score_sd", "p_alone", "p_adjusted"),
            Column("in_question", "–", "1 if it absorbs a model error"),
            *columns_of(Displacement, "pushed_by", "pushed_share", "after_moved_sd"),
        ),
    ),
    ResultTable(
        PUSHES,
        (
            _text("parameter", "name in the posterior"),
            _text("causes", "acting causes, joined by +"),
            _log("log_bayes_factor", "of the model with them against the base model"),
            Column("shift_sd", "–", "shift of the base model, in sd of all other information"),
            Column("share", "–", "share of the shift that this explains"),
        ),
    ),
    ResultTable(
        MISSING_TERMS,
        (
            Column("step", "–", "1 for the first term that was taken, 2 for a second one"),
            _text("status", "taken, or fits as well as the one that was"),
            _text("formula", "the reading with the term, b its size"),
            _text("columns", "quantities that it depends on"),
            _text("unit", "unit of its size"),
            Column("size", "as stated", "its size"),
            *_quantiles("as stated", 5, 95),
            Column(
                "behind",
                "–",
                "log-likelihood gained less than by the term taken, allowing for complexity",
            ),
            Column("share", "–", "share of the misfit removed by it and those before it"),
            Column("p_value", "–", "share of simulated data in which the best term gains as much"),
            _log("elpd_diff", "gain in log predictive density of held-out specimens"),
            _log("elpd_diff_se", "standard error of that"),
        ),
    ),
    ResultTable(
        MISFIT_COLUMNS,
        (
            _text("column", "a column of the study's tables"),
            Column("column_share", "–", "share of the misfit between its levels"),
            _text("level", "a level of it, or a third of its readings"),
            Column("readings", "–", "number of readings there"),
            Column("share", "–", "share of the misfit there"),
            _text("kind", "kind of reading of the excess"),
            _text("unit", "unit of the excess"),
            Column("excess", "as stated", "measured less simulated, on average"),
            Column("excess_pct", "%", "the same over the mean size of the simulated"),
        ),
    ),
    ResultTable(
        TERM_READINGS,
        (
            _text("kind", "what was read"),
            _text("history", "branch, cycle and mount, or mode of tension"),
            _SPECIMEN,
            _DEGRADATION,
            Column("along", "as stated", "pressure [kPa] or stretch [–]"),
            Column("term", "as read", "change of the reading due to the terms taken"),
            Column("residual", "as read", "reading less model, fitted together with the terms"),
        ),
    ),
    ResultTable(
        SETS,
        (
            _text("causes", "acting causes, joined by +"),
            _text("stated", "may be right, or excluded as a combination"),
            Column("log_bayes_factor", "–", "of the model with them against the base model"),
            Column("behind", "–", "its deficit to that of the favoured set"),
            Column("odds", "–", "of the favoured set against this one, by their evidence"),
            _text("judged_by", "full fit, or screening on the linear scale"),
        ),
    ),
    ResultTable(
        MISFIT_NULL,
        (
            Column("replicate", "–", "number of the simulated data set"),
            Column("statistic", "–", "misfit statistic of data simulated from the base model"),
        ),
    ),
)
#: Tables that actuator readings do not change: films and prior predictions.
NOT_OF_ACTUATORS: Final = (COURSE, MATERIAL_LAWS, MEASURED, ORDERS, PRIOR_PREDICTIVE)

#: Every table by its name.
TABLES: Final[Mapping[str, ResultTable]] = MappingProxyType(
    {table.name: table for table in _TABLES}
)


def present(frame: pd.DataFrame | None) -> pd.DataFrame | None:
    """Return a table, or None if it is absent or has no rows."""
    return None if frame is None or frame.empty else frame


@dataclass(frozen=True)
class Tables:
    """The tables of a run.

    Examples
    --------
    >>> tables = Tables({"bands": pd.DataFrame({"q50": [1.0]})})
    >>> tables["bands"]["q50"].tolist(), tables["rupture"], tables.files
    ([1.0], None, ('bands.csv',))
    """

    frames: Mapping[str, pd.DataFrame]

    def __getitem__(self, name: str) -> pd.DataFrame | None:
        """Return a table; None if it is absent or has no rows."""
        return present(self.frames.get(TABLES[name].name))

    @property
    def files(self) -> tuple[str, ...]:
        """File names of the tables that exist."""
        return tuple(table.file for table in TABLES.values() if self[table.name] is not None)
