"""Description of a misfit that no cause accounts for, for the run folder."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from bayesdeg.criticism.checks.misfit_columns import ColumnMisfit
from bayesdeg.criticism.checks.missing_terms import MissingTerm
from bayesdeg.pipeline.judge import Description, Judgement
from bayesdeg.report.record import (
    ColumnMisfitEntry,
    DescriptionEntry,
    ExperimentEntry,
    LevelMisfitEntry,
    MissingTermEntry,
)
from bayesdeg.report.wording import worded

TAKEN, AS_GOOD = "taken", "fits as well"


def description_entry(judgement: Judgement) -> DescriptionEntry | None:
    """Return ``description`` of ``verdict.json``; None if there is no misfit to describe."""
    found = judgement.missing
    if found is None:
        return None
    degrades = judgement.search.base.subject.world.degrades
    return DescriptionEntry(
        sentence=worded(found, degrades=degrades),
        with_causes=tuple(sorted(found.step.trial.names)),
        terms=tuple(_term_entry(one) for one in found.found.terms),
        columns=tuple(_column_entry(one) for one in found.columns),
        p_value=found.found.p_value,
        tried=found.found.tried,
        replicates=found.found.replicates,
        next_experiments=tuple(ExperimentEntry.model_validate(one) for one in found.experiments),
    )


def _term_entry(one: MissingTerm) -> MissingTermEntry:
    return MissingTermEntry(
        formula=one.term.formula,
        columns=one.term.columns,
        size=one.size,
        q05=one.low,
        q95=one.high,
        unit=one.term.unit,
        share_of_misfit=one.share,
        p_value=one.p_value,
        elpd_diff=one.held_out,
        elpd_diff_se=one.held_out_se,
        alike=tuple(other.term.formula for other in one.alike),
        count_alike=one.count_alike,
    )


def _column_entry(one: ColumnMisfit) -> ColumnMisfitEntry:
    levels = (
        LevelMisfitEntry(
            level=level.label,
            readings=level.readings,
            share_of_misfit=level.share,
            excess=level.excess,
            excess_pct=level.excess_pct,
        )
        for level in one.levels
    )
    return ColumnMisfitEntry(
        column=one.column,
        share_of_misfit=one.share,
        kind=one.kind,
        unit=one.unit,
        levels=tuple(levels),
    )


def terms_table(found: Description) -> pd.DataFrame | None:
    """Return the terms that were taken and those that fit as well; None without any.

    Parameters
    ----------
    found : Description
        What the misfit looks like.
    """
    rows = [row for step, one in enumerate(found.found.terms, 1) for row in _rows_of(step, one)]
    return pd.DataFrame(rows) if rows else None


def _rows_of(step: int, one: MissingTerm) -> Iterator[dict[str, object]]:
    yield {
        "step": step,
        "status": TAKEN,
        "formula": one.term.formula,
        "columns": ", ".join(one.term.columns),
        "unit": one.term.unit,
        "size": one.size,
        "q05": one.low,
        "q95": one.high,
        "behind": 0.0,
        "share": one.share,
        "p_value": one.p_value,
        "elpd_diff": np.nan if one.held_out is None else one.held_out,
        "elpd_diff_se": np.nan if one.held_out_se is None else one.held_out_se,
    }
    for other in one.alike:
        yield {
            "step": step,
            "status": AS_GOOD,
            "formula": other.term.formula,
            "columns": ", ".join(other.term.columns),
            "unit": other.term.unit,
            "size": other.size,
            "behind": other.behind,
        }


def columns_table(found: Description) -> pd.DataFrame | None:
    """Return the share of the misfit of every level of every column; None without any."""
    rows = [
        {
            "column": one.column,
            "column_share": one.share,
            "level": level.label,
            "readings": level.readings,
            "share": level.share,
            "kind": one.kind,
            "unit": one.unit,
            "excess": level.excess,
            "excess_pct": level.excess_pct,
        }
        for one in found.columns
        for level in one.levels
    ]
    return pd.DataFrame(rows) if rows else None


def readings_table(found: Description) -> pd.DataFrame | None:
    """Return the effect of the terms on each reading, and the residual; None without any.

    As for a smooth discrepancy (`criticism.checks.residuals.misfit_frame`), the residual is from a
    joint fit of terms and parameters.
    """
    if not found.found.terms:
        return None
    linear = found.step.trial.linear
    places = linear.subject.places
    change = np.sum([one.change for one in found.found.terms], axis=0)
    left = linear.observed - linear.whiten_columns(change[:, None])[:, 0]
    return pd.DataFrame(
        {
            "kind": places.kind,
            "history": places.history,
            "specimen_id": places.specimen,
            "degradation_pct": places.level,
            "along": places.along,
            "term": change,
            "residual": change + linear.unexplained(left),
        }
    )
