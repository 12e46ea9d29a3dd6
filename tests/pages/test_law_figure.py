"""The figure of material laws: panels, curves of the constants in the table, points of films."""

import numpy as np
import pandas as pd
import pytest

from bayesdeg.material.hyperelastic import Gent, NeoHookean, nominal_stress
from bayesdeg.pages.figures.material_laws import MOST_PANELS, drawn_panels, laws_figure
from bayesdeg.pages.tables import MATERIAL_LAWS, TABLES

STRETCH = np.linspace(1.1, 2.0, 4)


def tensile(rates, modes=("uniaxial",)):
    return pd.DataFrame(
        [
            {
                "model": model,
                "specimen_id": f"{mode}{rate}",
                "mode": mode,
                "degradation_pct": rate,
                "stretch": stretch,
                "stress_MPa": stretch - 1.0,
                "fitted": 1,
            }
            for model in ("base", "final")
            for rate in rates
            for mode in modes
            for stretch in STRETCH
        ]
    )


def laws(rates, *, judged=True):
    empty = dict.fromkeys(TABLES[MATERIAL_LAWS].headings, np.nan)
    return pd.DataFrame(
        [
            empty
            | {"law": law, "degradation_pct": rate, "used": int(law == "neo_hookean")}
            | {"held_out_rmse_MPa": error if judged else np.nan}
            | (constants if rate != "all" else {})
            for law, constants, error in (
                ("neo_hookean", {"c1_MPa": 0.3}, 0.2),
                ("gent", {"mu_MPa": 0.5, "j_m": 9.0}, 0.05),
            )
            for rate in (*(f"{r:g}" for r in rates), "all")
        ]
    )


def test_curves_are_those_of_the_constants_and_points_those_of_the_films():
    figure = laws_figure(laws([0.0, 10.0]), tensile([0.0, 10.2]))
    errors, first, second = (axes for axes in figure.axes if axes.axison)
    for axes in (first, second):
        soft, gent, read = axes.lines
        grid = soft.get_xdata()
        expected = nominal_stress(NeoHookean(0.3), grid, mode="uniaxial")
        np.testing.assert_allclose(soft.get_ydata(), expected)
        expected = nominal_stress(Gent(0.5, 9.0), grid, mode="uniaxial")
        np.testing.assert_allclose(gent.get_ydata(), expected)
        assert soft.get_linewidth() > gent.get_linewidth()
        # once, though both models predict them
        np.testing.assert_allclose(read.get_xdata(), STRETCH)
    pooled = [line.get_ydata().tolist() for line in errors.lines if line.get_marker() == "o"]
    assert pooled == [[0.2], [0.05]]


def test_where_no_film_was_held_out_there_are_curves_alone():
    figure = laws_figure(laws([0.0], judged=False), tensile([0.0]), degrades=False)
    (axes,) = (axes for axes in figure.axes if axes.axison)
    assert axes.get_title(loc="left") == "uniaxial"


@pytest.mark.parametrize(("count", "modes"), [(1, 1), (3, 2), (9, 1)])
def test_of_many_levels_and_modes_some_are_drawn(count, modes):
    rates = [5.0 * k for k in range(count)]
    named = ("uniaxial", "planar")[:modes]
    chosen = drawn_panels(laws(rates), tensile(rates, named))
    assert len(chosen) == len(set(chosen)) == min(count * modes, MOST_PANELS)
    assert (chosen[0][0], chosen[-1][0]) == (0.0, rates[-1])
