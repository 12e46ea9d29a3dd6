"""The tests that may refute a set of causes, made for the favoured set and for its rivals.

Each is made once. Those of a rival are made in the order of their cost: its size needs nothing more
than its fit, the misfit and the terms left by it data simulated from that fit, held-out specimens
further calibrations. Causes that no reading tells apart share the tests of the readings: what
chance decides for one must not speak for the other.
"""

from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from bayesdeg.assembly.assemble import Assembly
from bayesdeg.criticism.checks.absorption import effect_in
from bayesdeg.criticism.checks.missing_terms import MissingTerms, missing_terms
from bayesdeg.criticism.checks.shared_scatter import SharedScatter, shared_scatter
from bayesdeg.criticism.decide.alternatives import StatedSets, stated_sets
from bayesdeg.criticism.decide.elimination import eliminate
from bayesdeg.criticism.decide.support import (
    Regroup,
    Support,
    as_it_is,
    can_be_held_out,
    hold_out_each,
    support_without_rivals,
    supports,
)
from bayesdeg.criticism.decide.verdict import (
    Reason,
    TooLittleEvidence,
    against_held_out,
    against_misfit,
    against_scatter,
    against_sizes,
    against_structure,
)
from bayesdeg.criticism.fit.search import Names, Search, Step
from bayesdeg.criticism.fit.trials import DECIDING
from bayesdeg.criticism.holdout.held_out import HeldOut, joined
from bayesdeg.inference.model import JointModel
from bayesdeg.pages.left_out import Guard, OptionalStage
from bayesdeg.pages.wording import worded
from bayesdeg.progress import Progress

BASE: Names = frozenset()
HeldOutSets = tuple[dict[Names, HeldOut], dict[Names, HeldOut]]
"""Held-out results of sets of causes: of the main readings, and of these with all else."""
NOTHING_KNOWN: HeldOutSets = ({}, {})
Refuted = Mapping[Names, tuple[Reason, ...]]
REFUTING = (
    OptionalStage.HELD_OUT,
    OptionalStage.SHARED_SCATTER,
    OptionalStage.STRUCTURE,
)  # tests required for naming a cause


def label(names: Names) -> str:
    """Return the name of a model in tables.

    Examples
    --------
    >>> label(frozenset({"gravity", "creep"}))
    'base+creep+gravity'
    """
    return "+".join(("base", *sorted(names)))


@dataclass(frozen=True)
class SetResults:
    """A set of causes after all tests that may refute it, as far as they could be made.

    Parameters
    ----------
    names : frozenset of str
        The set.
    final : Step
        What it leaves.
    held_out, everything : dict of frozenset of str to HeldOut
        As of `held_out_and_all`.
    supported : list of Support
        What speaks for each cause.
    stated : StatedSets or None
        The sets that may be right besides it.
    shared : list of SharedScatter
        Whether specimens that it lets scatter one by one deviate level by level.
    structure : MissingTerms or None
        The terms in known quantities that it leaves.
    """

    names: Names
    final: Step
    held_out: dict[Names, HeldOut]
    everything: dict[Names, HeldOut]
    supported: list[Support]
    stated: StatedSets | None
    shared: list[SharedScatter]
    structure: MissingTerms | None

    def without(self, refuted: Collection[Names]) -> "SetResults":
        """Return it without its refuted rivals."""
        supported = [
            replace(
                one,
                rivals={
                    rival: gap
                    for rival, gap in one.rivals.items()
                    if one.replaced(self.names, rival) not in refuted
                },
            )
            for one in self.supported
        ]
        stated = None if self.stated is None else self.stated.without(refuted)
        return replace(self, supported=supported, stated=stated)


