"""``bayesdeg lifetime``: service life of an actuator in the soil, from a finished run."""

from pathlib import Path

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bayesdeg.commands.answers import (
    delivered,
    empty_table,
    numbers,
    refuse_risk,
    refuse_too_many,
    seed_of,
    stored_run,
)
from bayesdeg.console import output, shown
from bayesdeg.pipeline import forecast, own_forecast
from bayesdeg.pipeline.lifetime import (
    default_hours,
    life_summary,
    life_table,
    lifetime_cautions,
    lifetime_of,
)
from bayesdeg.pipeline.output import output_file
from bayesdeg.pipeline.posterior import Posterior
from bayesdeg.prediction.conditions import ServiceConditions
from bayesdeg.prediction.lifetime import Duty
from bayesdeg.report import tables as columns
from bayesdeg.report.wording import chance, interval, number, percent

Floats = NDArray[np.float64]

MOST_TIMES = 200
UNITS = {column.name: column.unit for column in columns.TABLES[columns.LIFETIME].columns}
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
    hours: list[str] | None,
    beyond: bool,
    hold_s: float,
    cycle: int,
    branch: str,
    humidity: float | None,
    temperature: float | None,
    mount: str,
    cause: str | None,
    base: bool,
    emulator: Path | None,
    seed: int | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Do what `interface.lifetime` says."""
    if own_forecast.is_own(report):
        raise typer.BadParameter("a study with its own forward map has no lifetime in the soil")
    duty, times = _duty(pressure, curvature, risk), _times(hours)
    service = ServiceConditions(hold_s, cycle, branch, humidity, mount, temperature_c=temperature)
    out = None if out is None else output_file(out)
    soil, stored = forecast.soil_of(report), stored_run(report, cause, base=base, emulator=emulator)
    times = default_hours(stored.measured) if times is None else times
    with shown(quiet or as_json) as progress:
        life = lifetime_of(
            *(stored, soil, duty, times),
            seed=seed_of(stored, seed),
            progress=progress,
            conditions=service,
            experience=None if beyond else stored.experience,
        )
    table, summary = life_table(stored, life, duty), life_summary(stored, life, duty)
    messages = (str(summary), *lifetime_cautions(stored, soil, life, duty, service, beyond=beyond))
    # a summary follows the table; in JSON it is among the messages
    said = messages if as_json else messages[1:]
    if not delivered(
        *(stored, table, said, UNITS), out=out, quiet=quiet, as_json=as_json, summary=summary.facts
    ):
        _show(stored, table, messages[0])


def _duty(pressure: float, curvature: float, risk: float) -> Duty:
    for value, option, unit in ((pressure, "--pressure", "kPa"), (curvature, "--curvature", "1/m")):
        if not (np.isfinite(value) and value > 0.0):
            raise typer.BadParameter(
                f"{option} {value:g} {unit} must be positive; give a number above 0"
            )
    refuse_risk(risk)
    return Duty(pressure, curvature, risk)


def _times(hours: list[str] | None) -> Floats | None:
    """Return the requested times [h]; None for those of the films."""
    if not hours:
        return None
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
