"""Effects as they are written on the command line."""

import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.errors import BayesdegError
from bayesdeg.laboratory.truth import parse_effect, parse_effects


def test_the_name_alone_means_the_first_parameter():
    cause, values = parse_effect("pressure_offset=14")
    assert cause is CATALOGUE["pressure_offset"]
    assert values == {"offset": 14.0}
    cause, values = parse_effect(" degradation_misread = -2.5 ")
    assert values == {"shift": -2.5}


def test_a_parameter_can_be_named():
    cause, values = parse_effect("degradation_misread.scatter=1e0")
    assert (cause.name, values) == ("degradation_misread", {"scatter": 1.0})


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_cause_can_be_hidden_at_its_typical_size(name):
    cause = CATALOGUE[name]
    texts = [f"{name}.{short}={value!r}" for short, value in cause.typical.items()]
    [hidden] = parse_effects(texts)
    assert hidden.cause is cause
    assert hidden.values == cause.typical
    assert {v.shape for v in hidden.effect.values()} == {(1, 1, 1)}


def test_what_is_not_given_is_neutral_and_causes_stand_in_order_of_application():
    hidden = parse_effects(["curvature_reading=8", "degradation_misread=3", "pressure_offset=14"])
    assert [h.cause.name for h in hidden] == [
        "degradation_misread",
        "pressure_offset",
        "curvature_reading",
    ]
    assert hidden[0].values == {"shift": 3.0, "scatter": 0.0}
    assert hidden[2].values == {"fibre_height": 8.0, "magnification": 0.0}


def test_parameters_of_one_cause_come_together():
    [hidden] = parse_effects(["degradation_misread=3", "degradation_misread.scatter=1"])
    assert hidden.values == {"shift": 3.0, "scatter": 1.0}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("presure_offset=14", "did you mean 'pressure_offset'"),
        ("gremlins=1", "cause 'gremlins'"),
        ("degradation_misread.shft=3", "'shft'; .* 'shift'"),
        ("degradation_misread.xyz=3", "it has shift, scatter"),
        ("pressure_offset=14kPa", r"'14kPa' is not a number; give a number \[kPa\].* 14"),
        ("pressure_offset=", "'' is not a number"),
        ("pressure_offset", "for example pressure_offset=14"),
        ("pressure_offset=nan", "impossible"),
        ("pressure_offset=inf", "impossible"),
        ("pressure_offset=1e9", "1e9 is far beyond"),
        ("creep.time_constant=1e8", "far beyond"),
        ("pressure_loss=2", "pressure_loss.fraction: 2 is impossible"),
        ("stress_measure=0.4", "0.4 is impossible under either 0 or 1"),
        ("", "unknown cause ''"),
    ],
)
def test_a_slip_is_told_with_what_would_be_right(text, message):
    with pytest.raises(BayesdegError, match=message):
        parse_effect(text)


def test_a_parameter_given_twice_is_refused():
    with pytest.raises(BayesdegError, match=r"pressure_offset\.offset is given twice"):
        parse_effects(["pressure_offset=14", "pressure_offset.offset=15"])
