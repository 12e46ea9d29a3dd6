"""Search for the set of causes that the data support.

A cause is added while the log Bayes factor of the best addition exceeds what chance alone gives in
5 % of data sets simulated from the current model. That greedy path may fail, since one cause may
look like two others together. So all pairs and triples are also ranked on one linear scale, with
the scatter of the current model (`fit.screening`); the close ones are fitted, and one of them
replaces the current set if it is better, or if it is larger and its gain exceeds chance. Each
cause is exchanged for a rival while that is better. In the final set, every cause must earn its
place against the set without it, and is compared with all possible replacements.
"""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.chance import chance_of, is_clear
from bayesdeg.criticism.checks.discrepancy import Misfit, complete_sets, measure, resolved
from bayesdeg.criticism.fit.linear import Linear, is_seen, log_bayes_factor, sensitivities
from bayesdeg.criticism.fit.screening import JointScreening, Screened, largest_by_chance, screen
from bayesdeg.criticism.fit.side_by_side import apply, in_order
from bayesdeg.criticism.fit.trials import (
    DECIDING,
    SETTLING,
    CandidateFit,
    from_prior,
    settled,
    try_causes,
)
from bayesdeg.criticism.outcome import LEFT_LEVEL

Floats = NDArray[np.float64]

CLOSE = 10.0  # deficit in screened log Bayes factor up to which a full fit is worthwhile
NEAR_SHARE = 0.75  # or share of the best: screening is rough for strong effects


@dataclass(frozen=True)
class Step:
    """Tests of a model with a set of active causes.

    Parameters
    ----------
    trial : CandidateFit
        The fitted model.
    misfit : Misfit
        What it leaves unexplained.
    simulated : array, shape (k, n_readings)
        Data sets simulated from its posterior, those refused left out.
    screened : mapping
        Every other cause at its most probable size, by name.
    threshold : float
        Log Bayes factor that naming one more takes.
    unbent : mapping
        The causes screened where no parameter has given way to the misfit, see
        `CandidateFit.unbent`; empty if none has.
    chance : array, shape (k,)
        Log Bayes factor of the best of all other causes in each of the simulated data sets, which
        hold no further effect: what `threshold` comes from [nats]. Empty if there are none.
    """

    trial: CandidateFit
    misfit: Misfit
    simulated: Floats
    screened: dict[str, Screened]
    threshold: float
    unbent: dict[str, Screened] = field(default_factory=dict)
    chance: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def false_name_rate(self) -> float | None:
        """Share of data without a further effect in which the best cause passes the threshold.

        At least one in the number simulated; None if none were. It is below 5 % if odds of 20
        require more than chance gives.
        """
        if not len(self.chance):
            return None
        return max(float(np.mean(self.chance > self.threshold)), 1.0 / (1 + len(self.chance)))

    @property
    def least_threshold(self) -> float:
        """Lower limit of the threshold that more data sets may give [nats].

        Two standard errors of a share of 5 % below it: with 200 data sets, the value that 8 %
        reach.
        """
        if not len(self.chance):
            return self.threshold
        error = float(np.sqrt(FALSE_NAME_RATE * (1.0 - FALSE_NAME_RATE) / len(self.chance)))
        lower = np.quantile(self.chance, max(1.0 - FALSE_NAME_RATE - 2.0 * error, 0.0))
        return min(self.threshold, max(LEAST_FACTOR, float(lower)))

    def chance_of(self, log_bayes_factor: float) -> float | None:
        """Return the p-value of the best cause's gain [nats] if nothing acts, (1 + #)/(1 + k).

        None if no data were simulated.
        """
        if not len(self.chance):
            return None
        return float(chance_of(log_bayes_factor, self.chance))

    def guess(self, name: str) -> tuple[Cause, Floats]:
        """Return a cause with the size at which a full fit begins."""
        plain, straight = self.screened[name], self.unbent.get(name)
        if straight is not None and straight.log_bayes_factor > plain.log_bayes_factor:
            return straight.cause, straight.size
        return plain.cause, plain.size


