r"""Outlying specimens and readings of a study.

A laboratory mishap affects one specimen, one picture or one day, while a physical cause acts on all
specimens tested in the same way. So every common fault of readings is a direction d in the
readings, and everything that all specimens may have in common is left free: the parameters within
their priors, and smooth functions of path, degradation rate, history and time. With z and
:math:`w` the readings and the direction on the scale on which all of that, specimen scatter and
errors are white,

.. math:: y = f + X \beta + d\,\phi + e,\qquad t = w^T z / |w|, \qquad
          \hat\phi = w^T z / |w|^2 ,

t is the deletion residual of the linear model: the departure of a specimen from its prediction by
the others. A mishap that takes part in the calibration widens scatter and errors, which hides it.
So possible mishaps are removed first, with a loose threshold on scores divided by their median
size; the model is calibrated without them; reading errors, which any common misfit makes wide and
correlated, and scatter are estimated with everything common left free; and the removed data are
judged by these, with Student's law for a scatter known from few specimens, films among them, and a
threshold such that one sound study in 100 has a suspect. This is repeated until only suspects, or
possible ones, are left out, since scatter seems too small without the oddest sound specimens.

Sources: Cook and Weisberg (1982), Residuals and Influence in Regression, chapter 2, for the mean
shift model and deletion residuals; Hadi and Simonoff (1993), doi:10.1080/01621459.1993.10476407,
for the search outwards from a sound part of the data.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from bayesdeg.criticism.checks.discrepancy import discrepancy_roots
from bayesdeg.criticism.fit.linear import Whitening, jacobian_of
from bayesdeg.data.levels import levels
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import ACTUATOR, ANGLE, CURVATURE, Curvature
from bayesdeg.observations.kinds import Labels, Places
from bayesdeg.observations.specimens import STIFFNESS_SCATTER
from bayesdeg.observations.tensile import Tensile

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEVEL = 0.01
"""Probability that a study without a mishap has a suspect, over all hypotheses together."""
DOUBTFUL = 0.1
"""The same probability for exclusion from the calibration used for judging: with one mishap left
in, errors seem wide enough to hide the next."""
BEYOND_DOUBT = 0.001
"""Largest p-value of what is set aside; other suspects are only reported. If one study in 20 has a
mishap, at most one study in 50 that loses data is then sound."""
LEAST_CHANGE = 0.05
"""Least change, over the largest of the readings, of what is set aside: creep in two cycles, of
which common effects are only an approximation, looked like a jump of 0.019."""
APART = 2.0
"""Least distance of a specimen that is set aside from the nearest of its replicates, over the range
of these: below 1 where misread degradation rates made one rate scatter."""
LOOSE = np.array([3.0, 3.0, 2.0, 4.5, 2.0])
"""Scores, over their median size, above which whole responses, other errors of specimens, groups,
readings and the edge of the picture are left out at first: chance gives one every few studies,
which costs a second."""
NARROWER = 0.4
"""Initial factor on the calibrated specimen scatter: the wider it is, the more of a specimen's
departure is attributed to what all have in common. Median sizes of scores compensate for it."""
MOST_SPECIMENS, MOST_READINGS = 1 / 3, 1 / 4
"""Largest shares that are left out: what most specimens do is not a mishap."""
LEAST_SCALE = 0.3
"""Floor of the median size of scores: errors were calibrated to at most three times their size."""
COMMON = 0.5
"""Relative size of what all specimens tested in the same way may have in common: beyond any known
common effect."""
COMMON_SHAPES = (
    "the path, slowly, drifting with degradation",
    "the path, for each history of load",
)
TIME_CONSTANTS = (10.0, 100.0, 1000.0)  # s, time scales of processes while an actuator is held
FEWEST = 4
"""Fewest specimens of a family for judging one by the others."""
FEWEST_OF_SORT = 5
"""Fewest hypotheses of one sort for estimating the width of their scores by the median."""
NORMAL_MEDIAN = 0.6745
EDGES = np.array([0.96, 0.98, 1.0])
"""Edges of the picture relative to the largest curvature read: beyond the edge readings scatter
about it by the tracing errors."""
ROUNDS = 5  # calibrations without the suspects so far: mostly two agree
SMALL = 1e-9
SPLITS = 10_000  # sets of sizes without groups, for the chance of two groups
SMALLEST_GROUP = 3  # specimens; fewer are reported one by one
STATED_DOF = 10
"""Weight of the reading errors in the scatter of curvature over bend angle, besides that scatter
itself: lengths of specimens may differ by more than their reading errors."""
LOOSE_GROUPS = 0.05  # chance of a group that is left out at first


class Anomaly(StrEnum):
    """Ways in which readings can be odd."""

    RESPONSE = "response"
    OFFSET = "offset"
    CURVATURE = "curvature"
    ANGLE = "angle"
    JUMP = "jump"
    CUT_OFF = "cut off"
    EDGE = "edge"
    READING = "reading"
    BATCH = "batch"
    DAY = "day"


GROUPS = 2
_PART = {
    Anomaly.RESPONSE: 0,
    Anomaly.OFFSET: 1,
    Anomaly.CURVATURE: 1,
    Anomaly.ANGLE: 1,
    Anomaly.BATCH: GROUPS,
    Anomaly.DAY: GROUPS,
    Anomaly.EDGE: 4,
    Anomaly.JUMP: 3,
    Anomaly.CUT_OFF: 3,
    Anomaly.READING: 3,
}
"""Place of each in `SHARES` and `LOOSE`; up to groups they concern whole specimens."""

OF_RESPONSE = (Anomaly.RESPONSE, Anomaly.OFFSET)


@dataclass(frozen=True)
class Irregularity:
    """One hypothesis of how some readings may be wrong.

    Parameters
    ----------
    oddity : Anomaly
        In which way.
    specimens : tuple of str
        Whose.
    kind : str
        What was read; empty if all of it.
    rows : array of bool, shape (n,)
        Readings that are not to be trusted if it is right.
    direction : array, shape (n,)
        Change of the readings by a size of 1: of ln response, a relative error, or what the
        readings are given in.
    at : float
        Where on the path it begins, or stands; nan of whole specimens.
    """

    oddity: Anomaly
    specimens: tuple[str, ...]
    kind: str
    rows: Flags
    direction: Floats
    at: float = float("nan")

    @property
    def is_of_specimen(self) -> bool:
        """Whether it concerns whole specimens, whose number limits how well scatter is known."""
        return _PART[self.oddity] <= GROUPS


@dataclass(frozen=True)
class Suspect:
    """Outlying readings.

    With the hypothesis that they are most like and its size; the score is in standard deviations of
    what the others predict, the p-value the probability of one as large by chance, times the number
    of hypotheses.
    """

    hypothesis: Irregularity
    size: float
    score: float
    p_value: float

    def is_beyond_doubt(self, subject: JointModel, vector: Floats) -> bool:
        """Return whether a study can be judged without these readings of a model.

        Neither chance nor an error of the emulator, or of common effects that are taken as linear,
        may be as large, and a specimen must differ from its replicates too: if a cause moves
        degradation rates to where stiffness is steep, all of a rate scatter more than elsewhere.

        Parameters
        ----------
        subject : JointModel
            With all readings.
        vector : array, shape (n_parameters,)
            Its mode.
        """
        way, kinds = self.hypothesis, subject.places.kind
        of_kinds = [way.rows & (kinds == kind) for kind in np.unique(kinds[way.rows])]
        change = max(
            float(np.abs(self.size * way.direction[rows]).max())
            / max(float(np.abs(subject.observed[rows]).max()), SMALL)
            for rows in of_kinds
        )
        if not (self.p_value < BEYOND_DOUBT and change > LEAST_CHANGE):
            return False
        return way.oddity not in OF_RESPONSE or _is_apart(subject, vector, way)


Refit = Callable[[Sequence[Suspect]], Floats | None]
"""The mode of a calibration without suspects, on the scale of the whole model, if any."""


# ---- hypotheses


def hypotheses(
    subject: JointModel, vector: Floats, batches: Iterable[tuple[str, ...]] = ()
) -> tuple[Irregularity, ...]:
    """Return the hypotheses of wrong readings of a model at a vector, (n_parameters,).

    Batches are specimens that have something in common beside their degradation rate.
    """
    places, batches = subject.places, tuple(batches)
    prediction = subject.expected(vector[None])[0]
    response = subject.deviations(vector).slope.sum(axis=1)
    found: list[Irregularity] = []
    for family in dict.fromkeys(places.family.tolist()):
        rows = places.family == family
        names = list(dict.fromkeys(places.specimen[rows].tolist()))
        for name in names:
            own = rows & (places.specimen == name)
            found.append(
                Irregularity(Anomaly.RESPONSE, (name,), "", own, np.where(own, response, 0.0))
            )
            if ACTUATOR in places.family[own]:
                found += _of_actuator(places, own, name, response, prediction)
            found += _pictures(places, own, name, prediction)
        found += _of_edge(subject, rows, prediction)
        rates = _levels(places, rows)
        of_rates = [
            one
            for one in _of_groups(places, rows, [*rates, *batches], Anomaly.BATCH, response)
            if one.specimens in batches or not _is_end(places, one)
        ]
        found += of_rates
        # Wrong lengths of a batch or a round, if bend angles were read too. Replicates with the
        # same number in the order of tests form a round, often of one day.
        if np.any(rows & (places.kind == ANGLE)):
            ordered = [sorted(one, key=names.index) for one in rates]
            longest = max(map(len, ordered), default=0)
            rounds = [tuple(one[k] for one in ordered if k < len(one)) for k in range(longest)]
            curved = rows & (places.kind == CURVATURE)
            found += _of_groups(places, curved, [*batches, *rounds], Anomaly.DAY, prediction)
    return tuple(one for one in found if np.any(one.direction != 0.0))


def _of_actuator(
    places: Places, own: Flags, name: str, response: Floats, prediction: Floats
) -> Iterator[Irregularity]:
    shifted = response / np.maximum(np.abs(places.along), SMALL)
    yield Irregularity(Anomaly.OFFSET, (name,), "", own, np.where(own, shifted, 0.0))
    kinds = list(dict.fromkeys(places.kind[own].tolist()))
    named = {CURVATURE: Anomaly.CURVATURE, ANGLE: Anomaly.ANGLE}
    for kind in kinds if len(kinds) > 1 else ():
        one = own & (places.kind == kind)
        if kind in named:
            direction = np.where(one, prediction, 0.0)
            yield Irregularity(named[kind], (name,), kind, one, direction)
    yield from _jumps(places, own, name, prediction)
    # the path cut off at each of its readings
    curved = own & (places.kind == CURVATURE)
    order = np.flatnonzero(curved)
    top = order[np.argmax(prediction[order])] if len(order) else 0
    for place in order[1:]:
        beyond = curved & (prediction > prediction[place])
        if place != top and beyond.sum() > 1:
            lost = np.where(beyond, prediction[place] - prediction, 0.0)
            at = float(places.along[beyond].min())
            yield Irregularity(Anomaly.CUT_OFF, (name,), CURVATURE, beyond, lost, at)


def _jumps(places: Places, own: Flags, name: str, prediction: Floats) -> Iterator[Irregularity]:
    """Yield a jump before each reading of a path, as large as the largest of its kind."""
    order = np.flatnonzero(own & (places.kind == CURVATURE))
    unit = np.ones(len(places))
    for kind in (CURVATURE, ANGLE):
        read = own & (places.kind == kind)
        unit[read] = np.abs(prediction[read]).max(initial=0.0)
    step = np.full(len(places), -1)  # index of each reading along the path, by kind
    for kind in dict.fromkeys(places.kind[own].tolist()):
        rows = own & (places.kind == kind)
        step[rows] = np.arange(rows.sum())
    for place in range(2, len(order) - 1):
        after = own & (step >= step[order[place]])
        at = float(places.along[order[place]])
        yield Irregularity(Anomaly.JUMP, (name,), "", after, np.where(after, unit, 0.0), at)


def _of_edge(subject: JointModel, rows: Flags, prediction: Floats) -> Iterator[Irregularity]:
    """Yield curvatures beyond which no specimen was seen: the edge of the picture."""
    places = subject.places
    curved = rows & (places.kind == CURVATURE)
    if not curved.any():
        return
    top = float(subject.observed[curved].max())
    for edge in EDGES * top:
        beyond = curved & (prediction > edge)
        names = tuple(dict.fromkeys(places.specimen[beyond].tolist()))
        if beyond.sum() > 1 and len(names) > 1:
            lost = np.where(beyond, edge - prediction, 0.0)
            yield Irregularity(Anomaly.EDGE, names, CURVATURE, beyond, lost, float(edge))


def _pictures(places: Places, own: Flags, name: str, prediction: Floats) -> Iterator[Irregularity]:
    """Yield single readings, and all readings from one picture."""
    pictures: dict[tuple[float, str, float | None], list[int]] = {}
    for i in np.flatnonzero(own):
        time = float(places.time[i])
        key = (float(places.along[i]), str(places.history[i]), None if np.isnan(time) else time)
        pictures.setdefault(key, []).append(int(i))
    for (at, *_), taken in pictures.items():
        rows = np.zeros(len(places), dtype=bool)
        rows[taken] = True
        if len(taken) > 1 and len(set(places.kind[own].tolist())) > 1:
            whole = np.where(rows, prediction, 0.0)
            yield Irregularity(Anomaly.READING, (name,), "", rows, whole, at)
        for one in taken:
            alone = np.zeros(len(places))
            alone[one] = float(prediction[one]) or 1.0
            yield Irregularity(Anomaly.READING, (name,), str(places.kind[one]), rows, alone, at)


def _levels(places: Places, rows: Flags) -> list[tuple[str, ...]]:
    """Return the specimens of each degradation rate, if there are several rates."""
    names, first = np.unique(places.specimen[rows], return_index=True)
    member = levels(places.level[rows][first])[1]
    if member.max(initial=0) < 2:
        return []
    return [tuple(names[member == k].tolist()) for k in range(member.max() + 1)]


def _of_groups(
    places: Places,
    rows: Flags,
    groups: Iterable[tuple[str, ...]],
    oddity: Anomaly,
    direction: Floats,
) -> Iterator[Irregularity]:
    """Yield groups of several, but not all, of the specimens with these readings."""
    kind = CURVATURE if oddity is Anomaly.DAY else ""
    for group in dict.fromkeys(groups):
        own = rows & np.isin(places.specimen, group)
        if len(np.unique(places.specimen[own])) > 1 and not np.array_equal(own, rows):
            yield Irregularity(oddity, group, kind, own, np.where(own, direction, 0.0))


# ---- scores


@dataclass(frozen=True)
class Scored:
    """Readings and hypotheses on the scale on which everything but mishaps is white.

    z (n,), and w (n, m), one column a hypothesis.
    """

    observed: Floats
    columns: Floats

    @property
    def norms(self) -> Floats:
        """|w|, (m,)."""
        return np.linalg.norm(self.columns, axis=0)

    def without(self, direction: Floats) -> "Scored":
        """Return the same with the size of one whitened direction free, (n,)."""
        length = float(np.linalg.norm(direction))
        if not length > SMALL:
            return self
        unit = direction / length
        return Scored(
            self.observed - unit * (unit @ self.observed),
            self.columns - np.outer(unit, unit @ self.columns),
        )

    def scores(self, whole: Floats) -> Floats:
        """Return t of each hypothesis, (m,); 0 for one spanned by the free ones.

        `whole` (m,) is |w| before anything was made free.
        """
        norms = self.norms
        seen = norms > 1e-3 * np.maximum(whole, SMALL)
        found: Floats = np.where(seen, self.columns.T @ self.observed, 0.0)
        return found / np.where(seen, norms, 1.0)


@dataclass(frozen=True)
class ReadingParts:
    """Components of the readings near a point, with common effects of specimens free.

    Parameters
    ----------
    residual : array, shape (n,)
        Readings less their mean.
    shared : array, shape (n, r)
        Directions that all specimens have in common, of the size that they may have.
    specimens, errors : array, shape (n, n)
        Covariances of specimens' deviations, and of errors of reading.
    family : array of str, shape (n,)
        Of which readings each is.
    stated : array, shape (n, n), optional
        Covariance of what the tables state an error of, degradation rates above all: no misfit
        can have widened it.
    """

    residual: Floats
    shared: Floats
    specimens: Floats
    errors: Floats
    family: Labels
    stated: Floats | float = 0.0

    @property
    def is_finite(self) -> bool:
        """Whether the model can be evaluated there."""
        parts = (self.residual, self.shared, self.specimens, self.errors)
        return all(bool(np.all(np.isfinite(part))) for part in parts)

    def whitening(self, scatter: float, error: Floats) -> Whitening:
        """Return the whitening of readings, with deviations and errors scaled by factors.

        Factors are of the standard deviations: one of specimens, and those of the errors of each
        reading, (n,).
        """
        return Whitening.of(self.covariance(scatter, error), self.shared)

    def covariance(self, scatter: float, error: Floats) -> Floats:
        """Return the covariance of what is not shared, scaled as by `whitening`, (n, n)."""
        scaled = scatter**2 * self.specimens + np.outer(error, error) * self.errors
        return scaled + self.stated

    def log_density(self, scatter: float, error: Floats) -> float:
        """Return the log density of the readings, up to a constant."""
        scaled = self.covariance(scatter, error)
        if not np.all(np.isfinite(scaled)):
            return -np.inf
        lower = np.linalg.cholesky(scaled)
        both = np.column_stack([self.residual, self.shared])
        found: Floats = solve_triangular(lower, both, lower=True)
        white, shared = found[:, 0], found[:, 1:]
        # of I + A Aᵀ, with the columns A, by the smaller I + AᵀA
        root = np.linalg.cholesky(np.eye(shared.shape[1]) + shared.T @ shared)
        along = solve_triangular(root, shared.T @ white, lower=True)
        spread = float(np.sum(np.log(np.diag(lower))) + np.sum(np.log(np.diag(root))))
        return -0.5 * float(white @ white - along @ along) - spread

    def without(self, rows: Flags) -> "ReadingParts":
        """Return the same without some of the readings, (n,)."""
        kept = ~rows
        both = np.ix_(kept, kept)
        return ReadingParts(
            self.residual[kept],
            self.shared[kept],
            self.specimens[both],
            self.errors[both],
            self.family[kept],
            self.stated if isinstance(self.stated, float) else self.stated[both],
        )

    def widths(self, beside: Floats | float = 0.0) -> "Widths":
        """Return the most probable widths of deviations and errors.

        A misfit widens both in the calibration; here the common directions absorb it. As these are
        integrated out, this is the restricted likelihood of variance components
        (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545).

        `beside` (n_factors,) is the log density of what else is known of the scatter of specimens,
        at each of `FACTORS`.
        """
        error = np.ones(len(self.residual))
        scatter, dof = 1.0, 1.0
        found, of_errors = dict[str, float](), dict[str, float]()
        for _ in range(SWEEPS):
            density = np.array([self.log_density(factor, error) for factor in FACTORS])
            scatter, dof = _peak(density + beside)
            for family in dict.fromkeys(self.family.tolist()):
                own = self.family == family
                tried = [np.where(own, factor, error) for factor in FACTORS]
                density = np.array([self.log_density(scatter, e) for e in tried])
                found[family], of_errors[family] = _peak(density)
                error = np.where(own, found[family], error)
        return Widths(scatter, dof, found, of_errors)


@dataclass(frozen=True)
class Widths:
    """Widths of specimen deviations and reading errors, relative to the calibrated ones.

    Parameters
    ----------
    scatter : float
        Of specimens' deviations.
    dof : float
        From how many degrees of freedom that is known: of a variance from ν normal deviations the
        log density in ln of the standard deviation bends by −2ν at its top.
    errors : mapping of str to float
        Of the errors of reading, by family.
    error_dof : mapping of str to float
        From how many degrees of freedom those are known.
    """

    scatter: float
    dof: float
    errors: Mapping[str, float]
    error_dof: Mapping[str, float]


FACTORS = np.geomspace(0.25, 1.25, 6)
"""Tried factors on calibrated standard deviations: a misfit may widen them severalfold."""
SWEEPS = 2  # over scatter and errors, each given the others


def _peak(values: Floats) -> tuple[float, float]:
    """Return the factor at the top of the parabola through the largest value, and its dof."""
    best = int(np.clip(np.argmax(values), 1, len(values) - 2))
    low, top, high = values[best - 1 : best + 2]
    bend = float(low - 2.0 * top + high)
    shift = 0.5 * (low - high) / bend if bend < 0.0 else float(np.sign(high - low))
    step = float(np.log(FACTORS[1] / FACTORS[0]))
    ratio = float(np.exp(step * np.clip(shift, -1.0, 1.0)))
    # −ν (ln f + f̂²/2f²) bends by −2ν f̂²/f², and f is that of the values, not of the top
    return float(FACTORS[best] * ratio), max(1.0, -0.5 * bend / step**2 / ratio**2)


def film_density(subject: JointModel, vector: Floats, left_out: Iterable[str]) -> Floats:
    """Return the log density of films for a scaled scatter of stiffness, at each of `FACTORS`.

    Films and actuators of a study have the same scatter in its model.
    """
    values = subject.table.named(np.repeat(vector[None], len(FACTORS), axis=0))
    name = STIFFNESS_SCATTER.name
    if name not in values:
        return np.zeros(len(FACTORS))
    state = subject.state(dict(values) | {name: values[name] * FACTORS})
    total, out = np.zeros(len(FACTORS)), list(left_out)
    for films in subject.of_kind(Tensile):
        density = films.log_likelihood(state)[:, ~np.isin(films.labels, out)]
        total += density.sum(axis=1)
    return total if np.all(np.isfinite(total)) else np.zeros(len(FACTORS))


def parts_of(subject: JointModel, vector: Floats) -> ReadingParts:
    """Return the components of the readings of a model, linearised at a vector (n_parameters,)."""
    places, slopes = subject.places, jacobian_of(subject, vector) * _prior_widths(subject)
    prediction = subject.expected(vector[None])[0]
    roots = discrepancy_roots(places, prediction)
    common = [root for _, label, root in roots if label in COMMON_SHAPES]
    if np.isfinite(places.time).any():
        time = np.nan_to_num(places.time)
        for constant in TIME_CONSTANTS:
            gone = np.log1p(time / constant)
            column = prediction * gone / max(float(gone.max()), SMALL)
            drifting = column * places.level / max(places.level.max(), 1.0)
            common.append(np.stack([column, drifting], axis=1))
    deviations = subject.deviations(vector)
    # the variance of specimen deviations without the scatter of stiffness
    values, alone = dict(subject.table.named(vector[None])), np.zeros_like(deviations.spread)
    if STIFFNESS_SCATTER.name in values:
        alike = values | {STIFFNESS_SCATTER.name: np.array([SMALL])}
        alone = subject.deviations(np.asarray(subject.table.vectors(alike))[0]).spread
    known = np.minimum(alone, deviations.spread)
    stated, specimens = (
        (deviations.slope * part) @ deviations.slope.T
        for part in (known, deviations.spread - known)
    )
    residual: Floats = subject.observed - prediction
    for one in subject.of_kind(Curvature):
        rows = np.isin(places.kind, (CURVATURE, ANGLE)) & (places.family == ACTUATOR)
        linearised = one.linearised(subject.state(subject.table.named(vector[None])))
        residual[rows] = linearised.residual[0][one.tests.paths.mask]
    return ReadingParts(
        residual,
        np.hstack([slopes, *(COMMON * root for root in common)]),
        specimens,
        subject.scatter(vector) - specimens - stated,
        places.family,
        stated,
    )


def scored(
    parts: ReadingParts,
    known: Sequence[Irregularity],
    scatter: float = 1.0,
    errors: Mapping[str, float] | None = None,
) -> Scored:
    """Return readings and hypotheses with common effects of specimens free.

    Deviations of specimens and, by family, errors of reading are scaled by factors.
    """
    error = np.array([(errors or {}).get(one, 1.0) for one in parts.family.tolist()])
    whitening = parts.whitening(scatter, error)
    directions = np.stack([one.direction for one in known], axis=1)
    return Scored(whitening.whitened(parts.residual), whitening.whitened(directions))


def _prior_widths(subject: JointModel) -> Floats:
    """Return the prior width of each parameter on the sampler's scale, (n_parameters,)."""
    ends = np.array([0.1587, 0.8413])
    found = []
    for parameter in subject.table.parameters:
        low, high = parameter.law.to_unconstrained(parameter.law.quantile(ends))
        width = 0.5 * float(high - low)
        found.append(width if np.isfinite(width) else 1.0)
    return np.array(found)


