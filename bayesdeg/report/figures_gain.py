"""Figure of what the extended model gains on held-out data."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdeg.quantities import axis_label
from bayesdeg.report.figures import (
    BASE_COLOUR,
    FINAL_COLOUR,
    FULL_WIDTH,
    MUTED,
    Sketch,
    key,
    legend_above,
    side_by_side,
    single,
    styled,
)
from bayesdeg.report.record import Verdict
from bayesdeg.report.summaries import BASE, extended_model, models_of, pooled, several_levels
from bayesdeg.report.tables import Tables
from bayesdeg.report.wording import level_words, model_words, words


def gain_sketch(verdict: Verdict, tables: Tables) -> Sketch | None:
    """Return the figure with its caption; None where nothing was held out with a cause.

    Errors are told by degradation rate, and of studies with one rate by mode of tension.
    """
    others = [model for model in models_of(tables.gain) if model != BASE]
    if not others:
        return None
    final = extended_model(tables.gain, verdict) or others[0]
    by_level, by_mode = several_levels(tables.gain), tables.gain_modes
    unseen, per = ("specimens", "degradation rate")
    if by_level is None and by_mode is not None:
        unseen, per = ("modes of tension", "mode")
    gains = "gain in expected log predictive density"
    said = f"Left: error of the base model and of {model_words(final)} by {per}. Right: {gains}."
    if len(others) == 1:
        said = f"Error of the base model and of {model_words(final)} by {per}."
    if by_level is None and by_mode is None:
        said = f"{gains.capitalize()}."
    caption = f"Prediction of {unseen} that the model has not seen. {said}"
    return Sketch("gain", gain_figure(pooled(tables.gain), by_level, final, by_mode), caption)


@styled
def gain_figure(
    pooled: pd.DataFrame | None,
    by_level: pd.DataFrame | None,
    final: str,
    by_mode: pd.DataFrame | None = None,
) -> Figure:
    """Draw what the extended model gains on held-out specimens, or modes of tension.

    Parameters
    ----------
    pooled : pandas.DataFrame, optional
        Rows of table ``gain`` over all degradation rates: gain in elpd of each model, drawn beside
        the errors where several are compared.
    by_level : pandas.DataFrame, optional
        Rows of table ``gain`` by degradation rate: error of base and extended model.
    final : str
        The model that is set against the base model.
    by_mode : pandas.DataFrame, optional
        Table ``gain_modes``, drawn where there are no rows by degradation rate.
    """
    has_errors = by_level is not None or by_mode is not None
    has_gains = pooled is not None and (not has_errors or (pooled["model"] != BASE).sum() > 1)
    if has_errors and has_gains:
        figure, left, right = side_by_side(height=2.9)
    else:
        figure, left = single(width=FULL_WIDTH, height=2.9)
        right = left
    if by_level is not None:
        _draw_by_level(left, by_level, final)
    elif by_mode is not None:
        _draw_by_mode(left, by_mode, final)
    if pooled is not None and has_gains:
        _draw_elpd(right, pooled, final)
    if has_errors:
        models = {BASE: BASE_COLOUR, final: FINAL_COLOUR}
        keys = {model_words(m): key(c, marker="o", line=False) for m, c in models.items()}
        legend_above(figure, keys)
    return figure


def _draw_by_level(axes: Axes, by_level: pd.DataFrame, final: str) -> None:
    errors = by_level.pivot_table(index="degradation_pct", columns="model", values="rmse_per_m")
    _draw_errors(axes, errors, [level_words(float(level)) for level in errors.index], final)
    axes.set(xlabel="error on held-out specimens, rms [1/m]", ylabel=axis_label("degradation_pct"))
    axes.set_title("error by degradation rate")


def _draw_by_mode(axes: Axes, by_mode: pd.DataFrame, final: str) -> None:
    errors = by_mode.pivot_table(index="mode", columns="model", values="rmse_MPa")
    _draw_errors(axes, errors, [str(mode) for mode in errors.index], final)
    axes.set(xlabel="error of nominal stress, rms [MPa]")
    axes.set_title("error on held-out modes of tension")


def _draw_errors(axes: Axes, errors: pd.DataFrame, labels: list[str], final: str) -> None:
    place = np.arange(len(errors))
    if final in errors and BASE in errors:
        axes.hlines(place, errors[BASE], errors[final], color=MUTED, alpha=0.6, linewidth=1.6)
    for model, colour in ((BASE, BASE_COLOUR), (final, FINAL_COLOUR)):
        if model in errors:
            axes.plot(errors[model], place, "o", color=colour, markersize=5)
    axes.set_yticks(place, labels)
    axes.set_xlim(left=0.0)
    axes.margins(y=0.12)
    axes.grid(visible=False, axis="y")
    axes.invert_yaxis()


def _draw_elpd(axes: Axes, pooled: pd.DataFrame, final: str) -> None:
    extended = pooled[pooled["model"] != BASE].head(8)
    place = np.arange(len(extended))[::-1]
    for y, (_, row) in zip(place, extended.iterrows(), strict=True):
        colour = FINAL_COLOUR if row["model"] == final else MUTED
        axes.errorbar(
            row["elpd_diff"], y, xerr=row["elpd_diff_se"], fmt="o", color=colour, markersize=5
        )
    axes.axvline(0.0, color=BASE_COLOUR, linewidth=1.2)
    axes.set_yticks(place, [_added(str(model)) for model in extended["model"]])
    axes.set_xlabel("gain in elpd over the base model ± se [–]")
    axes.margins(x=0.1, y=0.25)
    axes.grid(visible=False, axis="y")
    axes.set_title("gain in held-out prediction")


def _added(model: str) -> str:
    return "\n".join(f"+ {words(part)}" for part in model.split("+") if part != BASE)
