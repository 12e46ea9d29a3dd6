"""Predictions of what took no part in a calibration."""
