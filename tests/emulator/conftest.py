"""A small surrogate of an actuator in closed form, trained once."""

import pytest

from bayesdeg.emulator.surrogate import Surrogate
from tests.emulator.closed_form import trained


@pytest.fixture(scope="session")
def surrogate() -> Surrogate:
    return trained()
