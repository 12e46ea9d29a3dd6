"""A small surrogate of an actuator in closed form, trained once."""

import pytest

from bayesdeg.surrogate.surrogate import Surrogate
from tests.surrogate.closed_form import trained


@pytest.fixture(scope="session")
def surrogate() -> Surrogate:
    return trained()
