"""``bayesdeg control``: the pressure for a wanted curvature, from a stored posterior."""

from pathlib import Path

import numpy as np
import typer

from bayesdeg.commands.answers import (
    Texts,
    ask_own,
    delivered,
    empty_table,
    levels_of,
    needed,
    numbers,
    posterior_asked,
    refuse_risk,
    refuse_too_many,
    seed_of,
)
from bayesdeg.commands.options import Asking, Service
from bayesdeg.console import output
from bayesdeg.display import shown
from bayesdeg.pages.wording import chance, interval
from bayesdeg.prediction import forecast
from bayesdeg.prediction.posterior import Posterior

MOST_SETTINGS = 500
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
    curvature: Texts | None,
    degradation: Texts | None,
    hours: Texts | None,
    risk: float,
    beyond: bool,
    reading: Texts | None,
    service: Service,
    degradation_sd: float,
    x: Texts | None,
    asking: Asking,
) -> None:
    """Do what `interface.control` says."""
    conditions = service.conditions(degradation_sd)
    others = {"curvature": curvature, "degradation": degradation, "hours": hours}
    if ask_own(report, asking, x, reading, inverse=True, conditions=conditions, **others):
        return
    levels = levels_of(report, degradation, hours, asking.seed)
    given = needed(curvature, "--curvature", x=x, reading=reading)
    wanted = numbers(given, "--curvature", "1/m", low=0.0, high=np.inf)
    if wanted[0] == 0.0:
        raise typer.BadParameter("--curvature 0 needs no pressure; give a curvature above 0")
    refuse_risk(risk)
    refuse_too_many(wanted, levels, most=MOST_SETTINGS)
    stored = posterior_asked(report, asking)
    with shown(asking.quiet or asking.as_json) as progress:
        found = forecast.control(
            *(stored, levels, wanted),
            risk=risk,
            beyond=beyond,
            seed=seed_of(stored, asking),
            progress=progress,
            conditions=conditions,
        )
    if not delivered(stored, found, asking):
        _show(stored, found)


def _show(stored: Posterior, answer: forecast.Forecast) -> None:
    found = answer.settings
    time = () if found[0].hours is None else ("soil\n[h]",)
    degrades = stored.run.degrades or any(s.degradation for s in found)
    rate = ("D_R\n[%]",) if degrades else ()
    table = empty_table(stored, (*time, *rate, *HEADINGS), f", risk up to {found[0].risk:g}")
    checks = stored.checks()

    def end(value: float, style: str) -> str:
        if np.isnan(value):
            return "–"
        return "out of reach" if np.isinf(value) else f"{value:{style}}"

    def ends(low: float, high: float, style: str) -> str:
        return " to ".join(dict.fromkeys((end(low, style), end(high, style))))

    for s in found:
        burst, low, high = (chance(float(p), checks, short=True) for p in s.probability)
        allowed = f"{s.allowed.pressure:.0f}"
        table.add_row(
            *(() if s.hours is None else (f"{s.hours:g}",)),
            *((f"{s.degradation:.4g}",) if rate else ()),
            f"{s.wanted:g}",
            "yes" if s.reached else "no",
            f"{s.pressure:.1f}" if np.isfinite(s.pressure) else "–",
            ends(s.needed[0], s.needed[2], ".0f"),
            end(s.curvature[2], ".3g"),
            ends(s.curvature[0], s.curvature[4], ".3g"),
            burst,
            interval(low, high),
            allowed if s.allowed.found else f"> {allowed}",
        )
    console = output()
    console.print(table)
    for why in answer.table["why"]:
        if why:
            console.print(why, soft_wrap=True)
