"""Criticism of calibrated models: misfit, causes and predictive gain."""
