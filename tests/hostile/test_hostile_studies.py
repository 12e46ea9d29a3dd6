"""Every study and command line of the table is refused before anything is computed."""

import pytest

from tests.hostile.inputs import hostile_inputs
from tests.run.study_files import study_in

CASES = [case for case in hostile_inputs() if case.subject == "study"]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    study_in(folder)
    return folder


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_hostile_study_is_refused(case, sound, refused):
    refused(case, sound)
