"""Predictions of held-out data."""
