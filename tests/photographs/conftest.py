"""Rendered photographs, from the module of the benchmark."""

import photograph_scenes
import pytest


@pytest.fixture(scope="session")
def scenes():
    return photograph_scenes
