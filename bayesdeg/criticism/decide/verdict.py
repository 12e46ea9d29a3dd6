"""The verdict: one cause, several, or none.

The chain of argument: (1) the overall misfit is calibrated by simulating from the fitted base
model; (2) a Gaussian-process discrepancy measures how much there is to explain; (3) causes are
added one after another while the evidence exceeds what chance gives in 5 % of data without an
effect, a test directed at the catalogue, and they are then judged jointly (`fit.search`); (4)
together they must raise the predictive density of held-out data by more than a standard error,
each adding to it, and leave no more than chance or remove most of the misfit; none may need a size
that its prior all but excludes, or one that is implausible unless it acts alone with strong
evidence, or treat a deviation of whole levels as scatter of single specimens
(`checks.shared_scatter`). Without a cause, the overall misfit, ruptures, their counts, measured
means and priors decide whether the base model is adequate. The misfit left by causes must not
require a further term in known quantities (`checks.missing_terms`), which catches effects outside
the catalogue that resemble a cause; (5) sets within odds of 20 get the same tests, and those that
are refuted drop out (`decide.elimination`); what remains is reported as a product of lists if every
combination is supported, else as a list of sets (`decide.alternatives`): a cause is named if it is
in all of them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.checks.count_misfit import CountMisfit
from bayesdeg.criticism.checks.discrepancy import (
    Misfit,
    explained,
    explained_on_one_scale,
)
from bayesdeg.criticism.checks.missing_terms import MissingTerms
from bayesdeg.criticism.checks.plausible_errors import TakenForErrors
from bayesdeg.criticism.checks.shared_scatter import SharedScatter
from bayesdeg.criticism.decide.alternatives import StatedSets
from bayesdeg.criticism.decide.support import Support
from bayesdeg.criticism.findings import (
    Conflict,
    Detectable,
    Questioned,
    RuptureMisfit,
)
from bayesdeg.criticism.fit.search import Step
from bayesdeg.criticism.outcome import LEFT_LEVEL, MISFIT_LEVEL, Outcome

Floats = NDArray[np.float64]

LEAST_EXPLAINED, LEAST_ON_ONE_SCALE = 0.5, 0.8
MOST_HIDDEN = 10.0
"""Largest smooth misfit, in % of the largest reading, that may hide in an adequate model."""
NEARLY_ALL = 0.9  # share of the misfit: the remainder may be small and yet significant
LEAST_CHANGE = 0.01
"""Largest change by a remaining term, over the largest reading, that does not count against causes:
errors of emulator and mesh may be as large."""


@dataclass(frozen=True)
class Uncalibrated:
    """The p-value of a misfit is unknown: too few simulated data sets are usable."""

    known: int
    drawn: int
    remaining: bool = False
    """Whether it is the misfit left by the favoured causes."""


@dataclass(frozen=True)
class LittlePower:
    """A smooth misfit up to this size [% of the largest reading] would have gone undetected."""

    kind: str
    misfit_pct: float
    specimens: int


@dataclass(frozen=True)
class CoarseMap:
    """The forward map errs by more than the readings, relative to their errors."""

    ratio: float


@dataclass(frozen=True)
class NotTested:
    """Too few simulated data sets to test whether specimens of one level deviate together."""

    cause: str


@dataclass(frozen=True)
class NotComputed:
    """A test that could have refuted a cause could not be computed."""

    test: str
    why: str


@dataclass(frozen=True)
class NotConverged:
    """The sampler of a model has not converged, by its largest R̂ and its fewest effective draws."""

    model: str
    r_hat: float
    effective: float


@dataclass(frozen=True)
class NothingHeldOut:
    """A single specimen, which cannot confirm a cause."""


@dataclass(frozen=True)
class NotPredictedBetter:
    """The cause does not improve the prediction of held-out specimens [nats]."""

    cause: str
    gain: float
    error: float


@dataclass(frozen=True)
class ImplausibleSize:
    """The size of the cause has too small a prior probability for its evidence [nats].

    `beside` others, no evidence is enough.
    """

    cause: str
    probability: float
    log_bayes_factor: float
    beside: bool = False


ON_EDGE = 0.01
"""Share of simulated data sets beyond the range of the forward map above which a model stands on
its edge: there causes were named that only keep curves within it."""


@dataclass(frozen=True)
class OnEdge:
    """The model with all that the evidence favours has readings where the map does not answer.

    Parameters
    ----------
    lost : float
        Share of the data sets simulated from it that leave the map's range [–].
    specimens : tuple of str
        Whose readings do so.
    """

    lost: float
    specimens: tuple[str, ...]


@dataclass(frozen=True)
class ExcludedSize:
    """The readings need a size of the cause that its prior excludes, whatever the evidence."""

    cause: str
    probability: float


@dataclass(frozen=True)
class TooLittleEvidence:
    """A rival of a refuted cause gains less evidence than naming requires [nats]."""

    cause: str
    log_bayes_factor: float
    threshold: float


@dataclass(frozen=True)
class SharedByLevel:
    """What the cause treats as scatter of single specimens is shared by degradation rates."""

    cause: str
    p_value: float
    replicates: int


@dataclass(frozen=True)
class NoReduction:
    """The misfit is within chance without the causes but not with them."""

    p_value: float
    replicates: int


@dataclass(frozen=True)
class TooLittleExplained:
    """The favoured causes remove less than half of the misfit."""

    share: float


@dataclass(frozen=True)
class MisfitRemains:
    """The favoured causes remove a share of the misfit, and the rest is significant."""

    share: float
    p_value: float
    replicates: int


@dataclass(frozen=True)
class StructureLeft:
    """A term in known quantities fits the misfit left by the causes.

    `change` is its largest effect, over the largest reading of its kind; `alike` the number of
    terms that fit as well.
    """

    formula: str
    columns: tuple[str, ...]
    change: float
    alike: int
    p_value: float
    replicates: int


type Reason = (
    Uncalibrated
    | LittlePower
    | CoarseMap
    | OnEdge
    | TakenForErrors
    | NotTested
    | NotComputed
    | NotConverged
    | NothingHeldOut
    | NotPredictedBetter
    | ImplausibleSize
    | ExcludedSize
    | TooLittleEvidence
    | SharedByLevel
    | NoReduction
    | TooLittleExplained
    | MisfitRemains
    | StructureLeft
)


@dataclass(frozen=True)
class Decision:
    """The outcome and its causes.

    Parameters
    ----------
    outcome : Outcome
        What can be said.
    causes : tuple of str
        Named, or not to be told apart; the strongest first.
    one_of : tuple of tuple of str
        Beside named causes: sets of which one more acts, but which cannot be said.
    reasons : tuple of Reason
        Why causes that the evidence favours were not named, or why nothing could be judged.
    sets : tuple of tuple of str
        Lists of each of which one cause acts, a named one alone in its list; empty where nothing is
        supported, or where what is supported is no product of lists.
    alternatives : tuple of tuple of str
        Sets of causes of which one acts, the most plausible first, where they are no such product.
    """

    outcome: Outcome
    causes: tuple[str, ...]
    one_of: tuple[tuple[str, ...], ...] = ()
    reasons: tuple[Reason, ...] = ()
    sets: tuple[tuple[str, ...], ...] = ()
    alternatives: tuple[tuple[str, ...], ...] = ()


def decide(
    base: Step,
    final: Step,
    supported: list[Support],
    *,
    rupture: RuptureMisfit | None = None,
    counts: CountMisfit | None = None,
    contradicted: Conflict | None = None,
    questioned: Sequence[Questioned] = (),
    on_rupture: frozenset[str] = frozenset(),
    alike: tuple[str, ...] = (),
    shared: Sequence[SharedScatter] = (),
    untested: Sequence[NotComputed] = (),
    structure: MissingTerms | None = None,
    stated: StatedSets | None = None,
    held_out: bool = True,
    detectable: Detectable | None = None,
    errors: TakenForErrors | None = None,
    coarse: CoarseMap | None = None,
) -> Decision:
    """Return the outcome.

    A cause may be named although the overall misfit is within chance: `supported` causes passed an
    equally calibrated test that is directed at the causes and has more power than one for any
    smooth discrepancy. Without such a cause the overall misfit decides. If there is such a cause
    and the remaining misfit exceeds chance, there is a misfit, even if the base model alone shows
    none.

    A model whose misfit could not be compared with chance is never adequate, nor is one whose
    readings would hide a large misfit, or one with a favoured cause but nothing to hold out. A
    cause is never named if a test that could have refuted it is missing: then nothing is judged.

    Parameters
    ----------
    base, final : Step
        What is known without a cause, and with all that the evidence favours.
    supported : list of Support
        Those causes.
    rupture : RuptureMisfit, optional
        Whether the base model expects the ruptures that there were.
    counts : CountMisfit, optional
        How probable published counts of ruptures are without a cause of rupture.
    contradicted : Conflict, optional
        The measured mean that the base model contradicts most.
    questioned : sequence of Questioned
        Parameters that the base model takes far off their priors: it fits, but not as it should.
    on_rupture : frozenset of str
        Causes that act on rupture alone: they need not explain the misfit of the readings.
    alike : tuple of str
        Causes that could not be judged since another form of the law reads like them: a misfit of
        the readings that nothing else explains may be any of them.
    shared : sequence of SharedScatter
        Whether specimens that those causes let scatter one by one deviate level by level.
    untested : sequence of NotComputed
        Tests that might refute a favoured cause and could not be made.
    structure : MissingTerms, optional
        The terms in known quantities that what those causes leave asks for.
    stated : StatedSets, optional
        Which sets of causes of the readings may be right; by default each cause is held against its
        own rivals alone.
    held_out : bool
        Whether specimens were to be held out; if not, causes need no confirmation by them.
    detectable : Detectable, optional
        The smallest detectable misfit.
    errors : ImplausibleErrors, optional
        What is implausible of the errors with all that the evidence favours.
    coarse : CoarseMap, optional
        That the forward map errs by more than the readings.
    """
    unknown_scatter = (NotTested(one.cause) for one in shared if not one.is_tested)
    missed: list[Reason] = [*untested, *unknown_scatter]
    if supported and missed:
        return Decision(Outcome.NOT_JUDGED, (), reasons=tuple(missed))
    misread = base.misfit.p_value <= MISFIT_LEVEL
    off = misread or bool(questioned) or (counts is not None and counts.contradicts)
    others = (found.p_value for found in (rupture, contradicted) if found is not None)
    off = off or any(p_value <= MISFIT_LEVEL for p_value in others) or errors is not None
    of_readings = any(one.cause not in on_rupture for one in supported)
    # a model with overestimated errors shows no misfit
    off = off or (of_readings and final.misfit.p_value <= MISFIT_LEVEL)
    confirming = supported if held_out else []
    by_level, structured = against_scatter(shared), against_structure(structure)
    against = [*against_misfit(base, final), *structured] if of_readings else []
    off = off or bool(by_level) or (of_readings and bool(structured))
    reasons = [*against_held_out(confirming), *against_sizes(supported), *by_level, *against]
    if errors is not None:
        reasons.append(errors)
    if not supported or reasons:
        if misread and len(alike) > 1:
            return Decision(Outcome.AMBIGUOUS, alike, reasons=tuple(reasons))
        unknown = [] if off else _unknown(base, confirming, detectable, coarse)
        if unknown:
            both = dict.fromkeys([*reasons, *unknown])
            return Decision(Outcome.NOT_JUDGED, (), reasons=tuple(both))
        outcome = Outcome.UNEXPLAINED if off else Outcome.ADEQUATE
        return Decision(outcome, (), reasons=tuple(reasons))
    edge = on_edge(final) if of_readings else None
    if edge is not None:
        return Decision(Outcome.NOT_JUDGED, (), reasons=(edge,))
    if of_readings and not base.misfit.is_calibrated and base.misfit.lost > ON_EDGE:
        return Decision(Outcome.NOT_JUDGED, (), reasons=(uncalibrated(base.misfit),))
    # the named causes, which are in every possible set, and lists of which one acts
    apart = [one for one in supported if stated is None or one.cause not in stated.favoured]
    lists = [(one.cause, *one.inseparable) for one in apart]
    certain = [names[0] for names in lists if len(names) == 1]
    open_ones = [names for names in lists if len(names) > 1]
    sets: list[tuple[str, ...]] = []
    if stated is not None:
        certain, open_ones = [*stated.certain, *certain], [*stated.one_of, *open_ones]
        sets = [*stated.product, *lists] if stated.is_product else []
    outcome = Outcome.NAMED if certain else Outcome.AMBIGUOUS
    together = tuple(dict.fromkeys(name for names in open_ones for name in names))
    return Decision(
        outcome,
        tuple(certain) or together,
        one_of=tuple(open_ones) if certain else (),
        sets=tuple(sets),
        alternatives=() if stated is None else stated.alternatives,
    )


def share_explained(base: Step, final: Step) -> tuple[float, float]:
    """Return the explained share of the misfit, at each model's own errors and at common ones.

    1 if there was no misfit; the first is 0 if a misfit could not be compared with chance. The
    second uses the errors of the final model (`explained_on_one_scale`) and is computed only if the
    first leaves a doubt.
    """
    own = explained(base.misfit, final.misfit)
    own = 1.0 if np.isnan(own) else own
    if not (base.misfit.is_calibrated and final.misfit.is_calibrated):
        own = 0.0
    if own >= NEARLY_ALL:
        return own, own
    common = explained_on_one_scale(base.trial.linear, final.trial.linear)
    return own, 1.0 if np.isnan(common) else common


def fraction_explained(base: Step, final: Step) -> float | None:
    """Return the larger share of `share_explained`; None if there was no misfit."""
    if np.isnan(explained(base.misfit, final.misfit)):
        return None
    return max(share_explained(base, final))


def uncalibrated(misfit: Misfit, *, remaining: bool = False) -> Uncalibrated:
    """Return why the p-value of a misfit is unknown."""
    return Uncalibrated(len(misfit.null), misfit.drawn, remaining)


def _unknown(
    base: Step,
    supported: list[Support],
    detectable: Detectable | None,
    coarse: CoarseMap | None,
) -> list[Reason]:
    """Return why a model without a detected misfit may still not count as adequate."""
    if not base.misfit.is_calibrated:
        return [uncalibrated(base.misfit)]
    if detectable is not None:
        # one specimen may differ from the simulation by chance
        is_seen = detectable.misfit_pct <= MOST_HIDDEN and detectable.specimens != 1
        if not is_seen:
            return [LittlePower(detectable.kind, detectable.misfit_pct, detectable.specimens)]
    if coarse is not None:
        return [coarse]
    return [_against(one) for one in supported if one.elpd_diff is None]


def on_edge(step: Step) -> OnEdge | None:
    """Return the readings that simulated data sets have beyond the range of the forward map."""
    if not step.misfit.lost > ON_EDGE:
        return None
    names = step.trial.linear.subject.places.specimen[step.misfit.unanswered > 0.0]
    return OnEdge(step.misfit.lost, tuple(dict.fromkeys(names.tolist())))


def against_sizes(supported: Iterable[Support]) -> list[Reason]:
    """Return the sizes that are too improbable for what speaks for them."""
    found: list[Reason] = []
    for one in supported:
        if one.is_excluded:
            found.append(ExcludedSize(one.cause, one.least_tail))
        elif not one.is_plausible:
            beside = one.together is not None
            found.append(ImplausibleSize(one.cause, one.prior_tail, one.log_bayes_factor, beside))
    return found


def against_held_out(supported: Iterable[Support]) -> list[Reason]:
    """Return the causes with which held-out specimens are not predicted better."""
    return list(dict.fromkeys(_against(one) for one in supported if not one.held_out_agrees))


def against_scatter(shared: Iterable[SharedScatter]) -> list[Reason]:
    """Return the causes that treat a deviation of whole levels as scatter of single specimens."""
    return [
        SharedByLevel(one.cause, one.p_value, one.replicates)
        for one in shared
        if one.is_more_than_chance
    ]


def against_structure(found: MissingTerms | None) -> list[Reason]:
    """Return the remaining term, if it has a relevant size and exceeds chance.

    Held-out specimens need not confirm it: giving a term is a claim, doubting a cause is not.
    """
    if found is None or found.best is None or found.best.largest < LEAST_CHANGE:
        return []
    if not found.p_value <= MISFIT_LEVEL:
        return []
    first, term = found.best, found.best.term
    alike, p_value = first.count_alike, first.p_value
    return [
        StructureLeft(term.formula, term.columns, first.largest, alike, p_value, found.replicates)
    ]


def _against(one: Support) -> Reason:
    if one.elpd_diff is None:
        return NothingHeldOut()
    return NotPredictedBetter(one.cause, one.elpd_diff, one.elpd_diff_se or 0.0)


def against_misfit(base: Step, final: Step) -> list[Reason]:
    """Return why the misfit left by causes counts against them, if it does."""
    left, replicates = final.misfit.p_value, len(final.misfit.null)
    if left > LEFT_LEVEL:
        return []
    # of a misfit that is not calibrated p is nan
    if base.misfit.p_value > MISFIT_LEVEL and left <= LEFT_LEVEL:
        return [NoReduction(left, replicates)]
    own, common = share_explained(base, final)
    share = max(own, common)
    if own < LEAST_EXPLAINED and common < LEAST_ON_ONE_SCALE:
        return [TooLittleExplained(share)]
    if not final.misfit.is_calibrated and share < NEARLY_ALL:
        return [uncalibrated(final.misfit, remaining=True)]
    if share < NEARLY_ALL:
        return [MisfitRemains(share, left, replicates)]
    return []
