"""Bayesian calibration of degrading soft actuators that names what the simulation gets wrong."""

__version__ = "0.1.0"
