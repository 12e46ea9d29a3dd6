"""``bayesdeg control``: the pressure for a wanted curvature, from a stored posterior."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer
from numpy.typing import NDArray

from bayesdeg.commands.answers import (
    answer,
    delivered,
    empty_table,
    inputs_of,
    levels_of,
    needed,
    numbers,
    refuse_others,
    refuse_risk,
    refuse_too_many,
    seed_of,
    stored_run,
)
from bayesdeg.console import output, shown
from bayesdeg.pipeline import forecast, own_forecast
from bayesdeg.pipeline.output import output_file
from bayesdeg.pipeline.posterior import Posterior
from bayesdeg.prediction.conditions import ServiceConditions
from bayesdeg.prediction.control import Setting
from bayesdeg.prediction.soil import Level
from bayesdeg.report.wording import chance, interval

Floats = NDArray[np.float64]

MOST_SETTINGS = 500
UNITS = (
    {forecast.TIME: "h", "wanted_per_m": "1/m", "risk": "–", "reached": "1 yes, 0 no"}
    | dict.fromkeys(("degradation_pct", *forecast.RATE_COLUMNS), "%")
    | dict.fromkeys(("pressure_kPa", "allowed_kPa"), "kPa")
    | dict.fromkeys(("needed_q05_kPa", "needed_q50_kPa", "needed_q95_kPa"), "kPa")
    | dict.fromkeys(forecast.BAND_COLUMNS, "1/m")
    | dict.fromkeys(forecast.PROBABILITY_COLUMNS, "–")
)

RATE = "D_R\n[%]"
HEADINGS = (
    "wanted\n[1/m]",
    "reached",
    "set to\n[kPa]",
    "90 % need\n[kPa]",
    "median\n[1/m]",
    "90 % bend by\n[1/m]",
    "rupture\nprobability",
    "90 %\ninterval",
    "allowed\n[kPa]",
)


def control(
    report: Path,
    curvature: list[str] | None,
    degradation: list[str] | None,
    hours: list[str] | None,
    risk: float,
    beyond: bool,
    reading: list[str] | None,
    hold_s: float,
    cycle: int,
    branch: str,
    humidity: float | None,
    temperature: float | None,
    mount: str,
    degradation_sd: float,
    x: list[str] | None,
    cause: str | None,
    base: bool,
    emulator: Path | None,
    seed: int | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Do what `interface.control` says."""
    service = ServiceConditions(hold_s, cycle, branch, humidity, mount, degradation_sd, temperature)
    if own_forecast.is_own(report):
        others = {"curvature": curvature, "degradation": degradation, "hours": hours}
        refuse_others(service, **others, cause=cause)
        _of_own(report, reading or [], x or [], base=base, seed=seed, out=out, as_json=as_json)
        return
    levels = levels_of(report, degradation, hours, seed)
    wanted = _asked(needed(curvature, "--curvature", x=x, reading=reading), risk, levels)
    out = None if out is None else output_file(out)
    stored = stored_run(report, cause, base=base, emulator=emulator)
    found = _settings(
        *(stored, levels, wanted, seed_of(stored, seed), service),
        risk=risk,
        beyond=beyond,
        quiet=quiet or as_json,
    )
    said = forecast.setting_cautions(stored, levels, found, service, beyond=beyond)
    table = forecast.settings_table(found)
    if not delivered(stored, table, said, UNITS, out=out, quiet=quiet, as_json=as_json):
        _show(stored, found)


def _asked(curvature: list[str], risk: float, levels: Sequence[Level]) -> Floats:
    """Return wanted curvatures [1/m]."""
    wanted = numbers(curvature, "--curvature", "1/m", low=0.0, high=float("inf"))
    if wanted[0] == 0.0:
        raise typer.BadParameter("--curvature 0 needs no pressure; give a curvature above 0")
    refuse_risk(risk)
    refuse_too_many(wanted, levels, most=MOST_SETTINGS)
    return wanted


def _settings(
    stored: Posterior,
    levels: Sequence[Level],
    wanted: Floats,
    seed: np.random.SeedSequence,
    conditions: ServiceConditions,
    *,
    risk: float,
    beyond: bool,
    quiet: bool,
) -> list[Setting]:
    """Find the settings, and show progress."""
    with shown(quiet) as progress:
        return forecast.settings(
            *(stored, levels, wanted),
            risk=risk,
            seed=seed,
            progress=progress,
            conditions=conditions,
            experience=None if beyond else stored.experience,
        )


def _show(stored: Posterior, found: list[Setting]) -> None:
    time = () if found[0].hours is None else ("soil\n[h]",)
    degrades = stored.run.degrades or any(s.degradation for s in found)
    rate = (RATE,) if degrades else ()
    table = empty_table(stored, (*time, *rate, *HEADINGS), f", risk up to {found[0].risk:g}")
    checks = stored.checks()
    for s in found:
        burst, low, high = (chance(float(p), checks, short=True) for p in s.probability)
        allowed = f"{s.allowed.pressure:.0f}"
        table.add_row(
            *(() if s.hours is None else (f"{s.hours:g}",)),
            *((f"{s.degradation:.4g}",) if rate else ()),
            f"{s.wanted:g}",
            "yes" if s.reached else "no",
            f"{s.pressure:.1f}" if np.isfinite(s.pressure) else "–",
            _interval(s.needed[0], s.needed[2], ".0f"),
            _end(s.curvature[2], ".3g"),
            _interval(s.curvature[0], s.curvature[4], ".3g"),
            burst,
            interval(low, high),
            allowed if s.allowed.found else f"> {allowed}",
        )
    console = output()
    console.print(table)
    for s in found:
        if not s.reached:
            console.print(forecast.statement(s), soft_wrap=True)


def _interval(low: float, high: float, style: str) -> str:
    """Format an interval whose ends may be out of reach."""
    ends = dict.fromkeys((_end(low, style), _end(high, style)))
    return " to ".join(ends)


def _end(value: float, style: str) -> str:
    if np.isnan(value):
        return "–"
    return "out of reach" if np.isinf(value) else f"{value:{style}}"


def _of_own(
    report: Path,
    reading: list[str],
    x: list[str],
    *,
    base: bool,
    seed: int | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Find the input for a reading of a user's forward map."""
    stored = own_forecast.read_own(report, base=base)
    block = own_forecast.user_map(stored).readings[0]
    if not reading:
        raise typer.BadParameter("--reading is missing")
    wanted = numbers(reading, "--reading", block.unit, low=-np.inf, high=np.inf)
    at = inputs_of(x, list(block.x))
    several = [name for name, column in at.items() if len(np.unique(column)) > 1]
    if several != list(at)[:1]:
        first = next(iter(at))
        raise typer.BadParameter(
            f"give a range for --x {first}, and one value for each other input"
        )
    out = None if out is None else output_file(out)
    table = own_forecast.control(stored, wanted, at, seed_of(stored, seed))
    units = {"wanted": block.unit, "reached": "", "share": ""}
    answer(stored, table.drop(columns="unit"), units, out=out, as_json=as_json)
