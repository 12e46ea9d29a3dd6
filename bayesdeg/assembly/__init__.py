"""From a study to a model of it."""
