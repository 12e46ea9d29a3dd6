"""Rendered photographs, from the module of the benchmark."""

import importlib
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="session")
def scenes():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        yield importlib.import_module("photograph_scenes")
    finally:
        sys.path.remove(str(BENCHMARKS))