@dataclass
class RefutingTests:
    """Tests of sets of causes, each made once.

    Parameters
    ----------
    search : Search
        With the fitted sets.
    assembly : Assembly
        Of the study.
    seed : SeedSequence
        Of held-out specimens.
    progress : Progress
        Shows each held-out set.
    guard : Guard
        Leaves out what fails.
    """

    search: Search
    assembly: Assembly
    seed: np.random.SeedSequence
    progress: Progress
    guard: Guard
    known: HeldOutSets = NOTHING_KNOWN
    tested: dict[Names, SetResults] = field(default_factory=dict)
    against_readings: dict[tuple[str, ...], list[Reason]] = field(default_factory=dict)

    def best(self, favoured: Names) -> tuple[SetResults, Refuted]:
        """Return the best set that survives all tests, and the refuted ones with the reasons.

        If none survives, or a test could not be made, the set that the evidence favours.
        """

        def against(names: Names, leads: bool) -> list[Reason]:
            if not leads:
                return self._against_rival(names)
            # the favoured set gained enough when it was found
            weak = [] if names == favoured else self._too_little(names)
            return weak or self._against_leader(names)

        found = eliminate(favoured, self._rivals_of, against)
        if self._is_incomplete:
            return self.of(favoured), {}
        best = self.of(found.leader)
        if found.leader not in found.refuted:
            best = best.without(found.refuted)
        return replace(best, everything=self.known[1]), found.refuted

    def of(self, names: Names) -> SetResults:
        """Return all tests of a set."""
        if names not in self.tested:
            final = self.search.step(names)
            final = self.search.left(names) if names else final
            supported = self.supported(names)
            stated = self.guard.attempt(
                OptionalStage.SETS, stated_sets, self.search, names, supported
            )
            structure = self._structure(final) if names else None
            self.tested[names] = SetResults(
                names, final, *self.known, supported, stated, self._shared(final), structure
            )
        return self.tested[names]

    def supported(self, names: Names) -> list[Support]:
        """Return the support for each cause of a set, with specimens held out.

        They are held out a second time, with more draws, if Monte Carlo error may have decided
        whether a cause is supported.
        """
        self._hold_out(names)
        found = supports(self.search, names, self.known[1])
        if any(one.is_close_call for one in found):
            parts = (names - {name} for name in sorted(names))
            self.search.settle([BASE, names, *parts], DECIDING)
            self.known = NOTHING_KNOWN
            self._hold_out(names)
            found = supports(self.search, names, self.known[1])
        return found

    def _hold_out(self, names: Names) -> None:
        """Add the result of `held_out_and_all` to what is known, if it can be computed."""
        self.progress.stage("held-out specimens")
        found = self.guard.attempt(
            OptionalStage.HELD_OUT,
            held_out_and_all,
            self.search,
            names,
            known=self.known,
            seed=self.seed,
            executor=self.search.executor,
            on_set=lambda one: self.progress.advance(1, label(one)),
        )
        self.known = found or self.known

    @property
    def _is_incomplete(self) -> bool:
        return any(stage in self.guard.stages for stage in REFUTING)

    def _rivals_of(self, names: Names) -> list[Names]:
        stated = self.of(names).stated
        if stated is None or self._is_incomplete:
            return []
        return [one.names for one in stated.members if one.fitted and one.names != names]

    def _against_leader(self, names: Names) -> list[Reason]:
        """Return all reasons, so that the report can give them."""
        one = self.of(names)
        found = [*against_held_out(one.supported), *against_scatter(one.shared)]
        if self._acts_on_readings(names):
            found += against_misfit(self.search.step(BASE), one.final)
            found += against_structure(one.structure)
        self.against_readings[self._alike(names)] = found
        return [*against_sizes(one.supported), *found]

    def _against_rival(self, names: Names) -> list[Reason]:
        """Return the first reasons found, the cheapest tests first."""
        alike = self._alike(names)
        found = against_sizes(self._supports(names))
        if not found and alike not in self.against_readings:
            self.against_readings[alike] = self._against_readings_of(names)
        return found or self.against_readings[alike]

    def _against_readings_of(self, names: Names) -> list[Reason]:
        final, found = self.search.left(names), list[Reason]()
        if self._acts_on_readings(names):
            found = against_misfit(self.search.step(BASE), final)
            found = found or against_structure(self._structure(final))
        found = found or against_scatter(self._shared(final))
        if found:
            return found
        self._hold_out(names)
        # where Monte Carlo error decides, it must not be what tells a rival from the leader
        return against_held_out(one for one in self._supports(names) if not one.is_close_call)

    def _supports(self, names: Names) -> list[Support]:
        held_out = self.known[1]
        return [support_without_rivals(self.search, names, n, held_out) for n in sorted(names)]

    def _too_little(self, names: Names) -> list[Reason]:
        """Return the causes that gain less than naming requires."""
        found: list[Reason] = []
        for name in sorted(names):
            rest = names - {name}
            if not self.search.passes(rest, names):
                gain = self.search.factor(names) - self.search.factor(rest)
                found.append(TooLittleEvidence(name, gain, self.search.step(rest).threshold))
        return found

    def _acts_on_readings(self, names: Names) -> bool:
        acting = (cause for cause in self.search.causes if cause.name in names)
        return any(not cause.is_of_rupture_alone for cause in acting)

    def _alike(self, names: Names) -> tuple[str, ...]:
        """Return a set with each cause replaced by the first of those that read like it."""
        acting = (cause for cause in self.search.causes if cause.name in names)
        return tuple(sorted(min((cause.name, *cause.twins)) for cause in acting))

    def _structure(self, final: Step) -> MissingTerms | None:
        return self.guard.attempt(OptionalStage.STRUCTURE, terms_left, final, self.assembly)

    def _shared(self, final: Step) -> list[SharedScatter]:
        about = (final.trial, final.simulated)
        return self.guard.attempt(OptionalStage.SHARED_SCATTER, shared_scatter, *about) or []