# ---- the search


@dataclass(frozen=True)
class Pool:
    """Hypotheses of one study, and the calibration of their scores.

    Parameters
    ----------
    known : tuple of Irregularity
        All of them.
    family : array of str, shape (m,)
        Of which readings each is.
    specimens : array of int, shape (m,)
        Number of specimens of that family.
    dof : array, shape (m,)
        Degrees of freedom from which it is known how wide each score is.
    """

    known: tuple[Irregularity, ...]
    family: NDArray[np.str_]
    specimens: NDArray[np.int64]
    dof: Floats

    @cached_property
    def part(self) -> NDArray[np.int64]:
        """Place of each in `SHARES` and `LOOSE`, (m,)."""
        return np.array([_PART[one.oddity] for one in self.known])

    def scales(self, scores: Floats) -> Floats:
        """Return the median score size of each sort of hypotheses, over that of a normal law.

        A batch scatters as its specimens do.
        """
        sort = np.array([f"{one.oddity} {one.kind}" for one in self.known])
        found = np.ones(len(scores))
        for family in np.unique(self.family):
            for name in np.unique(sort):
                rows = (self.family == family) & (sort == name)
                if rows.sum() >= FEWEST_OF_SORT:
                    found[rows] = np.median(np.abs(scores[rows])) / NORMAL_MEDIAN
            batch = (self.family == family) & (sort == f"{Anomaly.BATCH} ")
            single = (self.family == family) & (sort == f"{Anomaly.RESPONSE} ")
            found[batch] = found[single][0] if single.any() else 1.0
        return np.maximum(found, LEAST_SCALE)

    def p_values(self, scores: Floats) -> Floats:
        """Return p of each score, times the hypotheses of its part over its `SHARES`."""
        chance = 2.0 * stats.t.sf(np.abs(scores), self.dof)
        count = np.bincount(self.part, minlength=len(SHARES))[self.part]
        found: Floats = np.minimum(1.0, count * chance / SHARES[self.part])
        return np.where(self.specimens >= FEWEST, found, 1.0)


