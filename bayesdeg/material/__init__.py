"""Constitutive laws, degradation trends and rupture as pure functions."""
