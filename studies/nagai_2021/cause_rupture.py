"""The second contradiction by cause: 2 of 3 burst at 25 % and none below.

An actuator bursts as in `rupture`, with strain at 240 kPa and elongation limit modified by one
cause of the catalogue at sizes from its prior. All causes share their draws of material, limit and
scatter. If the strain cannot be simulated, counts are taken as impossible; the share of such draws
is given.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause, StrengthConditions
from bayesdeg.material.degradation import derivative
from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.strength import (
    CRITERIA,
    Criterion,
    Strength,
    limit_stretch,
)
from bayesdeg.surrogate.surrogate import Surrogate
from nagai_2021.causes import (
    LAST,
    ROOM,
    Misread,
    Values,
    able,
    cannot_burst,
    misread,
    predict,
    size_of,
    values_at,
    weighted_quantiles,
    within_grid,
)
from nagai_2021.published import LEVELS, NODES_USED, Materials
from nagai_2021.rupture import SCATTER, counts_given, demanded, log_elongations

Floats = NDArray[np.float64]

LATER = frozenset({"dry_embrittlement", "uneven_degradation"})
WIDE = 2.5
"""Scatter is drawn from a prior so many times as wide, and weighted for it."""
HERMITE = ((-np.sqrt(3.0), 1.0 / 6.0), (0.0, 2.0 / 3.0), (np.sqrt(3.0), 1.0 / 6.0))
"""Points [sd] and weights for the mean over specimens' D_R."""


@dataclass(frozen=True)
class Shared:
    """Draws that all causes share.

    Parameters
    ----------
    surrogate : Surrogate
        The mechanics.
    materials : Materials
        One row a draw.
    log_limit : array, shape (n, 3)
        ln of the median elongation at break at the nodes.
    biaxiality, scatter : array, shape (n, 1)
        Exponent of the second stretch; sd of ln elongation at break [–].
    weight : array, shape (n,)
        Prior over drawn density of the scatter.
    """

    surrogate: Surrogate
    materials: Materials
    log_limit: Floats
    biaxiality: Floats
    scatter: Floats
    weight: Floats


