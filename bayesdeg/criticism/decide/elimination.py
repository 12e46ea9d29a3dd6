"""Which set of causes survives the tests that may refute it: the leader, or one of its rivals.

The leader is the set with the most evidence. What comes within odds of 20 of it explains the
readings about as well, so it is tested too: by the same tests, the cheapest first, up to the first
that refutes it. If the leader is refuted, the best rival that is not takes its place; the rivals of
that one are tested in turn, until the leading set survives, and with it all its rivals that do. If
none does, nothing is named.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from bayesdeg.criticism.decide.verdict import Reason
from bayesdeg.criticism.fit.search import Names


@dataclass(frozen=True)
class Elimination:
    """The leading set after all tests.

    Parameters
    ----------
    leader : frozenset of str
        The best set that survives; if none does, the one with the most evidence.
    refuted : mapping of frozenset of str to tuple of Reason
        The sets that were refuted, and why.
    """

    leader: Names
    refuted: Mapping[Names, tuple[Reason, ...]]


def eliminate(
    leader: Names,
    rivals_of: Callable[[Names], Iterable[Names]],
    against: Callable[[Names, bool], Iterable[Reason]],
) -> Elimination:
    """Test a leader and its rivals.

    Parameters
    ----------
    leader : frozenset of str
        The set with the most evidence.
    rivals_of : callable
        Returns the sets within odds of 20 of a set, the best first.
    against : callable
        Returns why a set is refuted; nothing if it is not. The second argument says whether the set
        leads: then all that naming requires is tested.

    Examples
    --------
    >>> from bayesdeg.criticism.decide.verdict import TooLittleExplained
    >>> first, second = frozenset({"degradation_scale"}), frozenset({"erosion"})
    >>> against = lambda names, leads: [TooLittleExplained(0.4)] if names == first else []
    >>> eliminate(first, lambda names: {first, second} - {names}, against).leader
    frozenset({'erosion'})
    """
    first, tested, refuted = leader, set[Names](), dict[Names, tuple[Reason, ...]]()

    def survives(names: Names, *, leads: bool = False) -> bool:
        if names not in refuted and (leads or names not in tested):
            tested.add(names)
            reasons = tuple(against(names, leads))
            if reasons:
                refuted[names] = reasons
        return names not in refuted

    while not survives(leader, leads=True):
        rival = next((one for one in rivals_of(leader) if survives(one)), None)
        if rival is None:
            return Elimination(first, refuted)
        leader = rival
    for one in rivals_of(leader):
        survives(one)
    return Elimination(leader, refuted)
