"""When tests cannot reveal a cause, and what tests are by default."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.causes.cause import Conditions
from bayesdeg.data.study import Study
from tests.causes.default_actuator import LEVELS, LOADING, THERE_AND_BACK, conditions_of

DEFAULT = Conditions(np.broadcast_to(LOADING, (6, 12)), LEVELS)
FRESH_ONLY = Conditions(np.broadcast_to(LOADING, (1, 12)), np.array([[0.3]]))
ROOMS = ("batch_stiffness", "temperature_softening")
OF_RUPTURE = ("dry_embrittlement", "flaw_embrittlement", "uneven_degradation")
NEED_DEGRADED = (
    *("degradation_misread", "degraded_skin", "delamination", "erosion", "paper_softening"),
    *("uneven_degradation", "degradation_scale", "degraded_shrinkage"),
)


def test_by_default_a_test_is_a_prompt_first_loading_in_a_horizontal_mount():
    shape = (6, 12)
    for name in ("time", "cycle", "unloading", "humidity", "mount", "temperature", "batch"):
        assert getattr(DEFAULT, name).shape == shape
    assert np.all(np.isnan(DEFAULT.time))
    assert np.all(np.isnan(DEFAULT.humidity))
    assert np.all(np.isnan(DEFAULT.temperature))
    assert np.all(DEFAULT.batch == 0)
    assert np.all(DEFAULT.cycle == 1)
    assert not np.any(DEFAULT.unloading)
    assert np.all(DEFAULT.mount == "horizontal")


def test_what_was_recorded_must_fit_the_readings():
    with pytest.raises(ValueError, match="broadcast"):
        Conditions(LOADING[None], np.array([[0.0]]), time=np.arange(5.0))


@pytest.mark.parametrize("name", NEED_DEGRADED)
def test_what_degradation_does_needs_degraded_actuators(name):
    assert find(name).blind(DEFAULT) is None
    assert find(name).blind(FRESH_ONLY).startswith("no degraded actuator")


def test_drying_needs_degraded_actuators_and_a_humidity():
    cause = find("dry_embrittlement")
    assert cause.blind(DEFAULT).endswith("not recorded")
    assert cause.blind(conditions_of(humidity=60.0)) is None
    fresh = Conditions(np.broadcast_to(LOADING, (1, 12)), np.array([[0.0]]))
    assert cause.blind(fresh).startswith("no degraded actuator")
    assert cause.needs == ("humidity_pct",)


def test_dry_air_shows_nothing_where_degraded_actuators_were_tested_as_they_were_stored():
    cause = find("dry_embrittlement")
    for humidity in (66.8, 67.0, 72.0):
        assert cause.blind(conditions_of(humidity=humidity)).endswith("67 %")
    # fresh ones, the first of six, are not weakened by dry air
    room = np.full((6, 12), 67.0)
    room[0] = 50.0
    assert cause.blind(conditions_of(humidity=room)).endswith("67 %")
    room[3] = 50.0
    assert cause.blind(conditions_of(humidity=room)) is None
    # most of the test counts, not a door that was opened
    room[3, 2:] = 67.0
    assert cause.blind(conditions_of(humidity=room)).endswith("67 %")


def test_flaws_need_far_degraded_actuators():
    cause = find("flaw_embrittlement")
    assert cause.blind(DEFAULT) is None
    at_20 = Conditions(DEFAULT.pressure[:5], LEVELS[:5])
    assert cause.blind(at_20).endswith("more than 20 %")


@pytest.mark.parametrize("name", ["creep", "humidity_drift"])
def test_what_takes_time_needs_times_that_pass(name):
    cause = find(name)
    assert cause.needs == ("time_s",)
    assert cause.blind(conditions_of()) is None
    assert cause.blind(DEFAULT).endswith("recorded")
    assert "passed" in cause.blind(conditions_of(hold=0.0))
    one_clock = np.full((6, 12), np.nan)
    one_clock[3] = np.arange(12.0)
    assert cause.blind(Conditions(DEFAULT.pressure, LEVELS, time=one_clock)) is None


def test_drying_needs_a_room_unlike_the_storage():
    cause = find("humidity_drift")
    stored = conditions_of(humidity=67.2)
    assert cause.blind(stored).endswith("67 %")
    assert cause.blind(conditions_of(humidity=np.array([67.0] * 11 + [60.0]))) is None


def test_mullins_needs_readings_after_the_first_loading():
    cause = find("mullins")
    assert "first loading" in cause.blind(DEFAULT)
    assert cause.blind(conditions_of(THERE_AND_BACK)) is None
    let_out = np.append(LOADING, 0.0)  # as a row that is not there
    assert "first loading" in cause.blind(conditions_of(let_out))
    again = np.concatenate([LOADING, LOADING])
    assert cause.blind(conditions_of(again)) is None


def test_friction_needs_both_branches_of_a_specimen():
    cause = find("hysteresis")
    assert cause.needs == ("branch",)
    down = np.arange(23) > 11
    assert cause.blind(conditions_of(THERE_AND_BACK, unloading=down)) is None
    apart = np.broadcast_to(np.arange(6)[:, None] > 2, (6, 23))
    for unloading in (False, True, apart):
        assert cause.blind(conditions_of(THERE_AND_BACK, unloading=np.array(unloading)))


def test_gravity_needs_a_mount_that_is_not_horizontal():
    cause = find("gravity")
    assert cause.needs == ("mount",)
    assert "horizontally" in cause.blind(DEFAULT)
    for mount in ("hanging", "bending_up", "bending_down"):
        assert cause.blind(conditions_of(mount=mount)) is None


def test_other_causes_are_never_hidden_by_the_conditions():
    hidden = {*NEED_DEGRADED, *OF_RUPTURE, "creep", "humidity_drift", "mullins", "gravity"}
    hidden |= {*ROOMS, "hysteresis"}
    for name in CATALOGUE.keys() - hidden:
        assert find(name).blind(FRESH_ONLY) is None, name


def test_each_cause_says_which_tests_it_changes():
    films, both = {"stress_measure"}, {"second_invariant", *ROOMS}
    for name, cause in CATALOGUE.items():
        want = {"actuator"}
        if name in films | both:
            want = {"tensile"} | ({"actuator"} if name in both else set())
        if name in OF_RUPTURE:
            want = {"rupture"}
        assert cause.acts_on == want, name


def actuators_of(batches):
    return pd.DataFrame({"specimen_id": list("abcdef"), "batch": batches, "temperature_C": np.nan})


def study_of(actuator, tensile=None):
    return Study("s", Path("s"), actuator=actuator, tensile=tensile)


@pytest.mark.parametrize(
    ("batches", "blind"),
    [
        ([None] * 6, True),
        (["A"] * 6, True),
        (["A", None, "", None, "A", ""], True),
        (["A", "B"] * 3, False),
        (list("ABCDAB"), False),
    ],
)
def test_batches_show_where_actuators_are_of_several(batches, blind):
    found = find("batch_stiffness").blind_in(study_of(actuators_of(batches)))
    assert (found is not None) == blind


def test_more_batches_than_there_are_parameters_are_not_judged():
    cause = find("batch_stiffness")
    for count, why in ((1, "one batch"), (4, None), (5, "more than 4")):
        said = cause.blind(conditions_of(batch=np.arange(6)[:, None] % count))
        assert said is None if why is None else why in said


@pytest.mark.parametrize(
    ("rooms", "of_films", "blind"),
    [
        ([np.nan] * 6, [27.0], True),
        ([24.0] * 6, [np.nan], True),
        ([24.0, 24.3] * 3, [24.2], True),
        ([27.0] * 6, [27.2], True),
        ([27.0] * 6, [np.nan], False),  # films are taken to have been pulled at 24 °C
        ([22.0, 27.0] * 3, [24.0], False),
    ],
)
def test_warmth_shows_where_tests_differ_in_it(rooms, of_films, blind):
    actuator = actuators_of(["A"] * 6).assign(temperature_C=rooms)
    films = pd.DataFrame({"specimen_id": ["f"], "temperature_C": of_films})
    found = find("temperature_softening").blind_in(study_of(actuator, films))
    assert (found is not None) == blind
