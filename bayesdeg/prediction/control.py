"""Control: the pressure that reaches a wanted curvature at a bounded risk of rupture."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayesdeg.observations.specimens import has_elongation
from bayesdeg.prediction.predictive import QUANTILES, Specimens, finer, respond

Floats = NDArray[np.float64]

INTERVAL = (0.05, 0.5, 0.95)
DOUBLINGS = 6  # factor on the pressure tried first
COARSE, FINE = (
    33,
    65,
)  # pressures for inverting curves, first over the whole range, then where needed
FINER_STRATA = 60
POINTS, ROUNDS = 17, 4  # bisections: the allowed pressure is found to 1/65536 of the range


@dataclass(frozen=True)
class Allowed:
    """The largest pressure at which the probability of rupture is not above the risk.

    Parameters
    ----------
    pressure : float
        [kPa]; 0 if not even the smallest is allowed.
    by_rupture : bool
        Whether rupture limits it; otherwise more specimens than the risk balloon beyond, or lie
        outside the range of the forward map.
    found : bool
        False if no limit was found: then `pressure` is the largest tried.
    by_test : bool
        Whether the tests limit it although the risk would allow more.
    """

    pressure: float
    by_rupture: bool
    found: bool = True
    by_test: bool = False


@dataclass(frozen=True)
class Setting:
    """The pressure for a wanted curvature, and its consequences.

    Parameters
    ----------
    degradation, wanted, risk : float
        The request: [%], the median if rates differ between draws, [1/m], [–].
    pressure : float
        To be set [kPa]: that at which half of the specimens reach the wanted curvature, or the
        largest allowed if that is less; nan if none is allowed.
    reached : bool
        Whether the wanted curvature is reached at that pressure.
    needed : array, shape (3,)
        5, 50 and 95 % quantiles over new specimens of the pressure that each needs [kPa]; inf of
        specimens that never reach it.
    allowed : Allowed
        The largest pressure allowed by the risk.
    curvature : array, shape (5,)
        Quantiles ``QUANTILES`` over new specimens of the curvature at `pressure` [1/m]; inf of
        specimens outside the range there, which bend further before they balloon.
    probability : array, shape (3,)
        Probability of rupture at `pressure`, and its 5 and 95 % quantiles over the posterior [–];
        nan if the elongation at break is unknown.
    hours : float, optional
        Time in the soil, where the degradation rate follows from it [h].
    rates : array
        5, 50 and 95 % quantiles of the degradation rate then; where it is known that alone [%].
    """

    degradation: float
    wanted: float
    risk: float
    pressure: float
    reached: bool
    needed: Floats
    allowed: Allowed
    curvature: Floats
    probability: Floats
    hours: float | None = None
    rates: Floats = field(default_factory=lambda: np.empty(0))


def needed_pressure(pressure: Floats, curvature: Floats, wanted: float) -> Floats:
    """Return the lowest pressure at which each curve reaches a curvature, linear between points.

    Parameters
    ----------
    pressure : array, shape (n_points,)
        Rising [kPa].
    curvature : array, shape (n, n_points)
        [1/m]; nan where there is none.
    wanted : float
        [1/m].

    Returns
    -------
    array, shape (n,)
        [kPa]; inf of curves that never reach it.

    Examples
    --------
    >>> curves = np.array([[0.0, 4.0, 8.0], [0.0, 2.0, np.nan], [0.0, 0.0, 5.0]])
    >>> needed_pressure(np.array([0.0, 100.0, 200.0]), curves, 5.0)
    array([125.,  inf, 200.])
    """
    reached = np.where(np.isfinite(curvature), curvature, -np.inf) >= wanted
    after = np.argmax(reached, axis=1)
    before = np.maximum(after - 1, 0)
    rows = np.arange(len(curvature))
    low, high = curvature[rows, before], curvature[rows, after]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(after > before, (wanted - low) / (high - low), 1.0)
    found = pressure[before] + np.nan_to_num(share, nan=1.0) * (pressure[after] - pressure[before])
    return np.where(reached.any(axis=1), found, np.inf)


def needed_by(
    specimens: Specimens, degradation: float | Floats, wanted: float, *, first: float
) -> Floats:
    """Return the pressure that each specimen needs for a curvature.

    Parameters
    ----------
    specimens : Specimens
        New specimens.
    degradation : float or array, shape (n_draws,)
        Of all, or of the specimens of each draw [%].
    wanted : float
        [1/m].
    first : float
        The largest pressure tried first; doubled while specimens need more [kPa].

    Returns
    -------
    array, shape (n,)
        [kPa]; inf of specimens that never reach it.
    """
    top = first
    for _ in range(DOUBLINGS):
        last = respond(specimens, degradation, np.array([top])).curvature
        if not np.any(last < wanted):
            break
        top *= 2.0
    coarse = np.linspace(0.0, top, COARSE)
    found = needed_pressure(coarse, respond(specimens, degradation, coarse).curvature, wanted)
    known = found[np.isfinite(found)]
    if not len(known):
        return found
    low, high = known.min() - coarse[1], known.max() + coarse[1]
    fine = np.linspace(max(low, 0.0), min(high, top), FINE)
    return needed_pressure(fine, respond(specimens, degradation, fine).curvature, wanted)


def largest_allowed(
    specimens: Specimens,
    degradation: float | Floats,
    risk: float,
    *,
    first: float,
    ceiling: float = np.inf,
) -> Allowed:
    """Return the largest pressure up to which the probability of rupture is not above a risk.

    It is the probability that a new specimen bursts, averaged over specimens and posterior; those
    outside the range of the forward map count as burst.

    Parameters
    ----------
    specimens : Specimens
        New specimens.
    degradation : float or array, shape (n_draws,)
        Of all, or of the specimens of each draw [%].
    risk : float
        Between 0 and 1 [–].
    first : float
        The largest pressure tried first; doubled while it is allowed [kPa].
    ceiling : float
        Above which nothing is allowed, whatever the risk [kPa].
    """

    def over(pressure: Floats) -> NDArray[np.bool_]:
        answer: Floats = respond(specimens, degradation, pressure).burst.mean(axis=0)
        return answer > risk

    top = min(first, ceiling)
    for _ in range(DOUBLINGS):
        if top == ceiling or over(np.array([top]))[0]:
            break
        top = min(2.0 * top, ceiling)
    if top == ceiling and not (top > 0.0 and over(np.array([top]))[0]):
        return Allowed(top, by_rupture=False, by_test=True)
    low, high = 0.0, top
    for _ in range(ROUNDS):
        grid = np.linspace(low, high, POINTS)
        beyond = over(grid)
        if not beyond.any():
            return Allowed(float(high), by_rupture=False, found=False)
        first_over = int(np.argmax(beyond))
        low, high = float(grid[max(first_over - 1, 0)]), float(grid[first_over])
    ended = respond(specimens, degradation, np.array([high]))
    unanswered = 1.0 - float(ended.answered[0])
    return Allowed(low, by_rupture=bool(unanswered < 0.5 * float(ended.burst.mean())))


def setting_for(
    specimens: Specimens,
    degradation: float | Floats,
    wanted: float,
    *,
    risk: float,
    first: float,
    allowed: Allowed | None = None,
) -> Setting:
    """Return the pressure for a wanted curvature, and its consequences.

    The pressure is the median of those that new specimens need; as curves rise, it is also the one
    at which the median curvature is the wanted one.

    Parameters
    ----------
    specimens : Specimens
        New specimens.
    degradation : float or array, shape (n_draws,)
        Of all, or of the specimens of each draw [%].
    wanted : float
        Curvature, above 0 [1/m].
    risk : float
        Largest probability of rupture that is accepted, between 0 and 1 [–].
    first : float
        The largest pressure tried first [kPa].
    allowed : Allowed, optional
        Result of `largest_allowed` for the same specimens, degradation rate and risk.

    Raises
    ------
    ValueError
        If the wanted curvature or the first pressure is not above 0, or the risk not between 0
        and 1.
    """
    if not (wanted > 0.0 and first > 0.0 and 0.0 < risk < 1.0):
        raise ValueError("curvature and pressure must be above 0, the risk between 0 and 1")
    if allowed is None:
        allowed = largest_allowed(specimens, degradation, risk, first=first)
    each = needed_by(specimens, degradation, wanted, first=first)
    needed = np.quantile(each, INTERVAL, method="inverted_cdf")
    reached = bool(needed[1] <= allowed.pressure)
    pressure = float(needed[1]) if reached else allowed.pressure
    if pressure == 0.0:
        nothing = np.full(len(QUANTILES), np.nan)
        asked = (float(np.median(degradation)), wanted, risk)
        return Setting(*asked, np.nan, False, needed, allowed, nothing, nothing[:3])
    response = respond(specimens, degradation, np.array([pressure]))
    curvature = np.nan_to_num(response.curvature[:, 0], nan=np.inf, posinf=np.inf)
    return Setting(
        degradation=float(np.median(degradation)),
        wanted=wanted,
        risk=risk,
        pressure=pressure,
        reached=reached,
        needed=needed,
        allowed=allowed,
        curvature=np.quantile(curvature, QUANTILES, method="inverted_cdf"),
        probability=_probability(specimens, degradation, pressure),
    )


def _probability(specimens: Specimens, degradation: float | Floats, pressure: float) -> Floats:
    """Return the probability of rupture with its 90 % interval over the posterior."""
    if not has_elongation(specimens.model.base):
        return np.full(3, np.nan)
    at = np.array([pressure])
    mean = float(respond(specimens, degradation, at).burst.mean())
    # the probability of one draw needs more of its specimens than the mean over all draws
    each = respond(finer(specimens, FINER_STRATA), degradation, at).burst
    return np.array([mean, *np.quantile(each, [0.05, 0.95])])
