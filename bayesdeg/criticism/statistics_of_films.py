"""Statistics of films in tension, and of readings of any other kind."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.linear import Linear
from bayesdeg.criticism.model_readings import ACTUATOR, FILM
from bayesdeg.criticism.statistics_of_residuals import (
    Statistic,
    between_specimens,
    regression,
)

Floats = NDArray[np.float64]

PERCENT = 0.01


def film_statistics(linear: Linear) -> tuple[Statistic, ...]:
    """Return the statistics of films in tension; none where there are none."""
    places = linear.subject.places
    rows = places.family == FILM
    if not rows.any():
        return ()
    size = np.where(rows, linear.prediction, 0.0)
    stretch = np.where(rows, places.along - 1.0, 0.0)
    trend = Statistic(
        "trend of the films' residual with stretch",
        "% per unit of stretch",
        "stresses rise faster with stretch than simulated: as with Cauchy stress recorded as "
        "nominal, or with a law that stiffens too late",
        "stresses rise slower with stretch than simulated: as with nominal stress recorded as "
        "Cauchy, or with damage while stretching",
        regression(linear, PERCENT * size * stretch, size),
        "needs films at several stretches",
    )
    return (*_modes(linear, size), trend, _scatter(linear, size))


def other_statistics(linear: Linear) -> tuple[Statistic, ...]:
    """Return statistics of readings that are neither actuators' nor films'."""
    families = dict.fromkeys(linear.subject.places.family.tolist())
    found: list[Statistic] = []
    for family in families:
        if family not in (ACTUATOR, FILM):
            found += _of_family(linear, family)
    return tuple(found)


def _modes(linear: Linear, size: Floats) -> list[Statistic]:
    """Return the mean excess of stress in each mode of tension over the first."""
    places = linear.subject.places
    modes = list(dict.fromkeys(places.history[size != 0.0].tolist()))
    if len(modes) == 1:
        why = "needs a second mode of tension: column mode of tensile.csv"
        return [Statistic("difference between modes of tension", "MPa", "", "", None, why)]
    first = "uniaxial" if "uniaxial" in modes else modes[0]
    rest = [mode for mode in modes if mode != first]
    scaled = {mode: _of_mean_one(size, places.history == mode) for mode in rest}
    return [
        Statistic(
            f"{mode} against {first} tension",
            "MPa",
            f"stress in {mode} tension is higher than {first} curves lead to expect: as with "
            "a law that depends on the second invariant",
            f"stress in {mode} tension is lower than {first} curves lead to expect: as with "
            "a law that depends on the second invariant",
            regression(
                linear, scaled[mode], size, *(scaled[other] for other in rest if other != mode)
            ),
            "the modes differ as the films do",
        )
        for mode in rest
    ]


def _of_mean_one(size: Floats, rows: NDArray[np.bool_]) -> Floats:
    own = np.where(rows, size, 0.0)
    return np.asarray(own / np.mean(np.abs(size[rows & (size != 0.0)])))


def _scatter(linear: Linear, size: Floats) -> Statistic:
    return Statistic(
        "variance between films, over the model's",
        "–",
        "films of one degradation rate differ more than the model allows: as with misread "
        "thickness or degradation rates",
        "films of one degradation rate differ less than the model allows: its scatter of "
        "stiffness is too large for them",
        between_specimens(linear, size, alike=linear.subject.places.history),
        "needs several films at one degradation rate",
        neutral=1.0,
        squares=True,
    )


def _of_family(linear: Linear, family: str) -> list[Statistic]:
    places = linear.subject.places
    rows = places.family == family
    size = np.where(rows, linear.prediction, 0.0)
    found = [
        _trend(linear, size, values, family=family, along=along)
        for along, values in (
            ("the path", places.along),
            ("the level", places.level),
            ("time", places.time),
        )
    ]
    scatter = Statistic(
        f"variance between specimens, over the model's ({family})",
        "–",
        "specimens of one level differ more than the model allows",
        "specimens of one level differ less than the model allows",
        between_specimens(linear, size),
        "needs several specimens at one level",
        neutral=1.0,
        squares=True,
    )
    return [*found, scatter]


def _trend(linear: Linear, size: Floats, values: Floats, *, family: str, along: str) -> Statistic:
    """Return the relative residual's change from the smallest to the largest of these values."""
    rows = (size != 0.0) & np.isfinite(values)
    extent = float(np.ptp(values[rows])) if rows.any() else 0.0
    projection = None
    if extent > 0.0:
        share = np.where(rows, values - np.min(values[rows]), 0.0) / extent
        projection = regression(linear, PERCENT * size * share, size, size * rows)
    return Statistic(
        f"trend of the residual with {along} ({family})",
        "% over all",
        f"readings exceed the prediction more and more with {along}",
        f"readings fall short of the prediction more and more with {along}",
        projection,
        f"needs readings at several values of {along}",
    )