def near(screened: dict[str, Screened], least: float) -> list[str]:
    """Return the causes that screening puts near the best, the best first."""
    factors = {name: one.log_bayes_factor for name, one in screened.items()}
    best = max(factors.values(), default=-np.inf)
    least = max(min(best - CLOSE, NEAR_SHARE * best), least)
    return sorted((n for n in factors if factors[n] >= least), key=lambda n: -factors[n])


Names = frozenset[str]

FALSE_NAME_RATE = 0.05
LEAST_FACTOR = float(np.log(20.0))
NEXT_TO = 1.0
"""Distance of a gain from the threshold within which Monte Carlo error may decide [nats]: for one
cause it was 2.65 and 2.97 with two seeds, from evidences each 0.1 to 0.5 too low with stated
errors of 0.04 to 0.1; 16,000 draws gave 2.8 to 3.0."""
MARGIN = 2.0  # by how much screening may underestimate a cause that a full fit would name
MOST_CAUSES = 3
ROUNDS = 3  # rounds of exchanging and growing; each begins with a better set, so few are needed
FEW = 400  # draws for screening causes that act only on rupture


@dataclass(frozen=True)
class SearchEffort:
    """Limits of the search.

    Parameters
    ----------
    replicates : int
        Data sets simulated to calibrate misfit and naming.
    fitted : int
        Causes that are fitted fully at each step.
    pairs : int
        Pairs and triples, of those that screening ranks best, that are fitted fully at a time.
    levels_out : bool
        Whether whole levels of degradation are held out too.
    most : int
        Data sets up to which misfit and naming are calibrated where a p-value is near the level
        that decides.
    """

    replicates: int
    fitted: int
    pairs: int
    levels_out: bool = False
    most: int = 0


