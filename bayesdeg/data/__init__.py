"""Read a study folder: tables, settings, faults and doubts."""