SINGLE_FIRST = 1.5
"""Factor by which a group must be odder than its oddest specimen, since one of three drags its
group along."""
SHARES = np.array([0.4, 0.15, 0.25, 0.15, 0.05])
"""Shares of the level for responses, other errors of specimens, groups, readings and the edge of
the picture: larger if common mishaps are close to the scatter that hides them."""
READING_DOF = 60
"""Degrees of freedom of reading errors: readings on all paths, less what a path has in common."""


def pool_of(
    subject: JointModel, known: tuple[Irregularity, ...], dof: Floats | float = READING_DOF
) -> Pool:
    """Return hypotheses with the families of their readings, and the accuracy of scores."""
    places = subject.places
    family = np.array([str(places.family[np.argmax(one.rows)]) for one in known])
    count = {
        name: len(np.unique(places.specimen[places.family == name])) for name in np.unique(family)
    }
    every = np.broadcast_to(np.float64(dof), len(known))
    return Pool(known, family, np.array([count[name] for name in family]), every)


def find_suspects(
    subject: JointModel,
    mode: Floats,
    refit: Refit,
    batches: Iterable[tuple[str, ...]] = (),
) -> tuple[Suspect, ...]:
    """Return the outlying specimens and readings, the oddest first.

    `mode` is that of the calibration with all readings; batches are specimens that have something
    in common beside their degradation rate.
    """
    batches = tuple(batches)
    left_out, found = _loose(subject, mode, batches), tuple[Suspect, ...]()
    for _ in range(ROUNDS):
        vector = refit(left_out) if left_out else None
        if vector is None:
            return ()
        out_before, before = left_out, found
        left_out = _strict(subject, vector, batches, left_out)
        found = tuple(one for one in left_out if one.p_value < LEVEL)
        if {_key(one) for one in left_out} == {_key(one) for one in out_before}:
            return found
    known = [one.hypothesis for one in before]  # suspects that come and go are in doubt
    return tuple(one for one in found if _is_among(one.hypothesis, known))


