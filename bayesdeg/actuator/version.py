"""The version of the finite element model, for those who compare it and solve nothing."""

MODEL_VERSION = "3"  # raised when numbers change: stored solutions then count no more
