"""A study folder becomes a study: tables, settings, faults and doubts."""
