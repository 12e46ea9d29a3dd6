"""From a study to a run folder: the stages of the work."""
