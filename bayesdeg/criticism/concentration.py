r"""Whether a misfit sits in one branch, cycle or hold, or in few specimens: by simulation.

Each group of readings is given a scale and a trend along the path of its own, directions W on the
whitened scale. What it gains in log-likelihood at the best sizes,

.. math:: g = \tfrac12 |Q^T z|^2, \qquad Q \text{ orthonormal, of the span of } W,

is set against the misfit statistic, which is a log-likelihood ratio too, and against what the best
of all groups gains in data simulated from the model. Degradation rates, mounts, modes of tension
and all readings together compete: where one of these is better, no group is told of.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.linear import Linear
from bayesdeg.criticism.model_readings import ACTUATOR
from bayesdeg.criticism.residuals import levels
from bayesdeg.criticism.statistics_of_residuals import regression
from bayesdeg.criticism.subject import Places

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

BRANCH, CYCLE, HOLD, SPECIMEN, OTHER = "branch", "cycle", "hold", "specimen", ""
RARE = 0.02  # p-value up to which more than chance sits in a group
MOST = 0.5  # share of the misfit statistic from which it dominates
MORE = 1.25  # of its share of the readings, which it must exceed by this factor
FEW, FEW_OF_ALL = 3, 0.25  # specimens that are still a few


@dataclass(frozen=True)
class Concentration:
    """Where most of a misfit sits.

    Parameters
    ----------
    kind : str
        ``branch``, ``cycle``, ``hold`` or ``specimen``.
    members : tuple of str
        ``unloading``; ``cycle 2`` or ``cycles after the first``; ``readings after a hold``; or the
        names of specimens.
    excess : tuple of float
        By how much of the simulated each lies above the other readings, as far as that differs
        from the simulation [%].
    share : float
        Of the misfit statistic.
    readings : float
        Share of the readings.
    p_value : float
        Share of simulated data in which the best of all groups gains as much, (1 + #)/(1 + n).
    """

    kind: str
    members: tuple[str, ...]
    excess: tuple[float, ...]
    share: float
    readings: float
    p_value: float


@dataclass(frozen=True)
class _Group:
    kind: str
    name: str
    rows: Flags


def concentration(linear: Linear, simulated: Floats, statistic: float) -> Concentration | None:
    """Return the branch, cycle, hold or few specimens in which most of a misfit sits, if any.

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    simulated : array, shape (k, n)
        Data sets simulated from it; without any nothing is told.
    statistic : float
        Its misfit statistic [nats].
    """
    groups = list(_groups(linear.subject.places))
    if not groups or not len(simulated):
        return None
    data = np.vstack([linear.observed, linear.whiten(simulated)])
    gains = np.stack([_gain(linear, (group,), data) for group in groups])
    chance = gains[:, 1:].max(axis=0)
    p_values = (1 + np.sum(chance >= gains[:, :1], axis=1)) / (1 + len(chance))
    best = int(np.argmax(gains[:, 0]))
    chosen = _chosen(groups, gains[:, 0], p_values, best)
    if not chosen or p_values[best] > RARE:
        return None
    gain = float(_gain(linear, chosen, data[:1])[0])
    share = gain / max(statistic, gain)
    family = np.any([group.rows for group in groups], axis=0)
    readings = float(np.sum(np.any([group.rows for group in chosen], axis=0)) / np.sum(family))
    if share < max(MOST, MORE * readings):
        return None
    excess = tuple(_excess(linear, group, family) for group in chosen)
    names = tuple(group.name for group in chosen)
    return Concentration(chosen[0].kind, names, excess, share, readings, float(p_values[best]))


def with_concentration(sentence: str, found: Concentration | None) -> str:
    """Add to the sentence that says where a misfit sits in what most of it does.

    Examples
    --------
    >>> found = Concentration("branch", ("unloading",), (4.2,), 0.8, 0.5, 0.004)
    >>> with_concentration("Curvature is low.", found)
    'Curvature is low; most of the misfit (80 %, in 50 % of the readings) sits in the unloading \
branch, 4 % above the rest relative to the simulation.'
    """
    if found is None:
        return sentence
    shares = f"{100 * found.share:.0f} %, in {100 * found.readings:.0f} % of the readings"
    return f"{sentence.removesuffix('.')}; most of the misfit ({shares}) sits in {_place(found)}."


def _place(found: Concentration) -> str:
    off = [f"{abs(e):.0f} % {'above' if e > 0.0 else 'below'}" for e in found.excess]
    relative = "the rest relative to the simulation"
    if found.kind == SPECIMEN and len(found.members) > 1:
        each = [f"{name} ({size})" for name, size in zip(found.members, off, strict=True)]
        return f"specimens {', '.join(each[:-1])} and {each[-1]}, against {relative}"
    [name] = found.members
    named = {BRANCH: f"the {name} branch", SPECIMEN: f"specimen {name}"}
    return f"{named.get(found.kind, name)}, {off[0]} {relative}"


def _chosen(groups: list[_Group], gains: Floats, p_values: Floats, best: int) -> tuple[_Group, ...]:
    """Return the best group, with other specimens that stand out as it does; none if many do."""
    if groups[best].kind != SPECIMEN:
        return (groups[best],) if groups[best].kind else ()
    all_of_them = [i for i, group in enumerate(groups) if group.kind == SPECIMEN]
    out = sorted((i for i in all_of_them if p_values[i] <= RARE), key=lambda i: -gains[i])
    few = min(FEW, int(FEW_OF_ALL * len(all_of_them)))
    return tuple(groups[i] for i in out) if len(out) <= few else ()


def _groups(places: Places) -> Iterator[_Group]:
    of_actuators = bool(np.any(places.family == ACTUATOR))
    family = places.family == ACTUATOR if of_actuators else np.ones(len(places), bool)
    yield _Group(OTHER, "all", family)
    specimens, first = np.unique(places.specimen[family], return_index=True)
    rates, member = levels(places.level[family][first])
    for k in np.flatnonzero(np.bincount(member) > 1) if len(rates) > 1 else ():
        yield _Group(OTHER, "level", family & np.isin(places.specimen, specimens[member == k]))
    for name in specimens if len(specimens) >= 1 / FEW_OF_ALL else ():
        yield _Group(SPECIMEN, str(name), family & (places.specimen == name))
    if of_actuators:
        yield from _histories(places, family)
    else:
        for mode in np.unique(places.history[family]):
            yield _Group(OTHER, "mode", family & (places.history == mode))


def _histories(places: Places, family: Flags) -> Iterator[_Group]:
    """Yield branches, cycles, held readings and mounts: those that are not all readings."""
    split = np.full((len(family), 3), "", dtype=np.array(places.history).dtype)
    split[family] = [history.split() for history in places.history[family]]
    branch, cycle, mount = split.T
    found = [_Group(BRANCH, "unloading", branch == "unloading")]
    later = [str(c) for c in np.unique(cycle[family]) if c != "1"]
    found += [_Group(CYCLE, f"cycle {name}", cycle == name) for name in later]
    if len(later) > 1:
        found.append(_Group(CYCLE, "cycles after the first", family & (cycle != "1")))
    found.append(_Group(HOLD, "readings after a hold", family & _held(places)))
    found += [_Group(OTHER, "mount", mount == name) for name in np.unique(mount[family])]
    yield from (one for one in found if 0 < np.sum(one.rows) < np.sum(family))


def _held(places: Places) -> Flags:
    """Return which readings were taken at the pressure of the one before on the same path."""
    keys = np.stack([places.specimen, places.kind, places.history])
    same = np.all(keys[:, 1:] == keys[:, :-1], axis=0) & (np.diff(places.along) == 0.0)
    return np.append(False, same)


def _gain(linear: Linear, groups: tuple[_Group, ...], data: Floats) -> Floats:
    """Return what whitened data sets (k, n) gain by a scale and a trend of each group, (k,)."""
    places, columns = linear.subject.places, []
    for group in groups:
        size = np.where(group.rows, linear.prediction, 0.0)
        middle = float(np.mean(places.along[group.rows]))
        columns += [size, size * (places.along - middle) / max(float(np.ptp(places.along)), 1e-12)]
    whitened = linear.whiten_columns(np.column_stack(columns))
    vectors, values, _ = np.linalg.svd(whitened, full_matrices=False)
    basis = vectors[:, values > 1e-6 * values[0]]
    gain: Floats = 0.5 * np.sum((data @ basis) ** 2, axis=1)
    return gain


def _excess(linear: Linear, group: _Group, family: Flags) -> float:
    size = np.where(family, linear.prediction, 0.0)
    projection = regression(linear, 0.01 * size * group.rows, size)
    return 0.0 if projection is None else float(linear.observed @ projection[:, 0])
