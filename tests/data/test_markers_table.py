"""The table of points along the bottom line."""

import pytest

from bayesdeg.data.markers import MARKERS
from bayesdeg.data.study import check_table

HEAD = "specimen_id,degradation_pct,pressure_kPa,point,x_mm,y_mm,x_error_mm,y_error_mm\n"
ROWS = [f"a,0,{p},{i},{10 * i},{-0.01 * p * i},0.1,0.1" for p in (20, 40) for i in (1, 2, 3, 4)]


def checked(rows, head=HEAD):
    return check_table((head + "\n".join(rows)).encode(), MARKERS, degradation_sd_pct=1.0)


def test_lines_in_millimetres_and_in_pixels():
    found = checked(ROWS)
    assert not found.faults
    assert found.frame["mount"].unique().tolist() == ["horizontal"]
    head = "specimen_id,degradation_pct,pressure_kPa,point,x_px,y_px,scale_mm_per_px\n"
    assert not checked([f"a,0,20,{i},{i},{i},0.1" for i in (1, 2, 3, 4)], head).faults


@pytest.mark.parametrize(
    ("rows", "column", "row"),
    [
        ([*ROWS[:3], "a,0,20,4,,-1,0.1,0.1"], "x_mm", 5),
        ([*ROWS[:2], ROWS[3], ROWS[2]], "point", 5),
        (ROWS[:3], "point", 2),
        ([*ROWS[:3], "a,0,20,4.5,40,-1,0.1,0.1"], "point", 5),
        ([*ROWS[:3], "a,0,20,4,40,-1,-0.1,0.1"], "x_error_mm", 5),
    ],
)
def test_faults_say_where(rows, column, row):
    (fault,) = checked(rows).faults[:1]
    assert (fault.column, fault.row) == (column, row)