def _is_among(one: Irregularity, others: Iterable[Irregularity]) -> bool:
    """Return whether a hypothesis matches one of others, for most of the readings of either."""
    return any(
        other.oddity is one.oddity
        and 2 * np.sum(one.rows & other.rows) > min(np.sum(one.rows), np.sum(other.rows))
        for other in others
    )


def _is_apart(subject: JointModel, vector: Floats, one: Irregularity) -> bool:
    """Return whether a specimen differs from its replicates by more than these from each other."""
    places, prediction = subject.places, subject.expected(vector[None])[0]
    own = np.isin(places.specimen, one.specimens)
    member = levels(places.level)[1]
    alike = (member == member[one.rows][0]) & (places.family == places.family[one.rows][0])
    ratio = np.log(np.maximum(subject.observed, SMALL) / np.maximum(np.abs(prediction), SMALL))
    others = [
        float(np.median(ratio[alike & (places.specimen == name)]))
        for name in np.unique(places.specimen[alike & ~own])
    ]
    if len(others) < 2:
        return True
    distance = float(np.min(np.abs(np.array(others) - np.median(ratio[own]))))
    return distance > APART * float(np.ptp(others))


def _is_end(places: Places, one: Irregularity) -> bool:
    """Return whether a group is all specimens below or above a degradation rate.

    They are only extrapolated to, and a cause may act on them alone.
    """
    family = places.family == places.family[np.argmax(one.rows)]
    own = family & np.isin(places.specimen, one.specimens)
    inside, outside = places.level[own], places.level[family & ~own]
    return bool(inside.max() < outside.min() or outside.max() < inside.min())


