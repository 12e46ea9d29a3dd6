"""Marks of parametrized cases."""

import pytest


def long_unless(is_plain, *values, **options):
    """Return a case, marked `long` unless it belongs to a plain run."""
    return pytest.param(*values, marks=() if is_plain else pytest.mark.long, **options)
