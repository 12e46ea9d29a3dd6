"""Probability laws, one file for each kind of scale."""
