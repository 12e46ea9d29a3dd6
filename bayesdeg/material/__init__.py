"""Quantities become constitutive laws: pure functions."""
