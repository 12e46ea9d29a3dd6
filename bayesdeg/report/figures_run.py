"""Which figures a run has, with captions and descriptions for those who cannot see them."""

from collections.abc import Callable

from bayesdeg.report.figures import Drawing, Sketch, inline_svg
from bayesdeg.report.figures_actuator import deformed_figure
from bayesdeg.report.figures_checks import (
    leave_one_out_sketch,
    prior_curvature_sketch,
    prior_stress_sketch,
    sensitivity_sketch,
)
from bayesdeg.report.figures_course import course_sketch
from bayesdeg.report.figures_criticism import (
    discrepancy_sketch,
    loo_pit_sketch,
    statistics_sketch,
)
from bayesdeg.report.figures_curvature import (
    bands_figure,
    elongation_figure,
    null_figure,
    rupture_figure,
)
from bayesdeg.report.figures_gain import gain_sketch
from bayesdeg.report.figures_material import (
    constants_figure,
    has_one_rate,
    tensile_figure,
    tensile_panels,
)
from bayesdeg.report.figures_residuals import UNLOADING, residual_figure
from bayesdeg.report.left_out import Guard, figure_stage
from bayesdeg.report.record import RunRecord, Verdict
from bayesdeg.report.summaries import by_level, panel_levels
from bayesdeg.report.tables import Tables
from bayesdeg.report.wording import level_words, number, percent

RARE = 0.01  # a probability that cannot be told from none in the figure

type Draw = Callable[[Verdict, RunRecord, Tables], Sketch | None]


def drawings_of(
    verdict: Verdict, run: RunRecord, tables: Tables, guard: Guard | None = None
) -> dict[str, Drawing]:
    """Draw every figure of `FIGURES` for which the run has data.

    Parameters
    ----------
    verdict, run, tables : Verdict, RunRecord, Tables
        What the run found.
    guard : Guard, optional
        Leaves out figures that fail; by default nothing is left out and faults are raised.

    Returns
    -------
    dict
        By name; those without data are left out.
    """
    guard = guard or Guard(strict=True)
    drawn = (
        guard.attempt(figure_stage(name), _drawing, draw, verdict, run, tables)
        for name, draw in FIGURES.items()
    )
    return {drawing.name: drawing for drawing in drawn if drawing is not None}


def _drawing(draw: Draw, verdict: Verdict, run: RunRecord, tables: Tables) -> Drawing | None:
    sketch = draw(verdict, run, tables)
    if sketch is None:
        return None
    svg = inline_svg(sketch.figure, sketch.name, description=sketch.caption, virtual=run.virtual)
    there = [name for name in SOURCES.get(sketch.name, ()) if name in tables.files]
    return Drawing(sketch.name, svg, sketch.caption, sketch.half, tuple(there))


def _residuals(verdict: Verdict, tables: Tables) -> Sketch | None:
    if tables.observations is None:
        return None
    levels = panel_levels(by_level(tables.levels), tables.bands, tables.observations)
    caption = (
        "Measured less simulated curvature against pressure, one panel a degradation rate, one "
        "line a specimen. A model that is right scatters about zero inside the noise."
    )
    if (tables.observations["branch"] == UNLOADING).any():
        caption += " Unloading is dashed, with hollow marks."
    if (tables.observations["cycle"] > 1).any():
        caption += " Squares are of cycles after the first."
    if verdict.misfit.specimens:
        named = " and ".join(verdict.misfit.specimens)
        caption += f" Most of the misfit sits in {named}: the thick lines."
    figure = residual_figure(
        tables.observations,
        levels,
        noise_per_m=verdict.misfit.noise_per_m,
        specimens=verdict.misfit.specimens,
    )
    return Sketch("residuals", figure, caption)


def _null(run: RunRecord, tables: Tables) -> Sketch | None:
    if tables.misfit_null is None:
        return None
    observed = run.misfit.observed
    caption = (
        f"The misfit statistic of {len(tables.misfit_null)} studies simulated from the fitted base "
        f"model; in this study it is {number(observed)}."
    )
    name = run.misfit.name
    return Sketch(
        "null", null_figure(tables.misfit_null, observed=observed, name=name), caption, half=True
    )


def _bands(tables: Tables) -> Sketch | None:
    if tables.bands is None:
        return None
    levels = panel_levels(tables.bands)
    caption = (
        "Measured curvature against pressure, and that predicted for new specimens at "
        f"{', '.join(level_words(level) for level in levels)} degradation; all panels have one "
        "scale."
    )
    if tables.observations is not None:
        caption += (
            " Dashed: what the models say of the measured specimens themselves, at their own "
            "degradation rate and with their own history of loading, of which a band, that of a "
            "new specimen at the rate of its panel, knows nothing."
        )
    return Sketch("bands", bands_figure(tables.bands, tables.observations, levels), caption)


