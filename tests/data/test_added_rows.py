"""Rows that are added to a table of actuators."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.data.added import extend
from bayesdeg.errors import StudyError

HEAD = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m"
STUDY = f"{HEAD}\na,0,20,1\na,0,60,3\nb,10,20,0.8\nb,10,60,2.5\n"


def added(new, *, to=STUDY, earlier=None):
    before = None if earlier is None else earlier.encode()
    return extend(to.encode(), before, new.encode(), "new.csv", degradation_sd_pct=1.0)


def fault_of(new, **options):
    with pytest.raises(StudyError) as raised:
        added(new, **options)
    (fault,) = raised.value.faults
    return fault


def pressures(found, specimen):
    frame = found.table.frame
    return frame.loc[frame["specimen_id"] == specimen, "pressure_kPa"].tolist()


def test_a_new_specimen_comes_after_the_others():
    found = added(f"{HEAD}\nc,25,20,0.4\nc,25,60,1.1\n")
    assert found.table.frame["specimen_id"].tolist() == ["a", "a", "b", "b", "c", "c"]
    assert (found.specimens, found.rows) == (("c",), 2)
    assert found.table.frame["degradation_sd_pct"].tolist() == [1.0] * 6


@pytest.mark.parametrize(
    ("pressure", "order"), [(10, [10, 20, 60]), (40, [20, 40, 60]), (80, [20, 60, 80])]
)
def test_a_further_reading_goes_to_where_its_pressure_belongs(pressure, order):
    found = added(f"{HEAD}\na,0,{pressure},2\n")
    assert pressures(found, "a") == order
    assert pressures(found, "b") == [20, 60]


def test_a_reading_on_the_way_down_goes_to_its_own_branch():
    study = f"{HEAD},branch\na,0,20,1,\na,0,60,3,\na,0,50,2.9,unloading\na,0,10,0.7,unloading\n"
    found = added(f"{HEAD},branch\na,0,30,1.8,unloading\n", to=study)
    assert pressures(found, "a") == [20, 60, 50, 30, 10]


def test_another_cycle_and_a_reading_with_a_time_go_to_the_end():
    found = added(f"{HEAD},cycle\na,0,20,1.1,2\na,0,40,2.1,2\n")
    assert pressures(found, "a") == [20, 60, 20, 40]
    found = added(
        f"{HEAD},time_s\na,0,60,3.1,100\n", to=f"{HEAD},time_s\na,0,20,1,5\na,0,60,3,10\n"
    )
    assert pressures(found, "a") == [20, 60, 60]


@pytest.mark.long
@given(order=st.permutations([30, 40, 50, 70]))
@settings(max_examples=24, deadline=None)
def test_the_order_of_new_rows_of_one_loading_does_not_matter(order):
    rows = sorted(order[:2]) + sorted(order[2:])
    first = "".join(f"a,0,{p},{p / 20}\n" for p in sorted(rows[:2]))
    second = "".join(f"a,0,{p},{p / 20}\n" for p in sorted(rows[2:]))
    once = added(f"{HEAD}\n{first}")
    twice = added(f"{HEAD}\n{second}", earlier=once.added.decode())
    assert pressures(twice, "a") == [20, 30, 40, 50, 60, 70]
    assert added(f"{HEAD}\nc,25,20,0.4\n", earlier=twice.added.decode()).rows == 1


def test_rows_that_were_added_stay_with_those_that_come():
    once = added(f"{HEAD}\nc,25,20,0.4\n")
    twice = added(f"{HEAD},bend_angle_deg\nd,25,20,0.4,1.0\n", earlier=once.added.decode())
    lines = twice.added.decode().splitlines()
    assert lines == [f"{HEAD},bend_angle_deg", "c,25,20,0.4,", "d,25,20,0.4,1.0"]
    assert twice.specimens == ("d",)


def test_a_name_that_begins_like_a_comment_stays_a_name():
    once = added(f'{HEAD}\n"#1",25,20,0.4\n')
    twice = added(f"{HEAD}\nd,25,20,0.4\n", earlier=once.added.decode())
    assert twice.table.frame["specimen_id"].tolist()[-2:] == ["#1", "d"]


FAULTS = [
    # new rows, and row, column and value of the one fault in them
    ("specimen_id,degradation_pct,pressure_kPa,curvature\nc,0,1,1\n", (1, "curvature", None)),
    (f"{HEAD},colour\nc,25,20,0.4,red\n", (1, "colour", None)),
    (f"{HEAD}\nc,25,twenty,0.4\n", (2, "pressure_kPa", "twenty")),
    (f"{HEAD}\na,0,60,3.2\n", (2, "pressure_kPa", "60")),
    (f"{HEAD}\na,0,60,3\n", (2, None, "a,0,60,3")),
    (f"{HEAD}\na,5,80,3\n", (2, "degradation_pct", "5")),
    (f"{HEAD}\nc,250,20,0.4\n", (2, "degradation_pct", "250")),
    (f"{HEAD}\n", (1, None, None)),
    ("", (None, None, None)),
]


@pytest.mark.parametrize(("new", "place"), FAULTS)
def test_every_fault_has_its_place_in_the_new_file(new, place):
    fault = fault_of(new)
    assert fault.file == "new.csv"
    assert (fault.row, fault.column, fault.value) == place
    assert len(str(fault).splitlines()) == 1


def test_a_specimen_that_burst_has_no_further_readings():
    study = f"{HEAD},ruptured\na,0,20,1,0\na,0,60,,1\n"
    fault = fault_of(f"{HEAD}\na,0,80,4\n", to=study)
    assert (fault.file, fault.specimen) == ("new.csv", "a")
    assert pressures(added(f"{HEAD}\na,0,40,2\n", to=study), "a") == [20, 40, 60]
