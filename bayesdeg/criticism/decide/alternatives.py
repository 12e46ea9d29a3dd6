r"""Which sets of causes may be right, and whether they are one of A and one of B.

Causes of a set that have look-alikes make many sets that the data cannot tell apart. Where every
choice of one cause from each of several lists is as good as its parts say, the sets are a product
of lists. With g the log Bayes factor by which a set is behind, a combination of several
replacements belongs to it if

.. math::
    g \le \max \Big( \ln 20,\ \sum_j g_j + 1 \Big),

:math:`g_j` those of each replacement by itself: evidence that is independent adds. Otherwise the
data exclude the combination, and there is no product, but a list of sets.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from bayesdeg.criticism.decide.support import INSEPARABLE, Support
from bayesdeg.criticism.fit.search import Names, Search, SetScale

TOLERANCE = 1.0
"""By which a combination may be farther behind than its replacements together [nats]: errors of
three evidences by importance sampling, each up to some 0.3, and no odds to speak of."""


@dataclass(frozen=True)
class SetOdds:
    """One set of causes beside the favoured one.

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
        """The causes without an order."""
        return frozenset(self.causes)


@dataclass(frozen=True)
class StatedSets:
    """What the data support as sets of causes.

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
        """Members that are no choice from the lists."""
        choices = {frozenset(picked) for picked in product(*self.lists)}
        return tuple(one for one in self.members if one.names not in choices)

    @property
    def is_product(self) -> bool:
        """Whether the sets that may be right are all choices of one cause from each list."""
        return not (self.excluded or self.elsewhere)

    @property
    def product(self) -> tuple[tuple[str, ...], ...]:
        """Lists of which one cause each acts; empty where the sets are no product."""
        return self.lists if self.is_product else ()

    @property
    def alternatives(self) -> tuple[tuple[str, ...], ...]:
        """The sets of which one acts, where they are no product."""
        return () if self.is_product else tuple(one.causes for one in self.members)

    @property
    def certain(self) -> tuple[str, ...]:
        """Causes that are in every set that may be right."""
        alone = (names[0] for names in self.lists if len(names) == 1)
        return tuple(name for name in alone if all(name in one.causes for one in self.members))

    @property
    def one_of(self) -> tuple[tuple[str, ...], ...]:
        """Lists of each of which one cause acts at least, whatever set is right."""
        if not self.elsewhere:
            return tuple(names for names in self.lists if len(names) > 1)
        further = (name for one in self.members for name in one.causes)
        return (tuple(dict.fromkeys(name for name in further if name not in self.certain)),)


def stated_sets(search: Search, chosen: Names, supported: Sequence[Support]) -> StatedSets:
    """Return which sets may be right beside a favoured one; none where nothing is favoured.

    Combinations of several replacements are fitted, those first of which screening says least that
    they are as good as their parts; beyond what the effort allows it is screening that judges.

    Parameters
    ----------
    search : Search
        In which the set and its rivals are fitted.
    chosen : frozenset of str
        The favoured set.
    supported : sequence of Support
        What speaks for its causes, with their rivals.
    """
    if not chosen:
        return StatedSets((), ())
    lists = tuple((one.cause, *one.inseparable) for one in supported)
    combined = _combined(lists, [{one.cause: 0.0, **one.rivals} for one in supported])
    screened = _screened_gaps(search, chosen, combined)
    doubtful = sorted(combined, key=lambda one: one.together - screened[one.names])
    missing = [one.names for one in doubtful if one.names not in search.trials]
    scale = SetScale.of(search, chosen) if missing else None
    if scale is not None:
        search.fit_sets({names: scale.sizes_of(names) for names in missing[: search.effort.fitted]})
    members = list(_replaced_once(search, supported, lists))
    excluded: list[SetOdds] = []
    for one in combined:
        found = _judged(search, chosen, one.causes, screened[one.names])
        belongs = found.behind <= max(INSEPARABLE, one.together + TOLERANCE)
        (members if belongs else excluded).append(found)
    members += _further(search, chosen, {one.names for one in (*members, *excluded)})
    first, *others = members
    others.sort(key=lambda one: (one.behind, one.causes))
    return StatedSets(lists, (first, *others), tuple(excluded))


class _Combination(NamedTuple):
    """A choice with several replacements, and by how much they are behind one by one together."""

    causes: tuple[str, ...]
    together: float
    parts: tuple[Names, ...]

    @property
    def names(self) -> Names:
        return frozenset(self.causes)


def _combined(
    lists: tuple[tuple[str, ...], ...], gaps: Sequence[Mapping[str, float]]
) -> list[_Combination]:
    """Return the choices from lists in which several causes are replaced, each set once."""
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
    """Return by how much combinations are behind: their parts, and what screening says beyond.

    Where screening says nothing, as of causes that change no reading, they are as their parts.
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


def _judged(search: Search, chosen: Names, causes: tuple[str, ...], screened: float) -> SetOdds:
    names, whole = frozenset(causes), search.factor(chosen)
    fitted = names in search.trials
    behind = whole - search.factor(names) if fitted else screened
    return SetOdds(causes, whole - behind, behind, fitted)


def _replaced_once(
    search: Search, supported: Sequence[Support], lists: tuple[tuple[str, ...], ...]
) -> Iterator[SetOdds]:
    """Yield the favoured set, and those in which a rival stands in the place of one cause."""
    heads = tuple(names[0] for names in lists)
    whole = search.factor(frozenset(heads))
    yield SetOdds(heads, whole, 0.0)
    for one in supported:
        for rival in one.inseparable:
            causes = tuple(rival if name == one.cause else name for name in heads)
            yield SetOdds(causes, whole - one.rivals[rival], one.rivals[rival])


def _further(search: Search, chosen: Names, known: set[Names]) -> Iterator[SetOdds]:
    """Yield fitted sets of as many causes within odds of 20 that are no choice from the lists."""
    whole = search.factor(chosen)
    for names in search.trials:
        behind = whole - search.factor(names)
        if len(names) == len(chosen) and names not in known and behind < INSEPARABLE:
            yield SetOdds(tuple(sorted(names)), whole - behind, behind)
