"""Measured data: one module for each kind."""
