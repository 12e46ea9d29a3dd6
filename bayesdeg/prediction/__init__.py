"""Predictions and decisions from a posterior."""
