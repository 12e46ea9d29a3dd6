"""Question (b): which mechanism bursts 2 of 3 actuators at 25 % and none below.

An actuator bursts before 240 kPa if its uniaxial equivalent elongation there, times a factor of
concentration k, exceeds the elongation at break of its material, log-normal about the films'
median:

    P(burst) = Φ( ln[k (λ_eq − 1) / (λ_b − 1)] / s ),

and the counts are binomial. The wall's second stretch is λ^b, b from 0 (planar) to 1
(equibiaxial) being unknown; principal stretch does not depend on it.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import special

from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.strength import (
    CRITERIA,
    Criterion,
    equivalent_uniaxial_stretch,
    limit_stretch,
    rupture_probability,
)
from bayesdeg.surrogate.surrogate import Surrogate
from nagai_2021.published import (
    ELONGATION_DROP,
    ELONGATION_FRESH,
    LEVELS,
    NODES_USED,
    PRESSURES,
    RUPTURED,
    SPECIMENS,
    Materials,
)

Floats = NDArray[np.float64]

SCATTER = 0.2
"""Scale of the half-normal prior of the sd of ln elongation at break."""
CONCENTRATION = 0.7
"""ln k is half-normal with this scale: k is 1.6 in the median and below 4 in 95 of 100 draws."""
FLAW_DROP, FLAW_SCATTER = 0.7, 0.5
"""Half-normal scales of the further fall of ln elongation at 25 %, and of its further scatter."""


@dataclass(frozen=True)
class Hypothesis:
    """What besides the elongation limit of the films may act.

    Parameters
    ----------
    criterion : str
        Of `bayesdeg.material.strength`.
    concentration : bool
        Whether strain may be concentrated, by one factor at all levels.
    flaws : bool
        Whether flaws at 25 % may cut the limit and widen its scatter.
    """

    criterion: Criterion = "principal_stretch"
    concentration: bool = False
    flaws: bool = False

    def __str__(self) -> str:
        """Return the words for it."""
        extra = [("strain concentration", self.concentration), ("flaws at 25 %", self.flaws)]
        names = [self.criterion.replace("_", " "), *(name for name, holds in extra if holds)]
        return " + ".join(names)


HYPOTHESES = tuple(
    Hypothesis(criterion, concentration, flaws)
    for concentration, flaws, criterion in product((False, True), (False, True), CRITERIA)
)


@dataclass(frozen=True)
class Walls:
    """Draws of demand and strength at the six levels at 240 kPa.

    Parameters
    ----------
    demand : dict of array, shape (n, 6)
        Equivalent uniaxial elongation λ_eq − 1 by criterion [–].
    limit : array, shape (n, 6)
        Median elongation at break λ_b − 1 [–].
    scatter, concentration, flaw_drop, flaw_scatter : array, shape (n, 1)
        Draws from their priors: sd of ln elongation, ln k, and what flaws add at 25 % [–].
    """

    demand: dict[str, Floats]
    limit: Floats
    scatter: Floats
    concentration: Floats
    flaw_drop: Floats
    flaw_scatter: Floats


def draw_walls(surrogate: Surrogate, materials: Materials, generator: np.random.Generator) -> Walls:
    """Draw demand and strength for materials that agree with the published moduli."""
    stretch = surrogate(materials.inputs(LEVELS, PRESSURES[-1:])).peak_stretch[..., 0]
    count = len(materials)
    biaxiality = generator.uniform(0.0, 1.0, (count, 1))
    law = Yeoh(*materials.constants(LEVELS))
    demand = {c: demanded(stretch, biaxiality, c, law) for c in CRITERIA}
    whole = np.all([np.isfinite(d).all(axis=1) for d in demand.values()], axis=0)
    log_limit = log_elongations(generator, count)

    def half_normal(scale: float) -> Floats:
        return scale * np.abs(generator.standard_normal((count, 1)))

    rest = [half_normal(s) for s in (SCATTER, CONCENTRATION, FLAW_DROP, FLAW_SCATTER)]
    limit = limit_stretch(log_limit, LEVELS, NODES_USED) - 1.0
    return Walls(
        {c: values[whole] for c, values in demand.items()},
        limit[whole],
        *(values[whole] for values in rest),
    )


def demanded(stretch: Floats, biaxiality: Floats, criterion: Criterion, law: Yeoh) -> Floats:
    """Return the uniaxial elongation that does as much harm as λ along and λ^b across [–]."""
    states = np.stack([stretch, stretch**biaxiality, stretch ** (-1.0 - biaxiality)], axis=-1)
    return equivalent_uniaxial_stretch(states, criterion, law) - 1.0


def burst_probability(walls: Walls, hypothesis: Hypothesis) -> Floats:
    """Return the probability that an actuator bursts before 240 kPa, (n, 6)."""
    elongation = walls.demand[hypothesis.criterion]
    limit, scatter = walls.limit, np.broadcast_to(walls.scatter, walls.limit.shape)
    if hypothesis.concentration:
        elongation = elongation * np.exp(walls.concentration)
    if hypothesis.flaws:
        degraded = LEVELS > 24.0
        limit = limit * np.exp(-walls.flaw_drop * degraded)
        scatter = np.hypot(scatter, walls.flaw_scatter * degraded)
    return rupture_probability(1.0 + elongation, 1.0 + limit, scatter, "lognormal")


def probability_of_counts(walls: Walls, hypothesis: Hypothesis) -> tuple[float, float]:
    """Return the probability of the published counts and its Monte Carlo standard error."""
    joint = counts_given(burst_probability(walls, hypothesis))
    return float(joint.mean()), float(joint.std(ddof=1) / np.sqrt(len(joint)))


def counts_given(burst: Floats) -> Floats:
    """Return the probability of the published counts where one actuator bursts so often, (n,)."""
    ways = special.comb(SPECIMENS, RUPTURED)
    each = ways * burst**RUPTURED * (1.0 - burst) ** (SPECIMENS - RUPTURED)
    return np.asarray(np.prod(each, axis=1))


def required_factor(walls: Walls, criterion: Criterion = "principal_stretch") -> Floats:
    """Return the factor on strain at which half of the actuators burst, (n, 6) [–]."""
    return walls.limit / walls.demand[criterion]


def none_below(walls: Walls, criterion: Criterion = "principal_stretch") -> float:
    """Return the probability of no rupture at 0 … 20 % if a common factor makes it 2/3 at 25 %."""
    quantile = special.ndtri(2.0 / 3.0)
    needed = required_factor(walls, criterion)[:, -1:] * np.exp(quantile * walls.scatter)
    elongation = walls.demand[criterion] * needed
    burst = rupture_probability(1.0 + elongation, 1.0 + walls.limit, walls.scatter, "lognormal")
    return float(np.prod((1.0 - burst[:, :-1]) ** SPECIMENS, axis=1).mean())


def log_elongations(generator: np.random.Generator, count: int) -> Floats:
    """Return ln of the median elongation at the nodes, falling and without a kink, (count, 3)."""
    mean, sd = ELONGATION_FRESH
    fresh = np.log(generator.normal(mean, sd, count) / 100.0)
    degraded = fresh - np.log(ELONGATION_DROP) + 0.1 * generator.standard_normal(count)
    # a quarter of the way from either end is the most that leaves the quadratic monotone
    share = np.clip(generator.normal(0.5, 0.15, count), 0.25, 0.75)
    return np.stack([fresh, fresh + share * (degraded - fresh), degraded], axis=-1)
