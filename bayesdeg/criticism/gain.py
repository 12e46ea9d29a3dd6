"""What knowing a cause is worth: scores of held-out specimens, per level and over all."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.held_out import HeldOut, group_levels, standard_error
from bayesdeg.criticism.residuals import levels, r_squared
from bayesdeg.criticism.subject import Subject

Floats = NDArray[np.float64]

UNITS = {"curvature": "per_m", "stress": "MPa"}
"""Units of the kinds of readings that are scored, as column names end."""


def gain_table(subject: Subject, results: dict[str, HeldOut]) -> pd.DataFrame:
    """Return the scores of each model per level and over all, on held-out specimens.

    Parameters
    ----------
    subject : Subject
        With the data.
    results : mapping
        By name of the model; the first is the one that others are compared with.

    Returns
    -------
    DataFrame
        The columns of ``gain.csv``; of films alone errors are in ``rmse_MPa`` and ``crps_MPa``, and
        the columns of curvatures are empty. Standard errors are over specimens.
    """
    centres, member = levels(group_levels(subject))
    rows = []
    for name, held_out in results.items():
        base = next(iter(results.values()))
        for k, centre in enumerate(centres):
            rows.append(_scores(name, f"{centre:.4g}", subject, held_out, base, member == k))
        rows.append(_scores(name, "all", subject, held_out, base, member >= 0))
    return pd.DataFrame(rows)


def mode_table(subject: Subject, results: dict[str, HeldOut]) -> pd.DataFrame:
    """Return the scores of each model by mode of tension, each predicted from the others.

    Parameters
    ----------
    subject : Subject
        With films, of which whole modes are held out.
    results : mapping
        As in `gain_table`.

    Returns
    -------
    DataFrame
        The columns of ``gain_modes.csv``. A mode is one group, so there is no standard error.
    """
    base = next(iter(results.values()))
    rows = [
        {
            "mode": mode,
            **_scores(name, "", subject, held_out, base, np.array(subject.groups) == mode),
        }
        for name, held_out in results.items()
        for mode in subject.groups
    ]
    no_use = ["degradation_pct", "elpd_se", "elpd_diff_se", "rmse_per_m", "crps_per_m"]
    return pd.DataFrame(rows).drop(columns=no_use)


def crps(draws: Floats, observed: Floats) -> Floats:
    """Return the continuous ranked probability score of draws (n, ...) for observations (...).

    E|X − y| − E|X − X'|/2, the second term from the sorted draws.

    Source: Gneiting and Raftery (2007), doi:10.1198/016214506000001437.

    Examples
    --------
    >>> float(crps(np.array([0.0, 2.0]), np.array(1.0)))
    0.5
    """
    count = len(draws)
    ordered = np.sort(draws, axis=0)
    weight = (2.0 * np.arange(1, count + 1) - count - 1.0) / count**2
    spread = np.tensordot(weight, ordered, axes=(0, 0))
    score: Floats = np.mean(np.abs(draws - observed), axis=0) - spread
    return score


def _scores(
    name: str,
    label: str,
    subject: Subject,
    held_out: HeldOut,
    base: HeldOut,
    chosen: NDArray[np.bool_],
) -> dict[str, object]:
    gap = (held_out.log_density - base.log_density)[chosen]
    return {
        "model": name,
        "degradation_pct": label,
        "elpd": float(np.sum(held_out.log_density[chosen])),
        "elpd_se": standard_error(held_out.log_density[chosen]),
        "elpd_diff": float(np.sum(gap)),
        "elpd_diff_se": standard_error(gap),
        **_errors(subject, held_out, chosen),
    }


def _errors(subject: Subject, held_out: HeldOut, chosen: NDArray[np.bool_]) -> dict[str, float]:
    """Score the first kind of reading that is held out."""
    names = [g for g, is_chosen in zip(subject.groups, chosen, strict=True) if is_chosen]
    rows = np.isin(subject.group, names)
    kind = subject.places.kind[rows][0]
    rows = rows & (subject.places.kind == kind)
    observed, draws, mean = subject.observed[rows], held_out.draws[:, rows], held_out.mean[rows]
    unit = UNITS.get(str(kind), "per_m")
    found = {} if unit == "per_m" else {"rmse_per_m": np.nan, "crps_per_m": np.nan}
    return found | {
        f"rmse_{unit}": float(np.sqrt(np.mean((observed - mean) ** 2))),
        f"crps_{unit}": float(np.mean(crps(np.nan_to_num(draws), observed))),
        "r_squared": r_squared(observed, mean),
        "coverage_50": _coverage(draws, observed, 0.5),
        "coverage_90": _coverage(draws, observed, 0.9),
    }


def _coverage(draws: Floats, observed: Floats, share: float) -> float:
    low, high = np.nanquantile(draws, [0.5 - share / 2, 0.5 + share / 2], axis=0)
    return float(np.mean((observed >= low) & (observed <= high)))
