"""What a run computes with a model: calibration, verdict, checks."""
