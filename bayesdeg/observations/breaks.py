"""Elongations at break of films."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, override

import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.study import Study
from bayesdeg.material.degradation import lagrange_weights
from bayesdeg.material.strength import GUMBEL, draw_scores, score_density
from bayesdeg.observations.arrays import chosen
from bayesdeg.observations.kinds import ROUNDING, Observations, Parts, Rows, State
from bayesdeg.observations.specimens import FilmsAndActuators, elongation_spread, node_name

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class BreakTable:
    """Elongations at break.

    Parameters
    ----------
    specimens : tuple of str
        One per specimen.
    degradation, degradation_sd : array, shape (n,)
        D_R of the film and its standard error [%].
    elongation : array, shape (n,)
        [%].
    """

    specimens: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    elongation: Floats

    def subset(self, rows: Rows) -> "BreakTable":
        """Return some of the specimens."""
        return chosen(self, rows)


def break_table(study: Study) -> BreakTable | None:
    """Return the elongations at break."""
    table = study.breaks
    if table is None:
        return None
    return BreakTable(
        tuple(str(s) for s in table["specimen_id"]),
        table["degradation_pct"].to_numpy(np.float64),
        table["degradation_sd_pct"].to_numpy(np.float64),
        table["elongation_pct"].to_numpy(np.float64),
    )


@dataclass(frozen=True)
class Breaks(Observations):
    """Elongations at break.

    Parameters
    ----------
    table : BreakTable
        The readings.
    """

    name: ClassVar[str] = "breaks"
    order: ClassVar[int] = 40

    table: BreakTable = field(
        default_factory=lambda: BreakTable((), np.empty(0), np.empty(0), np.empty(0))
    )

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return self.table.specimens

    @property
    @override
    def elongation_levels(self) -> Floats:
        return self.table.degradation

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        score, log_scale = self._scores(state)
        return score_density(score, state.world.scatter_law) - log_scale

    @override
    def factors(self, state: State[FilmsAndActuators]) -> Parts:
        score, log_scale = self._scores(state)
        if state.world.scatter_law == "lognormal":
            return Parts(normal=((score, log_scale),))
        # the expected information of a shift of ln elongation by one sd is that of the Gumbel law
        return Parts(events=((score_density(score, "weibull") - log_scale, GUMBEL * score),))

    @override
    def subset(self, rows: Rows) -> "Breaks":
        return Breaks(self.table.subset(rows))

    @override
    def least(self, digits: Mapping[str, float]) -> dict[str, float]:
        """Return the bound of the scatter of ln elongation, smallest for the longest elongation."""
        digit = digits.get("elongation_pct", 0.0)
        return {"elongation_scatter": ROUNDING * digit / float(self.table.elongation.max())}

    @override
    def replicated(
        self,
        state: State[FilmsAndActuators],
        generator: np.random.Generator,
        drawn: tuple[Observations, ...],
    ) -> tuple[Observations, ...]:
        median, spread = self._law(state)
        scores = draw_scores(spread.shape, generator, state.world.scatter_law)
        again = median * np.exp(spread * scores)
        return (*drawn, Breaks(replace(self.table, elongation=again[0])))

    @override
    def start(self, world: FilmsAndActuators) -> dict[str, float]:
        """Return nodal values by least squares, as ln elongation is linear in them."""
        nodes = world.elongation_nodes
        weights = lagrange_weights(self.table.degradation, nodes)
        at_nodes = np.linalg.lstsq(weights, np.log(self.table.elongation), rcond=None)[0]
        return {
            node_name("elongation", node): float(np.exp(value))
            for node, value in zip(nodes, at_nodes, strict=True)
        }

    def _scores(self, state: State[FilmsAndActuators]) -> tuple[Floats, Floats]:
        """Return scores at break, and ln of the elongation change per unit score [%]."""
        median, spread = self._law(state)
        elongation = self.table.elongation
        return np.log(elongation / median) / spread, np.log(spread * elongation)

    def _law(self, state: State[FilmsAndActuators]) -> tuple[Floats, Floats]:
        """Return median and sd of the logarithm of elongations at break, each (n, n_films)."""
        world, rates = state.world, self.table.degradation
        slope = world.elongation_slope(state.values, rates)
        spread = elongation_spread(state.values, slope, self.table.degradation_sd)
        return world.elongation(state.values, rates), np.sqrt(spread)


def from_study(study: Study) -> tuple[Breaks, ...]:
    """Return the elongations at break of a study, if any."""
    table = break_table(study)
    return () if table is None else (Breaks(table),)