def _deformed(tables: Tables) -> Sketch | None:
    if tables.deformed is None:
        return None
    caption = (
        "The actuator solved by finite elements with the fitted material, at true size: the cut "
        "through its plane of symmetry over the whole, thin lines before loading. The largest "
        "stretches stand at re-entrant corners, where they grow with refinement of the mesh; the "
        "scale of colours leaves them out."
    )
    return Sketch("deformed", deformed_figure(tables.deformed), caption)


def _rupture(tables: Tables) -> Sketch | None:
    if tables.rupture is None:
        return None
    caption = "Probability that the actuator bursts up to a pressure, with its 90 % interval."
    largest = float(tables.rupture["probability"].max())
    if largest < RARE:
        caption += f" It is at most {percent(largest)} everywhere: all curves lie on the axis."
    return Sketch("rupture", rupture_figure(tables.rupture), caption, half=True)


def _elongation(tables: Tables) -> Sketch | None:
    if tables.elongation is None:
        return None
    caption = "Elongation at break against degradation rate: 90 % band and measured specimens."
    return Sketch("elongation", elongation_figure(tables.elongation), caption, half=True)


def _constants(tables: Tables) -> Sketch | None:
    if tables.constants is None:
        return None
    caption = (
        "Constants of Yeoh's law and Young's modulus against degradation rate: posterior median "
        "with 50 % and 90 % bands, each constant to its own scale."
    )
    if has_one_rate(tables.constants):
        rate = level_words(float(tables.constants["degradation_pct"].iloc[0]))
        caption = (
            f"Constants of Yeoh's law and Young's modulus at {rate} degradation, the only rate of "
            "the study: posterior median with 50 % (thick) and 90 % intervals, each constant to "
            "its own scale."
        )
    return Sketch("constants", constants_figure(tables.constants, tables.measured), caption)


def _tensile(tables: Tables) -> Sketch | None:
    if tables.tensile is None:
        return None
    kinds = tables.tensile[["fitted", "mode", "degradation_pct"]].drop_duplicates()
    shown = tensile_panels(tables.tensile)
    caption = "Nominal stress against stretch: measured, and predicted with 90 % intervals."
    if any(not panel.fitted for panel in shown):
        caption += " Panels marked as held out were not used in the fit."
    if len(shown) < len(kinds):
        caption += f" {len(shown)} of {len(kinds)} combinations of mode and rate are drawn."
    return Sketch("tensile", tensile_figure(tables.tensile), caption)


def _discrepancy(tables: Tables) -> Sketch | None:
    return None if tables.discrepancy is None else discrepancy_sketch(tables.discrepancy)


def _statistics(tables: Tables) -> Sketch | None:
    if tables.statistics is None or tables.statistics["value"].isna().all():
        return None
    return statistics_sketch(tables.statistics)


def _loo_pit(tables: Tables) -> Sketch | None:
    return None if tables.loo_pit is None else loo_pit_sketch(tables.loo_pit)


def _of_tables(draw: Callable[[Tables], Sketch | None]) -> Draw:
    return lambda _verdict, _run, tables: draw(tables)


FIGURES: dict[str, Draw] = {
    "residuals": lambda verdict, _run, tables: _residuals(verdict, tables),
    "null": lambda _verdict, run, tables: _null(run, tables),
    "gain": lambda verdict, _run, tables: gain_sketch(verdict, tables),
    "bands": _of_tables(_bands),
    "deformed": _of_tables(_deformed),
    "rupture": _of_tables(_rupture),
    "elongation": _of_tables(_elongation),
    "constants": _of_tables(_constants),
    "tensile": _of_tables(_tensile),
    "discrepancy": _of_tables(_discrepancy),
    "statistics": _of_tables(_statistics),
    "loo-pit": _of_tables(_loo_pit),
    "leave-one-out": _of_tables(leave_one_out_sketch),
    "prior-sensitivity": _of_tables(sensitivity_sketch),
    "prior-curvature": _of_tables(prior_curvature_sketch),
    "prior-stress": _of_tables(prior_stress_sketch),
    "course": _of_tables(course_sketch),
}
"""Every figure of a report by its name in the page; it draws None where the run has no data."""

SOURCES: dict[str, tuple[str, ...]] = {
    "residuals": ("observations.csv",),
    "null": ("misfit_null.csv",),
    "gain": ("gain.csv", "gain_modes.csv"),
    "bands": ("bands.csv", "observations.csv"),
    "rupture": ("rupture.csv",),
    "elongation": ("elongation.csv",),
    "constants": ("constants.csv", "measured.csv"),
    "tensile": ("tensile.csv",),
    "discrepancy": ("discrepancy.csv",),
    "statistics": ("statistics.csv",),
    "loo-pit": ("loo_pit.csv",),
    "leave-one-out": ("leave_one_out.csv",),
    "prior-sensitivity": ("prior_sensitivity.csv",),
    "prior-curvature": ("prior_predictive.csv", "observations.csv"),
    "prior-stress": ("prior_predictive.csv", "tensile.csv"),
    "course": ("course.csv",),
}
"""The tables of the run folder that each figure draws."""
