"""Published statistics of actuators whose readings are not to be had: R² and counts of ruptures.

Both are likelihoods only for a study without readings of its own. Where there is an
``actuator.csv``, the same statistics are shown beside the model's and not fitted: they describe
other specimens and another simulation, and its own readings carry the information.

What R² says is told in `published_density`: it speaks of scatter and noise, not of the shape of the
curves. A binomial count speaks of the elongation limit. Where counts contradict the model, as two
of three at 25 % and none below do in doi:10.3389/frobt.2021.760485, a fit gives up what it can: the
constants at 25 % leave the published Young's modulus for a material three times as soft. Such
counts are better left out of the fit and held against it.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import ForwardMap, Inputs
from bayesdeg.data.study import Study
from bayesdeg.errors import Fault, StudyError
from bayesdeg.inference.parameters import Named
from bayesdeg.inference.published_density import (
    STIFFNESS_NODES,
    Differences,
    r_squared_log_density,
    rupture_log_density,
)
from bayesdeg.inference.specimens import Material, elongation_at, elongation_spread
from bayesdeg.material.degradation import Nodes

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Kind = Literal["r_squared", "ruptures"]

PRESSURES = np.arange(20.0, 241.0, 20.0)
"""Of the published tests [kPa]; curvature at 0 kPa is zero by definition and counts in SST."""
SPECIMENS = 3.0
"""Actuators at a level, and films behind the constants of a level, where no number is given."""


@dataclass(frozen=True)
class PublishedTests:
    """Tests of actuators of which only statistics are known.

    Parameters
    ----------
    degradation, degradation_sd : array, shape (n_levels,)
        D_R of each level and its standard error from specimen to specimen [%].
    pressure : array, shape (n_pressures,)
        Rising [kPa].
    tested : array, shape (n_levels,)
        Number of actuators.
    r_squared, ruptured : array, shape (n_levels,)
        R² [–] and number of actuators that burst; nan where it is not given.
    films : float
        Number of films behind the constants that the published simulation used at a level.
    """

    degradation: Floats
    degradation_sd: Floats
    pressure: Floats
    tested: Floats
    r_squared: Floats
    ruptured: Floats
    films: float = SPECIMENS

    def given(self, kind: Kind) -> Flags:
        """Return the levels at which a statistic is given, shape (n_levels,)."""
        return np.isfinite(self.r_squared if kind == "r_squared" else self.ruptured)

    def without_ruptures(self) -> "PublishedTests | None":
        """Return R² alone, None if there is none.

        A base model of walls without flaws holds published ruptures for next to impossible, since
        a stiffer material is stretched less (2 of 3 at 25 %: a probability of e⁻¹⁸⁷). Fitted, they
        would pull the stiffness to less than a third of its published value instead of telling
        that something is missing; so they are compared, and left to causes of rupture.
        """
        if not np.any(self.given("r_squared")):
            return None
        return replace(self, ruptured=np.full_like(self.ruptured, np.nan))

    def names(self, kind: Kind) -> tuple[str, ...]:
        """Return what the columns of a block of the log likelihood stand for."""
        words = {"r_squared": "R²", "ruptures": "ruptures"}[kind]
        return tuple(f"{words} at {level:g} %" for level in self.degradation[self.given(kind)])


def published_tests(study: Study) -> PublishedTests | None:
    """Return the statistics of a study that are used as data.

    Degraded specimens get the error of degradation rates that the study states in general;
    fresh ones have none.

    Returns
    -------
    PublishedTests or None
        None if none are given, or the study has readings of actuators of its own.

    Raises
    ------
    StudyError
        If a statistic is given twice at a level, or more burst than were tested.
    """
    if study.actuator is not None or study.summary is None:
        return None
    given = {name: _by_level(study, name) for name in ("r_squared", "ruptured_count")}
    tested = _by_level(study, "tested_count")
    levels = sorted({level for values in given.values() for level in values})
    if not levels:
        return None
    films = study.summary.loc[study.summary["quantity"] == "young_modulus", "n"].dropna()
    r_squared, ruptured = (
        np.array([values.get(level, np.nan) for level in levels]) for values in given.values()
    )
    tests = PublishedTests(
        degradation=np.array(levels),
        degradation_sd=np.where(np.array(levels) > 0.0, study.settings.degradation_sd_pct, 0.0),
        pressure=PRESSURES,
        tested=np.array([tested.get(level, SPECIMENS) for level in levels]),
        r_squared=r_squared,
        ruptured=ruptured,
        films=float(films.min()) if len(films) else SPECIMENS,
    )
    _refuse_impossible_counts(tests)
    return tests


def log_likelihood(
    tests: PublishedTests,
    forward: ForwardMap,
    values: Named,
    material: Material,
    *,
    elongation_nodes: Nodes,
    paper_thickness: float,
) -> dict[str, Floats]:
    """Return the log densities of all published statistics by kind.

    Parameters
    ----------
    tests : PublishedTests
        The data.
    forward : ForwardMap
        Curvature and stretch from constants and pressure.
    values : mapping
        Named values, (n,): ``volume_ratio``, ``paper_stiffness``, ``stiffness_scatter``, the
        noise of curvature, and for ruptures the elongation at break and its scatter.
    material : Material
        Median material at the levels.
    elongation_nodes : tuple of float
        Degradation rates at which the elongation is held [%].
    paper_thickness : float
        [mm]

    Returns
    -------
    dict
        ``r_squared`` and ``ruptures``, as far as given, each (n, n_given). Nan where the forward
        map has no answer.
    """
    scatter = values["stiffness_scatter"][:, None]
    spread = scatter**2 + (material.sensitivity * tests.degradation_sd) ** 2
    c1, c2, c3 = (material.constants[..., i, None] for i in range(3))
    inputs = Inputs(
        pressure=tests.pressure,
        c1=c1,
        c2=c2,
        c3=c3,
        linear_scale=np.cbrt(values["volume_ratio"])[:, None, None],
        paper_stiffness=values["paper_stiffness"][:, None, None],
        paper_thickness=np.full((1, 1, 1), paper_thickness),
    )
    blocks = {}
    if np.any(known := tests.given("r_squared")):
        blocks["r_squared"] = _r_squared(tests, forward, values, inputs, spread)[:, known]
    if np.any(known := tests.given("ruptures")):
        limit = elongation_at(values, tests.degradation, elongation_nodes) / 100.0
        variance = elongation_spread(
            values, tests.degradation, tests.degradation_sd, nodes=elongation_nodes
        )
        blocks["ruptures"] = rupture_log_density(
            tests.ruptured[known],
            tests.tested[known],
            _peak_stretch(tests, forward, inputs, spread)[:, known],
            limit=1.0 + limit[:, known],
            scatter=np.sqrt(variance)[:, known],
        )
    return blocks


def _r_squared(
    tests: PublishedTests, forward: ForwardMap, values: Named, inputs: Inputs, spread: Floats
) -> Floats:
    prediction = forward(inputs)
    noise, floor, length = (
        values[name][:, None, None]
        for name in ("curvature_noise", "curvature_noise_floor", "curvature_noise_length")
    )
    sd = np.hypot(floor, noise * prediction.curvature)
    apart = np.abs(tests.pressure[:, None] - tests.pressure)
    correlation = np.exp(-apart / length)[:, None]
    differences = Differences(
        slope=prediction.slope,
        spread=spread,
        common_spread=values["stiffness_scatter"][:, None] ** 2 / tests.films,
        noise=sd[..., :, None] * correlation * sd[..., None, :],
        specimens=tests.tested,
    )
    return r_squared_log_density(1.0 - tests.r_squared, prediction.curvature, differences)


def _peak_stretch(
    tests: PublishedTests, forward: ForwardMap, inputs: Inputs, spread: Floats
) -> Floats:
    """Return the peak stretch at the largest pressure over stiffnesses, (n, n_levels, 7)."""
    factor = np.exp(np.sqrt(spread)[..., None] * STIFFNESS_NODES)
    prediction = forward(
        replace(
            inputs,
            pressure=np.full((1, 1, len(STIFFNESS_NODES)), tests.pressure[-1]),
            c1=inputs.c1 * factor,
            c2=inputs.c2 * factor,
            c3=inputs.c3 * factor,
        )
    )
    return np.where(prediction.status == 0, prediction.peak_stretch, np.nan)


def _by_level(study: Study, quantity: str) -> dict[float, float]:
    assert study.summary is not None
    table = study.summary
    rows = table[(table["quantity"] == quantity) & table["degradation_pct"].notna()]
    levels = rows["degradation_pct"].to_numpy(np.float64)
    twice = sorted({float(level) for level in levels if np.sum(levels == level) > 1})
    if twice:
        remedy = "keep one row of each level"
        raise StudyError(
            [
                Fault("summary.csv", f"{quantity} at {level:g} % is given twice", remedy)
                for level in twice
            ]
        )
    return dict(zip(levels.tolist(), rows["value"].to_numpy(np.float64).tolist(), strict=True))


def _refuse_impossible_counts(tests: PublishedTests) -> None:
    faults = [
        Fault(
            "summary.csv",
            f"{ruptured:g} of {tested:g} actuators burst at {level:g} %",
            "give tested_count at that level: at least 1, and at least ruptured_count",
        )
        for level, tested, ruptured in zip(
            tests.degradation, tests.tested, tests.ruptured, strict=True
        )
        if tested < max(np.nan_to_num(ruptured), 1.0)
    ]
    if faults:
        raise StudyError(faults)
