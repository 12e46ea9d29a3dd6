"""Scores of answers made by hand, whose every share can be counted."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.errors import StudyError
from bayesdeg.laboratory.hidden import (
    HiddenAnswer,
    HiddenTruth,
    Origin,
    StatedSize,
    lines_of,
    parse_sets,
    read_answers,
    read_truths,
    sets_text,
)
from bayesdeg.laboratory.score import (
    OUTSIDE,
    SEVERAL,
    TWO,
    WITH_IT,
    WITHOUT_IT,
    combinations,
    credit,
    is_right,
    names_absent_cause,
    score,
    wilson,
)

NAMES = sorted(CATALOGUE)


def truth(study, *causes, origin=None, visible=10.0):
    known = origin or (Origin.RULE if causes else Origin.NOTHING)
    hidden = {name: {"size": 2.0} for name in causes}
    return HiddenTruth(
        study=study, origin=known, hidden=hidden, visible=dict.fromkeys(causes, visible)
    )


def answer(study, *sets, outcome=None, **more):
    said = Outcome.NAMED if any(len(names) == 1 for names in sets) else Outcome.AMBIGUOUS
    known = outcome or (said if sets else Outcome.ADEQUATE)
    return HiddenAnswer(study=study, outcome=known, sets=sets, **more)


TRUTHS = [
    truth("1", "creep"),
    truth("2", "creep"),
    truth("3", "gravity", visible=3.0),
    truth("4", "gravity", origin=Origin.PHYSICS),
    truth("5", "creep", "gravity"),
    truth("6", "creep", "gravity"),
    truth("7"),
    truth("8"),
    truth("9", "outside_lens", origin=Origin.OUTSIDE),
    truth("10", "outside_lens", origin=Origin.OUTSIDE),
]
ANSWERS = [
    answer("1", ["creep"], p_value=0.01),  # right
    answer("2", ["creep", "mullins"]),  # right, half a credit
    answer("3", ["erosion"]),  # false
    answer("4", ["gravity", "erosion", "mullins", "creep"]),  # right, a quarter
    answer("5", ["creep"], ["gravity", "mullins"]),  # right, half
    answer("6", ["creep"]),  # one of two
    answer("7", p_value=0.4),  # right
    answer("8", ["creep", "erosion"], p_value=0.04),  # false
    answer("9", outcome=Outcome.UNEXPLAINED),  # right
    answer("10", ["gravity"]),  # false
]
COUNTED = {  # name: (counted, of)
    "right": (6, 10),
    "single_right": (3, 4),
    "single_alone": (1, 4),
    "single_credit": (1.75, 4),
    "plain_right": (3, 3),
    "plain_alone": (1, 3),
    "plain_credit": (1.75, 3),
    "physics_right": (1, 1),
    "two_right": (1, 2),
    "two_alone": (0, 2),
    "two_plain_right": (1, 2),
    "said_false": (3, 10),
    "none_adequate": (1, 2),
    "none_said": (1, 2),
    "outside_unexplained": (1, 2),
    "outside_said": (1, 2),
    "of_several": (4, 10),
    "none_rejected": (1, 2),
}


def test_every_share_is_what_a_person_counts():
    found = score(reversed(ANSWERS), TRUTHS)
    assert {one.name: (one.count, one.studies) for one in found.shares} == COUNTED
    assert (found.credit.count, found.credit.studies) == (1 + 0.5 + 0.25 + 0.5 + 1 + 1, 10)
    for one in found.shares:
        assert one.share == pytest.approx(one.count / one.studies)
        assert 0.0 <= one.low <= one.share <= one.high <= 1.0
    # of studies 1, 2, 4 and 5: 1, 2, 4 causes said for one hidden, 3 for two
    assert found.causes_said == pytest.approx((1 + 2 + 4 + 1.5) / 4)


def test_the_matrix_has_a_row_for_each_thing_hidden_and_loses_no_study():
    found = score(ANSWERS, TRUTHS)
    assert found.matrix == {
        "gravity": {"erosion": 1, WITH_IT: 1},
        "creep": {"creep": 1, WITH_IT: 1},
        TWO: {"creep": 1, SEVERAL: 1},
        OUTSIDE: {"gravity": 1, "unexplained": 1},
        "nothing": {"nothing": 1, WITHOUT_IT: 1},
    }
    cells = list(found.cells())
    assert sum(cell.count for _, _, cell in cells) == len(TRUTHS)
    for hidden in found.matrix:
        row = [cell for name, _, cell in cells if name == hidden]
        assert sum(cell.share for cell in row) == pytest.approx(1.0)
        assert all(cell.low <= cell.share <= cell.high for cell in row)


@pytest.mark.parametrize(("count", "studies"), [(0, 5), (3, 10), (10, 10), (1, 1), (37, 96)])
def test_intervals_are_those_of_scipy(count, studies):
    known = stats.binomtest(count, studies).proportion_ci(0.95, method="wilson")
    assert wilson(count, studies) == pytest.approx((known.low, known.high), abs=1e-12)


def test_the_interval_holds_a_mean_of_credits_as_often_as_it_says():
    """Of any law between 0 and 1; here credits of sets of 1 to 4."""
    generator = np.random.default_rng(5)
    drawn = generator.choice([0.0, 0.25, 0.5, 1.0], p=[0.3, 0.2, 0.2, 0.3], size=(2000, 40))
    ends = np.array([wilson(float(total), 40) for total in drawn.sum(axis=1)])
    inside = (ends[:, 0] <= 0.45) & (ends[:, 1] >= 0.45)
    assert inside.mean() >= 0.95


def perfect(one):
    if one.is_outside:
        return answer(one.study, outcome=Outcome.UNEXPLAINED)
    return answer(one.study, *([name] for name in one.causes), probabilities=dict.fromkeys(
        one.causes, 1.0))  # fmt: skip


def test_perfect_answers_score_one():
    found = score(map(perfect, TRUTHS), TRUTHS)
    assert found.credit.share == 1.0
    assert found.credit.high == 1.0
    assert found.causes_said == 1.0
    wrong = {"said_false", "none_said", "outside_said", "of_several", "none_rejected"}
    for one in found.shares:
        assert one.share == (0.0 if one.name in wrong else 1.0) or not one.studies
    assert found.probabilities.brier == 0.0
    # creep and gravity are hidden in 4 of 10 each
    assert found.probabilities.brier_of_base_rates == pytest.approx(2 * 0.4 * 0.6)


def test_who_names_everything_is_right_of_every_single_cause_and_wins_nothing():
    everything = score([answer(one.study, NAMES) for one in TRUTHS], TRUTHS)
    nothing = score([answer(one.study) for one in TRUTHS], TRUTHS)
    assert everything.share("single_right").share == 1.0
    assert everything.credit.count == pytest.approx(4 / len(NAMES))
    assert everything.credit.share < nothing.credit.share < 0.5
    assert everything.causes_said == len(NAMES)
    two = score([answer(one.study, NAMES, NAMES) for one in TRUTHS], TRUTHS)
    pairs = len(NAMES) * (len(NAMES) - 1) / 2
    assert two.credit.count == pytest.approx(2 / pairs)


def test_of_sets_that_overlap_each_combination_counts_once():
    hidden = truth("1", "creep", "gravity")
    said = answer("1", ["creep", "gravity"], ["creep", "gravity"])
    assert combinations(said.sets) == {frozenset({"creep", "gravity"})}
    assert credit(said, hidden) == 1.0
    assert not is_right(answer("1", ["creep", "gravity"]), hidden)
    assert not is_right(answer("1", ["creep"], ["gravity"], ["erosion"]), hidden)
    assert names_absent_cause(answer("1", ["creep"], ["erosion", "mullins"]), hidden)


def test_alternatives_are_combinations_that_no_product_gives():
    hidden = truth("1", "creep", "gravity")
    either = [["creep", "gravity"], ["erosion"], ["mullins", "creep"]]
    said = HiddenAnswer(study="1", outcome=Outcome.AMBIGUOUS, alternatives=either)
    assert credit(said, hidden) == pytest.approx(1 / 3)
    assert not names_absent_cause(said, hidden)
    assert names_absent_cause(said, truth("1", "gravity"))
    assert score([said], [hidden]).causes_said == 2.0  # four for two
    assert read_answers(lines_of([said]).encode(), "a.jsonl") == (said,)
    both = said.model_copy(update={"sets": (("creep",),)})
    with pytest.raises(StudyError):
        read_answers(lines_of([both]).encode(), "a.jsonl")


def test_coverage_counts_sizes_of_what_is_right_alone():
    def stated(low, high):
        return {"creep.size": StatedSize(mean=2.0, q05=low, q95=high)}

    truths = [truth(str(n), "creep") for n in range(4)]
    answers = [
        answer("0", ["creep"], sizes=stated(1.0, 3.0)),
        answer("1", ["creep"], sizes=stated(2.5, 3.5)),
        answer("2", ["creep"], sizes=stated(2.0, 6.0)),  # its end counts
        answer("3", ["gravity"], sizes=stated(1.0, 3.0)),  # wrong: does not count
    ]
    found = score(answers, truths).sizes
    assert (found.inside_90.count, found.inside_90.studies) == (2, 3)
    assert found.relative_width == pytest.approx(1.0)  # of 2/2, 1/2, 4/2
    assert score([answer(str(n)) for n in range(4)], truths).sizes is None


def test_the_brier_score_is_least_in_expectation_at_the_true_probability():
    truths = [truth(str(n), *(["creep"] if n < 3 else [])) for n in range(10)]

    def brier(p):
        given = [answer(one.study, probabilities={"creep": p}) for one in truths]
        return score(given, truths).probabilities

    assert brier(0.3).brier == pytest.approx(0.3 * 0.7)
    assert brier(0.3).brier == pytest.approx(brier(0.3).brier_of_base_rates)
    assert min(np.linspace(0.0, 1.0, 21), key=lambda p: brier(p).brier) == pytest.approx(0.3)


def test_studies_without_an_answer_and_answers_without_a_study_are_refused():
    with pytest.raises(StudyError) as caught:
        score([*ANSWERS[1:], answer("77")], TRUTHS, "a.csv")
    assert [(one.file, one.value) for one in caught.value.faults] == [
        ("a.csv", "1"),
        ("a.csv", "77"),
    ]
    with pytest.raises(StudyError) as caught:
        score([], [truth(str(n)) for n in range(50)])
    assert len(caught.value.faults) == 6  # not a line for each


@given(st.lists(st.lists(st.sampled_from(NAMES), min_size=1, max_size=4, unique=True), max_size=4))
def test_products_of_sets_come_back(sets):
    said = tuple(map(tuple, sets))
    assert parse_sets(sets_text(said)) == said
    assert parse_sets(sets_text(said).replace("|", " | ").replace(";", " ; ")) == said


@given(
    st.lists(
        st.tuples(
            st.sampled_from([*Outcome]),
            st.lists(st.lists(st.sampled_from(NAMES), min_size=1, max_size=3, unique=True),
                     min_size=1, max_size=3),
            st.one_of(st.none(), st.floats(0.0, 1.0)),
        ),
        min_size=1, max_size=6,
    )
)  # fmt: skip
def test_answers_come_back_from_lines_and_from_cells(rows):
    given = [
        HiddenAnswer(
            study=f"{n:04d}",
            outcome=outcome,
            sets=sets if outcome in ("named", "ambiguous") else (),
            p_value=p_value,
            sizes={"creep.amount": StatedSize(mean=0.5, q05=-1.0, q95=2.5)},
            probabilities={"creep": 0.25, "gravity": 1.0},
        )
        for n, (outcome, sets, p_value) in enumerate(rows)
    ]
    assert read_answers(lines_of(given).encode(), "a.jsonl") == tuple(given)
    cells = ["study,outcome,causes,p_value,sizes,probabilities"] + [
        f"{one.study},{one.outcome},{sets_text(one.sets)},"
        f"{'' if one.p_value is None else repr(one.p_value)},"
        "creep.amount=0.5[-1:2.5],creep=0.25;gravity=1"
        for one in given
    ]
    assert read_answers("\n".join(cells).encode(), "a.csv") == tuple(given)


GOOD = "study,outcome,causes,p_value,sizes,probabilities"


WRONG_ROWS = [
    ("1,named,crep,,,", "causes"),
    ("1,named,creep|creep,,,", "causes"),
    ("1,named,creep||gravity,,,", "causes"),
    ("1,named,creep;,,,", "causes"),
    ("1,named,creep;creep;creep;creep;creep,,,", "causes"),
    ("1,named,,,,", "outcome"),
    ("1,adequate,creep,,,", "outcome"),
    ("1,fine,,,,", "outcome"),
    (",adequate,,,,", "study"),
    ("1,adequate,,nan,,", "p_value"),
    ("1,adequate,,2,,", "p_value"),
    ("1,adequate,,-0.1,,", "p_value"),
    ("1,adequate,,few,,", "p_value"),
    ("1,named,creep,,creep.amount=0.5,", "sizes"),
    ("1,named,creep,,creep.amount=0.5[2:1],", "sizes"),
    ("1,named,creep,,creep.amount=nan[0:1],", "sizes"),
    ("1,named,creep,,creep.amnt=0.5[0:1],", "sizes"),
    ("1,named,creep,,crep.amount=0.5[0:1],", "sizes"),
    ("1,named,creep,,,creep=1.5", "probabilities"),
    ("1,named,creep,,,creep=inf", "probabilities"),
    ("1,named,creep,,,crep=0.5", "probabilities"),
    ("1,named,creep,,,creep", "probabilities"),
]


@pytest.mark.parametrize(("row", "column"), WRONG_ROWS)
def test_a_cell_that_cannot_be_meant_is_one_fault_that_says_where(row, column):
    with pytest.raises(StudyError) as caught:
        read_answers(f"{GOOD}\n0,adequate,,,,\n{row}\n".encode(), "a.csv")
    (fault,) = caught.value.faults
    assert (fault.file, fault.row, fault.column) == ("a.csv", 3, column)
    assert fault.value is not None
    assert fault.remedy


WRONG_FILES = [
    ("a.csv", "", None),
    ("a.csv", f"{GOOD}\n", 1),
    ("a.csv", "study,outcome\n1,adequate\n", 1),
    ("a.csv", "study,outcome,cause\n1,adequate,\n", 1),
    ("a.csv", f"{GOOD}\n1,adequate,,,,\n1,adequate,,,,\n", 3),
    ("a.csv", f"{GOOD}\n1,adequate,,,,,,\n2,adequate,,,,\n", 2),
    ("a.jsonl", "", None),
    ("a.jsonl", "{\n", 1),
    ("a.jsonl", "[1]\n", 1),
    ("a.jsonl", '{"study": "1"}\n', 1),
    ("a.jsonl", '{"study": "1", "outcome": "fine"}\n', 1),
    ("a.jsonl", '{"study": "1", "outcome": "adequate", "p_value": NaN}\n', 1),
    ("a.jsonl", '{"study": "1", "outcome": "adequate", "sets": ["creep"]}\n', 1),
    ("a.jsonl", '{"study": "1", "outcome": "named", "sets": [[]]}\n', 1),
    ("a.jsonl", "\n".join(['{"study": "1", "outcome": "adequate"}'] * 2), 2),
]


@pytest.mark.parametrize(("name", "content", "row"), WRONG_FILES)
def test_a_file_that_is_malformed_is_refused_with_its_row(name, content, row):
    with pytest.raises(StudyError) as caught:
        read_answers(content.encode(), name)
    first = caught.value.faults[0]
    assert (first.file, first.row) == (name, row)
    assert all("\n" not in str(fault) for fault in caught.value.faults)


WRONG_TRUTHS = [
    '{"study": "1", "origin": "rule"}',
    '{"study": "1", "origin": "nothing", "hidden": {"creep": {}}}',
    '{"study": "1", "origin": "rule", "hidden": {"crep": {}}}',
    '{"study": "1", "origin": "magic", "hidden": {"creep": {}}}',
    '{"origin": "nothing"}',
]


@pytest.mark.parametrize("line", WRONG_TRUTHS)
def test_truths_that_contradict_themselves_are_refused(line):
    with pytest.raises(StudyError) as caught:
        read_truths(f"{line}\n".encode(), "t.jsonl")
    assert caught.value.faults[0].row == 1


def test_a_document_of_many_lines_has_one_fault():
    with pytest.raises(StudyError) as caught:
        read_answers(b'[\n {\n  "study": "1"\n }\n]\n', "a.json")
    assert [fault.row for fault in caught.value.faults if fault.row] == [1]


def test_truths_come_back():
    assert read_truths(lines_of(TRUTHS).encode(), "t.jsonl") == tuple(TRUTHS)


def test_credits_of_all_answers_to_two_causes_are_those_of_a_draw():
    """By simulation: draw one of each set until they differ, and see whether it is the truth."""
    hidden = truth("1", "creep", "gravity")
    members = ["creep", "gravity", "erosion"]
    subsets = [c for k in (1, 2, 3) for c in itertools.combinations(members, k)]
    for sets in itertools.product(subsets, repeat=2):
        equally = combinations(sets)
        wanted = sum(one == {"creep", "gravity"} for one in equally) / max(len(equally), 1)
        assert credit(answer("1", *sets), hidden) == pytest.approx(wanted)