@dataclass(frozen=True)
class Bursts:
    """Probabilities that an actuator bursts before 240 kPa.

    Parameters
    ----------
    probability : array, shape (n, 6)
        nan where strain can't be simulated.
    """

    probability: Floats

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Draws of which all levels can be simulated, (n,)."""
        return np.asarray(np.isfinite(self.probability).all(axis=1))

    def joint(self) -> Floats:
        """Return the probability of the published counts, 0 where not inside, (n,)."""
        return np.where(self.inside, counts_given(self.probability), 0.0)


def share(surrogate: Surrogate, materials: Materials, generator: np.random.Generator) -> Shared:
    """Draw limits and scatter for materials that agree with the published moduli."""
    count = len(materials)
    score = WIDE * np.abs(generator.standard_normal((count, 1)))
    weight = WIDE * np.exp(-0.5 * score[:, 0] ** 2 * (1.0 - WIDE**-2))
    return Shared(
        surrogate,
        materials,
        log_elongations(generator, count),
        generator.uniform(size=(count, 1)),
        SCATTER * score,
        weight,
    )


def burst(
    shared: Shared,
    cause: Cause | None = None,
    values: Values | None = None,
    criteria: tuple[Criterion, ...] = CRITERIA,
) -> dict[Criterion, Bursts]:
    """Return how probably actuators burst with a cause, by criterion."""
    count = len(shared.materials)
    none = np.zeros((count, len(LEVELS)))
    off = Misread(none, none)
    if cause is not None and values is not None:
        off = misread(cause, values)
    points = HERMITE if np.any(off.scatter) else ((0.0, 1.0),)
    total = {criterion: np.zeros_like(none) for criterion in criteria}
    for sds, weight in points:
        level = within_grid(LEVELS + off.shift + sds * off.scatter)
        for criterion, probability in _burst_at(shared, level, cause, values, criteria).items():
            total[criterion] += weight * probability
    return {criterion: Bursts(probability) for criterion, probability in total.items()}


def compare(shared: Shared, bursts: Bursts, reference: Bursts) -> dict[str, Any]:
    r"""Return the counts' probability and its ratio to the reference, with Monte Carlo errors.

    .. math:: B = \bar w / \bar w_0, \quad
        s_B = B \, \mathrm{sd}(w / \bar w - w_0 / \bar w_0) / \sqrt n
    """
    weight, before = (shared.weight * b.joint() for b in (bursts, reference))
    ratio = float(weight.mean() / before.mean())
    root = np.sqrt(len(weight))
    away = weight / max(weight.mean(), np.finfo(float).tiny) - before / before.mean()
    inside = bursts.inside
    of_one = np.average(bursts.probability[inside], axis=0, weights=shared.weight[inside])
    return {
        "probability": float(weight.mean()),
        "monte_carlo_error": float(weight.std(ddof=1) / root),
        "bayes_factor": ratio,
        "bayes_factor_error": float(ratio * away.std(ddof=1) / root),
        "share_outside": float(1.0 - inside.mean()),
        "burst_probability": of_one.tolist(),
    }


def judge(
    shared: Shared, cause: Cause, reference: dict[Criterion, Bursts], generator: np.random.Generator
) -> dict[str, Any]:
    """Return how probable a cause makes the counts, and at which size."""
    scores = generator.standard_normal((len(shared.materials), len(cause.parameters)))
    values = values_at(cause, scores)
    bursts = burst(shared, cause, values)
    by_criterion = {c: compare(shared, bursts[c], reference[c]) for c in CRITERIA}
    mildest = bursts[CRITERIA[0]]
    size = weighted_quantiles(size_of(cause, values), shared.weight * mildest.joint())
    first = cause.parameters[0]
    changed = not np.allclose(
        mildest.probability, reference[CRITERIA[0]].probability, rtol=1e-9, atol=0.0
    )
    found = {"parameter": first.name, "unit": first.unit, "changes_bursts": changed, "size": size}
    return {**found, "criteria": by_criterion}


def answer(shared: Shared, generator: np.random.Generator) -> dict[str, Any]:
    """Return the evidence of every cause that can change ruptures, and why the others can't."""
    acting, silent = able(cannot_burst)
    reference = burst(shared)
    # what joined the catalogue later has numbers of its own: those of the others stay
    streams = {name: generator.spawn(1)[0] if name in LATER else generator for name in acting}
    judged = {
        name: judge(shared, cause, reference, streams[name]) for name, cause in acting.items()
    }

    def probability(name: str) -> float:
        return max(float(found["probability"]) for found in judged[name]["criteria"].values())

    return {
        "without_cause": {c: compare(shared, reference[c], reference[c]) for c in CRITERIA},
        "causes": {name: judged[name] for name in sorted(judged, key=probability, reverse=True)},
        "cannot_act": silent,
    }


def _burst_at(
    shared: Shared,
    level: Floats,
    cause: Cause | None,
    values: Values | None,
    criteria: tuple[Criterion, ...],
) -> dict[Criterion, Floats]:
    """Return the probability of bursting at true D_R (n, 6), by criterion."""
    prediction = predict(
        shared.surrogate, shared.materials, level, cause=cause, values=values, read=LAST
    )
    stretch = np.where(prediction.status == 0, prediction.peak_stretch, np.nan)[..., 0]
    strength = _strength(shared, level, cause, values)
    law = Yeoh(*shared.materials.constants(level))
    found = {}
    for criterion in criteria:
        demand = demanded(stretch, shared.biaxiality, criterion, law)
        known = np.isfinite(demand)
        with np.errstate(divide="ignore"):  # nothing bursts without strain
            whole = strength.log_whole(np.log(np.where(known, demand, 0.0)))
        found[criterion] = np.where(known, -np.expm1(whole), np.nan)
    return found


def _strength(
    shared: Shared, level: Floats, cause: Cause | None, values: Values | None
) -> Strength:
    median = limit_stretch(shared.log_limit, level, NODES_USED) - 1.0
    strength = Strength(median, np.broadcast_to(shared.scatter, median.shape))
    if cause is None or cause.on_strength is None or values is None:
        return strength
    effect = {name: size[..., 0] for name, size in cause.effect(values).items()}
    slope = derivative(shared.log_limit, level, NODES_USED)
    tests = StrengthConditions(level, np.full(level.shape[-1], ROOM), slope)
    return cause.on_strength(strength, tests, effect)
