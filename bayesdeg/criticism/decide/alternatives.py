r"""The sets of causes that may be right, and whether they are combinations from lists.

Causes with look-alikes give many sets that the data cannot tell apart. If every choice of one cause
from each of several lists is as good as its parts suggest, the sets are a product of lists. With g
the deficit of a set in log Bayes factor, a combination of several replacements belongs to it if

.. math::
    g \le \max \Big( \ln 20,\ \sum_j g_j + 1 \Big),

:math:`g_j` those of each replacement alone: independent evidence adds. Otherwise the data exclude
the combination, and there is no product but a list of sets.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from bayesdeg.criticism.decide.support import INSEPARABLE, Support
from bayesdeg.criticism.fit.search import Names, Search, SetScale

TOLERANCE = 1.0
"""Allowed excess of a combination's deficit over the sum of its replacements' [nats]: errors of
three evidences by importance sampling, each up to some 0.3, and negligible odds."""


@dataclass(frozen=True)
class SetOdds:
    """A set of causes compared with the favoured one.

    Parameters
    ----------
    causes : tuple of str
        In the order of the lists that it is a choice from, else of the alphabet.
    log_bayes_factor : float
        Against the base model [nats].
    behind : float
        What it has less than the favoured set [nats].
    fitted : bool
        Whether the model with it was fitted as a whole, or screened on the linear scale only.
    """

    causes: tuple[str, ...]
    log_bayes_factor: float
    behind: float
    fitted: bool = True

    @property
    def names(self) -> Names:
        """The causes as an unordered set."""
        return frozenset(self.causes)


@dataclass(frozen=True)
class StatedSets:
    """The sets of causes that the data support.

    Parameters
    ----------
    lists : tuple of tuple of str
        For each cause of the favoured set that cause and what can stand in its place.
    members : tuple of SetOdds
        Sets that may be right, the favoured one first, then by their evidence.
    excluded : tuple of SetOdds
        Combinations of the lists that the data exclude.

    Examples
    --------
    >>> both = [SetOdds(("creep", name), 40.0, 0.0) for name in ("pressure_loss", "film_mismatch")]
    >>> lists = (("creep",), ("pressure_loss", "film_mismatch"))
    >>> stated = StatedSets(lists, tuple(both))
    >>> stated.product == lists, stated.certain, stated.alternatives
    (True, ('creep',), ())
    >>> apart = StatedSets((("a", "c"), ("b", "d")), (SetOdds(("a", "b"), 9.0, 0.0),
    ...     SetOdds(("c", "b"), 8.0, 1.0), SetOdds(("a", "d"), 8.0, 1.0)),
    ...     (SetOdds(("c", "d"), 2.0, 7.0),))
    >>> apart.product, apart.alternatives
    ((), (('a', 'b'), ('c', 'b'), ('a', 'd')))
    """

    lists: tuple[tuple[str, ...], ...]
    members: tuple[SetOdds, ...]
    excluded: tuple[SetOdds, ...] = ()

    @property
    def favoured(self) -> Names:
        """The set that the evidence favours."""
        return frozenset(names[0] for names in self.lists)

    @property
    def elsewhere(self) -> tuple[SetOdds, ...]:
        """Members that are not combinations from the lists."""
        choices = {frozenset(picked) for picked in product(*self.lists)}
        return tuple(one for one in self.members if one.names not in choices)

    @property
    def is_product(self) -> bool:
        """Whether the sets that may be right are all choices of one cause from each list."""
        return not (self.excluded or self.elsewhere)

    @property
    def product(self) -> tuple[tuple[str, ...], ...]:
        """Lists from each of which one cause acts; empty if the sets are not a product."""
        return self.lists if self.is_product else ()

    @property
    def alternatives(self) -> tuple[tuple[str, ...], ...]:
        """The sets of which one acts, if they are not a product."""
        return () if self.is_product else tuple(one.causes for one in self.members)

    @property
    def certain(self) -> tuple[str, ...]:
        """Causes that are in every set that may be right."""
        alone = (names[0] for names in self.lists if len(names) == 1)
        return tuple(name for name in alone if all(name in one.causes for one in self.members))

    @property
    def one_of(self) -> tuple[tuple[str, ...], ...]:
        """Lists from each of which at least one cause acts, whichever set is right."""
        if not self.elsewhere:
            return tuple(names for names in self.lists if len(names) > 1)
        further = (name for one in self.members for name in one.causes)
        return (tuple(dict.fromkeys(name for name in further if name not in self.certain)),)

    def without(self, refuted: Collection[Names]) -> "StatedSets":
        """Return what remains if some sets are refuted, but not the favoured one.

        Examples
        --------
        >>> lists = (("creep", "mullins"),)
        >>> both = (SetOdds(("creep",), 9.0, 0.0), SetOdds(("mullins",), 8.0, 1.0))
        >>> StatedSets(lists, both).without({frozenset({"mullins"})}).product
        (('creep',),)
        """
        heads = self.favoured
        lists = tuple(
            tuple(name for name in names if heads - {names[0]} | {name} not in refuted)
            for names in self.lists
        )
        choices = {frozenset(picked) for picked in product(*lists)}
        return StatedSets(
            lists,
            tuple(one for one in self.members if one.names not in refuted),
            tuple(
                one
                for one in (*self.excluded, *self.members)
                if one.names in choices and (one in self.excluded or one.names in refuted)
            ),
        )


def stated_sets(search: Search, chosen: Names, supported: Sequence[Support]) -> StatedSets:
    """Return the sets that may be right besides the favoured one; empty if nothing is favoured.

    Combinations of several replacements are fitted, first those that screening rates worst relative
    to their parts; beyond the limit of the effort screening decides.
    """
    if not chosen:
        return StatedSets((), ())
    lists = tuple((one.cause, *one.inseparable) for one in supported)
    combined = _combined(lists, [{one.cause: 0.0, **one.rivals} for one in supported])
    screened = _screened_gaps(search, chosen, combined)
    doubtful = sorted(combined, key=lambda one: one.together - screened[one.names])
    missing = [one.names for one in doubtful if one.names not in search.trials]
    if missing:
        scale = SetScale.of(search, chosen)
        search.fit_sets({names: scale.sizes_of(names) for names in missing[: search.effort.fitted]})
    whole, heads = search.factor(chosen), tuple(names[0] for names in lists)
    members = [SetOdds(heads, whole, 0.0)]
    for support in supported:
        for rival in support.inseparable:
            causes = tuple(rival if name == support.cause else name for name in heads)
            behind = support.rivals[rival]
            members.append(SetOdds(causes, whole - behind, behind))
    excluded: list[SetOdds] = []
    for one in combined:
        fitted = one.names in search.trials
        behind = whole - search.factor(one.names) if fitted else screened[one.names]
        found = SetOdds(one.causes, whole - behind, behind, fitted)
        belongs = found.behind <= max(INSEPARABLE, one.together + TOLERANCE)
        (members if belongs else excluded).append(found)
    # fitted sets of the same size within odds of 20 that are not combinations from the lists
    known = {one.names for one in (*members, *excluded)}
    for names in search.trials:
        behind = whole - search.factor(names)
        if len(names) == len(chosen) and names not in known and behind < INSEPARABLE:
            members.append(SetOdds(tuple(sorted(names)), whole - behind, behind))
    first, *others = members
    others.sort(key=lambda one: (one.behind, one.causes))
    return StatedSets(lists, (first, *others), tuple(excluded))


class _Combination(NamedTuple):
    """A combination of several replacements, and the sum of their single deficits."""

    causes: tuple[str, ...]
    together: float
    parts: tuple[Names, ...]

    @property
    def names(self) -> Names:
        return frozenset(self.causes)


def _combined(
    lists: tuple[tuple[str, ...], ...], gaps: Sequence[Mapping[str, float]]
) -> list[_Combination]:
    """Return the combinations from lists with several replacements, without duplicates."""
    heads, found = [names[0] for names in lists], dict[Names, _Combination]()
    for picked in product(*lists):
        places = [k for k, name in enumerate(picked) if name != heads[k]]
        if len(places) < 2 or len(set(picked)) < len(heads) or {*picked} == {*heads}:
            continue
        together = sum(gaps[k][picked[k]] for k in places)
        parts = tuple(frozenset(heads) - {heads[k]} | {picked[k]} for k in places)
        one = _Combination(picked, together, parts)
        if one.names not in found or together < found[one.names].together:
            found[one.names] = one
    return list(found.values())


def _screened_gaps(
    search: Search, chosen: Names, combined: Sequence[_Combination]
) -> dict[Names, float]:
    """Return the deficits of combinations: the sum of their parts, plus the excess by screening.

    Without screening, as for causes that change no reading, the sum of the parts is used.
    """
    if not combined:
        return {}
    scale, found = SetScale.of(search, chosen), {}
    for one in combined:
        sets = (chosen, one.names, *one.parts)
        own, whole, *parts = (scale.log_bayes_factor(names) for names in sets)
        beyond = 0.0
        if own is not None and whole is not None:
            known = [part for part in parts if part is not None]
            beyond = (own - whole) - sum(own - part for part in known)
        found[one.names] = one.together + beyond
    return found
