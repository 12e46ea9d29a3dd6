"""Every table of a report that was changed by hand is refused when the page is made again."""

import pytest

from tests.hostile.inputs import hostile_inputs
from tests.pages.synthetic_run import write_full

CASES = [case for case in hostile_inputs() if case.subject == "report"]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "report"
    write_full(folder, "named")
    return folder


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_hostile_report_is_refused(case, sound, refused):
    refused(case, sound)
