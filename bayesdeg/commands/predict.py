"""``bayesdeg predict``: curvature and rupture of a new specimen, from a stored posterior."""

from pathlib import Path

import numpy as np
import pandas as pd

from bayesdeg.commands.answers import (
    Texts,
    ask_own,
    delivered,
    empty_table,
    levels_of,
    needed,
    numbers,
    posterior_asked,
    refuse_too_many,
    seed_of,
)
from bayesdeg.commands.options import Asking, Service
from bayesdeg.console import output
from bayesdeg.display import shown
from bayesdeg.pages.wording import chance, interval, number
from bayesdeg.prediction import forecast
from bayesdeg.prediction.posterior import TIME, Posterior


def predict(
    report: Path,
    pressure: Texts | None,
    degradation: Texts | None,
    hours: Texts | None,
    service: Service,
    degradation_sd: float,
    x: Texts | None,
    asking: Asking,
) -> None:
    """Do what `interface.predict` says."""
    conditions = service.conditions(degradation_sd)
    others = {"pressure": pressure, "degradation": degradation, "hours": hours}
    if ask_own(report, asking, x, inverse=False, conditions=conditions, **others):
        return
    given = needed(pressure, "--pressure", x=x)
    pressures = numbers(given, "--pressure", "kPa", low=0.0, high=np.inf)
    levels = levels_of(report, degradation, hours, asking.seed)
    refuse_too_many(pressures, levels)
    stored = posterior_asked(report, asking)
    with shown(asking.quiet or asking.as_json) as progress:
        found = forecast.predict(
            *(stored, levels, pressures),
            seed=seed_of(stored, asking),
            progress=progress,
            conditions=conditions,
            by_each=True,
        )
    if not delivered(stored, found, asking):
        table = found.table
        names = table.get(forecast.MODEL, pd.Series(stored.name, index=table.index))
        for one, name in zip((stored, *stored.each), names.unique(), strict=True):
            _show(one, table[names == name])


def _show(stored: Posterior, table: pd.DataFrame) -> None:
    time = ("soil\n[h]",) if TIME in table else ()
    degrades = stored.run.degrades or bool(table["degradation_pct"].any())
    rate = ("D_R\n[%]",) if degrades else ()
    kappas = (f"κ {name}\n[1/m]" for name in forecast.BAND_COLUMNS)
    ruptures = ("rupture\nprobability", "90 %\ninterval")
    printed = empty_table(stored, (*time, *rate, "pressure\n[kPa]", *kappas, *ruptures))
    checks = stored.checks(forecast.RUPTURE_DRAWS)
    last: list[str] = []
    for row in table.to_dict("records"):
        place = [f"{row[name]:g}" for name in (TIME,) if name in row]
        place += [f"{row['degradation_pct']:.4g}"] if rate else []
        if last and place != last:
            printed.add_section()
        last = place
        burst, low, high = (
            chance(row[name], checks, short=True) for name in forecast.PROBABILITY_COLUMNS
        )
        curvatures = (number(row[name]) for name in forecast.BAND_COLUMNS)
        printed.add_row(*place, f"{row['pressure_kPa']:g}", *curvatures, burst, interval(low, high))
    console = output()
    console.print(printed)
    for row in table[table["why"] != ""].to_dict("records"):
        level = f"{row['degradation_pct']:.4g} %, " if rate else ""
        console.print(f"{level}{row['pressure_kPa']:g} kPa: {row['why']}", soft_wrap=True)
