"""A study becomes a run folder: the order of the work."""
