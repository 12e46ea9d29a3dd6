"""A model of readings is fitted: linearised, screened, searched."""
