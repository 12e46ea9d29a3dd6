"""Which figures a run has, with captions and descriptions for those who cannot see them."""

from bayesdeg.report.figures import Drawing, Sketch, inline_svg
from bayesdeg.report.figures_actuator import deformed_figure
from bayesdeg.report.figures_checks import check_sketches
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
from bayesdeg.report.figures_material import constants_figure, tensile_figure, tensile_panels
from bayesdeg.report.figures_residuals import UNLOADING, residual_figure
from bayesdeg.report.record import Run, Verdict
from bayesdeg.report.summaries import by_level, panel_levels
from bayesdeg.report.tables import Tables
from bayesdeg.report.wording import level_words, number


def drawings_of(verdict: Verdict, run: Run, tables: Tables) -> dict[str, Drawing]:
    """Draw every figure for which the run has data.

    Returns
    -------
    dict
        By name: ``residuals``, ``statistics``, ``discrepancy``, ``loo-pit``, ``null``, ``gain``,
        ``bands``, ``deformed``, ``rupture``, ``elongation``, ``constants``, ``tensile``,
        ``leave-one-out``, ``prior-sensitivity``, ``prior-curvature``, ``prior-stress``,
        ``course``; those without data are left out.
    """
    sketches = (
        _residuals(verdict, tables),
        _null(run, tables),
        gain_sketch(verdict, tables),
        _bands(tables),
        _deformed(tables),
        _rupture(tables),
        _elongation(tables),
        _constants(tables),
        _tensile(tables),
        *criticism_sketches(tables),
        *check_sketches(tables),
        course_sketch(tables),
    )
    return {
        sketch.name: Drawing(
            sketch.name,
            inline_svg(sketch.figure, sketch.name, description=sketch.caption, virtual=run.virtual),
            sketch.caption,
            sketch.half,
        )
        for sketch in sketches
        if sketch is not None
    }


def criticism_sketches(tables: Tables) -> list[Sketch]:
    """Return what there is to explain, statistics of it, and the fit to held-out readings."""
    drawn = (
        (discrepancy_sketch, tables.discrepancy),
        (statistics_sketch, tables.statistics),
        (loo_pit_sketch, tables.loo_pit),
    )
    return [draw(table) for draw, table in drawn if table is not None]


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


def _null(run: Run, tables: Tables) -> Sketch | None:
    if tables.misfit_null is None:
        return None
    observed = run.misfit_observed
    caption = (
        f"The misfit statistic of {len(tables.misfit_null)} studies simulated from the fitted base "
        f"model; in this study it is {number(observed)}."
    )
    name = run.misfit_name
    return Sketch(
        "null", null_figure(tables.misfit_null, observed=observed, name=name), caption, half=True
    )


def _bands(tables: Tables) -> Sketch | None:
    if tables.bands is None:
        return None
    levels = panel_levels(tables.bands)
    caption = (
        "Predicted curvature against pressure at "
        f"{', '.join(level_words(level) for level in levels)} degradation."
    )
    if tables.observations is not None:
        caption += (
            " Measured specimens stand in the panel nearest to their own degradation rate, so "
            "they may lie beside a band for that reason alone."
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
        "with 50 % and 90 % bands."
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
