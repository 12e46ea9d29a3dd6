"""``bayesdeg lifetime``: how long an actuator in the soil does its duty, from a finished run."""

from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bayesdeg.commands.answers import (
    AsJson,
    Base,
    Beyond,
    Branch,
    Cycle,
    EmulatorFile,
    Hold,
    Hours,
    Humidity,
    Mount,
    OneCause,
    OutFile,
    Risk,
    RunFolderPath,
    Seed,
    delivered,
    empty_table,
    numbers,
    output,
    refuse_risk,
    refuse_too_many,
    seed_of,
    stored_run,
)
from bayesdeg.commands.options import Quiet
from bayesdeg.console import shown
from bayesdeg.pipeline import forecast
from bayesdeg.pipeline.forecast import StoredRun
from bayesdeg.pipeline.lifetime import (
    default_hours,
    life_summary,
    life_table,
    lifetime_of,
    said_of_life,
)
from bayesdeg.pipeline.output import output_file
from bayesdeg.pipeline.own_forecast import is_own
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
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

Pressure = Annotated[float, typer.Option(help="Gauge pressure of the duty in kPa.", metavar="KPA")]
Curvature = Annotated[
    float,
    typer.Option(help="Curvature in 1/m that the duty asks for, above 0.", metavar="PER_M"),
]


def lifetime(
    report: RunFolderPath,
    pressure: Pressure,
    curvature: Curvature,
    risk: Risk = 0.05,
    hours: Hours = None,
    beyond: Beyond = False,
    hold_s: Hold = PROMPT.hold_s,
    cycle: Cycle = PROMPT.cycle,
    branch: Branch = PROMPT.branch,
    humidity: Humidity = PROMPT.humidity_pct,
    mount: Mount = PROMPT.mount,
    cause: OneCause = None,
    base: Base = False,
    emulator: EmulatorFile = None,
    seed: Seed = None,
    out: OutFile = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Say how long an actuator in the soil does its duty, and which pressure keeps its curvature.

    An actuator fails when it bursts at the pressure of the duty or bends less than asked. The table
    gives, by hours in the soil, degradation rate, curvature at that pressure, the probability of
    having burst and of having failed by then with its 90 % interval, the pressures that keep the
    curvature of 90 % of new actuators, the largest pressure that --risk and the tests allow, and
    the share of actuators that reach the curvature with it. A probability of less than one in the
    films broken and actuators loaded is no number. Times are those up to the last film that was
    taken out of the soil; give others with --hours.
    """
    if is_own(report):
        raise typer.BadParameter("a study with a forward map of its own has no life in the soil")
    duty, times = _duty(pressure, curvature, risk), _times(hours)
    conditions = ServiceConditions(hold_s, cycle, branch, humidity, mount)
    out = None if out is None else output_file(out)
    soil, stored = forecast.soil_of(report), stored_run(report, cause, base=base, emulator=emulator)
    times = default_hours(stored.measured) if times is None else times
    with shown(quiet or as_json) as progress:
        life = lifetime_of(
            *(stored, soil, duty, times),
            seed=seed_of(stored, seed),
            progress=progress,
            conditions=conditions,
            experience=None if beyond else stored.experience,
        )
    table, summary = life_table(stored, life, duty), life_summary(stored, life, duty)
    messages = (str(summary), *said_of_life(stored, soil, life, duty, conditions, beyond=beyond))
    # the table is followed by what it comes to; JSON has that among its messages
    said = messages if as_json else messages[1:]
    if not delivered(
        *(stored, table, said, UNITS), out=out, quiet=quiet, as_json=as_json, summary=summary.facts
    ):
        _show(stored, table, messages[0])


def _duty(pressure: float, curvature: float, risk: float) -> Duty:
    for value, option, unit in ((pressure, "--pressure", "kPa"), (curvature, "--curvature", "1/m")):
        if not (np.isfinite(value) and value > 0.0):
            raise typer.BadParameter(f"{option} {value:g} {unit} is no duty; give a number above 0")
    refuse_risk(risk)
    return Duty(pressure, curvature, risk)


def _times(hours: list[str] | None) -> Floats | None:
    """Return the times that are asked for [h]; None where those of the films are meant."""
    if not hours:
        return None
    times = numbers(hours, "--hours", "h", low=0.0, high=np.inf)
    if len(times) == 1:
        raise typer.BadParameter(
            f"--hours {times[0]:g} is a single time, and a life has a course; give a range such as "
            f"0:{max(times[0], 1.0):g}:1"
        )
    refuse_too_many(times, most=MOST_TIMES)
    return times


def _show(stored: StoredRun, table: pd.DataFrame, summary: str) -> None:
    duty = table.iloc[0]
    asked = f", {duty['wanted_per_m']:g} 1/m at {duty['pressure_kPa']:g} kPa, risk {duty['risk']:g}"
    printed = empty_table(stored, HEADINGS, asked)
    checks = forecast.checks_of(stored)
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