def _key(suspect: Suspect) -> tuple[str, bytes]:
    return suspect.hypothesis.oddity, suspect.hypothesis.rows.tobytes()


def _posed(
    subject: JointModel,
    vector: Floats,
    batches: tuple[tuple[str, ...], ...],
    left_out: Sequence[Suspect] = (),
) -> tuple[Pool, Scored] | None:
    """Return the hypotheses and their scores, with those of groups that the scores suggest.

    If the data to leave out are known, scatter and errors are those of the other readings.
    """
    chance = LEVEL * SHARES[GROUPS] if left_out else LOOSE_GROUPS
    if left_out:
        vector = _with_own_errors(subject, vector, left_out)
    parts = parts_of(subject, vector)
    known = hypotheses(subject, vector, batches)
    if not known or not parts.is_finite:
        return None
    widths = Widths(NARROWER, READING_DOF, {}, {})
    if left_out:
        out = np.any([one.hypothesis.rows for one in left_out], axis=0)
        names = {name for one in left_out for name in one.hypothesis.specimens}
        widths = parts.without(out).widths(film_density(subject, vector, names))
    now = scored(parts, known, widths.scatter, widths.errors)
    # with groups that the scores suggest, without days that they do not
    free = Scored(now.observed, _with_free_response(known, now))
    days = np.array([one.oddity is Anomaly.DAY for one in known])
    kept = np.flatnonzero(~_unclear_days(known, free, chance))
    told = [known[k] for k in kept if days[k]]
    groups = [
        (one, column)
        for one, column in _two_groups(pool_of(subject, known), free, chance)
        if not _is_among(one, told) and not _is_end(subject.places, one)
    ]
    columns = np.where(days, free.columns, now.columns)[:, kept]
    columns = np.column_stack([columns, *(column for _, column in groups)])
    known = (*(known[k] for k in kept), *(one for one, _ in groups))
    now = Scored(now.observed, columns)
    return pool_of(subject, known, _dof(parts, known, now, widths)), now