def why_refuted(refuted: Refuted, best: Names, *, degrades: bool) -> dict[str, str]:
    """Return why causes are not named, by name: in the first set with each that was tested.

    Nothing of those in the best set, if it survives.
    """
    found: dict[str, str] = {}
    for names, reasons in refuted.items():
        said = "; ".join(worded(one, degrades=degrades) for one in reasons)
        for name in names if best in refuted else names - best:
            beside = " and ".join(sorted(names - {name}))
            found.setdefault(name, f"together with {beside}: {said}" if beside else said)
    return found


def held_out_and_all(
    search: Search,
    chosen: Names,
    *,
    known: HeldOutSets = NOTHING_KNOWN,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_set: Callable[[Names], None] | None = None,
) -> HeldOutSets:
    """Hold out the study's main readings, and these together with films and means of replicates.

    A wrong model of actuators can adapt to them and predict them well; it then contradicts the
    films or the measured volume ratio.

    Returns
    -------
    tuple of dict
        By set of causes, with those `known`; the same where there is nothing beside, or no cause to
        compare.
    """
    subject = search.base.subject
    compared = bool(chosen) and can_be_held_out(subject)
    ways: list[Regroup] = [as_it_is]
    ways += [partial(_beside_it, place) for place in range(len(subject.beside)) if compared]
    own, *others = hold_out_each(
        search, chosen, ways, known=known[0], seed=seed, executor=executor, on_set=on_set
    )
    everything = dict(own)
    for other in others:
        everything |= {names: joined(everything[names], more) for names, more in other.items()}
    return known[0] | own, known[1] | everything


def _beside_it(place: int, subject: JointModel) -> JointModel:
    return subject.beside[place]


def terms_left(step: Step, assembly: Assembly) -> MissingTerms:
    """Return the terms in the families of readings that the causes change.

    Causes are not at fault for structure in readings that are the same without them, such as a
    level of films that lies off its law.
    """
    acting = effect_in(step.trial, step.trial.names)
    change = acting.of(replace(step.trial.subject, causes=()))
    families = set(step.trial.subject.places.family[change != 0.0].tolist())
    return terms_of(step, assembly, families)


def terms_of(
    step: Step, assembly: Assembly, families: Collection[str] | None = None
) -> MissingTerms:
    """Return the terms in all families of readings, or in some, that a model leaves."""
    linear, batches = step.trial.linear, assembly.batches
    return missing_terms(linear, step.simulated, step.misfit, batches=batches, families=families)