@dataclass
class Search:
    """The state of the search: fitted sets of causes, and tests of some.

    Parameters
    ----------
    base : CandidateFit
        Without a cause.
    causes : tuple of Cause
        All that may be named.
    effort : SearchEffort
        What it may cost.
    seed : SeedSequence
        A child for every set, whatever the order in which sets are tried.
    executor : Executor, optional
        Fits side by side.
    on_fit : callable, optional
        Called with the names of each set that was fitted.
    """

    base: CandidateFit
    causes: tuple[Cause, ...]
    effort: SearchEffort
    seed: np.random.SeedSequence
    executor: Executor | None = None
    on_fit: Callable[[str], None] | None = None
    trials: dict[Names, CandidateFit] = field(default_factory=dict)
    steps: dict[Names, Step] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.trials[self.base.names] = self.base

    def factor(self, names: Names) -> float:
        """Return the log Bayes factor of a fitted set against the base model."""
        return self.trials[names].log_evidence - self.base.log_evidence

    def step(self, names: Names) -> Step:
        """Return the tests of a fitted set."""
        if names in self.steps:
            return self.steps[names]
        plain = self.unscreened(names)
        trial, linear, known = plain.trial, plain.trial.linear, plain.simulated
        others = [cause for cause in self.causes if cause.name not in names]
        jobs = [(c, self._seed(names | {c.name}, 2)) for c in others]
        found = apply(partial(_screened, trial), jobs, self.executor)
        screened = {cause.name: one for cause, one in zip(others, found, strict=True)}
        chance = factors_by_chance(linear, others, known)
        unbent: dict[str, Screened] = {}
        straight = trial.unbent()
        if straight is not None:
            judged = [cause for cause in others if not cause.is_of_rupture_alone]
            found = apply(partial(screen, straight), judged, self.executor)
            unbent = {cause.name: one for cause, one in zip(judged, found, strict=True)}
        threshold = naming_threshold(chance)
        self.steps[names] = replace(
            plain, screened=screened, threshold=threshold, unbent=unbent, chance=chance
        )
        return self.steps[names]

    def unscreened(self, names: Names) -> Step:
        """Return the misfit of a fitted set; further causes are screened only if they were."""
        if names in self.steps:
            return self.steps[names]
        trial, linear = self.trials[names], self.trials[names].linear
        simulate = partial(_simulated, trial, np.random.default_rng(self._seed(names, 1)))
        simulated = simulate(self.effort.replicates)
        misfit = resolved(measure(linear, simulated), linear, simulate, most=self.effort.most)
        return Step(trial, misfit, complete_sets(simulated), {}, LEAST_FACTOR)

    def passes(self, names: Names, larger: Names) -> bool:
        """Return whether a larger set gains enough beyond a fitted set for naming.

        More data sets are simulated until it is clear whether chance gives as much in 5 % of them,
        and evidence is estimated again if the gain is close to the threshold.
        """
        step = self.step(names)
        gain = self.factor(larger) - self.factor(names)
        if abs(gain - step.threshold) < NEXT_TO:
            self.settle([names, larger], DECIDING)
            gain = self.factor(larger) - self.factor(names)
        while gain >= LEAST_FACTOR and not is_clear(gain, step.chance, FALSE_NAME_RATE):
            count = len(step.chance)
            generator = np.random.default_rng(self._seed(names, 3 + count))
            more = max(min(count, self.effort.most - count), 0)
            known = complete_sets(_simulated(step.trial, generator, more))
            others = [cause for cause in self.causes if cause.name not in names]
            gains = factors_by_chance(step.trial.linear, others, known)
            if not len(gains):
                break
            chance = np.append(step.chance, gains)
            step = replace(step, chance=chance, threshold=naming_threshold(chance))
        self.steps[names] = step
        return gain >= step.threshold

    def left(self, names: Names) -> Step:
        """Return the misfit of a favoured set or a rival, from enough replicates.

        More data sets are simulated until the p-value of the misfit is clearly on one side of
        `LEFT_LEVEL`.
        """
        step = self.unscreened(names)
        generator = np.random.default_rng(self._seed(names, 5))
        simulate = partial(_simulated, step.trial, generator)
        misfit = resolved(
            step.misfit, step.trial.linear, simulate, most=self.effort.most, level=LEFT_LEVEL
        )
        step = replace(step, misfit=misfit)
        if names in self.steps:
            self.steps[names] = step
        return step

    def fit(self, parent: Names, additions: Iterable[str]) -> list[Names]:
        """Fit a set with each of several causes added, in parallel; return the larger sets."""
        step, wanted = self.step(parent), list(additions)
        missing = [name for name in wanted if parent | {name} not in self.trials]
        jobs = [(*step.guess(name), self._seed(parent | {name})) for name in missing]
        fitted = in_order(partial(_fitted, step.trial), jobs, self.executor)
        for name, trial in zip(missing, fitted, strict=True):
            self.trials[parent | {name}] = trial
            if self.on_fit is not None:
                self.on_fit(" and ".join(sorted(parent | {name})))
        return [parent | {name} for name in wanted]

    def fit_sets(self, guesses: Mapping[Names, Mapping[str, Floats]]) -> None:
        """Fit sets starting from their largest fitted subset, without those in between.

        The guesses are the sizes at which the fit of each cause of a set begins; by default those
        that screening found for each alone.
        """
        own = {cause.name: cause for cause in self.causes}
        missing = [names for names in guesses if names not in self.trials]
        ways: list[_Way] = []
        for names in missing:
            parts = [known for known in self.trials if known < names]
            known = max(parts, key=lambda part: (len(part), self.factor(part)))
            jobs, reached = [], known
            for name in sorted(names - known):
                reached = reached | {name}
                size = guesses[names].get(name)
                if size is None:
                    size = self.step(self.base.names).guess(name)[1]
                jobs.append((own[name], size, self._seed(reached)))
            ways.append((self.trials[known], jobs))
        fitted = in_order(_fitted_in_turn, ways, self.executor)
        for names, trials in zip(missing, fitted, strict=True):
            for trial in trials:
                self.trials.setdefault(trial.names, trial)
            if self.on_fit is not None:
                self.on_fit(" and ".join(sorted(names)))

    def settle(self, sets: Iterable[Names], draws: int = SETTLING) -> None:
        """Estimate the evidence of fitted sets from this many draws, once, see `trials.settled`."""
        for names in sets:
            if self.trials[names].settled_by < draws:
                generator = np.random.default_rng(self._seed(names, 4))
                self.trials[names] = settled(self.trials[names], generator, draws)
        self.base = self.trials[self.base.names]

    def leaders(self, names: Names) -> list[str]:
        """Return the additions that deserve a full fit: those that screening puts near the best."""
        step = self.step(names)
        least = step.least_threshold - MARGIN
        leading = [
            *near(step.screened, least)[: self.effort.fitted],
            *near(step.unbent, least)[: self.effort.fitted],
        ]
        return list(dict.fromkeys(leading))

    def fit_leaders(self, names: Names) -> list[Names]:
        """Fit a set with each addition that deserves it; return the larger sets.

        Screening is rough, and only a limited number of its best are fitted: while it puts a
        further cause above all of these, that one is fitted too.
        """
        step, sets = self.step(names), self.fit(names, self.leaders(names))
        while sets:
            gains = (self.factor(one) - self.factor(names) for one in sets)
            least = max(step.least_threshold - MARGIN, *gains)
            fitted = frozenset().union(*sets)
            left = {n: one.log_bayes_factor for n, one in step.screened.items() if n not in fitted}
            overlooked = sorted((n for n in left if left[n] > least), key=lambda n: -left[n])
            if not overlooked:
                break
            sets += self.fit(names, overlooked[: self.effort.fitted])
        return sets

    def _seed(self, names: Names, use: int = 0) -> np.random.SeedSequence:
        known = [cause.name for cause in self.causes]
        key = (use, *sorted(known.index(name) for name in names))
        return np.random.SeedSequence(self.seed.entropy, spawn_key=(*self.seed.spawn_key, *key))