def _with_own_errors(subject: JointModel, vector: Floats, left_out: Sequence[Suspect]) -> Floats:
    """Return a point with the reading errors that remain after common effects of actuators.

    A common misfit makes calibrated errors not only wide but also correlated along a path and
    between curvature and bend angle. All their parameters are found by restricted likelihood, with
    normal priors, and mean and specimen scatter unchanged.
    """
    rows = subject.places.family == ACTUATOR
    at, free = subject.scatter(vector), np.zeros(len(vector), dtype=bool)
    for k in np.flatnonzero(~np.any(jacobian_of(subject, vector), axis=0)):
        moved = vector.copy()
        moved[k] += STEP
        own = subject.table.parameters[k].name != STIFFNESS_SCATTER.name
        free[k] = own and np.any((subject.scatter(moved) - at)[np.ix_(rows, rows)])
    if not free.any() or not rows.any():
        return vector
    out = np.any([one.hypothesis.rows for one in left_out], axis=0) & rows
    parts = parts_of(subject, vector)
    if not parts.is_finite:
        return vector
    rest = parts.without(out | ~rows)
    kept = np.ix_(rows & ~out, rows & ~out)
    beside = (at - parts.errors)[kept]
    medians = np.array(
        [float(p.law.to_unconstrained(p.law.quantile(0.5))) for p in subject.table.parameters]
    )[free]
    widths, ones = _prior_widths(subject)[free], np.ones(int(kept[0].size))

    def minus_log_density(own: Floats) -> float:
        there = vector.copy()
        there[free] = own
        errors = subject.scatter(there)[kept] - beside
        density = replace(rest, errors=errors).log_density(1.0, ones)
        density -= 0.5 * float(np.sum(((own - medians) / widths) ** 2))
        return -density if np.isfinite(density) else UNLIKELY

    found = minimize(
        minus_log_density,
        vector[free],
        method="L-BFGS-B",
        options={"maxiter": STEPS, "eps": STEP},
    )
    there = vector.copy()
    there[free] = found.x
    return there


