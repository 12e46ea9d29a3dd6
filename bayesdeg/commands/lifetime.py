"""``bayesdeg lifetime``: service life of an actuator in the soil, from a finished run."""

from pathlib import Path

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bayesdeg.commands.answers import (
    Texts,
    delivered,
    empty_table,
    is_own,
    numbers,
    posterior_asked,
    refuse_risk,
    refuse_too_many,
    seed_of,
)
from bayesdeg.commands.options import Asking, Service
from bayesdeg.console import output
from bayesdeg.display import shown
from bayesdeg.pages.wording import chance, interval, number, percent
from bayesdeg.prediction import lifetime as lives
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.prediction.stored import soil_of

Floats = NDArray[np.float64]

MOST_TIMES = 200
HEADINGS = (
    "soil\n[h]",
    "D_R\n[%]",
    "median\n[1/m]",
    "90 % bend by\n[1/m]",
    "burst",
    "failed",
    "90 %\ninterval",
    "90 % need\n[kPa]",
    "allowed\n[kPa]",
    "in reach",
)

SHOWN_PROBABILITIES = ("burst_probability", "failed_probability", "failed_q05", "failed_q95")


def lifetime(
    report: Path,
    pressure: float,
    curvature: float,
    risk: float,
    hours: Texts | None,
    beyond: bool,
    service: Service,
    asking: Asking,
) -> None:
    """Do what `interface.lifetime` says."""
    if is_own(report):
        raise typer.BadParameter("a study with its own forward map has no lifetime in the soil")
    for value, option, unit in ((pressure, "--pressure", "kPa"), (curvature, "--curvature", "1/m")):
        if not (np.isfinite(value) and value > 0.0):
            raise typer.BadParameter(
                f"{option} {value:g} {unit} must be positive; give a number above 0"
            )
    refuse_risk(risk)
    times, conditions = _times(hours), service.conditions()
    stored, soil = posterior_asked(report, asking), soil_of(report)
    with shown(asking.quiet or asking.as_json) as progress:
        found = lives.lifetime(
            *(stored, soil, lives.Duty(pressure, curvature, risk)),
            times if len(times) else lives.default_hours(stored.measured),
            beyond=beyond,
            seed=seed_of(stored, asking),
            progress=progress,
            conditions=conditions,
        )
    if not delivered(stored, found, asking):
        _show(stored, found.table, found.headline)


def _times(hours: Texts | None) -> Floats:
    """Return the requested times [h]; none for those of the films."""
    if not hours:
        return np.empty(0)
    times = numbers(hours, "--hours", "h", low=0.0, high=np.inf)
    if len(times) == 1:
        raise typer.BadParameter(
            f"--hours {times[0]:g} is a single time, but a lifetime needs several; give a range "
            f"such as 0:{max(times[0], 1.0):g}:1"
        )
    refuse_too_many(times, most=MOST_TIMES)
    return times


def _show(stored: Posterior, table: pd.DataFrame, summary: str) -> None:
    duty = table.iloc[0]
    asked = f", {duty['wanted_per_m']:g} 1/m at {duty['pressure_kPa']:g} kPa, risk {duty['risk']:g}"
    printed = empty_table(stored, HEADINGS, asked)
    checks = stored.checks()
    for row in table.to_dict("records"):
        burst, failed, low, high = (
            chance(row[name], checks, short=True) for name in SHOWN_PROBABILITIES
        )
        printed.add_row(
            f"{row['time_h']:.4g}",
            f"{row['degradation_q50']:.3g}",
            number(row["q50_per_m"]),
            f"{number(row['q05_per_m'])} to {number(row['q95_per_m'])}",
            *(burst, failed, interval(low, high)),
            f"{number(row['needed_q05_kPa'])} to {number(row['needed_q95_kPa'])}",
            f"{row['allowed_kPa']:.0f}",
            percent(row["reachable"]),
        )
    console = output()
    console.print(printed)
    console.print(summary, soft_wrap=True)
