import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.pages.wording import (
    LARGE,
    NOTHING,
    duration,
    fixed,
    listed,
    number,
    p_value,
    percent,
    unbroken,
)
from bayesdeg.quantities import p_value_text

PLAIN = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " "})


@given(st.floats(-1e12, 1e12).filter(lambda value: value == 0 or abs(value) > 1e-12))
def test_a_number_is_shown_to_three_significant_digits(value):
    shown = float(number(value).translate(PLAIN))
    assert shown == pytest.approx(value, rel=0.0051)
    assert (shown < 0) == (value < 0)


@given(st.floats(-1e6, 1e6), st.integers(0, 4))
def test_a_fixed_number_is_off_by_no_more_than_half_its_last_digit(value, decimals):
    shown = float(fixed(value, decimals).translate(PLAIN))
    last = 0 if abs(value) >= LARGE else decimals
    assert abs(shown - value) <= 0.5000001 * 10.0**-last


@given(st.floats(1e-300, 1.0, exclude_max=True))
def test_what_is_possible_is_never_shown_as_impossible_nor_as_certain(fraction):
    shown = percent(fraction).translate(PLAIN)
    assert shown not in ("0 %", "100 %", "0.0 %", "100.0 %")
    figure = float(re.search(r"[\d.]+", shown).group())
    if shown[0] not in "<>":
        assert abs(figure - 100 * fraction) <= 0.5000001


@pytest.mark.parametrize("nothing", [None, float("nan"), float("inf")])
def test_a_value_that_is_not_there_is_a_dash(nothing):
    assert {number(nothing), fixed(nothing), percent(nothing)} == {"–"}


def test_certainty_and_impossibility_are_shown_as_such():
    assert [percent(value).translate(PLAIN) for value in (0.0, 1.0)] == ["0 %", "100 %"]


def test_texts_that_are_no_numbers_stay_as_they_are():
    assert number("about 5.5 times") == "about 5.5 times"
    assert number("nan") == "nan"
    assert listed([]) == ""


def test_spans_of_time():
    assert [duration(value) for value in (0.04, 59.94, 60.0, 3599.0, 7260.0)] == [
        "0.0 s",
        "59.9 s",
        "1 min 0 s",
        "59 min 59 s",
        "2 h 1 min",
    ]


def test_only_the_space_before_a_unit_is_made_unbreakable():
    assert unbroken("3 specimens at 25 %, 0.4 1/m") == (
        "3 specimens at 25\N{NO-BREAK SPACE}%, 0.4\N{NO-BREAK SPACE}1/m"
    )


@pytest.mark.parametrize("replicates", [49, 200, 500, 2000, 20_000])
def test_a_p_value_at_the_resolution_of_its_replicates_is_a_bound(replicates):
    least, next_one = (p_value_text(k / (1 + replicates), replicates) for k in (1, 2))
    sign, bound = least.split()[1:]
    assert sign in ("<", "≤")
    assert 1.0 / (1 + replicates) <= float(bound) <= max(2.0 / (1 + replicates), 0.001)
    assert next_one.split()[1] == "=" or 2.0 / (1 + replicates) < 0.001


@pytest.mark.parametrize("value", [1.0, 0.5, 0.0996, 0.0994, 0.0249, 0.00995, 0.00213, 0.001, 1e-5])
def test_a_p_value_has_no_digits_that_say_nothing(value):
    name, sign, shown = p_value_text(value).split()
    digits = shown.lstrip("0.").rstrip("0")
    assert name == "p"
    assert len(digits) <= 2
    assert float(shown) == pytest.approx(value, rel=0.1) if sign == "=" else value < float(shown)


def test_a_p_value_that_is_not_known_is_no_number():
    assert "nan" not in p_value_text(float("nan"))
    assert p_value(float("nan")) == p_value(None) == NOTHING