STEPS, STEP, UNLIKELY = 10, 1e-3, 1e12
"""Tolerance of the search for reading errors: a hundredth of a unit of log density."""


def _dof(parts: ReadingParts, known: Sequence[Irregularity], now: Scored, widths: Widths) -> Floats:
    r"""Return the degrees of freedom of the width of each score, (m,).

    A share s of the variance of a size, 1/|w|², comes from specimen scatter, known with ν degrees
    of freedom, and the rest from reading errors, known with more. The rule is that of Satterthwaite
    (1946), doi:10.2307/3002019: :math:`1/(s^2/\nu + (1 - s)^2/\nu_e)`.
    """
    wider = scored(parts, known, WIDER * widths.scatter, widths.errors)
    grown = np.log(np.maximum(now.norms, SMALL) / np.maximum(wider.norms, SMALL))
    share = np.clip(grown / np.log(WIDER), 0.0, 1.0)
    family = parts.family[[int(np.argmax(one.rows)) for one in known]].tolist()
    errors = np.array([widths.error_dof.get(one, READING_DOF) for one in family])
    found: Floats = 1.0 / (share**2 / widths.dof + (1.0 - share) ** 2 / errors)
    return found


WIDER = 1.1  # scatter of specimens, for the share of a variance that comes from it


def _with_free_response(known: Sequence[Irregularity], now: Scored) -> Floats:
    """Return whitened directions, of lengths with the response of every specimen free, (n, m).

    Lengths affect curvature over bend angle, which does not depend on stiffness and is known to
    within the reading errors, whatever the specimen scatter.
    """
    responses = [k for k, one in enumerate(known) if one.oddity is Anomaly.RESPONSE]
    lengths = [k for k, one in enumerate(known) if one.oddity in (Anomaly.CURVATURE, Anomaly.DAY)]
    found = now.columns.copy()
    if lengths:
        basis = np.linalg.qr(now.columns[:, responses])[0]
        found[:, lengths] -= basis @ (basis.T @ found[:, lengths])
    return found


def _unclear_days(known: Sequence[Irregularity], free: Scored, chance: float) -> Flags:
    """Return a mask of day hypotheses within the scatter of specimen lengths, (m,)."""
    members = np.array([k for k, one in enumerate(known) if one.oddity is Anomaly.CURVATURE], int)
    names = [known[k].specimens[0] for k in members]
    days = [k for k, one in enumerate(known) if one.oddity is Anomaly.DAY]
    found = np.zeros(len(known), dtype=bool)
    dof = STATED_DOF + len(members) - 2
    for k in days:
        own = np.isin(names, known[k].specimens)
        t = t_between(*_sizes(free, members), own) if 0 < own.sum() < len(own) else 0.0
        found[k] = abs(t) < stats.t.isf(0.5 * chance / len(days), dof)
    return found


def _two_groups(pool: Pool, now: Scored, chance: float) -> Iterator[tuple[Irregularity, Floats]]:
    r"""Yield hypotheses that specimens fall into two groups, each with its whitened direction.

    The sizes :math:`\hat\phi_k` of single specimens in order, the statistic is the largest t of the
    means of a first and a last part, of at least `SMALLEST_GROUP` each; its law without groups is
    that of equal normal sizes. It needs no scale of the scatter, which two groups widen.
    """
    for oddity, group in ((Anomaly.CURVATURE, Anomaly.DAY), (Anomaly.RESPONSE, Anomaly.BATCH)):
        same = np.array([one.oddity is oddity for one in pool.known])
        for family in np.unique(pool.family):
            members = np.flatnonzero(same & (pool.family == family))
            if len(members) < 2 * SMALLEST_GROUP:
                continue
            sizes, norms = _sizes(now, members)
            statistic, part = largest_t(sizes[None], norms)
            generator = np.random.default_rng(len(norms))
            null_sizes = generator.standard_normal((SPLITS, len(norms))) / norms
            if statistic[0] <= float(np.quantile(largest_t(null_sizes, norms)[0], 1.0 - chance)):
                continue
            order = np.argsort(sizes)
            few = members[min(order[part[0] :], order[: part[0]], key=len)]
            ways = [pool.known[k] for k in few]
            names = tuple(one.specimens[0] for one in ways)
            rows = np.any([one.rows for one in ways], axis=0)
            direction = np.sum([one.direction for one in ways], axis=0)
            together = Irregularity(group, names, ways[0].kind, rows, direction)
            yield together, now.columns[:, few].sum(1)


