r"""Score a method's answers about hidden effects: shares with intervals, and a matrix.

An answer is a product of sets :math:`S_1 \times \dots \times S_k`, see
`bayesdeg.laboratory.hidden`. It is *right* if the hidden causes are one of the combinations

.. math:: C = \{\{s_1, \dots, s_k\} : s_i \in S_i,\ \text{all different}\};

Studies without a hidden effect require ``adequate``, an effect without an entry ``unexplained``.
Naming everything would always be right but uninformative, so the main score is the *credit*
:math:`[\text{right}]/|C|`, the probability of the truth when a combination is drawn at random.

Shares have Wilson's 95 % interval, which also holds for a mean of credits: values between 0 and 1
have the largest variance if they are 0 or 1.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from math import sqrt
from statistics import NormalDist, mean, median

from pydantic import Field

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.errors import Fault, StudyError
from bayesdeg.laboratory.hidden import HiddenAnswer, HiddenTruth, Origin
from bayesdeg.records import FileRecord, Number, Numbers, Record, Text

Pair = tuple[HiddenAnswer, HiddenTruth]
Judged = Callable[[HiddenAnswer, HiddenTruth], float]

LEVEL = 0.95
#: Size of an effect after a refit of everything else from which a test must detect it [standard
#: deviations]: more than twice what noise alone gives any one effect.
VISIBLE = 5.0
#: p-value up to which a test counts as rejecting, where nothing is hidden.
REJECTED = 0.05
#: Faults of missing studies that are listed one by one.
MOST_LISTED = 5

WITH_IT, WITHOUT_IT = "one of several, it among them", "one of several, without it"
SEVERAL = "several at once"
SAID_OF = {
    Outcome.UNEXPLAINED: "unexplained",
    Outcome.ADEQUATE: "nothing",
    Outcome.NOT_JUDGED: "not judged",
}
#: Columns of the isolability matrix.
SAID = (*CATALOGUE, WITH_IT, WITHOUT_IT, SEVERAL, *SAID_OF.values())
NOTHING, OUTSIDE, TWO = "nothing", "outside the catalogue", "two causes"


class ScoredShare(Record):
    """A share of studies, or a mean of credits, with its 95 % interval."""

    name: Text
    meaning: Text
    count: Number = Field(default=None, description="number of studies, or sum of their credits")
    studies: int = Field(description="total number of studies")
    share: Number = None
    low: Number = Field(default=None, description="lower end of Wilson's 95 % interval")
    high: Number = None


class ScoredSizes(Record):
    """Sizes of hidden causes, in correctly answered studies."""

    inside_90: ScoredShare
    relative_width: Number = Field(
        default=None, description="median width of the 90 % intervals over the true size"
    )


class ScoredProbabilities(Record):
    r"""Probabilities that causes act: the Brier score and that of the base rates.

    .. math:: B = \frac1N \sum_{n=1}^N \sum_c (p_{nc} - [c \text{ is hidden in } n])^2

    References
    ----------
    Gneiting and Raftery (2007), doi:10.1198/016214506000001437.
    """

    studies: int
    brier: Number = None
    brier_of_base_rates: Number = Field(
        default=None, description="Brier score of the overall frequencies of hidden causes"
    )


class Score(FileRecord):
    """The content of ``score.json``: how well a method identifies hidden effects."""

    studies: int
    credit: ScoredShare = Field(description="the score that ranks methods")
    shares: tuple[ScoredShare, ...]
    causes_said: Number = Field(
        default=None,
        description="mean number of causes named per hidden one, in correctly answered studies "
        "with a hidden cause; at least 1",
    )
    sizes: ScoredSizes | None = Field(default=None, description="null if no sizes are given")
    probabilities: ScoredProbabilities | None = Field(
        default=None, description="null if none are given"
    )
    matrix: Mapping[str, Numbers] = Field(
        description="isolability: counts of answers, by the single hidden effect"
    )

    def share(self, name: str) -> ScoredShare:
        """Return a share by its name.

        Raises
        ------
        KeyError
            If the name is unknown.
        """
        return {one.name: one for one in self.shares}[name]

    def cells(self) -> Iterator[tuple[str, str, ScoredShare]]:
        """Yield the isolability matrix: hidden effect, answer, and share."""
        for hidden, said in self.matrix.items():
            studies = int(sum(count or 0.0 for count in said.values()))
            for column in SAID:
                yield hidden, column, _share(column, "", [said.get(column) or 0.0], studies)


def wilson(count: float, studies: int) -> tuple[float, float]:
    r"""Return Wilson's 95 % interval of a share.

    .. math:: \frac{p + z^2/2n \pm z \sqrt{p(1 - p)/n + z^2/4n^2}}{1 + z^2/n}

    Parameters
    ----------
    count : float
        p n; for a sum of numbers between 0 and 1 the interval is conservative.
    studies : int
        n; for 0 the interval is (0, 1).

    References
    ----------
    Brown, Cai, DasGupta (2001), doi:10.1214/ss/1009213286, recommend it for small n.

    Examples
    --------
    >>> [round(end, 3) for end in wilson(0, 10)], wilson(0, 0)
    ([0.0, 0.278], (0.0, 1.0))
    """
    if studies == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + 0.5 * LEVEL)
    share, widened = count / studies, 1.0 + z**2 / studies
    middle = (share + 0.5 * z**2 / studies) / widened
    half = z * sqrt(share * (1.0 - share) / studies + 0.25 * (z / studies) ** 2) / widened
    return max(middle - half, 0.0), min(middle + half, 1.0)


def is_right(answer: HiddenAnswer, truth: HiddenTruth) -> bool:
    """Return whether an answer contains the hidden causes, and no others.

    Examples
    --------
    >>> truth = HiddenTruth(study="1", origin="rule", hidden={"creep": {}, "gravity": {}})
    >>> def said(*sets):
    ...     return HiddenAnswer(study="1", outcome="named", sets=sets)
    >>> is_right(said(["creep", "mullins"], ["gravity"]), truth)
    True
    >>> is_right(said(["creep", "gravity"]), truth)  # one of both
    False
    """
    if truth.is_outside or not truth.hidden:
        wanted = Outcome.UNEXPLAINED if truth.is_outside else Outcome.ADEQUATE
        return answer.outcome is wanted
    return frozenset(truth.hidden) in said_by(answer)


def said_by(answer: HiddenAnswer) -> set[frozenset[str]]:
    """Return the combinations of causes that an answer allows; empty if it names no cause.

    Examples
    --------
    >>> pairs = HiddenAnswer(study="1", outcome="ambiguous", alternatives=[["a", "b"], ["c"]])
    >>> sorted(sorted(one) for one in said_by(pairs))
    [['a', 'b'], ['c']]
    """
    if answer.alternatives:
        return {frozenset(names) for names in answer.alternatives}
    return combinations(answer.sets) if answer.sets else set()


def combinations(sets: Sequence[Sequence[str]]) -> set[frozenset[str]]:
    """Return the combinations of causes allowed by a product of sets.

    Examples
    --------
    >>> sorted(sorted(one) for one in combinations([["a", "b"], ["b", "c"]]))
    [['a', 'b'], ['a', 'c'], ['b', 'c']]
    """
    chosen = (frozenset(one) for one in product(*sets))
    return {one for one in chosen if len(one) == len(sets)}


def credit(answer: HiddenAnswer, truth: HiddenTruth) -> float:
    """Return the credit: 1 over the number of combinations, 0 if the answer is wrong.

    Examples
    --------
    >>> truth = HiddenTruth(study="1", origin="rule", hidden={"creep": {}})
    >>> credit(HiddenAnswer(study="1", outcome="ambiguous", sets=[["creep", "mullins"]]), truth)
    0.5
    """
    return is_right(answer, truth) / max(len(said_by(answer)), 1)


def names_absent_cause(answer: HiddenAnswer, truth: HiddenTruth) -> bool:
    """Return whether every combination contains a cause that is not hidden, a false repair."""
    allowed = said_by(answer)
    return bool(allowed) and not any(one <= set(truth.hidden) for one in allowed)


def said(answer: HiddenAnswer, truth: HiddenTruth) -> str:
    """Return the column of the isolability matrix: one of `SAID`."""
    if not answer.sets and not answer.alternatives:
        return SAID_OF.get(answer.outcome, "not judged")
    if len(answer.sets) > 1 or any(len(one) > 1 for one in answer.alternatives):
        return SEVERAL
    names = answer.sets[0] if answer.sets else tuple(n for one in answer.alternatives for n in one)
    if len(names) == 1:
        return names[0]
    return WITH_IT if set(truth.hidden).intersection(names) else WITHOUT_IT


def score(answers: Iterable[HiddenAnswer], truths: Iterable[HiddenTruth], file: str = "") -> Score:
    """Score a method's answers to all studies.

    There is one answer per study, in any order; ``file`` is their source, for faults.

    Raises
    ------
    StudyError
        If a study has no answer, or an answer no study: shares over selected studies would be
        meaningless.

    Examples
    --------
    >>> truths = [HiddenTruth(study="1", origin="nothing"),
    ...           HiddenTruth(study="2", origin="rule", hidden={"creep": {"amount": 0.1}})]
    >>> answers = [HiddenAnswer(study="1", outcome="adequate"),
    ...            HiddenAnswer(study="2", outcome="ambiguous", sets=[["creep", "mullins"]])]
    >>> found = score(answers, truths)
    >>> found.credit.share, found.share("right").share, found.causes_said
    (0.75, 1.0, 2.0)
    """
    said_of = {answer.study: answer for answer in answers}
    wanted = tuple(truths)
    known = [truth.study for truth in wanted]
    unanswered = [name for name in known if name not in said_of]
    faults = [
        *_listed(file or "answers", "has no answer", "answer every study", unanswered),
        *_listed(
            *(file or "answers", "is not a study of the truths"),
            *("answer the studies of the data set", sorted(set(said_of) - set(known))),
        ),
    ]
    if faults:
        raise StudyError(faults)
    pairs = [(said_of[truth.study], truth) for truth in wanted]
    counts = [
        (
            len(set().union(*answer.alternatives))
            if answer.alternatives
            else sum(map(len, answer.sets))
        )
        / len(truth.hidden)
        for answer, truth in pairs
        if truth.hidden and not truth.is_outside and is_right(answer, truth)
    ]
    return Score(
        studies=len(pairs),
        credit=_part("credit", "right, over the number of combinations said", pairs, credit),
        shares=tuple(_shares(pairs)),
        causes_said=mean(counts) if counts else None,
        sizes=_sizes(pairs),
        probabilities=_probabilities(pairs),
        matrix=_matrix(pairs),
    )


def _listed(file: str, problem: str, remedy: str, studies: Sequence[str]) -> Iterator[Fault]:
    for study in studies[:MOST_LISTED]:
        yield Fault(file, problem, remedy, column="study", value=study)
    if (left := len(studies) - MOST_LISTED) > 0:
        yield Fault(file, f"{problem}, like {left} more", remedy, column="study")


def _shares(pairs: Sequence[Pair]) -> Iterator[ScoredShare]:
    """Yield the shares, whose names and meanings are those of ``score.json``."""
    caused = [(a, t) for a, t in pairs if t.hidden and not t.is_outside]
    single = [(a, t) for a, t in caused if len(t.hidden) == 1]
    plain = [(a, t) for a, t in single if _least(t) >= VISIBLE]
    planted = [(a, t) for a, t in single if t.origin is Origin.PHYSICS]
    both = [(a, t) for a, t in caused if len(t.hidden) > 1]
    shown = [(a, t) for a, t in both if _least(t) >= VISIBLE]
    none = [(a, t) for a, t in pairs if not t.hidden]
    outside = [(a, t) for a, t in pairs if t.is_outside]
    tested = [(a, t) for a, t in none if a.p_value is not None]
    yield from (
        _part("right", "right, in sets of any size", pairs, is_right),
        _part("single_right", "right, of single causes", single, is_right),
        _part("single_alone", "named alone, of single causes", single, _alone),
        _part("single_credit", "credit of single causes", single, credit),
        _part("plain_right", "right, of single causes of 5 sd and more", plain, is_right),
        _part("plain_alone", "named alone, of these", plain, _alone),
        _part("plain_credit", "credit of these", plain, credit),
        _part("physics_right", "right, of causes planted by physics", planted, is_right),
        _part("two_right", "right, of two causes", both, is_right),
        _part("two_alone", "both named alone, of two causes", both, _alone),
        _part("two_plain_right", "right, of two causes of 5 sd and more each", shown, is_right),
        _part(
            "said_false",
            "a cause said that is not hidden, whichever is drawn",
            pairs,
            names_absent_cause,
        ),
        _part("none_adequate", "adequate, where nothing is hidden", none, is_right),
        _part("none_said", "causes said where nothing is hidden", none, names_absent_cause),
        _part("outside_unexplained", "unexplained, of effects without entry", outside, is_right),
        _part("outside_said", "causes said for effects without entry", outside, names_absent_cause),
        _part("of_several", "a set of several said", pairs, lambda a, _: len(said_by(a)) > 1),
        _part(
            "none_rejected",
            "p of 0.05 and less where nothing is hidden",
            tested,
            lambda a, _: (1.0 if a.p_value is None else a.p_value) <= REJECTED,
        ),
    )


def _part(name: str, meaning: str, pairs: Sequence[Pair], judged: Judged) -> ScoredShare:
    return _share(name, meaning, [float(judged(*pair)) for pair in pairs], len(pairs))


def _share(name: str, meaning: str, counts: Sequence[float], studies: int) -> ScoredShare:
    count = sum(counts)
    low, high = wilson(count, studies)
    share = count / studies if studies else None
    return ScoredShare(
        name=name, meaning=meaning, count=count, studies=studies, share=share, low=low, high=high
    )


def _alone(answer: HiddenAnswer, truth: HiddenTruth) -> bool:
    return credit(answer, truth) == 1.0


def _least(truth: HiddenTruth) -> float:
    """Return the visibility of the weakest hidden effect; 0 if unknown."""
    return min((size for size in truth.visible.values() if size is not None), default=0.0)


def _sizes(pairs: Sequence[Pair]) -> ScoredSizes | None:
    inside, widths = [], []
    for answer, truth in pairs:
        true = {
            f"{c}.{p}": value for c, values in truth.hidden.items() for p, value in values.items()
        }
        for name, size in answer.sizes.items() if is_right(answer, truth) else ():
            value = true.get(name)
            if value is None or size.q05 is None or size.q95 is None:
                continue
            inside.append(float(size.q05 <= value <= size.q95))
            if value != 0.0:
                widths.append((size.q95 - size.q05) / abs(value))
    if not inside:
        return None
    share = _share("inside_90", "sizes inside their 90 % intervals", inside, len(inside))
    return ScoredSizes(inside_90=share, relative_width=median(widths) if widths else None)


def _probabilities(pairs: Sequence[Pair]) -> ScoredProbabilities | None:
    """Return scores of the probabilities; None if a method gives none."""
    if not any(answer.probabilities for answer, _ in pairs):
        return None
    rates = Counter(name for _, truth in pairs for name in truth.hidden if name in CATALOGUE)
    said_of = [({n: p or 0.0 for n, p in a.probabilities.items()}, t) for a, t in pairs]
    usual = {name: count / len(pairs) for name, count in rates.items()}
    return ScoredProbabilities(
        studies=len(pairs),
        brier=mean(_brier(probabilities, truth) for probabilities, truth in said_of),
        brier_of_base_rates=mean(_brier(usual, truth) for _, truth in pairs),
    )


def _brier(probabilities: Mapping[str, float], truth: HiddenTruth) -> float:
    return sum((probabilities.get(name, 0.0) - (name in truth.hidden)) ** 2 for name in CATALOGUE)


def _matrix(pairs: Sequence[Pair]) -> dict[str, Numbers]:
    counts: dict[str, Counter[str]] = {}
    for answer, truth in pairs:
        row = truth.causes[0] if len(truth.causes) == 1 else TWO if truth.hidden else NOTHING
        row = OUTSIDE if truth.is_outside else row
        counts.setdefault(row, Counter())[said(answer, truth)] += 1
    rows = (*CATALOGUE, TWO, OUTSIDE, NOTHING)
    return {
        row: {column: counts[row][column] for column in SAID if counts[row][column]}
        for row in rows
        if row in counts
    }