ENOUGH, ROUNDS = 0.5, 12
"""Share of the data sets asked for that must be complete, and at most so many times as many drawn:
near ballooning nine of ten were lost."""


def _simulated(trial: CandidateFit, generator: np.random.Generator, count: int) -> Floats:
    """Return data sets simulated from a fitted model, at least (count, n_readings).

    Where its draws leave the range of the forward map, in which the real specimens were, others
    take their place, until `ENOUGH` of the count are complete or clearly will not be.
    """
    found, complete = list[Floats](), 0
    for done in range(1, ROUNDS + 1):
        draws = _as_refitted(trial.linear, trial.draws(generator, count))
        simulated = trial.subject.simulated(draws, generator)
        found.append(trial.linear.straightened(draws, simulated))
        complete += len(complete_sets(found[-1]))
        if complete >= ENOUGH * count or complete * ROUNDS < ENOUGH * count * done:
            break
    return np.concatenate(found)


def _as_refitted(linear: Linear, draws: Floats) -> Floats:
    """Return draws with parameters that do not move the mean fixed at the mode, (k, n_parameters).

    The errors of data simulated at a draw would be re-estimated from them, and the statistics use
    estimated errors.
    """
    moves = is_seen(linear.whiten_columns(linear.jacobian))
    return np.where(moves, draws, linear.mode)


def factors_by_chance(linear: Linear, causes: Iterable[Cause], replicates: Floats) -> Floats:
    """Return the largest log Bayes factor of all causes in each data set without an effect, (k,).

    In nats, of the data sets (k, n_readings); empty where there is no cause or no data set.
    """
    whitened = linear.whiten(replicates)
    factors = [log_bayes_factor(whitened, sensitivities(linear, cause)) for cause in causes]
    if not factors or not len(replicates):
        return np.zeros(0)
    return np.asarray(np.max(factors, axis=0))


def naming_threshold(chance: Floats) -> float:
    """Return the log Bayes factor required for naming, at least ln 20 [nats].

    Chance reaches it in 5 % of data sets.

    `chance` (k,) is what the best cause reaches without an effect, as of `factors_by_chance`.
    """
    if not len(chance):
        return LEAST_FACTOR
    return max(LEAST_FACTOR, float(np.quantile(chance, 1.0 - FALSE_NAME_RATE)))