def _sizes(now: Scored, members: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return sizes of single hypotheses, and one over their standard errors, (m,) each."""
    norms = np.maximum(now.norms[members], SMALL)
    return (now.columns[:, members].T @ now.observed) / norms**2, norms


def t_between(sizes: Floats, weights: Floats, own: Flags) -> float:
    """Return t of the means of some sizes and of the others, (k,) each.

    Their scatter is pooled with the stated one, at `STATED_DOF` degrees of freedom.
    """
    parts = [(sizes[part], weights[part] ** 2) for part in (own, ~own)]
    means = [float(np.average(size, weights=square)) for size, square in parts]
    within = sum(
        float(square @ (size - mean) ** 2)
        for (size, square), mean in zip(parts, means, strict=True)
    )
    scale = (STATED_DOF + within) / (STATED_DOF + len(sizes) - 2)
    variance = scale * sum(1.0 / float(square.sum()) for _, square in parts)
    return (means[0] - means[1]) / float(np.sqrt(variance))


def largest_t(sizes: Floats, weights: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return the largest t of two groups of ordered sizes (n, k), and where the second begins.

    Errors of the k sizes are in proportion to one over their weights (k,), whatever the scale of
    these.

    Examples
    --------
    >>> t, part = largest_t(np.array([[0.1, 5.0, 0.0, 5.2, 5.1, -0.1]]), np.ones(6))
    >>> t.round(1).tolist(), part.tolist()
    ([62.5], [3])
    """
    order = np.argsort(sizes, axis=1)
    values = np.take_along_axis(sizes, order, axis=1)
    square = weights[order] ** 2
    count = sizes.shape[1]
    sums = [np.cumsum(square * values**power, axis=1) for power in range(3)]
    first = slice(SMALLEST_GROUP - 1, count - SMALLEST_GROUP)
    low = [one[:, first] for one in sums]
    high = [one[:, -1:] - one[:, first] for one in sums]
    within = sum(two - one**2 / zero for zero, one, two in (low, high))
    spread = np.sqrt(np.maximum(within, 1e-300) / (count - 2) * (1.0 / low[0] + 1.0 / high[0]))
    t = (high[1] / high[0] - low[1] / low[0]) / spread
    best = np.argmax(t, axis=1)
    return np.take_along_axis(t, best[:, None], axis=1)[:, 0], best + SMALLEST_GROUP


def _loose(
    subject: JointModel, vector: Floats, batches: tuple[tuple[str, ...], ...]
) -> tuple[Suspect, ...]:
    """Return possible mishaps by scores over their median size."""
    posed = _posed(subject, vector, batches)
    if posed is None:
        return ()
    pool, now = posed
    threshold = LOOSE[pool.part]
    scale = pool.scales(now.scores(now.norms))

    def excess(scores: Floats) -> Floats:
        size = np.abs(scores) / scale
        return np.where((size > threshold) & (pool.specimens >= FEWEST), size / threshold, 0.0)

    places, found = subject.places, []
    for suspect in _pursued(subject, pool, now, excess):
        one = suspect.hypothesis
        # the kind of mishap is decided only once the scatter is known without the whole specimen
        if one.oddity in (Anomaly.JUMP, Anomaly.CUT_OFF):
            family = places.family == places.family[np.argmax(one.rows)]
            rows = family & np.isin(places.specimen, one.specimens)
            one = replace(one, oddity=Anomaly.RESPONSE, rows=rows)
        found.append(replace(suspect, hypothesis=one))
    return tuple(found)


def _strict(
    subject: JointModel,
    vector: Floats,
    batches: tuple[tuple[str, ...], ...],
    left_out: Sequence[Suspect],
) -> tuple[Suspect, ...]:
    """Return possible mishaps by a calibration without them."""
    posed = _posed(subject, vector, batches, left_out)
    if posed is None:
        return ()
    pool, now = posed

    def excess(scores: Floats) -> Floats:
        chance = pool.p_values(scores)
        size = np.abs(scores)
        size = np.where(pool.part == GROUPS, size / SINGLE_FIRST, size)
        return np.where(chance < DOUBTFUL, size, 0.0)

    return _not_drawn_along(_confirmed(pool, now, _pursued(subject, pool, now, excess)))


def _not_drawn_along(found: tuple[Suspect, ...]) -> tuple[Suspect, ...]:
    """Return suspects without batches in which a single specimen is odd.

    Whether the rest of the batch is also odd is decided once it takes part in the calibration.
    """
    ways = [one.hypothesis for one in found]
    alone = {way.specimens[0] for way in ways if way.is_of_specimen and len(way.specimens) == 1}
    return tuple(
        one
        for one in found
        if one.hypothesis.oddity is not Anomaly.BATCH or not alone & set(one.hypothesis.specimens)
    )


def _pursued(
    subject: JointModel, pool: Pool, now: Scored, excess: Callable[[Floats], Floats]
) -> tuple[Suspect, ...]:
    """Take the oddest hypothesis, make its size free, and so on, until none is odd."""
    whole, places = now.norms, subject.places
    found: list[Suspect] = []
    left = np.zeros(len(places), dtype=bool)
    while len(found) < MOST_READINGS * len(places):
        # data already left out need no further explanation
        explained = np.array([bool(np.all(left[one.rows])) for one in pool.known])
        # no more specimens of a family than allowed
        out = {
            name
            for one in found
            if one.hypothesis.is_of_specimen
            for name in one.hypothesis.specimens
        }
        most = np.maximum(1, np.floor(MOST_SPECIMENS * pool.specimens))
        with_it = np.array(
            [len(out | set(one.specimens)) if one.is_of_specimen else 0 for one in pool.known]
        )
        closed = explained | np.asarray(with_it > most)
        odd = np.where(closed, 0.0, excess(now.scores(whole)))
        best = int(np.argmax(odd))
        if not odd[best] > 0.0:
            break
        one = pool.known[best]
        found.append(_suspect(pool, now, whole, best))
        if one.is_of_specimen or one.oddity is Anomaly.READING:
            left |= one.rows
        now = now.without(now.columns[:, best])
    return tuple(found)


def _suspect(pool: Pool, now: Scored, whole: Floats, best: int) -> Suspect:
    scores = now.scores(whole)
    size = float(scores[best]) / max(float(now.norms[best]), SMALL)
    chance = float(pool.p_values(scores)[best])
    return Suspect(pool.known[best], size, float(scores[best]), chance)


def _confirmed(pool: Pool, now: Scored, found: tuple[Suspect, ...]) -> tuple[Suspect, ...]:
    """Return suspects that remain with all others free, with their sizes then."""
    index = {id(way): k for k, way in enumerate(pool.known)}
    kept = list(found)
    while kept:
        judged = []
        for one in kept:
            free = now
            for other in kept:
                if other is not one:
                    free = free.without(free.columns[:, index[id(other.hypothesis)]])
            judged.append(_suspect(pool, free, now.norms, index[id(one.hypothesis)]))
        worst = max(range(len(judged)), key=lambda i: judged[i].p_value)
        if judged[worst].p_value < DOUBTFUL:
            return tuple(sorted(judged, key=lambda one: -abs(one.score)))
        del kept[worst]
    return ()
