import pytest

from bayesdeg.data.cells import check_header
from bayesdeg.data.tables import ACTUATOR
from bayesdeg.errors import Fault

REQUIRED = [name for name, column in ACTUATOR.columns.items() if column.required]
OPTIONAL = [name for name, column in ACTUATOR.columns.items() if not column.required]
PLACE = Fault("actuator.csv", "", "", 1)


@pytest.mark.parametrize(
    "name",
    ["operator", "camera", "amount", "time_of_day", "time_h", "curvature_per_m_raw", "notes",
     "degradation_pct_dry", "humidity_sensor", "count", "paper_batch"],
)  # fmt: skip
def test_columns_of_the_users_own_are_nobodys_fault(name: str) -> None:
    assert check_header([*REQUIRED, name], PLACE, required=REQUIRED, optional=OPTIONAL) == {}


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("Branch", "branch"),
        ("cycles", "cycle"),
        ("mout", "mount"),
        ("time_min", "time_s"),
        ("humidity", "humidity_pct"),
        ("bend_angle_rad", "bend_angle_deg"),
        ("curvature_sd_per_mm", "curvature_sd_per_m"),
        ("rupture", "ruptured"),
        ("degradation_sd", "degradation_sd_pct"),
    ],
)
def test_slips_in_optional_columns_are_found(name: str, meant: str) -> None:
    faults = check_header([*REQUIRED, name], PLACE, required=REQUIRED, optional=OPTIONAL)
    assert list(faults) == [meant]
    assert faults[meant].column == name


@pytest.mark.parametrize("column", REQUIRED)
@pytest.mark.parametrize("slip", [str.upper, lambda c: c[:-1], lambda c: c.replace("_", "")])
def test_slips_in_required_columns_are_one_fault(column, slip) -> None:
    names = [slip(name) if name == column else name for name in REQUIRED]
    faults = check_header(names, PLACE, required=REQUIRED, optional=OPTIONAL)
    assert list(faults) == [column]
    assert faults[column].column == slip(column)
