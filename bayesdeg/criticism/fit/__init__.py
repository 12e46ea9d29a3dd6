"""Fitting causes to readings: linearisation, screening and search."""