def run_search(search: Search) -> Names:
    """Return the set of causes that the data support: none, one or several."""
    chosen = _pruned(search, _added(search, search.base.names))
    for _ in range(ROUNDS):
        better = _exchanged(search, _elsewhere(search, chosen))
        if better == chosen:
            break
        grown = _pruned(search, _added(search, better))
        begun = chosen == search.base.names and len(grown) > 1
        if begun and not _passes_at_once(search, chosen, grown):
            break
        chosen = grown
    return chosen


def rivals(search: Search, chosen: Names, cause: str) -> dict[str, float]:
    """Return replacements of one cause of a set, with log Bayes factors.

    These are the causes that screening puts near the best, up to the limit of the effort; beyond
    it, look-alikes from the catalogue; causes already fitted; and those that no reading tells from
    one of these within odds of 20. The factors are those of the whole set relative to the base
    model.
    """
    rest = chosen - {cause}
    ensure(search, rest)
    larger = [names for names in search.trials if names > rest and len(names) == len(chosen)]
    fitted = sorted(name for names in larger for name in names - rest)
    own = search.trials[chosen].cause(cause)
    # look-alikes that screening, which cannot judge twins, does not put far behind
    step = search.step(rest)
    close = {*near(step.screened, -np.inf), *near(step.unbent, -np.inf), *own.twins}
    named = dict.fromkeys([*own.twins, *own.confusable_with])
    alike = [name for name in named if name in close and name in step.screened]
    leading = dict.fromkeys([*search.leaders(rest), *alike, *fitted])
    found = _factors_of(search, rest, [name for name in leading if name not in chosen])
    least = search.factor(chosen) - LEAST_FACTOR
    as_good = [c for c in search.causes if found.get(c.name, -np.inf) > least]
    twins = dict.fromkeys(twin for c in as_good for twin in c.twins if twin not in found)
    able = [name for name in twins if name not in chosen and name in search.step(rest).screened]
    return found | _factors_of(search, rest, able)


def _factors_of(search: Search, rest: Names, added: list[str]) -> dict[str, float]:
    """Return log Bayes factors of a set with each of several causes added, by cause."""
    sets = search.fit(rest, added)
    return dict(zip(added, (search.factor(names) for names in sets), strict=True))


def _added(search: Search, names: Names) -> Names:
    """Add causes one after another while the best passes the threshold."""
    while len(names) < MOST_CAUSES:
        sets = search.fit_leaders(names)
        if not sets:
            return names
        best = max(sets, key=search.factor)
        if not search.passes(names, best):
            return names
        names = best
    return names


def _elsewhere(search: Search, chosen: Names) -> Names:
    """Return the best of a set and of close sets not reached by one addition or exchange.

    A set of the same size need only be better; a larger one must gain enough for naming.
    """
    reached = in_reach(search, chosen)
    search.fit_sets({one.names: one.sizes for one in reached})
    same = [names for names in search.trials if len(names) == len(chosen)]
    best = max(same, key=search.factor)
    larger = [one.names for one in reached if len(one.names) > len(chosen)]
    passing = [names for names in larger if _passes_at_once(search, best, names)]
    penalty = set_penalties(len(search.causes))
    return max([best, *passing], key=lambda n: search.factor(n) - penalty[len(n)])


def _passes_at_once(search: Search, names: Names, larger: Names) -> bool:
    """Return whether a larger set, not necessarily a superset, gains enough for naming.

    Given a named cause, each further one must gain as much as a single cause must. If nothing was
    named, chance can choose among all pairs. They are tested at what single causes leave of the 5
    %, so that both together keep it.
    """
    if names != search.base.names:
        if not search.passes(names, larger):
            return False
        gain = search.factor(larger) - search.factor(names)
        return gain >= (len(larger) - len(names)) * search.step(names).threshold
    step = search.step(names)
    least = LEAST_FACTOR + float(np.log(max(len(search.causes) - 1, 2) / 2.0))
    gain = search.factor(larger)
    if gain < least or not len(step.simulated):
        return gain >= least
    linear = step.trial.linear
    columns = [sensitivities(linear, cause) for cause in search.causes]
    singles = factors_by_chance(linear, search.causes, step.simulated)
    pairs = largest_by_chance(linear.whiten(step.simulated), columns)
    return gain > beside_the_rate(singles, pairs, step.threshold)


