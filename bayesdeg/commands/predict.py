"""``bayesdeg predict``: curvature and rupture of a new specimen, from a stored posterior."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
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
    refuse_too_many,
    seed_of,
    stored_run,
)
from bayesdeg.console import output, shown
from bayesdeg.pipeline import forecast, own_forecast
from bayesdeg.pipeline.output import output_file
from bayesdeg.pipeline.posterior import Posterior
from bayesdeg.prediction.conditions import ServiceConditions
from bayesdeg.report.wording import chance, interval, number

Floats = NDArray[np.float64]

UNITS = (
    {forecast.TIME: "h", "pressure_kPa": "kPa"}
    | dict.fromkeys(("degradation_pct", *forecast.RATE_COLUMNS), "%")
    | dict.fromkeys(forecast.BAND_COLUMNS, "1/m")
    | dict.fromkeys((*forecast.PROBABILITY_COLUMNS, "answered"), "–")
)
RUPTURE_HEADINGS = ("rupture\nprobability", "90 %\ninterval")


def predict(
    report: Path,
    pressure: list[str] | None,
    degradation: list[str] | None,
    hours: list[str] | None,
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
    """Do what `interface.predict` says."""
    service = ServiceConditions(hold_s, cycle, branch, humidity, mount, degradation_sd, temperature)
    if own_forecast.is_own(report):
        others = {"pressure": pressure, "degradation": degradation, "hours": hours}
        refuse_others(service, **others, cause=cause)
        _of_own(report, x or [], base=base, seed=seed, out=out, as_json=as_json)
        return
    pressures = numbers(
        needed(pressure, "--pressure", x=x), "--pressure", "kPa", low=0.0, high=np.inf
    )
    levels = levels_of(report, degradation, hours, seed)
    refuse_too_many(pressures, levels)
    out = None if out is None else output_file(out)
    stored = stored_run(report, cause, base=base, emulator=emulator)
    messages = forecast.cautions(stored, levels, pressures, service)
    with shown(quiet or as_json) as progress:
        ask = partial(forecast.predict, progress=progress, conditions=service)
        table = forecast.by_each(
            stored, lambda run: ask(run, levels, pressures, seed=seed_of(run, seed))
        )
    if not delivered(stored, table, messages, UNITS, out=out, quiet=quiet, as_json=as_json):
        names = table.get(forecast.MODEL, pd.Series(stored.name, index=table.index))
        for run, name in zip((stored, *stored.each), names.unique(), strict=True):
            _show(run, table[names == name])


def _show(stored: Posterior, table: pd.DataFrame) -> None:
    kappas = (f"κ {name}\n[1/m]" for name in forecast.BAND_COLUMNS)
    time = ("soil\n[h]",) if forecast.TIME in table else ()
    degrades = stored.run.degrades or bool(table["degradation_pct"].any())
    rate = ("D_R\n[%]",) if degrades else ()
    headings = (*time, *rate, "pressure\n[kPa]", *kappas, *RUPTURE_HEADINGS)
    shown_table = empty_table(stored, headings)
    checks = stored.checks(forecast.RUPTURE_DRAWS)
    last = None
    for row in table.to_dict("records"):
        place = [f"{row[name]:g}" for name in (forecast.TIME,) if name in row]
        place += [f"{row['degradation_pct']:.4g}"] if rate else []
        if last is not None and place != last:
            shown_table.add_section()
        last = place
        burst, low, high = (
            chance(row[name], checks, short=True) for name in forecast.PROBABILITY_COLUMNS
        )
        shown_table.add_row(
            *place,
            f"{row['pressure_kPa']:g}",
            *(number(row[name]) for name in forecast.BAND_COLUMNS),
            burst,
            interval(low, high),
        )
    console = output()
    console.print(shown_table)
    for row in table[table["why"] != ""].to_dict("records"):
        level = f"{row['degradation_pct']:.4g} %, " if rate else ""
        console.print(f"{level}{row['pressure_kPa']:g} kPa: {row['why']}", soft_wrap=True)


def _of_own(
    report: Path, x: list[str], *, base: bool, seed: int | None, out: Path | None, as_json: bool
) -> None:
    """Predict with a user's forward map."""
    stored = own_forecast.read_own(report, base=base)
    block = own_forecast.user_map(stored).readings[0]
    at = inputs_of(x, list(block.x))
    out = None if out is None else output_file(out)
    table = own_forecast.predict(stored, at, seed_of(stored, seed))
    units = dict.fromkeys(("mean", "sd", *forecast.BAND_COLUMNS), block.unit)
    answer(stored, table.drop(columns="unit"), units, out=out, as_json=as_json)