def beside_the_rate(singles: Floats, pairs: Floats, threshold: float) -> float:
    """Return the log Bayes factor of a pair that keeps the rate of false names [nats].

    Parameters
    ----------
    singles, pairs : array, shape (k,)
        The best single cause and the best pair in each of k data sets without an effect.
    threshold : float
        Which single causes have to pass.

    Returns
    -------
    float
        In at most 5 % of the data sets a cause or a pair passes; where single causes use that up,
        what no other data set reaches.

    Examples
    --------
    >>> beside_the_rate(np.arange(100.0), np.arange(100.0), 96.5)
    94.0
    """
    left = np.sort(pairs[singles <= threshold])[::-1]
    allowed = int(FALSE_NAME_RATE * len(pairs)) - int(np.sum(singles > threshold))
    return float(left[min(max(allowed, 0), len(left) - 1)]) if len(left) else np.inf


def _exchanged(search: Search, chosen: Names) -> Names:
    """Replace causes by rivals while that improves the set."""
    while True:
        found = {
            chosen - {name} | {rival}: factor
            for name in sorted(chosen)
            for rival, factor in rivals(search, chosen, name).items()
        }
        best = max(found, key=lambda names: found[names], default=chosen)
        if search.factor(best) <= search.factor(chosen):
            return chosen
        chosen = best


def _pruned(search: Search, names: Names) -> Names:
    """Drop causes that do not earn their place."""
    while names - search.base.names:
        gains = {}
        for name in sorted(names - search.base.names):
            ensure(search, names - {name})
            gains[name] = search.factor(names) - search.factor(names - {name})
        weakest = min(gains, key=lambda name: gains[name])
        if search.passes(names - {weakest}, names):
            return names
        names = names - {weakest}
    return names


def ensure(search: Search, names: Names) -> None:
    """Fit a set, cause by cause, if it is not fitted yet."""
    if names in search.trials:
        return
    known = max((n for n in search.trials if n < names), key=len)
    for name in sorted(names - known):
        [known] = search.fit(known, [name])


@dataclass(frozen=True)
class RankedSet:
    """A set of causes on the linear scale.

    `score` is its log Bayes factor against the base model less ln of the number of sets as large
    [nats]; sizes are the most probable ones on the unconstrained scale, by name.
    """

    names: Names
    log_bayes_factor: float
    score: float
    sizes: Mapping[str, Floats]


def set_penalties(count: int) -> Floats:
    """Return ln of the number of sets of 0, 1, … causes, the difference of their log priors.

    Examples
    --------
    >>> np.exp(set_penalties(4)).round().tolist()
    [1.0, 4.0, 6.0, 4.0, 1.0]
    """
    steps = [max(count - k, 1) / (k + 1) for k in range(count)]
    found: Floats = np.cumsum(np.log([1.0, *steps]))
    return found


def in_reach(search: Search, chosen: Names) -> list[RankedSet]:
    """Return the sets to fit besides a chosen one, the most plausible first.

    They differ from it by at least two causes, and screening puts them within odds of 20 of it, or
    finds that they gain about as much as further causes need, allowing for the larger number of
    sets. Their number is limited by the effort.
    """
    scale = SetScale.of(search, chosen)
    own = scale.log_bayes_factor(chosen)
    if own is None:
        return []
    wanted = search.step(chosen).threshold - MARGIN
    found = []
    for size in range(max(len(chosen), 2), min(MOST_CAUSES, len(search.causes)) + 1):
        more = size - len(chosen)
        # without a cause errors are widest and screening is lowest: a few fits are worthwhile
        choice = float(scale.penalties[size] - scale.penalties[len(chosen)]) if chosen else 0.0
        least = own + wanted * more + choice if more else own - LEAST_FACTOR
        found += [one for one in scale.best(size, least) if len(one.names - chosen) > 1]
    found.sort(key=lambda one: -one.score)
    return found[: search.effort.pairs]


@dataclass(frozen=True)
class SetScale:
    """All sets of causes on the linear scale of the base model, with the scatter of a set.

    Parameters
    ----------
    scales : tuple of JointScreening
        Of the base model, and where its parameters have given way to the misfit, of it unbent.
    own : tuple of array
        What the causes of each scale gain alone by more than they do linearly [nats].
    penalties : array
        Those of `set_penalties`.
    """

    scales: tuple[JointScreening, ...]
    own: tuple[Floats, ...]
    penalties: Floats

    @classmethod
    def of(cls, search: Search, names: Names) -> "SetScale":
        """Return the scale with the scatter of a fitted set, without that from its causes."""
        step, base = search.step(search.base.names), search.base
        fitted = search.trials[names]
        known = dict(zip(fitted.subject.table.names, fitted.mode, strict=True))
        point = np.array([known[name] for name in base.subject.table.names])
        scatter = base.subject.scatter(point)
        scales, own = [], []
        for linear, found in ((base.linear, step.screened), (base.unbent(), step.unbent)):
            screened = [one for one in found.values() if not one.cause.is_of_rupture_alone]
            if linear is None or not screened:
                continue
            plain = JointScreening.of(linear.observed, screened)
            factors = {one.cause.name: one.log_bayes_factor for one in screened}
            beyond = np.array([factors[cause.name] for cause in plain.causes]) - plain.alone
            own.append(np.where(np.isfinite(beyond), beyond, 0.0))
            scales.append(JointScreening.at(linear, screened, scatter))
        return cls(tuple(scales), tuple(own), set_penalties(len(search.causes)))

    def log_bayes_factor(self, names: Names) -> float | None:
        """Return the log Bayes factor of a set; None if one of its causes changes no reading."""
        if not names:
            return 0.0
        found = [
            float(scale.factors(places[None])[0] + np.sum(own[places]))
            for scale, own in zip(self.scales, self.own, strict=True)
            if (places := scale.places_of(names)) is not None
        ]
        return max(found, default=None)

    def sizes_of(self, names: Names) -> dict[str, Floats]:
        """Return the most probable sizes in a set, on the unconstrained scale, by name.

        Empty if one of its causes changes no reading.
        """
        for scale in self.scales:
            places = scale.places_of(names)
            if places is not None:
                return scale.sizes_of(places)
        return {}

    def best(self, size: int, least: float) -> list[RankedSet]:
        """Return the sets of this many causes with at least this log Bayes factor."""
        found: dict[Names, RankedSet] = {}
        for scale, own in zip(self.scales, self.own, strict=True):
            sets = scale.all_sets(size)
            factors = scale.factors(sets) + np.sum(own[sets], axis=1)
            for k in np.flatnonzero(factors >= least):
                names, factor = scale.names_of(sets[k]), float(factors[k])
                if names not in found or found[names].log_bayes_factor < factor:
                    score = factor - float(self.penalties[size])
                    found[names] = RankedSet(names, factor, score, scale.sizes_of(sets[k]))
        return list(found.values())


def _fitted(
    parent: CandidateFit, job: tuple[Cause, Floats, np.random.SeedSequence]
) -> CandidateFit:
    cause, size, seed = job
    return try_causes(parent, cause, size, np.random.default_rng(seed))


type _Way = tuple[CandidateFit, list[tuple[Cause, Floats, np.random.SeedSequence]]]


def _fitted_in_turn(way: _Way) -> list[CandidateFit]:
    trial, found = way[0], []
    for job in way[1]:
        trial = _fitted(trial, job)
        found.append(trial)
    return found


def _screened(trial: CandidateFit, job: tuple[Cause, np.random.SeedSequence]) -> Screened:
    cause, seed = job
    found = screen(trial.linear, cause)
    if not cause.is_of_rupture_alone:
        return found
    ratio = from_prior(trial, cause, np.random.default_rng(seed), draws=FEW)
    return replace(found, log_bayes_factor=ratio.log_evidence)
